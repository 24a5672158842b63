"""Rides: brings robots from floor to floor as a client of sessions. It touches neither drivers nor keepers.

One task goes on with all rides: on every event of a lift that has one, and once a second for what the time does. What a robot or
a caller says is answered at once. Nothing is done from within an event: whoever publishes it is in the middle of something.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import replace

from lift_manager.core.rides.acting import Acting
from lift_manager.core.rides.book import RideBook, is_kept, reused, to_keep, to_tell
from lift_manager.core.rides.choosing import Choosing, may_move
from lift_manager.core.rides.due import Due
from lift_manager.core.rides.places import Places
from lift_manager.core.rides.seeing import Core, Lines, Seeing
from lift_manager.domain import ride_steps as steps
from lift_manager.domain import ride_words as words
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.events import Advised, Event, Occurrence, PersonAcknowledged, RequestFollowed, RideChanged
from lift_manager.domain.following import TAKEN
from lift_manager.domain.ride import Ride, RideBegun, RidePlan, RideRequest, RideWord
from lift_manager.domain.ride_record import (
    Close,
    GoTo,
    InPlace,
    KeptRide,
    Open,
    RideRecord,
    Step,
    holder_of,
    kept,
    restored,
    shown,
)
from lift_manager.domain.ride_sight import why_not_taken
from lift_manager.domain.service import Cause
from lift_manager.domain.session_requests import Do, Status
from lift_manager.domain.state import Holder
from lift_manager.runtime.recorder import Clock

_log = logging.getLogger(__name__)

TICK_S = 1.0
"""How often rides are gone on with although nothing happens: limits, leases, repeats and the place in the line."""

_AT_ONCE = 8
"""Steps of one ride in a row; each has a reason of its own, and fewer are ever needed."""

_AT_A_TIME = 10
"""Rides that are gone on with before others in the process have their turn. Chosen: some milliseconds."""

_ID_BYTES = 8


Tap = Callable[[Callable[[Occurrence], None]], AbstractContextManager[None]]
"""Hands out every event, as `EventSource.tap`."""

Keep = Callable[[str, tuple[KeptRide, ...]], None]
"""Remembers the rides of a lift over a restart."""


class RideEngine:
    """All rides of a site. Its answers are from memory and at once."""

    def __init__(
        self, core: Core, lines: Lines, tap: Tap, *, publish: Callable[[Event], object], keep: Keep, clock: Clock
    ) -> None:
        """`lines` gives who waits for a lift; `publish` and `keep` hear of what has changed."""
        self._core = core
        self._tap = tap
        self._publish = publish
        self._keep = keep
        self._clock = clock
        self._book = RideBook()
        self._seeing = Seeing(core, lines, self._book, clock)
        self._acting = Acting(core, self._seeing, publish)
        self._places = Places(lines)
        self._choosing = Choosing(self._seeing, self._book)
        self._due = Due(self._seeing, self._book, self._places)
        self._wake = asyncio.Event()
        self._news: set[str] = set()
        """Lifts with events that were not looked at."""
        self._advised: list[Advised] = []
        self._ended: list[RequestFollowed] = []
        self._acknowledged: list[str] = []
        self._taken_up = self._stopping = False

    async def run(self) -> None:
        """Go on with rides until cancelled. To be started once every lift has taken up its session of before this start."""
        self.take_up()
        self._seeing.begun = True
        self._wake.set()
        while True:
            await self._wake.wait()
            with self._tap(self._hear):
                await self._go_on_until_over()

    async def _go_on_until_over(self) -> None:
        """Go on for as long as any ride does, or its robot may be in a car; otherwise no state need be worked out for anybody."""
        tick_at = _now()
        while True:
            self._wake.clear()
            is_tick = _now() >= tick_at
            if is_tick:
                tick_at = _now() + TICK_S
            await self._go_on(is_tick=is_tick)
            if not any(not record.over or record.maybe_aboard for record in self._book):
                return
            with suppress(TimeoutError):
                async with asyncio.timeout_at(tick_at):
                    await self._wake.wait()

    def take_up(self) -> None:
        """Take up the rides of before this start, in their order; nothing is asked for them before their robots are heard."""
        if self._taken_up:
            return
        self._taken_up = True
        for lift in self._core.lift_names():
            remembered = self._core.remembered(lift)
            for one in remembered.rides if remembered is not None else ():
                record = restored(one, lift, at=self._clock(), now=_now())
                self._book.put(record)
                self._places.see_to(record, _now())
            self._news.add(lift)

    def stop(self) -> None:
        """Begin no more rides. Those that go on are kept, and go on at the next start."""
        self._stopping = True

    def plan(self, wish: RideRequest) -> RidePlan | Refused:
        """Say what a ride would come to."""
        record = self._chosen(wish)
        if isinstance(record, Refused):
            return record
        seen = self._seeing.of(record)
        held = seen.state.holder not in (None, record.holder)
        return RidePlan(record.lift, seen.ahead + int(held), why_not_taken(record, seen))

    def begin(self, wish: RideRequest) -> RideBegun | Refused:
        """Begin a ride, or return the one of the same caller and idempotency key; the key refuses another wish."""
        self.take_up()
        if (same := self._book.of_key(wish.caller, wish.key)) is not None:
            if (no := reused(same, wish)) is not None:
                return no
            self._put(same, words.heard(same))
            self._advance(same.id)
            return RideBegun(self._shown(same.id), anew=False)
        self._catch_up(holder_of(wish))
        record = self._book.too_many(wish.caller) or self._chosen(wish)
        if isinstance(record, Refused):
            return record
        self._put(None, record)
        self._wake.set()
        self._advance(record.id)
        return RideBegun(self._shown(record.id), anew=True)

    def ride(self, ride: str) -> Ride | None:
        """Return a ride as it is at this moment."""
        self._recall()
        return None if self._book.get(ride) is None else self._shown(ride)

    def lift_of(self, ride: str) -> str:
        """Return the lift of a ride; empty where nobody remembers it, or it has none yet."""
        self._recall()
        record = self._book.get(ride)
        return "" if record is None else record.lift

    def rides(self) -> tuple[Ride, ...]:
        """Return every ride, the oldest first."""
        self._recall()
        return tuple(self._shown(record.id) for record in sorted(self._book, key=lambda one: one.begun_at))

    def word(self, ride: str, word: RideWord, caller: Holder | None) -> Ride | Refused:
        """Take the robot's word."""
        record = self._of(ride, caller)
        if isinstance(record, Refused):
            return record
        if word is RideWord.LEFT and (live := self._taken_up_by(record)) is not None:
            # the car is no longer the old ride's: its robot's word is for the one that goes on
            answer = self.word(live.id, word, caller)
            return answer if isinstance(answer, Refused) else self._shown(ride)
        self._catch_up(record.holder)
        record = self._advance(ride)
        taken = words.take_word(record, word, self._seeing.of(record))
        self._take(record, Step(words.heard(record)) if isinstance(taken, Refused) else taken)
        self._advance(ride)
        return taken if isinstance(taken, Refused) else self._shown(ride)

    def _catch_up(self, holder: Holder) -> None:
        """Know what has become of the rides of a holder before it says something: its word is newer than any of that."""
        for record in self._book.maybe_aboard(holder):
            self._advance(record.id)

    def _taken_up_by(self, record: RideRecord) -> RideRecord | None:
        """Return the ride with which the robot of one that is over has taken its car up again."""
        if not (record.over and record.maybe_aboard and record.wish.robot):
            return None
        taken_up = (one for one in self._book.under_way(record.lift) if one.holder == record.holder)
        return next((one for one in taken_up if self._advance(one.id).maybe_aboard), None)

    def cancel(self, ride: str, caller: Holder | None, reason: str) -> Ride | Refused:
        """End a ride; a robot that may be inside is let out first."""
        record = self._of(ride, caller)
        if isinstance(record, Refused):
            return record
        record = self._advance(ride)
        seen = self._seeing.of(record)
        # the caller's word is its robot's: where it withdraws the ride the robot has been heard of
        record = record if caller is None else words.heard(record)
        self._take(record, words.cancel(record, seen, reason, by_operator=caller is None))
        self._advance(ride)
        return self._shown(ride)

    def _of(self, ride: str, caller: Holder | None) -> RideRecord | Refused:
        self._recall()
        record = self._book.get(ride)
        if record is None:
            return Refused(Refusal.UNKNOWN_RIDE, f"no ride {ride!r} goes on here, and none ended within the last hour")
        if caller not in (None, record.wish.caller):
            return Refused(Refusal.NOT_YOUR_RIDE, f"ride {ride} is that of {record.wish.caller}")
        return record

    def _chosen(self, wish: RideRequest) -> RideRecord | Refused:
        """Return the ride that a wish begins as, not in the book yet."""
        if self._stopping:
            return Refused(Refusal.STOPPING, "the manager is stopping")
        names = self._core.lift_names()
        for lift in wish.lifts:
            if lift not in names:
                return Refused(Refusal.UNKNOWN_LIFT, f"no lift {lift!r}; the lifts are {', '.join(names)}")
        now, at = _now(), self._clock()
        ride = secrets.token_hex(_ID_BYTES)
        record = RideRecord(
            id=ride, wish=wish, lift=next(iter(wish.lifts), ""), phase_since=now, begun_at=at, changed_at=at
        )
        return self._choosing.first(replace(record, spoke_at=now) if wish.robot else record)

    def _shown(self, ride: str) -> Ride:
        """Return a ride as it is at this moment: an event since may not have been looked at yet."""
        record = self._known(ride)
        if self._seeing.begun and not record.over:
            record = steps.read(record, self._seeing.of(record))
        return shown(record, _now())

    def _hear(self, occurrence: Occurrence) -> None:
        """Note what has happened, and do nothing about it here."""
        event = occurrence.event
        match event:
            case RideChanged():
                return
            case Advised():
                self._advised.append(event)
            case RequestFollowed():
                self._ended.append(event)
            case PersonAcknowledged(lift, said) if Cause.OCCUPIED in said.what:
                self._acknowledged.append(lift)
        self._news.add(event.lift)
        self._wake.set()

    async def _go_on(self, *, is_tick: bool) -> None:
        """Go on with the rides of lifts with events, and on a tick with all; others have their turn between them."""
        news, self._news = self._news, set()
        self._heed_events()
        self._choosing.begin_pass()
        names = self._core.lift_names()
        lifts = names if is_tick else tuple(lift for lift in names if lift in news)
        freed = self._due.freed(lifts)
        due = [record.id for record in self._book if not record.over] if is_tick else self._due.rides(lifts, freed)
        for place, ride in enumerate(due):
            if place % _AT_A_TIME == _AT_A_TIME - 1:
                await asyncio.sleep(0)
            record = self._book.get(ride)
            if record is None or record.over:
                continue
            if self._seeing.begun and (is_tick or freed.intersection(record.wish.lifts)):
                self._move(record)
            self._advance(ride)
        self._recall()

    def _recall(self) -> None:
        """Know the rides of before this start, and forget what ended long ago."""
        self.take_up()
        for lift in self._book.forget(_now()):
            self._keep_of(lift)

    def _heed_events(self) -> None:
        advised, self._advised = self._advised, []
        ended, self._ended = self._ended, []
        acknowledged, self._acknowledged = self._acknowledged, []
        for said in advised:
            for record in self._with_session(said.lift, said.holder):
                told = words.advised(record, self._seeing.of(record), said.advice, said.text)
                self._put(record, told)
        for event in ended:
            followed = event.followed
            failed = followed.status in (Status.REJECTED, Status.UNCONFIRMED) and followed.reason != TAKEN
            if failed and followed.do in (Do.GO_TO, Do.ROBOT_IN_PLACE):
                for record in self._with_session(event.lift, followed.holder):
                    self._put(record, replace(record, trouble=f"{followed.do} {followed.status}: {followed.reason}"))
        for lift in acknowledged:
            self._found_outside(lift)

    def _found_outside(self, lift: str, holder: Holder | None = None) -> None:
        """No robot of earlier rides of a holder, or of anybody, is in the car any more."""
        for record in self._book.on(lift):
            if record.over and record.maybe_aboard and holder in (None, record.holder):
                self._put(record, replace(record, maybe_aboard=False))

    def _with_session(self, lift: str, holder: Holder) -> tuple[RideRecord, ...]:
        return tuple(
            record for record in self._book.on(lift) if record.session and not record.over and record.holder == holder
        )

    def _advance(self, ride: str) -> RideRecord:
        """Go on with a ride until there is nothing to do for it; return it as it is."""
        for _ in range(_AT_ONCE):
            record = self._known(ride)
            if record.over or not self._seeing.begun:
                return record
            self._places.see_to(record, _now())
            step = steps.step(record, self._seeing.of(record))
            self._take(record, step)
            if not step.actions:
                return step.record
            if Open() in step.actions and may_move(turned_away := self._known(ride)):
                self._choosing.begin_pass()
                self._move(turned_away)
        return self._known(ride)

    def _known(self, ride: str) -> RideRecord:
        record = self._book.get(ride)
        if record is None:
            raise KeyError(ride)
        return record

    def _take(self, before: RideRecord, step: Step) -> None:
        """Write a step down before anything is done for it, and do it."""
        record = step.record
        self._put(before, record)
        for action in step.actions:
            after = self._acting.carry_out(record, action, self._seeing.of(record))
            self._put(record, after)
            record = after
            if record.trouble and isinstance(action, Open | InPlace | GoTo):
                break
        if Close(left=True) in step.actions and not record.maybe_aboard:
            self._found_outside(record.lift, record.holder)
        if record.over and not before.over:
            # whoever waits for this lift is next
            self._news.add(record.lift)
            self._wake.set()

    def _move(self, record: RideRecord) -> None:
        """Choose again for a ride that waits and may take any lift: another one only where it is better off."""
        lift = self._choosing.better(record)
        if lift is None:
            return
        moved = replace(record, lift=lift, trouble="", changed_at=self._clock())
        self._put(record, steps.read(moved, self._seeing.of(moved)))
        self._keep_of(record.lift)
        self._choosing.begin_pass()

    def _put(self, before: RideRecord | None, record: RideRecord) -> None:
        """Write down a ride as it is, for a restart too, and let it be known."""
        if record == before:
            return
        self._book.put(record)
        self._places.see_to(record, _now())
        if before is None or to_keep(record) != to_keep(before):
            self._keep_of(record.lift)
        if before is not None and to_tell(record) == to_tell(before):
            return
        phase = None if before is None else before.phase
        event = self._publish(RideChanged(record.lift, shown(record, _now()), phase))
        if phase is not record.phase:
            said = {"lift": record.lift, "event": event}
            _log.info(
                "%s: ride %s of %s is %s%s",
                record.lift,
                record.id,
                record.holder,
                record.phase,
                f": {record.reason}" if record.reason else "",
                extra=said,
            )

    def _keep_of(self, lift: str) -> None:
        now, at = _now(), self._clock()
        self._keep(lift, tuple(kept(record, at=at, now=now) for record in self._book.on(lift) if is_kept(record)))


def _now() -> float:
    return asyncio.get_running_loop().time()
