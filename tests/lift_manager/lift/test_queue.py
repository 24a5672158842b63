"""Who waits for a lift, in which order and for how long."""

import pytest

from drivers.rate_limits import CALLERS
from lift_manager.lift import queue
from lift_manager.lift.queue import LAPSES_AFTER_S, Queue
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.rmf_view import rmf_holder
from lift_manager.lift.session import Holder
from tests.support.rows import each_row

WORKSHOP, RMF, RMF_SECOND = Holder("workshop", "workshop"), Holder("rmf", "fleet/robot1"), Holder("rmf", "fleet/robot2")
ROBOT, SECOND = Holder("api", "amr-7"), Holder("api", "amr-8")
RIDE, LATER = Holder("ride", "amr-1"), Holder("ride", "amr-2")
HELD = Refused(Refusal.HELD, "held")


def refused(*holders: Holder, at: float = 0.0, before: Queue | None = None) -> Queue:
    """A queue after these callers were refused a held lift."""
    made = before or Queue()
    for holder in holders:
        made = queue.join_if_refused(made, holder, HELD, at)
    return made


def ahead(made: Queue, *holders: Holder, at: float = 0.0) -> list[int]:
    return [queue.ahead_of(made, holder, at) for holder in holders]


def test_first_come_first_served_and_joining_twice_changes_nothing() -> None:
    made = Queue()
    for holder in (RIDE, LATER, RIDE):
        made = queue.join(made, holder, 0.0)
    assert ahead(made, RIDE, LATER, ROBOT) == [0, 1, 2]
    made = queue.leave(queue.leave(made, RIDE), RIDE)
    assert queue.waiting(made, 1e6) == (LATER,)
    assert made.departures == 1


def test_a_face_that_asks_again_is_one_place_and_lapses_when_it_asks_no_more() -> None:
    made = queue.join(refused(RMF), RIDE, 1.0)
    made = refused(RMF_SECOND, at=4.0, before=made)
    assert queue.waiting(made, 4.0) == ("rmf", RIDE)
    assert ahead(made, RMF_SECOND, RIDE, at=4.0) == [0, 1]
    assert queue.next_lapse(made) == 4.0 + LAPSES_AFTER_S
    assert queue.waiting(made, 3.9 + LAPSES_AFTER_S) == ("rmf", RIDE)
    assert queue.waiting(made, queue.next_lapse(made)) == (RIDE,)


@each_row("code", sorted(set(Refusal) - {Refusal.HELD, Refusal.QUEUED}))
def test_a_caller_that_is_refused_for_another_reason_does_not_wait(code: Refusal) -> None:
    assert queue.join_if_refused(Queue(), RMF, Refused(code, "no"), 0.0) == Queue()


def test_each_rmf_waits_as_one() -> None:
    first, second = rmf_holder("fleet/robot1", ""), rmf_holder("fleet/robot1", "5")
    made = refused(first, second, rmf_holder("fleet/robot2", "5"))
    assert queue.waiting(made, 0.0) == ("rmf", "rmf@5")
    assert ahead(made, second) == [1]


def test_workshop_waits_as_one_and_each_caller_of_a_session_for_itself_for_as_long_as_they_ask() -> None:
    made = refused(WORKSHOP, Holder("workshop", "other"), ROBOT, SECOND, ROBOT)
    assert queue.waiting(made, 0.0) == ("workshop", ROBOT, SECOND)
    assert ahead(made, WORKSHOP, ROBOT, SECOND) == [0, 1, 2]
    assert made.departures == 0
    made = queue.lapse(refused(SECOND, at=3.0, before=made), 1.0 + LAPSES_AFTER_S)
    assert (made.places, made.departures) == ((SECOND,), 2)


def test_made_up_names_do_not_fill_the_queue() -> None:
    made = refused(*(Holder("api", f"amr-{number}") for number in range(2 * CALLERS)))
    assert len(queue.waiting(made, 0.0)) == CALLERS
    made = queue.join(made, RIDE, 0.0)
    assert ahead(made, RIDE, at=0.1 + LAPSES_AFTER_S) == [0]


def test_a_ride_does_not_join_because_it_was_refused() -> None:
    assert refused(RIDE) == Queue()


@pytest.mark.parametrize(
    ("waits", "text"),
    [
        ((RIDE,), "lift is free, and 1 that waited for it comes first; send another request"),
        ((RIDE, LATER), "lift is free, and 2 that waited for it come first; send another request"),
    ],
)
def test_a_free_lift_is_refused_to_everybody_but_the_first(waits: tuple[Holder, ...], text: str) -> None:
    made = Queue()
    for holder in waits:
        made = queue.join(made, holder, 0.0)
    assert queue.why_not_yet("lift", made, RIDE, 0.0) is None
    no = queue.why_not_yet("lift", made, ROBOT, 0.0)
    assert no is not None
    assert (no.code, no.message) == (Refusal.QUEUED, text)
    assert no.blocking is not None
    assert no.blocking.ahead == len(waits)
