"""The register face of a simulated lift: any map, with a controller behind it.

Time is handed in with every access and the controller is stepped to it first, so each write takes effect at its own
instant: a press and its release are two events, however close they are.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

from register_maps.codec import Codec, Image
from register_maps.schema import Kind
from register_maps.words import Table
from simulator import controller, network_commands, shaft
from simulator.cells import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, Cells, ExceptionReply, NoReply
from simulator.faults import Fault, Homing, LostPress, MachineFault, NetworkFault, Reboot, SlotKept, Stopped
from simulator.modes import Key
from simulator.network_commands import WATCHDOG_REFRESHES
from simulator.register_faults import RegisterFaults, ShownRegisters, restarted, step_stopped
from simulator.shaft import NEGLIGIBLE_S
from simulator.shown_signals import ShownSignals
from simulator.state import Inputs, Parameters, ShownState, State

__all__ = [
    "ILLEGAL_ADDRESS",
    "ILLEGAL_FUNCTION",
    "ILLEGAL_VALUE",
    "WATCHDOG_REFRESHES",
    "Endpoint",
    "ExceptionReply",
    "NoReply",
    "RegisterFace",
]

BEATS_PER_S = 2
"""How often the alive counter counts. Chosen: twice as often as the generic map requires."""


_picture_fields = attrgetter(
    "shaft",
    "mode",
    "car_calls",
    "landing_calls",
    "called",
    "destination",
    "image",
    "handshake",
    "active_faults",
    "homes_from",
    "network_memory.tripped",
)
"""What `controller.picture` makes a picture of: not the timers, which count in every scan."""
_signal_fields = attrgetter(*(name for name in ShownState._fields if name not in ("position_m", "speed_m_s")))
"""The fields of a picture that signals show, unless there is a car position."""
_signal_fields_with_position = attrgetter(*(name for name in ShownState._fields if name != "speed_m_s"))


class RegisterFace:
    """One simulated lift behind the registers of its map; by itself it is the controller, one of its devices.

    `floor_codes` are the codes of the floors, lowest first; raises ValueError for one that the map cannot express. Where
    `parameters` leave the watchdog open it is that of the map; a `hold_watchdog_s` of infinity is none at all.
    """

    def __init__(
        self, codec: Codec, floor_codes: Sequence[int], parameters: Parameters, *, start: int = 0, key: Key = Key.NORMAL
    ) -> None:
        self.parameters = network_commands.apply_map(parameters, codec)
        self._codec = codec
        self._codes = tuple(floor_codes)
        for command in codec.commands.values():
            for code in self._codes if command.is_call else ():
                command.encode(code)
        self._state = controller.initial(self.parameters, floor_index=start, key=key)
        self._inputs = Inputs(key=key)
        self._peoples_faults: frozenset[MachineFault] = frozenset()
        self._now = 0.0
        self._cells = Cells(codec)
        self._beat = network_commands.heartbeat_count(codec, self._cells.program_cells)
        self._signals = ShownSignals(
            codec, self._codes, self.parameters.hold_watchdog_s, self.parameters.shaft.heights_m
        )
        self._shown_fields = _signal_fields_with_position if "car_position" in codec.signals else _signal_fields
        self._shown: State | None = None
        """The state when the registers were last updated, its picture with the count, and the values they show."""
        self._made_of: tuple[ShownState, int] | None = None
        self._last_shown: tuple[object, ShownRegisters] | None = None
        self._counts = any(signal.kind is Kind.COUNTER for signal in codec.signals.values())
        self._beats = 0
        """The last count of the alive counter."""
        self._beats_from = 0.0
        self._register_faults = RegisterFaults(codec, self._codes, self._cells)
        self._homes = False
        """The program has started and does not know the position of its car yet."""
        self._watchers: list[Callable[[], None]] = []
        self._pictured: tuple[State, object, ShownState] | None = None
        """The last picture, with its state and the fields it was made of; reused while they have not changed."""
        self._show()

    @property
    def picture(self) -> ShownState:
        """The true state of the lift, by its own physics."""
        state, last = self._state, self._pictured
        if last is not None and last[0] is state:
            return last[2]
        made_of = _picture_fields(state)
        picture = last[2] if last is not None and last[1] == made_of else controller.picture(state, self.parameters)
        self._pictured = state, made_of, picture
        return picture

    @property
    def inputs(self) -> Inputs:
        """What people press, hold and turn, including the initial key."""
        return self._inputs

    @property
    def commands(self) -> Mapping[str, int]:
        """The commands present on the network: the index of the floor for a call, 1 for others."""
        return self._inputs.commands

    @property
    def cleared_holds(self) -> Collection[str]:
        """The holds that continue although the program has cleared their points."""
        return self._cells.cleared_holds

    @property
    def cells(self) -> Image:
        """The written cells as the program sees them."""
        return self._cells.program_cells

    @property
    def lost(self) -> Mapping[str, int]:
        """Presses that are stored but not seen by the program, by command."""
        return self._register_faults.lost

    @property
    def believed(self) -> Mapping[str, int]:
        """The `commands` that the controller acts on: no hold whose watchdog ran out, nothing that needs robot mode without it."""
        return self._state.network_memory.given

    def endpoint(self, name: str) -> Endpoint:
        """One of the map's further devices. Raises ValueError for a name that the map does not have."""
        if name not in self._codec.map.endpoints:
            has = ", ".join(self._codec.map.endpoints) or "none"
            raise ValueError(f"{self._codec.map.name} has no endpoint {name}; it has {has}")
        return Endpoint(self, name)

    def advance(self, now: float) -> None:
        """Step the lift to `now` (seconds, never backwards)."""
        cells, foreign = self._cells, self._register_faults.foreign
        while (at := min(cells.next_end, foreign.next_at)) <= now + NEGLIGIBLE_S:
            self._step(min(at, now))
            if at == cells.next_end:
                cells.end_next()
                self._take_inputs()
            else:
                self._write_foreign(at)
        self._step(now)
        self._show()

    def people(self, now: float, inputs: Inputs) -> None:
        """Change what people press, hold and turn; network commands and faults stay."""
        self.advance(now)
        self._peoples_faults = inputs.faults
        commands, signs_of_life = self._inputs.commands, self._inputs.signs_of_life
        self._inputs = replace(inputs, commands=commands, signs_of_life=signs_of_life, faults=self._machine_faults)

    # -- faults

    @property
    def faults(self) -> frozenset[Fault]:
        """The faults that were begun and not ended."""
        return self._register_faults.present

    def begin(self, fault: Fault, now: float) -> None:
        """Begin a fault; one that is present stays as it is.

        Raises ValueError for a foreign writer or a signal that this map cannot have.
        """
        self.advance(now)
        if fault in self.faults:
            return
        self._register_faults.begin(
            fault,
            now,
            self._register_faults.falsify(ShownRegisters(self.picture, self._beats, obeyed=self._cells.obeyed)),
        )
        match fault:
            case LostPress():
                self._register_faults.start_losing(
                    fault, network_commands.present_commands(self._codec, self._cells.program_cells, self._codes)
                )
            case Reboot():
                self._state = restarted(self._state, self._inputs.key, self.parameters)
                self._homes = False
            case _:
                pass
        self._change(fault, now)

    def end(self, fault: Fault, now: float) -> None:
        """End a fault; nothing happens if it is not present."""
        self.advance(now)
        if fault not in self.faults:
            return
        self._register_faults.end(fault)
        match fault:
            case LostPress():
                self._register_faults.stop_losing(fault)
            case Reboot():
                self._beats_from = now
                self._homes = fault.homes and not self._is_home()
            case Stopped():
                self._beats_from = now - self._beats / BEATS_PER_S
            case _:
                pass
        self._change(fault, now)

    def _change(self, fault: Fault, now: float) -> None:
        """Apply and show the effect of a fault that has begun or ended."""
        self._inputs = replace(self._inputs, faults=self._machine_faults)
        self._shown = self._made_of = self._last_shown = None
        self._take_inputs()
        self.advance(now)
        if isinstance(fault, NetworkFault):
            for watcher in self._watchers:
                watcher()

    @property
    def on_network(self) -> bool:
        """Whether it answers at all; otherwise reading and writing raise NoReply."""
        return not self._register_faults.is_off_network

    def admits(self, now: float) -> bool:
        """Whether it accepts another connection; existing ones end when it is off the network."""
        self.advance(now)
        return self.on_network and SlotKept() not in self.faults

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call this whenever a fault of the network has begun or ended."""
        self._watchers.append(watcher)

    # -- what clients do

    def read(self, table: Table, address: int, count: int, now: float, *, endpoint: str = "") -> list[int]:
        """Read cells by their address on the wire. Raises ExceptionReply outside what the map serves."""
        self._answer(now)
        return self._cells.read(endpoint, table, address, count)

    def stored(self, table: Table, address: int, now: float, *, endpoint: str = "") -> int:
        """Return what was last written to a cell, whatever it shows: a mask write starts from it."""
        self._answer(now)
        return self._cells.stored(endpoint, table, address)

    def write(self, table: Table, address: int, values: Sequence[int], now: float, *, endpoint: str = "") -> None:
        """Write cells by their address on the wire; takes effect at `now`."""
        self._answer(now)
        if self._register_faults.drops_writes:
            self._cells.pretend(endpoint, table, address, values)
            return
        if self._cells.write(endpoint, table, address, values, now):
            self._written()

    def mask_write(self, address: int, keep: int, put: int, now: float, *, endpoint: str = "") -> None:
        """Write some bits of a holding register: its contents AND `keep`, OR `put` without `keep` (FC22)."""
        cell = self.stored(Table.HOLDING, address, now, endpoint=endpoint)
        self.write(Table.HOLDING, address, [cell & keep | put & ~keep], now, endpoint=endpoint)

    def pulse(self, address: int, counts: int, now: float, *, endpoint: str = "") -> None:
        """Set a coil for so many counts of its device. Raises ExceptionReply where the map has no such coil."""
        self._answer(now)
        self._cells.timed_coil(endpoint, Table.COIL, address)
        if not self._register_faults.drops_writes:
            self._cells.pulse(endpoint, Table.COIL, address, counts, now)
            self._written()

    def _answer(self, now: float) -> None:
        self.advance(now)
        if self._register_faults.is_off_network:
            raise NoReply

    def _written(self) -> None:
        """Handle a write of a client: that, or with a heartbeat its change, is a sign of life."""
        faults = self._register_faults
        beat = network_commands.heartbeat_count(self._codec, self._cells.program_cells)
        if (beat is None or beat != self._beat) and not (faults.ignores_writes or faults.is_stopped):
            self._sign_of_life(beat)
        self._take_inputs()
        self._show()

    def _write_foreign(self, now: float) -> None:
        """Carry out a foreign write: a sign of life only if it is the heartbeat."""
        fault = self._register_faults.foreign.take_due()
        if self._register_faults.is_off_network or self._register_faults.drops_writes:
            return
        self._register_faults.foreign.write(fault, now)
        beat = network_commands.heartbeat_count(self._codec, self._cells.program_cells)
        if beat != self._beat:
            self._sign_of_life(beat)
        self._take_inputs(ours=False)

    def _sign_of_life(self, beat: int | None) -> None:
        self._beat = beat
        self._inputs = replace(self._inputs, signs_of_life=self._inputs.signs_of_life + 1)

    def _take_inputs(self, *, ours: bool = True) -> None:
        present = dict.fromkeys(self._cells.cleared_holds, 1) | network_commands.present_commands(
            self._codec, self._cells.program_cells, self._codes
        )
        visible = self._register_faults.visible_commands(present, ours=ours)
        if visible != self._inputs.commands:
            self._inputs = replace(self._inputs, commands=visible)

    # -- time

    def _step(self, now: float) -> None:
        if now <= self._now:
            return
        dt, self._now = now - self._now, now
        if self._register_faults.is_stopped:
            self._state = step_stopped(self._state, dt, self.parameters)
            return
        self._state = controller.step(self._state, self._inputs, dt, self.parameters)
        if self._homes and self._is_home():
            self._homes = False
            self._inputs = replace(self._inputs, faults=self._machine_faults)

    def _is_home(self) -> bool:
        return shaft.level_floor(self._state.shaft, self.parameters.shaft) == 0

    @property
    def _machine_faults(self) -> frozenset[MachineFault]:
        begun = frozenset(fault for fault in self.faults if isinstance(fault, MachineFault))
        return self._peoples_faults | begun | ({Homing()} if self._homes else frozenset())

    def _show(self) -> None:
        """Update the values shown, if they can have changed."""
        state, stale = self._state, self._cells.stale
        if state is self._shown and not stale:
            return
        self._shown = state
        if self._counts and not self._register_faults.is_stopped:
            self._beats = int((self._now - self._beats_from) * BEATS_PER_S) & 0xFFFF
        before, picture = self._made_of, self.picture
        if before is not None and picture is before[0] and self._beats == before[1] and not stale:
            return
        self._made_of = picture, self._beats
        shown = ShownRegisters(picture, self._beats, obeyed=self._cells.obeyed)
        if self._register_faults.is_falsified:
            shown = self._register_faults.falsify(shown)
        fields, last = (self._shown_fields(shown.picture), shown.false_signals), self._last_shown
        if last is not None and fields == last[0]:
            if shown.beat == last[1].beat and not stale:
                return
            shown = last[1]._replace(beat=shown.beat)  # the picture is the same to the signals, which have seen it
        self._last_shown = fields, shown
        self._cells.show(lambda image: self._signals.insert(image, *shown))


class Endpoint:
    """One further device of a simulated lift."""

    def __init__(self, face: RegisterFace, name: str) -> None:
        self._face = face
        self._name = name

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Read cells. Raises ExceptionReply outside what this device serves."""
        return self._face.read(table, address, count, now, endpoint=self._name)

    def stored(self, table: Table, address: int, now: float) -> int:
        """Return what was last written to a cell, whatever it shows."""
        return self._face.stored(table, address, now, endpoint=self._name)

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Write cells; takes effect at `now`."""
        self._face.write(table, address, values, now, endpoint=self._name)

    def mask_write(self, address: int, keep: int, put: int, now: float) -> None:
        """Write some bits of a holding register."""
        self._face.mask_write(address, keep, put, now, endpoint=self._name)

    def pulse(self, address: int, counts: int, now: float) -> None:
        """Set a coil for so many counts of its device."""
        self._face.pulse(address, counts, now, endpoint=self._name)

    @property
    def on_network(self) -> bool:
        """Whether the devices of this lift answer at all."""
        return self._face.on_network

    @property
    def faults(self) -> frozenset[Fault]:
        """The faults of the lift of this device."""
        return self._face.faults

    def admits(self, now: float) -> bool:
        """Whether it accepts another connection."""
        return self._face.admits(now)

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call this whenever a fault of the network has begun or ended."""
        self._face.watch(watcher)
