"""One lift behind Modbus links: a map and its links become readings, commands and outcomes."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from drivers.driver import Permit, WriteLog, always
from drivers.errors import (
    ConnectionLost,
    ControllerException,
    PointsRefused,
    UnitOffline,
)
from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.carrier import Carrier
from drivers.modbus.confirm import Expectation, proof
from drivers.modbus.diagnosis import Diagnosis
from drivers.modbus.endings import ended
from drivers.modbus.foreign import Watch
from drivers.modbus.heartbeat import SIGNAL, Heartbeat
from drivers.modbus.lines import Line, Lines
from drivers.modbus.link import Link
from drivers.modbus.notes import Notes
from drivers.modbus.permission import Permissions
from drivers.modbus.plan import plan_poll
from drivers.modbus.presses import NOT_SENT, REPLACED, Presses
from drivers.modbus.reading import lift_values
from drivers.modbus.recipe import Outputs
from drivers.modbus.rows import Rows, Wish
from drivers.modbus.signals import Signals
from drivers.modbus.steps import Phase
from drivers.modbus.writer import Writer
from drivers.model import Command, CommandKind, LiftReading, LiftValues, Outcome, Proof, Result, SignalValue
from register_maps.codec import Cell, Codec
from register_maps.words import Side

_ONLY_ALIVE = frozenset({SIGNAL})


class ModbusLift:
    """The LiftDriver of one lift on a Modbus link.

    Wishes are noted at once; `run` writes them. Raises ValueError when the site's floors do not fit the map's coding.
    """

    def __init__(
        self,
        codec: Codec,
        link: Link,
        settings: LiftSettings,
        endpoints: Mapping[str, Line] | None = None,
        log: WriteLog | None = None,
    ) -> None:
        """Plan the poll and prepare every request once; `endpoints` are the map's further devices.

        Without a `log` nothing is written down, and no press waits for that.
        """
        self._codec = codec
        self._lines = Lines(Line(link, settings.unit_id), endpoints or {})
        self._name = link.name
        self._settings = settings
        self._commands = dict(codec.commands) if settings.control else {}
        self._names = {code: name for name, code in settings.floors.items()}
        self._blocks = plan_poll(
            codec, max_registers=settings.max_registers_per_read, max_bits=settings.max_bits_per_read
        )
        self._requests = tuple((b, self._lines.link(b.endpoint), self._lines.request(b)) for b in self._blocks)
        self._reader = codec.reader(self._blocks)
        self._asked_at: tuple[float, ...] = ()
        """When each block of the newest poll was asked for; empty before the first."""
        self._signals: Signals | None = None
        self._values: LiftValues | None = None
        self._epoch = 0
        self._epochs: dict[str, int] = {}
        self._heartbeat = Heartbeat(codec, link.name)
        watchdog = codec.map.signals.get("watchdog_time")
        self._watchdog_unit_s = (watchdog.unit_s if watchdog is not None else None) or 1.0
        car_floor = codec.map.signals.get("car_floor")
        self._floor_under_way = car_floor is None or car_floor.known_while is None
        self._diagnosis = Diagnosis(codec, self._lines, settings.name)
        self._outputs = Outputs(self._commands, codec.written)
        self._again = {name: _command(name) for name in self._outputs.names}
        """What is told to the log when a hold is pressed again: no call ever is, so none of them has a floor."""
        beats = [command for command in self._commands.values() if command.spec.is_heartbeat]
        notes = Notes(log, {point.cell for command in beats for point in command.points})
        self._writer = Writer(codec, self._commands, self._lines, settings, notes)
        self._presses = Presses(tuple(settings.floors), codec.map.at_floor_evidence)
        self._permissions = self._new_permissions()
        self._watch = self._new_watch()
        self._notices = self._watch.notices
        self._carrier = Carrier(
            settings.name,
            self._outputs,
            self._writer,
            self._presses,
            self._permissions,
            self._watch,
            self._give_all_up,
        )
        self._rows = Rows(
            log, notes, lift=settings.name, planned=self._planned, enter=self._enter, refused=self._refused
        )
        self._check_floors()
        self._loop: asyncio.AbstractEventLoop | None = None
        self.capabilities = capabilities(codec, self._blocks, settings)

    def _new_permissions(self) -> Permissions:
        return Permissions(
            self._codec,
            self._outputs,
            self._presses,
            self._lines,
            self._heartbeat,
            values=lambda: self._values,
            is_unread=self._is_unread,
        )

    def _new_watch(self) -> Watch:
        return Watch(
            self._codec,
            self._outputs,
            self._lines,
            self._settings,
            is_unread=self._is_unread,
            tripped=self._permissions.is_tripped,
            clear=self._clear,
        )

    def _check_floors(self) -> None:
        """Raise ValueError for a floor of the site that some call of the map cannot express."""
        for command in self._commands.values():
            for code in self._settings.floors.values() if command.is_call else ():
                command.encode(code)

    @property
    def source(self) -> str:
        """Where it is, for messages."""
        return self._name

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        """Return every signal of the map, from the words of the newest poll that was answered as a whole.

        Words that came while the alive counter stands still are among them: a person who looks for the reason needs them.
        """
        if self._signals is None:
            self._signals = Signals(self._codec, self._blocks, self._names, watchdog_unit_s=self._watchdog_unit_s)
        return self._signals.as_read(self._reader, self._asked_at, now)

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError."""
        lines, loop = self._lines, self._loop
        if loop is None:
            # kept: Python 3.11 asks the kernel for the process id whenever it is asked for its loop
            loop = self._loop = asyncio.get_running_loop()
        at, epoch = loop.time(), lines.epoch
        asked_at: tuple[float, ...] = (at,)
        if len(self._requests) == 1:
            block, link, request = self._requests[0]
            try:
                payloads: tuple[bytes, ...] = (await link.read(request),)
            except ControllerException as error:
                raise await self._diagnosis.explained(error, block) from error
        else:
            payloads, asked_at = await self._read_blocks(loop)
        if lines.epoch != epoch:
            raise ConnectionLost(self._name, "poll", "the connection was replaced in the middle of it")
        is_new = epoch != self._epoch
        if is_new:
            await self._take_over(epoch)
        changed = self._reader.feed(payloads)
        self._asked_at = asked_at
        values = self._values
        if changed or values is None:
            values = self._changed(changed or frozenset(), at)
        if is_new:
            self._heartbeat.connected(self._epochs, at)
            self._presses.seen_again(values, at)
        if at > self._heartbeat.live_until:
            raise self._heartbeat.error(at)
        if self._presses.waiting:
            self._presses.look(values, at)
        return LiftReading(at, epoch, values, self._watch.take_notices(at) if self._notices else ())

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled; no device waits for another.

        A bug raises only once everything is let go of, or after a few seconds in which that was not possible.
        """
        await self._carrier.run(self._press_again)

    def press(self, command: Command, permit: Permit, begins: Permit = always) -> asyncio.Future[Outcome]:
        """Give a command once; it waits until it is written down."""
        name = command.name
        if name not in self._outputs:
            return self._presses.refuse(command, f"{self._settings.name} has no command {name}")
        if self._carrier.has_failed:
            return self._presses.refuse(command, "the driver of this lift has failed")
        press = self._presses.asked(command, begins)
        self._drop(name, Result.UNCONFIRMED, REPLACED)
        self._ask(Wish(command, permit, asyncio.get_running_loop().time(), press))
        return press.future

    def hold(self, command: Command, permit: Permit, *, begin: bool = True) -> None:
        """Keep a held command on, or renew it. From rest it waits until it is written down, and stays there unless it may `begin`."""
        name = command.name
        if name not in self._outputs or self._carrier.has_failed:
            return
        if self._permissions.missing(name) and not self._outputs.output(name).awaits_look:
            # what the map requires was taken away: the hold goes, whatever its limit
            self.let_go(command)
            return
        now = asyncio.get_running_loop().time()
        if self._outputs.wanted(name):
            self._permissions.note(name, permit)
            self._outputs.hold(name, now, begin=begin)
            if self._outputs.output(name).needs_row:
                self._press_again(name)
        elif not begin:
            self._drop(name, Result.REJECTED, NOT_SENT)
        elif (wish := self._rows.waiting(name)) is not None:
            wish.permit, wish.at = permit, now
        elif self._rows.may_ask(name, now):
            self._ask(Wish(command, permit, now))

    def adopt(self, command: Command, permit: Permit) -> None:
        """Keep what the first look finds on as this command writes it; raises RuntimeError once the lift was read.

        Nothing to adopt are pulses, holds made of pulses, points that show a lamp, and floors that the site has no longer:
        what is found on there is let go of.
        """
        if self._epoch:
            raise RuntimeError(f"{self._settings.name}: {command} is adopted after the first reading")
        code = self._settings.floors.get(command.floor) if command.floor is not None else 1
        if command.name not in self._outputs or code is None:
            return
        self._permissions.note(command.name, permit)
        self._outputs.adopt(command.name, code, asyncio.get_running_loop().time())

    def keep(self, command: Command) -> None:
        """Leave a hold on though nobody asks for it any more; what waits to be pressed is dropped."""
        self._drop(command.name, Result.REJECTED, NOT_SENT)
        if command.name in self._outputs:
            self._outputs.output(command.name).keep()

    def let_go(self, command: Command) -> None:
        """Release a hold or a press that is still on."""
        name, reason = command.name, "let go before it was confirmed"
        self._drop(name, Result.UNCONFIRMED, reason)
        if name in self._outputs and not self._outputs.rests(name):
            self._outputs.let_go(name)
            self._presses.end(name, Result.UNCONFIRMED, reason)
            self._carrier.stir()

    def given(self, command: Command) -> bool:
        """Whether it is wanted and not let go; what waits to be written down or was adopted is wanted."""
        name = command.name
        if name not in self._outputs:
            return False
        waits = self._rows.waiting(name) is not None
        return waits or self._outputs.given(name, asyncio.get_running_loop().time())

    def held(self, command: Command) -> bool:
        """Whether this hold is on and verified, by read-back or, where the map asks for it, by its effect."""
        if self._values is None or command.name not in self._outputs:
            return False
        if not self._outputs.output(command.name).is_held:
            return False
        any_of = self._writer.confirm(command.name).any_of
        if "readback" in any_of and not self._outputs.verified(command.name):
            return False  # a door that is open by itself does not make up for a hold that is not there
        expected = Expectation(command, any_of, None, ())
        return proof(expected, self._values, read_back=self._outputs.verified(command.name)) is not Proof.NONE

    def at_rest(self, command: Command) -> bool:
        """Whether nothing of it is on or wanted, and that is verified."""
        name = command.name
        return name not in self._outputs or (self._rows.waiting(name) is None and self._outputs.rests(name))

    async def release_all(self) -> None:
        """Let everything go and return once it is verified."""
        self._give_all_up("everything was let go")
        await self._carrier.rest()

    def _ask(self, wish: Wish) -> None:
        """Have a wish written down, and want of the outputs what it wants once that is done."""
        for other in self._outputs.excluded(wish.command.name):
            self._drop(other, Result.REJECTED, NOT_SENT)
        self._rows.ask(wish)

    def _planned(self, command: Command) -> tuple[str, ...]:
        """Return the frames that a press of this command will be, as far as is known without reading."""
        return self._writer.planned(*self._outputs.about_to_press(command.name, self._code(command)))

    def _enter(self, wish: Wish) -> None:
        """It is written down: from here on the outputs see to it."""
        if wish.again:
            self._outputs.record(wish.command.name)
            self._carrier.stir()
            return
        name, now = wish.command.name, asyncio.get_running_loop().time()
        resting = self._outputs.phase(name) is Phase.REST
        if wish.press is not None:
            self._presses.begin(wish.press)
        self._permissions.note(name, wish.permit)
        if wish.press is not None:
            self._outputs.press(name, self._code(wish.command), now)
        else:
            self._outputs.hold(name, wish.at)
        if wish.press is not None or resting:
            self._carrier.end_dropped()
            self._carrier.stir()

    def _press_again(self, name: str) -> None:
        """Have it written down that a hold is pressed again; the outputs see to the rest."""
        now = asyncio.get_running_loop().time()
        if self._rows.waiting(name) is None and self._rows.may_ask(name, now):
            self._rows.ask(Wish(self._again[name], always, now, again=True))

    def _refused(self, wish: Wish, reason: str) -> None:
        """It could not be written down, so nothing of it is pressed."""
        if wish.press is not None:
            self._presses.finish(wish.press, Result.REJECTED, reason)

    def _drop(self, name: str, result: Result, reason: str) -> None:
        """Forget a wish that waits to be written down."""
        wish = self._rows.drop(name)
        if wish is not None and wish.press is not None:
            self._presses.finish(wish.press, result, reason)

    def _give_all_up(self, reason: str) -> None:
        """Let everything go, and forget what waits to be written down."""
        for name in self._outputs.names:
            self._drop(name, Result.UNCONFIRMED, reason)
        self._presses.end_all(reason)
        self._outputs.let_all_go()

    def _code(self, command: Command) -> int:
        return self._settings.floors[command.floor] if command.floor is not None else 1

    async def _read_blocks(self, loop: asyncio.AbstractEventLoop) -> tuple[tuple[bytes, ...], tuple[float, ...]]:
        """Return what each block holds, and when it was asked for."""
        payloads: list[bytes] = []
        asked_at: list[float] = []
        for block, link, request in self._requests:
            asked_at.append(loop.time())
            try:
                payloads.append(await link.read(request))
            except ControllerException as error:
                raise await self._diagnosis.explained(error, block) from error
        return tuple(payloads), tuple(asked_at)

    def _changed(self, changed: frozenset[str], at: float) -> LiftValues:
        if SIGNAL in changed:
            self._heartbeat.beat(at)
        if self._values is None or changed != _ONLY_ALIVE:
            self._values = lift_values(
                self._reader.values,
                self._reader.unlisted,
                self._names,
                watchdog_unit_s=self._watchdog_unit_s,
                floor_under_way=self._floor_under_way,
            )
            self._presses.changed(self._values, at)
            self._diagnosis.report_unlisted(self._values)
            for name in ended(self._commands, self._values, self._codec.signals):
                self._outputs.let_go(name)
                self._carrier.end_dropped()
                self._carrier.stir()
        return self._values

    async def _take_over(self, epoch: int) -> None:
        """Look at our own outputs over a new connection before anything is believed or written."""
        epochs = self._lines.epochs
        changed = {endpoint for endpoint, number in epochs.items() if number != self._epochs.get(endpoint)}
        cells: dict[Cell, int] = {}
        for block, names in self._writer.read_blocks(changed).items():
            try:
                cells |= await self._lines.cells([block])
            except UnitOffline:
                raise
            except ControllerException as error:
                raise PointsRefused(error, f"it does not say what our outputs hold: {names}") from error
        if self._commands:
            self._outputs.reconnected(cells, asyncio.get_running_loop().time(), changed)
            self._carrier.stir()
        self._epoch, self._epochs = epoch, epochs
        self._diagnosis.forget()

    def _is_unread(self) -> bool:
        """Whether a connection is new, and nothing was read over it yet."""
        return self._lines.epoch != self._epoch

    def _clear(self, name: str) -> None:
        """Let go of what somebody else has pressed."""
        self._outputs.clear(name, asyncio.get_running_loop().time())
        self._carrier.stir()


def _command(name: str) -> Command:
    kind, _, side = name.partition(".")
    return Command(CommandKind(kind), side=Side(side) if side else None)
