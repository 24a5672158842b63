"""One machine of a pair: sends the requests of its term to etcd, one at a time, and carries the term to whoever is bound by it."""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import Future
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from drivers.clock import boottime
from drivers.thread import Worker
from lift_manager.cluster.content import (
    Handover,
    Place,
    decode_handover,
    decode_head,
    decode_key,
    decode_solo,
    encode_handover,
    encode_key,
)
from lift_manager.cluster.errors import ClusterError, ClusterUnusable
from lift_manager.cluster.etcd import Entry, Etcd, Result, has_revision, has_value, put, read
from lift_manager.cluster.term import (
    HIGHEST_EPOCH,
    Answered,
    Input,
    Key,
    Leave,
    Order,
    Role,
    Sent,
    Term,
    Tick,
    Unanswered,
    step,
)
from lift_manager.store.committer import Jobs

_log = logging.getLogger(__name__)

SILENCE_S = 3.0
"""After so long without an answer a standby reports that it cannot reach etcd. Chosen: longer than the election of a leader."""


class ActiveTerm:
    """A term in which this machine is active, for those who may write only while it lasts."""

    def __init__(self, key: Key, clock: Callable[[], float], *, alone: str = "") -> None:
        """`key` is what etcd has for the epoch of the term; `alone` says in words that this machine goes on without it."""
        self.key = key
        self.alone = alone
        self.ends = asyncio.Event()
        """OPEN is to be withdrawn and everything released; or all of it is over already."""
        self.releases = asyncio.Event()
        """Everything is to be released now, whoever is in a doorway."""
        self.prepare: Mapping[str, Callable[[], Awaitable[None]]] = {}
        """What is to be done before the first connection to a controller in this term, by its name."""
        self.handed_over_by = ""
        """Who has requested that the other machine takes over; then the term is over, and all is left as it is for that one."""
        self.over = asyncio.Event()
        """Nothing may be written any more. `remaining_s` knows it earlier, when this process was stopped."""
        self._clock = clock
        self._until = 0.0
        self._releases_at = 0.0
        self._followers: list[Callable[[float], None]] = []

    @property
    def remaining_s(self) -> float:
        """For how long this machine may still write; 0 or less once the term is over."""
        return 0.0 if self.over.is_set() else self._until - self._clock()

    @property
    def until(self) -> float:
        """When the term ends on CLOCK_BOOTTIME, if no renewal is applied until then."""
        return self._until

    @property
    def clear_s(self) -> float:
        """How long a robot may take to leave a doorway before the release, if no renewal is applied until then."""
        return max(0.0, self._releases_at - self._clock())

    def follow(self, fence: Callable[[float], None]) -> None:
        """Call `fence` now and with every renewal, with the loop time at which the term ends."""
        self._followers.append(fence)
        fence(self._loop_time(self._until))

    def renew(self, term: Term) -> None:
        """Take over the end of a term; one that is over stays over."""
        if self.over.is_set():
            return
        self._until, self._releases_at = term.until, term.releases_at
        for fence in self._followers:
            fence(self._loop_time(self._until))

    def end(self) -> None:
        """Let nothing be written any more."""
        self.over.set()
        for fence in self._followers:
            fence(asyncio.get_running_loop().time())
        self.ends.set()
        self.releases.set()

    def _loop_time(self, at: float) -> float:
        # the loop's clock is read first: if this process is stopped between the two lines, the result is too early
        now = asyncio.get_running_loop().time()
        return now + (at - self._clock())


class Member:
    """Watches the key, takes it, and renews it. `run` does the work; the other methods must be called while it runs."""

    def __init__(
        self,
        name: str,
        address: str,
        etcd: Etcd,
        place: Place,
        *,
        jobs: Callable[[], Jobs] = lambda: Worker("lift-manager-term"),
        clock: Callable[[], float] = boottime,
    ) -> None:
        """`name` is that of this machine, `address` is where clients find its manager."""
        self.name = name
        self.active: ActiveTerm | None = None
        """The term of this machine; None while it is a standby. A term that is over stays until `stand_by`."""
        self._address = address
        self._etcd = etcd
        self._place = place
        self._jobs = jobs
        self._clock = clock
        self._term = Term()
        self._taken = asyncio.Event()
        self._wake = asyncio.Event()
        self._worker: Jobs | None = None
        self._answered_at = clock()
        self._trouble = ""
        self._bar = ""

    @property
    def key(self) -> Key | None:
        """The key as it was read last; None before the first answer."""
        return self._term.key

    @property
    def trouble(self) -> str:
        """Why this machine could not take over now; empty while it could."""
        if self._term.key is not None and self._term.key.revision == 0:
            return "etcd holds nothing for this site yet; `lift-manager cluster init` begins it"
        if self._bar:
            return self._bar
        silent_s = self._clock() - self._answered_at
        return self._trouble if self._trouble and silent_s > SILENCE_S else ""

    async def run(self) -> None:
        """Do what the term requires until cancelled."""
        self._worker = worker = self._jobs()
        try:
            while True:
                self._wake.clear()
                for order in self._take(Tick(self._clock())):
                    if order in (Order.LOOK, Order.TAKE, Order.RENEW):
                        self._send(order, worker)
                wait_s = self._term.wake_at - self._clock()
                with suppress(TimeoutError):
                    async with asyncio.timeout(None if math.isinf(wait_s) else max(wait_s, 0.0)):
                        await self._wake.wait()
        finally:
            _ = worker.submit(self._etcd.close)  # nobody waits for it
            worker.stop()

    async def until_active(self) -> ActiveTerm:
        """Return the term once this machine is active."""
        await self._taken.wait()
        assert self.active is not None  # noqa: S101  both are set together
        return self.active

    def leave(self) -> None:
        """Give this term up in good order: it is renewed until `give_up`."""
        self._take(Leave(self._clock()))

    async def give_up(self) -> None:
        """End the term, once nothing of it is left to be written, and let the other machine take the next one at once."""
        active, term = self.active, self._term
        if active is None:
            return
        is_held = term.role in (Role.ACTIVE, Role.LEAVING) and self._clock() < term.until
        active.end()
        self._term = replace(term, role=Role.OVER)
        if is_held and self._worker is not None:
            compare = [has_value(self._place.active, encode_key(active.key))]
            vacant = put(self._place.active, encode_key(Key(0, active.key.epoch)))
            try:
                await self._worker.submit(partial(self._etcd.transact, compare, [vacant]))
            except ClusterError as error:
                _log.warning("cluster: the other machine has to wait until it sees that this one has left: %s", error)

    def stand_by(self) -> None:
        """Watch the key again after `give_up`."""
        left = None if self.active is None else self.active.key.epoch
        self.active = None
        self._taken.clear()
        before = self._term
        self._term = Term(left=left, answered_at=before.answered_at, answering_since=before.answering_since)
        self._wake.set()

    def _take(self, happened: Input) -> tuple[Order, ...]:
        """Step the term, and carry out what concerns this process."""
        self._term, orders = step(self._term, happened)
        if (active := self.active) is None:
            return orders
        if Order.WITHDRAW in orders:
            _log.error(
                "cluster: etcd has not renewed the term of this manager, which withdraws OPEN and releases everything: %s",
                self._trouble or "no answer",
            )
            active.ends.set()
        if Order.RELEASE in orders:
            active.ends.set()
            active.releases.set()
        if Order.FENCE in orders:
            _log.error("cluster: the term of epoch %d is over; nothing is written any more", active.key.epoch)
            active.end()
        return orders

    def _send(self, order: Order, worker: Jobs) -> None:
        sent_at = self._clock()
        self._term, _ = step(self._term, Sent(sent_at))
        known = self._term.key or Key(0)
        place = self._place
        looks = [read(key) for key in (place.active, place.handover, place.solo, place.head)]
        if order is Order.LOOK:
            key, job = known, worker.submit(partial(self._etcd.transact, [], looks))
        else:
            key = self._next_key(known) if order is Order.TAKE else known
            compare = [has_revision(self._place.active, known.revision)]
            if order is Order.TAKE:
                compare.append(has_revision(self._place.solo, 0))
            writes = [put(self._place.active, encode_key(key)), *looks]
            job = worker.submit(partial(self._etcd.transact, compare, writes, looks))
        job.add_done_callback(partial(self._on_answer, order, sent_at, key))

    def _next_key(self, known: Key) -> Key:
        if known.epoch >= HIGHEST_EPOCH:
            raise OverflowError(f"{self._place.active} has epoch {known.epoch}, and a controller knows no higher one")
        return Key(0, known.epoch + 1, self.name, self._address)

    def _on_answer(self, order: Order, sent_at: float, key: Key, job: Future[Result]) -> None:
        self._wake.set()
        if job.cancelled():
            return
        try:
            result = job.result()
            active, requested, solo, head = result.ranges
            found, handover = decode_key(active), decode_handover(requested)
        except ClusterError as error:
            self._trouble = str(error)
            self._take(Unanswered(sent_at, self._clock()))
            return
        self._answered_at, self._trouble = self._clock(), ""
        self._bar = _bar(solo, head)
        is_applied = order is not Order.LOOK and result.succeeded
        was_standby = self._term.role is Role.STANDBY
        self._take(Answered(order, sent_at, self._clock(), found, is_applied, bool(self._bar)))
        if was_standby and self._term.role is not Role.STANDBY:
            self._begin(key)
        elif self.active is not None:
            self.active.renew(self._term)
        if handover is not None:
            self._take_handover(handover, found)

    def _begin(self, key: Key) -> None:
        active = self.active = ActiveTerm(key, self._clock)
        active.renew(self._term)
        if self._term.role is Role.OVER:
            active.end()
        _log.warning("cluster: %s is active in epoch %d", self.name, key.epoch)
        self._taken.set()

    def _take_handover(self, handover: Handover, key: Key) -> None:
        """Accept a handover as the standby, once it could take over; as the active, write nothing any more once it is accepted."""
        if self.active is not None:
            if handover.accepted_by and handover.epoch == self.active.key.epoch and not self.active.over.is_set():
                _log.warning("cluster: %s has requested that %s takes over", handover.by, handover.accepted_by)
                self.active.handed_over_by = handover.by
                self.leave()
                self.active.end()
        elif (
            key.owner
            and handover.epoch == key.epoch
            and not handover.accepted_by
            and self._worker is not None
            and self._clock() >= self._term.ready_at
        ):
            compare = [has_value(self._place.handover, encode_handover(handover))]
            accepted = replace(handover, accepted_by=self.name)
            job = self._worker.submit(
                partial(self._etcd.transact, compare, [put(self._place.handover, encode_handover(accepted))])
            )
            job.add_done_callback(_log_failure)


def _bar(solo: Sequence[Entry], head: Sequence[Entry]) -> str:
    """Return in words why the key must not be taken, whatever becomes of it; empty if it may be."""
    try:
        decided = decode_solo(solo)
        if head:
            decode_head(head[0])
    except ClusterUnusable as error:
        return str(error)
    return "" if decided is None else f"{decided.text}; `lift-manager cluster join` on {decided.machine} ends that"


def _log_failure(job: Future[Result]) -> None:
    if not job.cancelled() and isinstance(error := job.exception(), ClusterError):
        _log.warning("cluster: the handover could not be accepted, and is tried again: %s", error)
