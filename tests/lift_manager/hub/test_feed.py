"""What a reader of the event stream gets: every event once and in order, however slow it is, and a word where that cannot be."""

import asyncio
import re
from collections.abc import Awaitable, Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import cast

from lift_manager.hub.feed import FOREIGN_EVENTS, HubFeed
from lift_manager.hub.messages import Position, RowMessage
from lift_manager.hub.rows import PAGE, RowStore
from lift_manager.hub.service import Hub, Receive
from lift_manager.web.events.readers import QUEUE_LENGTH, OpenStreams, Reader


class Rows:
    """The database of a hub and its listeners, without NATS."""

    def __init__(self, path: Path, kept: int = 1_000_000) -> None:
        self._path, self._receivers = path, list[Receive]()
        self._store = RowStore(path, kept=kept)
        self._seq = 0
        self.id = self._store.id

    def open_rows(self) -> RowStore:
        return RowStore(self._path)

    @contextmanager
    def listen(self, receive: Receive) -> Iterator[None]:
        self._receivers.append(receive)
        yield
        self._receivers.remove(receive)

    def arrive(self, count: int) -> None:
        """Let so many rows of a site arrive at once."""
        rows = []
        for _ in range(count):
            self._seq += 1
            about = {"kind": "press", "lift": "", "caller": "", "text": "", "data": "{}", "hash": "0" * 64}
            rows.append(RowMessage(journal="j", seq=self._seq, at=0, **about))
        for event in self._store.add_rows("berlin", rows, Position(stream="s", at=self._seq)):
            for receive in self._receivers:
                receive(event, "berlin")

    def close(self) -> None:
        self._store.close()


def reading(rows: Rows, after: str | None, then: Callable[[Reader], Awaitable[None]]) -> None:
    async def main() -> None:
        feed = HubFeed(cast("Hub", rows), OpenStreams(4))
        with feed.reader(None, after, lambda: True) as reader:
            await then(reader)

    with closing(rows):
        asyncio.run(main())


async def until_seq(reader: Reader, seq: int) -> str:
    """Read until a row has arrived; return all that was sent."""
    text = ""
    while seq not in seqs(text):
        text += ((await reader.next()) or b"").decode()
    return text


def seqs(text: str) -> list[int]:
    return [int(number) for number in re.findall(r'"seq":([0-9]+)', text)]


def test_a_reader_that_is_slower_than_the_rows_gets_all_of_them_once_and_in_order(tmp_path: Path) -> None:
    rows = Rows(tmp_path / "hub.db")

    async def read(reader: Reader) -> None:
        rows.arrive(3)
        text = await until_seq(reader, 3)
        rows.arrive(QUEUE_LENGTH + 2 * PAGE)
        text += await until_seq(reader, 10)
        rows.arrive(QUEUE_LENGTH + 7)
        text += await until_seq(reader, 3 + QUEUE_LENGTH + 2 * PAGE + QUEUE_LENGTH + 7)
        rows.arrive(1)
        text += await until_seq(reader, 11 + 2 * QUEUE_LENGTH + 2 * PAGE)
        assert seqs(text) == list(range(1, 12 + 2 * QUEUE_LENGTH + 2 * PAGE))
        assert "event: lost" not in text

    reading(rows, None, read)


def test_a_reader_that_was_away_for_long_gets_everything_that_it_has_missed(tmp_path: Path) -> None:
    rows = Rows(tmp_path / "hub.db")
    rows.arrive(3 * PAGE)

    async def read(reader: Reader) -> None:
        assert seqs(await until_seq(reader, 3 * PAGE)) == list(range(8, 3 * PAGE + 1))

    reading(rows, f"{rows.id}-7", read)


def test_a_reader_that_comes_from_another_hub_learns_that_and_gets_the_newest_events(tmp_path: Path) -> None:
    rows = Rows(tmp_path / "hub.db")
    rows.arrive(FOREIGN_EVENTS + 1)

    async def read(reader: Reader) -> None:
        text = await until_seq(reader, FOREIGN_EVENTS + 1)
        assert text.count("event: lost") == 1
        assert seqs(text) == list(range(2, FOREIGN_EVENTS + 2))

    reading(rows, "00000000-5", read)


def test_a_reader_that_was_away_until_its_events_were_removed_learns_that(tmp_path: Path) -> None:
    rows = Rows(tmp_path / "hub.db", kept=100)
    rows.arrive(150)

    async def read(reader: Reader) -> None:
        text = await until_seq(reader, 150)
        assert text.index("event: lost") < text.index("event: row")
        assert seqs(text)[0] > 6

    reading(rows, f"{rows.id}-5", read)


def test_a_reader_from_the_beginning_has_lost_nothing(tmp_path: Path) -> None:
    rows = Rows(tmp_path / "hub.db", kept=100)
    rows.arrive(150)

    async def read(reader: Reader) -> None:
        assert "event: lost" not in await until_seq(reader, 150)

    reading(rows, "0", read)
