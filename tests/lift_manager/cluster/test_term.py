"""The term of one member, input by input."""

import math
from dataclasses import replace

import pytest

from lift_manager.cluster.term import (
    ANSWER_S,
    ANSWERING_S,
    RENEW_S,
    SILENT_S,
    TERM_S,
    UNCHANGED_S,
    Answered,
    Input,
    Key,
    Leave,
    Order,
    Role,
    Sent,
    Term,
    Tick,
    Unanswered,
    step,
)

OTHERS = Key(7, 3, "b", "http://b:5003")
MINE = Key(8, 4, "a", "http://a:5003")


ANSWERING = Term(answered_at=49.9, answering_since=0.0)
"""A standby to which etcd has answered for long."""


def after(term: Term, *inputs: Input) -> tuple[Term, list[Order]]:
    """The term after these inputs, and everything that was ordered."""
    ordered: list[Order] = []
    for happened in inputs:
        term, orders = step(term, happened)
        ordered += orders
    return term, ordered


def active(at: float = 100.0, trip_s: float = 0.01) -> Term:
    """A term that was taken by a request that was sent at this time."""
    standby = Term(key=OTHERS, known_at=at - UNCHANGED_S)
    term, _ = after(standby, Sent(at), Answered(Order.TAKE, at, at + trip_s, MINE, is_applied=True))
    assert term.role is Role.ACTIVE
    return term


def renewed(term: Term, sent_at: float, at: float) -> Term:
    assert term.key is not None
    key = replace(term.key, revision=term.key.revision + 1)
    return after(term, Sent(sent_at), Answered(Order.RENEW, sent_at, at, key, is_applied=True))[0]


def test_a_standby_looks_at_the_key_as_often_as_its_owner_renews_it() -> None:
    term, orders = after(Term(), Tick(50.0))
    assert orders == [Order.LOOK]
    term, orders = after(term, Sent(50.0), Tick(50.2), Answered(Order.LOOK, 50.0, 50.25, OTHERS, is_applied=False))
    assert orders == []
    assert term.wake_at == 50.0 + RENEW_S
    assert after(term, Tick(term.wake_at))[1] == [Order.LOOK]


def test_a_key_is_taken_once_it_is_known_unchanged_for_long_enough() -> None:
    seen, _ = after(ANSWERING, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, OTHERS, is_applied=False))
    assert after(seen, Tick(50.1 + UNCHANGED_S - 0.001))[1] == [Order.LOOK]
    assert after(seen, Tick(50.1 + UNCHANGED_S))[1] == [Order.TAKE]


def test_a_look_that_shows_the_same_revision_does_not_start_the_wait_again() -> None:
    term, _ = after(ANSWERING, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, OTHERS, is_applied=False))
    term, _ = after(term, Sent(52.0), Answered(Order.LOOK, 52.0, 52.1, OTHERS, is_applied=False))
    assert after(term, Tick(52.6))[1] == [Order.TAKE]


def test_a_changed_key_starts_the_wait_again_whoever_changed_it() -> None:
    term, _ = after(ANSWERING, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, OTHERS, is_applied=False))
    term, _ = after(term, Sent(52.0), Answered(Order.LOOK, 52.0, 52.1, replace(OTHERS, revision=9), is_applied=False))
    assert after(term, Tick(52.6))[1] == [Order.LOOK]


def test_a_key_without_an_owner_is_taken_at_once() -> None:
    term, _ = after(ANSWERING, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, Key(9, 3), is_applied=False))
    assert term.wake_at == 50.1
    assert after(term, Tick(50.1))[1] == [Order.TAKE]


def test_a_member_that_left_gives_the_other_one_time_to_take_the_key() -> None:
    term, _ = after(
        replace(ANSWERING, left=3), Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, Key(9, 3), is_applied=False)
    )
    assert term.takes_at == 50.1 + UNCHANGED_S


def test_after_etcd_was_silent_no_key_is_taken_before_a_machine_that_went_on_alone_can_have_said_so() -> None:
    free, silent = Key(9, 3), replace(ANSWERING, answered_at=50.1 - SILENT_S - 0.001)
    for standby in (Term(), silent):
        for key in (free, OTHERS):
            term, _ = after(standby, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, key, is_applied=False))
            assert term.takes_at == 50.1 + ANSWERING_S
    early = replace(ANSWERING, answered_at=50.1 - SILENT_S)
    term, _ = after(early, Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, free, is_applied=False))
    assert term.takes_at == 50.1


def test_no_key_is_taken_while_a_machine_goes_on_alone() -> None:
    looked = Answered(Order.LOOK, 50.0, 50.1, OTHERS, is_applied=False, is_barred=True)
    term, _ = after(ANSWERING, Sent(50.0), looked)
    assert term.takes_at == math.inf
    term, _ = after(term, Sent(52.5), replace(looked, sent_at=52.5, at=52.6, is_barred=False))
    assert after(term, Tick(52.6))[1] == [Order.TAKE]


def test_a_key_that_was_never_made_is_never_taken() -> None:
    term, _ = after(Term(), Sent(50.0), Answered(Order.LOOK, 50.0, 50.1, Key(0), is_applied=False))
    assert term.takes_at == math.inf
    assert after(term, Tick(1e6))[1] == [Order.LOOK]


def test_a_term_lasts_from_before_the_request_was_sent() -> None:
    assert active(100.0, trip_s=0.4).until == 100.0 + TERM_S
    assert renewed(active(100.0), 100.3, 100.7).until == 100.3 + TERM_S


def test_a_take_that_somebody_else_forestalled_changes_nothing() -> None:
    standby = Term(key=OTHERS, known_at=90.0, answered_at=99.9)
    theirs = Key(8, 4, "b", "http://b:5003")
    term, orders = after(standby, Sent(100.0), Answered(Order.TAKE, 100.0, 100.1, theirs, is_applied=False))
    assert (term.role, orders) == (Role.STANDBY, [])
    assert term.takes_at == 100.1 + UNCHANGED_S


def test_a_take_without_an_answer_is_not_tried_again_at_once() -> None:
    term, _ = after(Term(key=OTHERS, known_at=90.0), Sent(100.0), Unanswered(100.0, 100.001))
    assert term.wake_at == pytest.approx(100.0 + RENEW_S)
    assert after(term, Tick(100.2))[1] == []
    assert after(term, Tick(100.001 + RENEW_S))[1] == [Order.TAKE]


def test_a_take_whose_answer_comes_after_its_term_is_over_at_once() -> None:
    standby = Term(key=OTHERS, known_at=90.0, answered_at=99.9)
    term, orders = after(standby, Sent(100.0), Answered(Order.TAKE, 100.0, 102.1, MINE, is_applied=True))
    assert (term.role, orders) == (Role.OVER, [Order.FENCE])


def test_the_active_renews_every_third_of_a_second_one_request_at_a_time() -> None:
    term = active(100.0)
    assert term.wake_at == 100.0 + RENEW_S
    term, orders = after(term, Tick(100.3), Sent(100.3), Tick(100.7))
    assert orders == [Order.RENEW]
    term, orders = after(term, Unanswered(100.3, 100.3 + ANSWER_S), Tick(100.3 + ANSWER_S))
    assert orders == [Order.RENEW]


def test_open_is_withdrawn_then_everything_released_and_then_nothing_is_written() -> None:
    term = active(100.0)
    assert term.margin_s == pytest.approx(0.2 + 3 * 0.01)
    term, _ = after(term, Sent(100.3))
    term, orders = after(term, Tick(term.wake_at))
    assert (term.role, orders) == (Role.LEAVING, [Order.WITHDRAW])
    term, orders = after(term, Tick(term.wake_at), Tick(101.99))
    assert (term.role, orders) == (Role.LEAVING, [Order.RELEASE])
    term, orders = after(term, Tick(102.0), Tick(102.1))
    assert (term.role, orders) == (Role.OVER, [Order.FENCE])
    assert term.wake_at == math.inf


def test_a_renewal_after_the_withdrawal_gives_time_for_the_release_and_no_more() -> None:
    term, _ = after(active(100.0), Sent(101.7), Tick(101.8))
    assert term.role is Role.LEAVING
    term, _ = after(term, Answered(Order.RENEW, 101.7, 101.85, replace(MINE, revision=9), is_applied=True))
    assert (term.role, term.until) == (Role.LEAVING, 101.7 + TERM_S)


def test_a_stopped_process_finds_its_term_over_whatever_it_gets_first() -> None:
    waits, _ = after(active(100.0), Sent(101.0))
    for happened in (
        Tick(130.0),
        Answered(Order.RENEW, 101.0, 130.0, replace(MINE, revision=9), is_applied=True),
        Unanswered(101.0, 130.0),
        Leave(130.0),
    ):
        term, orders = after(waits, happened)
        assert (term.role, orders) == (Role.OVER, [Order.FENCE]), happened
        assert term.until == 102.0


def test_a_renewal_that_was_applied_although_its_answer_was_lost_makes_the_term_no_longer() -> None:
    term, _ = after(active(100.0), Sent(100.3), Unanswered(100.3, 100.8), Sent(100.8))
    term, orders = after(term, Answered(Order.RENEW, 100.8, 100.9, replace(MINE, revision=9), is_applied=False))
    assert (term.role, term.until, orders) == (Role.ACTIVE, 102.0, [])
    assert after(term, Tick(100.9))[1] == [Order.RENEW]
    assert term.key == replace(MINE, revision=9)


def test_an_answer_to_a_request_of_an_earlier_life_changes_nothing() -> None:
    standby, _ = after(Term(key=OTHERS, known_at=90.0), Sent(100.0))
    for late in (Answered(Order.TAKE, 95.0, 100.1, MINE, is_applied=True), Unanswered(95.0, 100.1)):
        assert after(standby, late) == (standby, [])


def test_a_key_with_another_epoch_ends_the_term_at_once() -> None:
    term, _ = after(active(100.0), Sent(100.3))
    for key in (Key(9, 5, "b"), Key(9, 5, "a"), Key(9, 4)):
        ended, orders = after(term, Answered(Order.RENEW, 100.3, 100.4, key, is_applied=False))
        assert (ended.role, orders) == (Role.OVER, [Order.FENCE]), key


def test_the_margin_follows_the_slowest_usual_renewal_up_to_half_a_term() -> None:
    term, at = active(100.0), 100.0
    for number in range(300):
        at += RENEW_S
        term = renewed(term, at, at + (0.1 if number % 50 == 0 else 0.005))
    assert term.margin_s == pytest.approx(0.2 + 3 * 0.1)
    for _ in range(10):
        at += 1.0
        term = renewed(term, at, at + 0.9)
    assert term.margin_s == 1.0
    assert len(term.trips) == 200


def test_a_renewal_without_an_answer_does_not_make_the_margin_longer() -> None:
    term = active(100.0)
    assert after(term, Sent(100.3), Unanswered(100.3, 100.8))[0].margin_s == term.margin_s


def test_a_member_that_leaves_keeps_renewing_until_everything_is_released() -> None:
    term, orders = after(active(100.0), Leave(100.1))
    assert (term.role, orders) == (Role.LEAVING, [])
    assert after(term, Tick(100.3))[1] == [Order.RENEW]
    term, orders = after(renewed(term, 100.3, 100.31), Tick(101.9), Tick(102.29))
    assert orders == [Order.RENEW, Order.RELEASE, Order.RENEW]
    assert term.role is Role.LEAVING
