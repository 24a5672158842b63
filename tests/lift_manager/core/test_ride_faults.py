"""What happens at each step of a ride, and what its robot is told then."""

from itertools import product

import pytest

from lift_manager.domain.ride import Guidance, Phase
from tests.support.ride_faults import FAULTS, STEPS, play
from tests.support.trip_sites import site_of
from tests.support.virtual_time import run_virtual

MAPS = ("generic-registers", "two-stop-agv", "seer-lps3-two-stop")
"""Robot mode, a handshake, and a robot in place on a lift that shows no fire."""
BY_MODE = ("fire", "out of service")


def _map_of(number: int, fault: str) -> str:
    shows = MAPS[:1] if fault in BY_MODE else MAPS
    return shows[number % len(shows)]


CASES = [
    (_map_of(one + other, fault), step, fault)
    for (one, step), (other, fault) in product(enumerate(STEPS), enumerate(FAULTS))
]
"""Each fault at each step, once; `tests.campaigns.ride_truth` plays them on every map."""
MEANT = ("cancel", "operator cancels")
TAKEN_AWAY = ("fire", "out of service", "lockout", "force-release")


@pytest.mark.parametrize(("name", "step", "fault"), CASES)
def test_the_robot_is_told_the_truth_whatever_happens_at_whatever_step(name: str, step: str, fault: str) -> None:
    site = site_of(name)
    story, over = run_virtual(lambda: play(site, step, fault), limit_s=3000)
    assert story.judged > 20
    if fault in MEANT:
        assert over.phase is Phase.CANCELLED
    elif fault in TAKEN_AWAY and step != "just outside":
        assert (over.phase, over.guidance) == (Phase.GAVE_UP, Guidance.GAVE_UP)
        assert over.advice is not None
    elif fault == "restart, and its robot is heard":
        assert over.phase is (Phase.CANCELLED if step == "clearing" else Phase.DONE)
    elif fault == "dies and returns":
        assert over.phase in (Phase.DONE, Phase.CANCELLED)
