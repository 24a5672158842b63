"""Writes down what happens: every event before it is published, every request before it is decided on, every press before it leaves."""

from __future__ import annotations

import asyncio
from asyncio import Future
from dataclasses import dataclass

from drivers.model import Command, Written
from lift_manager.core.bus import Bus
from lift_manager.core.journal import Journal
from lift_manager.core.memory import Memory
from lift_manager.domain import journal_rows as rows
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import Event
from lift_manager.domain.state import Holder
from register_maps.words import Mode

TOLD_EVERY_S = 60.0
"""How long repeats of one request are counted before a row tells of them. Chosen: robots repeat themselves once a second, and one row a
minute shows that they still do."""

CALLERS = 64
"""Callers whose last request is remembered. Chosen: far more robots than wait for one lift."""


class RecordingBus(Bus[Event]):
    """A bus of which every event is in the journal, heard or not."""

    def __init__(self, journal: Journal) -> None:
        super().__init__()
        self._journal = journal

    def publish(self, item: Event) -> None:
        """Note an event, and give it to all listeners."""
        row = rows.row_of(item)
        if row is not None:
            self._journal.note(row)
        super().publish(item)


@dataclass(slots=True)
class _Said:
    """One request, its answer, and how often both came again."""

    ask: Ask
    answer: Accepted | Refused | None
    since: float
    times: int = 0


class RequestLog:
    """The requests for one lift. One that only repeats its caller's last, with the same answer, is counted."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._last: dict[Holder, _Said] = {}

    def asked(self, ask: Ask) -> None:
        """Note a request that is about to be decided on."""
        last, now = self._last.get(ask.holder), asyncio.get_running_loop().time()
        if last is not None and last.ask == ask:
            last.times += 1
            if now - last.since >= TOLD_EVERY_S:
                self._tell(last, now)
            return
        self.tell()
        if len(self._last) >= CALLERS:
            self._last.clear()
        self._last[ask.holder] = _Said(ask, None, now)
        self._journal.note(rows.asked(ask))

    def answered(self, ask: Ask, answer: Accepted | Refused) -> None:
        """Note what it was told, where that is news."""
        last, now = self._last[ask.holder], asyncio.get_running_loop().time()
        if last.answer is not None:
            if _same(last.answer, answer):
                return
            # this one had another answer than those before it
            last.times -= 1
            self._tell(last, now)
            self._journal.note(rows.asked(ask))
        last.answer, last.since, last.times = answer, now, 0
        row = rows.answered(ask, answer)
        if row is not None:
            self._journal.note(row)

    def tell(self) -> None:
        """Write down what was only counted: something comes of it, or something else is next."""
        now = asyncio.get_running_loop().time()
        for said in self._last.values():
            self._tell(said, now)

    def _tell(self, said: _Said, now: float) -> None:
        if said.times > 0:
            self._journal.note(rows.repeated(said.ask, said.times, now - said.since))
            said.times, said.since = 0, now


class LiftLog:
    """What one lift has in the journal. As its WriteLog: a press waits for its row, and for its session, to be on the disk."""

    def __init__(self, lift: str, journal: Journal, memory: Memory) -> None:
        self._lift = lift
        self._journal = journal
        self._memory = memory
        self._requests = RequestLog(journal)
        self._mode: Mode | None = None
        self._link: str | None = None
        """Why the lift is not read; empty while it is."""

    def asked(self, ask: Ask) -> None:
        """Note a request that is about to be decided on."""
        self._requests.asked(ask)

    def answered(self, ask: Ask, answer: Accepted | Refused) -> None:
        """Note what it was told."""
        self._requests.answered(ask, answer)

    def before(self, command: Command, frames: tuple[str, ...]) -> Future[str | None]:
        """Note what is about to be pressed; answer when row and session are written, or why nothing may be pressed."""
        self._requests.tell()  # what was asked comes before what is pressed because of it
        if trouble := self._memory.trouble:
            return _answered(trouble)
        row = self._journal.before(rows.pressing(self._lift, self._holder, command, frames))
        session = self._memory.written(self._lift)
        return row if session is None else _both(row, session)

    def wrote(self, written: Written) -> None:
        """Note what reached the wire, or may have."""
        self._journal.note(rows.written(self._lift, self._holder, written))

    def mode(self, mode: Mode) -> None:
        """Note the mode if it has changed."""
        if mode is not self._mode:
            self._journal.note(rows.mode_is(self._lift, mode, self._mode))
            self._mode = mode

    def link(self, source: str, trouble: str) -> None:
        """Note that the lift is read, or why not, when that has changed."""
        if self._link is None or bool(trouble) is not bool(self._link):
            self._journal.note(rows.link_down(self._lift, trouble) if trouble else rows.link_up(self._lift, source))
        self._link = trouble

    @property
    def trouble(self) -> str:
        """Why nothing may be pressed: what is done cannot be written down. Empty while it can."""
        return self._journal.trouble or self._memory.trouble

    @property
    def _holder(self) -> Holder | None:
        session = self._memory.recall(self._lift).session
        return None if session is None else session.holder


def _same(before: Accepted | Refused, answer: Accepted | Refused) -> bool:
    """Whether an answer is the one before; the words of a refusal may count seconds."""
    if isinstance(before, Refused) and isinstance(answer, Refused):
        return before.code is answer.code
    return before == answer


def _answered(text: str | None) -> Future[str | None]:
    done: Future[str | None] = asyncio.get_running_loop().create_future()
    done.set_result(text)
    return done


def _both(row: Future[str | None], session: Future[None]) -> Future[str | None]:
    """Wait for a row and a session; a row that is refused needs no waiting."""
    if row.done() and not row.cancelled() and row.result() is not None:
        return row
    both: Future[str | None] = asyncio.get_running_loop().create_future()

    def look(_: object) -> None:
        if both.done() or not row.done():
            return
        refusal = row.result()
        if refusal is not None or session.done():
            both.set_result(refusal)

    row.add_done_callback(look)
    session.add_done_callback(look)
    return both
