"""The journal's words for what happens to a lift, and which repetitions get rows of their own.

Row suppression is a reducer beside `step`: it sees each request with its reply, and remembers what it only counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

from drivers.model import Command, FloorName, Outcome, Proof, Written
from drivers.rate_limits import CALLERS, RowRateLimiter
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType
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
from lift_manager.lift.inputs import (
    CloseSession,
    EndSession,
    GiveCommand,
    HandOver,
    LiftRequest,
    OpenSession,
    RenewSession,
    Request,
)
from lift_manager.lift.journal import Json, Row, RowKind, short
from lift_manager.lift.refusals import Refused
from lift_manager.lift.session import Holder
from register_maps.words import Mode

REQUEST_ROWS = 30
"""How many requests of one caller for one lift get rows of their own, a minute. Chosen: more than a ride and its corrections need."""

# -- events


def row_of(event: Event) -> Row | None:
    """Return the row of an event; None for a command that has not ended, or has no row of its own."""
    match event:
        case CommandEnded(lift, outcome, holder):
            return _outcome(lift, outcome, holder)
        case Alarm(lift, text, holder):
            return Row(RowKind.ALARM, text, lift, "" if holder is None else str(holder))
        case CommandFollowed(_, status, is_recorded):
            return _command(status) if is_recorded else None
        case RestrictionBegun() | RestrictionEnded() | Acknowledged() | ForceReleased():
            return _person(event)
        case _:
            return _session(event)


def _session(event: SessionOpened | SessionRestored | SessionEnded | HandedOver | Advised) -> Row:
    holder, data, text = str(event.holder), dict[str, Json](), ""
    match event:
        case SessionOpened(_, _, floor):
            data, text = {"to": floor or ""}, f"{holder} holds the lift" + (f", to {floor}" if floor else "")
        case SessionRestored(_, _, floor, why):
            to_floor = f", to {floor}" if floor else ""
            data, text = {"to": floor or ""}, f"{holder} holds the lift as before the restart{to_floor}: {why}"
        case SessionEnded(_, _, reason, why, advice):
            data, text = {"reason": reason, "advice": advice}, f"the session of {holder} is over: {why}"
        case HandedOver(_, _, to):
            data, text = {"handed_to": str(to)}, f"{holder} hands the lift over to {to}"
        case Advised(_, _, advice, why):
            data, text = {"advice": advice}, f"{holder} is advised {advice}: {why}"
    return Row(RowKind.SESSION, text, event.lift, holder, data)


def _person(event: RestrictionBegun | RestrictionEnded | Acknowledged | ForceReleased) -> Row:
    match event:
        case ForceReleased():
            text = f"{event.by} took the lift from {event.holder}: {event.reason}"
            taken: dict[str, Json] = {"said": "release", "from": str(event.holder), "reason": event.reason}
            return Row(RowKind.PERSON, text, event.lift, event.by, taken)
        case RestrictionBegun(lift, one):
            did = "locked out" if one.kind is RestrictionKind.LOCKOUT else "drain begun"
            text = f"{did} by {one.by}: {one.reason}"
            return Row(RowKind.PERSON, text, lift, one.by, {"said": one.kind, "reason": one.reason})
        case RestrictionEnded(lift, by, _, one):
            text = f"the {one.kind} by {one.by} is ended by {by}"
            data: dict[str, Json] = {"said": f"{one.kind}_end", "since": _shown(one.since)}
            return Row(RowKind.PERSON, text, lift, by, data)
        case Acknowledged(lift, by, _, causes):
            text = f"{' and '.join(causes)} acknowledged by {by}"
            return Row(RowKind.PERSON, text, lift, by, {"said": "acknowledge", "what": [*causes]})


def _outcome(lift: str, outcome: Outcome, holder: Holder | None) -> Row:
    text = f"{outcome.command} {outcome.result}" + (f": {outcome.reason}" if outcome.reason else "")
    data: dict[str, Json] = {
        "command": outcome.command.name,
        "floor": outcome.command.floor,
        "result": outcome.result,
        "proof": outcome.proof,
        "frames": list(outcome.frames),
    }
    return Row(RowKind.OUTCOME, text, lift, "" if holder is None else str(holder), data)


def _command(status: CommandStatus) -> Row | None:
    if status.state is CommandState.PENDING:
        return None
    what = f"{status.kind} {status.floor}" if status.floor else status.kind
    seen = "" if status.proof is Proof.NONE else f", seen by {status.proof}"
    text = f"{what} {status.state}{seen}" + (f": {status.reason}" if status.reason else "")
    data: dict[str, Json] = {
        "do": status.kind,
        "floor": status.floor,
        "status": status.state,
        "proof": status.proof,
    }
    return Row(RowKind.REQUEST, text, status.lift, str(status.holder), data)


# -- modes


def mode_row(lift: str, mode: Mode, before: Mode | None) -> Row:
    """Return the row of a mode that is seen for the first time or has changed."""
    text = f"the mode is {mode}" if before is None else f"the mode was {before} and is {mode}"
    return Row(RowKind.MODE, text, lift, "", {"mode": mode, "before": before})


def modes_row(lift: str, mode: Mode | None, modes: Mapping[str, int], for_s: float) -> Row:
    """Return the row that sums up changes without rows of their own; `modes` says how often each mode was seen."""
    times = sum(modes.values())
    among = f"to {mode}" if len(modes) < 2 else f"between {' and '.join(sorted(modes))}, and is {mode}"
    text = f"the mode changed {times} times within {for_s:.0f} s {among}"
    return Row(RowKind.MODE, text, lift, "", {"mode": mode, "times": times})


# -- the controller


def link_row(lift: str, source: str, fault: str) -> Row:
    """Return the row of a lift that is read, or is not; `fault` says why."""
    return Row(RowKind.LINK, fault or f"reading {source}", lift, "", {"up": not fault})


def links_row(lift: str, fault: str, changes: Mapping[str, int], for_s: float) -> Row:
    """Return the row that sums up changes without rows of their own; `fault` is why the lift is not read in the end."""
    times = sum(changes.values())
    text = f"the lift was lost or read again {times} times within {for_s:.0f} s, and is {fault and 'not '}read"
    data: dict[str, Json] = {"up": not fault, "times": times}
    return Row(RowKind.LINK, text + (f": {fault}" if fault else ""), lift, "", data)


def press_row(
    lift: str, holder: Holder | None, command: Command, frames: tuple[str, ...], *, again: bool = False
) -> Row:
    """Return the row that a press or the beginning of a hold waits for: what is wanted, and not what came of it.

    `again` marks a hold that was found off.
    """
    data: dict[str, Json] = {"command": command.name, "floor": command.floor, "frames": list(frames)}
    why = " again: it was found off" if again else ""
    return Row(RowKind.PRESS, f"{command} is to be pressed{why}", lift, "" if holder is None else str(holder), data)


def write_row(lift: str, holder: Holder | None, write: Written) -> Row:
    """Return the row of a write."""
    what = f"{write.what} of {write.name}" if write.name else write.what
    text = f"{what} failed: {write.failure}" if write.failure else f"{what} was answered"
    data: dict[str, Json] = {
        "command": write.name,
        "what": write.what,
        "frames": list(write.frames),
        "failure": write.failure,
    }
    return Row(RowKind.WRITE, text, lift, "" if holder is None else str(holder), data)


# -- requests


@dataclass(frozen=True, slots=True)
class RequestWords:
    """A request as the journal has it, without the id of the session and without keys; repeats are equal."""

    holder: Holder
    what: str
    floor: FloorName | None = None
    more: str = ""
    """What else it contains, in words."""
    data: Mapping[str, Json] = field(default_factory=dict)
    """The same as values."""

    @property
    def text(self) -> str:
        """The request in words."""
        return " ".join(part for part in (self.what, short(self.floor or ""), self.more) if part)


def words_of(request: Request) -> RequestWords:
    """Return a request as the journal has it."""
    match request:
        case LiftRequest():
            hold = ", hold the door there" if request.hold_door else ", no hold"
            word = "" if request.robot is None else f", robot {request.robot}"
            data: dict[str, Json] = {"hold_door": request.hold_door, "robot": request.robot}
            return RequestWords(request.holder, "", request.floor, f"{hold}{word}", data)
        case OpenSession():
            return RequestWords(request.holder, "open", more="a session")
        case RenewSession():
            return RequestWords(request.holder, "renew", more="its session")
        case CloseSession():
            word = "" if request.robot is None else f", robot {request.robot}"
            return RequestWords(request.holder, "close", more=f"its session{word}")
        case EndSession():
            grace = f" in {request.grace_s:g} s" if request.grace_s > 0 else ""
            return RequestWords(request.holder, "end", more=f"its session{grace}")
        case HandOver():
            return RequestWords(request.holder, "hand over", more=f"its session to {request.to}")
        case GiveCommand():
            command = request.request
            more = "" if command.side is None else str(command.side)
            if command.kind is CommandType.GO_TO:
                more = "and hold the door there" if command.hold_door else "and hold no door"
            return RequestWords(command.holder, command.kind, command.floor, more)


def request_row(lift: str, words: RequestWords) -> Row:
    """Return the row of a request."""
    floor = short(words.floor or "")
    if not words.what:
        return Row(
            RowKind.REQUEST, f"requests {floor}{words.more}", lift, str(words.holder), {"floor": floor, **words.data}
        )
    return Row(RowKind.REQUEST, f"requests: {words.text}", lift, str(words.holder), {"do": words.what, "floor": floor})


def refusal_row(lift: str, words: RequestWords, refused: Refused) -> Row:
    """Return the row of a refusal; an accepted request shows by what follows."""
    floor = words.floor or ""
    text = refused.message.replace(repr(floor), repr(short(floor)))
    return Row(RowKind.REQUEST, f"refused: {text}", lift, str(words.holder), {"refused": refused.code})


# -- how much of it is written


@dataclass(frozen=True, slots=True)
class CallerRows:
    """The last request of one caller for one lift, and which of its requests were only counted."""

    limiter: RowRateLimiter = field(default_factory=lambda: RowRateLimiter(REQUEST_ROWS))
    words: RequestWords | None = None
    """The newest with a row of its own."""
    answer: str = ""
    """The reply to it: `accepted`, or the code of the refusal."""


@dataclass(frozen=True, slots=True)
class RequestRows:
    """The requests for one lift, as far as the journal has them. The callers that were silent for longest are forgotten first."""

    lift: str
    callers: Mapping[Holder, CallerRows] = field(default_factory=dict)

    def take(
        self, words: RequestWords, refused: Refused | None, now: float, *, known: bool
    ) -> tuple[RequestRows, tuple[Row, ...]]:
        """Return the rows of a request and its reply; `known` says whether the lift has a floor: all others count as one."""
        kind, answer = words if known else replace(words, floor=""), "accepted" if refused is None else refused.code
        rows, caller, made = self._having_room(words.holder, now)
        limiter, is_admitted = caller.limiter.admit(kind, now)
        if not is_admitted and kind == limiter.last and caller.answer and caller.answer != answer:
            limiter, is_admitted = limiter.admit(kind, now, differs=True)
        if not is_admitted:
            limiter = limiter.count(answer, now)
            if limiter.is_due(now):
                made += _counted(self.lift, words.holder, replace(caller, limiter=limiter), now)
                limiter = limiter.cleared()
            return rows.having(words.holder, replace(caller, limiter=limiter)), made
        made += (*_counted(self.lift, words.holder, caller, now), request_row(self.lift, words))
        if refused is not None:
            made += (refusal_row(self.lift, words, refused),)
        return rows.having(words.holder, CallerRows(limiter.cleared(), words, answer)), made

    def report(self, holder: Holder, now: float) -> tuple[RequestRows, tuple[Row, ...]]:
        """Return the row of what was only counted of a caller: a press follows from it."""
        caller = self.callers.get(holder)
        if caller is None or not caller.limiter.counts:
            return self, ()
        made = _counted(self.lift, holder, caller, now)
        return self.having(holder, replace(caller, limiter=caller.limiter.cleared())), made

    def report_due(self, now: float, *, end: bool = False) -> tuple[RequestRows, tuple[Row, ...]]:
        """Return the rows of what was counted for long enough, or of everything at the end."""
        rows: RequestRows = self
        made: tuple[Row, ...] = ()
        for holder, caller in self.callers.items():
            if end or caller.limiter.is_due(now):
                rows, reported = rows.report(holder, now)
                made += reported
        return rows, made

    def having(self, holder: Holder, caller: CallerRows) -> RequestRows:
        """Return this with one caller as it is now, the newest."""
        others = {other: one for other, one in self.callers.items() if other != holder}
        return RequestRows(self.lift, {**others, holder: caller})

    def _having_room(self, holder: Holder, now: float) -> tuple[RequestRows, CallerRows, tuple[Row, ...]]:
        """Return a caller, and the row of the one that is forgotten to make room."""
        caller = self.callers.get(holder, CallerRows())
        callers = {**self.callers, holder: caller}
        if len(callers) <= CALLERS:
            return RequestRows(self.lift, callers), caller, ()
        oldest = next(iter(callers))
        reported = _counted(self.lift, oldest, callers.pop(oldest), now)
        return RequestRows(self.lift, callers), caller, reported


def _counted(lift: str, holder: Holder, caller: CallerRows, now: float) -> tuple[Row, ...]:
    """Return the row of what was only counted of a caller, if there is anything."""
    limiter, words = caller.limiter, caller.words
    if not limiter.counts:
        return ()
    times, for_s = sum(limiter.counts.values()), now - limiter.counted_since
    if not limiter.repeats_only or words is None:
        answers = ", ".join(f"{count} {code}" for code, count in sorted(limiter.counts.items()))
        more = "once more" if times == 1 else f"{times} more times"
        text = f"requests {more} within {for_s:.0f} s: {answers}"
        data: dict[str, Json] = {"times": times, "answers": dict(limiter.counts)}
        return (Row(RowKind.REQUEST, text, lift, str(holder), data),)
    floor = short(words.floor or "")
    again = f"requests again: {words.text}," if words.what else f"requests {floor} again,"
    said: dict[str, Json] = {"do": words.what} if words.what else {"floor": floor}
    how_often = "once" if times == 1 else f"{times} times"
    text = f"{again} {how_often} within {for_s:.0f} s, with the same answer"
    return (Row(RowKind.REQUEST, text, lift, str(holder), {**said, "times": times}),)


def _shown(at: datetime) -> str:
    return at.isoformat(timespec="seconds")
