"""Carries a trial out in a session of a manager, tells what the lift does meanwhile, and releases everything at its end."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from lift_manager.api.lifts import PlannedWrites
from lift_manager.api.sessions import Command
from lift_manager.client.client import LiftManagerClient, in_background
from lift_manager.client.errors import ClientError, SessionLost
from lift_manager.client.session import ActiveSession
from lift_manager.commissioning.poke.trial import ROBOT_MODE, KnownLift, NotPossible, SessionRequest, Trial, plan_trial
from lift_manager.commissioning.poke.watcher import AT_REST, LOOK_EVERY_S, Show, View, Watcher, look
from lift_manager.lift.commands import DOOR_WITHIN_S, ROBOT_WORDS, CommandState, CommandType
from lift_manager.lift.session import EndReason
from lift_manager.lift.state import Quality

LIVE_WITHIN_S = 15.0
"""How long a lift may take until it is read. Chosen: a controller may need some seconds before it takes another connection."""
RELEASED_WITHIN_S = 10.0
"""How long the releases may take until they are verified. Chosen: twice what the manager gives itself when it ends."""
LEASE_S = 30.0
"""Chosen: so long the manager holds anything should this program be killed."""
SLACK_S = 15.0
"""Chosen: what a command may wait for besides the lift: a turn of people, the disk, a pause of the map."""

_PROOFS = {
    "readback": "the output reads back as written",
    "lamp": "the lift shows that it has taken it",
    "effect": "the lift does it",
    "none": "the lift needed no press",
}


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
    began = asyncio.get_running_loop().time()
    watcher = Watcher(client, await look(client, trial.lift), show, began=began)
    performance = _Performance(again, watcher, hold_s, trip_s=known.capabilities.arrive_within_s)
    outcome, is_released, is_open = Outcome(CommandState.UNCONFIRMED, "interrupted"), True, False
    try:
        async with client.session(trial.lift, robot=who, ttl_s=LEASE_S) as session:
            is_open = True
            try:
                async with in_background(watcher.watch()):
                    outcome = await performance.run(session)
            finally:
                await _close(session, watcher)
    except SessionLost as error:
        outcome = Outcome(CommandState.UNCONFIRMED, f"the session ended before its time: {error}")
    finally:
        if is_open:
            is_released = await _released(client, again, watcher)
    return Outcome(outcome.state, outcome.text, is_released)


@dataclass(frozen=True, slots=True)
class _Performance:
    """The requests of a trial, one after another, with what the lift does for each."""

    trial: Trial
    watcher: Watcher
    hold_s: float
    trip_s: float
    """How long a trip may take."""

    async def run(self, session: ActiveSession) -> Outcome:
        if self.trial.tried is None:
            outcome = await self._until_granted()
            await self._hold(outcome)
            return outcome
        if ROBOT_MODE in self.watcher.view.outputs:
            # a session presses it by itself, at once; where it may not, the requests say why
            await self.watcher.until(lambda view: view.robot_mode in ("on", "held"), DOOR_WITHIN_S)
        outcome, target, limit_s = Outcome(CommandState.CONFIRMED, ""), "", _limit_s(self.trial)
        for number, request in enumerate(self.trial.requests):
            if request.kind is CommandType.GO_TO:
                target = request.floor or ""
            elif request.kind in ROBOT_WORDS:
                await self._until_open(target)
            answer = await _send(session, request, limit_s)
            if number == self.trial.tried:
                outcome = _outcome(answer, limit_s)
                self._report(outcome)
                if outcome.state is CommandState.CONFIRMED:
                    await self._watch_effect(outcome)
            elif answer.status is not CommandState.CONFIRMED and number < self.trial.tried:
                reason = answer.reason or "the lift did not take it"
                return Outcome(answer.status, f"{self.trial} was not pressed: {answer.do} is {answer.status}: {reason}")
            await self.watcher.until(self._pulses_at_rest, _pulse_s(self.trial))
        return outcome

    async def _until_granted(self) -> Outcome:
        """Follow robot mode, which a session presses by itself."""
        within_s = self.trial.command.confirmed_within_s + SLACK_S
        await self.watcher.until(lambda view: view.robot_mode == "held", within_s)
        outcome = _granted(self.watcher.view, within_s)
        self._report(outcome)
        return outcome

    async def _watch_effect(self, outcome: Outcome) -> None:
        """Wait for the car, or keep on for a while what stays on."""
        floor = self.trial.floor
        if not floor:
            await self._hold(outcome)
        elif not await self.watcher.until(lambda view: view.has_arrived(floor), self.trip_s):
            self.watcher.report(f"the car was not seen to stand at {floor} within {self.trip_s:g} s")

    async def _hold(self, outcome: Outcome) -> None:
        if outcome.state is CommandState.CONFIRMED and self.trial.is_held and self.hold_s > 0:
            self.watcher.report(f"{self.trial} stays on for {self.hold_s:g} s; Ctrl-C releases it at once")
            await self.watcher.until(lambda _: False, self.hold_s)

    async def _until_open(self, floor: str) -> None:
        """Wait until the car stands open at a floor: no robot can enter or leave before."""
        is_ride = any(one.kind is CommandType.ROBOT_IN_PLACE for one in self.trial.requests)
        within_s = self.trip_s if is_ride else DOOR_WITHIN_S
        if not await self.watcher.until(lambda view: view.stands_open_at(floor), within_s):
            self.watcher.report(f"the car was not seen to stand open for a robot at {floor} within {within_s:g} s")

    def _pulses_at_rest(self, view: View) -> bool:
        pulses = [command.name for command in self.trial.pressed if command.action == "pulse"]
        return all(view.outputs.get(name) in AT_REST for name in pulses)

    def _report(self, outcome: Outcome) -> None:
        self.watcher.report(f"{self.trial}: {outcome.state}{f' ({outcome.text})' if outcome.text else ''}")


# -- one request


def _limit_s(trial: Trial) -> float:
    """Return how long one request may take: the lift may have to grant robot mode first."""
    return max(command.confirmed_within_s for command in trial.pressed) + SLACK_S


def _pulse_s(trial: Trial) -> float:
    """Return how long the pulses of a trial may take until they are at rest."""
    return max((command.width_s or 0.0 for command in trial.pressed), default=0.0) + DOOR_WITHIN_S


async def _send(session: ActiveSession, request: SessionRequest, limit_s: float) -> Command:
    match request.kind:
        case CommandType.GO_TO:
            return await session.go_to(request.floor or "", hold_door=request.hold_door, wait=limit_s)
        case CommandType.HOLD_DOOR:
            return await session.hold_door(wait=limit_s)
        case CommandType.CLOSE_DOOR:
            return await session.close_door(request.door, wait=limit_s)
        case CommandType.ROBOT_IN_PLACE:
            return await session.robot_in_place(wait=limit_s)
        case CommandType.ROBOT_LEFT:
            return await session.robot_left(wait=limit_s)
        case CommandType.RELEASE_DOOR:
            return await session.let_go_door(wait=limit_s)


def _outcome(answer: Command, limit_s: float) -> Outcome:
    """Judge the answer to the request that is tried."""
    if answer.status is CommandState.CONFIRMED:
        return Outcome(answer.status, _PROOFS.get(answer.proof, answer.proof))
    if answer.status is CommandState.PENDING:
        waits = answer.reason or "the lift"
        return Outcome(CommandState.UNCONFIRMED, f"it still waits for {waits} after {limit_s:g} s")
    return Outcome(answer.status, answer.reason)


def _granted(view: View, within_s: float) -> Outcome:
    """Judge robot mode by what the lift showed within a time."""
    if view.robot_mode == "held":
        granted = " and robot_mode_on reads yes" if view.reads_yes("robot_mode_on") else ""
        return Outcome(CommandState.CONFIRMED, f"its output is on and verified{granted}")
    if view.robot_mode in ("at rest", "requested"):
        waits = ", ".join(view.notes) or "the lift to allow it"
        return Outcome(CommandState.REJECTED, f"it was not pressed: waiting for {waits}")
    return Outcome(CommandState.UNCONFIRMED, f"the lift did not show within {within_s:g} s that it grants it")


# -- the end


async def _close(session: ActiveSession, watcher: Watcher) -> None:
    """End the session. Nobody was in the car: a person has said so."""
    watcher.report("the session ends, and everything is released")
    try:
        over = (await session.close(left=True)).over
    except ClientError as error:
        watcher.report(
            f"the session could not be ended ({error}); its lease ends within {LEASE_S:g} s, and releases everything"
        )
    else:
        if over is not None and over.reason is not EndReason.RELEASED:
            watcher.report(f"it had ended before: {over.text}")


async def _released(client: LiftManagerClient, trial: Trial, watcher: Watcher) -> bool:
    """Wait until every output is verified to be at rest; tell whether it is, and what else is left."""
    names = [command.name for command in trial.pressed]
    try:
        is_released = await watcher.until(lambda view: not view.not_at_rest, RELEASED_WITHIN_S, looks=True)
        lift = await client.lift(trial.lift)
    except ClientError as error:
        watcher.report(
            f"nobody can tell whether everything is released: {error}; look at the outputs of the controller"
        )
        return False
    if is_released:
        watcher.report(f"verified: {', '.join(names)} {'is' if len(names) == 1 else 'are'} at rest")
    else:
        left = ", ".join(f"{name} ({state})" for name, state in watcher.view.not_at_rest.items())
        watcher.report(f"NOT VERIFIED within {RELEASED_WITHIN_S:g} s: {left}; look at the outputs of the controller")
    if (holder := lift.restrictions.maybe_occupied_by) is not None:
        watcher.report(
            f"the lift counts a robot of {holder} in its car; `lift-manager ack {lift.name} --by NAME` ends that"
        )
    return is_released
