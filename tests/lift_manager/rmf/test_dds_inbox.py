"""From the thread that hears to the thread that acts: in order, without waiting, and never more than fits."""

from collections.abc import Callable
from functools import partial

import pytest

from lift_manager.rmf.dds_inbox import MOST_CALLS, MOST_TEXT, Inbox


class Thread:
    """The other thread: it calls what it was given when it has time."""

    def __init__(self) -> None:
        self.given: list[Callable[[], None]] = []
        self.done: list[int | str] = []

    def act(self) -> None:
        while self.given:
            self.given.pop(0)()

    def note(self, what: int | str) -> None:
        self.done.append(what)


@pytest.fixture
def thread() -> Thread:
    return Thread()


@pytest.fixture
def inbox(thread: Thread) -> Inbox:
    return Inbox(thread.given.append)


def test_calls_come_in_order_and_one_turn_is_asked_for(thread: Thread, inbox: Inbox) -> None:
    for n in range(3):
        inbox.put(partial(thread.note, n), 1)
    assert len(thread.given) == 1
    thread.act()
    assert thread.done == [0, 1, 2]


def test_a_turn_is_asked_for_again_after_the_last_one(thread: Thread, inbox: Inbox) -> None:
    inbox.put(partial(thread.note, 1), 1)
    thread.act()
    inbox.put(partial(thread.note, 2), 1)
    thread.act()
    assert thread.done == [1, 2]


def test_ten_thousand_calls_that_nobody_takes_leave_the_newest(
    thread: Thread, inbox: Inbox, caplog: pytest.LogCaptureFixture
) -> None:
    for n in range(10_000):
        inbox.put(partial(thread.note, n), 20)
    assert len(thread.given) == 1
    thread.act()
    assert thread.done == list(range(10_000 - MOST_CALLS, 10_000))
    assert inbox.dropped == 10_000 - MOST_CALLS
    assert len(caplog.records) == 1
    assert "faster than they can be processed" in caplog.text
    inbox.close()
    assert caplog.records[-1].getMessage() == "at least 9000 messages of RMF were dropped unread in total"


def test_long_texts_fill_it_sooner(thread: Thread, inbox: Inbox) -> None:
    for n in range(100):
        inbox.put(partial(thread.note, n), 1_000_000)
    thread.act()
    assert thread.done == [96, 97, 98, 99]
    assert inbox.dropped == 96
    inbox.put(partial(thread.note, "short"), 10)
    inbox.put(partial(thread.note, "short too"), 10)
    thread.act()
    assert thread.done[4:] == ["short", "short too"]


def test_what_must_not_be_lost_outlives_a_flood_in_its_place(thread: Thread, inbox: Inbox) -> None:
    for n in range(3000):
        inbox.put(partial(thread.note, n), 20, keep=n in (5, 2500))
    thread.act()
    assert thread.done == [5, *range(3000 - MOST_CALLS + 1, 3000)]
    assert inbox.dropped == 3000 - MOST_CALLS


def test_of_what_must_not_be_lost_the_oldest_goes_when_there_is_nothing_else(thread: Thread, inbox: Inbox) -> None:
    for n in range(MOST_CALLS + 10):
        inbox.put(partial(thread.note, n), 20, keep=True)
    inbox.put(partial(thread.note, "loose"), 20)
    inbox.put(partial(thread.note, "newest"), 20, keep=True)
    thread.act()
    assert thread.done == [*range(11, MOST_CALLS + 10), "newest"]


def test_of_what_must_not_be_lost_long_texts_are_given_up_as_others_are(thread: Thread, inbox: Inbox) -> None:
    inbox.put(partial(thread.note, "short"), 100, keep=True)
    for n in range(100):
        inbox.put(partial(thread.note, n), 1_000_000, keep=True)
    thread.act()
    assert thread.done == ["short", 97, 98, 99]


def test_what_was_taken_makes_room_again(thread: Thread, inbox: Inbox) -> None:
    for turn in range(3):
        for n in range(MOST_CALLS):
            inbox.put(partial(thread.note, turn * MOST_CALLS + n), 20, keep=n % 2 == 0)
        thread.act()
    assert thread.done == list(range(3 * MOST_CALLS))
    assert inbox.dropped == 0


def test_what_was_lost_before_it_came_here_is_told_once_and_counted(
    inbox: Inbox, caplog: pytest.LogCaptureFixture
) -> None:
    inbox.overrun()
    inbox.overrun()
    assert inbox.dropped == 2
    assert ["faster than they can be processed" in record.getMessage() for record in caplog.records] == [True]


def test_a_single_text_of_any_length_is_delivered(thread: Thread, inbox: Inbox) -> None:
    inbox.put(partial(thread.note, "long"), MOST_TEXT * 2)
    thread.act()
    assert thread.done == ["long"]
    assert inbox.dropped == 0


def test_of_what_has_a_newest_only_that_comes_and_before_the_rest(thread: Thread, inbox: Inbox) -> None:
    inbox.put(partial(thread.note, "request"), 1)
    for n in range(1000):
        inbox.put_newest("clock", partial(thread.note, n))
    inbox.put_newest("matched", partial(thread.note, "matched"))
    thread.act()
    assert thread.done == [999, "matched", "request"]


def test_a_long_queue_leaves_room_for_other_work_between(thread: Thread, inbox: Inbox) -> None:
    for n in range(250):
        inbox.put(partial(thread.note, n), 1)
    turns = 0
    while thread.given:
        thread.given.pop(0)()
        turns += 1
    assert turns == 3
    assert thread.done == list(range(250))


def test_a_call_that_raises_costs_none_of_the_others(thread: Thread, inbox: Inbox) -> None:
    def bug() -> None:
        raise LookupError

    inbox.put(partial(thread.note, 1), 1)
    inbox.put(bug, 1)
    inbox.put(partial(thread.note, 2), 1)
    with pytest.raises(LookupError):
        thread.act()
    thread.act()
    assert thread.done == [1, 2]


def test_after_closing_nothing_is_delivered_and_nothing_asked_for(thread: Thread, inbox: Inbox) -> None:
    inbox.put(partial(thread.note, 1), 1)
    inbox.close()
    inbox.put(partial(thread.note, 2), 1)
    inbox.put_newest("clock", partial(thread.note, 3))
    thread.act()
    inbox.put(partial(thread.note, 4), 1)
    assert thread.given == []
    assert thread.done == []
