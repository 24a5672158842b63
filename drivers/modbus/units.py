"""The links of one lift: to its controller and, where its map has endpoints, to further devices."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from drivers.clock import suspended_s
from drivers.errors import ACCEPTED, ControllerException
from drivers.modbus.declared_writes import DeclaredWrites
from drivers.modbus.link import Link, LinkState
from drivers.modbus.transactions import Permit
from register_maps import frames
from register_maps.codec import Block, Cell, CommandCodec
from register_maps.frames import Request
from register_maps.words import BIT_TABLES


@dataclass(frozen=True, slots=True)
class Unit:
    """One device: the link to it and its unit id there."""

    link: Link
    unit_id: int


class Units:
    """Every device of one lift, by endpoint; the controller's endpoint is empty."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_fence_at", "_links", "_suspended_before_s", "_suspended_s", "_units")

    def __init__(
        self, controller: Unit, endpoints: Mapping[str, Unit], *, suspended_s: Callable[[], float] = suspended_s
    ) -> None:
        """`endpoints` as the map names them. `suspended_s` returns for how long the computer was suspended."""
        self._units = {"": controller, **endpoints}
        self._links = tuple(dict.fromkeys(unit.link for unit in self._units.values()))
        self._fence_at = math.inf
        self._suspended_s = suspended_s
        self._suspended_before_s = 0.0
        """For how long it was suspended when the fence was set."""

    def fence(self, until: float) -> None:
        """Write nothing from this loop time on, or earlier by the time for which the computer is suspended until then."""
        self._fence_at = until
        self._suspended_before_s = 0.0 if math.isinf(until) else self._suspended_s()

    @property
    def is_fenced(self) -> bool:
        """Whether nothing may be written now."""
        if self._fence_at == math.inf:
            return False
        slept_s = self._suspended_s() - self._suspended_before_s
        return asyncio.get_running_loop().time() + slept_s >= self._fence_at

    def declare(self, commands: Iterable[CommandCodec]) -> None:
        """Allow the links to write these commands, in addition to those that other lifts have declared, and nothing else."""
        declared = tuple(commands)
        for link in self._links:
            if link.declared is None:
                link.declared = DeclaredWrites()
            units = {endpoint: unit.unit_id for endpoint, unit in self._units.items() if unit.link is link}
            link.declared.add(declared, units)

    @property
    def epoch(self) -> int:
        """Rises with every connection to any of the devices; readings of an earlier epoch no longer count."""
        if len(self._links) == 1:
            return self._links[0].epoch
        return sum(link.epoch for link in self._links)

    @property
    def epochs(self) -> dict[str, int]:
        """The epoch of each device, by endpoint."""
        return {endpoint: unit.link.epoch for endpoint, unit in self._units.items()}

    def up_for_s(self, endpoint: str) -> float | None:
        """How long one device has been connected; None while it is not."""
        link = self._units[endpoint].link
        if link.state is not LinkState.UP or link.since is None:
            return None
        return asyncio.get_running_loop().time() - link.since

    def link(self, endpoint: str) -> Link:
        """Return the link to one device."""
        return self._units[endpoint].link

    def unit(self, endpoint: str) -> int:
        """Return the unit id of one device."""
        return self._units[endpoint].unit_id

    def round_trip_s(self, endpoint: str) -> float:
        """How long one device takes to answer; 0 before its first answer."""
        unit = self._units[endpoint]
        return unit.link.stats.round_trip_of(unit.unit_id) or 0.0

    def request(self, block: Block) -> Request:
        """Make the request that reads a block."""
        return _read(block, self.unit(block.endpoint))

    async def cells(self, blocks: Iterable[Block], *, urgent: bool = True) -> dict[Cell, int]:
        """Read these blocks, each once, in the command lane, or in the read lane if not `urgent`."""
        cells: dict[Cell, int] = {}
        for block in dict.fromkeys(blocks):
            link = self.link(block.endpoint)
            payload = await (link.read_urgent if urgent else link.read)(self.request(block))
            if block.table in BIT_TABLES:
                values: tuple[int, ...] = frames.unpack_bits(payload, block.count)
            else:
                values = tuple(int.from_bytes(payload[i : i + 2], "big") for i in range(0, len(payload), 2))
            cells.update(zip(block.cells, values, strict=True))
        return cells

    async def send(self, endpoint: str, request: Request, permit: Permit | None) -> None:
        """Write, unless fenced. An answer that the command is accepted but still in progress counts as its echo."""

        def unless_fenced() -> str | None:
            if self.is_fenced:
                return "this manager may not write to the lift any more"
            return None if permit is None else permit()

        try:
            await self.link(endpoint).write(request, unless_fenced, presses=permit is not None)
        except ControllerException as error:
            if error.code != ACCEPTED:
                raise

    def word_lock(self, endpoint: str) -> asyncio.Lock:
        """Return the lock that prevents other lifts on this link from writing between our read of a shared word and its write."""
        return self.link(endpoint).shared_words


@lru_cache(1024)
def _read(block: Block, unit: int) -> Request:
    """Return the request that reads a block: lifts that are read alike share it, and so do the reads of one block."""
    return frames.read(block.table, block.start, block.count, unit)
