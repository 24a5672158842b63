"""Writes the steps of one lift's outputs: requests in order, words shared with other writers, and the read-back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from drivers.errors import ControllerException, Delivery, DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.confirm import confirmation_of
from drivers.modbus.output import Cells, matches
from drivers.modbus.read_plan import plan_reads
from drivers.modbus.steps import READ_ONLY_KINDS, Step, StepKind
from drivers.modbus.transactions import Permit
from drivers.modbus.units import Units
from drivers.modbus.write_reports import CUT_SHORT, WriteReports, hex_frames
from drivers.modbus.writes import block_request, block_write, blocks_in_order, read_back_blocks, step_requests
from register_maps.codec import Block, Cell, Codec, CommandCodec
from register_maps.frames import MASK_WRITE, Request

_NOT_READ_BACK = frozenset({StepKind.BEAT, StepKind.CYCLE, StepKind.RESET, StepKind.PAUSE})


class Writer:
    """Writes the commands of a map and reads them back."""

    def __init__(
        self,
        codec: Codec,
        commands: Mapping[str, CommandCodec],
        units: Units,
        settings: LiftSettings,
        reports: WriteReports | None = None,
    ) -> None:
        """`commands` are those that this lift may use: its links accept only their writes."""
        self._codec = codec
        self._commands = commands
        self._units = units
        self._reports = reports or WriteReports(lambda _: None)
        units.declare(commands.values())
        self._functions = {block: function for block, function, _ in codec.written}
        self._read_blocks = {
            name: read_back_blocks(
                command,
                codec.written,
                plan_reads(
                    command.read_points,
                    codec.served,
                    max_registers=settings.max_registers_per_read,
                    max_bits=settings.max_bits_per_read,
                ),
            )
            for name, command in commands.items()
        }

    def read_blocks(self, endpoints: Collection[str]) -> dict[Block, str]:
        """Return the blocks to read for the outputs of these devices, with the commands each is read for."""
        found: dict[Block, list[str]] = {}
        for name, blocks in self._read_blocks.items():
            if {point.endpoint for point in self._commands[name].points} & set(endpoints):
                for block in blocks:
                    found.setdefault(block, []).append(self.printed(name))
        return {block: "; ".join(names) for block, names in found.items()}

    @property
    def is_fenced(self) -> bool:
        """Whether nothing may be written now."""
        return self._units.is_fenced

    def printed(self, name: str) -> str:
        """Return the name of a command, with its addresses as its map prints them."""
        return f"{name} at {', '.join(self._commands[name].spec.addresses)}" if name in self._commands else name

    def plan_frames(self, step: Step, cells: Cells) -> tuple[str, ...]:
        """Return the writes of a press as hex, without reading: the bits of other writers in the same words count as 0."""
        return hex_frames(
            [request for _, request in step_requests(self._commands[step.name], step, cells, self._units.unit)]
        )

    async def write(
        self, step: Step, cells: Cells, permit: Permit | None, on_answer: Callable[[Request], None]
    ) -> None:
        """Send every request of a step; `on_answer` gets each once it is answered. Raises DriverError.

        At the end, failed or not, what reached the wire or may have is reported.
        """
        if step.kind in READ_ONLY_KINDS:
            return
        sent: list[Request] = []
        failure = CUT_SHORT
        try:
            await self._write(step, cells, permit, sent, on_answer)
            failure = ""
        except DriverError as error:
            failure = str(error)
            raise
        finally:
            blocks = self._commands[step.name].blocks if step.block is None else (step.block,)
            self._reports.report_write(step, blocks, cells, sent, failure)

    async def _write(
        self,
        step: Step,
        cells: Cells,
        permit: Permit | None,
        sent: list[Request],
        on_answer: Callable[[Request], None],
    ) -> None:
        if step.block is not None:
            request = block_write(step.block, self._functions[step.block], cells, self._unit(step.block))
            on_answer(await self._send(request, step.block, permit, sent))
            return
        command = self._commands[step.name]
        failure: DriverError | None = None
        for block, function in blocks_in_order(command, step, cells):
            try:
                on_answer(await self._write_block(command, step, block, function, cells, permit, sent))
            except DriverError as error:
                # a press on one device is released whatever another device answers
                if step.kind is not StepKind.RELEASE:
                    raise
                failure = failure or error
        if failure is not None:
            raise failure

    async def read_back(self, step: Step) -> bool | None:
        """Return whether the points hold what the step wrote; None if a read-back is not needed."""
        if step.kind in _NOT_READ_BACK:
            return None
        command = self._commands[step.name]
        release = step.kind in (StepKind.RELEASE, StepKind.VERIFY)
        if command.shows_lamp or not command.read_points:
            # the points show the controller's answer and not our write: for a release the echo is all the proof there is
            return True if release else None
        if command.spec.self_clearing and not release:
            return None
        if not (
            release
            or step.kind is StepKind.LOOK
            or command.is_shared
            or "readback" in confirmation_of(command.spec).any_of
        ):
            return None
        return matches(command, await self.cells(step.name), step.code)

    async def cells(self, name: str) -> Cells:
        """Return the cells where a command is read back. Raises DriverError."""
        return await self._units.cells(self._read_blocks[name])

    async def _write_block(
        self,
        command: CommandCodec,
        step: Step,
        block: Block,
        function: int,
        cells: Cells,
        permit: Permit | None,
        sent: list[Request],
    ) -> Request:
        if not command.is_shared or function == MASK_WRITE or command.is_timed_coil:
            request = block_request(command, step, block, function, cells, self._unit(block))
            return await self._send(request, block, permit, sent)
        async with self._units.word_lock(block.endpoint):
            fresh: dict[Cell, int] = await self._units.cells([block])
            for point, value in command.encode(step.code).items():
                if block.holds(point):
                    fresh[point.cell] = point.into(fresh[point.cell], value)
            return await self._send(block_write(block, function, fresh, self._unit(block)), block, permit, sent)

    async def _send(self, request: Request, block: Block, permit: Permit | None, sent: list[Request]) -> Request:
        sent.append(request)
        try:
            await self._units.send(block.endpoint, request, permit)
        except Exception as error:
            if not _may_have_been_sent(error):
                sent.pop()
            raise
        return request

    def _unit(self, block: Block) -> int:
        return self._units.unit(block.endpoint)


def _may_have_been_sent(error: Exception) -> bool:
    """Whether a failed write may be on the wire: a controller that answers has received it, even if it did nothing."""
    return isinstance(error, DriverError) and (error.sent is not Delivery.NO or isinstance(error, ControllerException))
