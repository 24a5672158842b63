"""Readers of a stream on virtual time: heartbeats, ages, slow readers, keys that are taken back."""

import asyncio
from collections.abc import Coroutine
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from lift_manager.api.keys import KeyRing, Secret
from lift_manager.api.roles import Role
from lift_manager.lift.events import Alarm
from lift_manager.lift.session import Holder
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Phase
from lift_manager.web.events.feed import KEEP_EVENTS_S, MAX_KEPT_EVENTS, Feed, PublishedEvent, StreamScope
from lift_manager.web.events.readers import BATCH_BYTES, QUEUE_LENGTH, READERS_A_TURN, OpenStreams, Reader
from lift_manager.web.outlet import Outlet
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.keyed import key, ring
from tests.lift_manager.web.listening import Happening, Message, messages
from tests.support.virtual_time import elapse, run_virtual

CALLER = Holder("ride", "amr-7")


def always() -> bool:
    return True


def run(main: Coroutine[Any, Any, None]) -> None:
    async def once() -> None:
        await main

    run_virtual(once, limit_s=7200)


async def said(reader: Reader) -> list[Message]:
    """What one turn of the reader brings."""
    sent = await reader.next()
    assert sent is not None
    return messages(sent)


class Noting:
    """Takes what a reader is sent, with the time."""

    def __init__(self) -> None:
        self.sent: list[tuple[float, bytes]] = []

    async def take(self, reader: Reader) -> None:
        while (sent := await reader.next()) is not None:
            self.sent.append((asyncio.get_running_loop().time(), sent))


def test_a_reader_that_hears_nothing_hears_a_heartbeat_every_second_and_no_other_hears_more() -> None:
    async def main() -> None:
        manager, noted = Happening(), Noting()
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always) as reader:
            taking = asyncio.ensure_future(noted.take(reader))
            await elapse(10.1)
            quiet = noted.sent[1:]
            assert {sent for _, sent in quiet} == {b":\n\n"}
            times = [at for at, _ in noted.sent]
            assert 9 <= len(quiet) <= 14
            assert max(later - at for at, later in pairwise(times)) <= 1.0
            manager.happens(Alarm("lift", "one"))
            await elapse(0.1)
            noted.sent.clear()
            for _ in range(20):
                await elapse(0.5)
                manager.happens(Alarm("lift", "one"))
            await elapse(0.1)
            assert len(noted.sent) == 20
            assert b":\n\n" not in {sent for _, sent in noted.sent}
            reader.end()
            await taking

    run(main())


def test_nothing_is_listened_to_before_the_first_reader_and_no_timer_runs_after_the_last() -> None:
    async def main() -> None:
        manager, places = Happening(), OpenStreams(10)
        feed = Feed(manager, places)
        ears = [manager.has_ears]
        with feed.reader(StreamScope(), None, always):
            ears.append(manager.has_ears)
            await elapse(3)
        # the virtual loop fails a test whose timers go on for ever: nothing is left to wait for
        assert (ears, places.is_full) == ([False, True], False)

    run(main())


def test_a_reader_that_is_too_slow_is_told_how_many_it_lost_and_how_things_are() -> None:
    async def main() -> None:
        manager = Happening()
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            (first,) = await said(reader)
            assert (first.event, first.data["lost"]) == ("snapshot", False)
            for number in range(QUEUE_LENGTH + 50):
                manager.shift("lift", reason=f"{number}")
            lost, snapshot = await said(reader)
            assert (lost.event, lost.data["events"], lost.id) == ("lost", QUEUE_LENGTH + 50, "")
            assert (snapshot.event, snapshot.id) == ("snapshot", f"b0-{QUEUE_LENGTH + 50}")
            assert snapshot.data["lifts"][0]["reason"] == f"{QUEUE_LENGTH + 49}"
            manager.happens(Alarm("lift", "after it"))
            (after,) = await said(reader)
            assert after.data["text"] == "after it"

    run(main())


def test_a_reader_that_comes_back_and_is_too_slow_loses_what_it_has_missed_as_well() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always):
            for _ in range(400):
                manager.happens(Alarm("lift", "missed"))
        with feed.reader(StreamScope(), "b0-0", always) as reader:
            for _ in range(QUEUE_LENGTH + 1):
                manager.happens(Alarm("lift", "lost"))
            lost, _ = await said(reader)
            assert lost.data["events"] == 400 + QUEUE_LENGTH + 1

    run(main())


def test_what_is_published_for_a_snapshot_does_not_come_again_behind_it() -> None:
    class Late(Happening):
        """Has a change that it has not told of."""

        def freshen(self, lift: str | None = None) -> None:
            self.shift("lift", reason="told for the snapshot")

    async def main() -> None:
        manager = Late()
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            (first,) = await said(reader)
            assert first.data["lifts"][0]["reason"] == "told for the snapshot"
            assert first.id == "b0-1"
            for _ in range(QUEUE_LENGTH + 1):
                manager.happens(Alarm("lift", "too many"))
            _, again = await said(reader)
            assert again.id == f"b0-{QUEUE_LENGTH + 3}"
            manager.happens(Alarm("lift", "the next"))
            (after,) = await said(reader)
            assert after.id == f"b0-{QUEUE_LENGTH + 4}"

    run(main())


def test_what_waits_is_sent_in_pieces_of_a_bounded_size() -> None:
    async def main() -> None:
        manager = Happening()
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            await said(reader)
            for _ in range(100):
                manager.happens(Alarm("lift", "x" * 2000))
            sizes = []
            count = 0
            while count < 100:
                sent = await reader.next()
                assert sent is not None
                sizes.append(len(sent))
                count += len(messages(sent))
            assert len(sizes) > 2
            assert max(sizes) < BATCH_BYTES + 3000

    run(main())


def test_a_reader_hears_of_its_own_lift_alone_and_of_the_same_as_those_who_hear_everything() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with (
            feed.reader(StreamScope(), None, always) as one,
            feed.reader(StreamScope(lift="lift"), None, always) as other,
        ):
            await said(one)
            await said(other)
            manager.shift("lift", floor="L2")
            assert await said(one) == await said(other)
            manager.shift("goods", floor="L2")
            manager.happens(Alarm("lift", "the last"))
            assert [message.id for message in await said(other)] == ["b0-3"]
            assert [message.id for message in await said(one)] == ["b0-2", "b0-3"]

    run(main())


def test_an_age_is_right_when_it_is_sent_however_long_it_waited() -> None:
    async def main() -> None:
        manager = Happening()
        ride = a_ride(CALLER, "r1", "lift")
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always) as reader:
            await said(reader)
            manager.shift("lift", age_s=0.1, holder=CALLER, held_since_s=5.0)
            manager.happens(RideChanged("lift", ride))
            await elapse(10)
            state, late = await said(reader)
            assert state.data["lift"]["age_s"] == pytest.approx(10.1)
            assert state.data["lift"]["session"]["for_s"] == pytest.approx(15.0)
            assert late.data["ride"]["phase_ends_in_s"] == pytest.approx(90.0)
        await elapse(100)
        with feed.reader(StreamScope(), "b0-0", always) as reader:
            state, late = await said(reader)
            assert state.data["lift"]["age_s"] == pytest.approx(110.1)
            assert late.data["ride"]["phase_ends_in_s"] == 0.0

    run(main())


def test_events_older_than_five_minutes_are_not_kept() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always):
            manager.happens(Alarm("lift", "old"))
            await elapse(KEEP_EVENTS_S + 1)
            manager.happens(Alarm("lift", "new"))
        with feed.reader(StreamScope(), "b0-0", always) as reader:
            (first,) = await said(reader)
            assert (first.event, first.data["lost"]) == ("snapshot", True)
        with feed.reader(StreamScope(), "b0-1", always) as reader:
            (first,) = await said(reader)
            assert first.data["text"] == "new"

    run(main())


def test_a_reader_that_has_heard_everything_goes_on_whatever_is_kept() -> None:
    async def main() -> None:
        manager = Happening(newest=MAX_KEPT_EVENTS * 2)
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), f"b0-{MAX_KEPT_EVENTS * 2}", always) as reader:
            manager.happens(Alarm("lift", "next"))
            (first,) = await said(reader)
            assert first.data["text"] == "next"

    run(main())


def test_rides_that_are_over_are_in_the_snapshot_of_their_own_reader_alone() -> None:
    async def main() -> None:
        manager = Happening()
        manager.fake_rides.going_on(a_ride(CALLER, "r1"), replace(a_ride(CALLER, "r2"), phase=Phase.DONE))
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always) as reader:
            (all_,) = await said(reader)
        with feed.reader(StreamScope(ride="r2"), None, always) as reader:
            (own,) = await said(reader)
        assert [ride["id"] for ride in all_.data["rides"]] == ["r1"]
        assert [ride["id"] for ride in own.data["rides"]] == ["r2"]

    run(main())


@pytest.mark.parametrize("begins", [Role.VIEWER, None], ids=["a key that is revoked", "no key where one is needed"])
def test_a_reader_that_may_not_read_any_more_hears_no_more_within_a_second(begins: Role | None) -> None:
    async def main() -> None:
        keys = [ring(Role.VIEWER)] if begins else [KeyRing()]
        of = None if begins is None else keys[0].find(Secret(key(begins)))
        assert keys[0].admits(of)
        noted, places = Noting(), OpenStreams(10)
        with Feed(Happening(), places).reader(StreamScope(), None, lambda: keys[-1].admits(of)) as reader:
            taking = asyncio.ensure_future(noted.take(reader))
            await elapse(3)
            assert not taking.done()
            keys.append(ring(Role.OPERATOR))
            await elapse(1)
            assert taking.done()

    run(main())


class Counting(Happening):
    """Counts how often somebody wants to know how all its lifts are."""

    asked_for = 0

    def freshen(self, lift: str | None = None) -> None:
        self.asked_for += 1


def test_readers_that_begin_together_share_a_snapshot_and_hear_what_came_after_it() -> None:
    async def main() -> None:
        manager = Counting()
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always) as first:
            (one,) = await said(first)
            manager.happens(Alarm("lift", "between them"))
            await elapse(0.2)
            with (
                feed.reader(StreamScope(), None, always) as second,
                feed.reader(StreamScope(lift="lift"), None, always) as other,
            ):
                two, between = await said(second)
                assert (two, between.data["text"]) == (one, "between them")
                assert [message.id for message in await said(other)] == ["b0-1"]
                assert manager.asked_for == 2
            await elapse(0.2)
            with feed.reader(StreamScope(), None, always) as third:
                (three,) = await said(third)
                assert (three.event, three.id, manager.asked_for) == ("snapshot", "b0-1", 3)

    run(main())


def test_readers_that_are_too_slow_together_share_a_snapshot_and_lose_nothing_that_came_after_it() -> None:
    async def main() -> None:
        manager = Counting()
        feed = Feed(manager, OpenStreams(10))
        with feed.reader(StreamScope(), None, always) as one, feed.reader(StreamScope(), None, always) as other:
            for reader in (one, other):
                await said(reader)
            for _ in range(QUEUE_LENGTH + 1):
                manager.happens(Alarm("lift", "lost"))
            await elapse(0.1)
            asked_for = manager.asked_for
            _, first = await said(one)
            manager.happens(Alarm("lift", "after it"))
            lost, second = await said(other)
            (after,) = await said(other)
            assert (lost.data["events"], second, after.data["text"]) == (QUEUE_LENGTH + 1, first, "after it")
            assert manager.asked_for == asked_for + 1

    run(main())


def test_an_event_is_encoded_once_however_many_hear_it() -> None:
    async def main() -> None:
        manager = Happening()
        encoded: list[str] = []
        with manager.tap(
            lambda occurrence: heard.append(PublishedEvent(occurrence.id, occurrence.at, occurrence.event, (), age))
        ):
            heard: list[PublishedEvent] = []

            def age(lift: str) -> float:
                encoded.append(lift)
                return 2.0

            manager.shift("lift", floor="L2")
        (one,) = heard
        now = asyncio.get_running_loop().time()
        fresh = one.wire(now)
        assert one.wire(now + 0.2) is fresh
        assert encoded == ["lift"]
        assert one.wire(now + 0.3) != fresh

    run(main())


class Room(Outlet):
    """Takes what a reader is sent while there is room."""

    def __init__(self) -> None:
        self.room = True
        self.sent: list[bytes] = []

    @property
    def has_room(self) -> bool:
        return self.room

    def write(self, part: bytes) -> None:
        self.sent.append(part)


class Unwritable:
    """An event that cannot be encoded."""

    def wire(self, now: float) -> bytes:
        raise ZeroDivisionError


def test_a_connection_with_room_is_sent_events_in_their_order_without_its_task_being_woken() -> None:
    async def main() -> None:
        manager, noted, outlet = Happening(), Noting(), Room()
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            reader.outlet = outlet
            taking = asyncio.ensure_future(noted.take(reader))
            await elapse(0.1)
            assert len(noted.sent) == 1
            for number in range(6):
                outlet.room = number not in {2, 3}
                manager.happens(Alarm("lift", f"a{number}"))
                manager.happens(Alarm("lift", f"b{number}"))
                await elapse(0.1)
            texts = [[message.data["text"] for message in messages(part)] for part in outlet.sent]
            assert texts == [["a0", "b0"], ["a1", "b1"], ["a4", "b4"], ["a5", "b5"]]
            texts = [[message.data["text"] for message in messages(part)] for _, part in noted.sent[1:]]
            assert texts == [["a2", "b2"], ["a3", "b3"]]
            await elapse(2.1)
            assert outlet.sent[4:] == [b":\n\n"] * 2
            reader.end()
            await taking
            assert len(noted.sent) == 3

    run(main())


def test_what_comes_while_many_readers_are_served_does_not_wait_for_all_of_them() -> None:
    async def main() -> None:
        manager, outlets, served = Happening(), [Room() for _ in range(3 * READERS_A_TURN - 1)], list[int]()
        feed, loop = Feed(manager, OpenStreams(len(outlets))), asyncio.get_running_loop()

        def note() -> None:
            served.append(sum(bool(outlet.sent) for outlet in outlets))
            if served[-1] < len(outlets):
                loop.call_soon(note)

        with ExitStack() as readers:
            taking = []
            for outlet in outlets:
                reader = readers.enter_context(feed.reader(StreamScope(), None, always))
                reader.outlet = outlet
                taking.append((reader, asyncio.ensure_future(Noting().take(reader))))
            await elapse(0.1)
            manager.happens(Alarm("lift", "one"))
            loop.call_soon(note)
            await elapse(0.1)
            assert served == [READERS_A_TURN, 2 * READERS_A_TURN, len(outlets)]
            for reader, task in taking:
                reader.end()
                await task

    run(main())


def test_an_event_right_behind_the_turn_of_a_task_brings_no_heartbeat() -> None:
    async def main() -> None:
        manager, noted, outlet = Happening(), Noting(), Room()
        with Feed(manager, OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            reader.outlet = outlet
            taking = asyncio.ensure_future(noted.take(reader))
            await elapse(0.1)
            outlet.room = False
            manager.happens(Alarm("lift", "one"))
            asyncio.get_running_loop().call_soon(manager.happens, Alarm("lift", "two"))
            asyncio.get_running_loop().call_soon(setattr, outlet, "room", True)
            await elapse(0.1)
            sent = b"".join([*(part for _, part in noted.sent), *outlet.sent])
            assert [message.event for message in messages(sent)] == ["snapshot", "alarm", "alarm"]
            assert b":\n\n" not in {*outlet.sent, *(part for _, part in noted.sent)}
            reader.end()
            await taking

    run(main())


def test_a_bug_in_an_event_reaches_the_task_of_the_connection() -> None:
    async def main() -> None:
        with Feed(Happening(), OpenStreams(10)).reader(StreamScope(), None, always) as reader:
            reader.outlet = Room()
            taking = asyncio.ensure_future(Noting().take(reader))
            await elapse(0.1)
            reader.put(Unwritable())
            with pytest.raises(ZeroDivisionError):
                await taking

    run(main())
