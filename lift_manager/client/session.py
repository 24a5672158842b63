"""A session in a robot's hand: its lease is renewed by itself, and it is closed at the end of the block."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Protocol

from lift_manager.api.events import AdviceEvent, SessionEvent
from lift_manager.api.lifts import Lift
from lift_manager.api.sessions import Command, CommandRequest, Session
from lift_manager.client.errors import ClientError, Refused, SessionLost, Unreachable
from lift_manager.client.states import Condition, States
from lift_manager.client.states import Manager as StatesManager
from lift_manager.client.stream import Connected
from lift_manager.lift.commands import CommandState, CommandType
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Side

_log = logging.getLogger(__name__)

RENEW_EVERY = 3
"""Chosen: so many renewals within a lease; two may be lost."""
LONGEST_PAUSE_S = 20.0
"""Chosen: a session without a lease is looked at so often."""
TRY_AGAIN_S = 1.0
"""Chosen: after a renewal that nobody answered."""
WAIT_S = 5.0
"""Chosen: the manager is asked to wait for so long at a time; a session that is lost meanwhile is told no later."""
_ENDED = frozenset({Refusal.NO_SUCH_SESSION, Refusal.SESSION_OVER})


class Manager(StatesManager, Protocol):
    """What of the client a session needs."""

    async def get_session(self, lift: str, session: str) -> Session:
        """Ask for it."""
        ...

    async def renew_session(
        self, lift: str, session: str, *, ttl_s: float | None = None, within_s: float | None = None
    ) -> Session:
        """Begin its lease anew."""
        ...

    async def close_session(self, lift: str, session: str, *, robot: RobotWord | None = None) -> Session:
        """End it."""
        ...

    async def hand_over_session(self, lift: str, session: str, to: str, *, robot: str | None = None) -> Session:
        """Give it to another caller."""
        ...

    async def command(self, lift: str, session: str, wish: CommandRequest, *, wait: float = 0.0) -> Command:
        """Ask for something within it."""
        ...

    async def get_command(self, lift: str, session: str, command: str, *, wait: float = 0.0) -> Command:
        """Ask what became of a request."""
        ...


class ActiveSession:
    """The lift for one robot alone.

    Once the session is lost every call raises SessionLost, and so does what waits. The block itself is not cancelled:
    that would stop a robot in the doorway, the worst of all places; `lost` waits for it, for a program that wants to know at once.
    """

    def __init__(self, manager: Manager, opened: Session, asked_at: float, ttl_s: float | None) -> None:
        self._manager = manager
        self._ttl_s = ttl_s
        self._session, self._asked_at = opened, asked_at
        self._lost: SessionLost | None = None
        self._changed = asyncio.Event()
        self._gone = asyncio.Event()
        self._closed = False
        self._last_word: RobotWord | None = None

    @property
    def name(self) -> str:
        """Of the lift."""
        return self._session.lift

    @property
    def info(self) -> Session:
        """As the manager told it last."""
        return self._session

    async def go_to(self, floor: str, *, hold_door: bool = True, wait: float = 0.0) -> Command:
        """Bring the car to a floor. With `wait`, in seconds, return once it is no longer pending: taken by the lift, which is not arrival."""
        return await self._do(CommandType.GO_TO, wait, floor=floor, hold_door=hold_door)

    async def hold_door(self, *, wait: float = 0.0) -> Command:
        """Hold the door open, as long as the site allows."""
        return await self._do(CommandType.HOLD_DOOR, wait)

    async def let_go_door(self, *, wait: float = 0.0) -> Command:
        """Hold the door no more."""
        return await self._do(CommandType.LET_GO_DOOR, wait)

    async def close_door(self, door: Side | None = None, *, wait: float = 0.0) -> Command:
        """Press the close button. Only for a caller that sees that nothing stands in the doorway: this says so."""
        return await self._do(CommandType.CLOSE_DOOR, wait, door=door, clear=True)

    async def robot_in_place(self, *, wait: float = 0.0) -> Command:
        """Say that the robot is in the car and may be taken along."""
        return await self._do(CommandType.ROBOT_IN_PLACE, wait)

    async def robot_left(self, *, wait: float = 0.0) -> Command:
        """Say that the robot is out of the car and clear of the door. The end of the session says it once more."""
        self._last_word = RobotWord.LEFT
        return await self._do(CommandType.ROBOT_LEFT, wait)

    async def hand_over(self, to: str, *, robot: str | None = None) -> Session:
        """Give the session to another caller; this one is over with it. The answer has the new id."""
        self._check()
        given = await self._manager.hand_over_session(self.name, self._session.id, to, robot=robot)
        self._closed = True
        return given

    async def until(self, condition: Condition) -> Lift:
        """Wait until the lift is so, such as `open_at("L2")`. Raises SessionLost; for a limit, use `asyncio.timeout`."""
        states = States(self._manager, self.name)
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(states.follow()), group.create_task(states.listen())]
            try:
                found = await self._met(states, condition)
            finally:
                for task in tasks:
                    task.cancel()
        if isinstance(found, ClientError):
            raise found
        return found

    async def lost(self) -> SessionLost:
        """Wait until the session is over without its holder's word; return why."""
        while self._lost is None:
            await self._gone.wait()
        return self._lost

    async def close(self, *, left: bool = False) -> Session:
        """End it, the car where it is; `left` says that the robot is outside and clear of the door. Twice is once."""
        word = RobotWord.LEFT if left else self._last_word
        self._session = await self._manager.close_session(self.name, self._session.id, robot=word)
        self._closed = True
        return self._session

    @property
    def closed(self) -> bool:
        """Its holder ended it, or gave it away."""
        return self._closed

    async def follow(self) -> None:
        """Renew the lease in time, until the session is over."""
        while self._lost is None and not self._closed:
            await self._until(self._asked_at + self._pause_s)
            await self._renew()

    async def listen(self) -> None:
        """Ask how the session is whenever the event stream says that something happened to it."""
        try:
            async with self._manager.events(lift=self.name) as events:
                async for event in events:
                    # a manager that was started again presses nothing before it hears the holder
                    if isinstance(event, SessionEvent | AdviceEvent | Connected):
                        self._changed.set()
        except Refused as error:
            _log.warning("%s: no event stream (%s); the session is looked at with each renewal", self.name, error)

    @property
    def _pause_s(self) -> float:
        lease_s = self._session.lease_ends_in_s
        return LONGEST_PAUSE_S if lease_s is None else min(lease_s / RENEW_EVERY, LONGEST_PAUSE_S)

    async def _renew(self) -> None:
        asked_at = asyncio.get_running_loop().time()
        self._changed.clear()
        try:
            renewed = await self._manager.renew_session(
                self.name, self._session.id, ttl_s=self._ttl_s, within_s=self._left_s(asked_at)
            )
        except Refused as error:
            if error.code in _ENDED:
                await self._ended(error)
                return
            trouble: ClientError = error
        except ClientError as error:
            trouble = error
        else:
            self._session, self._asked_at = renewed, asked_at
            if renewed.over is not None:
                self._lose(SessionLost(renewed.over.text, renewed.over))
            return
        await self._wait_out(trouble)

    def _left_s(self, now: float) -> float:
        """Return for how long an answer to a renewal is worth waiting for."""
        lease_s = self._session.lease_ends_in_s
        return LONGEST_PAUSE_S if lease_s is None else min(max(self._asked_at + lease_s - now, TRY_AGAIN_S), WAIT_S)

    async def _wait_out(self, trouble: ClientError) -> None:
        lease_s = self._session.lease_ends_in_s
        now = asyncio.get_running_loop().time()
        if lease_s is not None and now >= self._asked_at + lease_s:
            why = trouble.text if isinstance(trouble, Unreachable) else str(trouble)
            self._lose(SessionLost(f"the lease on {self.name} ended, for it could not be renewed: {why}"))
            return
        ends_at = now + TRY_AGAIN_S if lease_s is None else min(now + TRY_AGAIN_S, self._asked_at + lease_s)
        await self._until(ends_at)

    async def _until(self, due_at: float) -> None:
        try:
            async with asyncio.timeout_at(due_at):
                await self._changed.wait()
        except TimeoutError:
            return

    async def _ended(self, refused: Refused) -> None:
        over = None
        try:
            over = (await self._manager.get_session(self.name, self._session.id)).over
        except ClientError as error:
            _log.debug("%s: why the session is over cannot be had: %s", self.name, error)
        self._lose(SessionLost(str(refused) if over is None else over.text, over))

    def _lose(self, lost: SessionLost) -> None:
        if not self._closed and self._lost is None:
            self._lost = lost
            self._gone.set()

    def _check(self) -> None:
        if self._lost is not None:
            raise self._lost
        if self._closed:
            raise SessionLost(f"the session on {self.name} was closed", self._session.over)

    async def _do(self, do: CommandType, wait: float, **what: Any) -> Command:
        self._check()
        wish = CommandRequest.model_validate({"do": do, **what})
        ends_at = asyncio.get_running_loop().time() + wait
        try:
            command = await self._manager.command(self.name, self._session.id, wish)
            while command.status is CommandState.PENDING:
                left_s = ends_at - asyncio.get_running_loop().time()
                if left_s <= 0:
                    break
                command = await self._manager.get_command(
                    self.name, self._session.id, command.id, wait=min(left_s, WAIT_S)
                )
        except Refused as error:
            if error.code not in _ENDED:
                raise
            await self._ended(error)
            self._check()
            raise
        return command

    async def _met(self, states: States, condition: Condition) -> Lift | ClientError:
        while self._lost is None and not self._closed:
            for lift in states.lifts:
                if condition(lift):
                    return lift
            try:
                # what is asked for by the clock ends the wait a few times a second
                await states.changed()
            except Refused as error:
                return error
        return self._lost or SessionLost(f"the session on {self.name} was closed", self._session.over)
