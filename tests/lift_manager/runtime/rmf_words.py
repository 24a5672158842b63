"""What RMF says to one lift on a bench."""

from dataclasses import replace

from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import RequestRefused
from register_maps.words import Door, Motion
from tests.lift_manager.runtime.scripted import PLAIN, Bench
from tests.support.refusals import refusal
from tests.support.virtual_time import elapse

RMF, NEXT = Holder("rmf", "fleet/amr-7"), Holder("rmf", "fleet/amr-8")
HOLD = "hold_door.front"
WITH_MODE = replace(
    PLAIN,
    commands=PLAIN.commands | {"robot_mode"},
    signals=PLAIN.signals | {"robot_mode_on", "motion"},
    held_commands=PLAIN.held_commands | {"robot_mode"},
    evidence="motion_stopped",
)
"""A call, a door hold, and a robot mode that lasts as long as the session."""


def wants(made: Bench, floor: str, *, hold: bool = True, holder: Holder = RMF) -> None:
    made.site.request("lift", holder, floor, hold_door=hold, stays=True)


def is_refused(made: Bench, floor: str, *, hold: bool = True, holder: Holder = RMF) -> RequestRefused:
    return refusal(wants, made, floor, hold=hold, holder=holder)


def ends(made: Bench, grace_s: float = 3.0, *, holder: Holder = RMF) -> None:
    """RMF's END_SESSION."""
    made.site.end_session("lift", holder, grace_s)


async def idle(made: Bench) -> None:
    """Nobody has the lift."""


async def just_asked(made: Bench) -> None:
    """The car is called, and nothing has been written yet."""
    wants(made, "L3")


async def coming(made: Bench) -> None:
    """The empty car is on its way to the robot."""
    wants(made, "L1")
    await elapse(0.5)
    await under_way(made)


async def open_for_it(made: Bench) -> None:
    """The car stands open at L1 for the robot, and its door is held."""
    await coming(made)
    await stands_open(made, "L1")


async def riding(made: Bench) -> None:
    """The robot may have been taken along to L3."""
    await open_for_it(made)
    wants(made, "L3")
    await elapse(0.5)
    await under_way(made)


async def arrived(made: Bench) -> None:
    """The car stands open at L3, where RMF sent the robot."""
    await riding(made)
    await stands_open(made, "L3")


async def under_way(made: Bench) -> None:
    made.driver.values = replace(made.driver.values, motion=Motion.UP)
    await made.car(None, Door.CLOSED)


async def stands_open(made: Bench, floor: str) -> None:
    made.driver.values = replace(made.driver.values, motion=Motion.STOPPED)
    await made.car(floor, Door.OPEN, enter=True, leave=True)
