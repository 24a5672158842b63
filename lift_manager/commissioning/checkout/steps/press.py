"""What several procedures do with the lift: call it, hold its door, ride with it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

from lift_manager.client.errors import ClientError
from lift_manager.client.session import ActiveSession
from lift_manager.commissioning.checkout.lift import Sample, Watch, WatchedLift
from lift_manager.commissioning.checkout.record import WRITTEN
from lift_manager.commissioning.checkout.steps.step import Step, at
from lift_manager.lift.commands import CommandState
from lift_manager.rides.ride import Guidance
from register_maps.words import Side

ROBOT = "checkout"
"""The name of the robot that the manager sees."""
COMMAND_WITHIN_S = 60.0
"""How long a command may stay pending: people have their turn between two sessions. Chosen."""
DOOR_WITHIN_S = 20.0
"""Chosen: twice the slowest door of the maps."""
RIDE_WITHIN_S = 600.0
"""Chosen: the limits of a ride end it earlier."""
SETTLE_S = 1.0
"""After a press, until everything that it changes shows. Chosen: several polls and scans."""


@asynccontextmanager
async def session(lift: WatchedLift) -> AsyncIterator[ActiveSession]:
    """Hold the lift within the context; at its end nobody is in the car. Raises ClientError."""
    async with lift.client.session(lift.name, robot=ROBOT) as held:
        try:
            yield held
        except BaseException:
            with suppress(ClientError):  # the session is closed once more, and that failure is logged
                await held.close(left=True)
            raise
        await held.close(left=True)


async def call(step: Step, lift: WatchedLift, watch: Watch, held: ActiveSession, floor: str, *, hold: bool) -> bool:
    """Call the car to a floor and wait until it shows there, with the door open if `hold`; return whether it did.

    Notes a problem if it did not.
    """
    began = watch.newest
    command = await held.go_to(floor, hold_door=hold, wait=COMMAND_WITHIN_S)
    if command.status is not CommandState.CONFIRMED and (text := refused(step, watch, began.at)):
        step.problem(text)
        return False
    name = call_name(step)
    where = f"{at(step, name, floor)}, called to {floor}"
    if command.status is CommandState.PENDING:
        step.problem(f"{where}: not pressed within {COMMAND_WITHIN_S:g} s, the manager waits: {command.reason}")
        return False
    if command.status is not CommandState.CONFIRMED:
        width = step.codec.commands[name].spec.width_s
        hint = (
            ""
            if width is None
            else f"; each press lasts {width:g} s, which must be longer than a scan of the controller"
        )
        step.problem(f"{where}: {command.status}, {command.reason}{hint}{_elsewhere(watch, floor)}")
        return False
    step.saw(f"{where}: {command.status} ({command.proof})")
    capabilities = await lift.client.capabilities(lift.name)
    came = await watch.until(lambda sample: is_at(sample, floor), capabilities.arrive_within_s)
    if not came:
        step.problem(
            f"{where}: no signal shows the car at {floor} within {capabilities.arrive_within_s:g} s{_elsewhere(watch, floor)}"
        )
        return False
    if hold:
        await watch.until(lambda sample: sample.lift.robot_door == "open", DOOR_WITHIN_S)
    await asyncio.sleep(SETTLE_S)
    _figures(step, watch, began)
    step.evidence += [f"{WRITTEN}{write.text}" for write in watch.writes if write.at >= began.at][:12]
    return True


def refused(step: Step, watch: Watch, since: float) -> str:
    """Return which write the controller has refused since then; empty if it took all."""
    found = next((one for one in watch.refused if one.at >= since), None)
    if found is None:
        return ""
    return (
        f"{at(step, found.command)}: the controller refuses to be written: {found.text}; compare the address with the vendor's table, and"
        " look whether the controller lets this client write"
    )


def _elsewhere(watch: Watch, floor: str) -> str:
    """Return where the car shows instead, and the most likely reason."""
    here = watch.newest.lift.floor
    if here in (None, floor, watch.samples[0].lift.floor):
        return ""
    return f"; the car went to {here} instead: the outputs of {floor} and {here} may be crossed, or the floors shifted"


def is_at(sample: Sample, floor: str) -> bool:
    """Whether the lift shows the car standing at a floor."""
    return sample.is_live and sample.lift.standing and sample.lift.floor == floor


def call_name(step: Step) -> str:
    """Return the command that calls the empty car, for messages."""
    calls = [name for name, command in step.codec.commands.items() if command.is_call]
    return calls[0] if calls else "the call"


def other_floor(step: Step, sample: Sample) -> str:
    """Return a floor at which the car does not show: the next one up, or the one below at the top."""
    here = sample.lift.floor
    if here not in step.floors:
        return step.floors[0]
    index = step.floors.index(here)
    return step.floors[index + 1] if index + 1 < len(step.floors) else step.floors[index - 1]


@dataclass(slots=True)
class Ridden:
    """What became of one trip, with times of the loop."""

    began_at: float
    entered_at: float | None = None
    left_at: float | None = None
    is_complete: bool = False
    reason: str = ""


Drive = Callable[[Guidance], Awaitable[None]]
"""Waits until the robot has driven in or out, as it is guided."""


async def ride(lift: WatchedLift, start: str, destination: str, drive: Drive | None = None) -> Ridden:
    """Go through one whole trip: of a robot, or of the empty car, as fast as a robot could be. Raises ClientError and TimeoutError."""
    loop = asyncio.get_running_loop()
    ridden = Ridden(loop.time())
    async with asyncio.timeout(RIDE_WITHIN_S), lift.client.ride(lift.name, start, destination, robot=ROBOT) as active:
        async for now in active:
            if now.guidance is Guidance.ENTER:
                if drive is not None:
                    await drive(now.guidance)
                ridden.entered_at = loop.time()
                await active.entered()
            elif now.guidance is Guidance.LEAVE:
                ridden.left_at = loop.time()
                if drive is not None:
                    await drive(now.guidance)
                await active.left()
        ridden.is_complete, ridden.reason = active.now.guidance is Guidance.DONE, active.now.reason
    return ridden


def door_times(watch: Watch, since: Sample, side: Side) -> dict[str, float]:
    """Return how long a door took to open and to close, as far as it was seen."""
    found: dict[str, float] = {}
    shut_at = open_at = None
    for sample in watch.samples:
        if sample.at < since.at or not sample.is_live:
            continue
        door = sample.lift.doors.get(side)
        if door == "closed":
            if open_at is not None:
                found.setdefault("door_closes_s", round(sample.at - open_at, 2))
                open_at = None
            shut_at = sample.at
        elif door == "open":
            if shut_at is not None:
                found.setdefault("door_opens_s", round(sample.at - shut_at, 2))
                shut_at = None
            open_at = sample.at
    return found


def travel_s(watch: Watch, since: float, floor: str) -> float | None:
    """Return the time from the last look at which the car stood elsewhere to the first at which it stands at a floor."""
    left_at = None
    for sample in watch.samples:
        if sample.at < since or not sample.is_live:
            continue
        if is_at(sample, floor):
            return None if left_at is None else round(sample.at - left_at, 2)
        if sample.lift.standing:
            left_at = sample.at
    return None


def _figures(step: Step, watch: Watch, began: Sample) -> None:
    floor = watch.newest.lift.floor or ""
    taken = travel_s(watch, began.at, floor)
    if taken is not None:
        step.figures["travel_s"] = taken
    for side in Side:
        for name, value in door_times(watch, began, side).items():
            step.figures[name if side is Side.FRONT else f"{side}_{name}"] = value
