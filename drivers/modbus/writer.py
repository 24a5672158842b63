"""Writes the steps of one lift's outputs: requests in order, words shared with other writers, and the read-back."""

from __future__ import annotations

from asyncio import Future
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from drivers.errors import ACCEPTED, ControllerException, Delivery, DriverError
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


@dataclass(slots=True)
class Write:
    """The write of one step."""

    step: Step
    cells: Cells
    permit: Permit | None
    blocks: list[tuple[Block, int]]
    """The blocks to write and their functions, in order."""
    sent: list[Request] = field(default_factory=list)
    """What reached the wire, or may have."""
    begun: Future[bytes] | None = None
    """The answer to the first request, which was sent already."""


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

    def is_free(self, endpoint: str) -> bool:
        """Whether a request to this device would be sent at once."""
        return self._units.is_free(endpoint)

    def plan(self, step: Step, cells: Cells, permit: Permit | None) -> Write:
        """Return the write of a step; a step that only reads writes nothing."""
        if step.kind in READ_ONLY_KINDS:
            blocks = []
        elif step.block is not None:
            blocks = [(step.block, self._functions[step.block])]
        else:
            blocks = blocks_in_order(self._commands[step.name], step, cells)
        return Write(step, cells, permit, blocks)

    def begin(self, write: Write) -> None:
        """Send the first request now, unless its word has to be read before."""
        block, function = write.blocks[0] if write.blocks else (None, 0)
        if block is not None and not self._reads_first(write.step, function):
            write.begun = self._send(write, block, self._request(write, block, function))

    async def write(self, write: Write, on_answer: Callable[[Request], None]) -> None:
        """Send every request of a write that was not sent; `on_answer` gets each once it is answered. Raises DriverError.

        At the end, failed or not, what reached the wire or may have is reported.
        """
        failure = CUT_SHORT
        try:
            await self._write(write, on_answer)
            failure = ""
        except DriverError as error:
            failure = str(error)
            raise
        finally:
            self._report(write, failure)

    def cut_short(self, write: Write) -> None:
        """Report what was sent of a write that was begun, and whose answer is not awaited."""
        answer = write.begun
        if answer is None:
            return
        error = answer.exception() if answer.done() else None
        answer.cancel()
        if error is None or _may_have_been_sent(error):
            self._report(write, CUT_SHORT)

    def _report(self, write: Write, failure: str) -> None:
        step = write.step
        blocks = self._commands[step.name].blocks if step.block is None else (step.block,)
        self._reports.report_write(step, blocks, write.cells, write.sent, failure)

    async def _write(self, write: Write, on_answer: Callable[[Request], None]) -> None:
        failure: DriverError | None = None
        for block, function in write.blocks:
            try:
                on_answer(await self._write_block(write, block, function))
            except DriverError as error:
                # a press on one device is released whatever another device answers
                if write.step.kind is not StepKind.RELEASE:
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

    async def _write_block(self, write: Write, block: Block, function: int) -> Request:
        """Write a block, and return the request once it is answered."""
        answer, write.begun = write.begun, None
        if answer is not None:
            return await self._answered(write, answer)
        if not self._reads_first(write.step, function):
            return await self._answered(write, self._send(write, block, self._request(write, block, function)))
        async with self._units.word_lock(block.endpoint):
            fresh: dict[Cell, int] = await self._units.cells([block])
            for point, value in self._commands[write.step.name].encode(write.step.code).items():
                if block.holds(point):
                    fresh[point.cell] = point.into(fresh[point.cell], value)
            request = block_write(block, function, fresh, self._unit(block))
            return await self._answered(write, self._send(write, block, request))

    def _reads_first(self, step: Step, function: int) -> bool:
        """Whether a block is read before it is written, because others write to its words too."""
        command = self._commands[step.name] if step.block is None else None
        return command is not None and command.is_shared and function != MASK_WRITE and not command.is_timed_coil

    def _request(self, write: Write, block: Block, function: int) -> Request:
        step, unit = write.step, self._unit(block)
        if step.block is not None:
            return block_write(block, function, write.cells, unit)
        return block_request(self._commands[step.name], step, block, function, write.cells, unit)

    def _send(self, write: Write, block: Block, request: Request) -> Future[bytes]:
        answer = self._units.begin_write(block.endpoint, request, write.permit)
        write.sent.append(request)
        return answer

    async def _answered(self, write: Write, answer: Future[bytes]) -> Request:
        """Wait for the answer to the newest request, and return that. That it is accepted but in progress counts as its echo."""
        request = write.sent[-1]
        try:
            await answer
        except Exception as error:
            if isinstance(error, ControllerException) and error.code == ACCEPTED:
                return request
            if not _may_have_been_sent(error):
                write.sent.pop()
            raise
        return request

    def _unit(self, block: Block) -> int:
        return self._units.unit(block.endpoint)


def _may_have_been_sent(error: BaseException) -> bool:
    """Whether a failed write may be on the wire: a controller that answers has received it, even if it did nothing."""
    return isinstance(error, DriverError) and (error.sent is not Delivery.NO or isinstance(error, ControllerException))
