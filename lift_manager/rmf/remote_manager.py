"""The connection to a manager in another process, with HTTP and threads.

One thread polls the state of the lifts, one reads the event stream to know when to poll, and a few send the adapter's requests. All of
them deliver their results to the adapter's own thread.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from lift_manager.plain.answers import (
    NotJson,
    describe_no_answer,
    describe_refusal,
    describe_stranger,
    parse_json,
    parse_problem,
)
from lift_manager.plain.backoff import Backoff
from lift_manager.plain.change_signal import ChangeSignal, event_number
from lift_manager.plain.client_aging import DEFAULT_MAX_AGE_S, SILENT_S, refresh_pause_s
from lift_manager.plain.http import Connection, NoAnswer, Reply, Server, StreamedReply
from lift_manager.plain.paths import EVENTS, RMF, rmf_path
from lift_manager.plain.rmf import BadAnswer, SiteView, parse_decision, parse_site
from lift_manager.plain.sse import EventParser, TooLong
from lift_manager.rmf.port import (
    NOT_SENT,
    UNREACHABLE,
    Answer,
    Deliver,
    EndOfSession,
    ManagerListener,
    ManagerRequest,
    SessionDemand,
)

_log = logging.getLogger(__name__)

SENDERS = 4
"""How many lifts can have a request under way at the same time. Chosen. One of these connections is for ENDs alone, because a robot that
waits for the end of a session waits without a limit (open-rmf 1.5), and a slow disk must not delay it."""
CLOSED_WITHIN_S = 2.0
"""Chosen: longer than any wait that `close` cannot cut short, except for the system's wait for a name server."""
LAST_ENDS_WITHIN_S = 0.5
"""The part of it in which the last ENDs can still be sent. Chosen: as long as the manager waits for its disk."""
ANSWER_SHARE = 1 / 5
"""Of the time between two polls the manager may need this share to answer; one that answers sooner is polled sooner, down to no pause at
all. Chosen: where the lifts are few, a change does not wait behind the one before it, and the manager has four fifths of its time for others."""
MAX_REASONS = 5
"""Different reasons that are reported in one loss, none of them twice. Chosen: a broken proxy may have a new one each time."""
MAX_QUEUED_S = 1.0
"""A demand that could not be sent for this long is dropped. Chosen: RMF repeats those that still count, and an END must not wait behind an
obsolete one."""
_STREAM = "text/event-stream"
_BUSY = "the manager answers more slowly than RMF sends requests, so this one was not passed on; RMF repeats it"
_KEY = (
    "the adapter needs a key of the role rmf that names each of its lifts"
    " (`lift-manager keys make SITE --name NAME --role rmf --lift LIFT`)"
)


@dataclass(frozen=True)
class Pace:
    """Timeouts and pauses, in seconds."""

    poll_timeout_s: float = DEFAULT_MAX_AGE_S
    """For the state of the lifts. A slower answer shows nothing fresh; if lifts are read less often, it is the longest `max_age_s`, up
    to `stream_timeout_s`."""
    request_timeout_s: float = 2.0
    """For the answer to a request. Chosen: the manager waits for its disk for half a second at most, and RMF repeats its request with
    every state, twice a second: after four times that long, no answer will come."""
    stream_timeout_s: float = SILENT_S
    """Without data on the event stream, which has a heartbeat each second."""
    min_poll_gap_s: float = 0.02
    """The shortest time between two polls of a manager that takes its time. Chosen: at most fifty a second, however many events there are."""
    max_poll_gap_s: float = 1.0
    """The longest time between two polls. Chosen: even if lifts are read rarely, the loss of the manager is noticed within a second."""
    first_retry_s: float = 0.25
    longest_retry_s: float = 2.0
    """The first and the longest pause between attempts to reach a lost manager. Chosen: a robot is waiting."""


class RemoteManager:
    """Implements `port.Manager`. Its threads begin with `start` and end with `close`."""

    def __init__(self, server: Server, pace: Pace | None = None) -> None:
        self._server = server
        self._pace = pace or Pace()
        self._end = threading.Event()
        self._changes = ChangeSignal()
        self._queue = _RequestQueue()
        self._event_reader = _EventReader(server, self._pace, self._changes, self._end)
        self._workers: list[_Worker] = [self._event_reader]
        self._threads: list[threading.Thread] = []

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Begin to poll; `listener` gets the first answer, or that there is none."""
        server, pace, proxy = self._server, self._pace, _ListenerProxy(listener, deliver, self._end)
        self._workers.append(_Poller(server, pace, self._changes, proxy, self._event_reader.retry_now))
        self._workers += (
            _Sender(server, pace, self._queue, self._changes, proxy, ends_only=number == 0) for number in range(SENDERS)
        )
        for worker in self._workers:
            # daemons, so that a name server that does not answer cannot keep the program from ending
            thread = threading.Thread(
                target=_run, args=(worker, proxy), name=f"rmf{type(worker).__name__.lower()}", daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def send(self, request: ManagerRequest) -> None:
        """Queue a request behind earlier ones for the same lift; ENDs of other lifts go first."""
        self._queue.put(request)

    def close(self) -> None:
        """End every thread and connection; nothing is delivered afterwards, not even answers that are due."""
        self._end.set()
        self._changes.announce(None)
        self._queue.end()
        self._event_reader.retry_now()
        senders = [worker for worker in self._workers if isinstance(worker, _Sender)]
        for worker in self._workers:
            if worker not in senders:
                worker.connection.cut()
        self._join(LAST_ENDS_WITHIN_S)
        for worker in senders:
            worker.connection.cut()
        self._join(CLOSED_WITHIN_S - LAST_ENDS_WITHIN_S)

    def _join(self, within_s: float) -> None:
        until = time.monotonic() + within_s
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))


class _ListenerProxy:
    """Calls the adapter from another thread."""

    def __init__(self, listener: ManagerListener, deliver: Deliver, end: threading.Event) -> None:
        self._listener = listener
        self._deliver = deliver
        self.end = end

    def on_site(self, site: SiteView, sent_at: float) -> None:
        self._deliver_to_adapter(lambda: self._listener.on_site(site, sent_at, time.monotonic()))

    def on_answer(self, answer: Answer) -> None:
        self._deliver_to_adapter(lambda: self._listener.on_answer(answer, time.monotonic()))

    def on_manager_lost(self, reason: str) -> None:
        self._deliver_to_adapter(lambda: self._listener.on_manager_lost(reason, time.monotonic()))

    def failed(self, error: Exception) -> None:
        """Raise a bug in the adapter's thread, which can end the program."""

        def fail() -> None:
            raise error

        self._deliver_to_adapter(fail)

    def _deliver_to_adapter(self, call: Callable[[], None]) -> None:
        if not self.end.is_set():
            # a call may still be waiting there while `close` is called
            self._deliver(lambda: None if self.end.is_set() else call())


class _Worker(Protocol):
    """The work of one thread, on a connection of its own."""

    connection: Connection

    def run(self) -> None: ...


def _run(worker: _Worker, proxy: _ListenerProxy) -> None:
    try:
        worker.run()
    except Exception as error:  # noqa: BLE001  raised again in the adapter's thread
        proxy.failed(error)
    finally:
        worker.connection.close()


class _Poller:
    """Polls the state of the lifts: often enough to keep it fresh, and at once after a change."""

    def __init__(
        self, server: Server, pace: Pace, changes: ChangeSignal, proxy: _ListenerProxy, on_connected: Callable[[], None]
    ) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._changes = changes
        self._proxy = proxy
        self._on_connected = on_connected
        self._backoff = Backoff(first_s=pace.first_retry_s, longest_s=pace.longest_retry_s)
        self._every_s = refresh_pause_s(DEFAULT_MAX_AGE_S)
        self._within_s = pace.poll_timeout_s
        self._is_connected = False
        self._reasons: set[str] = set()
        """The reasons reported since the manager's last answer."""

    def run(self) -> None:
        while not self._proxy.end.is_set():
            sent_at = time.monotonic()
            try:
                site = self._request_site()
            except _NoSite as error:
                self._report_lost(str(error))
                self._proxy.end.wait(self._backoff.next_s())
                continue
            gap_s = min(self._pace.min_poll_gap_s, (time.monotonic() - sent_at) / ANSWER_SHARE)
            self._report_site(site, sent_at)
            self._changes.wait(sent_at + self._every_s - time.monotonic())
            self._proxy.end.wait(max(0.0, sent_at + gap_s - time.monotonic()))

    def _request_site(self) -> SiteView:
        """Request the state of the site. Raises _NoSite."""
        try:
            reply = self.connection.request("GET", RMF, within_s=self._within_s)
        except NoAnswer as error:
            raise _NoSite(describe_no_answer(self._server, error)) from error
        if reply.status != 200:
            raise _NoSite(describe_refusal(self._server, reply, _KEY))
        try:
            return parse_site(parse_json(reply))
        except (BadAnswer, NotJson) as error:
            text = self._server.without_key(str(error))
            raise _NoSite(
                f"{describe_stranger(self._server, reply)}, or one of another version than this adapter: {text}"
            ) from error

    def _report_site(self, site: SiteView, sent_at: float) -> None:
        ages = [lift.max_age_s for lift in site.lifts] or [DEFAULT_MAX_AGE_S]
        self._every_s = min(max(refresh_pause_s(min(ages)), self._pace.min_poll_gap_s), self._pace.max_poll_gap_s)
        self._within_s = max(self._pace.poll_timeout_s, min(max(ages), self._pace.stream_timeout_s))
        if not self._is_connected:
            self._is_connected = True
            self._reasons.clear()
            self._backoff.reset()
            self._on_connected()
        self._changes.mark_shown((site.boot, site.event), sent_at)
        self._proxy.on_site(site, sent_at)

    def _report_lost(self, reason: str) -> None:
        self._is_connected = False
        if reason not in self._reasons and len(self._reasons) < MAX_REASONS:
            self._reasons.add(reason)
            self._proxy.on_manager_lost(reason)


class _EventReader:
    """Announces changes that the event stream reports. Without a stream the poller notices them a little later."""

    def __init__(self, server: Server, pace: Pace, changes: ChangeSignal, end: threading.Event) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._changes = changes
        self._end = end
        self._backoff = Backoff()
        self._retry = threading.Event()
        self._reason = ""

    def run(self) -> None:
        while not self._end.is_set():
            try:
                with closing(self.connection.open(EVENTS, _STREAM, within_s=self._pace.stream_timeout_s)) as stream:
                    self._listen(stream)
            except (NoAnswer, TooLong) as error:
                self._log_loss(str(error))
            self._retry.wait(self._backoff.next_s())
            # cleared after the wait, so that a wait ended by `close` sees the end
            self._retry.clear()

    def retry_now(self) -> None:
        """Cut the pause short: the manager is back, or `close` was called."""
        self._retry.set()

    def _listen(self, stream: StreamedReply) -> None:
        if stream.status != 200 or stream.kind != _STREAM:
            self._log_loss(f"HTTP {stream.status}, {self._server.without_key(stream.kind)}")
            return
        parser = EventParser()
        try:
            while piece := stream.read_piece(self._pace.stream_timeout_s):
                self._reason = ""
                self._backoff.reset()
                for message in parser.feed(piece):
                    self._changes.announce(event_number(message.id))
        finally:
            # a manager that ends closes its streams, which is noticed sooner than by the next poll
            self._changes.announce(None)

    def _log_loss(self, reason: str) -> None:
        if reason != self._reason and not self._end.is_set():
            self._reason = reason
            _log.info(
                "no events from the manager at %s (%s): polling it a few times a second", self._server.address, reason
            )


class _Sender:
    """Sends requests of the adapter to the manager, and delivers the answers."""

    def __init__(
        self,
        server: Server,
        pace: Pace,
        queue: _RequestQueue,
        changes: ChangeSignal,
        proxy: _ListenerProxy,
        *,
        ends_only: bool,
    ) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._queue = queue
        self._changes = changes
        self._proxy = proxy
        self._ends_only = ends_only

    def run(self) -> None:
        while (next_request := self._queue.take(ends_only=self._ends_only)) is not None:
            request, waited_s = next_request
            too_late = isinstance(request, SessionDemand) and waited_s > MAX_QUEUED_S
            answer = (
                Answer(request, accepted=False, code=NOT_SENT, reason=_BUSY) if too_late else self._send_one(request)
            )
            self._proxy.on_answer(answer)
            # after its answer, which the next one for the same lift must not overtake
            self._queue.finish(request.lift)
            if answer.accepted:
                self._changes.announce((answer.boot, answer.event))

    def _send_one(self, request: ManagerRequest) -> Answer:
        action, body = _action_and_body(request)
        try:
            # may be sent twice, see `Connection.request`: repeating a demand or an end changes nothing
            reply = self.connection.request(
                "POST", rmf_path(request.lift, action), body, within_s=self._pace.request_timeout_s
            )
        except NoAnswer as error:
            return Answer(request, accepted=False, code=UNREACHABLE, reason=describe_no_answer(self._server, error))
        if reply.status == 200:
            return self._accept(request, reply)
        code = self._server.without_key(parse_problem(reply)[0])
        return Answer(
            request, accepted=False, code=code or UNREACHABLE, reason=describe_refusal(self._server, reply, _KEY)
        )

    def _accept(self, request: ManagerRequest, reply: Reply) -> Answer:
        try:
            boot, event = parse_decision(parse_json(reply))
        except (BadAnswer, NotJson):
            return Answer(request, accepted=False, code=UNREACHABLE, reason=describe_stranger(self._server, reply))
        return Answer(request, accepted=True, boot=boot, event=event)


class _RequestQueue:
    """Requests that were not sent yet: one at a time for each lift, in order."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._requests: list[tuple[ManagerRequest, float]] = []
        """With the time at which each was queued."""
        self._under_way: set[str] = set()
        self._is_ended = False

    def put(self, request: ManagerRequest) -> None:
        with self._changed:
            self._requests.append((request, time.monotonic()))
            self._changed.notify_all()

    def take(self, *, ends_only: bool) -> tuple[ManagerRequest, float] | None:
        """Wait for the next request; return it with its time in the queue, or None at the end. It blocks its lift until `finish`."""
        with self._changed:
            found = self._next(ends_only=ends_only)
            while found is None and not self._is_ended:
                self._changed.wait()
                found = self._next(ends_only=ends_only)
            if found is None:
                return None
            self._requests.remove(found)
            request, since = found
            self._under_way.add(request.lift)
            return request, time.monotonic() - since

    def finish(self, lift: str) -> None:
        with self._changed:
            self._under_way.discard(lift)
            self._changed.notify_all()

    def end(self) -> None:
        """Keep only ENDs, to be sent at once if possible: some supervisors send each only once (open-rmf 1.4)."""
        with self._changed:
            self._is_ended = True
            self._requests = [one for one in self._requests if isinstance(one[0], EndOfSession)]
            self._changed.notify_all()

    def _next(self, *, ends_only: bool) -> tuple[ManagerRequest, float] | None:
        firsts: dict[str, tuple[ManagerRequest, float]] = {}
        for one in self._requests:
            firsts.setdefault(one[0].lift, one)
        free = [one for lift, one in firsts.items() if lift not in self._under_way]
        ended = [one for one in free if isinstance(one[0], EndOfSession)]
        return next(iter(ended if ends_only else ended + free), None)


class _NoSite(Exception):
    """No usable answer came; the message is for people."""


def _action_and_body(request: ManagerRequest) -> tuple[str, dict[str, object]]:
    """Return the last part of the path, and the body."""
    # left out if empty, for managers older than adapter ids
    caller = {"session_id": request.session} | ({"adapter": request.adapter} if request.adapter else {})
    if isinstance(request, EndOfSession):
        return "ended", {**caller, "grace_s": request.grace_s}
    return "wanted", {**caller, "floor": request.floor, "hold_door": request.hold_door}
