"""The rows and log lines of one lift: requests, events, presses, writes, its mode and its link; and a site's start and end."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.model import Command, Outcome, Proof, Result, Written
from drivers.rate_limits import SUMMARY_EVERY_S, ChangeRateLimiter, RowRateLimiter
from lift_manager.lift import audit
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.config import Checkout
from lift_manager.lift.events import (
    Acknowledged,
    Advised,
    Alarm,
    CommandEnded,
    CommandFollowed,
    Event,
    ForceReleased,
    HandedOver,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.inhibits import clock_text
from lift_manager.lift.inputs import GiveCommand, Request
from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.lift.observation import Moment
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.refusals import Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Restrictions
from lift_manager.plain.text import counted, without_seconds
from lift_manager.runtime.recorder import Recorder
from register_maps.words import Mode

_log = logging.getLogger(__name__)

CHANGES = 10
"""How many changes of a lift's mode, and of its link, get rows of their own, a minute. Chosen: people turn a key switch less often."""

READ_WITHIN_S = 3.0
"""How long after the start the first reading of a lift may take before its absence is news. Chosen: a connection, and the change
that its map wants to see first, take less."""


class LiftJournal:
    """Writes down what happens to one lift, and logs what people need. Never waits, and never fails."""

    def __init__(self, lift: str, source: str, recorder: Recorder) -> None:
        """`source` is where the lift is, for messages."""
        self._lift = lift
        self._source = source
        self._recorder = recorder
        self._requests = audit.RequestRows(lift)
        self._mode: Mode | None = None
        self._modes = _Changes(lambda counted, for_s: audit.modes_row(lift, self._mode, counted, for_s))
        self._link = _Link(lift, source)
        self._rejected = ""
        """Why the last command was not pressed; empty if it was."""

    def request(self, request: Request, refused: Refused | None, now: float, *, known: bool) -> None:
        """Record a request and its reply; `known` says whether the lift has a floor."""
        self._requests, rows = self._requests.take(audit.words_of(request), refused, now, known=known)
        self._note(rows)

    def admits(self, request: GiveCommand, now: float, *, known: bool) -> bool:
        """Whether a request has a row of its own, and so has its outcome."""
        _, rows = self._requests.take(audit.words_of(request), None, now, known=known)
        return any("times" not in row.data for row in rows)

    def event(self, event: Event, event_id: str) -> None:
        """Record and log an event."""
        if (row := audit.row_of(event)) is not None:
            self._recorder.note(replace(row, event=event_id))
        level, text = self._line(event)
        _log.log(level, "%s: %s", self._lift, text, extra={"event": event_id, "lift": self._lift})

    def found(self, durable: DurableRecord, shown: Restrictions, moment: Moment) -> None:
        """Log what people have still to see to from before this start."""
        fire, occupied, owed = durable.fire_since, durable.occupied, durable.robot_left_pending_since
        texts = (
            f"a fire at {clock_text(fire, moment)} that nobody has acknowledged" if fire is not None else "",
            f"locked out {shown.lockout}" if shown.lockout else "",
            f"drain {shown.drain}" if shown.drain else "",
            f"a robot of {occupied.holder} that may be in the car" if occupied is not None else "",
            "robot_left, which the lift has not taken" if owed is not None else "",
            shown.distrusted,
        )
        if left := "; ".join(text for text in texts if text):
            _log.warning("%s: from before this start: %s", self._lift, left, extra={"lift": self._lift})

    def call(self, before: Call | None, after: Call | None) -> None:
        """Log that the car has come for a call, or that the lift shows that it will not; a failed press has its own line."""
        if before is None or after is None or (before.floor, before.outcome) != (after.floor, after.outcome):
            return
        if after.phase is not before.phase and after.phase in (CallPhase.ARRIVED, CallPhase.FAILED):
            why = f": {after.reason}" if after.reason else ""
            _log.info("%s: call to %s: %s%s", self._lift, after.floor, after.phase, why)

    def press(
        self, holder: Holder | None, command: Command, frames: tuple[str, ...], now: float, *, again: bool = False
    ) -> Row:
        """Return the row of a press; its holder's requests that were only counted are written before it."""
        if holder is not None:
            self._requests, rows = self._requests.report(holder, now)
            self._note(rows)
        return audit.press_row(self._lift, holder, command, frames, again=again)

    def wrote(self, holder: Holder | None, written: Written) -> None:
        """Record what reached the wire, or may have."""
        self._recorder.note(audit.write_row(self._lift, holder, written))

    def mode(self, mode: Mode, now: float) -> None:
        """Record the mode if it has changed."""
        if mode is not self._mode:
            before, self._mode = self._mode, mode
            self._note(self._modes.rows(audit.mode_row(self._lift, mode, before), mode, now))

    def link(self, fault: str, now: float, *, answers: bool = False) -> None:
        """Record and log that the lift is read, or why not, when that has changed.

        With `answers` the controller is there and its values cannot be used: another reason of that kind is logged too.
        """
        self._note(self._link.observed(fault, now, answers=answers))

    def report(self, now: float, *, end: bool = False) -> None:
        """Write the rows of what was counted for long enough, or of everything at the end."""
        self._requests, rows = self._requests.report_due(now, end=end)
        self._note((*rows, *self._modes.due(now, end=end), *self._link.due(now, end=end)))
        self._link.remind(now)

    def _note(self, rows: tuple[Row, ...]) -> None:
        for row in rows:
            self._recorder.note(row)
            if row.kind is RowKind.LINK:
                self._link.log(row)

    def _line(self, event: Event) -> tuple[int, str]:  # noqa: C901, PLR0911  one for each kind of event
        match event:
            case Alarm(_, text, _):
                return logging.WARNING, text
            case Advised(_, holder, advice, text):
                return logging.WARNING, f"{text}; {holder} is advised: {advice}"
            case CommandEnded(_, outcome, _):
                return self._outcome_line(outcome)
            case SessionOpened(_, holder, floor):
                return logging.INFO, f"{holder} holds the lift" + (f", to {floor}" if floor else "")
            case SessionRestored(_, holder, _, text):
                return logging.INFO, f"{holder} holds the lift from before a restart, {text}"
            case HandedOver(_, holder, to):
                return logging.INFO, f"{holder} hands the lift over to {to}"
            case RestrictionBegun() | RestrictionEnded() | Acknowledged():
                return logging.WARNING, _decision(event)
            case ForceReleased():
                return logging.WARNING, f"{event.text} (released by {event.by}: {event.reason})"
            case SessionEnded(_, holder, _, text, _):
                return logging.INFO, f"session of {holder} over: {text}"
            case CommandFollowed(_, status, _):
                what = f"{status.kind} {status.floor}" if status.floor else status.kind
                why = f": {status.reason}" if status.reason else ""
                return logging.DEBUG, f"{status.holder}: {what} is {status.state}{why}"

    def _outcome_line(self, outcome: Outcome) -> tuple[int, str]:
        proof = "" if outcome.proof is Proof.NONE else f", seen by {outcome.proof}"
        rejected = outcome.reason if outcome.result is Result.REJECTED else ""
        # a robot repeats its request, and the reason may be the disk that the log is on
        level = logging.DEBUG if rejected and rejected == self._rejected else logging.INFO
        self._rejected = rejected
        why = f": {outcome.reason}" if outcome.reason else ""
        return level, f"{outcome.command} {outcome.result}{proof}{why}"


def _decision(event: RestrictionBegun | RestrictionEnded | Acknowledged) -> str:
    match event:
        case RestrictionBegun(_, one):
            did = "locked out" if one.kind is RestrictionKind.LOCKOUT else "no new session begins: drain"
            return f"{did} by {one.by}: {one.reason}"
        case RestrictionEnded(_, by, at, one):
            since = f"{one.since.astimezone(at.tzinfo):%Y-%m-%d %H:%M}"
            return f"the {one.kind} by {one.by} since {since}: {one.reason} is ended by {by}"
        case Acknowledged(_, by, _, causes):
            return f"{' and '.join(causes)} acknowledged by {by}"


class _Changes:
    """The changes of one thing: a few a minute have rows of their own, and the others are counted."""

    def __init__(self, summary: Callable[[Counter[str], float], Row]) -> None:
        """`summary` makes the row of changes that were counted."""
        self._changes = ChangeRateLimiter(CHANGES)
        self._summary = summary

    def rows(self, row: Row, word: str, now: float) -> tuple[Row, ...]:
        """Return the rows of one change; it is counted by its `word` where there were many."""
        due = self.due(now)
        return (*due, row) if self._changes.admits(word, now) else due

    def due(self, now: float, *, end: bool = False) -> tuple[Row, ...]:
        """Return the row of what was counted for long enough, or of everything at the end."""
        counted = self._changes.summary(now, end=end)
        return () if counted is None else (self._summary(*counted),)


class _Link:
    """Whether a lift is read. After a start the first reading may take a little."""

    def __init__(self, lift: str, source: str) -> None:
        self._lift = lift
        self._source = source
        self._fault: str | None = None
        """Why the lift is not read; empty while it is, None before that is known."""
        self._unread_since: float | None = None
        self._logged = ""
        """Why the lift is not read, as the log has it; empty while it is."""
        self._logged_again_at = math.inf
        self._now = 0.0
        self._changes = _Changes(lambda counted, for_s: audit.links_row(lift, self._fault or "", counted, for_s))
        self._reasons = RowRateLimiter(CHANGES)

    def observed(self, fault: str, now: float, *, answers: bool) -> tuple[Row, ...]:
        """Return the rows of a poll that was answered, or failed."""
        self._now = now
        if self._fault is None and fault:
            self._unread_since = now if self._unread_since is None else self._unread_since
            if now - self._unread_since < READ_WITHIN_S:
                return ()
        before, self._fault = self._fault, fault
        if before is None or bool(fault) is not bool(before):
            row = audit.link_row(self._lift, self._source, fault)
            return self._changes.rows(row, "not read" if fault else "read", now)
        if answers and self._logged and without_seconds(fault) != without_seconds(self._logged):
            self._reasons, is_admitted = self._reasons.admit(object(), now)
            if is_admitted:
                self._line(fault, is_read=False)
        return ()

    def due(self, now: float, *, end: bool = False) -> tuple[Row, ...]:
        """Return the row of changes that were counted."""
        self._now = now
        return self._changes.due(now, end=end)

    def remind(self, now: float) -> None:
        """Log once more what lasts."""
        if self._fault and self._logged and now >= self._logged_again_at:
            self._logged_again_at = math.inf
            _log.warning("%s: still not read: %s", self._lift, self._fault, extra={"lift": self._lift})

    def log(self, row: Row) -> None:
        """Log a row."""
        self._line(row.text, is_read=row.data["up"] is True)

    def _line(self, text: str, *, is_read: bool) -> None:
        self._logged = "" if is_read else self._fault or text
        self._logged_again_at = math.inf if is_read else self._now + SUMMARY_EVERY_S
        level = logging.INFO if is_read else logging.WARNING
        _log.log(level, "%s: %s", self._lift, text, extra={"lift": self._lift})


def manager_started(
    version: str, maps: Mapping[str, tuple[str, str, str]], checkouts: Mapping[str, Checkout] | None = None
) -> Row:
    """Return the first row of a process; `maps` are access, map and the hash of the map as loaded, by lift."""
    lifts: dict[str, dict[str, Json]] = {
        lift: {"access": access, "map": name, "sha256": sha256} for lift, (access, name, sha256) in maps.items()
    }
    for lift, checkout in (checkouts or {}).items():
        lifts[lift]["checkout"] = {"sha256": checkout.sha256, "ended_at": checkout.ended_at.isoformat()}
    text = f"lift manager {version} started, {counted(len(maps), 'lift')}"
    return Row(RowKind.MANAGER, text, data={"version": version, "lifts": lifts})


def manager_took_over(machine: str, epoch: int, alone: str = "") -> Row:
    """Return the row of the manager of a cluster that has become active; `alone` says in words that it goes on without the other one."""
    text = f"the manager on {machine} is active, in epoch {epoch}{f': {alone}' * bool(alone)}"
    return Row(RowKind.MANAGER, text, data={"machine": machine, "epoch": epoch})


def manager_handed_over(machine: str, by: str) -> Row:
    """Return the last row of a manager that hands its lifts to the other machine; the other one finds on what it left on."""
    text = f"the manager on {machine} hands over, as {by} has requested; what is on stays on"
    return Row(RowKind.MANAGER, text, caller=by, data={"machine": machine})


def manager_ended(*, released: bool, commands: bool) -> Row:
    """Return the last row of an orderly end; `commands` tells whether it may command any lift."""
    rest = "everything held is released and verified" if released else "not every output could be verified as released"
    rest = rest if commands else "it held nothing, because it only watches"
    return Row(RowKind.MANAGER, f"the manager ends: {rest}", data={"released": released})
