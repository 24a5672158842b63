"""The procedures of a command and of a floor: exactly this output, and the lift does it."""

from __future__ import annotations

from lift_manager.commissioning.checkout.lift import Sample, Watch, WatchedLift
from lift_manager.commissioning.checkout.person import Prompt
from lift_manager.commissioning.checkout.steps.press import DOOR_WITHIN_S, call, other_floor, refused, ride, session
from lift_manager.commissioning.checkout.steps.step import Step, at
from register_maps.meanings import COMMAND_MEANINGS
from register_maps.words import Side

TIMES = 2
"""How often each command is pressed: once may be chance."""
HOLD_S = 15.0
"""How long the door is held before the question. Chosen: longer than the dwell of a passenger lift."""
BEATS = 3
_DURING_A_TRIP = ("go", "robot_in_place", "robot_left")


async def check_command(step: Step, lift: WatchedLift) -> None:
    """Carry out the item of a command."""
    name = step.item.subject
    async with lift.watched() as watch:
        if step.codec.commands[name].spec.is_heartbeat:
            await _heartbeat(step, watch, name)
            return
        for number in range(1, TIMES + 1):
            if step.problems:
                return
            began = watch.newest.at
            step.saw(f"press {number} of {TIMES}")
            if name in _DURING_A_TRIP:
                await _trip(step, lift, watch)
            elif step.codec.commands[name].is_call:
                await _call(step, lift, watch)
            elif name == "robot_mode":
                await _robot_mode(step, lift, watch)
            elif name.startswith("hold_door"):
                await _hold(step, lift, watch, Side(name.partition(".")[2]))
            else:
                await _close(step, lift, watch, Side(name.partition(".")[2]))
            _check_outputs(step, watch, name, began)


async def check_floor(step: Step, lift: WatchedLift) -> None:
    """Carry out the item of a floor with its doors."""
    floor = step.item.subject
    async with lift.watched() as watch:
        await step.may_move(f"The manager calls the empty car to {floor} and holds its door. Is everybody clear?")
        async with session(lift) as held:
            if await call(step, lift, watch, held, floor, hold=True):
                await _compare_floor(step, floor)
                await _compare_doors(step, watch, floor)


async def _compare_floor(step: Step, floor: str) -> None:
    real = await step.where()
    if real != floor:
        step.problem(
            f"the car was called to {floor}, all signals show {floor}, and it is at {real}: the calls of {floor} and {real} may be crossed,"
            " or all floors are shifted by one; compare the codes of the calls and of car_floor with the vendor's table"
        )


async def _compare_doors(step: Step, watch: Watch, floor: str) -> None:
    for side in Side:
        if f"door.{side}" not in step.codec.signals and f"hold_door.{side}" not in step.codec.commands:
            continue
        is_open = await step.yes(f"Is the {side} door open?", Prompt.DOOR, subject=side)
        if watch.newest.door_is_open(side) != is_open and f"door.{side}" in step.codec.signals:
            real = "open" if is_open else "not open"
            step.problem(
                f"{at(step, f'door.{side}')} shows {watch.newest.lift.doors.get(side)} while the door is {real}"
            )
        if not is_open and watch.newest.lift.robot_door == "open":
            step.problem(f"a robot would be invited to drive at {floor} while the {side} door is not open")


async def _call(step: Step, lift: WatchedLift, watch: Watch) -> None:
    floor = other_floor(step, watch.newest)
    await step.may_move(f"The manager calls the empty car to {floor}. Is everybody clear?")
    async with session(lift) as held:
        if await call(step, lift, watch, held, floor, hold=False):
            await _compare_floor(step, floor)


async def _trip(step: Step, lift: WatchedLift, watch: Watch) -> None:
    start, destination = watch.newest.lift.floor or step.floors[0], other_floor(step, watch.newest)
    await step.may_move(f"The manager takes the empty car from {start} to {destination}. Is everybody clear?")
    began = watch.newest.at
    ridden = await ride(lift, start, destination)
    if text := refused(step, watch, began):
        step.problem(text)
    elif not ridden.is_complete:
        step.problem(f"the trip from {start} to {destination} ended early: {ridden.reason}")


async def _robot_mode(step: Step, lift: WatchedLift, watch: Watch) -> None:
    name = step.item.subject
    floor = other_floor(step, watch.newest)
    await step.may_move(f"The manager requests robot mode and calls the empty car to {floor}. Is everybody clear?")
    began = watch.newest
    async with session(lift) as held:
        if not await call(step, lift, watch, held, floor, hold=False):
            _check_granted(step, watch, began)
            return
        await step.wait(HOLD_S, "robot mode is kept")
        if lost := _lost_robot_mode(step, watch, began):
            step.problem(lost)
            return
        if not await step.yes(
            "Does the lift show robot mode, and no longer answer its landing buttons?", Prompt.SHOWN, subject=name
        ):
            step.problem(
                f"{at(step, name)} is on, and the lift is not in robot mode: the output may be wired to something else, or the program"
                " ignores it"
            )
    if "robot_mode_on" in step.codec.signals and not await watch.until(
        lambda sample: sample.value("robot_mode_on") is not True, DOOR_WITHIN_S
    ):
        step.problem(f"{at(step, 'robot_mode_on')} still shows yes after {at(step, name)} was released")


def _check_granted(step: Step, watch: Watch, began: Sample) -> None:
    """Note where the request for robot mode went instead, after a call that was not pressed without it."""
    if "robot_mode_on" not in step.codec.signals or refused(step, watch, began.at):
        return
    samples = [one for one in watch.samples if one.at > began.at and one.is_live]
    if any(one.value("robot_mode_on") is True for one in samples):
        return
    opened = [side for side in Side if not began.door_is_open(side) and any(one.door_is_open(side) for one in samples)]
    instead = "".join(
        f"; the {side} door opened instead: this output and {at(step, f'hold_door.{side}')} may be exchanged"
        for side in opened
    )
    step.problem(
        f"{at(step, step.item.subject)} is on, and {at(step, 'robot_mode_on')} does not show it"
        + (instead or "; check output and wire, and look at the panel for what the lift waits for")
    )


def _lost_robot_mode(step: Step, watch: Watch, began: Sample) -> str:
    """Return how the lift left robot mode although it was kept; empty if it did not, or has no signal for it."""
    samples = [one for one in watch.samples if one.at > began.at and one.is_live]
    granted = next((one for one in samples if one.value("robot_mode_on") is True), None)
    if granted is None:
        return ""
    lost = next((one for one in samples if one.at > granted.at and one.value("robot_mode_on") is False), None)
    if lost is None:
        return ""
    name, commands = step.item.subject, step.codec.commands
    signs = [
        (at(step, one), commands[one].spec.every_s or commands[one].spec.refresh_s)
        for one in ("heartbeat", name)
        if one in commands
    ]
    written = " and ".join(f"{where} every {every_s:g} s" for where, every_s in signs if every_s is not None)
    return (
        f"{at(step, name)} is on, and {at(step, 'robot_mode_on')} went away {lost.at - granted.at:.0f} s after it came: the watchdog of the"
        f" controller may be shorter than our sign of life ({written or 'written once'}), or something else takes robot mode away"
    )


async def _hold(step: Step, lift: WatchedLift, watch: Watch, side: Side) -> None:
    name = step.item.subject
    floor = watch.newest.lift.floor if watch.newest.lift.standing else None
    floor = floor or step.floors[0]
    await step.may_move(f"The manager opens the {side} door at {floor} and holds it. Is everybody clear?")
    began = watch.newest.at
    async with session(lift) as held:
        came = await call(step, lift, watch, held, floor, hold=True)
        if text := refused(step, watch, began):
            if came:
                step.problem(text)
            return
        await step.wait(HOLD_S, "the door is held")
        real = await step.yes(
            f"Did the {side} door open, and does it stay open? It has been held for {HOLD_S:g} s.",
            Prompt.HOLDS,
            subject=side,
        )
    if not came or not real:
        step.problem(
            f"{at(step, name)} is on, and the {side} door {'closes' if came else 'does not show open'}: hold and close, or hold and another"
            " output, may be exchanged, or the controller does not take the hold"
        )
        return
    if not await step.yes(f"The hold is released. Does the {side} door close by itself?", Prompt.CLOSED, subject=side):
        step.problem(f"{at(step, name)} was released, and the {side} door stays open")


async def _close(step: Step, lift: WatchedLift, watch: Watch, side: Side) -> None:
    name = step.item.subject
    floor = (watch.newest.lift.floor if watch.newest.lift.standing else None) or step.floors[0]
    await step.may_move(
        f"The manager opens the {side} door at {floor} and then presses its close button. Is the doorway clear?"
    )
    began = watch.newest.at
    async with session(lift) as held:
        if not await call(step, lift, watch, held, floor, hold=True):
            return
        await held.robot_left()  # the person has just said that the doorway is clear
        command = await held.close_door(side, wait=DOOR_WITHIN_S)
        step.saw(f"{name}: {command.status} {command.reason}".strip())
        if text := refused(step, watch, began):
            step.problem(text)
            return
        if not await step.yes(f"Did the {side} door close at once?", Prompt.CLOSED, subject=side):
            step.problem(
                f"{at(step, name)} was pressed ({command.status}), and the {side} door did not close: check the output, and whether it is"
                f" exchanged with hold_door.{side}"
            )


async def _heartbeat(step: Step, watch: Watch, name: str) -> None:
    every_s = step.codec.commands[name].spec.every_s or 1.0
    await step.wait(BEATS * every_s + 1.0, "watching the beats")
    beats = [write.beat for write in watch.writes if write.beat is not None]
    step.saw(f"{len(beats)} beats within {BEATS * every_s + 1.0:g} s, every {every_s:g} s by the map")
    step.figures["beats"] = len(set(beats))
    if len(set(beats)) < 2:
        step.problem(f"{at(step, name)}: the {COMMAND_MEANINGS[name]} was not written")


def _check_outputs(step: Step, watch: Watch, name: str, began: float) -> None:
    """See in the frames which outputs were on: this one, and those that go with a session."""
    pressed = {one.partition(" ")[0] for one in watch.pressed(began)}
    step.saw(f"outputs on since the press: {', '.join(sorted(pressed)) or 'none'}")
    if name not in pressed and not step.problems:
        step.problem(
            f"{at(step, name)}: the manager did not press it, because this lift did not need it for this request"
        )
    if watch.alarms:
        step.problem(f"meanwhile: {'; '.join(dict.fromkeys(watch.alarms))}")
