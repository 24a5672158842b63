"""The connection to RMF of a machine of a cluster: it lasts as long as the process, and serves the adapter of each term.

So RMF has discovered a standby long before it takes over. A standby publishes nothing. It remembers the ENDs that it receives, because
the active machine may have lost them when it failed.
"""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import TimerHandle
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds import DdsError, DdsListener
from lift_manager.rmf.early_ends import EarlyEnds
from lift_manager.rmf.lift_sessions import REPLAY_S
from lift_manager.rmf.messages import DOOR_CLOSED, END_SESSION, LiftRequest, LiftState, Time
from lift_manager.rmf.port import Deliver
from lift_manager.rmf.run import RESTART_PAUSE_S, Rmf

_log = logging.getLogger(__name__)

KEEP_ENDS_S = 10.0
"""How long a received END is remembered: a takeover that nothing delays takes 5 s at most (measured). Chosen: not much longer, because the
next ride of a robot has the same session id."""


@dataclass(frozen=True)
class _Attached:
    """The adapter of the term."""

    term: TermRmf
    listener: DdsListener
    deliver: Deliver


class LastingRmf:
    """Implements `dds.DdsListener`. Use it on one running loop."""

    def __init__(self, join: Callable[[DdsListener, Deliver], Rmf], alarms: Alarms, clock: Callable[[], float]) -> None:
        """`alarms` are those of the site file. `clock` counts suspended time, too. Raises what `join` raises."""
        self._loop = asyncio.get_running_loop()
        self._make_rmf = join
        self._alarms = alarms
        self._clock = clock
        self._ends, self._fleet_ends = EarlyEnds(KEEP_ENDS_S), EarlyEnds(KEEP_ENDS_S)
        self._writer_found_at = -math.inf
        """When the newest writer of lift requests appeared."""
        self._attached: _Attached | None = None
        self._rejoining: TimerHandle | None = None
        self._rmf: Rmf | None = None
        self._join()

    @property
    def joined(self) -> Rmf | None:
        """The connection; None after it has failed, until RMF is joined again."""
        return self._rmf

    def attach(self, may_publish: Callable[[], bool], listener: DdsListener, deliver: Deliver) -> TermRmf:
        """Serve the adapter of a term, until it closes what this returns. The adapter first receives what it has to know of before.

        Raises what `join` raises if the connection has failed.
        """
        if self._rmf is None:
            self._join()
        term = TermRmf(self, may_publish)
        self._attached = _Attached(term, listener, deliver)
        now = self._clock()
        if now - self._writer_found_at < REPLAY_S:
            deliver(listener.on_request_writer)
        for lift, session in self._ends.at(now):
            deliver(partial(listener.on_request, _end_of(lift, session)))
        for lift, session in self._fleet_ends.at(now):
            deliver(partial(listener.on_fleet_request, _end_of(lift, session)))
        return term

    def detach(self, term: TermRmf) -> None:
        """Serve this adapter no longer; called by `TermRmf.close`."""
        if self._attached is not None and self._attached.term is term:
            self._attached = None

    def leave(self) -> None:
        """Leave RMF after a failure, and join it again after a pause."""
        rmf, self._rmf = self._rmf, None
        if rmf is not None:
            rmf.close()
            self._rejoining = self._loop.call_later(RESTART_PAUSE_S, self._rejoin)

    def close(self) -> None:
        """Leave RMF for good."""
        if self._rejoining is not None:
            self._rejoining.cancel()
        if self._rmf is not None:
            self._rmf.close()

    def on_request(self, request: LiftRequest) -> None:
        self._ends.note(request, self._clock())
        self._pass_on(lambda listener: listener.on_request(request))

    def on_fleet_request(self, request: LiftRequest) -> None:
        self._fleet_ends.note(request, self._clock())
        self._pass_on(lambda listener: listener.on_fleet_request(request))

    def on_unreadable(self, text: str) -> None:
        self._pass_on(lambda listener: listener.on_unreadable(text))

    def on_request_writer(self) -> None:
        self._writer_found_at = self._clock()
        self._pass_on(lambda listener: listener.on_request_writer())

    def on_rival(self, lift_name: str) -> None:
        """Pass it on in a term only: a machine without one receives what the active machine publishes."""
        if self._attached is not None and self._attached.term.may_publish():
            self._pass_on(lambda listener: listener.on_rival(lift_name))

    def on_clock(self, seconds: float) -> None:
        self._pass_on(lambda listener: listener.on_clock(seconds))

    def _join(self) -> None:
        if self._rejoining is not None:
            self._rejoining.cancel()
        self._rmf = self._make_rmf(self, self._deliver)
        self._rmf.alarm.offer(self._alarms)

    def _rejoin(self) -> None:
        try:
            self._join()
        except DdsError as error:
            _log.error("Open-RMF cannot be joined again, next attempt in %g s: %s", RESTART_PAUSE_S, error)
            self._rejoining = self._loop.call_later(RESTART_PAUSE_S, self._rejoin)

    def _pass_on(self, call: Callable[[DdsListener], None]) -> None:
        """Call the adapter in its own way, so that its bugs remain its own."""
        if (attached := self._attached) is not None:
            attached.deliver(partial(call, attached.listener))

    def _deliver(self, call: Callable[[], None]) -> None:
        self._loop.call_soon_threadsafe(self._run, call)

    def _run(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:  # noqa: BLE001  nothing is received any more: RMF is joined again, by the adapter or without one
            if (attached := self._attached) is not None:
                attached.deliver(partial(_raise, error))
            else:
                _log.exception("the connection to Open-RMF failed; it is joined again in %g s", RESTART_PAUSE_S)
            self.leave()


class TermRmf:
    """RMF for the adapter of one term. Implements `run.Rmf` and `alarms.AlarmPublisher`."""

    def __init__(self, lasting: LastingRmf, may_publish: Callable[[], bool]) -> None:
        """`may_publish` compares the clock with the end of the term."""
        self._lasting = lasting
        self.may_publish = may_publish
        self._has_announced = False
        """A later reader would get the latest alarm of this term."""

    @property
    def alarm(self) -> TermRmf:
        """Where a fire is announced."""
        return self

    def publish(self, state: LiftState) -> None:
        """Publish a state, unless the term is over."""
        self._call(lambda rmf: rmf.publish(state))

    def offer(self, alarms: Alarms) -> None:
        """Open the topics of these alarms."""
        if (rmf := self._lasting.joined) is not None:
            rmf.alarm.offer(alarms)

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        """Announce a fire, or its end, unless the term is over."""

        def announce(rmf: Rmf) -> None:
            self._has_announced = True
            rmf.alarm.publish_alarms(alarms, on=on)

        self._call(announce)

    def forget(self) -> None:
        """Drop the latest alarm."""
        self._has_announced = False
        if (rmf := self._lasting.joined) is not None:
            rmf.alarm.forget()

    def close(self) -> None:
        """Publish and receive nothing more. An alarm of this term is no history for later readers: the next active announces it."""
        self._lasting.detach(self)
        if self._has_announced:
            self.forget()

    def _call(self, publish: Callable[[Rmf], None]) -> None:
        """Publish on the connection; if that fails, it is a new one the next time."""
        rmf = self._lasting.joined
        if rmf is None or not self.may_publish():
            return
        try:
            publish(rmf)
        except Exception:
            self._lasting.leave()
            raise


def _end_of(lift: str, session: str) -> LiftRequest:
    return LiftRequest(lift, Time(), session, END_SESSION, "", DOOR_CLOSED)


def _raise(error: Exception) -> None:
    """Raise it in the adapter, which then starts again."""
    raise error
