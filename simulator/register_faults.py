"""Applies the faults of registers and network to one register face: false values, lost writes, other writers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from register_maps.arbitration import NO_CLAIM, Claim
from register_maps.codec import Codec, Point
from register_maps.command_codec import payload_counts
from register_maps.words import Door, Motion, Table
from simulator import controller, shaft
from simulator.cells import Cells, ExceptionReply
from simulator.faults import (
    ContradictingLimits,
    DisconnectedSignal,
    Fault,
    FloorAhead,
    ForeignCell,
    ForeignWriter,
    FrozenHeartbeat,
    FrozenRegisters,
    IgnoredWrites,
    LostPress,
    PowerLoss,
    Reboot,
    SaysWrongFloor,
    Stopped,
)
from simulator.modes import Key
from simulator.network import Given
from simulator.shaft import NEGLIGIBLE_S
from simulator.shown_signals import NO_FALSE_SIGNALS, FalseSignals
from simulator.state import Parameters, ShownState, State

Foreign = ForeignWriter | ForeignCell


class ShownRegisters(NamedTuple):
    """The values that the registers show."""

    picture: ShownState
    beat: int
    """Count of the alive counter."""
    false_signals: FalseSignals = NO_FALSE_SIGNALS
    obeyed: Claim = NO_CLAIM
    """Whom the controller obeys, where it decides that."""


class RegisterFaults:
    """The faults of one register face, applied to its cells."""

    def __init__(self, codec: Codec, codes: Sequence[int], cells: Cells) -> None:
        self.present: frozenset[Fault] = frozenset()
        self._codec = codec
        self.foreign = ForeignWriters(codec, tuple(codes), cells)
        self.is_off_network = False
        """The device is not on its network."""
        self.is_stopped = False
        """No program runs."""
        self.ignores_writes = False
        """Writes do not reach the program."""
        self.drops_writes = False
        """Writes are not even stored."""
        self.is_falsified = False
        """The registers do not show the truth."""
        self._presses: LostPresses | None = None
        self._floors = len(codes)
        self._cells = cells
        self._held: ShownRegisters | None = None
        """The last values of a stopped program."""
        self._beat: int | None = None
        """Count of a frozen heartbeat."""

    def begin(self, fault: Fault, now: float, shown: ShownRegisters) -> None:
        """Begin a fault; `shown` are the values at that moment. Raises ValueError for one that this map cannot have."""
        match fault:
            case ForeignWriter() | ForeignCell():
                self.foreign.begin(fault, now)
            case DisconnectedSignal():
                self._check_signal(fault)
            case FrozenRegisters():
                self._cells.freeze()
            case IgnoredWrites(stored=True):
                self._cells.hide_writes()
            case FrozenHeartbeat():
                self._beat = shown.beat
            case Stopped():
                self._held = shown
            case Reboot() | PowerLoss(outputs_held=False):
                self._cells.rest()
            case _:
                pass  # what is present is enough
        self._now_present(self.present | {fault})

    def end(self, fault: Fault) -> None:
        """End a fault that is present."""
        match fault:
            case ForeignWriter() | ForeignCell():
                self.foreign.end(fault)
            case FrozenRegisters():
                self._cells.thaw()
            case IgnoredWrites():
                self._cells.show_writes(stored=fault.stored)
            case FrozenHeartbeat():
                self._beat = None
            case Stopped():
                self._held = None
            case _:
                pass
        self._now_present(self.present - {fault})

    def start_losing(self, fault: LostPress, commands: Given) -> None:
        """Lose the next presses of `fault`, except the `commands` that are present now."""
        presses = self._presses or LostPresses(previous=commands)
        presses.remaining[fault] = fault.times
        self._presses = presses

    def stop_losing(self, fault: LostPress) -> None:
        """Lose no further presses; those that are lost stay so while they last."""
        if self._presses is not None:
            del self._presses.remaining[fault]

    def visible_commands(self, commands: Given, *, ours: bool) -> Given:
        """Return the stored commands that the program sees; `ours` tells whether a client may have stored them."""
        if self._presses is None:
            return commands
        visible = self._presses.visible_commands(commands, ours=ours)
        if self._presses.is_over:
            self._presses = None
        return visible

    @property
    def lost(self) -> Mapping[str, int]:
        """Lost presses that still last, by command."""
        return {} if self._presses is None else self._presses.lost

    def falsify(self, shown: ShownRegisters) -> ShownRegisters:
        """Return the values to show instead of the truth."""
        if self._held is not None:
            return self._held
        shown = falsify_registers(shown, self.present, self._floors)
        return shown if self._beat is None else shown._replace(beat=self._beat)

    def _now_present(self, faults: frozenset[Fault]) -> None:
        self.present = faults
        self.is_off_network = _any(faults, Reboot, PowerLoss)
        self.is_stopped = _any(faults, Reboot, Stopped)
        self.ignores_writes = _any(faults, IgnoredWrites)
        self.drops_writes = IgnoredWrites(stored=False) in faults
        self.is_falsified = _any(
            faults, SaysWrongFloor, FloorAhead, ContradictingLimits, DisconnectedSignal, FrozenHeartbeat, Stopped
        )

    def _check_signal(self, fault: DisconnectedSignal) -> None:
        source = self._codec.map
        wired = [name for name in self._codec.signals if name not in source.derived]
        if fault.signal not in wired:
            raise ValueError(
                f"{source.name} has no wire for a signal {fault.signal}; it has {', '.join(wired) or 'none'}"
            )


def _any(faults: frozenset[Fault], *kinds: type) -> bool:
    return any(isinstance(fault, kinds) for fault in faults)


# -- false values


def falsify_registers(shown: ShownRegisters, faults: frozenset[Fault], floors: int) -> ShownRegisters:
    """Return the values falsified by these faults; the lift has so many floors."""
    picture = shown.picture
    sides = frozenset(fault.side for fault in faults if isinstance(fault, ContradictingLimits))
    ahead = FloorAhead() in faults and _leaves(picture)
    if ahead:
        picture = picture._replace(floor=_next_floor(picture, floors))
    for fault in faults:
        if isinstance(fault, SaysWrongFloor):
            picture = _moved(picture, fault.by, floors)
    disconnected = frozenset(fault.signal for fault in faults if isinstance(fault, DisconnectedSignal))
    return shown._replace(picture=picture, false_signals=FalseSignals(ahead, sides, disconnected))


def _leaves(picture: ShownState) -> bool:
    return picture.motion is not Motion.STOPPED and all(door is Door.CLOSED for door in picture.doors.values())


def _next_floor(picture: ShownState, floors: int) -> int:
    if picture.destination is not None:
        return picture.destination
    step = 1 if picture.motion is Motion.UP else -1
    return min(max(picture.floor + step, 0), floors - 1)


def _moved(picture: ShownState, by: int, floors: int) -> ShownState:
    """Return the picture with every floor sensor reporting another floor."""

    def other(floor: int) -> int:
        to = min(max(floor + by, 0), floors - 1)
        return to if to != floor else min(max(floor - by, 0), floors - 1)

    return picture._replace(
        floor=other(picture.floor),
        level_floor=None if picture.level_floor is None else other(picture.level_floor),
        door_open_floor=None if picture.door_open_floor is None else other(picture.door_open_floor),
    )


# -- lost presses


@dataclass
class LostPresses:
    """Presses that are stored and that the program does not see."""

    previous: Given
    """The commands stored before."""
    remaining: dict[LostPress, int] = field(default_factory=dict)
    """How many more presses each fault loses."""
    lost: dict[str, int] = field(default_factory=dict)
    """Lost presses that last, by command."""

    def visible_commands(self, commands: Given, *, ours: bool) -> Given:
        """Return the commands that the program sees; only our presses are lost."""
        self.lost = {name: value for name, value in self.lost.items() if commands.get(name) == value}
        pressed = {name: value for name, value in commands.items() if self.previous.get(name) != value}
        fault = next((fault for fault, remaining in self.remaining.items() if remaining), None)
        if ours and pressed and fault is not None:
            self.remaining[fault] -= 1
            self.lost |= pressed
        self.previous = commands
        return {name: value for name, value in commands.items() if self.lost.get(name) != value}

    @property
    def is_over(self) -> bool:
        """Whether no press is lost or can be lost any more."""
        return not self.remaining and not self.lost


# -- who else writes


class ForeignWriters:
    """Other writers to the cells of one map, each at its own instants."""

    def __init__(self, codec: Codec, codes: tuple[int, ...], cells: Cells) -> None:
        self.next_at = inf
        """When the next write is due."""
        self._at: dict[Foreign, float] = {}
        self._codec = codec
        self._codes = codes
        self._cells = cells

    def begin(self, fault: Foreign, now: float) -> None:
        """Begin a writer, whose first write is due at once. Raises ValueError for one that this map cannot have."""
        self._check(fault)
        self._set({**self._at, fault: now})

    def end(self, fault: Foreign) -> None:
        """End a writer."""
        self._set({other: at for other, at in self._at.items() if other != fault})

    def take_due(self) -> Foreign:
        """Return the writer whose write is due, and schedule its next one."""
        fault, at = min(self._at.items(), key=lambda item: item[1])
        self._set({**self._at, fault: at + fault.every_s})
        return fault

    def write(self, fault: Foreign, now: float) -> None:
        """Write as a client would; of a call over several outputs all of them."""
        command = self._codec.commands[fault.command] if isinstance(fault, ForeignWriter) else None
        for point, value in self._points(fault).items():
            if command is not None and command.is_timed_coil and value:
                counts = payload_counts(command.spec)
                self._cells.pulse(point.endpoint, point.table, point.address, counts, now)
            else:
                stored = self._cells.stored(point.endpoint, point.table, point.address)
                self._cells.write(point.endpoint, point.table, point.address, [point.into(stored, value)], now)

    def _set(self, at: dict[Foreign, float]) -> None:
        self._at = at
        self.next_at = min(at.values(), default=inf)

    def _points(self, fault: Foreign) -> Mapping[Point, int]:
        if isinstance(fault, ForeignCell):
            return {Point(fault.table, fault.address, 0, 16, fault.endpoint): fault.value}
        command = self._codec.commands[fault.command]
        if command.spec.is_heartbeat:
            return command.encode((command.decode(self._cells.written) or 0) + 1)
        if not fault.pressed:
            return command.encode(None)
        return command.encode(1 if fault.floor is None else self._codes[fault.floor])

    def _check(self, fault: Foreign) -> None:
        if isinstance(fault, ForeignCell):
            self._check_cell(fault)
            return
        command = self._codec.commands.get(fault.command)
        if command is None:
            has = ", ".join(self._codec.commands)
            raise ValueError(f"{self._codec.map.name} has no command {fault.command}; it has {has}")
        if command.is_call and fault.pressed and fault.floor not in range(len(self._codes)):
            raise ValueError(f"{fault.command} needs a floor from 0 to {len(self._codes) - 1}, not {fault.floor}")

    def _check_cell(self, fault: ForeignCell) -> None:
        cell = f"{fault.endpoint}/{fault.table}:{fault.address}".removeprefix("/")
        if fault.table not in (Table.COIL, Table.HOLDING):
            raise ValueError(f"{cell} cannot be written: only coils and holding registers can")
        highest = 1 if fault.table is Table.COIL else 0xFFFF
        if not 0 <= fault.value <= highest:
            raise ValueError(f"{cell} takes 0 to {highest}, not {fault.value}")
        try:
            self._cells.writable(fault.endpoint, fault.table, fault.address, [fault.value])
        except ExceptionReply as objection:
            raise ValueError(
                f"{self._codec.map.name} answers a write of {fault.value} to {cell} with {objection}"
            ) from None


# -- a lift without its program


def step_stopped(state: State, dt: float, parameters: Parameters) -> State:
    """What `dt` real seconds make of the lift while no program runs: the car brakes and stands, doors stay as they are.

    In scans like `controller.step`, so that it does not matter how time is cut into steps.
    """
    since_scan_s = state.since_scan_s + dt
    while since_scan_s >= parameters.scan_s - NEGLIGIBLE_S:
        since_scan_s -= parameters.scan_s
        if state.shaft.standing:
            since_scan_s -= int((since_scan_s + NEGLIGIBLE_S) / parameters.scan_s) * parameters.scan_s
        else:
            state = state._replace(shaft=_braked(state.shaft, parameters))
    return state._replace(since_scan_s=since_scan_s)


def _braked(car: shaft.State, parameters: Parameters) -> shaft.State:
    """Return the car one scan later; without doors, because the mechanics would close them."""
    without = car._replace(doors={})
    braked = shaft.step(without, shaft.Orders(), parameters.scan_s * parameters.speed, parameters.shaft)
    return braked._replace(doors=car.doors)


def restarted(state: State, key: Key, parameters: Parameters) -> State:
    """Return the state of a program that has just started, with car and doors where they are."""
    fresh = controller.initial(parameters, floor_index=state.shaft.floor, key=key)
    return fresh._replace(shaft=state.shaft, since_scan_s=state.since_scan_s)
