"""Presses that wait until they are written down. Nobody else waits for that: a wish enters the outputs once its row is there."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.driver import Permit, WriteLog
from drivers.modbus.notes import Notes
from drivers.modbus.output import REJECTED_PAUSE_S
from drivers.modbus.presses import Press
from drivers.model import Command

_log = logging.getLogger(__name__)

ROW_WITHIN_S = 3.0
"""So long a press waits for its row. Chosen: a disk that takes longer is stuck, and a robot's client asks again anyhow; with
`LEAVE_WITHIN_S` it bounds how old a wish can be when it is pressed."""


@dataclass(slots=True, eq=False)
class Wish:
    """A press, or the first assertion of a hold, that is not wanted of the outputs yet."""

    command: Command
    permit: Permit
    at: float
    """When it was asked for last."""
    press: Press | None = None
    """None for a hold."""
    again: bool = False
    """A hold that is wanted and on as far as we know, and was found off."""
    timer: asyncio.TimerHandle | None = None


class Rows:
    """The wishes of one lift that wait for their rows: at most one per command."""

    def __init__(
        self,
        log: WriteLog | None,
        notes: Notes,
        *,
        lift: str,
        planned: Callable[[Command], tuple[str, ...]],
        enter: Callable[[Wish], None],
        refused: Callable[[Wish, str], None],
    ) -> None:
        """`planned` gives the frames of a press. A wish with its row goes to `enter`, one without to `refused` with the reason."""
        self._write_log = log
        self._notes = notes
        self._lift = lift
        self._planned = planned
        self._enter = enter
        self._refused = refused
        self._waiting: dict[str, Wish] = {}
        self._not_before: dict[str, float] = {}
        """When holds whose row was refused may ask again."""

    def ask(self, wish: Wish) -> None:
        """Have a wish written down. Where that is done at once, it enters at once."""
        name = wish.command.name
        if self._write_log is None or (wish.press is None and name in self._notes.unpressed):
            self._enter(wish)
            return
        row = self._write_log.before(wish.command, self._planned(wish.command), again=wish.again)
        if row.done():
            self._answered(wish, row)
            return
        self._waiting[name] = wish
        wish.timer = asyncio.get_running_loop().call_later(ROW_WITHIN_S, self._too_late, wish)
        row.add_done_callback(partial(self._told, wish))

    def waiting(self, name: str) -> Wish | None:
        """Return the wish of a command that waits for its row, if there is one."""
        return self._waiting.get(name)

    def may_ask(self, name: str, now: float) -> bool:
        """Whether a hold may be written down: not again at once after that was refused."""
        return now >= self._not_before.get(name, -math.inf)

    def drop(self, name: str) -> Wish | None:
        """Want a command no longer: its wish will not enter, whatever becomes of its row."""
        self._notes.unpressed.discard(name)
        wish = self._waiting.pop(name, None)
        if wish is not None and wish.timer is not None:
            wish.timer.cancel()
        return wish

    def _told(self, wish: Wish, row: asyncio.Future[str | None]) -> None:
        if self._waiting.get(wish.command.name) is wish:
            self.drop(wish.command.name)
            self._answered(wish, row)

    def _too_late(self, wish: Wish) -> None:
        self.drop(wish.command.name)
        self._refuse(wish, f"not sent: it could not be written down within {ROW_WITHIN_S:g} s; see to the disk")

    def _answered(self, wish: Wish, row: asyncio.Future[str | None]) -> None:
        if row.cancelled():
            reason: str | None = "not sent: it was not written down, because the journal has ended"
        elif (bug := row.exception()) is not None:
            _log.error("%s: a bug in the journal; %s is not pressed", self._lift, wish.command, exc_info=bug)
            reason = f"not sent: it was not written down: {bug}"
        else:
            reason = row.result()
        if reason is not None:
            self._refuse(wish, reason)
            return
        if wish.press is None:
            self._notes.unpressed.add(wish.command.name)
        self._not_before.pop(wish.command.name, None)
        self._enter(wish)

    def _refuse(self, wish: Wish, reason: str) -> None:
        name = wish.command.name
        if wish.press is None:
            if name not in self._not_before:
                _log.warning("%s: %s is not asserted: %s", self._lift, wish.command, reason)
            self._not_before[name] = asyncio.get_running_loop().time() + REJECTED_PAUSE_S
        self._refused(wish, reason)
