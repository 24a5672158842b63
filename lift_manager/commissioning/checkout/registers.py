"""The registers of one lift, read without a manager: nothing is written, and no watchdog is fed."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence

from drivers.modbus.read_plan import plan_reads
from lift_manager.commissioning.checkout.record import ConstantWord, Fingerprint, Latency, ServedRange, now
from lift_manager.commissioning.prober import Prober
from register_maps.codec import Block, Codec, Point, Unlisted, Value
from register_maps.schema import LinkDefaults
from register_maps.words import BIT_TABLES, Table

LOOKS = 3
"""How often a word is read that is to count as constant. Chosen: with a pause between, a running counter has moved on."""
LOOK_AGAIN_S = 1.0
"""Chosen: counters of a controller move at least once a second."""
SAMPLES = 60
"""How many answers are timed. Chosen: enough for a 99th percentile that is not the worst of a handful."""


class ReadFailed(Exception):
    """The controller did not answer as it should; the text says what came."""


class Registers:
    """Reads signals and outputs of one lift by their points."""

    def __init__(self, codec: Codec, probers: Mapping[str, tuple[Prober, int]], limits: LinkDefaults) -> None:
        """`probers` are the connection and the unit id of the controller (empty name) and of every endpoint."""
        self.codec = codec
        self._limits = limits
        self._probers = probers
        signals = codec.signal_points
        outputs = tuple(point for command in codec.commands.values() for point in command.read_points)
        self._blocks = plan_reads(
            [*signals, *outputs],
            codec.served,
            max_registers=limits.max_registers_per_read,
            max_bits=limits.max_bits_per_read,
        )
        self.took_s: list[float] = []

    async def look(self) -> Registered:
        """Read everything once. Raises ReadFailed and ConnectFailed."""
        image = self.codec.empty_image()
        for block in self._blocks:
            values = await self._read(block)
            space = Point(block.table, block.start, endpoint=block.endpoint).space
            image[space][block.start : block.start + block.count] = values
        return Registered(self.codec, image)

    async def fingerprint(self, *, probe_identity: bool = False) -> Fingerprint:
        """Return what can be known of the controller by reading the ranges of its map, and by asking what it is.

        Raises ReadFailed and ConnectFailed.
        """
        commanded = (point for command in self.codec.commands.values() for point in command.points)
        mapped = {(point.space, point.address) for point in (*self.codec.signal_points, *commanded)}
        seen: dict[tuple[str, int], set[int]] = {}
        served: list[ServedRange] = []
        blocks = list(self._served_blocks())
        for number in range(LOOKS):
            if number:
                await asyncio.sleep(LOOK_AGAIN_S)
            for space, unit, block in blocks:
                prober, _ = self._probers[block.endpoint]
                answer = await prober.read(block.table, block.start, block.count, unit=unit)
                self.took_s.append(answer.took_s)
                if answer.values is None:
                    continue
                if number == 0:
                    last = block.start + block.count - 1
                    served.append(ServedRange(table=space, first=block.start, last=last, unit=unit))
                for address, value in enumerate(answer.values, start=block.start):
                    seen.setdefault((space, address), set()).add(value)
        units = {space: unit for space, unit, _ in blocks}
        constants = tuple(
            ConstantWord(table=space, address=address, value=next(iter(values)), unit=units[space])
            for (space, address), values in sorted(seen.items())
            if len(values) == 1 and (space, address) not in mapped
        )
        while len(self.took_s) < SAMPLES:
            await self.look()
        prober, unit = self._probers[""]
        identity = dict((await prober.identify(unit=unit)).texts) if probe_identity else {}
        return Fingerprint(
            served=_joined(served),
            constants=constants,
            latency=latency(self.took_s),
            identity=identity,
            taken_at=now(),
        )

    async def _read(self, block: Block) -> tuple[int, ...]:
        prober, unit = self._probers[block.endpoint]
        answer = await prober.read(block.table, block.start, block.count, unit=unit)
        self.took_s.append(answer.took_s)
        if answer.values is None:
            what = answer.trouble if answer.exception is None else f"exception {answer.exception:02}"
            last = block.start + block.count - 1
            raise ReadFailed(f"{prober.peer}, unit {unit}, {block.table} {block.start} to {last}: {what}")
        return answer.values

    def _served_blocks(self) -> Sequence[tuple[str, int, Block]]:
        found: list[tuple[str, int, Block]] = []
        for space, ranges in self.codec.served.items():
            endpoint, _, table_name = space.rpartition("/")
            table = Table(table_name)
            limits = self._limits
            most = limits.max_bits_per_read if table in BIT_TABLES else limits.max_registers_per_read
            for span in ranges:
                for start in range(span.start, span.stop, most):
                    count = min(most, span.stop - start)
                    found.append((space, self._probers[endpoint][1], Block(table, start, count, endpoint)))
        return found


class Registered:
    """One image of the registers."""

    def __init__(self, codec: Codec, image: Mapping[str, list[int]]) -> None:
        self._codec = codec
        self._image = image

    @property
    def signals(self) -> dict[str, Value]:
        """The value of each signal; None for a value that its table does not list."""
        found = {}
        for name, signal in self._codec.signals.items():
            value = signal.decode(signal.extract(self._image))
            found[name] = None if isinstance(value, Unlisted) else value
        return found

    @property
    def outputs(self) -> dict[str, int | None]:
        """What each command reads back; None at rest. Commands that cannot be read back are absent."""
        return {
            name: command.decode(self._image)
            for name, command in self._codec.commands.items()
            if command.read_points == command.points
        }


def latency(took_s: Sequence[float]) -> Latency | None:
    """Return percentiles of durations; None without any."""
    if not took_s:
        return None
    in_order = sorted(round(1000 * one, 3) for one in took_s)
    return Latency(
        p50_ms=in_order[len(in_order) // 2],
        p99_ms=in_order[min(len(in_order) - 1, len(in_order) * 99 // 100)],
        max_ms=in_order[-1],
        samples_ms=tuple(round(1000 * one, 3) for one in took_s),
    )


def _joined(ranges: Sequence[ServedRange]) -> tuple[ServedRange, ...]:
    found: list[ServedRange] = []
    for one in ranges:
        before = found[-1] if found else None
        if before is not None and (before.table, before.unit, before.last + 1) == (one.table, one.unit, one.first):
            found[-1] = before.model_copy(update={"last": one.last})
        else:
            found.append(one)
    return tuple(found)
