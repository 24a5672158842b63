"""The way between the adapter and the manager, as long as it likes to be, and broken when told so."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random

from lift_manager.plain.rmf import SiteView
from lift_manager.rmf.port import UNREACHABLE, Answer, Manager, ManagerListener, ManagerRequest
from tests.support.rmf.network import Channel

GIVES_UP_S = 0.3
"""After so long an adapter beside the manager stops waiting for an answer. Chosen: short, so that doubts are many."""


class Way:
    """Between an adapter (`ManagerListener`) and a manager, with a delay of its own for each message. Implements `Manager` and `ManagerListener`.

    While it is cut nothing comes through. What was under way has reached the manager, or not: nobody knows.
    """

    def __init__(self, dice: Random, most_s: float) -> None:
        """`most_s` 0: the manager is in the same process."""
        self._dice = dice
        self._most_s = most_s
        self.listener: ManagerListener | None = None
        """The adapter; None while there is none."""
        self._manager: Manager | None = None
        self._up: Channel[ManagerRequest] = Channel(dice, most_s, self._pass_on)
        self._down: Channel[Callable[[], None]] = Channel(dice, most_s, _call)
        self._cut = ""
        self._unanswered: list[ManagerRequest] = []
        self.asked = 0

    def connect(self, manager: Manager) -> None:
        """Reach a manager from here on; whoever was asked before answers no more."""
        self._manager = manager

    def cut(self, reason: str) -> None:
        """Let nothing through. The adapter hears of it at once, and each of its questions fails some time later."""
        self._cut = reason
        self._down.cut()
        if self._dice.random() < 0.5:
            self._up.cut()
        if self.listener is not None:
            self.listener.on_manager_lost(reason, _now())
            for asked in self._unanswered:
                self._fail(asked)
        self._unanswered.clear()

    def mend(self) -> None:
        """Let things through again. The next news of the manager comes by itself."""
        self._cut = ""

    def forget(self) -> None:
        """Lose the adapter with all that was under way to it."""
        self.listener = None
        self._down.cut()
        self._unanswered.clear()

    # -- the adapter's side

    def send(self, asked: ManagerRequest) -> None:
        self.asked += 1
        if self._cut:
            self._fail(asked)
            return
        self._unanswered.append(asked)
        if self._most_s:
            self._up.send(asked)
        else:
            self._pass_on(asked)

    # -- the manager's side

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        self._back(lambda: None if self.listener is None else self.listener.on_site(site, asked_at, _now()))

    def on_answer(self, answer: Answer, now: float) -> None:
        if answer.request not in self._unanswered:
            return  # it was asked by an adapter that is no more, or given up
        self._back(lambda: self._deliver(answer))

    def on_manager_lost(self, reason: str, now: float) -> None:
        self._back(lambda: None if self.listener is None else self.listener.on_manager_lost(reason, _now()))

    def _deliver(self, answer: Answer) -> None:
        if self.listener is not None and answer.request in self._unanswered:
            self._unanswered.remove(answer.request)
            self.listener.on_answer(answer, _now())

    def _pass_on(self, asked: ManagerRequest) -> None:
        if self._manager is not None:
            self._manager.send(asked)

    def _back(self, call: Callable[[], None]) -> None:
        if self._cut:
            return
        if self._most_s:
            self._down.send(call)
        else:
            call()

    def _fail(self, asked: ManagerRequest) -> None:
        listener = self.listener

        def say() -> None:
            if listener is not None and listener is self.listener:
                listener.on_answer(
                    Answer(asked, accepted=False, code=UNREACHABLE, reason=self._cut or "no answer"), _now()
                )

        asyncio.get_running_loop().call_later(self._dice.uniform(0.0, GIVES_UP_S), say)


def _call(call: Callable[[], None]) -> None:
    call()


def _now() -> float:
    return asyncio.get_running_loop().time()
