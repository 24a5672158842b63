"""A session for the program of a robot: renews its lease automatically, and is closed at the end of the block."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Protocol

from lift_manager.api.events import AdviceEvent, SessionEvent
from lift_manager.api.lifts import Lift
from lift_manager.api.sessions import Command, CommandRequest, Session
from lift_manager.client.errors import ClientError, Refused, SessionLost, Unreachable
from lift_manager.client.states import Condition, States, StatesClient
from lift_manager.client.stream import Connected
from lift_manager.lift.commands import CommandState, CommandType
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Side

_log = logging.getLogger(__name__)

RENEWALS_PER_LEASE = 3
"""Chosen: two of the renewals within a lease may be lost."""
MAX_PAUSE_S = 20.0
"""Chosen: how often a session without a lease is checked."""
RETRY_S = 1.0
"""Chosen: after a renewal without a reply."""
WAIT_S = 5.0
"""Chosen: the longest wait requested from the manager; a session that is lost meanwhile is reported no later."""
_ENDED = frozenset({Refusal.NO_SUCH_SESSION, Refusal.SESSION_OVER})


class SessionClient(StatesClient, Protocol):
    """The part of the client that a session needs."""

    async def get_session(self, lift: str, session: str) -> Session:
        """Get a session."""
        ...

    async def renew_session(
        self, lift: str, session: str, *, ttl_s: float | None = None, within_s: float | None = None
    ) -> Session:
        """Renew its lease."""
        ...

    async def close_session(self, lift: str, session: str, *, robot: RobotWord | None = None) -> Session:
        """Close a session."""
        ...

    async def hand_over_session(self, lift: str, session: str, to: str, *, robot: str | None = None) -> Session:
        """Give it to another caller."""
        ...

    async def command(self, lift: str, session: str, request: CommandRequest, *, wait: float = 0.0) -> Command:
        """Send a command."""
        ...

    async def get_command(self, lift: str, session: str, command: str, *, wait: float = 0.0) -> Command:
        """Get the status of a command."""
        ...


class ActiveSession:
    """Exclusive use of a lift for one robot.

    Once the session is lost, every call raises SessionLost, including those that wait. The block itself is not cancelled, because
    that would stop a robot in the doorway, the worst of all places; `lost` waits for the loss, for a program that has to react at once.
    """

    def __init__(self, manager: SessionClient, opened: Session, requested_at: float, ttl_s: float | None) -> None:
        self._manager = manager
        self._ttl_s = ttl_s
        self._session, self._requested_at = opened, requested_at
        self._lost: SessionLost | None = None
        self._changed = asyncio.Event()
        self._lost_event = asyncio.Event()
        self._closed = False
        self._is_closing = False
        """The close is on its way to the manager; the event of the end may arrive before the reply, and calls for no renewal."""
        self._last_report: RobotWord | None = None

    @property
    def name(self) -> str:
        """The name of the lift."""
        return self._session.lift

    @property
    def info(self) -> Session:
        """The session in the latest reply."""
        return self._session

    async def go_to(self, floor: str, *, hold_door: bool = True, wait: float = 0.0) -> Command:
        """Call the car to a floor. With `wait`, in seconds, return once it is no longer pending: the lift has the call, but has not arrived."""
        return await self._run_command(CommandType.GO_TO, wait, floor=floor, hold_door=hold_door)

    async def hold_door(self, *, wait: float = 0.0) -> Command:
        """Hold the door open, as long as site and controller allow."""
        return await self._run_command(CommandType.HOLD_DOOR, wait)

    async def let_go_door(self, *, wait: float = 0.0) -> Command:
        """Release the door."""
        return await self._run_command(CommandType.RELEASE_DOOR, wait)

    async def close_door(self, door: Side | None = None, *, wait: float = 0.0) -> Command:
        """Press the close button. Only for a caller that can see that the doorway is clear: this confirms it."""
        return await self._run_command(CommandType.CLOSE_DOOR, wait, door=door, clear=True)

    async def robot_in_place(self, *, wait: float = 0.0) -> Command:
        """Report that the robot is in the car and ready to ride."""
        return await self._run_command(CommandType.ROBOT_IN_PLACE, wait)

    async def robot_left(self, *, wait: float = 0.0) -> Command:
        """Report that the robot is out of the car and clear of the door. Closing the session repeats it."""
        self._last_report = RobotWord.LEFT
        return await self._run_command(CommandType.ROBOT_LEFT, wait)

    async def hand_over(self, to: str, *, robot: str | None = None) -> Session:
        """Hand the session over to another caller; this object is closed. The reply has the new id."""
        self._require_open()
        handed_over = await self._manager.hand_over_session(self.name, self._session.id, to, robot=robot)
        self._closed = True
        return handed_over

    async def until(self, condition: Condition) -> Lift:
        """Wait until the lift meets a condition, such as `open_at("L2")`. Raises SessionLost; for a limit, use `asyncio.timeout`."""
        states = States(self._manager, self.name)
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(states.follow()), group.create_task(states.listen())]
            try:
                found = await self._wait_for(states, condition)
            finally:
                for task in tasks:
                    task.cancel()
        if isinstance(found, ClientError):
            raise found
        return found

    async def lost(self) -> SessionLost:
        """Wait until the session is over although its holder did not close it; return why."""
        while self._lost is None:
            await self._lost_event.wait()
        return self._lost

    async def close(self, *, left: bool = False) -> Session:
        """Close the session without moving the car; `left` reports that the robot is outside and clear of the door. May be repeated."""
        word = RobotWord.LEFT if left else self._last_report
        self._is_closing = True
        try:
            self._session = await self._manager.close_session(self.name, self._session.id, robot=word)
        finally:
            self._is_closing = False
        self._closed = True
        return self._session

    @property
    def closed(self) -> bool:
        """Whether its holder closed it or handed it over."""
        return self._closed

    async def follow(self) -> None:
        """Renew the lease until the session is over."""
        while self._lost is None and not self._closed:
            await self._sleep_until(self._requested_at + self._pause_s)
            await self._renew()

    async def listen(self) -> None:
        """Trigger a renewal for each event about the session."""
        try:
            async with self._manager.events(lift=self.name) as events:
                async for event in events:
                    # a restarted manager presses nothing before a request of the holder
                    if isinstance(event, SessionEvent | AdviceEvent | Connected):
                        self._changed.set()
        except Refused as error:
            _log.warning("%s: no event stream (%s); the session is checked with each renewal", self.name, error)

    @property
    def _pause_s(self) -> float:
        lease_s = self._session.lease_ends_in_s
        return MAX_PAUSE_S if lease_s is None else min(lease_s / RENEWALS_PER_LEASE, MAX_PAUSE_S)

    async def _renew(self) -> None:
        requested_at = asyncio.get_running_loop().time()
        self._changed.clear()
        if self._is_closing:
            return
        try:
            renewed = await self._manager.renew_session(
                self.name, self._session.id, ttl_s=self._ttl_s, within_s=self._renewal_timeout_s(requested_at)
            )
        except Refused as error:
            if error.code in _ENDED:
                await self._lose_with_reason(error)
                return
            trouble: ClientError = error
        except ClientError as error:
            trouble = error
        else:
            self._session, self._requested_at = renewed, requested_at
            if renewed.over is not None:
                self._mark_lost(SessionLost(renewed.over.text, renewed.over))
            return
        await self._retry_later(trouble)

    def _renewal_timeout_s(self, now: float) -> float:
        """Return how long to wait for the reply to a renewal."""
        lease_s = self._session.lease_ends_in_s
        return MAX_PAUSE_S if lease_s is None else min(max(self._requested_at + lease_s - now, RETRY_S), WAIT_S)

    async def _retry_later(self, trouble: ClientError) -> None:
        lease_s = self._session.lease_ends_in_s
        now = asyncio.get_running_loop().time()
        if lease_s is not None and now >= self._requested_at + lease_s:
            why = trouble.text if isinstance(trouble, Unreachable) else str(trouble)
            self._mark_lost(SessionLost(f"the lease on {self.name} ended because it could not be renewed: {why}"))
            return
        ends_at = now + RETRY_S if lease_s is None else min(now + RETRY_S, self._requested_at + lease_s)
        await self._sleep_until(ends_at)

    async def _sleep_until(self, due_at: float) -> None:
        try:
            async with asyncio.timeout_at(due_at):
                await self._changed.wait()
        except TimeoutError:
            return

    async def _lose_with_reason(self, refused: Refused) -> None:
        over = None
        try:
            over = (await self._manager.get_session(self.name, self._session.id)).over
        except ClientError as error:
            _log.debug("%s: the reason for the end of the session is not available: %s", self.name, error)
        self._mark_lost(SessionLost(str(refused) if over is None else over.text, over))

    def _mark_lost(self, lost: SessionLost) -> None:
        if not self._closed and self._lost is None:
            self._lost = lost
            self._lost_event.set()

    def _require_open(self) -> None:
        if self._lost is not None:
            raise self._lost
        if self._closed:
            raise SessionLost(f"the session on {self.name} was closed", self._session.over)

    async def _run_command(self, kind: CommandType, wait: float, **fields: Any) -> Command:
        self._require_open()
        request = CommandRequest.model_validate({"do": kind, **fields})
        ends_at = asyncio.get_running_loop().time() + wait
        try:
            command = await self._manager.command(self.name, self._session.id, request)
            while command.status is CommandState.PENDING:
                remaining_s = ends_at - asyncio.get_running_loop().time()
                if remaining_s <= 0:
                    break
                command = await self._manager.get_command(
                    self.name, self._session.id, command.id, wait=min(remaining_s, WAIT_S)
                )
        except Refused as error:
            if error.code not in _ENDED:
                raise
            await self._lose_with_reason(error)
            self._require_open()
            raise
        return command

    async def _wait_for(self, states: States, condition: Condition) -> Lift | ClientError:
        while self._lost is None and not self._closed:
            for lift in states.lifts:
                if condition(lift):
                    return lift
            try:
                # polling ends this wait a few times a second
                await states.changed()
            except Refused as error:
                return error
        return self._lost or SessionLost(f"the session on {self.name} was closed", self._session.over)
