"""The register face of a simulated lift: any map, and what it makes of a controller's picture and inputs.

Time is handed in with every access and the controller is stepped to it first, so each write takes effect at its own
instant: a press and its release are two events, however close they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from register_maps.codec import Codec, SignalCodec, Value
from register_maps.schema import Kind
from register_maps.words import Door, Mode, Side, Table
from simulator import controller
from simulator.controller import Inputs, Parameters, Picture
from simulator.modes import Key

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

BEATS_PER_S = 2
"""How often the alive counter counts. Chosen: twice as often as the generic map asks for."""

WATCHDOG_REFRESHES = 3
"""A hold that is not written again for so many of its refresh times falls. Chosen: one lost write must not open a grip, and
people wait no longer than that for their lift."""


class Objection(Exception):
    """The device answers with an exception code instead."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class RegisterFace:
    """One simulated lift behind one register image.

    `floor_codes` are the codes of the floors, lowest first; raises ValueError for one that the map cannot express.
    """

    def __init__(
        self, codec: Codec, floor_codes: Sequence[int], parameters: Parameters, *, start: int = 0, key: Key = Key.NORMAL
    ) -> None:
        self.parameters = replace(parameters, hold_watchdog_s=_watchdog_s(codec))
        self._codec = codec
        self._codes = tuple(floor_codes)
        self._state = controller.initial(self.parameters, floor_index=start, key=key)
        self._inputs = Inputs(key=key)
        self._people = Inputs(key=key)
        self._now = 0.0
        self._called: int | None = None
        self._image = codec.empty_image()
        for command in codec.commands.values():
            for (table, address), value in command.encode(None).items():
                self._image[table][address] = value
            if command.is_call:
                for code in self._codes:
                    command.encode(code)
        self._gated = False
        """A command that counts only in robot mode is given."""
        owned = {cell for command in codec.commands.values() for cell in command.encode(None)}
        self._said = {(p.table, p.address) for signal in codec.signals.values() for p in signal.points} - owned
        """Cells in which the lift speaks; whatever a client writes there is overwritten by the next scan, as on a controller."""
        self._shown: tuple[Picture, int] | None = None
        self._show()

    @property
    def picture(self) -> Picture:
        """What the lift really does, by its own physics."""
        return controller.picture(self._state, self.parameters)

    def advance(self, now: float) -> None:
        """Step the lift to `now` (seconds, never backwards)."""
        while self._gated and now - self._now > controller.until_scan_s(self._state, self.parameters):
            # whether a gated command counts is decided anew at every scan, whoever looks or does not
            before = (self._inputs, replace(self._state, since_scan_s=0.0))
            self._step(self._now + controller.until_scan_s(self._state, self.parameters))
            self._take_inputs(written=False)
            if before == (self._inputs, replace(self._state, since_scan_s=0.0)):
                break
        if now > self._now:
            self._step(now)
            if self._gated:
                self._take_inputs(written=False)
        self._show()

    def _step(self, now: float) -> None:
        self._state = controller.step(self._state, self._inputs, now - self._now, self.parameters)
        self._now = now

    def people(self, now: float, inputs: Inputs) -> None:
        """Change what people press, hold and turn, beside what comes over the network."""
        self.advance(now)
        self._people = inputs
        self._take_inputs(written=False)

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Read cells by their address on the wire. Raises Objection outside what the map serves."""
        self.advance(now)
        self._check_served(table, address, count)
        return self._image[table][address : address + count]

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Write cells by their address on the wire; takes effect at `now`."""
        self.advance(now)
        self._check_served(table, address, len(values))
        self._image[table][address : address + len(values)] = values
        self._take_inputs(written=True)
        self._show(anyway=True)

    def _check_served(self, table: Table, address: int, count: int) -> None:
        spans = self._codec.served.get(table)
        if spans is None:
            raise Objection(ILLEGAL_FUNCTION)
        if not any(address in span and address + count <= span.stop for span in spans):
            raise Objection(ILLEGAL_ADDRESS)

    def _take_inputs(self, *, written: bool) -> None:
        """Put the command cells and what people do onto the controller's inputs."""
        robot_mode_on = self.picture.robot_mode_on
        asked: dict[str, int | None] = {}
        self._gated = False
        for name, command in self._codec.commands.items():
            asked[name] = command.decode(self._image)
            if asked[name] is not None and "robot_mode_on" in command.spec.requires:
                self._gated = True
                if not robot_mode_on:
                    asked[name] = None
        floor = self._index(asked.get("go_to"))
        if floor is not None:
            self._called = floor
        people = self._people
        self._inputs = replace(
            people,
            car_buttons=people.car_buttons | ({floor} if floor is not None else set()),
            hold_door=people.hold_door | _sides(asked, "hold_door"),
            close_door=people.close_door | _sides(asked, "close_door"),
            robot_mode_request=people.robot_mode_request or asked.get("robot_mode") is not None,
            writes=self._inputs.writes + written,
        )

    def _index(self, code: int | None) -> int | None:
        return self._codes.index(code) if code in self._codes else None

    def _show(self, *, anyway: bool = False) -> None:
        """Bring the signals of the image up to date."""
        shown = (self.picture, int(self._now * BEATS_PER_S) & 0xFFFF)
        if shown == self._shown and not anyway:
            return
        self._shown = shown
        picture, beat = shown
        for table, address in self._said:
            self._image[table][address] = 0
        for signal in self._codec.signals.values():
            _insert(signal, self._image, self._value(signal, picture, beat))

    def _value(self, signal: SignalCodec, picture: Picture, beat: int) -> Value:
        match signal.kind:
            case Kind.FLOOR:
                return self._floor(signal, picture)
            case Kind.DOOR:
                return picture.doors.get(Side(signal.name.removeprefix("door.")), Door.CLOSED)
            case Kind.MOTION:
                return picture.motion
            case Kind.MODE:
                return picture.mode
            case Kind.COUNTER:
                return beat
            case Kind.NUMBER:
                return 0
            case Kind.FLAG:
                return _flag(signal.name, picture)

    def _floor(self, signal: SignalCodec, picture: Picture) -> int | None:
        index: int | None
        if signal.name == "destination":
            index = picture.destination
        elif signal.name == "call_accepted":
            index = self._called if self._called in picture.car_calls else None
        elif len(signal.points) > 1:
            # one switch per floor: it is made in the door zone only
            index = picture.floor if picture.in_door_zone else None
        else:
            index = picture.floor
        return None if index is None else self._codes[index]


def _flag(name: str, picture: Picture) -> bool:
    name, _, side = name.partition(".")
    if name == "obstruction":
        return Side(side) in picture.obstruction
    modes = {
        "fire": Mode.FIRE,
        "emergency_power": Mode.EMERGENCY,
        "inspection": Mode.INSPECTION,
        "independent": Mode.INDEPENDENT,
        "out_of_service": Mode.OUT_OF_SERVICE,
    }
    if name in modes:
        return picture.mode is modes[name]
    others = {
        "level": picture.level_floor is not None,
        "door_zone": picture.in_door_zone,
        "robot_mode_on": picture.robot_mode_on,
        "may_enter": picture.robot_mode_on and picture.door_open_floor is not None,
        "may_leave": picture.robot_mode_on and picture.door_open_floor is not None,
        "ready": picture.mode in (Mode.NORMAL, Mode.ROBOT),
        "robots_allowed": True,
    }
    return others.get(name, False)


def _insert(signal: SignalCodec, image: dict[Table, list[int]], value: Value) -> None:
    """Say a value in the nearest word this map has; a word it has no code for at all reads as 0."""
    nearest: list[Value] = [value]
    if value in (Door.OPENING, Door.CLOSING):
        nearest += [Door.MOVING, Door.CLOSED]
    for candidate in nearest:
        try:
            signal.insert(image, candidate)
        except ValueError:
            continue
        return


def _sides(asked: dict[str, int | None], command: str) -> frozenset[Side]:
    return frozenset(side for side in Side if asked.get(f"{command}.{side}") is not None)


def _watchdog_s(codec: Codec) -> float | None:
    """Return when holds fall without a write; None where the map says that they latch."""
    refresh = [
        command.spec.refresh_s or 1.0
        for command in codec.commands.values()
        if command.spec.on_link_loss == "device_watchdog"
    ]
    return max(refresh) * WATCHDOG_REFRESHES if refresh else None
