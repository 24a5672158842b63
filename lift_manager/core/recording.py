"""Writes down what happens: every event before it is published, every request before it is decided on, every press before it leaves."""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import Future
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import replace

from drivers.model import Command, Written
from drivers.sparing import TOLD_EVERY_S, Changes, Sparing, newest
from lift_manager.core.journal import Journal
from lift_manager.core.memory import Memory
from lift_manager.domain import journal_rows as rows
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import Event
from lift_manager.domain.journal import Row
from lift_manager.domain.seconds import without_seconds
from lift_manager.domain.state import Holder
from lift_manager.domain.wish import Wish
from lift_manager.runtime.bus import Bus
from register_maps.words import Mode

_log = logging.getLogger(__name__)

REQUESTS = 30
"""Requests of one caller for one lift that have rows of their own, a minute. Chosen: more than a ride and its second thoughts need."""

CHANGES = 10
"""Changes of a lift's mode, and of its link, that have rows of their own, a minute. Chosen: people turn a key switch less often."""

READ_WITHIN_S = 3.0
"""So long after the start a lift may take to be read for the first time before that is news. Chosen: a connection, and what its map wants
to see change once, take less."""


class RecordingBus(Bus[Event]):
    """A bus of which every event is in the journal, heard or not."""

    def __init__(self, journal: Journal, boot: str = "") -> None:
        """`boot` is what the ids begin with; made of the clock where it is empty."""
        super().__init__(boot)
        self._journal = journal

    def publish(self, item: Event) -> str:
        """Note an event, and give it to all listeners; returns its id."""
        event, row = self._next_id(), rows.row_of(item)
        if row is not None:
            self._journal.note(replace(row, event=event))
        self._hand_out(event, item)
        return event


class _Caller:
    """What one caller asked of one lift last, and what of it was only counted."""

    def __init__(self) -> None:
        self.sparing = Sparing(REQUESTS)
        self.ask: Ask | Wish | None = None
        """The newest with a row of its own."""
        self.answer: Accepted | Refused | None = None
        self.admitted = False
        """Whether the request that is decided on has a row already."""


class RequestLog:
    """The requests for one lift. Repeats with the same answer, and more than `REQUESTS` of a caller in a minute, are counted."""

    def __init__(self, lift: str, journal: Journal) -> None:
        self._lift = lift
        self._journal = journal
        self._callers: OrderedDict[Holder, _Caller] = OrderedDict()

    def asked(self, ask: Ask | Wish, *, known: bool) -> bool:
        """Note a request that is about to be decided on; `known` tells a floor that the lift has. Returns whether it has a row."""
        now, caller = _now(), self._caller(ask.holder)
        caller.admitted = caller.sparing.admits(_kind_of(ask, known=known), now)
        if caller.admitted:
            self._begin(caller, ask, now)
        return caller.admitted

    def answered(self, ask: Ask | Wish, answer: Accepted | Refused, *, known: bool) -> None:
        """Note what it was told, where that is news."""
        now, caller = _now(), self._caller(ask.holder)
        repeat = caller.sparing.is_last(_kind_of(ask, known=known))
        if not caller.admitted and repeat and caller.answer is not None and not _same(caller.answer, answer):
            # this one had another answer than those before it
            caller.admitted = caller.sparing.admits(_kind_of(ask, known=known), now, anew=True)
            if caller.admitted:
                self._begin(caller, ask, now)
        if not caller.admitted:
            caller.sparing.count("accepted" if isinstance(answer, Accepted) else answer.code, now)
            if caller.sparing.due(now):
                self._tell(ask.holder, caller, now)
            return
        caller.answer, row = answer, rows.answered(ask, answer)
        if row is not None:
            self._journal.note(row)

    def tell(self, holder: Holder | None) -> None:
        """Write down what was only counted of a caller: something is pressed because of it."""
        caller = None if holder is None else self._callers.get(holder)
        if holder is not None and caller is not None:
            self._tell(holder, caller, _now())

    def tell_due(self, *, end: bool) -> None:
        """Write down what was counted for long enough, or at the end all of it."""
        now = _now()
        for holder, caller in self._callers.items():
            if end or caller.sparing.due(now):
                self._tell(holder, caller, now)

    def _caller(self, holder: Holder) -> _Caller:
        caller, gone = newest(self._callers, holder, _Caller)
        if gone is not None:
            self._tell(*gone, _now())
        return caller

    def _begin(self, caller: _Caller, ask: Ask | Wish, now: float) -> None:
        self._tell(ask.holder, caller, now)
        caller.ask, caller.answer = ask, None
        self._journal.note(rows.asked(ask))

    def _tell(self, holder: Holder, caller: _Caller, now: float) -> None:
        if not caller.sparing.counts:
            return
        repeats = caller.sparing.repeats_only
        counted, for_s = caller.sparing.told(now)
        if repeats and caller.ask is not None:
            self._journal.note(rows.repeated(caller.ask, counted.total(), for_s))
        else:
            self._journal.note(rows.asked_more(self._lift, str(holder), counted, for_s))


class _Changes:
    """The changes of one thing."""

    def __init__(self, write: Callable[[Counter[str], float], Row], note: Callable[[Row], None]) -> None:
        """`write` makes the row of changes that were counted; `note` writes a row down."""
        self._changes = Changes(CHANGES)
        self._write = write
        self._note = note

    def note(self, row: Row, word: str) -> None:
        """Write down one change, or count it by its `word`."""
        now = _now()
        self.tell(now)
        if self._changes.admits(word, now):
            self._note(row)

    def tell(self, now: float, *, end: bool = False) -> None:
        """Write down what was counted for long enough, or at the end all of it."""
        if (counted := self._changes.summary(now, end=end)) is not None:
            self._note(self._write(*counted))


class LiftLog:
    """What one lift has in the journal. As its WriteLog: a press waits for its row to be on the disk, and its session with it."""

    def __init__(self, lift: str, journal: Journal, memory: Memory) -> None:
        self._lift = lift
        self._journal = journal
        self._memory = memory
        self._requests = RequestLog(lift, journal)
        self._mode: Mode | None = None
        self._link: str | None = None
        """Why the lift is not read; empty while it is."""
        self._unread_since: float | None = None
        """Before it was read for the first time."""
        self._logged = ""
        """Why the lift is not read, as the log has it; empty while it is."""
        self._logged_again_at = math.inf
        """When the log has it once more."""
        self._modes = _Changes(lambda counted, for_s: rows.mode_changed(lift, self._mode, counted, for_s), journal.note)
        self._links = _Changes(
            lambda counted, for_s: rows.link_changed(lift, self._link or "", counted, for_s), self._note_link
        )
        self._reasons = Sparing(CHANGES)

    def asked(self, ask: Ask | Wish, *, known: bool = True) -> bool:
        """Note a request that is about to be decided on; `known` tells a floor that the lift has. Returns whether it has a row."""
        return self._requests.asked(ask, known=known)

    def answered(self, ask: Ask | Wish, answer: Accepted | Refused, *, known: bool = True) -> None:
        """Note what it was told."""
        self._requests.answered(ask, answer, known=known)

    def tell(self, *, end: bool = False) -> None:
        """Write down what was counted for a minute and told by nothing since, or at the end all of it."""
        self._requests.tell_due(end=end)
        now = _now()
        for changes in (self._modes, self._links):
            changes.tell(now, end=end)
        if self._link and self._logged and now >= self._logged_again_at:
            self._logged_again_at = math.inf
            _log.warning("%s: still not read: %s", self._lift, self._link, extra={"lift": self._lift})

    def before(self, command: Command, frames: tuple[str, ...], *, again: bool = False) -> Future[str | None]:
        """Note what is about to be pressed; answer when row and session are written, or why nothing may be pressed."""
        self._requests.tell(self._holder)  # what was asked comes before what is pressed because of it
        if trouble := self._memory.trouble:
            return _answered(trouble)
        return self._journal.before(rows.pressing(self._lift, self._holder, command, frames, again=again))

    def wrote(self, written: Written) -> None:
        """Note what reached the wire, or may have."""
        self._journal.note(rows.written(self._lift, self._holder, written))

    def mode(self, mode: Mode) -> None:
        """Note the mode if it has changed."""
        if mode is not self._mode:
            before, self._mode = self._mode, mode
            self._modes.note(rows.mode_is(self._lift, mode, before), mode)

    def link(self, source: str, trouble: str, *, answers: bool = False) -> None:
        """Note and log that the lift is read, or why not, when that has changed. A start may take a little to read it at all.

        With `answers` the controller is there and what it says cannot be used: another such reason is logged, too.
        """
        now = _now()
        if self._link is None and trouble:
            self._unread_since = now if self._unread_since is None else self._unread_since
            if now - self._unread_since < READ_WITHIN_S:
                return
        before, self._link = self._link, trouble
        if before is None or bool(trouble) is not bool(before):
            row = rows.link_down(self._lift, trouble) if trouble else rows.link_up(self._lift, source)
            self._links.note(row, "not read" if trouble else "read")
        elif answers and self._is_another(trouble) and self._reasons.admits(object(), now):
            self._log_link(trouble, up=False)

    def _is_another(self, trouble: str) -> bool:
        """Whether the log has another reason why the lift is not read."""
        return bool(self._logged) and without_seconds(trouble) != without_seconds(self._logged)

    def _note_link(self, row: Row) -> None:
        self._journal.note(row)
        self._log_link(row.text, up=row.data["up"] is True)

    def _log_link(self, text: str, *, up: bool) -> None:
        self._logged = "" if up else self._link or text
        self._logged_again_at = math.inf if up else _now() + TOLD_EVERY_S
        _log.log(logging.INFO if up else logging.WARNING, "%s: %s", self._lift, text, extra={"lift": self._lift})

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


def _kind_of(ask: Ask | Wish, *, known: bool) -> Ask | Wish:
    """Return what repeats of a request have in common: floors that the lift does not have are all one."""
    return ask if known else replace(ask, floor="")


def _now() -> float:
    return asyncio.get_running_loop().time()


def _answered(text: str | None) -> Future[str | None]:
    done: Future[str | None] = asyncio.get_running_loop().create_future()
    done.set_result(text)
    return done
