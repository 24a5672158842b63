"""Which sessions have ended before there is a manager that can end them."""

from dataclasses import replace

from lift_manager.rmf.early_ends import MOST_ENDS, EarlyEnds
from lift_manager.rmf.lift_sessions import TEXT_LIMIT
from tests.lift_manager.rmf.bench import A, B, ends, wants


def test_an_end_is_remembered_until_its_time_is_over() -> None:
    early = EarlyEnds(keep_s=10.0)
    early.note(ends(A), 100.0)
    early.note(ends(B), 105.0)
    assert early.at(110.0) == [("lift_rmf", A), ("lift_rmf", B)]
    assert early.at(110.1) == [("lift_rmf", B)]


def test_a_session_that_goes_on_has_not_ended() -> None:
    early = EarlyEnds()
    early.note(ends(A), 1.0)
    early.note(wants(A, "Level 2", lift="another lift"), 2.0)
    assert early.at(2.0) == [("lift_rmf", A)]
    early.note(wants(A, "Level 2"), 3.0)
    assert early.at(3.0) == []


def test_a_repeated_end_counts_from_the_newest() -> None:
    early = EarlyEnds(keep_s=10.0)
    for now in (1.0, 9.0):
        early.note(ends(A), now)
    assert early.at(19.0) == [("lift_rmf", A)]


def test_of_too_many_ends_the_oldest_are_forgotten() -> None:
    early = EarlyEnds()
    for number in range(MOST_ENDS + 2):
        early.note(ends(f"fleet/{number}"), float(number))
    sessions = [session for _, session in early.at(1000.0)]
    assert (len(sessions), sessions[0], sessions[-1]) == (MOST_ENDS, "fleet/2", f"fleet/{MOST_ENDS + 1}")


def test_no_end_without_a_session_and_no_endless_text_is_kept() -> None:
    early = EarlyEnds()
    long = "x" * (TEXT_LIMIT + 1)
    for request in (ends(""), ends(long), replace(ends(A), lift_name=long)):
        early.note(request, 1.0)
    assert early.at(1.0) == []
