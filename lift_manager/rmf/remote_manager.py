"""The way to a manager in another process: HTTP and threads.

One thread asks how the lifts are, one hears from the event stream that something changed and so when to ask, and a few carry what
the adapter asks. All that they find out is handed over to the adapter's own thread.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from lift_manager.plain.aging import DEFAULT_MAX_AGE_S, SILENT_S, refresh_pause_s
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

CARRIERS = 4
"""Chosen: lifts that are asked something at the same time; one connection of these is for ENDs alone, because a robot that waits for
the end of a session waits without a limit (open-rmf 1.5), and a lift whose disk is slow must not delay it."""
CLOSED_WITHIN_S = 2.0
"""Chosen: above any wait that `close` cannot cut short, but for that of the system for a name server."""
LAST_WORDS_S = 0.5
"""Of these, for ENDs that were asked last. Chosen: as long as the manager waits for its disk."""
REASONS = 5
"""Chosen: so many different ones are told in one loss, and none twice: a broken proxy may have a new one each time."""
WAITED_S = 1.0
"""Chosen: a wish that could not leave for so long is given up: RMF repeats those that still count, and an END must not wait behind one
that nobody wants any more."""
_STREAM = "text/event-stream"
_BUSY = "the manager answers more slowly than RMF asks, so this was not passed on; RMF asks again"
_KEY = (
    "the adapter needs a key of the role rmf that names each of its lifts"
    " (`lift-manager keys make SITE --name NAME --role rmf --lift LIFT`)"
)


@dataclass(frozen=True)
class Pace:
    """How long is waited for what, in seconds."""

    question_s: float = DEFAULT_MAX_AGE_S
    """For how the lifts are. An answer that took longer shows nothing fresh; where lifts may be read less often, it is as long as
    the longest `max_age_s`, up to `silent_s`."""
    answer_s: float = 2.0
    """For an answer to what the adapter asks. Chosen: the manager waits for its disk for half a second at most, and RMF asks again
    with every state, twice a second: after four times both, nobody will answer."""
    silent_s: float = SILENT_S
    """Without a word on the event stream, which has a heartbeat each second."""
    between_s: float = 0.02
    """At the least, from question to question. Chosen: fifty a second, however many events there are."""
    at_most_s: float = 1.0
    """From question to question. Chosen: where lifts are read rarely, that a manager is gone shows within a second all the same."""
    first_s: float = 0.25
    longest_s: float = 2.0
    """Pauses before the first and the last of the tries to find a lost manager. Chosen: a robot waits."""


class RemoteManager:
    """Implements `port.Manager`. Its threads begin with `start` and end with `close`."""

    def __init__(self, server: Server, pace: Pace | None = None) -> None:
        self._server = server
        self._pace = pace or Pace()
        self._end = threading.Event()
        self._news = ChangeSignal()
        self._waiting = _Waiting()
        self._listener = _Listener(server, self._pace, self._news, self._end)
        self._works: list[_Work] = [self._listener]
        self._threads: list[threading.Thread] = []

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Begin to ask; the first answer, or that there is none, comes to `listener` by itself."""
        server, pace, ears = self._server, self._pace, _Ears(listener, deliver, self._end)
        self._works.append(_Watcher(server, pace, self._news, ears, self._listener.hurry))
        self._works += (
            _Carrier(server, pace, self._waiting, self._news, ears, only_ended=number == 0)
            for number in range(CARRIERS)
        )
        for work in self._works:
            # daemons: a name server that does not answer keeps nobody from ending the program
            thread = threading.Thread(
                target=_run, args=(work, ears), name=f"rmf{type(work).__name__.lower()}", daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def send(self, request: ManagerRequest) -> None:
        """Pass it on, after what was asked of the same lift before; ENDs of other lifts go first."""
        self._waiting.put(request)

    def close(self) -> None:
        """End every thread and connection; nothing is handed over any more, answers that are due included."""
        self._end.set()
        self._news.announce(None)
        self._waiting.end()
        self._listener.hurry()
        carriers = [work for work in self._works if isinstance(work, _Carrier)]
        for work in self._works:
            if work not in carriers:
                work.connection.cut()
        self._join(LAST_WORDS_S)
        for work in carriers:
            work.connection.cut()
        self._join(CLOSED_WITHIN_S - LAST_WORDS_S)

    def _join(self, within_s: float) -> None:
        until = time.monotonic() + within_s
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))


class _Ears:
    """The adapter, from another thread."""

    def __init__(self, listener: ManagerListener, deliver: Deliver, end: threading.Event) -> None:
        self._listener = listener
        self._deliver = deliver
        self.end = end

    def on_site(self, site: SiteView, sent_at: float) -> None:
        self._hand_over(lambda: self._listener.on_site(site, sent_at, time.monotonic()))

    def on_answer(self, answer: Answer) -> None:
        self._hand_over(lambda: self._listener.on_answer(answer, time.monotonic()))

    def on_manager_lost(self, reason: str) -> None:
        self._hand_over(lambda: self._listener.on_manager_lost(reason, time.monotonic()))

    def failed(self, error: Exception) -> None:
        """Let a bug end the program: the adapter's thread is the one that can."""

        def fail() -> None:
            raise error

        self._hand_over(fail)

    def _hand_over(self, what: Callable[[], None]) -> None:
        if not self.end.is_set():
            # some of it may wait there while `close` is called
            self._deliver(lambda: None if self.end.is_set() else what())


class _Work(Protocol):
    """What a thread does, on a connection of its own."""

    connection: Connection

    def run(self) -> None: ...


def _run(work: _Work, ears: _Ears) -> None:
    try:
        work.run()
    except Exception as error:  # noqa: BLE001  raised again in the adapter's thread
        ears.failed(error)
    finally:
        work.connection.close()


class _Watcher:
    """Asks how the lifts are: often enough that what is known stays fresh, and at once when there is news."""

    def __init__(
        self, server: Server, pace: Pace, news: ChangeSignal, ears: _Ears, on_back: Callable[[], None]
    ) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._news = news
        self._ears = ears
        self._on_back = on_back
        self._backoff = Backoff(first_s=pace.first_s, longest_s=pace.longest_s)
        self._every_s = refresh_pause_s(DEFAULT_MAX_AGE_S)
        self._within_s = pace.question_s
        self._is_heard = False
        self._reasons: set[str] = set()
        """Why the manager is not heard, as was told since it was heard last."""

    def run(self) -> None:
        while not self._ears.end.is_set():
            sent_at = time.monotonic()
            try:
                site = self._asked()
            except _Unheard as error:
                self._lost(str(error))
                self._ears.end.wait(self._backoff.next_s())
                continue
            self._heard(site, sent_at)
            self._news.wait(sent_at + self._every_s - time.monotonic())
            self._ears.end.wait(max(0.0, sent_at + self._pace.between_s - time.monotonic()))

    def _asked(self) -> SiteView:
        """Raises _Unheard."""
        try:
            reply = self.connection.request("GET", RMF, within_s=self._within_s)
        except NoAnswer as error:
            raise _Unheard(describe_no_answer(self._server, error)) from error
        if reply.status != 200:
            raise _Unheard(describe_refusal(self._server, reply, _KEY))
        try:
            return parse_site(parse_json(reply))
        except (BadAnswer, NotJson) as error:
            text = self._server.without_key(str(error))
            raise _Unheard(
                f"{describe_stranger(self._server, reply)}, or one of another version than this adapter: {text}"
            ) from error

    def _heard(self, site: SiteView, sent_at: float) -> None:
        ages = [lift.max_age_s for lift in site.lifts] or [DEFAULT_MAX_AGE_S]
        self._every_s = min(max(refresh_pause_s(min(ages)), self._pace.between_s), self._pace.at_most_s)
        self._within_s = max(self._pace.question_s, min(max(ages), self._pace.silent_s))
        if not self._is_heard:
            self._is_heard = True
            self._reasons.clear()
            self._backoff.reset()
            self._on_back()
        self._news.mark_shown((site.boot, site.event), sent_at)
        self._ears.on_site(site, sent_at)

    def _lost(self, reason: str) -> None:
        self._is_heard = False
        if reason not in self._reasons and len(self._reasons) < REASONS:
            self._reasons.add(reason)
            self._ears.on_manager_lost(reason)


class _Listener:
    """Hears from the event stream that there is news. Without a stream the watcher finds out a little later."""

    def __init__(self, server: Server, pace: Pace, news: ChangeSignal, end: threading.Event) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._news = news
        self._end = end
        self._backoff = Backoff()
        self._hurry = threading.Event()
        self._reason = ""

    def run(self) -> None:
        while not self._end.is_set():
            try:
                with closing(self.connection.open(EVENTS, _STREAM, within_s=self._pace.silent_s)) as stream:
                    self._listen(stream)
            except (NoAnswer, TooLong) as error:
                self._silent(str(error))
            self._hurry.wait(self._backoff.next_s())
            # after the wait: one that `close` ends finds that the end has come
            self._hurry.clear()

    def hurry(self) -> None:
        """Try now: the manager is back, or the end has come."""
        self._hurry.set()

    def _listen(self, stream: StreamedReply) -> None:
        if stream.status != 200 or stream.kind != _STREAM:
            self._silent(f"HTTP {stream.status}, {self._server.without_key(stream.kind)}")
            return
        parser = EventParser()
        try:
            while piece := stream.read_piece(self._pace.silent_s):
                self._reason = ""
                self._backoff.reset()
                for message in parser.feed(piece):
                    self._news.announce(event_number(message.id))
        finally:
            # a manager that ends takes its streams along, and that shows sooner than the next question would
            self._news.announce(None)

    def _silent(self, reason: str) -> None:
        if reason != self._reason and not self._end.is_set():
            self._reason = reason
            _log.info(
                "no events from the manager at %s (%s): it is asked a few times a second", self._server.address, reason
            )


class _Carrier:
    """Carries what the adapter asks to the manager, and the answer back."""

    def __init__(
        self, server: Server, pace: Pace, waiting: _Waiting, news: ChangeSignal, ears: _Ears, *, only_ended: bool
    ) -> None:
        self.connection = Connection(server)
        self._server = server
        self._pace = pace
        self._waiting = waiting
        self._news = news
        self._ears = ears
        self._only_ended = only_ended

    def run(self) -> None:
        while (taken := self._waiting.take(only_ended=self._only_ended)) is not None:
            request, waited_s = taken
            too_late = isinstance(request, SessionDemand) and waited_s > WAITED_S
            answer = (
                Answer(request, accepted=False, code=NOT_SENT, reason=_BUSY) if too_late else self._carried(request)
            )
            self._ears.on_answer(answer)
            # later than its answer, which the next one of the same lift must not overtake
            self._waiting.done(request.lift)
            if answer.accepted:
                self._news.announce((answer.boot, answer.event))

    def _carried(self, request: ManagerRequest) -> Answer:
        word, body = _said(request)
        try:
            # may go out twice, see `send`: to want again what is wanted, or to end again what is over, changes nothing
            reply = self.connection.request("POST", rmf_path(request.lift, word), body, within_s=self._pace.answer_s)
        except NoAnswer as error:
            return Answer(request, accepted=False, code=UNREACHABLE, reason=describe_no_answer(self._server, error))
        if reply.status == 200:
            return self._yes(request, reply)
        code = self._server.without_key(parse_problem(reply)[0])
        return Answer(
            request, accepted=False, code=code or UNREACHABLE, reason=describe_refusal(self._server, reply, _KEY)
        )

    def _yes(self, request: ManagerRequest, reply: Reply) -> Answer:
        try:
            boot, event = parse_decision(parse_json(reply))
        except (BadAnswer, NotJson):
            return Answer(request, accepted=False, code=UNREACHABLE, reason=describe_stranger(self._server, reply))
        return Answer(request, accepted=True, boot=boot, event=event)


class _Waiting:
    """What was asked and not carried yet: one at a time of each lift, in order."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._asked: list[tuple[ManagerRequest, float]] = []
        """With the time when it was asked."""
        self._under_way: set[str] = set()
        self._is_over = False

    def put(self, request: ManagerRequest) -> None:
        with self._changed:
            self._asked.append((request, time.monotonic()))
            self._changed.notify_all()

    def take(self, *, only_ended: bool) -> tuple[ManagerRequest, float] | None:
        """Wait for the next one and for how long it has waited; it keeps others of its lift until `done`. None at the end."""
        with self._changed:
            found = self._next(only_ended=only_ended)
            while found is None and not self._is_over:
                self._changed.wait()
                found = self._next(only_ended=only_ended)
            if found is None:
                return None
            self._asked.remove(found)
            request, since = found
            self._under_way.add(request.lift)
            return request, time.monotonic() - since

    def done(self, lift: str) -> None:
        with self._changed:
            self._under_way.discard(lift)
            self._changed.notify_all()

    def end(self) -> None:
        """Let ENDs be carried that can be at once, and nothing else: some supervisors say each once only (open-rmf 1.4)."""
        with self._changed:
            self._is_over = True
            self._asked = [one for one in self._asked if isinstance(one[0], EndOfSession)]
            self._changed.notify_all()

    def _next(self, *, only_ended: bool) -> tuple[ManagerRequest, float] | None:
        firsts: dict[str, tuple[ManagerRequest, float]] = {}
        for one in self._asked:
            firsts.setdefault(one[0].lift, one)
        free = [one for lift, one in firsts.items() if lift not in self._under_way]
        ended = [one for one in free if isinstance(one[0], EndOfSession)]
        return next(iter(ended if only_ended else ended + free), None)


class _Unheard(Exception):
    """No answer from which anything is known; the message is for people."""


def _said(request: ManagerRequest) -> tuple[str, dict[str, object]]:
    """Return the last word of the path, and the body."""
    # left out where it is empty, for a manager from before adapters had ids
    caller = {"session_id": request.session} | ({"adapter": request.adapter} if request.adapter else {})
    if isinstance(request, EndOfSession):
        return "ended", {**caller, "grace_s": request.grace_s}
    return "wanted", {**caller, "floor": request.floor, "hold_door": request.hold_door}
