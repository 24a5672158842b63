"""The seam between the manager and one lift, whatever the lift speaks."""

from __future__ import annotations

from asyncio import Future
from collections.abc import Callable
from typing import Protocol

from drivers.model import Capabilities, Command, LiftReading, Outcome

Permit = Callable[[], str | None]
"""Called immediately before the bytes of a press leave; a text refuses it and says why."""


class LiftDriver(Protocol):
    """One lift as an object: what it says and what it can be told.

    `press`, `hold` and `let_go` only note the wish and return at once; `run` carries them out.
    """

    @property
    def capabilities(self) -> Capabilities:
        """What this lift can say and be told."""
        ...

    @property
    def source(self) -> str:
        """Where it is, for messages: controller name and address."""
        ...

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError: then there is no reading, and nothing old stands in for it."""
        ...

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled."""
        ...

    def press(self, command: Command, permit: Permit) -> Future[Outcome]:
        """Give a command once. It is never repeated, whatever happens to it."""
        ...

    def hold(self, command: Command, permit: Permit) -> None:
        """Keep a held command on, or renew it; it falls `max_hold_s` after the last call."""
        ...

    def let_go(self, command: Command) -> None:
        """Release a hold or a press that is still on; repeated until verified or the controller is gone."""
        ...

    def given(self, command: Command) -> bool:
        """Whether a press or hold is wanted and not let go; a call that a controller forgot no longer is."""
        ...

    def held(self, command: Command) -> bool:
        """Whether this hold is on and verified."""
        ...

    async def release_all(self) -> None:
        """Let everything go and return once it is verified; while a controller is away it waits, so bound it."""
        ...
