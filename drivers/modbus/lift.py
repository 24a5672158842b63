"""The driver of one lift behind Modbus links: turns polls into readings, and commands into writes with outcomes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping, Sequence

from drivers.driver import DriverOwner, OnAnswer
from drivers.errors import (
    ConnectionLost,
    ControllerException,
    PointsRefused,
    UnitOffline,
)
from drivers.modbus.alive_counter import SIGNAL, AliveCounter
from drivers.modbus.arbitration import SIGNALS, Arbitration
from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.diagnosis import Diagnosis
from drivers.modbus.foreign_writes import ForeignWriteCheck
from drivers.modbus.link import Link
from drivers.modbus.output_worker import OutputWorker
from drivers.modbus.outputs import Outputs
from drivers.modbus.permission import Permissions, closes_to_release
from drivers.modbus.presses import Press, Presses
from drivers.modbus.read_plan import plan_poll
from drivers.modbus.reading import lift_values
from drivers.modbus.reports import DriverReports
from drivers.modbus.signals import Signals
from drivers.modbus.units import Unit, Units
from drivers.modbus.write_plan import command_info, plan_writes
from drivers.modbus.write_reports import WriteReports
from drivers.modbus.writer import Writer
from drivers.model import (
    Command,
    CommandInfo,
    CommandStep,
    Hold,
    LiftReading,
    LiftValues,
    PlannedWrite,
    PressId,
    Result,
    SignalValue,
)
from register_maps.arbitration import NO_CLAIM, Claim, claim_alone
from register_maps.codec import Cell, Codec
from register_maps.frames import Request

_ONLY_ALIVE = frozenset({SIGNAL})
_RELEASED_EARLY = "released before it was confirmed"


class ModbusLift:
    """The LiftDriver of one lift on a Modbus link.

    `declare` and `press` return at once; `run` writes. Raises ValueError if the site's floors do not fit the map's coding.
    """

    # every poll touches it: see benchmarks/README.md
    __slots__ = (
        "_alive",
        "_arbitration",
        "_begun",
        "_blocks",
        "_codec",
        "_commands",
        "_declared",
        "_diagnosis",
        "_epoch",
        "_epochs",
        "_foreign_writes",
        "_is_floor_known_under_way",
        "_name",
        "_names",
        "_notices",
        "_outputs",
        "_permissions",
        "_presses",
        "_reader",
        "_reports",
        "_requested_at",
        "_requests",
        "_settings",
        "_signals",
        "_units",
        "_waiting",
        "_watchdog_unit_s",
        "_worker",
        "_writer",
        "capabilities",
    )

    def __init__(
        self,
        codec: Codec,
        link: Link,
        settings: LiftSettings,
        endpoints: Mapping[str, Unit] | None = None,
        *,
        claim: Claim | None = None,
    ) -> None:
        """Plan the poll and prepare its requests; `endpoints` are the map's further devices.

        `claim` is that of the term of this manager, for a controller that arbitrates; None without a cluster.
        """
        self._codec = codec
        self._units = Units(Unit(link, settings.unit_id), endpoints or {})
        self._name = link.name
        self._settings = settings
        self._commands = codec.commands if settings.control else {}
        self._names = {code: name for name, code in settings.floors.items()}
        self._blocks = plan_poll(
            codec, max_registers=settings.max_registers_per_read, max_bits=settings.max_bits_per_read
        )
        self._requests = tuple((b, self._units.link(b.endpoint), self._units.request(b)) for b in self._blocks)
        self._reader = codec.reader(self._blocks)
        self._begun = (
            None if endpoints or len(self._requests) > 1 else _BegunPoll(*self._requests[0][1:], self._repetition)
        )
        """None for a lift that no single request polls."""
        self._requested_at: tuple[float, ...] = ()
        """When each block of the newest poll was requested; empty before the first."""
        self._signals: Signals | None = None
        self._epoch = 0
        self._epochs: dict[str, int] = {}
        self._alive = AliveCounter(codec, link.name)
        watchdog = codec.map.signals.get("watchdog_time")
        self._watchdog_unit_s = (watchdog.unit_s if watchdog is not None else None) or 1.0
        car_floor = codec.map.signals.get("car_floor")
        self._is_floor_known_under_way = car_floor is None or car_floor.known_while is None
        self._diagnosis = Diagnosis(codec, self._units, settings.name)
        self._outputs = Outputs(self._commands, codec.written, codec.arbitration)
        self._declared: Collection[str] = ()
        """Names of the holds that should be on."""
        self._reports = DriverReports(self._outputs, self._names)
        beats = [command for command in self._commands.values() if command.spec.is_heartbeat]
        notes = WriteReports(self._reports.report, {point.cell for command in beats for point in command.points})
        self._writer = Writer(codec, self._commands, self._units, settings, notes)
        self._presses = Presses(tuple(settings.floors), codec.map.at_floor_evidence, self._reports.report)
        self._waiting = self._presses.waiting
        self._arbitration = (
            Arbitration(claim, self._outputs.set_claim, self._note)
            if codec.arbitration is not None and settings.control
            else None
        )
        self._permissions = self._new_permissions()
        self._foreign_writes = self._new_foreign_write_check()
        self._notices = self._foreign_writes.notices
        self._worker = OutputWorker(
            settings.name,
            self._outputs,
            self._writer,
            self._presses,
            self._permissions,
            self._foreign_writes,
            self._reports,
        )
        self._check_floors()
        self.capabilities = capabilities(codec, self._blocks, settings)

    def _new_permissions(self) -> Permissions:
        return Permissions(
            self._codec,
            self._outputs,
            self._presses,
            self._units,
            self._alive,
            self._reports,
            is_unread=self._is_unread,
        )

    def _new_foreign_write_check(self) -> ForeignWriteCheck:
        return ForeignWriteCheck(
            self._codec,
            self._outputs,
            self._units,
            self._settings,
            is_unread=self._is_unread,
            is_tripped=self._permissions.is_watchdog_tripped,
            clear=self._clear,
        )

    def _check_floors(self) -> None:
        """Raise ValueError for a floor of the site that a call of the map cannot express."""
        for command in self._commands.values():
            for code in self._settings.floors.values() if command.is_call else ():
                command.encode(code)

    @property
    def source(self) -> str:
        """Controller name, for messages."""
        return self._name

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        """Return every signal of the map as of the newest complete poll.

        This includes polls while the alive counter stands still: a person who looks for the reason needs their values.
        """
        if self._signals is None:
            self._signals = Signals(self._codec, self._blocks, self._names, watchdog_unit_s=self._watchdog_unit_s)
        return self._signals.values_at(self._reader, self._requested_at, now)

    async def read(self) -> LiftReading:
        """Poll once, or finish the poll that was begun. Raises DriverError."""
        is_begun = self._begun is not None and self._begun.answer is not None
        epoch = self._epoch if is_begun else self._units.epoch  # what was begun is of the connection that was read last
        payloads, requested_at = await self._read_blocks()
        if self._units.epoch != epoch:
            raise ConnectionLost(self._name, "poll", "the connection was replaced in the middle of it")
        is_new = epoch != self._epoch
        if is_new:
            await self._read_outputs_again(epoch)
        return self._reading(payloads, requested_at, is_new=is_new)

    def begin_read(self, on_answer: OnAnswer) -> bool:
        """Begin a poll of one request, over a connection that was read before."""
        begun = self._begun
        return begun is not None and begun.link.epoch == self._epoch and begun.begin(on_answer)

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled; no device waits for another.

        After a bug it raises once everything is released, or after a few seconds.
        """
        await self._worker.run()

    def attach(self, owner: DriverOwner) -> None:
        """Consult and report to `owner` from now on."""
        self._reports.owner = owner

    def declare(self, holds: Mapping[Command, Hold]) -> None:
        """Replace what should be on."""
        now = asyncio.get_running_loop().time()
        if self._worker.has_failed:
            holds = {}
        declared = {command.name: (self._code(command), hold) for command, hold in holds.items()}
        self._declared = frozenset(declared).intersection(self._outputs.names)
        first_fall_at = self._outputs.first_expiry_at
        for name in self._outputs.names:
            code, hold = declared.get(name, (None, None))
            if code is None or hold is None:
                released = self._outputs.undeclare(name)
            elif self._epoch and self._permissions.missing_flags(name) and not self._outputs.output(name).awaits_look:
                # a flag that the map requires is gone: release the hold, whatever its limit
                released = self._outputs.withhold(name, hold)
            else:
                released = self._outputs.declare(name, code, hold, now, adopts=not self._epoch)
            if released:
                self._presses.end(name, Result.UNCONFIRMED, _RELEASED_EARLY)
        if self._reports.report_states() or self._outputs.first_expiry_at < first_fall_at:
            self._on_outputs_changed()

    def press(self, press: PressId, command: Command, leave_by: float) -> None:
        """Press a command once."""
        name, code = command.name, self._code(command)
        given = Press(press, command)
        if name not in self._outputs or code is None:
            self._presses.finish(given, Result.REJECTED, f"{self._settings.name} has no command {command}")
            return
        if self._worker.has_failed:
            self._presses.finish(given, Result.REJECTED, "the driver of this lift has failed")
            return
        self._presses.begin(given)
        now = asyncio.get_running_loop().time()
        self._outputs.press(name, code, now, press=press, leave_by=leave_by)
        self._on_outputs_changed()

    def cancel(self, press: PressId) -> None:
        """Cancel a press."""
        for name in self._outputs.names:
            output, given = self._outputs.output(name), self._presses.get(name)
            if output.press == press and (output.press_waits or name not in self._declared):
                self._outputs.release(name)
            if given is not None and given.id == press:
                self._presses.finish(given, Result.UNCONFIRMED, _RELEASED_EARLY)
        self._on_outputs_changed()

    def frames(self, command: Command) -> tuple[str, ...]:
        """Return the writes that a press of this command would send, as far as they are known without reading."""
        code = self._code(command)
        if command.name not in self._outputs or code is None:
            return ()
        return self._writer.plan_frames(*self._outputs.plan_press(command.name, code))

    def commands(self) -> tuple[CommandInfo, ...]:
        """Return every command of the map."""
        states = self._reports.states if self._commands else {}
        return tuple(command_info(command, states.get(name)) for name, command in self._codec.commands.items())

    def plan(self, steps: Sequence[CommandStep]) -> tuple[PlannedWrite, ...]:
        """Return every press and release that these steps would write from rest."""
        coded = [(step, self._code(step.command)) for step in steps]
        claim = claim_alone(NO_CLAIM) if self._arbitration is None else self._arbitration.claim
        return plan_writes(self._codec, self._units.unit, claim, coded)

    def fence(self, until: float) -> None:
        """Write nothing at or after this time."""
        self._units.fence(until)
        self._worker.wake()

    async def released(self) -> None:
        """Return once every output is at rest."""
        await self._worker.wait_until_at_rest()

    def _note(self, text: str) -> None:
        """Give a notice with the next reading."""
        self._foreign_writes.note(text)

    def _on_outputs_changed(self) -> None:
        """Report the outputs and wake the workers after a change of what is declared or pressed."""
        self._worker.end_dropped_presses()
        self._reports.report_states()
        self._worker.wake()

    def _code(self, command: Command) -> int | None:
        """Return the code that a command writes; None for a floor that the site does not have."""
        return self._settings.floors.get(command.floor) if command.floor is not None else 1

    async def _read_blocks(self) -> tuple[tuple[bytes, ...], tuple[float, ...]]:
        """Return the content of each block, and when it was requested."""
        payloads: list[bytes] = []
        requested_at: list[float] = []
        for block, link, request in self._requests:
            try:
                begun = None if self._begun is None else self._begun.take()
                payloads.append(await link.read(request) if begun is None else begun)
            except ControllerException as error:
                raise await self._diagnosis.explain(error, block) from error
            requested_at.append(link.stats.asked_at)
        return tuple(payloads), tuple(requested_at)

    def _repetition(self, payload: bytes, at: float) -> LiftReading | None:
        """Return the reading of an answer that repeats the one before; None where there is more to do than to take it."""
        values = self._reports.values
        if values is None or self._waiting or self._notices or at > self._alive.live_until:
            return None
        if not self._reader.repeats(payload):
            return self._reading((payload,), (at,)) if self._reader.differs_only_in(SIGNAL, payload) else None
        self._requested_at = (at,)
        return LiftReading(at, self._epoch, values, (), self._reports.states)

    def _reading(
        self, payloads: tuple[bytes, ...], requested_at: tuple[float, ...], *, is_new: bool = False
    ) -> LiftReading:
        """Take the answers of one poll. Raises HeartbeatStopped."""
        reports, at = self._reports, requested_at[0]
        changed = self._reader.feed(payloads)
        self._requested_at = requested_at
        values = reports.values
        if changed or values is None:
            values = self._update_values(changed or frozenset(), at)
        if is_new:
            self._alive.connected(self._epochs, at)
            self._presses.restart(values, at)
        if at > self._alive.live_until:
            raise self._alive.error(at)
        if self._waiting:
            self._presses.check_proof(values, at)
        notices = self._foreign_writes.take_notices(at) if self._notices else ()
        return LiftReading(at, self._epoch, values, notices, reports.states)

    def _update_values(self, changed: frozenset[str], at: float) -> LiftValues:
        if SIGNAL in changed:
            self._alive.beat(at)
        if self._arbitration is not None and not SIGNALS.isdisjoint(changed):
            self._arbitration.update(self._reader.values)
            self._reports.ignored = self._arbitration.refusal
        values = self._reports.values
        if values is None or changed != _ONLY_ALIVE:
            self._reports.values = values = lift_values(
                self._reader.values,
                self._reader.unlisted,
                self._names,
                watchdog_unit_s=self._watchdog_unit_s,
                is_floor_known_under_way=self._is_floor_known_under_way,
            )
            self._presses.update(values, at)
            self._diagnosis.report_unlisted(values)
            self._release_by_reading(values)
        return values

    def _release_by_reading(self, values: LiftValues) -> None:
        """Release what a reading ends: close commands, and holds whose required flags are gone."""
        to_release = list(closes_to_release(self._commands, values, self._codec.signals))
        for name in to_release:
            self._outputs.release(name)
        for name in self._outputs.names:
            if (
                self._outputs.output(name).begin
                and self._permissions.missing_flags(name)
                and self._outputs.withhold(name)
            ):
                self._presses.end(name, Result.UNCONFIRMED, _RELEASED_EARLY)
                to_release.append(name)
        if to_release:
            self._worker.end_dropped_presses()
            self._worker.wake()
        self._reports.report_states()

    async def _read_outputs_again(self, epoch: int) -> None:
        """Read our own outputs back over a new connection before anything is trusted or written."""
        epochs = self._units.epochs
        changed = {endpoint for endpoint, number in epochs.items() if number != self._epochs.get(endpoint)}
        cells: dict[Cell, int] = {}
        for block, names in self._writer.read_blocks(changed).items():
            try:
                cells |= await self._units.cells([block])
            except UnitOffline:
                raise
            except ControllerException as error:
                raise PointsRefused(error, f"our outputs cannot be read back: {names}") from error
        if self._commands:
            self._outputs.record_reconnect(cells, asyncio.get_running_loop().time(), changed)
            self._worker.wake()
        self._epoch, self._epochs = epoch, epochs
        self._reports.report_states()
        self._diagnosis.forget()

    def _is_unread(self) -> bool:
        """Whether a connection is new and was not read yet."""
        return self._units.epoch != self._epoch

    def _clear(self, name: str) -> None:
        """Release an output that somebody else has pressed."""
        self._outputs.clear(name, asyncio.get_running_loop().time())
        self._worker.wake()


class _BegunPoll:
    """A poll of one block that was begun without a task. Keeps an answer that is more than a repetition."""

    __slots__ = ("_on_answer", "_repetition", "_request", "_stats", "answer", "link")

    def __init__(self, link: Link, request: Request, repetition: Callable[[bytes, float], LiftReading | None]) -> None:
        """`repetition` returns the reading of an answer and the time of its request, or None where the answer is to be kept."""
        self.link = link
        self._stats = link.stats
        self._request = request
        self._repetition = repetition
        self._on_answer: OnAnswer
        self.answer: bytes | Exception | None = None
        """What was answered, or why nothing was, until it is taken."""

    def begin(self, on_answer: OnAnswer) -> bool:
        """Send the request, unless it would have to wait: then return False."""
        self.answer, self._on_answer = None, on_answer
        return self.link.read_at_once(self._request, self)

    def done(self) -> bool:
        return False

    def set_result(self, payload: bytes, /) -> None:
        try:
            reading = self._repetition(payload, self._stats.asked_at)
        except Exception as bug:  # noqa: BLE001 - raised by `read`: the connection and the other lifts on it have no part in it
            self.set_exception(bug)
            return
        if reading is None:
            self.answer = payload
        self._on_answer(reading)

    def set_exception(self, error: Exception, /) -> None:
        self.answer = error
        self._on_answer(None)

    def take(self) -> bytes | None:
        """Return the answer that is kept, once. Raises the error of a request without one."""
        answer, self.answer = self.answer, None
        if isinstance(answer, Exception):
            raise answer
        return answer
