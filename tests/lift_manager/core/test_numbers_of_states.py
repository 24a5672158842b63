"""What an answer's event number says of a state, whether or not anybody listens."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from lift_manager.core.lift import LiftTask
from lift_manager.core.manager import LiftManager
from lift_manager.core.options import LiftOptions
from lift_manager.domain.asking import Accepted
from lift_manager.domain.events import Event
from lift_manager.domain.state import RobotDoor
from lift_manager.runtime.bus import Bus
from tests.lift_manager.core.rmf_words import RMF, says, stands_open
from tests.lift_manager.core.scripted import AT_L2, FRONT, PLAIN, Bench, ScriptedDriver
from tests.support.proven import proven
from tests.support.virtual_time import elapse, run_virtual

Check = Callable[[Bench, LiftManager], Awaitable[None]]
FLOORS = ("L1", "L2", "L3")


def unheard(check: Check) -> None:
    """Run a check on a lift to whose events nobody listens."""

    async def main() -> None:
        bus: Bus[Event] = Bus()
        driver = ScriptedDriver(PLAIN, AT_L2)
        options = LiftOptions(
            name="lift",
            floors=FLOORS,
            doors_at=dict.fromkeys(FLOORS, (FRONT,)),
            control=True,
            poll_s=0.1,
            lease_s=60,
        )
        task = LiftTask(driver, options, bus, memory=proven(("lift",), PLAIN))
        running = [asyncio.ensure_future(work) for work in (task.drive(), task.run())]
        with bus.listen() as ended:
            pass
        await elapse(0.5)
        try:
            await check(Bench(driver, task, ended, bus), LiftManager([task], bus))
        finally:
            assert not bus.heard
            for work in running:
                work.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    run_virtual(main)


def wanted(made: Bench, manager: LiftManager, floor: str, *, hold: bool = True) -> int:
    """The number of the answer to a request, as the ways to RMF give it."""
    assert says(made.task, floor, hold=hold) == Accepted()
    manager.freshen()
    return manager.newest


def test_a_decision_has_a_number_of_its_own_though_nobody_listens() -> None:
    async def check(made: Bench, manager: LiftManager) -> None:
        first = wanted(made, manager, "L1")
        await elapse(1)
        assert wanted(made, manager, "L3") > first

    unheard(check)


def test_a_poll_numbers_nothing_that_nobody_hears() -> None:
    async def check(made: Bench, manager: LiftManager) -> None:
        before = manager.newest
        await stands_open(made, "L1")
        assert manager.newest == before
        manager.freshen()
        assert manager.newest == before + 1

    unheard(check)


@pytest.mark.parametrize("grace_s", [0.0, 3.0])
def test_an_end_has_a_number_of_its_own_though_nobody_listens(grace_s: float) -> None:
    async def check(made: Bench, manager: LiftManager) -> None:
        before = wanted(made, manager, "L1")
        assert made.task.end_session(RMF, grace_s) == Accepted()
        manager.freshen()
        assert manager.newest > before

    unheard(check)


def test_a_request_that_changes_nothing_has_the_number_of_before() -> None:
    async def check(made: Bench, manager: LiftManager) -> None:
        first = wanted(made, manager, "L1")
        assert wanted(made, manager, "L1") == first

    unheard(check)


def test_a_state_of_before_a_decision_is_told_from_the_one_after_though_that_was_numbered_once() -> None:
    """The door falls back to what it was when the last number was given."""

    async def check(made: Bench, manager: LiftManager) -> None:
        await stands_open(made, "L1")
        shut = wanted(made, manager, "L1")
        assert made.robot_door() is not RobotDoor.OPEN
        await elapse(1)
        assert made.robot_door() is RobotDoor.OPEN
        assert manager.newest == shut
        let_go = wanted(made, manager, "L1", hold=False)
        assert made.robot_door() is not RobotDoor.OPEN
        assert let_go > shut

    unheard(check)


def test_an_end_that_was_taken_back_and_said_again_has_another_number() -> None:
    async def check(made: Bench, manager: LiftManager) -> None:
        wanted(made, manager, "L1")
        assert made.task.end_session(RMF, 3) == Accepted()
        manager.freshen()
        first = manager.newest
        assert says(made.task, "L1") == Accepted()
        assert not made.state.ending
        assert made.task.end_session(RMF, 3) == Accepted()
        manager.freshen()
        assert manager.newest > first

    unheard(check)
