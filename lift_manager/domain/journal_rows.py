"""How what happens to a lift is worded in the journal. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

from drivers.model import Command, Outcome, Proof, Written
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import (
    Advised,
    Alarm,
    CommandEnded,
    DrainBegun,
    DrainOver,
    Event,
    HandedOver,
    LockedOut,
    LockoutOver,
    PersonAcknowledged,
    ReleasedByPerson,
    RequestFollowed,
    RideChanged,
    SessionEnded,
    SessionOpened,
    SessionRestored,
    StateChanged,
)
from lift_manager.domain.journal import Json, Row, RowKind, short
from lift_manager.domain.session_requests import Followed, Status
from lift_manager.domain.state import Holder
from lift_manager.domain.wish import Wish
from register_maps.words import Mode


def row_of(event: Event) -> Row | None:
    """Return the row of an event; None for a state, of which only mode and link have rows of their own."""
    match event:
        case StateChanged():
            return None
        case LockedOut() | LockoutOver() | DrainBegun() | DrainOver() | PersonAcknowledged() | ReleasedByPerson():
            return _person(event)
        case CommandEnded(lift, outcome, holder):
            return _outcome(lift, outcome, holder)
        case Alarm(lift, text, holder):
            return Row(RowKind.ALARM, text, lift, "" if holder is None else str(holder))
        case RequestFollowed(_, followed):
            return _followed(followed)
        case RideChanged():
            return _ride(event)
        case _:
            return _session(event)


def _session(event: SessionOpened | SessionRestored | SessionEnded | HandedOver | Advised) -> Row:
    holder, data, text = str(event.holder), dict[str, Json](), ""
    match event:
        case SessionOpened(_, _, floor):
            data, text = {"to": floor}, f"{holder} holds the lift" + (f", to {floor}" if floor else "")
        case SessionRestored(_, _, floor, why):
            to_floor = f", to {floor}" if floor else ""
            data, text = {"to": floor}, f"{holder} holds the lift as before the restart{to_floor}: {why}"
        case SessionEnded(_, _, reason, why, advice):
            data, text = {"reason": reason, "advice": advice}, f"the session of {holder} is over: {why}"
        case HandedOver(_, _, to):
            data, text = {"handed_to": str(to)}, f"{holder} hands the lift over to {to}"
        case Advised(_, _, advice, why):
            data, text = {"advice": advice}, f"{holder} is told {advice}: {why}"
    return Row(RowKind.SESSION, text, event.lift, holder, data)


def _ride(event: RideChanged) -> Row | None:
    """Return the row of a ride that begins, goes on to another phase, or ends; what its robot is told meanwhile has none."""
    ride = event.ride
    if ride.phase is event.before:
        return None
    robot = f" of {ride.robot}" if ride.robot else ""
    way = f"ride {ride.id}{robot} from {ride.start} to {ride.destination}"
    text = f"{way} is {ride.phase}" + (f": {ride.reason}" if ride.reason else "")
    data: dict[str, Json] = {"ride": ride.id, "phase": ride.phase, "reason": ride.reason}
    return Row(RowKind.SESSION, text, event.lift, str(ride.caller), data)


def asked(ask: Ask | Wish) -> Row:
    """Return the row of a request, written before it is decided on."""
    if isinstance(ask, Wish):
        floor = "" if ask.floor is None else short(ask.floor)
        text = replace(ask, floor=floor).text
        return Row(RowKind.REQUEST, f"asks: {text}", ask.lift, str(ask.holder), {"do": ask.what, "floor": floor})
    hold = "hold the door there" if ask.hold_door else "no hold"
    word, floor = "" if ask.robot is None else f", robot {ask.robot}", short(ask.floor)
    data: dict[str, Json] = {"floor": floor, "hold_door": ask.hold_door, "robot": ask.robot}
    return Row(RowKind.REQUEST, f"asks for {floor}, {hold}{word}", ask.lift, str(ask.holder), data)


def answered(ask: Ask | Wish, answer: Accepted | Refused) -> Row | None:
    """Return the row of a refusal; what was accepted shows by what follows."""
    if isinstance(answer, Accepted):
        return None
    floor = ask.floor or ""
    text = answer.message.replace(repr(floor), repr(short(floor)))
    return Row(RowKind.REQUEST, f"refused: {text}", ask.lift, str(ask.holder), {"refused": answer.code})


def repeated(ask: Ask | Wish, times: int, for_s: float) -> Row:
    """Return the row of requests like the one before, with the same answer."""
    if isinstance(ask, Wish):
        text = f"asks again: {ask.text}, {times} times within {for_s:.0f} s, with the same answer"
        return Row(RowKind.REQUEST, text, ask.lift, str(ask.holder), {"do": ask.what, "times": times})
    floor = short(ask.floor)
    text = f"asks for {floor} again, {times} times within {for_s:.0f} s, with the same answer"
    return Row(RowKind.REQUEST, text, ask.lift, str(ask.holder), {"floor": floor, "times": times})


def asked_more(lift: str, caller: str, answers: Mapping[str, int], for_s: float) -> Row:
    """Return the row of requests beyond those that have rows of their own; `answers` are their numbers by code."""
    times = sum(answers.values())
    text = f"asks {times} times more within {for_s:.0f} s: {_numbers(answers)}"
    return Row(RowKind.REQUEST, text, lift, caller, {"times": times, "answers": dict(answers)})


def pressing(
    lift: str, holder: Holder | None, command: Command, frames: tuple[str, ...], *, again: bool = False
) -> Row:
    """Return the row that a press waits for. It says what is wanted and not what came of it.

    `again` says that it is a hold that was found off.
    """
    data: dict[str, Json] = {"command": command.name, "floor": command.floor, "frames": list(frames)}
    why = " again: it was found off" if again else ""
    return Row(RowKind.PRESS, f"{command} is to be pressed{why}", lift, "" if holder is None else str(holder), data)


def written(lift: str, holder: Holder | None, write: Written) -> Row:
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


def mode_is(lift: str, mode: Mode, before: Mode | None) -> Row:
    """Return the row of a mode that is seen for the first time or has changed."""
    text = f"the mode is {mode}" if before is None else f"the mode was {before} and is {mode}"
    return Row(RowKind.MODE, text, lift, "", {"mode": mode, "before": before})


def mode_changed(lift: str, mode: Mode | None, modes: Mapping[str, int], for_s: float) -> Row:
    """Return the row of changes beyond those that have rows of their own; `modes` tells how often each was seen."""
    times = sum(modes.values())
    among = f"to {mode}" if len(modes) < 2 else f"between {' and '.join(sorted(modes))}, and is {mode}"
    text = f"the mode changed {times} times within {for_s:.0f} s {among}"
    return Row(RowKind.MODE, text, lift, "", {"mode": mode, "times": times})


def link_changed(lift: str, trouble: str, changes: Mapping[str, int], for_s: float) -> Row:
    """Return the row of changes beyond those that have rows of their own; `trouble` is why the lift is not read at last."""
    times = sum(changes.values())
    text = f"the lift was lost or read again {times} times within {for_s:.0f} s, and is {trouble and 'not '}read"
    data: dict[str, Json] = {"up": not trouble, "times": times}
    return Row(RowKind.LINK, text + (f": {trouble}" if trouble else ""), lift, "", data)


def link_up(lift: str, source: str) -> Row:
    """Return the row of a lift that is read."""
    return Row(RowKind.LINK, f"reading {source}", lift, "", {"up": True})


def link_down(lift: str, why: str) -> Row:
    """Return the row of a lift that cannot be read."""
    return Row(RowKind.LINK, why, lift, "", {"up": False})


def manager_started(version: str, maps: Mapping[str, tuple[str, str, str]]) -> Row:
    """Return the first row of a process; `maps` are access, map and the hash of the map as loaded, by lift."""
    lifts: Json = {
        lift: {"access": access, "map": name, "sha256": sha256} for lift, (access, name, sha256) in maps.items()
    }
    text = f"lift manager {version} started, {len(maps)} lift(s)"
    return Row(RowKind.MANAGER, text, data={"version": version, "lifts": lifts})


def manager_ended(*, released: bool, commands: bool) -> Row:
    """Return the last row of an orderly end; `commands` tells whether it may command any lift."""
    rest = "everything is let go and verified" if released else "not every output could be verified as let go"
    rest = rest if commands else "it held nothing, because it only watches"
    return Row(RowKind.MANAGER, f"the manager ends: {rest}", data={"released": released})


def _person(
    event: LockedOut | LockoutOver | DrainBegun | DrainOver | PersonAcknowledged | ReleasedByPerson,
) -> Row:
    match event:
        case ReleasedByPerson(lift, released):
            text = f"{released.by} took the lift from {released.holder}: {released.reason}"
            taken: dict[str, Json] = {"said": "release", "from": str(released.holder), "reason": released.reason}
            return Row(RowKind.PERSON, text, lift, released.by, taken)
        case LockedOut(lift, lockout):
            text = f"locked out by {lockout.by}: {lockout.reason}"
            return Row(RowKind.PERSON, text, lift, lockout.by, {"said": "lockout", "reason": lockout.reason})
        case LockoutOver(lift, ended):
            text = f"the lockout by {ended.lockout.by} is ended by {ended.by}"
            since: dict[str, Json] = {"said": "lockout_end", "since": _shown(ended.lockout.since)}
            return Row(RowKind.PERSON, text, lift, ended.by, since)
        case DrainBegun(lift, drain):
            text = f"drain begun by {drain.by}: {drain.reason}"
            return Row(RowKind.PERSON, text, lift, drain.by, {"said": "drain", "reason": drain.reason})
        case DrainOver(lift, ended):
            text = f"the drain by {ended.drain.by} is ended by {ended.by}"
            begun: dict[str, Json] = {"said": "drain_end", "since": _shown(ended.drain.since)}
            return Row(RowKind.PERSON, text, lift, ended.by, begun)
        case PersonAcknowledged(lift, said):
            text = f"{' and '.join(said.what)} acknowledged by {said.by}"
            return Row(RowKind.PERSON, text, lift, said.by, {"said": "acknowledge", "what": list(said.what)})


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


def _followed(followed: Followed) -> Row | None:
    """Return the row of a request within a session that has ended."""
    if followed.status is Status.PENDING:
        return None
    what = f"{followed.do} {followed.floor}" if followed.floor else followed.do
    seen = "" if followed.proof is Proof.NONE else f", seen by {followed.proof}"
    text = f"{what} {followed.status}{seen}" + (f": {followed.reason}" if followed.reason else "")
    data: dict[str, Json] = {
        "do": followed.do,
        "floor": followed.floor,
        "status": followed.status,
        "proof": followed.proof,
    }
    return Row(RowKind.REQUEST, text, followed.lift, str(followed.holder), data)


def _numbers(answers: Mapping[str, int]) -> str:
    return ", ".join(f"{times} {code}" for code, times in sorted(answers.items()))


def _shown(at: datetime) -> str:
    return at.isoformat(timespec="seconds")
