"""What an answer's event number says of a state, whether or not anybody listens."""

from collections.abc import Awaitable, Callable

import pytest

from lift_manager.lift.observation import RobotDoor
from tests.lift_manager.runtime.rmf_words import ends, stands_open, wants
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse


def unheard(check: Callable[[Bench], Awaitable[None]]) -> None:
    """Run a check on a lift to whose events nobody listens."""

    async def checked(made: Bench) -> None:
        await check(made)
        assert not made.bus.received

    on_bench(checked, PLAIN, lease_s=60, listens=False)


def wanted(made: Bench, floor: str, *, hold: bool = True) -> int:
    """The number of the answer to a request, as the ways to RMF give it."""
    with made.site.numbering("lift"):
        wants(made, floor, hold=hold)
    return made.site.newest


def ended(made: Bench, grace_s: float = 3.0) -> int:
    """The same of an end."""
    with made.site.numbering("lift"):
        ends(made, grace_s)
    return made.site.newest


def test_a_decision_has_a_number_of_its_own_though_nobody_listens() -> None:
    async def check(made: Bench) -> None:
        first = wanted(made, "L1")
        await elapse(1)
        assert wanted(made, "L3") > first

    unheard(check)


def test_a_poll_numbers_nothing_that_nobody_hears() -> None:
    async def check(made: Bench) -> None:
        before = made.site.newest
        await stands_open(made, "L1")
        assert made.site.newest == before
        made.site.freshen()
        assert made.site.newest == before + 1

    unheard(check)


@pytest.mark.parametrize("grace_s", [0.0, 3.0])
def test_an_end_has_a_number_of_its_own_though_nobody_listens(grace_s: float) -> None:
    async def check(made: Bench) -> None:
        before = wanted(made, "L1")
        assert ended(made, grace_s) > before

    unheard(check)


def test_a_request_that_changes_nothing_has_the_number_of_before() -> None:
    async def check(made: Bench) -> None:
        first = wanted(made, "L1")
        assert wanted(made, "L1") == first

    unheard(check)


def test_a_state_of_before_a_decision_is_told_from_the_one_after_though_that_was_numbered_once() -> None:
    """The door falls back to what it was when the last number was given."""

    async def check(made: Bench) -> None:
        await stands_open(made, "L1")
        shut = wanted(made, "L1")
        assert made.robot_door() is not RobotDoor.OPEN
        await elapse(1)
        assert made.robot_door() is RobotDoor.OPEN
        assert made.site.newest == shut
        let_go = wanted(made, "L1", hold=False)
        assert made.robot_door() is not RobotDoor.OPEN
        assert let_go > shut

    unheard(check)


def test_an_end_that_was_taken_back_and_said_again_has_another_number() -> None:
    async def check(made: Bench) -> None:
        wanted(made, "L1")
        first = ended(made)
        wanted(made, "L1")
        assert not made.state.ending
        assert ended(made) > first

    unheard(check)
