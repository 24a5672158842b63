"""Pauses between tries."""

import random
from itertools import pairwise

from lift_manager.plain.backoff import FIRST_S, LONGEST_S, Backoff


def test_pauses_double_up_to_the_longest_each_a_little_shorter_by_chance() -> None:
    backoff = Backoff(random.Random(1))
    whole = FIRST_S
    for _ in range(10):
        assert whole / 2 <= backoff.next_s() <= whole
        whole = min(2 * whole, LONGEST_S)
    assert whole == LONGEST_S


def test_whoever_waits_with_a_robot_at_its_door_waits_less() -> None:
    backoff = Backoff(random.Random(1), first_s=0.25, longest_s=2.0)
    pauses = [backoff.next_s() for _ in range(200)]
    assert 0.125 <= pauses[0] <= 0.25
    assert max(pauses) <= 2.0
    assert min(pauses[5:]) >= 1.0
    assert any(one != other for one, other in pairwise(pauses[5:]))


def test_something_heard_begins_anew() -> None:
    backoff = Backoff(random.Random(1), first_s=0.25)
    for _ in range(5):
        backoff.next_s()
    backoff.reset()
    assert backoff.next_s() <= 0.25
