"""Publishes the rows of a journal into the stream of the site's own leaf node. The journal is the outbox; nothing else is kept.

How far it is comes from the stream itself: its newest message holds the row that was published last. So a restart, a leaf node that was
away and a stream that was lost need no file of their own, and a row that is published twice has the same id.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from drivers.thread import Worker
from lift_manager.hub import subjects
from lift_manager.hub.connection import CLOSE_WITHIN_S, Connection, raise_if_cancelled
from lift_manager.hub.messages import Position, RowMessage
from lift_manager.store.chain import StoredRow
from lift_manager.store.errors import JournalUnreadable
from lift_manager.store.read import Reader, open_journal

if TYPE_CHECKING:
    from nats.js import JetStreamContext

CHECK_EVERY_S = 0.25
"""How often the journal is checked for new rows. Chosen: what happens at a site shows at the hub within half a second."""
BATCH = 256
"""Rows published before the next check of the journal. Chosen: a tenth of a second."""
BACKLOG = 10_000
"""How many rows are published where the stream knows none of this journal. Chosen: a busy week; what is before them is a gap."""
ACKNOWLEDGE_S = 5.0
"""How long the leaf node may take to store a row."""
RETRY_S = 2.0
"""How long to wait after a failure."""
STREAM_BYTES = 256 * 1024 * 1024
"""Size of the stream; the oldest rows go first. Chosen: half of what a journal may take by default."""
SAME_ID_S = 120.0
"""How long the server recognises a row that it has already. Later the hub does."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Published:
    """A row that is in the stream, and the journal that it was in."""

    journal: str
    row: StoredRow


class JournalReader:
    """Reads the rows that follow one, in a thread of its own."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: Reader | None = None
        self._file: tuple[int, int] | None = None
        self._changes: int | None = None

    def after(self, published: Published | None) -> list[Published]:
        """Return the next rows; empty where there are none. Raises JournalUnreadable."""
        reader = self._open()
        if reader is None:
            return []
        changes = reader.changes()
        if changes == self._changes:
            return []
        found = self._rows(reader, published)
        if len(found) < BATCH:
            self._changes = changes
        return found

    def again(self) -> None:
        """Read the journal at the next call, changed or not."""
        self._changes = None

    def close(self) -> None:
        """Close the file."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _open(self) -> Reader | None:
        """Return the journal that is in place now: a damaged one is moved away while the manager runs, and another is made."""
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return None  # the first commit of a new site makes it
        except OSError as error:
            raise JournalUnreadable(f"{self._path} cannot be read ({error.strerror or error})") from error
        file = (found.st_dev, found.st_ino)
        if self._reader is None or self._file != file:
            self.close()
            self._reader, self._file = open_journal(self._path), file
            self._changes = None
        return self._reader

    @staticmethod
    def _rows(reader: Reader, published: Published | None) -> list[Published]:
        journal = _journal_id(reader)
        if published is None:
            last = reader.last() or 0
            rows = reader.rows(after=last - BACKLOG)
        elif reader.row(published.row.seq) == published.row or (reader.first() or 0) > published.row.seq:
            # the row is there, or was removed because it was old
            journal, rows = published.journal, reader.rows(after=published.row.seq)
        else:
            # a backup was restored, or the journal was made again: its rows have numbers that others had before
            journal = _journal_id(reader, published.row.hash.hex())
            rows = (row for row in reader.rows() if row.at > published.row.at)
        return [Published(journal, row) for row in islice(rows, BATCH)]


def _journal_id(reader: Reader, replaced: str = "") -> str:
    """Return what tells a journal from others of the site, also from one with the same beginning that it replaced."""
    return hashlib.sha256(f"{reader.site}\n{reader.made_at}\n{replaced}".encode()).hexdigest()[:12]


class Outbox:
    """Publishes rows as long as `run` runs."""

    def __init__(self, site: str, path: Path, connection: Connection) -> None:
        """`path` is the store of the site."""
        self._site = site
        self._connection = connection
        self._reader = JournalReader(path)
        self._worker = Worker("lift-manager-outbox")
        self._stream = ""
        self._trouble = ""
        self.newest: Position | None = None
        """Of the newest row in the stream; None while the stream cannot be used."""
        self.changed = asyncio.Event()
        """Set when `newest` has changed."""

    async def run(self) -> None:
        """Publish until cancelled. A leaf node that is away, or without JetStream, is logged once and tried again."""
        from nats.errors import Error  # noqa: PLC0415  loaded only where the hub is used

        try:
            while True:
                try:
                    await self._publish_all(self._connection.client.jetstream())
                except (Error, TimeoutError, JournalUnreadable, OSError) as error:
                    raise_if_cancelled()
                    self._report(str(error) or type(error).__name__)
                    self.newest = None
                await asyncio.sleep(RETRY_S)
        finally:
            closed = self._worker.submit(self._reader.close)
            self._worker.stop()
            await asyncio.wait([closed], timeout=CLOSE_WITHIN_S)  # a disk may hang

    async def _publish_all(self, stream: JetStreamContext) -> None:
        published, number = await self._open_stream(stream)
        self._reader.again()
        self._set_newest(number)
        while True:
            rows = await self._worker.submit(lambda after=published: self._reader.after(after))  # type: ignore[misc]
            if rows:
                self._set_newest(await self._publish(stream, rows))
                published = rows[-1]
            if len(rows) < BATCH:
                await asyncio.sleep(CHECK_EVERY_S)

    async def _publish(self, stream: JetStreamContext, rows: list[Published]) -> int:
        """Publish rows in their order, and return the number of the last one in the stream once all are stored."""
        number = 0
        for entry in rows:
            # one after the other: a row that failed behind one that did not would never be published
            ident = {"Nats-Msg-Id": f"{entry.journal}:{entry.row.seq}"}
            stored = await stream.publish(
                subjects.journal(self._site), _encode(entry), ACKNOWLEDGE_S, subjects.STREAM, ident
            )
            number = stored.seq
        return number

    async def _open_stream(self, stream: JetStreamContext) -> tuple[Published | None, int]:
        """Return the newest row in the stream and its number; make a stream that is missing."""
        from nats.js.api import DiscardPolicy, StreamConfig  # noqa: PLC0415
        from nats.js.errors import NotFoundError  # noqa: PLC0415

        config = StreamConfig(
            name=subjects.STREAM,
            subjects=[subjects.journal(self._site)],
            max_bytes=STREAM_BYTES,
            discard=DiscardPolicy.OLD,
            duplicate_window=SAME_ID_S,
            allow_direct=True,
            deny_delete=True,
        )
        try:
            info = await stream.stream_info(subjects.STREAM)
        except NotFoundError:
            info = await stream.add_stream(config)
        self._stream = str(info.created)
        try:
            message = await stream.get_last_msg(subjects.STREAM, subjects.journal(self._site))
        except NotFoundError:
            return None, info.state.last_seq
        self._report("")
        return _decode(message.data or b""), info.state.last_seq

    def _set_newest(self, number: int) -> None:
        self._report("")
        self.newest = Position(stream=self._stream, at=number)
        self.changed.set()

    def _report(self, trouble: str) -> None:
        if trouble and trouble != self._trouble:
            text = "hub: the rows of the journal do not reach the leaf node (%s); they are published as soon as they can be"
            _log.warning(text, trouble)
        self._trouble = trouble


def _encode(entry: Published) -> bytes:
    row = entry.row
    message = {**row._asdict(), "hash": row.hash.hex(), "journal": entry.journal}
    return json.dumps(message, ensure_ascii=False, separators=(",", ":")).encode()


def _decode(data: bytes) -> Published | None:
    """Return a row that this program has published; None for anything else, which is as good as no row."""
    try:
        found = RowMessage.model_validate_json(data)
    except ValidationError:
        return None
    row = StoredRow(
        found.seq, found.at, found.kind, found.lift, found.caller, found.text, found.data, bytes.fromhex(found.hash)
    )
    return Published(found.journal, row)
