"""Event streams over real sockets: their heads, slow readers, many readers, the end of the manager, and who may read."""

import asyncio
import json
import socket
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import uvloop

from lift_manager.api.keys import Key
from lift_manager.api.roles import Role
from lift_manager.lift.events import Alarm
from lift_manager.lift.journal import Row
from lift_manager.runtime.links import WireFrame
from lift_manager.store.keys import KeyFile, make_key, revoke_key
from lift_manager.web.app import make_app
from register_maps import frames
from register_maps.words import Table
from tests.lift_manager.web.fake import ask, serving
from tests.lift_manager.web.fake_lifts import AT
from tests.lift_manager.web.keyed import bearing, ring
from tests.lift_manager.web.listening import EVENTS, Happening, Message, Stream, listening, messages, unchunked, until
from tests.support.programs import HANGS_S, soon

on_both_loops = pytest.mark.parametrize(
    "loop", [asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"]
)
FRAMES = "/api/v1/links/plc/frames"


def run(main: Coroutine[Any, Any, Any], loop: Callable[[], asyncio.AbstractEventLoop] = asyncio.new_event_loop) -> Any:
    with asyncio.Runner(loop_factory=loop) as runner:
        return runner.run(main)


class Wires:
    """Two links, and who listens to them."""

    def __init__(self) -> None:
        self.ears: dict[str, Callable[[WireFrame], None]] = {}

    def link_names(self) -> tuple[str, ...]:
        return ("plc", "east/wing")

    @contextmanager
    def tap_frames(self, link: str, hear: Callable[[WireFrame], None]) -> Iterator[None]:
        self.ears[link] = hear
        yield
        del self.ears[link]

    def pass_by(self, link: str, frame: bytes, *, sent: bool) -> None:
        self.ears[link](WireFrame(link, sent, frame, 12.5))


@on_both_loops
def test_a_stream_says_what_it_is_and_begins_with_a_snapshot(loop: Callable[[], asyncio.AbstractEventLoop]) -> None:
    manager = Happening()

    async def main() -> tuple[bytes, bytes, list[Message]]:
        async with serving(make_app(manager)) as port, listening(port) as stream:
            assert await stream.begin() == 200
            await stream.take(1)
            manager.shift("lift", floor="L2")
            found = await stream.take(2)
            return stream.head.lower(), unchunked(stream.raw), found

    head, body, found = run(main(), loop)
    for line in (b"content-type: text/event-stream", b"cache-control: no-store", b"x-accel-buffering: no"):
        assert line in head
    assert b"content-encoding" not in head
    assert b"content-length" not in head
    wish = body.partition(b"\n\n")[0]
    assert wish.startswith(b"retry: ")
    assert 1000 <= int(wish.removeprefix(b"retry: ")) <= 2000
    snapshot, state = found
    assert [lift["name"] for lift in snapshot.data["lifts"]] == ["lift", "goods"]
    assert snapshot.data["lifts"][0]["max_age_s"] == 2.0
    assert (snapshot.id, state.id, state.event, state.data["lift"]["floor"]) == ("b0-0", "b0-1", "state", "L2")


@pytest.mark.parametrize(
    ("query", "status", "code"),
    [
        ("?lift=nowhere", 404, "unknown_lift"),
        ("?lift=", 404, "unknown_lift"),
        ("?ride=nowhere", 404, "unknown_ride"),
        ("?lift=lift&ride=r1", 422, "malformed"),
        ("?lift=lift&lift=lift", 422, "malformed"),
        ("?lift=" + "x" * 5000, 422, "malformed"),
    ],
)
def test_what_is_not_there_is_not_listened_to(query: str, status: int, code: str) -> None:
    said = ask(Happening(), "GET", EVENTS + query)
    assert (said.status_code, said.json()["code"]) == (status, code)


def test_a_stream_beyond_the_limit_is_refused_until_another_one_has_gone() -> None:
    async def main() -> tuple[int, bytes]:
        async with serving(make_app(Happening(), streams=2)) as port, AsyncExitStack() as stack:
            async with listening(port) as gone:
                await gone.begin()
                await gone.take(1)
                other = await stack.enter_async_context(listening(port))
                await other.begin()
                async with listening(port) as refused:
                    status = await refused.begin()
            async with asyncio.timeout(HANGS_S):
                while True:
                    async with listening(port) as again:
                        if await again.begin() == 200:
                            return status, refused.head.lower()

    status, head = run(main())
    assert status == 503
    assert b"application/problem+json" in head
    assert b"retry-after: 5" in head


async def _statuses(
    port: int, stack: AsyncExitStack, count: int, headers: Mapping[str, str] | None = None
) -> tuple[list[int], str]:
    """Open so many streams and leave them open; returns their statuses, and what the last was told."""
    found, text = [], ""
    for _ in range(count):
        stream = await stack.enter_async_context(listening(port, headers=headers))
        found.append(await stream.begin())
        if found[-1] == 503:
            text = str(json.loads(await stream.reader.readuntil(b"}"))["detail"])
    return found, text


def test_one_key_gets_half_of_all_streams_and_the_others_the_rest() -> None:
    keys = ring(Role.VIEWER, Role.ROBOT, Role.OPERATOR)

    async def main() -> None:
        async with serving(make_app(Happening(), keys, streams=6)) as port, AsyncExitStack() as stack:
            async with AsyncExitStack() as of_viewer:
                found, text = await _statuses(port, of_viewer, 4, bearing(Role.VIEWER))
                assert found == [200, 200, 200, 503]
                assert text.startswith("the key the viewer has 3 event streams open, and of the 6 ")
                found, _ = await _statuses(port, stack, 3, bearing(Role.ROBOT))
                assert found == [200, 200, 200]
                found, text = await _statuses(port, stack, 1, bearing(Role.OPERATOR))
                assert found == [503]
                assert text.startswith("6 event streams are open")
            async with asyncio.timeout(HANGS_S):
                while (await _statuses(port, stack, 1, bearing(Role.VIEWER)))[0] != [200]:
                    pass

    run(main())


def test_without_keys_one_computer_may_have_all_streams() -> None:
    async def main() -> list[int]:
        async with serving(make_app(Happening(), streams=4)) as port, AsyncExitStack() as stack:
            return (await _statuses(port, stack, 5))[0]

    assert run(main()) == [200, 200, 200, 200, 503]


@on_both_loops
def test_a_reader_that_takes_nothing_costs_little_and_is_told_what_it_lost(
    loop: Callable[[], asyncio.AbstractEventLoop],
) -> None:
    manager, count = Happening(), 30_000

    async def main() -> bytes:
        async with serving(make_app(manager)) as port:
            with socket.socket() as slow:
                slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
                slow.connect(("127.0.0.1", port))
                slow.sendall(f"GET {EVENTS} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
                await until(lambda: manager.has_ears)
                for number in range(1, count + 1):
                    manager.happens(Alarm("lift", f"{number} " + "x" * 1000))
                    if number % 50 == 0:
                        await asyncio.sleep(0)
                slow.setblocking(False)
                return await taken(slow, f"b0-{count}")

    async def taken(slow: socket.socket, last_id: str) -> bytes:
        reader, writer = await asyncio.open_connection(sock=slow)
        stream = Stream(reader)
        await stream.begin()
        async with asyncio.timeout(HANGS_S):
            while last_id.encode() not in stream.raw[-200_000:]:
                stream.raw += await reader.read(65536)
            manager.happens(Alarm("lift", "after it"))
            while b"after it" not in stream.raw[-2000:]:
                stream.raw += await reader.read(65536)
        writer.close()
        return unchunked(stream.raw)

    body = run(main(), loop)
    found = messages(body)
    assert len(body) < 8_000_000  # what the kernel's buffers held, of 30 MB
    lost = [message.data["events"] for message in found if message.event == "lost"]
    heard = [message for message in found if message.event == "alarm"]
    snapshots = [message for message in found if message.event == "snapshot"]
    assert len(snapshots) == len(lost) + 1
    assert len(heard) + sum(lost) == count + 1
    assert [found.index(message) for message in snapshots[1:]] == [
        place + 1 for place, message in enumerate(found) if message.event == "lost"
    ]
    assert heard[-1].data["text"] == "after it"


def test_three_hundred_readers_hear_the_same() -> None:
    manager = Happening()

    async def main() -> list[list[Message]]:
        async with serving(make_app(manager)) as port, AsyncExitStack() as stack:
            streams = [await stack.enter_async_context(listening(port)) for _ in range(300)]
            for stream in streams:
                assert await stream.begin() == 200
                await stream.take(1)
            for number in range(20):
                manager.happens(Alarm("lift", f"{number}"))
                await asyncio.sleep(0)
            return [(await stream.take(21))[1:] for stream in streams]

    first, *others = run(main(), uvloop.new_event_loop)
    assert [message.data["text"] for message in first] == [f"{number}" for number in range(20)]
    assert all(other == first for other in others)


@on_both_loops
def test_streams_end_at_once_and_in_order_when_the_manager_ends(loop: Callable[[], asyncio.AbstractEventLoop]) -> None:
    async def main() -> tuple[float, list[bytes]]:
        async with AsyncExitStack() as stack:
            async with serving(make_app(Happening())) as port:
                streams = [await stack.enter_async_context(listening(port)) for _ in range(20)]
                for stream in streams:
                    await stream.begin()
                    await stream.take(1)
                began = time.monotonic()
            took = time.monotonic() - began
            for stream in streams:
                await stream.rest()
            return took, [stream.raw for stream in streams]

    def attempt() -> float:
        took, ends = run(main(), loop)
        assert all(end.endswith(b"\r\n0\r\n\r\n") for end in ends)
        return float(took)

    soon(attempt, 0.25)  # without a word to them, all of FINISH_WITHIN_S is waited for them


def test_the_stream_of_a_key_that_is_revoked_ends_within_two_seconds(tmp_path: Path) -> None:
    noted, files = list[Row](), count()

    async def main() -> float:
        path = tmp_path / f"keys{next(files)}.json"
        secret = make_key(path, "site", Key("", "page", Role.VIEWER), by="test", at=AT)
        keys = KeyFile(path, "site", open_without_keys=True)
        watching = asyncio.ensure_future(keys.run(noted.append))
        headers = {"Authorization": f"Bearer {secret.reveal()}"}
        async with serving(make_app(Happening(), keys)) as port, listening(port, EVENTS, headers) as stream:
            assert await stream.begin() == 200
            await stream.take(1)
            began = time.monotonic()
            revoke_key(path, "site", "page", by="test", at=AT)
            await stream.rest()
            watching.cancel()
            return time.monotonic() - began

    soon(lambda: float(run(main())), 2.0)


def test_a_viewer_hears_events_and_only_a_commissioner_sees_frames() -> None:
    keys, wires = ring(*Role), Wires()

    async def main() -> dict[tuple[Role, str], int]:
        async with serving(make_app(Happening(), keys, frames=wires)) as port:
            found = {}
            for role in Role:
                for path in (EVENTS, FRAMES):
                    async with listening(port, path, bearing(role)) as stream:
                        found[role, path] = await stream.begin()
            async with listening(port) as stream:
                assert await stream.begin() == 401
            return found

    for (role, path), status in run(main()).items():
        assert status == (403 if path == FRAMES and role is not Role.COMMISSIONER else 200)


def test_frames_are_told_in_words_and_listened_to_only_while_somebody_looks() -> None:
    wires = Wires()
    asked = frames.frame(frames.read(Table.HOLDING, 10, 2), 7)
    answered = frames.answer(frames.read(Table.HOLDING, 10, 2), 7, bytes(4))

    async def main() -> list[Message]:
        async with serving(make_app(Happening(), frames=wires)) as port:
            async with listening(port, FRAMES) as stream:
                assert await stream.begin() == 200
                await until(lambda: bool(wires.ears))
                wires.pass_by("plc", asked, sent=True)
                wires.pass_by("plc", answered, sent=False)
                found = await stream.take(2)
            await until(lambda: not wires.ears)
            async with listening(port, "/api/v1/links/east/wing/frames") as stream:
                assert await stream.begin() == 200
            return found

    request, answer = run(main())
    assert request.event == answer.event == "frame"
    assert request.data["hex"] == asked.hex(" ")
    assert (request.data["text"], request.data["sent"]) == (frames.describe(asked), True)
    assert (answer.data["text"], answer.data["sent"]) == (frames.describe_answer(answered), False)
    assert request.data["link"] == "plc"


def test_links_are_named_and_others_have_no_frames() -> None:
    app = make_app(Happening(), frames=Wires())

    async def main() -> tuple[bytes, int]:
        async with serving(app) as port:
            async with listening(port, "/api/v1/links") as names:
                await names.begin()
                body = await names.reader.readuntil(b"}")
            async with listening(port, "/api/v1/links/other/frames") as stream:
                return body, await stream.begin()

    body, status = run(main())
    assert body == b'{"links":["plc","east/wing"]}'
    assert status == 404
    assert ask(Happening(), "GET", "http://127.0.0.1:5003/api/v1/links").json() == {"links": []}
    elsewhere = ask(Happening(), "GET", "http://127.0.0.1:5003/api/v1/links", headers={"host": "192.0.2.7"})
    assert (elsewhere.status_code, elsewhere.json()["code"]) == (403, "other_computer")
