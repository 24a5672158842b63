"""Puts the picture of a lift into the signals of a map. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from register_maps.arbitration import NO_CLAIM, Claim
from register_maps.codec import UNLISTED, Codec, Point, SignalCodec, Value
from register_maps.schema import Kind, Signal
from register_maps.words import Door, Mode, Motion, Side
from simulator.state import ShownState

_MODES = {
    "fire": Mode.FIRE,
    "emergency_power": Mode.EMERGENCY,
    "inspection": Mode.INSPECTION,
    "independent": Mode.INDEPENDENT,
    "out_of_service": Mode.OUT_OF_SERVICE,
}
"""Flags that report one mode."""


@dataclass(frozen=True, slots=True)
class FalseSignals:
    """Signals that differ from the picture."""

    floor_between: bool = False
    """The floor shows between two floors too, where each floor has a switch of its own."""
    contradicting: frozenset[Side] = frozenset()
    """Doors that report open and closed at once."""
    disconnected: frozenset[str] = frozenset()
    """Signals of which all bits read 0."""


NO_FALSE_SIGNALS = FalseSignals()


class ShownSignals:
    """The signals of one map, for a lift with these floor codes, lowest floor first."""

    def __init__(
        self, codec: Codec, codes: Sequence[int], watchdog_s: float | None, heights_m: Sequence[float]
    ) -> None:
        """`watchdog_s` is the time of the watchdog, None where there is none; `heights_m` are those of the floors."""
        self._codec = codec
        self._codes = tuple(codes)
        self._has_handshake = "robot_in_place" in codec.commands
        self._has_robot_mode = "robot_mode_on" in codec.signals or "robot_mode" in codec.commands
        time = codec.map.signals.get("watchdog_time")
        unit_s = (time.unit_s if time is not None else None) or 1.0
        self._watchdog_counts = round((watchdog_s or 0.0) / unit_s)
        floor = codec.signals.get("car_floor")
        limits = {signal.points for signal in codec.signals.values() if signal.kind is Kind.DOOR and signal.per_floor}
        self._floor_is_door = floor is not None and floor.points in limits
        # what a number shows may be at the place of that number, and decides what is there
        shown = sorted(codec.signals, key=lambda name: bool(codec.map.signals[name].thresholds))
        self._signals = [
            (codec.signals[name], [(point.space, point) for point in codec.signals[name].points])
            for name in shown
            if name not in codec.map.derived
        ]
        position = codec.map.signals.get("car_position")
        self._positions = _positions(position, self._codes, heights_m) if position is not None else ()
        """Height of each floor in metres, and the position reported there."""
        self._knows_no_position = position is not None and bool(position.unknown)
        self._inserted: tuple[ShownState, FalseSignals, Claim] | None = None
        """What was inserted last, with these bits of each signal but the counters."""
        self._bits: list[tuple[SignalCodec, list[tuple[str, Point]], int | None]] = []
        self._raw: dict[str, dict[Value, int | None]] = {name: {} for name in codec.signals}
        """What each value was found to be in raw bits; None: there are none for it."""
        self._has_unknown_floor_code = floor is not None and self._encoded(floor, None) is not None

    def insert(
        self,
        image: dict[str, list[int]],
        picture: ShownState,
        beat: int,
        false_signals: FalseSignals = NO_FALSE_SIGNALS,
        obeyed: Claim = NO_CLAIM,
    ) -> None:
        """Put every signal into a register image; `beat` is what a counter stands at, `obeyed` whom the controller obeys."""
        inserted = self._inserted
        if inserted is None or picture is not inserted[0] or false_signals is not inserted[1] or obeyed != inserted[2]:
            self._inserted = picture, false_signals, obeyed
            self._bits = [
                (signal, places, self._raw_of(signal, picture, beat, false_signals, obeyed))
                for signal, places in self._signals
            ]
        for signal, places, bits in self._bits:
            raw = signal.encode(beat) if signal.kind is Kind.COUNTER else bits
            if raw is not None:
                _insert(image, places, raw)
        for side in false_signals.contradicting:
            self._contradict(image, side)
        if false_signals.disconnected:
            for signal, places in self._signals:
                if signal.name in false_signals.disconnected:
                    _insert(image, places, 0)

    def _raw_of(
        self, signal: SignalCodec, picture: ShownState, beat: int, false_signals: FalseSignals, obeyed: Claim
    ) -> int | None:
        """Return the bits that a signal shows; None where the map has none for its value."""
        value = self._value(signal, picture, beat, false_signals, obeyed)
        if signal.kind is Kind.COUNTER or signal.name == "car_position":
            return signal.encode(value)
        encoded = self._raw[signal.name]
        if value not in encoded:
            encoded[value] = self._encoded(signal, value)
        return encoded[value]

    def _value(
        self, signal: SignalCodec, picture: ShownState, beat: int, false_signals: FalseSignals, obeyed: Claim
    ) -> Value:
        match signal.kind:
            case Kind.FLOOR:
                return self._floor(signal, picture, false_signals)
            case Kind.FLOORS:
                return frozenset(self._codes[index] for index in picture.car_calls)
            case Kind.DOOR:
                return self._door(signal, picture)
            case Kind.MOTION:
                return picture.motion
            case Kind.MODE:
                return picture.mode
            case Kind.COUNTER:
                return beat
            case Kind.NUMBER:
                return self._number(signal.name, picture, obeyed)
            case Kind.FLAG:
                return self._flag(signal.name, picture)

    def _floor(self, signal: SignalCodec, picture: ShownState, false_signals: FalseSignals) -> int | None:
        index: int | None = picture.floor
        if signal.name == "destination":
            index = picture.destination
        elif signal.name == "call_accepted":
            index = picture.accepted
        elif self._floor_is_door:
            # its bits are door limits, which are made at an open door only
            index = picture.door_open_floor
        elif signal.per_floor and not (picture.in_door_zone or false_signals.floor_between):
            index = None  # a switch at each floor is made in the door zone only
        elif signal.name == "car_floor" and not (picture.floor_known or signal.per_floor):
            index = None if self._has_unknown_floor_code else picture.last_known_floor
        return None if index is None else self._codes[index]

    def _number(self, name: str, picture: ShownState, obeyed: Claim) -> int | None:
        if name == "car_position":
            return self._position(picture)
        numbers = {
            "watchdog_time": self._watchdog_counts,
            "fault_code": int(picture.fault),
            "epoch": obeyed.epoch,
            "owner": obeyed.owner,
        }
        return numbers.get(name, 0)

    def _position(self, picture: ShownState) -> int | None:
        if self._knows_no_position and not picture.floor_known:
            return None
        if picture.level_floor is not None:
            return round(self._positions[picture.level_floor][1])
        below = [index for index, (height_m, _) in enumerate(self._positions) if height_m <= picture.position_m]
        first = min(below[-1] if below else 0, len(self._positions) - 2)
        (low_m, low), (high_m, high) = self._positions[first : first + 2]
        return round(low + (high - low) * (picture.position_m - low_m) / (high_m - low_m))

    def _door(self, signal: SignalCodec, picture: ShownState) -> Value:
        door = picture.doors.get(Side(signal.name.removeprefix("door.")), Door.CLOSED)
        if not signal.per_floor:
            return door
        is_made = door is Door.OPEN and picture.level_floor is not None
        return frozenset({self._codes[picture.level_floor]} if is_made and picture.level_floor is not None else ())

    def _flag(self, name: str, picture: ShownState) -> bool:
        name, _, side = name.partition(".")
        if name == "obstruction":
            return Side(side) in picture.obstruction
        if name in _MODES:
            return picture.mode is _MODES[name]
        in_service = picture.mode in (Mode.NORMAL, Mode.ROBOT)
        may_pass = picture.door_open_floor is not None and (
            picture.robot_mode_on if self._has_robot_mode else in_service
        )
        flags = {
            "level": picture.level_floor is not None,
            "door_zone": picture.in_door_zone,
            "robot_mode_on": picture.robot_mode_on,
            "may_enter": picture.may_enter if self._has_handshake else may_pass,
            "may_leave": picture.may_leave if self._has_handshake else may_pass,
            "ready": in_service,
            "robots_allowed": picture.robots_allowed,
            "overload": picture.overload,
            "nudging": picture.nudging,
            "fault": picture.fault,
            "watchdog_tripped": picture.watchdog_tripped,
        }
        return flags.get(name, False)

    def _encoded(self, signal: SignalCodec, value: Value) -> int | None:
        """Return the bits of the nearest value this map has a code for, or None."""
        for candidate in (value, *self._nearest(signal, value)):
            try:
                return signal.encode(candidate)
            except ValueError:
                continue
        return None

    def _contradict(self, image: dict[str, list[int]], side: Side) -> None:
        """Show an impossible door; if the map lists every code, the truth stays."""
        for signal, places in self._signals:
            if signal.name == f"door.{side}":
                spec = self._codec.map.signals[signal.name]
                raw: int | None = signal.encode(Door.FAULT) if spec.open_limit or spec.open_limits else None
                if raw is None:
                    codes = range(1 << signal.width)
                    raw = next((code for code in codes if signal.decode(code) is UNLISTED), None)
                if raw is not None:
                    _insert(image, places, raw)

    def _nearest(self, signal: SignalCodec, value: Value) -> tuple[Value, ...]:
        if value in (Door.OPENING, Door.CLOSING):
            # one contact reports one of its two values truly, and otherwise that it is not so
            at_rest = (self._codec.map.signals[signal.name].values or {}).get(0, Door.CLOSED)
            return Door.MOVING, Door(at_rest), Door.CLOSED
        if value is Door.OPEN:
            return (Door.MOVING,)
        if value in (Motion.UP, Motion.DOWN):
            return (Motion.MOVING,)
        return (Mode.NORMAL,) if value is Mode.ROBOT else ()


def _positions(spec: Signal, codes: Sequence[int], heights_m: Sequence[float]) -> tuple[tuple[float, float], ...]:
    """Pair the height of each floor with its position: that of the map's table, else millimetres."""
    table = spec.positions
    if table is None:
        return tuple((height_m, height_m * 1000) for height_m in heights_m)
    if missing := [code for code in codes if code not in table]:
        raise ValueError(f"car_position has no position for the floor with code {missing[0]}")
    return tuple((height_m, table[code]) for height_m, code in zip(heights_m, codes, strict=True))


def _insert(image: dict[str, list[int]], places: Sequence[tuple[str, Point]], raw: int) -> None:
    """Put raw bits where a signal is; each place is a space and a point in it, lowest bits first."""
    for space, point in places:
        cells = image[space]
        cells[point.address] = point.into(cells[point.address], raw)
        raw >>= point.width
