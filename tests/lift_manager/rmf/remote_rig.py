"""A scripted manager and a recording listener for the tests of `remote_manager`."""

import json
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from lift_manager.plain.http import Address, Server
from lift_manager.plain.rmf import HeldBy, LiftView, SiteView
from lift_manager.rmf.port import Answer
from lift_manager.rmf.remote_manager import Pace, RemoteManager
from tests.support.scripted_http import WITHIN_S, Asked, Script, Scripted, Wire, problem, said

KEY = "lm_rmf_abcdefgh"
CALM = Pace(poll_timeout_s=WITHIN_S, request_timeout_s=WITHIN_S, first_retry_s=0.01, longest_retry_s=0.02)
"""Nothing is too late, however busy the computer is."""
BRISK = Pace(poll_timeout_s=0.3, request_timeout_s=0.3, stream_timeout_s=0.3, first_retry_s=0.01, longest_retry_s=0.02)
"""For tests in which something is."""

LIFT = LiftView(
    lift="east",
    name="Lift1",
    floors={"L1": "Level 1", "L2": "Level 2"},
    live=True,
    reason="",
    age_s=0.1,
    max_age_s=0.15,
    floor="L1",
    standing=True,
    destination=None,
    door="closed",
    motion="stopped",
    mode="normal",
    robot_mode_on=None,
    holder=HeldBy("rmf", "fleet/amr-7"),
    ending=False,
    fire_latched=False,
    waiting_for="",
    keeps_off="",
)
SITE = SiteView("boot", 7, (LIFT,), 3.0)
RARELY = replace(SITE, lifts=(replace(LIFT, max_age_s=1e6),))
"""Its lift may be read so rarely that nothing is asked but for news; see `PATIENT`."""
PATIENT = replace(CALM, max_poll_gap_s=1e6, stream_timeout_s=WITHIN_S)

STREAM = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream; charset=utf-8\r\n\r\n"


def event(event_id: str) -> bytes:
    return f'id: {event_id}\nevent: state\ndata: {{"event": "state"}}\n\n'.encode()


@dataclass
class Manager:
    """Answers as a manager does, but where a test puts another script for a path, or for the last part of one."""

    site: SiteView = SITE
    scripts: dict[str, Script] = field(default_factory=dict)

    def __call__(self, asked: Asked, wire: Wire) -> None:
        script = self.scripts.get(asked.path) or self.scripts.get(asked.path.rpartition("/")[2])
        if script is not None:
            script(asked, wire)
        elif asked.method == "POST":
            wire.send(said(200, {"boot": self.site.boot, "event": self.site.event}))
        elif asked.path == "/api/v1/rmf":
            wire.send(said(200, asdict(self.site)))
        else:
            wire.send(problem(404, "no_such_path"))


@dataclass(frozen=True)
class Received:
    """Calls of `on_site`."""

    site: SiteView
    asked_at: float
    now: float


@dataclass(frozen=True)
class Lost:
    """Calls of `on_manager_lost`."""

    reason: str


class RecordingListener:
    """Implements `port.ManagerListener`, in the thread of the test: what was handed over is run when the test wants to hear more."""

    def __init__(self) -> None:
        self.inbox: queue.Queue[Callable[[], None]] = queue.Queue()
        self._said: list[Received | Answer | Lost] = []

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        self._said.append(Received(site, asked_at, now))

    def on_answer(self, answer: Answer, now: float) -> None:
        self._said.append(answer)

    def on_manager_lost(self, reason: str, now: float) -> None:
        self._said.append(Lost(reason))

    def next(self) -> Received | Answer | Lost:
        while not self._said:
            self.inbox.get(timeout=WITHIN_S)()
        return self._said.pop(0)

    def next_site(self) -> Received:
        """Pass over answers, and fail where the manager is lost."""
        while isinstance(found := self.next(), Answer):
            pass
        assert isinstance(found, Received), found
        return found

    def until_site(self) -> Received:
        """Pass over everything else: where something may be too late, a busy computer makes it so."""
        while not isinstance(found := self.next(), Received):
            pass
        return found

    def next_loss(self) -> str:
        """Pass over what was heard before."""
        while not isinstance(found := self.next(), Lost):
            pass
        return found.reason

    def next_answer(self) -> Answer:
        """Pass over everything else."""
        while not isinstance(found := self.next(), Answer):
            pass
        return found

    def all_until(self, at: float) -> list[Received | Answer | Lost]:
        """Return what comes until this monotonic time."""
        while (left := at - time.monotonic()) > 0:
            try:
                self.inbox.get(timeout=left)()
            except queue.Empty:
                break
        found, self._said = self._said, []
        return found


@contextmanager
def connected(port: int, pace: Pace = CALM, *, key: str = KEY) -> Iterator[tuple[RemoteManager, RecordingListener]]:
    """An adapter's way to whoever answers at this port, and what is heard over it."""
    remote, listener = RemoteManager(Server(Address("127.0.0.1", port), key), pace), RecordingListener()
    remote.start(listener, listener.inbox.put)
    try:
        yield remote, listener
    finally:
        remote.close()


@contextmanager
def scripted_manager(manager: Script, pace: Pace = CALM) -> Iterator[tuple[Scripted, RemoteManager, RecordingListener]]:
    """A manager, and an adapter's way to it."""
    with Scripted(manager) as server, connected(server.port, pace) as (remote, listener):
        yield server, remote, listener


def spoiled(**changes: Any) -> bytes:
    """Return an answer with something wrong in it."""
    return json.dumps({**asdict(SITE), **changes}).encode()
