"""A register face of any map, and its time: a plain number."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from register_maps.codec import Codec
from register_maps.words import Door, Side, Table
from simulator import shaft
from simulator.controller import Inputs, Parameters, ShownState
from simulator.modes import Key
from simulator.registers import Endpoint, RegisterFace
from tests.support.shipped_maps import compiled

SCAN_S = 0.05


@dataclass
class Faced:
    """One face and its time; every write takes effect after `after_s`."""

    face: RegisterFace
    now: float = 0.0

    def read(self, table: Table, address: int, count: int = 1, *, of: str = "") -> list[int]:
        return self.device(of).read(table, address, count, self.now)

    def bit(self, table: Table, address: int, *, of: str = "") -> int:
        return self.read(table, address, of=of)[0]

    def write(self, table: Table, address: int, *values: int, after_s: float = 0.0, of: str = "") -> None:
        self.now += after_s
        self.device(of).write(table, address, values, self.now)

    def mask(self, address: int, keep: int, put: int, *, of: str = "") -> None:
        self.device(of).mask_write(address, keep, put, self.now)

    def pulse(self, address: int, counts: int, *, of: str = "") -> None:
        self.device(of).pulse(address, counts, self.now)

    def device(self, of: str) -> RegisterFace | Endpoint:
        return self.face.endpoint(of) if of else self.face

    def people(self, inputs: Inputs) -> ShownState:
        """Let people do this, and the next scans see it."""
        self.face.people(self.now, inputs)
        return self.after(3 * SCAN_S)

    def after(self, duration_s: float) -> ShownState:
        """Let time pass with nobody looking, then look."""
        self.now += duration_s
        self.face.advance(self.now)
        return self.face.picture

    def until(self, true: Callable[[ShownState], bool], within_s: float = 60.0) -> ShownState:
        """Look at every scan until it is so."""
        for _ in range(round(within_s / SCAN_S)):
            if true(self.face.picture):
                return self.face.picture
            self.after(SCAN_S)
        raise AssertionError(f"not within {within_s} s: {self.face.picture}")


def faced(
    codec: Codec | str,
    codes: Sequence[int],
    *,
    start: int = 0,
    key: Key = Key.NORMAL,
    sides: frozenset[Side] = frozenset({Side.FRONT}),
    like: Parameters | None = None,
) -> Faced:
    """A lift of this map, or of the shipped map of this name, with these floors; `like` are settings beside its building."""
    codec = compiled(codec) if isinstance(codec, str) else codec
    building = shaft.Parameters(heights_m=shaft.even_heights(len(codes)), doors_at=(sides,) * len(codes))
    parameters = replace(like or Parameters(), shaft=building)
    return Faced(RegisterFace(codec, codes, parameters, start=start, key=key))


def is_open(picture: ShownState) -> bool:
    return picture.doors[Side.FRONT] is Door.OPEN


def is_closed(picture: ShownState) -> bool:
    return picture.doors[Side.FRONT] is Door.CLOSED


def stands_open_at(floor: int) -> Callable[[ShownState], bool]:
    return lambda picture: picture.door_open_floor == floor
