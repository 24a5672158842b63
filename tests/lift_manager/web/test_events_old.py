"""An event that is handed out late invites nobody to drive."""

import asyncio
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from starlette.types import Message as Sent

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase
from lift_manager.web.events.feed import Feed, StreamScope
from lift_manager.web.events.readers import OpenStreams, Reader
from lift_manager.web.events.stream import EventStream
from register_maps.words import Door, Mode, Motion, Side
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.listening import Happening, Message, messages
from tests.support.virtual_time import elapse, run_virtual

CALLER = Holder("ride", "amr-7")
OPEN = {"robot_door": RobotDoor.OPEN, "doors": {Side.FRONT: Door.OPEN}, "permissions": {"may_enter": True}}
MAX_AGE_S = 2.0
"""Of the fake manager's lifts; their states are 0.1 s old when they are published."""


def run(main: Coroutine[Any, Any, None]) -> None:
    async def once() -> None:
        await main

    run_virtual(once, limit_s=7200)


async def said(reader: Reader) -> list[Message]:
    sent = await reader.next()
    assert sent is not None
    return messages(sent)


@contextmanager
def away(feed: Feed) -> Iterator[None]:
    """Somebody listens, so that events are kept for whoever comes back."""
    with feed.reader(StreamScope(), None, lambda: True):
        yield


@pytest.mark.parametrize(("guidance", "old"), [(Guidance.ENTER, "wait"), (Guidance.LEAVE, "stay")])
def test_a_reader_that_comes_back_is_not_told_to_drive_by_what_was_so_before(guidance: Guidance, old: str) -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with away(feed):
            manager.rides_on(replace(a_ride(CALLER), guidance=guidance))
            await elapse(MAX_AGE_S - 0.5)
            with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                (young,) = await said(reader)
            await elapse(0.6)
            with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                (late,) = await said(reader)
            assert (young.data["ride"]["guidance"], young.data["ride"]["reason"]) == (guidance, "")
            assert young.data["age_s"] == pytest.approx(1.5)
            assert late.data["ride"]["guidance"] == old
            assert (
                late.data["ride"]["reason"]
                == f"`{guidance}` was given 2.1 s ago; GET /api/v1/rides/r1 has what holds now"
            )
            assert (late.data["age_s"], late.data["ride"]["phase"]) == (pytest.approx(2.1), Phase.BOARDING)

    run(main())


def test_other_guidance_is_told_as_it_was_however_old() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        plain = [guidance for guidance in Guidance if guidance not in {Guidance.ENTER, Guidance.LEAVE}]
        with away(feed):
            for guidance in plain:
                manager.rides_on(replace(a_ride(CALLER), guidance=guidance, reason="as it is"))
            await elapse(100)
            with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                found = await said(reader)
            told = [(message.data["ride"]["guidance"], message.data["ride"]["reason"]) for message in found]
            assert told == [(guidance, "as it is") for guidance in plain]

    run(main())


def test_a_reader_that_comes_back_is_told_an_open_door_of_before_as_one_that_nobody_knows() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with away(feed):
            manager.shift("lift", **OPEN, destination="L2", holder=Holder("api", "amr-7"), held_since_s=1.0)
            manager.shift("goods", **OPEN)
            await elapse(MAX_AGE_S - 0.2)
            with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                young = await said(reader)
            await elapse(0.11)
            with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                late = [message.data["lift"] for message in await said(reader)]
            assert [message.data["lift"]["robot_door"] for message in young] == ["open", "open"]
            for lift in late:
                assert (lift["quality"], lift["robot_door"], lift["floor"]) == ("offline", "moving", None)
                assert (lift["doors"], lift["motion"], lift["mode"]) == ({}, Motion.UNKNOWN, Mode.UNKNOWN)
                assert (lift["standing"], lift["permissions"]) == (False, {})
                assert "GET /api/v1/lifts" in lift["reason"]
                assert lift["age_s"] == pytest.approx(2.01)
            assert [lift["destination"] for lift in late] == ["L2", None]
            assert late[0]["session"]["name"] == "amr-7"

    run(main())


def test_what_was_encoded_for_another_reader_a_moment_ago_is_not_handed_out_once_it_is_too_old() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with away(feed):
            manager.shift("lift", **OPEN)
            manager.rides_on(a_ride(CALLER))
            doors, guidance = [], []
            for wait_s in (1.85, 0.1, 0.1):
                await elapse(wait_s)
                with feed.reader(StreamScope(), "b0-0", lambda: True) as reader:
                    state, ride = await said(reader)
                doors.append(state.data["lift"]["robot_door"])
                guidance.append(ride.data["ride"]["guidance"])
            assert doors == ["open", "moving", "moving"]
            assert guidance == ["enter", "enter", "wait"]

    run(main())


def test_a_snapshot_of_a_moment_ago_is_not_handed_out_once_a_lift_in_it_is_too_old() -> None:
    async def main() -> None:
        manager = Happening()
        feed = Feed(manager, OpenStreams(10))
        with away(feed):
            manager.shift("lift", **OPEN, age_s=1.9)
            with feed.reader(StreamScope(lift="lift"), None, lambda: True) as reader:
                (first,) = await said(reader)
            await elapse(0.15)
            manager.lifts = {**manager.lifts, "lift": replace(manager.lifts["lift"], robot_door=RobotDoor.CLOSED)}
            with feed.reader(StreamScope(lift="lift"), None, lambda: True) as reader:
                (second,) = await said(reader)
            assert [one.data["lifts"][0]["robot_door"] for one in (first, second)] == ["open", "closed"]

    run(main())


def test_a_slow_reader_is_not_told_to_drive_by_what_waited_for_it() -> None:
    """Its connection takes nothing more after the snapshot, for ten seconds."""

    async def main() -> None:
        manager = Happening()
        feed, places = Feed(manager, OpenStreams(10)), OpenStreams(10)
        room, sent, gone = asyncio.Event(), bytearray(), asyncio.Event()

        async def send(message: Sent) -> None:
            if sent:
                await room.wait()
            sent.extend(message.get("body", b""))

        async def receive() -> Sent:
            await gone.wait()
            return {"type": "http.disconnect"}

        stream = EventStream(places, lambda: feed.reader(StreamScope(), None, lambda: True))
        serving = asyncio.ensure_future(stream({"type": "http", "app": None}, receive, send))
        await elapse(0.1)
        manager.rides_on(a_ride(CALLER))
        manager.shift("lift", **OPEN)
        await elapse(10)
        manager.rides_on(replace(a_ride(CALLER), guidance=Guidance.WAIT, phase=Phase.CANCELLED))
        room.set()
        await elapse(0.1)
        gone.set()
        await serving
        told = messages(bytes(sent))
        rides = [message.data["ride"]["guidance"] for message in told if message.event == "ride"]
        states = [message.data["lift"]["robot_door"] for message in told if message.event == "state"]
        assert (rides, states) == (["wait", "wait"], ["moving"])

    run(main())
