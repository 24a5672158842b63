"""The procedures of the abnormal cases: what happens when cable, power, manager, fire panel or robot mode go away."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

from drivers.errors import ConnectFailed
from lift_manager.client.session import ActiveSession
from lift_manager.commissioning.checkout.access import Access
from lift_manager.commissioning.checkout.lift import Sample, Watch, WatchedLift
from lift_manager.commissioning.checkout.person import Prompt
from lift_manager.commissioning.checkout.plan import WATCHED_S
from lift_manager.commissioning.checkout.registers import Registered, Registers
from lift_manager.commissioning.checkout.steps.press import call, other_floor, session
from lift_manager.commissioning.checkout.steps.signals import TECHNICIAN
from lift_manager.commissioning.checkout.steps.step import Step, at, shown
from register_maps.vocabulary import Kind
from register_maps.words import Door, Side

NOTICED_WITHIN_S = 15.0
"""How long the manager may take to notice a lost controller. Chosen: the longest `max_age_s` and some polls."""
BACK_WITHIN_S = 180.0
"""How long a controller may take to start. Chosen: a slow PLC with a self-test."""
BOOT_WATCHED_S = 15.0
"""How long a controller that answers again is watched for values that are not true. Chosen."""
RELEASED_WITHIN_S = 10.0
"""How long everything may take to be released. Chosen: a manager does it in its next poll."""
QUIET_FIRST_S = 5.0
"""Before the comparison begins: a controller may notice the end of the heartbeat of the manager."""
WATCHDOG_WITHIN_S = 20.0
"""How long a watchdog may take, the dwell of the door included. Chosen: watchdogs of lifts are set to some seconds."""
SLOT_FREE_WITHIN_S = 30.0
"""How long a controller may count the connection of a killed manager as open. Chosen: half of what is watched."""
WATCHED_FOR_S = 60.0
"""For how long the door is watched. Chosen."""
SHOWN_EVERY_S = 20.0
"""How often the time left is shown during a long look. Chosen."""
LANDING_S = 20.0
"""How long a landing call has to take the car away. Chosen."""


async def check_cable(step: Step, lift: WatchedLift) -> None:
    """The network cable is pulled while the manager holds the lift, and plugged in again."""
    async with lift.watched() as watch, session(lift) as held:
        if not await _hold_here(step, lift, watch, held):
            return
        await step.done("Pull the network cable of the controller.", Prompt.CABLE, value="out")
        await _lost(step, watch)
        if not await step.yes(
            "Is the lift back with its passengers: the door closes, and its buttons work?", Prompt.SERVES
        ):
            step.problem(
                "without the network the lift does not serve its passengers: its controller needs a watchdog that releases our outputs"
            )
        await step.done("Plug the network cable in again.", Prompt.CABLE, value="in")
        await _back(step, watch)


async def check_power(step: Step, lift: WatchedLift) -> None:
    """The controller is switched off and on while the manager holds the lift."""
    async with lift.watched() as watch, session(lift) as held:
        if not await _hold_here(step, lift, watch, held):
            return
        await step.done("Switch the controller off.", Prompt.POWER, value="off", rule=TECHNICIAN)
        await _lost(step, watch)
        await step.done("Switch the controller on again.", Prompt.POWER, value="on")
        if not await _back(step, watch):
            return
        back = watch.newest
        await step.wait(BOOT_WATCHED_S, "it answers again; watching what it shows while it starts")
        invited = [s for s in watch.samples if s.at >= back.at and s.is_live and s.lift.robot_door == "open"]
        sides = [side for side in Side if f"door.{side}" in step.codec.signals]
        for side in sides:
            is_open = await step.yes(f"Is the {side} door open?", Prompt.DOOR, subject=side)
            if invited and not is_open:
                step.problem(
                    f"after its start the controller showed an open {side} door that is not open: zeros on the wire read as a healthy lift"
                )


async def check_fire(step: Step, lift: WatchedLift) -> None:
    """Fire while the manager holds the lift: everything is released, and stays released until a person acknowledges it."""
    fires = [name for name in ("fire", "fireman", "mode") if name in step.codec.signals]
    async with lift.watched() as watch:
        async with session(lift) as held:
            if not await _hold_here(step, lift, watch, held):
                return
            began = watch.newest
            await step.done(
                "Give the fire signal at the fire panel, or at the input.", Prompt.FIRE, value="on", rule=TECHNICIAN
            )
            where = ", ".join(at(step, name) for name in fires) or "no signal of this map"
            if not await watch.until(_on_fire, RELEASED_WITHIN_S):
                changed = watch.changed(began)
                instead = f"; {', '.join(at(step, name) for name in changed)} changed" if changed else ""
                step.problem(
                    f"the fire is not seen at {where}: the contact is not wired, or its wire goes to another input{instead}"
                )
            elif not await _released(watch):
                step.problem(f"outputs are still on in a fire: {', '.join(watch.writes[-1].pressed)}")
            if not await step.yes("Does the lift do its own fire recall, with no robot?", Prompt.SHOWN, subject="fire"):
                step.problem("the lift does not do its fire recall while the manager is connected")
        await step.done("Take the fire signal back, and reset the fire panel and the lift.", Prompt.FIRE, value="off")
        step.person.show(f"waiting until the fire is over at the controller: at most {BACK_WITHIN_S:g} s")
        if not await watch.until(lambda sample: sample.is_live and not _on_fire(sample, latched=False), BACK_WITHIN_S):
            step.problem(f"the fire is still shown at {where} after it was taken back")
        if not watch.newest.lift.restrictions.fire_latched and not step.problems:
            step.problem("the manager does not keep robots off after the fire")


async def check_robot_mode(step: Step, lift: WatchedLift) -> None:
    """In robot mode the car serves nobody else; once it is withdrawn that shows, and no call is pressed."""
    async with lift.watched() as watch, session(lift) as held:
        here = other_floor(step, watch.newest)
        await step.may_move(f"The manager calls the empty car to {here} for a robot. Is everybody clear?")
        if not await call(step, lift, watch, held, here, hold=False):
            return
        floor = other_floor(step, watch.newest)
        await step.done(
            f"Wait until the door is closed, and press the landing button of {floor}.", Prompt.LANDING, value=floor
        )
        await step.wait(LANDING_S, "watching whether the car stays")
        if not await step.yes(f"Is the car still at {here}?", Prompt.STAYED):
            step.problem(
                f"the car left for a landing call although {at(step, 'robot_mode')} is on: the lift ignores it"
                if step.item.subject
                else "the car left for a landing call: this lift has no robot mode, and passengers can take it from a robot"
            )
        if not step.item.subject:
            return
        await step.done(
            "Take robot mode away, with its key or at the panel.", Prompt.WITHDRAW, value="on", rule=TECHNICIAN
        )
        shows = [name for name in ("robot_mode_on", "robots_allowed", "mode") if name in step.codec.signals]
        if shows and not await watch.until(_without_robot_mode, RELEASED_WITHIN_S):
            step.problem(
                f"robot mode was taken away, and it does not show at {', '.join(at(step, name) for name in shows)}"
            )
        elif shows:
            await _refuses_to_call(step, watch, held, floor)
        await step.done("Give robot mode back.", Prompt.WITHDRAW, value="off")


async def _refuses_to_call(step: Step, watch: Watch, held: ActiveSession, floor: str) -> None:
    """See that a request for a floor presses no call that needs robot mode."""
    began = watch.newest.at
    command = await held.go_to(floor, hold_door=False, wait=RELEASED_WITHIN_S)
    step.saw(f"without robot mode a request for {floor} is {command.status}: {command.reason}")
    needs = {name for name, one in step.codec.commands.items() if "robot_mode_on" in one.spec.requires}
    pressed = {one for one in watch.pressed(began) if one.partition(" ")[0] in needs}
    if pressed:
        step.problem(f"pressed without robot mode: {', '.join(sorted(pressed))}")


async def check_quiet(step: Step, registers: Registers) -> None:
    """Watch all registers while no manager runs: nothing may write outputs, and no signal may change by itself."""
    await step.wait(QUIET_FIRST_S, "nobody touches the lift now; first it comes to rest")
    first = await registers.look()
    loop = asyncio.get_running_loop()
    step.person.show(f"watching all inputs and outputs while nothing is written: {WATCHED_S:g} s")
    ends_at = loop.time() + WATCHED_S
    left_s = WATCHED_S - SHOWN_EVERY_S
    changed: dict[str, list[str]] = {}
    for name, code in first.outputs.items():
        if code is not None and not step.codec.commands[name].spec.is_heartbeat:
            changed.setdefault(name, []).append(_code(code))
    looks = 1
    while loop.time() < ends_at:
        await asyncio.sleep(0.2)
        if 0 < ends_at - loop.time() < left_s:
            step.person.show(f"{left_s:g} s left")
            left_s -= SHOWN_EVERY_S
        now = await registers.look()
        looks += 1
        for name, text in _differences(step, first, now):
            if text not in changed.setdefault(name, []):
                changed[name].append(text)
    step.figures["looks"] = looks
    outputs = {name: seen for name, seen in changed.items() if name in step.codec.commands}
    signals = {name: seen for name, seen in changed.items() if name in step.codec.signals}
    for name, seen in outputs.items():
        step.problem(
            f"{at(step, name)} reads {', '.join(seen)} although nothing was written: another master writes it; find it, and keep it off this"
            " controller"
        )
    for name, seen in signals.items():
        step.problem(
            f"{at(step, name)} changed to {', '.join(seen)} although nobody touched the lift: the input floats or drifts, or somebody else"
            " writes it"
        )


async def check_watchdog(step: Step, access: Access, floor: str) -> None:
    """A second manager that holds the door is killed; the controller has to let go by itself."""
    held = [name for name in step.item.subject.split() if name.startswith("hold_door")]
    if not held:
        step.saw("no door is held on this lift")
        return
    await step.may_move(
        f"A second manager opens the door at {floor}, holds it, and is then killed. Is everybody clear?"
    )
    sides = [Side(name.partition(".")[2]) for name in held]
    loop = asyncio.get_running_loop()
    async with access.holder(floor) as holder:
        is_held = await step.yes(
            f"Is the {' and '.join(sides)} door open, and held?", Prompt.HOLDS, subject=" ".join(sides)
        )
        if not is_held:
            step.problem(
                f"the second manager holds the door by {', '.join(at(step, name) for name in held)}, and it is not open"
            )
        await holder.kill()
        killed_at = loop.time()
    if not is_held:
        return
    async with AsyncExitStack() as stack:
        await _lets_go(step, await _connected(stack, access), sides, killed_at)
    let_go_s = step.figures.get("let_go_s")
    outputs = ", ".join(at(step, name) for name in held)
    cure = (
        "the controller has no watchdog on it, or a long one; the lift company sets it, or the map must say `latches`"
    )
    if let_go_s is not None and let_go_s <= WATCHDOG_WITHIN_S:
        step.saw(f"the door was released {let_go_s:g} s after the manager was killed")
    elif {step.codec.commands[name].spec.on_link_loss for name in held} == {"latches"}:
        step.notes.append(
            "the door stays open, as the map says of this lift: the lift technician releases it at the panel"
        )
    elif let_go_s is not None:
        step.problem(f"{outputs}: the door was released only {let_go_s:g} s after the manager was killed: {cure}")
    else:
        step.problem(f"{outputs}: the door is still held {WATCHED_FOR_S:g} s after the manager was killed: {cure}")


async def _connected(stack: AsyncExitStack, access: Access) -> Registers:
    """Read again after a manager was killed, as soon as its connection slot is free. Raises ConnectFailed."""
    loop = asyncio.get_running_loop()
    ends_at = loop.time() + SLOT_FREE_WITHIN_S
    while True:
        try:
            return await stack.enter_async_context(access.registers())
        except ConnectFailed:
            if loop.time() >= ends_at:
                raise
            await asyncio.sleep(1.0)


async def _lets_go(step: Step, registers: Registers, sides: list[Side], killed_at: float) -> None:
    """Note when doors begin to close; without a signal for them, a person says it."""
    loop = asyncio.get_running_loop()
    shown_by = [f"door.{side}" for side in sides if f"door.{side}" in step.codec.signals]
    if not shown_by:
        if await step.yes(
            "Wait until the door closes by itself, at most a minute. Did it close?", Prompt.CLOSED, subject=sides[0]
        ):
            step.figures["let_go_s"] = round(loop.time() - killed_at, 1)
        return
    step.person.show(f"the manager is killed; watching when the door is let go: at most {WATCHED_FOR_S:g} s")
    while loop.time() < killed_at + WATCHED_FOR_S:
        now = await registers.look()
        if all(now.signals[name] is not Door.OPEN for name in shown_by):
            step.figures["let_go_s"] = round(loop.time() - killed_at, 1)
            return
        await asyncio.sleep(0.1)


async def _hold_here(step: Step, lift: WatchedLift, watch: Watch, held: ActiveSession) -> bool:
    floor = watch.newest.lift.floor or step.floors[0]
    await step.may_move(f"The manager opens the door at {floor} and holds it. Is everybody clear?")
    return await call(step, lift, watch, held, floor, hold=True)


async def _lost(step: Step, watch: Watch) -> None:
    step.person.show(f"waiting until the manager notices: at most {NOTICED_WITHIN_S:g} s")
    if not await watch.until(lambda sample: not sample.is_live, NOTICED_WITHIN_S):
        step.problem(
            f"the manager still reads this lift {NOTICED_WITHIN_S:g} s later: that was another cable or controller, or a gateway answers for it"
        )
        return
    step.saw(f"noticed: {watch.newest.lift.reason}")


async def _back(step: Step, watch: Watch) -> bool:
    """Wait for the controller, and see that no call is pressed by itself; return whether it is back."""
    lost_at, loop = watch.newest.at, asyncio.get_running_loop()
    began = loop.time()
    step.person.show(f"waiting until the controller answers again: at most {BACK_WITHIN_S:g} s")
    if not await watch.until(lambda sample: sample.is_live, BACK_WITHIN_S):
        step.problem(
            f"the controller does not answer again within {BACK_WITHIN_S:g} s: is a connection slot still taken?"
        )
        return False
    step.figures["back_s"] = round(loop.time() - began, 1)
    await step.wait(RELEASED_WITHIN_S, "watching whether anything is pressed by itself")
    calls = {one for one in watch.pressed(lost_at) if step.codec.commands[one.partition(" ")[0]].is_call}
    if calls:
        step.problem(f"a call was pressed again without a request: {', '.join(sorted(calls))}")
    return True


async def _released(watch: Watch) -> bool:
    """Wait until the last write leaves nothing on."""
    return await watch.until(lambda _: not watch.writes or not watch.writes[-1].pressed, RELEASED_WITHIN_S)


def _on_fire(sample: Sample, *, latched: bool = True) -> bool:
    return (
        sample.value("fire") is True
        or sample.value("fireman") is True
        or sample.lift.mode == "fire"
        or (latched and sample.lift.restrictions.fire_latched)
    )


def _without_robot_mode(sample: Sample) -> bool:
    return sample.is_live and (
        sample.value("robot_mode_on") is False
        or sample.value("robots_allowed") is False
        or ("mode" in sample.signals and sample.value("mode") != "robot")
    )


def _differences(step: Step, first: Registered, now: Registered) -> list[tuple[str, str]]:
    steady = {Kind.FLAG, Kind.FLOOR, Kind.FLOORS, Kind.DOOR, Kind.MODE, Kind.MOTION}
    found = [
        (name, _code(code))
        for name, code in now.outputs.items()
        if code != first.outputs[name] and not step.codec.commands[name].spec.is_heartbeat
    ]
    found += [
        (name, shown(value))
        for name, value in now.signals.items()
        if value != first.signals[name] and step.codec.signals[name].kind in steady and name != "watchdog_tripped"
    ]
    return found


def _code(code: int | None) -> str:
    return "off" if code is None else f"on ({code})"
