"""Detects other clients that write our outputs: reads them back from time to time and compares them with what we wrote last.

A foreign press that two looks show is reported and released: a button left pressed is a hazard. While it lasts or comes back it is released
once in `FIGHT_S` at most, because pressing and releasing against somebody else makes a door flap.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from drivers.errors import DriverError
from drivers.modbus.capabilities import KINDS, LiftSettings
from drivers.modbus.output import FIGHT_S, MOST_PRESSES, Cells, matches, read_values
from drivers.modbus.outputs import Outputs
from drivers.modbus.read_plan import plan_reads
from drivers.modbus.steps import Phase
from drivers.modbus.units import Units
from register_maps.codec import Block, Cell, Codec, CommandCodec, Point

_log = logging.getLogger(__name__)

SECOND_LOOK_S = 0.3
"""From a look that shows a difference to the one that decides. Chosen: longer than the cycle of a PLC, which may show a write late,
and shorter than the pause between two refreshes of ours."""
HELD_LOOK_S = 0.5
"""How often our outputs are compared while a hold is refreshed. Chosen: between two refreshes; RMF and the workshop's adapter look once
a second."""
QUIET_LOOKS = 5
QUIET_S = 10.0
"""After so many looks without a difference, and so long, the other client has stopped writing. Chosen: occasional writes are one episode."""
UNEVEN = math.sqrt(5) / 2
"""The pause is so many times `look_s`. An irrational factor: the looks do not fall into step with our refreshes, which would hide what
happens between them. All pauses are the same: pauses that vary about a mean stay in step with it."""
SHARE = 20
"""The looks use at most a twentieth of the link, however slow the controller is. Chosen."""


@dataclass(frozen=True, slots=True)
class _Difference:
    """The difference that one look has found at one output."""

    stamp: tuple[int, ...]
    """How often its cells had been written by us."""
    code: int | None
    """What we wrote last; None for rest."""
    text: str
    """Printed address, the value read and the value we wrote."""


@dataclass(frozen=True, slots=True)
class _TimedNotice:
    """A notice, and the time from which it may be given."""

    text: str
    name: str = ""
    """The hold that was dropped, if the notice is about one."""
    at: float = -math.inf
    """When it was found: only a later reading shows whether a watchdog was the reason."""


class ForeignWriteCheck:
    """Compares the outputs of one lift with what the driver wrote, in the read lane: a command waits for one answer at most."""

    def __init__(
        self,
        codec: Codec,
        outputs: Outputs,
        units: Units,
        settings: LiftSettings,
        *,
        is_unread: Callable[[], bool],
        is_tripped: Callable[[], bool],
        clear: Callable[[str], None],
    ) -> None:
        """`is_unread` tells whether a connection is new, `is_tripped` whether the lift reports that a watchdog released our outputs.

        `clear` releases an output that somebody else has pressed.
        """
        self._outputs = outputs
        self._units = units
        self._every_s = settings.look_s
        self._is_unread = is_unread
        self._is_tripped = is_tripped
        self._clear = clear
        self._cleared_at: dict[str, float] = {}
        """When outputs that somebody else had pressed were last released."""
        self._commands, self._blocks = _plan_look(
            codec, outputs.names, settings.max_registers_per_read, settings.max_bits_per_read
        )
        self._refreshed = [name for name in self._commands if outputs.output(name).is_looked_at_first]
        self._writes: dict[Cell, int] = {}
        """Starts and ends of our writes, counted together: odd while a write is under way."""
        self._quiet: dict[str, tuple[int, float]] = {}
        """Outputs that somebody else writes: the looks since the last difference, and its time."""
        self._fights: Collection[str] = ()
        """Holds that are dropped too often, and were reported for it."""
        self.notices: list[_TimedNotice] = []
        """Notices that wait for a reading, oldest first."""

    @property
    def has_work(self) -> bool:
        """Whether there are outputs to compare."""
        return bool(self._blocks) and not math.isinf(self._every_s)

    def take_notices(self, read_at: float) -> tuple[str, ...]:
        """Return the notices that go with a reading requested at `read_at`, each once."""
        early = [notice for notice in self.notices if notice.at > read_at]
        notices = [notice for notice in self.notices if notice.at <= read_at]
        self.notices[:] = early
        if self._is_tripped():
            # the lift itself reports what released its outputs
            for name in [notice.name for notice in notices if notice.name]:
                self._quiet.pop(name, None)
            notices = [notice for notice in notices if not notice.name]
        return tuple(notice.text for notice in notices)

    def note(self, text: str) -> None:
        """Give a notice with the next reading."""
        self.notices.append(_TimedNotice(text))

    def count_write(self, cells: Iterable[Cell]) -> None:
        """Count the start or the end of a write of ours to these cells."""
        for cell in cells:
            self._writes[cell] = self._writes.get(cell, 0) + 1

    async def run(self, wake: Callable[[], None]) -> None:
        """Look until cancelled; call `wake` when an output may be due."""
        looks = 1
        while True:
            holds = any(self._outputs.output(name).phase is Phase.ON for name in self._refreshed)
            every_s = min(self._every_s, HELD_LOOK_S) if holds else self._every_s
            await asyncio.sleep(UNEVEN * max(every_s, SHARE * looks * self._look_s()))
            looks = 1
            try:
                looks = await self._look_twice(wake)
            except DriverError as error:
                _log.debug("%s: could not read our outputs back: %s", self._units.link("").name, error)

    def _look_s(self) -> float:
        """Return how long a look takes."""
        return sum(self._units.round_trip_s(block.endpoint) for block in self._blocks)

    async def _look_twice(self, wake: Callable[[], None]) -> int:
        """Look, and look again if something differs. Returns the number of looks."""
        first = await self._look()
        self._count_quiet(first)
        for name, found in first.items():
            if found is not None and found.code is not None and not self._is_tripped():
                # it was read as on before: one look is enough
                self._handle_drop(name, found.text)
                wake()
        differs = {name: found for name, found in first.items() if found is not None and found.code is None}
        if not differs:
            return 1
        await asyncio.sleep(SECOND_LOOK_S)
        second = await self._look()
        for name, found in differs.items():
            again = second.get(name)
            if again is not None and again.stamp == found.stamp:
                self._report_foreign(name, again)
        return 2

    async def _look(self) -> dict[str, _Difference | None]:
        """Return the differences by output name, None where there is none. Outputs written meanwhile are omitted."""
        if self._is_unread():
            return {}
        standing = {
            name: self._outputs.output(name) for name in self._commands if self._outputs.output(name).is_settled
        }
        before = {name: self._stamp(name) for name in standing}
        cells = await self._units.cells(self._blocks, urgent=False)
        found: dict[str, _Difference | None] = {}
        for name, output in standing.items():
            stamp = before[name]
            if self._is_unread() or not output.is_settled or stamp != self._stamp(name) or any(n % 2 for n in stamp):
                continue
            code = output.code if output.phase is Phase.ON else None
            if matches(output.codec, cells, code):
                found[name] = None
            else:
                found[name] = _Difference(stamp, code, _describe_difference(output.codec, cells, code))
        return found

    def _stamp(self, name: str) -> tuple[int, ...]:
        return tuple(self._writes.get(point.cell, 0) for point in self._commands[name].points)

    def _count_quiet(self, found: Mapping[str, _Difference | None]) -> None:
        now = asyncio.get_running_loop().time()
        for name in [name for name in self._quiet if name in found and found[name] is None]:
            looks, since = self._quiet[name]
            self._quiet[name] = looks + 1, since
            if looks + 1 >= QUIET_LOOKS and now - since >= QUIET_S:
                del self._quiet[name]
                self.notices.append(_TimedNotice(f"{self._printed(name)} reads what we wrote again"))

    def _report_foreign(self, name: str, difference: _Difference) -> None:
        now = asyncio.get_running_loop().time()
        self._report(name, _TimedNotice(f"somebody else writes {name} {difference.text}; {self._try_clear(name, now)}"))

    def compares(self, name: str) -> bool:
        """Whether only our writes decide what the points of this output hold."""
        return name in self._commands

    def report_found_off(self, name: str, cells: Cells) -> None:
        """Report a hold that was on and was found off before its refresh."""
        output = self._outputs.output(name)
        self._report_found_off(name, _describe_difference(output.codec, cells, output.code))

    def _handle_drop(self, name: str, where: str) -> None:
        """Press a hold again that was found off between two refreshes, or only refresh it where its map explains why it is off."""
        output, now = self._outputs.output(name), asyncio.get_running_loop().time()
        if output.was_cleared_by_device(now):
            output.refresh_at = now
            return
        is_declared = not output.is_only_kept
        output.handle_found_off(now, pause_s=0.0, excused=False)
        if is_declared:
            self._report_found_off(name, where)

    def _report_found_off(self, name: str, where: str) -> None:
        text = f"{name} was released by the controller or by somebody else {where}"
        self._report(name, _TimedNotice(text, name, asyncio.get_running_loop().time()))

    def _report(self, name: str, notice: _TimedNotice) -> None:
        """Report once that somebody else writes an output, until that has ended."""
        if name not in self._quiet:
            self.notices.append(notice)
        self._quiet[name] = 0, asyncio.get_running_loop().time()
        self.report_fights()

    def _try_clear(self, name: str, now: float) -> str:
        """Release an output that somebody else has pressed, if it is time. Returns the text about it."""
        free_at = self._cleared_at.get(name, -math.inf) + FIGHT_S
        if now < free_at:
            return (
                f"it was released not long ago, and is released again in {math.ceil(free_at - now)} s at the earliest"
            )
        self._cleared_at[name] = now
        self._clear(name)
        return f"it is released, once in {FIGHT_S:g} s at most"

    def report_fights(self) -> None:
        """Report each hold that is dropped too often, once until it is released."""
        known = {name for name in self._fights if self._outputs.output(name).dropped_at}
        fights = {name for name in self._outputs.names if self._outputs.output(name).is_yielding}
        for name in sorted(fights - known):
            self.notices.append(
                _TimedNotice(
                    f"{self._printed(name)} was released {MOST_PRESSES + 1} times within {FIGHT_S:g} s by the controller or by somebody"
                    f" else; it is pressed again once in {FIGHT_S:g} s at most: find out who else writes there"
                )
            )
        self._fights = tuple(known | fights)

    def _printed(self, name: str) -> str:
        return f"{name} at {', '.join(self._outputs.output(name).spec.addresses)}"


@lru_cache(maxsize=KINDS)
def _plan_look(
    codec: Codec, outputs: tuple[str, ...], max_registers: int, max_bits: int
) -> tuple[dict[str, CommandCodec], tuple[Block, ...]]:
    """Return the commands of these outputs that are compared, and the blocks to read for that. Lifts that are alike share them."""
    commands = {name: codec.commands[name] for name in outputs if _is_ours(codec.commands[name], codec)}
    points = [point for command in commands.values() for point in command.read_points]
    return commands, plan_reads(points, codec.served, max_registers=max_registers, max_bits=max_bits)


def _is_ours(command: CommandCodec, codec: Codec) -> bool:
    """Whether only our writes decide what the points of a command hold: no lamp, no signal and no timer of the device."""
    if command.spec.ends_itself or command.spec.is_heartbeat or command.shows_lamp or not command.read_points:
        return False
    return not any(
        _overlaps(point, signal_point) for point in command.read_points for signal_point in codec.signal_points
    )


def _overlaps(one: Point, other: Point) -> bool:
    return one.cell == other.cell and bool(one.mask << one.low & other.mask << other.low)


def _describe_difference(command: CommandCodec, cells: Cells, code: int | None) -> str:
    """Describe the first point that differs: its address, the value read and the value we wrote."""
    expected, found = command.encode(code), dict(read_values(command, cells))
    addresses = command.spec.addresses
    for place, point in enumerate(command.points):
        if found.get(point) != expected[point]:
            return f"at {addresses[place]}: it reads {found.get(point)}, we wrote {expected[point]}"
    return f"at {', '.join(addresses)}"
