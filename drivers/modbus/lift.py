"""One lift behind a Modbus link: a map and a link become readings, commands and outcomes."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from drivers.driver import Permit
from drivers.errors import (
    ACCEPTED,
    ConnectionLost,
    ControllerException,
    DriverError,
    HeartbeatStopped,
    PressRefused,
    Sent,
)
from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.confirm import Expectation, proof
from drivers.modbus.link import Link
from drivers.modbus.plan import plan_reads
from drivers.modbus.reading import lift_values
from drivers.modbus.recipe import Outputs, Phase, Step, StepKind
from drivers.model import Command, LiftReading, LiftValues, Outcome, Proof, Result
from register_maps import frames
from register_maps.codec import Block, Codec
from register_maps.frames import Request
from register_maps.schema import Confirm
from register_maps.words import BIT_TABLES, Table

_log = logging.getLogger(__name__)

_HEARTBEAT = frozenset({"alive"})
_READ_BACK = Confirm(any_of=("readback",), within_s=2.0)
"""What counts for a command whose map names no confirmation. The time is that of the shipped maps."""


@dataclass(slots=True)
class _Press:
    """One press on its way to its outcome."""

    command: Command
    permit: Permit
    future: asyncio.Future[Outcome]
    frames: list[str] = field(default_factory=list)
    expected: Expectation | None = None
    """Set once the write was echoed."""
    written_at: float = math.inf
    read_back: bool = False
    not_granted: bool = False


class ModbusLift:
    """The LiftDriver of one lift on a Modbus link.

    Wishes are noted at once; `run` writes them. Raises ValueError when the site's floors do not fit the map's coding.
    """

    def __init__(self, codec: Codec, link: Link, settings: LiftSettings) -> None:
        """Plan the poll and prepare every request once."""
        self._codec = codec
        self._link = link
        self._settings = settings
        self._commands = dict(codec.commands) if settings.control else {}
        self._names = {code: name for name, code in settings.floors.items()}
        self._blocks = plan_reads(
            codec.signal_points,
            codec.served,
            max_registers=settings.max_registers_per_read,
            max_bits=settings.max_bits_per_read,
        )
        self._requests = tuple(frames.read(b.table, b.start, b.count, settings.unit_id) for b in self._blocks)
        self._reader = codec.reader(self._blocks)
        self._values: LiftValues | None = None
        self._epoch = 0
        self._alive_at = -math.inf
        alive = codec.map.signals.get("alive")
        self._alive_within_s = alive.must_change_within_s if alive is not None else None
        self._outputs = Outputs(self._commands)
        self._presses: dict[str, _Press] = {}
        self._permits: dict[str, Permit] = {}
        self._waiting: list[_Press] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wake = asyncio.Event()
        self._rested = asyncio.Event()
        self.capabilities = capabilities(codec, self._blocks, settings)

    @property
    def source(self) -> str:
        """Where it is, for messages."""
        return self._link.name

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError."""
        link, loop = self._link, self._loop
        if loop is None:
            # kept: Python 3.11 asks the kernel for the process id whenever it is asked for its loop
            loop = self._loop = asyncio.get_running_loop()
        at, epoch = loop.time(), link.epoch
        if len(self._requests) == 1:
            payloads: tuple[bytes, ...] = (await link.read(self._requests[0]),)
        else:
            payloads = tuple([await link.read(request) for request in self._requests])
        if link.epoch != epoch:
            raise ConnectionLost(link.name, "poll", "the connection was replaced in the middle of it")
        if epoch != self._epoch:
            await self._take_over(epoch)
        changed = self._reader.feed(payloads)
        values = self._values
        if changed or values is None:
            values = self._changed(changed or frozenset(), at)
        if self._alive_within_s is not None and at - self._alive_at > self._alive_within_s:
            raise HeartbeatStopped(link.name, at - self._alive_at, self._alive_within_s)
        if self._waiting:
            self._look(values, at)
        return LiftReading(at, epoch, values)

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            step = self._outputs.next(loop.time())
            if step is not None:
                await self._carry_out(step)
                continue
            if self._outputs.at_rest:
                self._rested.set()
            await self._sleep_until(self._outputs.wake_at())

    def press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        """Give a command once."""
        future: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
        press = _Press(command, permit, future)
        codec = self._commands.get(command.name)
        if codec is None:
            _end(press, Result.REJECTED, f"{self._settings.name} has no command {command.name}")
            return future
        self._end_press(command.name, Result.UNCONFIRMED, "replaced by a newer command")
        self._presses[command.name] = press
        self._permits[command.name] = permit
        code = self._settings.floors[command.floor] if command.floor is not None else 1
        self._outputs.press(command.name, code, asyncio.get_running_loop().time())
        self._stir()
        return future

    def hold(self, command: Command, permit: Permit) -> None:
        """Keep a held command on, or renew it."""
        if command.name not in self._commands:
            return
        if self._missing(command.name):
            # what the map requires was taken away: the hold goes, whatever its limit
            self.let_go(command)
            return
        self._permits[command.name] = permit
        resting = self._outputs.phase(command.name) is Phase.REST
        self._outputs.hold(command.name, asyncio.get_running_loop().time())
        if resting:
            self._stir()

    def let_go(self, command: Command) -> None:
        """Release a hold or a press that is still on."""
        if command.name in self._commands and self._outputs.phase(command.name) is not Phase.REST:
            self._outputs.let_go(command.name)
            self._end_press(command.name, Result.UNCONFIRMED, "let go before it was confirmed")
            self._stir()

    def given(self, command: Command) -> bool:
        """Whether it is wanted and not let go."""
        phase = self._outputs.phase(command.name) if command.name in self._commands else Phase.REST
        return phase in (Phase.DUE, Phase.LEAVING, Phase.ON)

    def held(self, command: Command) -> bool:
        """Whether this hold is on and verified, by read-back or, where the map asks for it, by its effect."""
        if self._values is None or command.name not in self._commands:
            return False
        if self._outputs.phase(command.name) is not Phase.ON:
            return False
        expected = Expectation(command, self._confirm(command.name).any_of, None, ())
        return proof(expected, self._values, read_back=self._outputs.verified(command.name)) is not Proof.NONE

    async def release_all(self) -> None:
        """Let everything go and return once it is verified."""
        for name in tuple(self._presses):
            self._end_press(name, Result.UNCONFIRMED, "everything was let go")
        self._outputs.let_all_go()
        if not self._outputs.at_rest:
            self._rested.clear()
            self._stir()
            await self._rested.wait()

    def _changed(self, changed: frozenset[str], at: float) -> LiftValues:
        if self._values is None or "alive" in changed:
            self._alive_at = at
        if self._values is None or changed != _HEARTBEAT:
            before = self._values.unknown if self._values is not None else {}
            self._values = lift_values(self._reader.values, self._reader.unlisted, self._names)
            for signal, raw in self._values.unknown.items():
                if before.get(signal) != raw:
                    _log.warning(
                        "%s: %s reads %d, which the map and the site do not list", self._settings.name, signal, raw
                    )
        return self._values

    async def _take_over(self, epoch: int) -> None:
        """Look at our own outputs over a new connection before anything is believed or written."""
        if self._commands:
            cells = await self._read_cells(block for codec in self._commands.values() for block in codec.blocks)
            self._outputs.reconnected(cells, asyncio.get_running_loop().time())
            self._stir()
        self._epoch = epoch

    async def _carry_out(self, step: Step) -> None:
        loop = asyncio.get_running_loop()
        press = self._presses.get(step.name) if step.kind is StepKind.PRESS else None
        permit = None if step.kind is StepKind.RELEASE else self._permit(step, press)
        maybe_sent = False
        try:
            for request in self._writes(step):
                await self._send(request, permit)
                maybe_sent = True
                if press is not None:
                    press.frames.append(_hex(request))
            self._outputs.written(step, loop.time())
            if press is not None and not press.future.done():
                self._await_proof(press)
            if self._must_look(step):
                holds = await self._holds(step)
                self._outputs.looked(step, holds=holds, now=loop.time())
                if press is not None:
                    press.read_back = holds
        except PressRefused as refused:
            # a hold that may not be refreshed stays on until it is let go or falls by its limit
            self._outputs.failed(step, maybe_sent=maybe_sent, now=loop.time())
            if press is not None:
                self._finish(press, Result.UNCONFIRMED if maybe_sent else Result.REJECTED, refused.reason)
        except DriverError as error:
            sent = maybe_sent or error.sent is not Sent.NO
            rejected = isinstance(error, ControllerException)
            self._outputs.failed(step, maybe_sent=sent, now=loop.time(), rejected=rejected)
            if press is not None and press.expected is None:
                self._finish(press, Result.UNCONFIRMED if error.sent is Sent.UNKNOWN else Result.REJECTED, str(error))
            _log.debug("%s: %s of %s failed: %s", self._settings.name, step.kind, step.name, error)

    async def _send(self, request: Request, permit: Permit | None) -> None:
        try:
            await self._link.write(request, permit)
        except ControllerException as error:
            if error.code != ACCEPTED:
                raise

    def _permit(self, step: Step, press: _Press | None) -> Permit:
        permit = self._permits[step.name]

        def allowed() -> str | None:
            wanted = Phase.LEAVING if step.kind is StepKind.PRESS else Phase.ON
            if self._outputs.phase(step.name) is not wanted:
                return "nobody wants it any more"
            if self._link.epoch != self._epoch:
                return "the connection is new and has not been read yet"
            if missing := self._missing(step.name):
                if press is not None:
                    press.not_granted = True
                return f"{step.name} needs {', '.join(missing)}"
            return permit()

        return allowed

    def _missing(self, name: str) -> list[str]:
        flags = self._values.flags if self._values is not None else {}
        return [flag for flag in self._commands[name].spec.requires if not flags.get(flag, False)]

    def _writes(self, step: Step) -> list[Request]:
        """Return the requests of one step, cells that come to rest first."""
        codec = self._commands[step.name]
        cells = self._outputs.cells(step)
        pairs = sorted(
            zip(codec.blocks, codec.functions, strict=True),
            key=lambda pair: any(cells[pair[0].table, address] for address in _addresses(pair[0])),
        )
        return [_write(block, function, cells, self._settings.unit_id) for block, function in pairs]

    def _confirm(self, name: str) -> Confirm:
        return self._commands[name].spec.confirm or _READ_BACK

    def _must_look(self, step: Step) -> bool:
        return step.kind is StepKind.RELEASE or "readback" in self._confirm(step.name).any_of

    async def _holds(self, step: Step) -> bool:
        codec = self._commands[step.name]
        cells = await self._read_cells(codec.blocks)
        return all(cells.get(cell) == value for cell, value in codec.encode(step.code).items())

    async def _read_cells(self, blocks: Iterable[Block]) -> dict[tuple[Table, int], int]:
        """Read what the controller holds in these blocks, each once."""
        cells: dict[tuple[Table, int], int] = {}
        for block in dict.fromkeys(blocks):
            request = frames.read(block.table, block.start, block.count, self._settings.unit_id)
            payload = await self._link.read_urgent(request)
            if block.table in BIT_TABLES:
                values: tuple[int, ...] = frames.unpack_bits(payload, block.count)
            else:
                values = tuple(int.from_bytes(payload[i : i + 2], "big") for i in range(0, len(payload), 2))
            cells.update(
                {(block.table, address): value for address, value in zip(_addresses(block), values, strict=True)}
            )
        return cells

    def _await_proof(self, press: _Press) -> None:
        confirm, loop = self._confirm(press.command.name), asyncio.get_running_loop()
        press.expected = Expectation(press.command, confirm.any_of, self._values, tuple(self._settings.floors))
        press.written_at = loop.time()
        self._waiting.append(press)
        loop.call_later(confirm.within_s, self._too_late, press, confirm.within_s)

    def _look(self, values: LiftValues, at: float) -> None:
        """Compare what is waited for with a reading that was asked for after the write."""
        for press in tuple(self._waiting):
            if press.expected is None or at < press.written_at:
                continue
            found = proof(press.expected, values, read_back=press.read_back)
            if found is not Proof.NONE:
                self._finish(press, Result.CONFIRMED, "", found)

    def _too_late(self, press: _Press, within_s: float) -> None:
        self._finish(press, Result.UNCONFIRMED, f"nothing showed within {within_s:g} s that the lift took it")

    def _end_press(self, name: str, result: Result, reason: str) -> None:
        press = self._presses.get(name)
        if press is not None:
            self._finish(press, result, reason)

    def _finish(self, press: _Press, result: Result, reason: str, found: Proof = Proof.NONE) -> None:
        if press in self._waiting:
            self._waiting.remove(press)
        if self._presses.get(press.command.name) is press:
            del self._presses[press.command.name]
        _end(press, result, reason, found)

    def _stir(self) -> None:
        self._wake.set()

    async def _sleep_until(self, when: float) -> None:
        self._wake.clear()
        if math.isinf(when):
            await self._wake.wait()
            return
        try:
            async with asyncio.timeout_at(when):
                await self._wake.wait()
        except TimeoutError:
            return


def _end(press: _Press, result: Result, reason: str, found: Proof = Proof.NONE) -> None:
    if not press.future.done():
        outcome = Outcome(press.command, result, reason, found, tuple(press.frames), press.not_granted)
        press.future.set_result(outcome)


def _hex(request: Request) -> str:
    """Unit, function and data of a request: what a person compares with a manual."""
    return request.body[4:].hex()


def _addresses(block: Block) -> range:
    return range(block.start, block.start + block.count)


def _write(block: Block, function: int, cells: Mapping[tuple[Table, int], int], unit: int) -> Request:
    values = [cells[block.table, address] for address in _addresses(block)]
    match function:
        case 5:
            return frames.write_coil(block.start, bool(values[0]), unit)
        case 6:
            return frames.write_register(block.start, values[0], unit)
        case 15:
            return frames.write_coils(block.start, [bool(value) for value in values], unit)
        case _:
            return frames.write_registers(block.start, values, unit)
