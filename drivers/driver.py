"""The seam between the manager and one lift, whatever the lift speaks."""

from __future__ import annotations

from asyncio import Future
from collections.abc import Callable
from typing import Protocol

from drivers.model import Capabilities, Command, LiftReading, Outcome, SignalValue, Written

Permit = Callable[[], str | None]
"""Called immediately before the bytes of a press leave, and before that as often as anybody wants to know; a text refuses it and says why."""


def always() -> str | None:
    """Refuse nothing."""
    return None


class WriteLog(Protocol):
    """Writes down what is told to one lift. Never raises, and only `before` has an answer to wait for."""

    def before(self, command: Command, frames: tuple[str, ...], *, again: bool = False) -> Future[str | None]:
        """Note that this is about to be pressed; tell when that is written down: None, or why it may not be pressed.

        `again` says that it is a hold that was found off, and is pressed again for the same request.
        `frames` are the writes it will be, as far as they are known before words that others write too are read.
        """
        ...

    def wrote(self, written: Written) -> None:
        """Note what reached the wire, or may have. Of what is written again and again only changes are noted."""
        ...


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

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        """Return every signal of the map as it was read last, with its age at the monotonic time `now`; decoded when asked for."""
        ...

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError: then there is no reading, and nothing old stands in for it."""
        ...

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled."""
        ...

    def press(self, command: Command, permit: Permit, begins: Permit = always) -> Future[Outcome]:
        """Give a command once. It is never repeated, whatever happens to it.

        `begins` is asked with the permit when bytes leave, but no more once the press was answered: what is on then may stay.
        """
        ...

    def hold(self, command: Command, permit: Permit, *, begin: bool = True) -> None:
        """Keep a held command on, or renew it; it falls `max_hold_s` after the last call.

        Where it may not `begin`, only what is on is renewed, and what was adopted, or is only kept, and is found off later
        stays off.
        """
        ...

    def keep(self, command: Command) -> None:
        """Leave a hold on though nobody asks for it any more.

        It is not renewed by this. One that is found off stays off until `hold` may `begin` it; one that was not pressed yet is
        not pressed.
        """
        ...

    def adopt(self, command: Command, permit: Permit) -> None:
        """Keep what was on for this session before the process began, if the first look at the lift finds it on.

        To be called before the lift is read for the first time. What is found off is at rest: nothing is pressed because of
        this, a call least of all. What is found on is a hold, or a call, like any other: `given`, refreshed, limited; but it is
        pressed again only once `hold` may `begin` it.
        """
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

    def at_rest(self, command: Command) -> bool:
        """Whether nothing of it is on or wanted, and that is verified; True for a command that the map does not have."""
        ...

    async def release_all(self) -> None:
        """Let everything go and return once it is verified; while a controller is away it waits, so bound it."""
        ...
