"""The event stream over cuts, silence, restarts and nonsense."""

import asyncio
from collections.abc import AsyncIterator
from random import Random

import httpx
import pytest

from lift_manager.api.events import AlarmEvent, Snapshot, StateEvent
from lift_manager.client import Connected, Disconnected, EventStream, LiftManagerClient, NotAllowed
from lift_manager.client.stream import StreamEvent
from lift_manager.plain.backoff import Backoff
from tests.lift_manager.client.manager import IDLE, OPEN, URL, Manager, no, said
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual


def alarm(number: int) -> AlarmEvent:
    return AlarmEvent(lift="lift", text=str(number), holder=None)


def client_of(manager: Manager) -> LiftManagerClient:
    return LiftManagerClient(URL, transport=manager, chance=Random(1))


async def take(events: EventStream, count: int) -> list[StreamEvent]:
    return [await anext(events) for _ in range(count)]


def test_a_stream_begins_with_how_things_are_and_goes_on_with_what_changes() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.events(lift="lift") as events:
            assert await take(events, 2) == [Connected(), Snapshot(lifts=(IDLE,), rides=(), lost=False)]
            manager.show(OPEN)
            assert await anext(events) == StateEvent(lift=OPEN)
            assert events.last_id == "a-1"
        assert manager.asked == ["GET /api/v1/events"]

    run_virtual(main)


@each_row("seed", range(20))
def test_a_stream_that_is_cut_at_random_points_loses_and_repeats_nothing(seed: int) -> None:
    chance = Random(seed)

    async def main() -> tuple[list[str], int]:
        manager = Manager(cuts=chance)
        heard: list[str] = []
        async with client_of(manager) as client, client.events() as events, asyncio.TaskGroup() as tasks:
            while not isinstance(await anext(events), Snapshot):
                pass
            tasks.create_task(speak(manager))
            while len(heard) < 200:
                event = await anext(events)
                assert not isinstance(event, Snapshot)
                if isinstance(event, AlarmEvent):
                    heard.append(event.text)
        return heard, len(manager.asked)

    async def speak(manager: Manager) -> None:
        for number in range(200):
            manager.publish(alarm(number))
            await elapse(chance.choice([0.0, 0.01, 0.5]))

    heard, connections = run_virtual(main)
    assert heard == [str(number) for number in range(200)]
    assert connections > 5


def test_a_wait_that_is_cancelled_loses_nothing() -> None:
    async def main() -> list[str]:
        manager = Manager()
        heard: list[str] = []
        async with client_of(manager) as client, client.events() as events:
            await take(events, 2)
            for number in range(20):
                manager.publish(alarm(number))
            while len(heard) < 20:
                try:
                    async with asyncio.timeout(0.001):
                        event = await anext(events)
                except TimeoutError:
                    continue
                if isinstance(event, AlarmEvent):
                    heard.append(event.text)
                    async with asyncio.timeout(None):
                        await elapse(0)
        return heard

    assert run_virtual(main) == [str(number) for number in range(20)]


def test_a_restarted_manager_says_that_events_are_lost_and_how_things_are() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.events() as events:
            await take(events, 2)
            manager.show(OPEN)
            await anext(events)
            manager.restart()
            cut = await anext(events)
            assert isinstance(cut, Disconnected)
            assert (cut.reason, 0.5 <= cut.again_in_s <= 1.0) == ("cut", True)
            assert await take(events, 2) == [Connected(), Snapshot(lifts=(OPEN,), rides=(), lost=True)]
            assert manager.headers[-1]["last-event-id"] == "a-1"

    run_virtual(main)


def test_a_stream_that_says_nothing_for_three_seconds_is_dead() -> None:
    async def main() -> None:
        manager = Manager(beats=False)
        async with client_of(manager) as client, client.events() as events:
            await take(events, 2)
            began = asyncio.get_running_loop().time()
            event = await anext(events)
            assert event == Disconnected("no data for 3 s", event.again_in_s)  # type: ignore[union-attr]
            assert asyncio.get_running_loop().time() - began == pytest.approx(3.0)

    run_virtual(main)


def test_heartbeats_keep_a_quiet_stream_alive() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.events() as events:
            await take(events, 2)
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(3600):
                    await anext(events)
        assert len(manager.asked) == 1

    run_virtual(main, limit_s=4000)


def test_a_manager_that_is_away_is_tried_again_more_and_more_slowly() -> None:
    async def main() -> list[float]:
        manager = Manager(up=False)
        async with client_of(manager) as client, client.events() as events:
            away = await take(events, 8)
            manager.up = True
            assert isinstance(await anext(events), Connected)
            await anext(events)
            manager.cut()
            away.append(await anext(events))
        return [event.again_in_s for event in away if isinstance(event, Disconnected)]

    pauses = run_virtual(main)
    assert len(pauses) == 9
    for pause, most in zip(pauses, [1, 2, 4, 8, 15, 15, 15, 15, 1], strict=True):
        assert most / 2 <= pause <= most


def test_clients_that_were_cut_off_together_do_not_come_back_together() -> None:
    assert len({round(Backoff(Random(seed)).next_s(), 3) for seed in range(20)}) > 15


def test_a_key_that_may_not_listen_ends_the_stream() -> None:
    async def main() -> None:
        manager = Manager(handlers={("GET", "/api/v1/events"): lambda _: no(403, "not_allowed")})
        async with client_of(manager) as client, client.events() as events:
            with pytest.raises(NotAllowed):
                await anext(events)

    run_virtual(main)


class Nonsense(httpx.AsyncByteStream):
    def __init__(self, content: bytes) -> None:
        self._content = content

    async def __aiter__(self) -> AsyncIterator[bytes]:
        yield self._content


EVENTS = {"content-type": "text/event-stream"}


@each_row(
    ("answer", "why"),
    [
        (lambda: said(200, "<html>"), "it sends no events"),
        (lambda: said(502, "<html>"), "is not a lift manager"),
        (lambda: no(503, "too_many_streams", "full"), "full"),
        (lambda: httpx.Response(200, headers=EVENTS, stream=Nonsense(b"data: {\n\n")), "cannot be read"),
        (
            lambda: httpx.Response(200, headers=EVENTS, stream=Nonsense(b'data: {"event": "state"}\n\n')),
            "cannot be read",
        ),
        (lambda: httpx.Response(200, headers=EVENTS, stream=Nonsense(b"\xff\x00 \n")), "ended the stream"),
    ],
)
def test_nonsense_is_a_connection_that_broke(answer: object, why: str) -> None:
    async def main() -> None:
        manager = Manager(handlers={("GET", "/api/v1/events"): lambda _: answer()})  # type: ignore[operator]
        async with client_of(manager) as client, client.events() as events:
            found = [event for event in await take(events, 4) if isinstance(event, Disconnected)]
            assert why in found[0].reason
            manager.handlers.clear()
            while not isinstance(await anext(events), Snapshot):
                pass

    run_virtual(main)


def test_an_event_that_only_a_newer_manager_knows_is_passed_over() -> None:
    content = (
        b'id: a-1\nevent: party\ndata: {"event": "party"}\n\nid: a-2\ndata: ' + alarm(7).model_dump_json().encode()
    )

    async def main() -> None:
        stream = httpx.Response(200, headers=EVENTS, stream=Nonsense(content + b"\n\n"))
        manager = Manager(handlers={("GET", "/api/v1/events"): lambda _: stream})
        async with client_of(manager) as client, client.events() as events:
            assert await take(events, 2) == [Connected(), alarm(7)]
            assert events.last_id == "a-2"

    run_virtual(main)
