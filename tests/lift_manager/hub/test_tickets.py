"""Tickets and rates, on a clock turned by hand."""

from lift_manager.hub.messages import TICKET_S
from lift_manager.hub.rate_limiter import RateLimiter
from lift_manager.hub.tickets import MOST, Tickets


def test_a_ticket_is_good_once_and_for_two_seconds() -> None:
    tickets = Tickets()
    first, second = tickets.issue(100.0), tickets.issue(100.0)
    assert tickets.take(first, 100.0 + TICKET_S - 0.001)
    assert not tickets.take(first, 100.0)
    assert not tickets.take(second, 100.0 + TICKET_S)
    assert not tickets.take("made up", 100.0)


def test_only_the_newest_tickets_are_good() -> None:
    tickets = Tickets()
    issued = [tickets.issue(100.0) for _ in range(MOST + 1)]
    assert [tickets.take(ticket, 100.0) for ticket in issued] == [False, *[True] * MOST]


def test_no_more_messages_are_admitted_than_within_the_time() -> None:
    limiter = RateLimiter(2, 1.0)
    assert [limiter.admits(at) for at in (0.0, 0.5, 0.9, 1.0, 1.1, 1.5)] == [True, True, False, True, False, True]
