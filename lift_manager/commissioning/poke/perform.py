"""Carries a trial out in a session of a manager, tells what the lift does meanwhile, and releases everything at its end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

from lift_manager.api.lifts import Lift, LiftCommand, PlannedWrites, Signal
from lift_manager.api.sessions import Command
from lift_manager.client.client import LiftManagerClient, in_background
from lift_manager.client.errors import ClientError, SessionLost
from lift_manager.client.session import ActiveSession
from lift_manager.commissioning.poke.trial import ROBOT_MODE, KnownLift, NotPossible, SessionRequest, Trial, plan_trial
from lift_manager.lift.commands import DOOR_WITHIN_S, ROBOT_WORDS, CommandState, CommandType
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import EndReason
from lift_manager.lift.state import Quality
from register_maps.vocabulary import SIGNALS, Kind

LIVE_WITHIN_S = 15.0
"""How long a lift may take until it is read. Chosen: a controller may need some seconds before it takes another connection."""
RELEASED_WITHIN_S = 10.0
"""How long the releases may take until they are verified. Chosen: twice what the manager gives itself when it ends."""
LEASE_S = 30.0
"""Chosen: so long the manager holds anything should this program be killed."""
LOOK_EVERY_S = 0.2
"""Chosen: as often as most lifts are polled."""
SLACK_S = 15.0
"""Chosen: what a command may wait for besides the lift: a turn of people, the disk, a pause of the map."""

Show = Callable[[str], None]
"""Prints a line."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a trial."""

    state: CommandState
    text: str
    is_released: bool = True


async def read_lift(client: LiftManagerClient, lift: str, within_s: float = LIVE_WITHIN_S) -> KnownLift:
    """Return what the manager says about a lift, once it is read. Raises ClientError."""
    commands, capabilities = await client.commands(lift), await client.capabilities(lift)
    ends_at = asyncio.get_running_loop().time() + within_s
    while True:
        known = KnownLift(commands, capabilities, await client.lift(lift))
        is_known = known.is_standing or known.stands_open_only
        is_read = known.lift.quality is Quality.LIVE
        if (is_read and is_known) or asyncio.get_running_loop().time() >= ends_at:
            return known
        await asyncio.sleep(LOOK_EVERY_S)


async def plan_writes(
    client: LiftManagerClient, known: KnownLift, command: str, floor: str
) -> tuple[Trial, PlannedWrites]:
    """Return the trial of a command, and what it writes. Raises NotPossible and ClientError."""
    trial = plan_trial(known, command, floor)
    return trial, await client.planned_writes(trial.lift, *trial.steps)


async def perform(
    client: LiftManagerClient, trial: Trial, shown: PlannedWrites, *, who: str, hold_s: float, show: Show
) -> Outcome:
    """Carry out a trial of which `shown` was shown to a person. Raises NotPossible and Refused where nothing could be pressed.

    `who` is written down as the holder of the lift, `hold_s` is how long an output that stays on is watched.
    """
    known = await read_lift(client, trial.lift)
    again, writes = await plan_writes(client, known, trial.command.name, trial.floor)
    if (again.steps, again.requests, writes) != (trial.steps, trial.requests, shown):
        raise NotPossible(
            f"{trial.lift} has changed since its frames were shown (the car is at {known.lift.floor or 'no known floor'});"
            " nothing was sent, so look at it, and try again"
        )
    return await _Performance(client, again, known, who, hold_s, show).run()


@dataclass
class _Performance:
    client: LiftManagerClient
    trial: Trial
    known: KnownLift
    who: str
    hold_s: float
    show: Show
    _began: float = 0.0
    _signals: dict[str, Signal] = field(default_factory=dict)
    _states: dict[str, str | None] = field(default_factory=dict)
    _notes: tuple[str, ...] = ()
    _was_held: bool = False
    """The lift was seen to be held by a session."""

    async def run(self) -> Outcome:
        lift = self.trial.lift
        self._began = asyncio.get_running_loop().time()
        await self._look(lambda _: None)
        outcome, is_released, is_open = Outcome(CommandState.UNCONFIRMED, "interrupted"), True, False
        try:
            async with self.client.session(lift, robot=self.who, ttl_s=LEASE_S) as session:
                is_open = True
                try:
                    async with in_background(self._watch()):
                        outcome = await self._perform(session)
                finally:
                    await self._close(session)
        except SessionLost as error:
            outcome = Outcome(CommandState.UNCONFIRMED, f"the session ended before its time: {error}")
        finally:
            if is_open:
                is_released = await self._released()
        return Outcome(outcome.state, outcome.text, is_released)

    # -- the requests of the trial

    async def _perform(self, session: ActiveSession) -> Outcome:
        if self.trial.tried is None:
            outcome = await self._until_granted()
            await self._hold(outcome)
            return outcome
        if ROBOT_MODE in self._states:
            # a session presses it by itself, at once; where it may not, the requests say why
            await self._until(lambda: self._states[ROBOT_MODE] in ("on", "held"), DOOR_WITHIN_S)
        outcome, target = Outcome(CommandState.CONFIRMED, ""), ""
        for number, request in enumerate(self.trial.requests):
            if request.kind is CommandType.GO_TO:
                target = request.floor or ""
            elif request.kind in ROBOT_WORDS:
                await self._until_open(target)
            answer = await self._send(session, request)
            if number == self.trial.tried:
                outcome = self._outcome(answer)
                self._report(f"{self.trial}: {outcome.state}{_because(outcome.text)}")
                if outcome.state is CommandState.CONFIRMED:
                    await self._watch_effect(outcome)
            elif answer.status is not CommandState.CONFIRMED and number < self.trial.tried:
                reason = answer.reason or "the lift did not take it"
                return Outcome(answer.status, f"{self.trial} was not pressed: {answer.do} is {answer.status}: {reason}")
            await self._until(self._pulses_at_rest, self._pulse_s)
        return outcome

    async def _send(self, session: ActiveSession, request: SessionRequest) -> Command:
        wait = self._limit_s
        match request.kind:
            case CommandType.GO_TO:
                return await session.go_to(request.floor or "", hold_door=request.hold_door, wait=wait)
            case CommandType.HOLD_DOOR:
                return await session.hold_door(wait=wait)
            case CommandType.CLOSE_DOOR:
                return await session.close_door(request.door, wait=wait)
            case CommandType.ROBOT_IN_PLACE:
                return await session.robot_in_place(wait=wait)
            case CommandType.ROBOT_LEFT:
                return await session.robot_left(wait=wait)
            case CommandType.RELEASE_DOOR:
                return await session.let_go_door(wait=wait)

    def _outcome(self, answer: Command) -> Outcome:
        if answer.status is CommandState.CONFIRMED:
            proof = _PROOFS.get(answer.proof, answer.proof)
            return Outcome(answer.status, proof)
        if answer.status is CommandState.PENDING:
            waits = answer.reason or "the lift"
            return Outcome(CommandState.UNCONFIRMED, f"it still waits for {waits} after {self._limit_s:g} s")
        return Outcome(answer.status, answer.reason)

    async def _until_granted(self) -> Outcome:
        """Follow robot mode, which a session presses by itself."""
        within_s = self.trial.command.confirmed_within_s + SLACK_S
        await self._until(lambda: self._states.get(ROBOT_MODE) == "held", within_s)
        state = self._states.get(ROBOT_MODE)
        if state == "held":
            granted = " and robot_mode_on reads yes" if self._reads_yes("robot_mode_on") else ""
            outcome = Outcome(CommandState.CONFIRMED, f"its output is on and verified{granted}")
        elif state in ("at rest", "requested"):
            waits = ", ".join(self._notes) or "the lift to allow it"
            outcome = Outcome(CommandState.REJECTED, f"it was not pressed: waiting for {waits}")
        else:
            outcome = Outcome(
                CommandState.UNCONFIRMED, f"the lift did not show within {within_s:g} s that it grants it"
            )
        self._report(f"{self.trial}: {outcome.state}{_because(outcome.text)}")
        return outcome

    async def _watch_effect(self, outcome: Outcome) -> None:
        """Wait for the car, or keep on for a while what stays on."""
        if self.trial.floor:
            if not await self._until(self._has_arrived, self._trip_s):
                self._report(f"the car was not seen to stand at {self.trial.floor} within {self._trip_s:g} s")
        else:
            await self._hold(outcome)

    async def _hold(self, outcome: Outcome) -> None:
        if outcome.state is CommandState.CONFIRMED and self.trial.is_held and self.hold_s > 0:
            self._report(f"{self.trial} stays on for {self.hold_s:g} s; Ctrl-C releases it at once")
            await self._until(lambda: False, self.hold_s)

    async def _until_open(self, floor: str) -> None:
        """Wait until the car stands open at a floor: no robot can enter or leave before."""
        is_ride = any(one.kind is CommandType.ROBOT_IN_PLACE for one in self.trial.requests)
        within_s = self._trip_s if is_ride else DOOR_WITHIN_S
        if not await self._until(lambda: self._stands_open_at(floor), within_s):
            self._report(f"the car was not seen to stand open for a robot at {floor} within {within_s:g} s")

    # -- the end

    async def _close(self, session: ActiveSession) -> None:
        """End the session. Nobody was in the car: a person has said so."""
        self._report("the session ends, and everything is released")
        try:
            over = (await session.close(left=True)).over
        except ClientError as error:
            self._report(
                f"the session could not be ended ({error}); its lease ends within {LEASE_S:g} s, and releases everything"
            )
        else:
            if over is not None and over.reason is not EndReason.RELEASED:
                self._report(f"it had ended before: {over.text}")

    async def _released(self) -> bool:
        """Wait until every output is verified to be at rest; say whether it is, and what else is left."""
        names = [command.name for command in self.trial.pressed]
        try:
            is_released = await self._until(self._at_rest, RELEASED_WITHIN_S, looks=True)
            lift = await self.client.lift(self.trial.lift)
        except ClientError as error:
            self._report(
                f"nobody can tell whether everything is released: {error}; look at the outputs of the controller"
            )
            return False
        if is_released:
            self._report(f"verified: {', '.join(names)} {'is' if len(names) == 1 else 'are'} at rest")
        else:
            left = ", ".join(f"{name} ({state})" for name, state in self._states.items() if state not in _AT_REST)
            self._report(f"NOT VERIFIED within {RELEASED_WITHIN_S:g} s: {left}; look at the outputs of the controller")
        if (holder := lift.restrictions.maybe_occupied_by) is not None:
            self._report(
                f"the lift counts a robot of {holder} in its car; `lift-manager ack {lift.name} --by NAME` ends that"
            )
        return is_released

    # -- what the lift does

    async def _watch(self) -> None:
        while True:
            with suppress(ClientError):
                await self._look(self._report)
            await asyncio.sleep(LOOK_EVERY_S)

    async def _look(self, show: Show) -> None:
        """Read the lift, its outputs and its signals; show what has changed."""
        lift = await self.client.lift(self.trial.lift)
        outputs = (await self.client.commands(lift.name)).commands
        signals = (await self.client.signals(lift.name)).signals
        for line in (*self._changed_outputs(outputs), *self._changed_signals(signals), *self._changed_state(lift)):
            show(line)

    def _changed_outputs(self, commands: tuple[LiftCommand, ...]) -> Iterator[str]:
        for command in commands:
            before = self._states.get(command.name)
            self._states[command.name] = command.state
            if command.state is not None and before != command.state:
                yield f"output {command.name}: {before or 'unknown'} -> {command.state}"

    def _changed_signals(self, signals: tuple[Signal, ...]) -> Iterator[str]:
        for signal in signals:
            before = self._signals.get(signal.name)
            self._signals[signal.name] = signal
            is_shown = before is None or (before.value, before.raw) != (signal.value, signal.raw)
            if is_shown and SIGNALS.get(signal.name) not in _RUNNING and before is not None:
                yield f"signal {signal.name}: {_value(before)} -> {_value(signal)}   ({', '.join(signal.addresses)})"

    def _changed_state(self, lift: Lift) -> Iterator[str]:
        before, self.known = self.known.lift, KnownLift(self.known.commands, self.known.capabilities, lift)
        self._was_held = self._was_held or lift.session is not None
        if lift.standing and (before.standing, before.floor) != (True, lift.floor):
            yield f"the car stands at {lift.floor}"
        elif before.standing and not lift.standing:
            yield "the car is not seen to stand any more"
        if before.mode != lift.mode and "mode" not in self._signals:
            yield f"mode: {before.mode} -> {lift.mode}"
        notes = tuple(
            note for note in (lift.reason, lift.restrictions.waiting_for, lift.restrictions.distrusted) if note
        )
        if notes != self._notes:
            yield from (f"waiting for {note}" if note == lift.restrictions.waiting_for else note for note in notes)
        self._notes = notes

    def _has_arrived(self) -> bool:
        lift = self.known.lift
        return lift.quality is Quality.LIVE and lift.standing and lift.floor == self.trial.floor

    def _stands_open_at(self, floor: str) -> bool:
        return self.known.lift.floor == floor and self.known.lift.robot_door is RobotDoor.OPEN

    def _reads_yes(self, flag: str) -> bool:
        return flag in self._signals and self._signals[flag].value is True

    def _pulses_at_rest(self) -> bool:
        pulses = [command.name for command in self.trial.pressed if command.action == "pulse"]
        return all(self._states.get(name) in _AT_REST for name in pulses)

    def _at_rest(self) -> bool:
        return all(state in _AT_REST for state in self._states.values())

    @property
    def _pulse_s(self) -> float:
        return max((command.width_s or 0.0 for command in self.trial.pressed), default=0.0) + DOOR_WITHIN_S

    @property
    def _limit_s(self) -> float:
        """How long one request may take: the lift may have to grant robot mode first."""
        return max(command.confirmed_within_s for command in self.trial.pressed) + SLACK_S

    @property
    def _trip_s(self) -> float:
        return self.known.capabilities.arrive_within_s

    async def _until(self, is_met: Callable[[], bool], within_s: float, *, looks: bool = False) -> bool:
        """Wait until what the watch sees meets a condition, or the session is over; return whether it does.

        `looks` where nothing watches: after the end of the session.
        """
        ends_at = asyncio.get_running_loop().time() + within_s
        while True:
            if looks:
                await self._look(self._report)
            if is_met():
                return True
            is_over = self._was_held and self.known.lift.session is None and not looks
            if is_over or asyncio.get_running_loop().time() >= ends_at:
                return False
            await asyncio.sleep(LOOK_EVERY_S)

    def _report(self, text: str) -> None:
        self.show(f"{asyncio.get_running_loop().time() - self._began:7.1f} s  {text}")


_AT_REST = (None, "at rest")
_RUNNING = (Kind.COUNTER, Kind.NUMBER)
"""Signals that change all the time."""
_PROOFS = {
    "readback": "the output reads back as written",
    "lamp": "the lift shows that it has taken it",
    "effect": "the lift does it",
    "none": "the lift needed no press",
}


def _because(text: str) -> str:
    return f" ({text})" if text else ""


def _value(signal: Signal) -> str:
    if isinstance(signal.value, bool):
        return "yes" if signal.value else "no"
    return f"raw {signal.raw}" if signal.value is None else str(signal.value)
