"""One task per lift: polls it, adds up what the readings say, and publishes what changes."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

from drivers.driver import LiftDriver
from drivers.errors import ControllerException, DriverError
from drivers.model import FloorName, LiftReading
from lift_manager.core.around import Around
from lift_manager.core.ask_desk import AskDesk
from lift_manager.core.gate import Gate
from lift_manager.core.held import ReadWhileHeld
from lift_manager.core.journal import ShortJournal
from lift_manager.core.keeper import SessionKeeper
from lift_manager.core.lift_sessions import LiftSessions
from lift_manager.core.memory import Memory, ShortMemory
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs
from lift_manager.core.people import PeopleFirst
from lift_manager.core.people_words import PeopleWords
from lift_manager.core.recording import LiftLog
from lift_manager.core.session_desk import SessionDesk
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain import wish as wishes
from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.contradictions import Track, Trust, Wiring, judge
from lift_manager.domain.description import LiftDescription, LiftSignals
from lift_manager.domain.events import Event, StateChanged
from lift_manager.domain.report import Seen, late_text, lift_state, same_but_for_time
from lift_manager.domain.ride_record import KeptRide
from lift_manager.domain.service import (
    Acknowledged,
    Drain,
    DrainEnded,
    ForceReleased,
    Lockout,
    LockoutEnded,
    Remembered,
)
from lift_manager.domain.sight import Sight, see
from lift_manager.domain.state import Holder, LiftState
from lift_manager.runtime.bus import Bus
from lift_manager.runtime.recorder import Clock, wall_clock
from lift_manager.runtime.ticker import Ticker

CLEAR_AT_STOP_S = 3.0
"""`clear_s` of a manager that ends: the process has five seconds in all. A robot at 0.5 m/s drives 1.5 m in that time."""

RECENT_FLOOR_S = 3.0
"""How long a client may act on a floor we reported: the workshop adapter polls every 0.5 s, publishes every 1 s and waits 1 s for
an answer (open-rmf 2.1), so its idea of the floor may be 2.5 s old."""


class LiftTask:
    """One lift: its newest sight and the keeper of its session."""

    def __init__(
        self,
        driver: LiftDriver,
        options: LiftOptions,
        bus: Bus[Event],
        ticker: Ticker | None = None,
        *,
        memory: Memory | None = None,
        log: LiftLog | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Make a task that is not running yet; `ticker` and `memory` are shared by the lifts of a site.

        `log` has a row of whatever is pressed. Without a memory of the site, session and people's words are forgotten with
        the task.
        """
        memory = memory or ShortMemory()
        self.options = options
        self.polls = 0
        """Polls that have ended, well or not: it rises for as long as our own loop advances."""
        self._ticker = ticker or Ticker()
        self._driver = driver
        self._able = driver.capabilities
        self._bus = bus
        self._sight: Sight | None = None
        self._read_at = -math.inf
        """Monotonic seconds; nothing we know is older than this."""
        self._fault = "no answer yet"
        self._log = log or LiftLog(options.name, ShortJournal(), memory)
        self._outputs = LiftOutputs(options.name, driver, self._log)
        self._people = PeopleFirst(options, bus, memory, clock or wall_clock())
        self._keeper = SessionKeeper(
            self._outputs,
            options,
            bus,
            self._people,
            Around(self._fresh_sight, lambda: self._sight, self._publish, lambda: self._log.trouble),
        )
        self.line = WaitingLine(options.name)
        """Who waits for this lift."""
        self._asks = AskDesk(self._keeper, self.line)
        self._words = PeopleWords(self._keeper)
        self._gate = Gate(options, self._keeper, self._log)
        desk = SessionDesk(self._keeper, options, self.line)
        self.sessions = LiftSessions(options, self._keeper, desk, self._gate, self._log, state=self.state)
        """The sessions of this lift that their holders open and close."""
        self._left: dict[FloorName, float] = {}
        """When the car last left each floor while nobody held the lift."""
        self._read_while_held = ReadWhileHeld()
        self._wiring = Wiring(self._able, options.floors, options.doors_at)
        self._track = Track()
        self._trust: Trust | None = None
        """What the newest sight was judged by; a person may change it."""
        self._shown: LiftState | None = None
        self._looked = asyncio.Event()

    async def first_look(self) -> None:
        """Return once the lift has been read for the first time."""
        await self._looked.wait()

    async def run(self) -> None:
        """Take up the session of before this start, and poll the lift until cancelled. Its bad weather stays its own."""
        self._keeper.begin()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._poll())
            tasks.create_task(self._watch_age())

    async def drive(self) -> None:
        """Carry out presses, holds and releases until cancelled; letting go needs this and the link, and nothing else."""
        await self._driver.run()

    def announce_stop(self) -> None:
        """Refuse everything from now on and withdraw OPEN."""
        self._keeper.announce_stop(CLEAR_AT_STOP_S)

    @property
    def clearing(self) -> bool:
        """Whether a door whose release was announced is still held for a robot in it."""
        return self._keeper.clearing

    async def stop(self) -> None:
        """Refuse everything from now on, let everything go, and return once that is verified."""
        self._keeper.stop()
        try:
            await self._outputs.release_all()
        finally:
            self.tell(end=True)

    def tell(self, *, end: bool = False) -> None:
        """Write down what was only counted for a minute, or at the end all of it."""
        self._log.tell(end=end)

    def freshen(self) -> None:
        """Publish a change that was not published yet, whether or not anybody listens."""
        self._number(self.state())

    def state(self) -> LiftState:
        """Return what this lift publishes right now, from memory."""
        keeper = self._keeper
        seen = Seen(
            lift=self.options.name,
            floors=self.options.floors,
            doors_at=self.options.doors_at,
            able=self._able,
            sight=self._sight,
            age_s=None if self._sight is None else max(0.0, _now() - self._read_at),
            fault=self._fault,
            source=self._driver.source,
            session=keeper.session,
            arrived=keeper.arrived,
            door_held=self._read_while_held(held=keeper.door_held, read_at=self._read_at, now=_now()),
            aboard=keeper.aboard,
            restrictions=keeper.restrictions(),
            waiting=self.line.length(_now()),
            releases_at=keeper.releases_at,
            invites_until=keeper.invites_until,
        )
        return lift_state(seen, _now())

    def describe(self) -> LiftDescription:
        """Return what this lift can say and be told, and what the site allows."""
        options = self.options
        return LiftDescription(
            lift=options.name,
            floors=options.floors,
            doors_at=options.doors_at,
            control=options.control,
            able=self._able,
            poll_s=options.poll_s,
            lease_s=options.lease_s,
            max_session_s=options.max_session_s,
            max_session_hold_s=options.max_session_hold_s,
            clear_s=options.clear_s,
            robot_hours="" if options.robot_hours is None else str(options.robot_hours),
            rmf_name=options.rmf_name,
            rmf_floors=options.rmf_floors,
        )

    def signals(self) -> LiftSignals:
        """Return every signal as it was read last."""
        now = _now()
        age_s = None if self._sight is None else max(0.0, now - self._read_at)
        return LiftSignals(self.options.name, age_s, self._able.max_age_s, self._driver.signals(now))

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide on a request at once. Acceptance is not arrival."""
        self._keeper.begin()
        state = self.state()
        self._number(state)  # so that what is decided has a later number than every state before it
        is_release = not ask.hold_door and not ask.stays and self._is_release(ask, state)
        known = ask.floor in self.options.floors
        self._log.asked(ask, known=known)
        answer = self._gate.told(self._decided(ask, state, is_release=is_release), state)
        self._log.answered(ask, answer, known=known)
        return answer

    def _decided(self, ask: Ask, state: LiftState, *, is_release: bool) -> Accepted | Refused:
        if not is_release and (untaken := self._gate.takes_nobody()) is not None:
            return untaken
        anew = not is_release and self._gate.is_anew(ask.holder, ask.floor, hold_door=ask.hold_door)
        too_often = self._gate.too_often(ask.holder) if anew else None
        answer = too_often or self._asks.request(ask, is_release=is_release, offline=self._gate.offline(state))
        if isinstance(answer, Refused):
            self._asks.refused(ask, answer)
        elif anew:
            self._gate.took_a_turn(ask.holder)
        return answer

    def acknowledge(self, by: str) -> Acknowledged | Refused:
        """Take it that a person has checked the lift after a fire, or found no robot in its car."""
        state = self.state()
        return self._gate.told(self._words.acknowledge(by, offline=self._gate.offline(state)), state)

    def lock_out(self, by: str, reason: str, *, at_once: bool = False) -> Lockout | Refused:
        """Keep robots off until a person says otherwise, over restarts too; a held door is released `clear_s` later unless `at_once`."""
        return self._words.lock_out(by, reason, at_once=at_once)

    def force_release(self, by: str, reason: str, *, at_once: bool = False) -> ForceReleased | Refused:
        """Take the lift from its holder at a person's word; a held door is released `clear_s` later unless `at_once`."""
        return self._words.force_release(by, reason, at_once=at_once)

    def end_session(self, holder: Holder, grace_s: float) -> Accepted | Refused:
        """End the session at its holder's word, after the grace."""
        self._keeper.begin()
        self._number(self.state())  # as before a request
        said = wishes.ending(self.options.name, holder, grace_s)
        self._log.asked(said)
        answer = self._gate.told(self._asks.end(holder, grace_s), self.state())
        self._log.answered(said, answer)
        return answer

    def hand_over(self, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session of `holder` to another caller."""
        return self._asks.hand_over(holder, to)

    def end_lockout(self, by: str) -> LockoutEnded | Refused:
        """Let robots on the lift again."""
        answer = self._people.end_lockout(by)
        self._publish()
        return answer

    def begin_drain(self, by: str, reason: str) -> Drain | Refused:
        """Let sessions end and no new one begin, over restarts too, until a person ends that."""
        answer = self._people.begin_drain(by, reason)
        self._publish()
        return answer

    def end_drain(self, by: str) -> DrainEnded | Refused:
        """Let sessions begin again."""
        answer = self._people.end_drain(by)
        self._publish()
        return answer

    def remembered(self) -> Remembered:
        """Return what of this lift outlives the manager."""
        return self._people.remembered

    def note_rides(self, rides: tuple[KeptRide, ...]) -> None:
        """Remember the rides on this lift over a restart."""
        self._people.note_rides(rides)

    def _is_release(self, ask: Ask, state: LiftState) -> bool:
        """Whether the floor asked for is the one this lift reports, so that a request not to hold the door there lets go.

        An idle lift that people move is not called back to a floor that a slow client still believes in. Of a lift that is
        offline, clients know the last floor. Where only the open door tells the floor, the session's stop counts once the
        door has stood open there.
        """
        if ask.robot is not None:
            return ask.robot is RobotWord.LEFT
        floor, reported = ask.floor, state.floor
        if self._sight is not None and self._fresh_sight(_now()) is None:
            reported = self._sight.floor
        elif reported is None and self._able.evidence == "door_limit":
            reported = self._keeper.stood_open_at
        if floor == reported:
            return True
        return self._keeper.session is None and _now() - self._left.get(floor, -math.inf) <= RECENT_FLOOR_S

    async def _poll(self) -> None:
        loop, period = asyncio.get_running_loop(), self.options.poll_s
        await asyncio.sleep(self.options.first_poll_s)
        due = loop.time()
        while True:
            try:
                reading = await self._driver.read()
            except DriverError as error:
                self._missed(error)
            else:
                self._got(reading)
            self.polls += 1
            due += period
            late = loop.time() - due
            if late > 0:
                # an overloaded poller skips polls; queued ones would only bring older and older news
                due += math.ceil(late / period) * period
            await self._ticker.sleep_until(due)

    def _got(self, reading: LiftReading) -> None:
        before, gap_s = self._sight, reading.at - self._read_at
        self._read_at = reading.at
        if reading.notices:
            for notice in reading.notices:
                self._keeper.tell(notice)
        late_s = _now() - reading.at
        is_late = late_s > self._able.max_age_s
        if before is not None and not is_late and self._is_no_news(before, reading, gap_s):
            return
        self._outputs.flags = reading.values.flags
        sight, news = self._judged(see(before, reading, self._able, gap_s=gap_s), reading.at)
        self._sight = sight
        if before is None:
            self._looked.set()
        elif before.floor is not None and before.floor != sight.floor and self._keeper.session is None:
            self._left[before.floor] = reading.at
        if self._left and self._keeper.session is not None:
            self._left.clear()
        if is_late:
            self._fault = late_text(self._driver.source, late_s, self._able.max_age_s)
            self._log.link(self._driver.source, self._fault, answers=True)
        elif self._fault:
            self._fault = ""
            self._log.link(self._driver.source, "")
        self._gate.mode(sight.values.mode, reading.at)
        self._log.mode(sight.values.mode)
        for text in news:
            self._keeper.tell(text)
        self._keeper.act(_now())
        self._publish()

    def _judged(self, sight: Sight, at: float) -> tuple[Sight, tuple[str, ...]]:
        """Return a sight with what speaks against its open door, and what people should know of that."""
        people = self._people
        judgement = judge(
            self._wiring, self._track, people.remembered.trust, sight, self._keeper.commanded, at, people.clock()
        )
        self._track = judgement.track
        people.note_trust(judgement.trust)
        self._trust = people.remembered.trust
        settled = sight.settled and not judgement.pending
        return replace(sight, doubt=judgement.doubt, must_close=judgement.must_close, settled=settled), judgement.news

    def _is_no_news(self, before: Sight, reading: LiftReading, gap_s: float) -> bool:
        """Whether a reading only shows that nothing has changed: most do, and cost next to nothing."""
        return (
            reading.values is before.values
            and before.settled
            and reading.epoch == before.epoch
            and not self._keeper.busy
            and self._people.remembered.trust is self._trust
            and not self._fault
            and gap_s <= self._able.max_age_s
        )

    def _missed(self, error: DriverError) -> None:
        self._fault = str(error)
        self._log.link(self._driver.source, self._fault, answers=isinstance(error, ControllerException))
        self._keeper.act(_now())
        self._publish()

    async def _watch_age(self) -> None:
        """Publish the loss of a lift when its last reading has become too old, not when the next poll fails."""
        loop = asyncio.get_running_loop()
        while True:
            at = max(self._read_at, loop.time() - self._able.max_age_s)
            await asyncio.sleep(max(at + self._able.max_age_s - loop.time(), 0) + 0.001)
            lost = self._fresh_sight(loop.time()) is None
            if lost:
                self._keeper.act(loop.time())
            self._publish()  # also what changed without a reading, such as what a session waits for
            if lost:
                await asyncio.sleep(self._able.max_age_s)

    def _fresh_sight(self, now: float) -> Sight | None:
        return self._sight if now - self._read_at <= self._able.max_age_s else None

    def _publish(self) -> None:
        if self._bus.heard:
            self._number(self.state())

    def _number(self, state: LiftState) -> None:
        """Give a state an event of its own, if it is another one than that of the newest."""
        if self._shown is None or not same_but_for_time(state, self._shown):
            self._shown = state
            self._bus.publish(StateChanged(self.options.name, state))


def _now() -> float:
    return asyncio.get_running_loop().time()
