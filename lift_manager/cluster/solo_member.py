"""One machine that goes on alone: looks at etcd all the time, and ends its term as soon as another manager is seen to be active."""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import Future
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

from drivers.clock import boottime
from drivers.thread import Worker
from lift_manager.cluster.content import Place, Solo, decode_key, decode_solo, encode_solo
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.etcd import Etcd, Result, has_revision, put, read
from lift_manager.cluster.member import ActiveTerm
from lift_manager.cluster.solo import Found, Mark, SoloOrder, Watch, step
from lift_manager.cluster.term import Key, Sent, Tick, Unanswered
from lift_manager.cluster.term import Term as TermOfActive
from lift_manager.store.committer import Jobs

_log = logging.getLogger(__name__)


class SoloMember:
    """Does for a machine that goes on alone what `Member` does for one of a pair."""

    def __init__(
        self,
        solo: Solo,
        address: str,
        etcd: Etcd,
        place: Place,
        keep: Callable[[Solo], None],
        *,
        jobs: Callable[[], Jobs] = lambda: Worker("lift-manager-term"),
        clock: Callable[[], float] = boottime,
    ) -> None:
        """`keep` writes the decision to the disk when what it says changes, and may raise ClusterError; it may block."""
        self.name = solo.machine
        self.active: ActiveTerm | None = None
        """The term of this machine; None while it is none. A term that is over stays until `stand_by`."""
        self.key: Key | None = None
        """The key as it was read last; None before the first answer."""
        self._solo = solo
        self._address = address
        self._etcd = etcd
        self._place = place
        self._keep = keep
        self._jobs = jobs
        self._clock = clock
        self._watch = Watch(solo.revision, clock(), solo.contested)
        self._mark = Mark.MISSING
        self._taken = asyncio.Event()
        self._wake = asyncio.Event()
        self._worker: Jobs | None = None

    @property
    def trouble(self) -> str:
        """Why this machine commands no lift now; empty while it does."""
        if self._watch.is_active:
            return ""
        if self._watch.is_contested:
            return (
                f"{self._solo.text}, but another manager was active since. While that one is, this one stands by; once it has ended,"
                " this one goes on. `lift-manager cluster join` ends that, with `--discard` if the other one is to go on"
            )
        return f"{self._solo.text}; it looks first whether another manager is active"

    async def run(self) -> None:
        """Look until cancelled."""
        self._worker = worker = self._jobs()
        try:
            while True:
                self._wake.clear()
                for order in self._take(Tick(self._clock())):
                    if order is not SoloOrder.FENCE:
                        self._send(order, worker)
                wait_s = self._watch.wake_at - self._clock()
                with suppress(TimeoutError):
                    async with asyncio.timeout(None if math.isinf(wait_s) else max(wait_s, 0.0)):
                        await self._wake.wait()
        finally:
            _ = worker.submit(self._etcd.close)  # nobody waits for it
            worker.stop()

    async def until_active(self) -> ActiveTerm:
        """Return the term once this machine may command the lifts."""
        await self._taken.wait()
        assert self.active is not None  # noqa: S101  both are set together
        return self.active

    async def give_up(self) -> None:
        """End the term, once nothing of it is left to be written. The next one begins after another look, as after a start."""
        if self.active is not None:
            self.active.end()
        self._watch = replace(self._watch, is_active=False, known_at=self._clock())

    def stand_by(self) -> None:
        """Begin another term after `give_up` as soon as that is allowed."""
        self.active = None
        self._taken.clear()
        self._begin_if_allowed()

    def _take(self, happened: Tick | Found | Unanswered) -> tuple[SoloOrder, ...]:
        was_contested = self._watch.is_contested
        self._watch, orders = step(self._watch, happened)
        if SoloOrder.FENCE in orders and self.active is not None:
            why = "another manager was active" if self._watch.is_contested else "this process was stopped for too long"
            _log.error("cluster: this machine goes on alone, and writes nothing for now: %s", why)
            self.active.end()
        if self._watch.is_contested is not was_contested:
            self._remember()
        self._begin_if_allowed()
        return orders

    def _begin_if_allowed(self) -> None:
        if not self._watch.is_active:
            return
        if self.active is None:
            self.active = ActiveTerm(
                Key(0, self._solo.epoch, self.name, self._address), self._clock, alone=self._solo.text
            )
            _log.warning("cluster: %s; it commands the lifts from now on", self._solo.text)
            self._taken.set()
        self.active.renew(TermOfActive(until=self._watch.until))

    def _remember(self) -> None:
        """Write down whether silence of etcd is a permission, for a start of this machine without etcd."""
        self._solo = replace(self._solo, contested=self._watch.is_contested, revision=self._watch.revision)
        if self._worker is not None:
            self._worker.submit(partial(self._keep, self._solo)).add_done_callback(_log_failure)

    def _send(self, order: SoloOrder, worker: Jobs) -> None:
        sent_at, place = self._clock(), self._place
        self._watch, _ = step(self._watch, Sent(sent_at))
        looks = [read(place.active), read(place.solo)]
        if order is SoloOrder.LOOK:
            job = worker.submit(partial(self._etcd.transact, [], looks))
        else:
            compare = [has_revision(place.active, self._watch.revision), has_revision(place.solo, 0)]
            writes = [put(place.solo, encode_solo(self._solo)), *looks]
            job = worker.submit(partial(self._etcd.transact, compare, writes, looks))
        job.add_done_callback(partial(self._on_answer, sent_at))

    def _on_answer(self, sent_at: float, job: Future[Result]) -> None:
        self._wake.set()
        if job.cancelled():
            return
        try:
            active, solo = job.result().ranges
            key, found = decode_key(active), decode_solo(solo)
        except ClusterError:
            self._take(Unanswered(sent_at, self._clock()))
            return
        self.key = key
        mark = Mark.MISSING if found is None else Mark.OWN if found.id == self._solo.id else Mark.OTHER
        if mark is not self._mark:
            words = {
                Mark.MISSING: "no machine goes on alone",
                Mark.OWN: "this one does",
                Mark.OTHER: "the other one does",
            }
            _log.warning("cluster: this machine goes on alone; etcd answers, and says that %s", words[mark])
            self._mark = mark
        self._take(Found(sent_at, self._clock(), key.revision, mark))


def _log_failure(job: Future[None]) -> None:
    if not job.cancelled() and isinstance(error := job.exception(), ClusterError):
        _log.error("cluster: %s", error)
