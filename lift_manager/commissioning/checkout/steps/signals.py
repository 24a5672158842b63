"""The procedure of a signal: it follows what a person does, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable

from lift_manager.commissioning.checkout.lift import Sample, Watch, WatchedLift
from lift_manager.commissioning.checkout.person import Prompt
from lift_manager.commissioning.checkout.plan import BY_BUTTONS, BY_THE_MANAGER, BY_TRAVEL
from lift_manager.commissioning.checkout.steps.press import other_floor, ride
from lift_manager.commissioning.checkout.steps.step import Step, at, raw_text, shown
from register_maps.meanings import SIGNAL_MEANINGS
from register_maps.vocabulary import SAFETY_FLAGS, Kind

FOLLOWS_WITHIN_S = 5.0
"""How long a signal may take to follow. Chosen: a filter of a controller input is rarely longer than a second."""
CHANGES_WITHIN_S = 10.0
"""How long a counter may stand still, where the map has no limit of its own. Chosen."""
ON_ITS_OWN = frozenset({"alive", "car_position", "load", "mode"})
"""Signals that may change beside any other."""
SERVICES = {
    "independent": "Put the lift into independent service",
    "out_of_service": "Put the lift out of service",
    "inspection": "Put the lift under inspection",
}
"""What a key can do at most lifts, the easiest first."""
SIMULATES = "Only the lift technician simulates an input."
TECHNICIAN = "Only the lift technician does this, at the controller: never in the safety chain, never in the shaft."


async def check_signal(step: Step, lift: WatchedLift) -> None:
    """Carry out the item of a signal."""
    name = step.item.subject
    signal = step.codec.signals[name]
    async with lift.watched() as watch:
        match signal.kind:
            case _ if name in BY_THE_MANAGER:
                await _by_the_manager(step, lift, watch, name)
            case Kind.FLOOR | Kind.FLOORS:
                await (_sent if name in BY_BUTTONS else _floor)(step, watch, name)
            case Kind.DOOR:
                await _door(step, watch, name)
            case Kind.MOTION:
                await _motion(step, watch, name)
            case Kind.COUNTER:
                await _counter(step, watch, name)
            case Kind.NUMBER:
                await _number(step, watch, name)
            case Kind.MODE:
                await _mode(step, watch, name)
            case Kind.FLAG:
                await (_travelled if name in BY_TRAVEL else _flag)(step, watch, name)


async def _flag(step: Step, watch: Watch, name: str) -> None:
    rest = watch.newest.value(name) is True
    for expected in (not rest, rest):
        text = f"Make it {'so' if expected else 'no longer so'}: {SIGNAL_MEANINGS[name]}."
        await _follow(step, watch, name, text, expected, rule=SIMULATES)
    if not step.problems:
        await _disconnect(step, watch, name, rest)


async def _disconnect(step: Step, watch: Watch, name: str, rest: object) -> None:
    before = watch.newest
    await step.done(f"Disconnect the wire of {at(step, name)}.", Prompt.DISCONNECT, subject=name, rule=TECHNICIAN)
    await step.wait(FOLLOWS_WITHIN_S, "watching what it shows without its wire")
    broken = watch.newest.value(name)
    step.saw(f"disconnected: {raw_text(watch.newest, name)}")
    if broken == before.value(name) and name in SAFETY_FLAGS:
        step.notes.append(
            f"{at(step, name)}: a broken wire reads the same as before, so it is not noticed; a contact that is closed while"
            " all is well would show it"
        )
    await step.done(f"Connect {at(step, name)} again.", Prompt.RECONNECT, subject=name, rule=TECHNICIAN)
    if not await watch.until(lambda sample: sample.value(name) == rest, FOLLOWS_WITHIN_S):
        step.problem(f"{at(step, name)} shows {raw_text(watch.newest, name)} since its wire was connected again")


async def _door(step: Step, watch: Watch, name: str) -> None:
    side = name.partition(".")[2]
    await _follow(step, watch, name, f"Open the {side} door with its button, and keep it open.", "open")
    await _follow(step, watch, name, f"Let the {side} door close.", "closed", within_s=20.0)


async def _mode(step: Step, watch: Watch, name: str) -> None:
    rest = watch.newest.value(name)
    step.saw(f"at rest: {raw_text(watch.newest, name)}")
    values = step.codec.map.signals[name].values or {}
    expected = next((mode for mode in SERVICES if mode in values.values()), "")
    if expected:
        await _follow(step, watch, name, f"{SERVICES[expected]} with its key.", expected)
    await _follow(step, watch, name, "Put the lift into normal service.", rest if expected else "normal")


async def _floor(step: Step, watch: Watch, name: str) -> None:
    for floor in (step.floors[0], step.floors[-1]):
        await step.done(
            f"Send the car to {floor} with its own buttons, and wait until it stands.", Prompt.SEND, value=floor
        )
        real = await step.where()
        if not await watch.until(_shows(name, real), FOLLOWS_WITHIN_S):
            seen = shown(watch.newest.value(name))
            step.problem(
                f"{at(step, name)} shows {seen} (raw {_raw(watch.newest, name)}) while the car is at {real}: the floors may be"
                " shifted by one, or their contacts exchanged; compare the codes with the vendor's table"
            )
        step.saw(f"car at {real}: {raw_text(watch.newest, name)}")


async def _sent(step: Step, watch: Watch, name: str) -> None:
    floor = other_floor(step, watch.newest)
    before = watch.newest
    await step.done(
        f"Send the car to {floor} with its own buttons, and wait until it stands.", Prompt.SEND, value=floor
    )
    seen = watch.changed(before).get(name, [])
    step.saw(f"{name} showed {', '.join(map(shown, seen)) or 'no change'}")
    if not any(floor in str(value) for value in seen):
        step.problem(
            f"{at(step, name)} did not show {floor} while the car was sent there{_instead(step, watch, before, name)}"
        )


async def _motion(step: Step, watch: Watch, name: str) -> None:
    sent = "Send the car to {} with its own buttons, and wait until it stands."
    await step.done(sent.format(step.floors[0]), Prompt.SEND, value=step.floors[0])
    for floor, way in ((step.floors[-1], "up"), (step.floors[0], "down")):
        before = watch.newest
        await step.done(sent.format(floor), Prompt.SEND, value=floor)
        seen = watch.changed(before).get(name, [])
        if way not in seen:
            what = f"it showed {', '.join(map(shown, seen))}" if seen else "it did not change"
            step.problem(
                f"{at(step, name)} did not show {way} while the car went {way}: {what}; up and down may be exchanged"
            )
        step.saw(f"{way}: {', '.join(map(shown, seen)) or 'no change'}")


async def _travelled(step: Step, watch: Watch, name: str) -> None:
    before, floor = watch.newest, other_floor(step, watch.newest)
    await step.done(
        f"Send the car to {floor} with its own buttons, and wait until it stands there with its door closed.",
        Prompt.SEND,
        value=floor,
    )
    seen = watch.changed(before).get(name, [])
    step.saw(
        f"{name} was {raw_text(before, name)}, showed {', '.join(map(shown, seen)) or 'no change'}, and is {raw_text(watch.newest, name)}"
    )
    if before.value(name) is not True or watch.newest.value(name) is not True:
        step.problem(
            f"{at(step, name)} shows {raw_text(watch.newest, name)} while the car stands at {floor}{_instead(step, watch, before, name)}"
        )
    elif False not in seen:
        step.problem(f"{at(step, name)} did not change while the car travelled{_instead(step, watch, before, name)}")
    else:
        await _disconnect(step, watch, name, rest=True)


async def _counter(step: Step, watch: Watch, name: str) -> None:
    limit_s = step.codec.map.signals[name].must_change_within_s or CHANGES_WITHIN_S
    before = watch.newest
    if not await watch.until(lambda sample: sample.value(name) != before.value(name), limit_s):
        step.problem(
            f"{at(step, name)} did not change within {limit_s:g} s: the program of the controller does not count it"
        )
    step.saw(f"{raw_text(before, name)}, then {raw_text(watch.newest, name)}")


async def _number(step: Step, watch: Watch, name: str) -> None:
    before = watch.newest
    if name == "car_position":
        floor = other_floor(step, before)
        await step.done(
            f"Send the car to {floor} with its own buttons, and wait until it stands.", Prompt.SEND, value=floor
        )
        if not watch.changed(before).get(name):
            step.problem(
                f"{at(step, name)} did not change while the car travelled{_instead(step, watch, before, name)}"
            )
    elif name == "load":
        await step.done("Step into the car, or put a known weight into it.", Prompt.MAKE, subject=name, value="more")
        if not watch.changed(before).get(name):
            step.problem(f"{at(step, name)} did not change with a load in the car{_instead(step, watch, before, name)}")
    elif not await step.yes(
        f"{at(step, name)} shows {raw_text(before, name)}: is that right?", Prompt.SHOWN, subject=name
    ):
        step.problem(f"{at(step, name)} shows {raw_text(before, name)}, which is not right")
    step.saw(f"{raw_text(before, name)}, then {raw_text(watch.newest, name)}")


async def _by_the_manager(step: Step, lift: WatchedLift, watch: Watch, name: str) -> None:
    start = watch.newest.lift.floor or step.floors[0]
    destination = other_floor(step, watch.newest)
    await step.may_move(
        f"The manager takes the empty car from {start} to {destination} as for a robot. Is everybody clear?"
    )
    before = watch.newest
    ridden = await ride(lift, start, destination)
    seen = watch.changed(before).get(name, [])
    step.saw(f"during a trip {start} to {destination}: {', '.join(map(shown, seen)) or 'no change'}")
    if not seen:
        reason = "" if ridden.is_complete else f" (the trip ended early: {ridden.reason})"
        step.problem(
            f"{at(step, name)} did not change during a whole trip{reason}{_instead(step, watch, before, name)}"
        )
    elif not await watch.until(
        lambda sample: sample.value(name) in (before.value(name), False, None), CHANGES_WITHIN_S
    ):
        step.problem(f"{at(step, name)} still shows {raw_text(watch.newest, name)} after the trip")


async def _follow(
    step: Step,
    watch: Watch,
    name: str,
    text: str,
    expected: object,
    *,
    within_s: float = FOLLOWS_WITHIN_S,
    rule: str = "",
) -> None:
    """Let a person make something so, and see that the signal shows it and that nothing else changes unexplained."""
    before = watch.newest
    await step.done(text, Prompt.MAKE, subject=name, value=shown(expected), rule=rule)
    follows = await watch.until(_shows(name, expected), within_s)
    step.saw(f"{name} shows {raw_text(watch.newest, name)}")
    if not follows:
        step.problem(
            f"{at(step, name)} shows {raw_text(watch.newest, name)}, not {shown(expected)}{_instead(step, watch, before, name)}"
        )
        return
    others = {one: seen for one, seen in watch.changed(before).items() if one not in ON_ITS_OWN | {name}}
    if others and not await step.yes(
        f"{_listed(step, before, others)} changed too. Did the lift really do that?",
        Prompt.SHOWN,
        subject=" ".join(others),
    ):
        step.problem(
            f"{_listed(step, before, others)} changed too when only {at(step, name)} was to change: look for crossed or bridged wires"
        )


def _shows(name: str, value: object) -> Callable[[Sample], bool]:
    return lambda sample: sample.is_live and sample.value(name) == value


def _instead(step: Step, watch: Watch, before: Sample, name: str) -> str:
    """Return what changed instead of a signal, and the most likely reason."""
    changed = watch.changed(before)
    others = {one: seen for one, seen in changed.items() if one not in ON_ITS_OWN | {name}}
    if step.codec.signals[name].kind is Kind.FLAG and name not in BY_TRAVEL:
        # a lift that obeys an input moves: only another input can be the exchanged one
        others = {one: seen for one, seen in others.items() if _is_input(step, one)}
    if others:
        return f"; {_listed(step, before, others)} changed instead: the two may be exchanged"
    if name in changed:
        return ": it shows the opposite or something else; the contact may be inverted (normally closed)"
    return ": it stays the same; check contact, wire, and the address in the vendor's table"


def _is_input(step: Step, name: str) -> bool:
    return step.codec.signals[name].kind is Kind.FLAG and name not in BY_TRAVEL | BY_THE_MANAGER


def _listed(step: Step, before: Sample, others: dict[str, list[object]]) -> str:
    parts = [
        f"{at(step, one)} from {shown(before.value(one))} to {', '.join(map(shown, seen))}"
        for one, seen in others.items()
    ]
    return " and ".join(parts)


def _raw(sample: Sample, name: str) -> object:
    found = sample.signals.get(name)
    return None if found is None else found.raw
