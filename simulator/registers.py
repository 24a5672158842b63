"""The register face of a simulated lift: any map, with a controller behind it.

Time is handed in with every access and the controller is stepped to it first, so each write takes effect at its own
instant: a press and its release are two events, however close they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from register_maps.codec import Codec
from register_maps.words import Table
from simulator import asks, controller
from simulator.asks import WATCHDOG_REFRESHES
from simulator.cells import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, Cells, Objection
from simulator.modes import Key
from simulator.says import Says
from simulator.shaft import NEGLIGIBLE_S
from simulator.state import Inputs, Parameters, Picture

__all__ = [
    "ILLEGAL_ADDRESS",
    "ILLEGAL_FUNCTION",
    "ILLEGAL_VALUE",
    "WATCHDOG_REFRESHES",
    "Endpoint",
    "Objection",
    "RegisterFace",
]

BEATS_PER_S = 2
"""How often the alive counter counts. Chosen: twice as often as the generic map asks for."""


class RegisterFace:
    """One simulated lift behind the registers of its map; by itself it is the controller, one of its devices.

    `floor_codes` are the codes of the floors, lowest first; raises ValueError for one that the map cannot express.
    """

    def __init__(
        self, codec: Codec, floor_codes: Sequence[int], parameters: Parameters, *, start: int = 0, key: Key = Key.NORMAL
    ) -> None:
        self.parameters = asks.as_the_map_says(parameters, codec)
        self._codec = codec
        self._codes = tuple(floor_codes)
        for command in codec.commands.values():
            for code in self._codes if command.is_call else ():
                command.encode(code)
        self._state = controller.initial(self.parameters, floor_index=start, key=key)
        self._inputs = Inputs(key=key)
        self._now = 0.0
        self._cells = Cells(codec)
        self._beat = asks.beat(codec, self._cells.written)
        self._says = Says(codec, self._codes, self.parameters.hold_watchdog_s)
        self._shown: tuple[Picture, int] | None = None
        self._show()

    @property
    def picture(self) -> Picture:
        """What the lift really does, by its own physics."""
        return controller.picture(self._state, self.parameters)

    def endpoint(self, name: str) -> Endpoint:
        """One of the map's further devices. Raises ValueError for a name that the map does not have."""
        if name not in self._codec.map.endpoints:
            has = ", ".join(self._codec.map.endpoints) or "none"
            raise ValueError(f"{self._codec.map.name} has no endpoint {name}; it has {has}")
        return Endpoint(self, name)

    def advance(self, now: float) -> None:
        """Step the lift to `now` (seconds, never backwards)."""
        ended = False
        while (at := self._cells.next_end) <= now + NEGLIGIBLE_S:
            self._step(min(at, now))
            self._cells.end_next()
            self._take_inputs()
            ended = True
        self._step(now)
        self._show(anyway=ended)

    def people(self, now: float, inputs: Inputs) -> None:
        """Change what people press, hold and turn, beside what comes over the network."""
        self.advance(now)
        self._inputs = replace(inputs, asked=self._inputs.asked, signs_of_life=self._inputs.signs_of_life)

    def read(self, table: Table, address: int, count: int, now: float, *, endpoint: str = "") -> list[int]:
        """Read cells by their address on the wire. Raises Objection outside what the map serves."""
        self.advance(now)
        return self._cells.read(endpoint, table, address, count)

    def stored(self, table: Table, address: int, now: float, *, endpoint: str = "") -> int:
        """Return what was last written to a cell, whatever it shows: a mask write starts from it."""
        self.advance(now)
        return self._cells.stored(endpoint, table, address)

    def write(self, table: Table, address: int, values: Sequence[int], now: float, *, endpoint: str = "") -> None:
        """Write cells by their address on the wire; takes effect at `now`."""
        self.advance(now)
        self._cells.write(endpoint, table, address, values, now)
        self._written()

    def mask_write(self, address: int, keep: int, put: int, now: float, *, endpoint: str = "") -> None:
        """Write some bits of a holding register: its contents AND `keep`, OR `put` without `keep` (FC22)."""
        cell = self.stored(Table.HOLDING, address, now, endpoint=endpoint)
        self.write(Table.HOLDING, address, [cell & keep | put & ~keep], now, endpoint=endpoint)

    def pulse(self, address: int, counts: int, now: float, *, endpoint: str = "") -> None:
        """Set a coil for so many counts of its device. Raises Objection where the map has no such coil."""
        self.advance(now)
        self._cells.pulse(endpoint, Table.COIL, address, counts, now)
        self._written()

    def _step(self, now: float) -> None:
        if now > self._now:
            self._state = controller.step(self._state, self._inputs, now - self._now, self.parameters)
            self._now = now

    def _written(self) -> None:
        """A client wrote: that, or a heartbeat that moved on, is a sign of life."""
        beat = asks.beat(self._codec, self._cells.written)
        if beat is None or beat != self._beat:
            self._beat = beat
            self._inputs = replace(self._inputs, signs_of_life=self._inputs.signs_of_life + 1)
        self._take_inputs()
        self._show(anyway=True)

    def _take_inputs(self) -> None:
        asked = asks.asked(self._codec, self._cells.written, self._codes)
        if asked != self._inputs.asked:
            self._inputs = replace(self._inputs, asked=asked)

    def _show(self, *, anyway: bool = False) -> None:
        """Bring what the registers show up to date."""
        shown = (self.picture, int(self._now * BEATS_PER_S) & 0xFFFF)
        if shown != self._shown or anyway:
            self._shown = shown
            self._cells.show(lambda image: self._says.into(image, *shown))


class Endpoint:
    """One further device of a simulated lift."""

    def __init__(self, face: RegisterFace, name: str) -> None:
        self._face = face
        self._name = name

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Read cells. Raises Objection outside what this device serves."""
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
