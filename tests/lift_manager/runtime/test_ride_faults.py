"""What happens at each step of a ride, and what its robot is told then: each fault at one step, and each step with a fault.

`python -m tests.campaigns.ride_truth --table` plays every fault at every step on every map.
"""

import pytest

from tests.campaigns.ride_truth import as_meant
from tests.support.ride_faults import FAULTS, STEPS, play
from tests.support.trip_sites import site_of
from tests.support.virtual_time import run_virtual

MAPS = ("generic-registers", "two-stop-agv", "seer-lps3-two-stop")
"""Robot mode, a handshake, and a robot in place on a lift that shows no fire."""
BY_MODE = ("fire", "out of service")
_STEPS, _FAULTS = tuple(STEPS), tuple(FAULTS)


def _map_of(number: int, fault: str) -> str:
    shows = MAPS[:1] if fault in BY_MODE else MAPS
    return shows[number % len(shows)]


CASES = [
    (_map_of(number, fault), _STEPS[(number + number // len(_STEPS) * len(_STEPS) // 2) % len(_STEPS)], fault)
    for number, fault in enumerate(_FAULTS)
]


def test_every_fault_and_every_step_is_among_the_cases() -> None:
    assert {fault for _, _, fault in CASES} == set(FAULTS)
    assert {step for _, step, _ in CASES} == set(STEPS)
    assert {name for name, _, _ in CASES} == set(MAPS)


@pytest.mark.parametrize(("name", "step", "fault"), CASES)
def test_the_robot_is_told_the_truth_whatever_happens_at_whatever_step(name: str, step: str, fault: str) -> None:
    site = site_of(name)
    story, over = run_virtual(lambda: play(site, step, fault), limit_s=3000)
    assert story.judged > 20
    assert as_meant(step, fault, over)
