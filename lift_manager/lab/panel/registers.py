"""The registers of a simulated lift as a client reads them, by the names of its map, and who wrote them last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import BaseModel, ConfigDict, Field

from register_maps import frames
from register_maps.codec import UNLISTED, Cell, Codec, CommandCodec, Point, SignalCodec, Unlisted, Value
from register_maps.errors import FrameError
from register_maps.schema import Kind
from simulator.cells import NoReply
from simulator.registers import RegisterFace

FLOOR_KINDS = (Kind.FLOOR, Kind.FLOORS)


class Register(BaseModel):
    """One signal or command of the map at its place in the registers."""

    model_config = ConfigDict(frozen=True)

    name: str
    is_command: bool
    addresses: tuple[str, ...] = Field(description="as printed in the map")
    wire: str = Field(description="table and address on the wire, from 0")
    raw: tuple[int, ...] | None = Field(
        description="contents of each address, of a command as it was written; null while the controller does not answer"
    )
    read_back: tuple[int, ...] | None = Field(
        description="of a command that is read at other addresses than it is written to: what is read there"
    )
    value: str | None = Field(description="decoded by the map; null while the controller does not answer")
    is_obeyed: bool | None = Field(description="whether the controller acts on a command that is present; else null")
    written_by: str | None = Field(description="host:port of the client that wrote it last; null if nobody has")
    written_s: float | None = Field(description="how long ago")


class Writers:
    """Which client wrote each cell of the commands last."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._cells = {point.cell for command in codec.commands.values() for point in command.points}
        self._last: dict[Cell, tuple[str, float]] = {}

    def take(self, endpoint: str, client: str, frame: bytes, now: float) -> None:
        """Record a request of a client to one of the devices, if it writes."""
        try:
            request = frames.parse_request(frame, timed_coils=True)
        except FrameError:
            return
        if not request.is_write or request.unit != self._codec.map.unit_of(endpoint):
            return
        for address in range(request.address, request.address + request.count):
            cell = endpoint, request.table, address
            if cell in self._cells:
                self._last[cell] = client, now

    def last(self, points: Sequence[Point]) -> tuple[str, float] | None:
        """Return who wrote one of these points last, and when."""
        found = [self._last[point.cell] for point in points if point.cell in self._last]
        return max(found, key=lambda one: one[1], default=None)


class RegisterTable:
    """Every signal and command of one lift."""

    def __init__(self, codec: Codec, face: RegisterFace, floors: Mapping[str, int]) -> None:
        """`floors` are names with their codes, lowest first."""
        self.writers = Writers(codec)
        self._codec = codec
        self._face = face
        self._floors = tuple(floors)
        self._names = {code: name for name, code in floors.items()}

    def rows(self, now: float) -> list[Register]:
        """Return the registers at this moment, signals first, in the order of the map."""
        signals = [self._signal(signal, now) for signal in self._codec.signals.values()]
        return signals + [self._command(command, now) for command in self._codec.commands.values()]

    def _signal(self, signal: SignalCodec, now: float) -> Register:
        raw = self._read(signal.points, now)
        value = None
        if raw is not None:
            joined = shift = 0
            for point, bits in zip(signal.points, raw, strict=True):
                joined |= bits << shift
                shift += point.width
            value = self._text(signal.kind, signal.decode(joined))
        return Register(
            name=signal.name,
            is_command=False,
            addresses=tuple(self._codec.map.signals[signal.name].addresses),
            wire=wire_text(signal.points),
            raw=raw,
            read_back=None,
            value=value,
            is_obeyed=None,
            written_by=None,
            written_s=None,
        )

    def _command(self, command: CommandCodec, now: float) -> Register:
        name, points = command.name, command.points
        raw = self._read(points, now, stored=True)
        elsewhere = command.read_points if command.read_points != points else ()
        present = self._face.commands.get(name)
        client, at = self.writers.last(points) or (None, None)
        return Register(
            name=name,
            is_command=True,
            addresses=tuple(command.spec.addresses),
            wire=wire_text(points),
            raw=raw,
            read_back=self._read(elsewhere, now) if elsewhere else None,
            value=None if raw is None else self._command_text(command, present),
            is_obeyed=None if present is None else name in self._face.believed,
            written_by=client,
            written_s=None if at is None else round(now - at, 1),
        )

    def _command_text(self, command: CommandCodec, present: int | None) -> str:
        if command.spec.is_heartbeat:
            return str(command.decode(self._face.cells))
        if present is None:
            return "at rest" if command.decode(self._face.cells) is None else "not a command"
        return self._floors[present] if command.is_call else "on"

    def _read(self, points: Sequence[Point], now: float, *, stored: bool = False) -> tuple[int, ...] | None:
        """Return what a client reads, or with `stored` what was written; None while the controller does not answer."""
        try:
            return tuple(
                point.within(
                    self._face.stored(point.table, point.address, now, endpoint=point.endpoint)
                    if stored
                    else self._face.read(point.table, point.address, 1, now, endpoint=point.endpoint)[0]
                )
                for point in points
            )
        except NoReply:
            return None

    def _text(self, kind: Kind, value: Value | Unlisted) -> str:
        if value is UNLISTED:
            return "a code that the map does not list"
        if isinstance(value, frozenset):
            return ", ".join(self._floor(code) for code in sorted(value)) or "none"
        if value is None:
            return "none"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return self._floor(value) if kind in FLOOR_KINDS and isinstance(value, int) else str(value)

    def _floor(self, code: int) -> str:
        return self._names.get(code, f"code {code}, which is no floor of this lift")


def wire_text(points: Sequence[Point]) -> str:
    """Return where points are on the wire, such as `holding 16`, `holding 5.0 to 5.2` or `coil 512, coil 513`."""
    return ", ".join(f"{point.space} {point.address}{_bits(point)}" for point in points)


def _bits(point: Point) -> str:
    if point.is_whole:
        return ""
    last = point.low + point.width - 1
    return f".{point.low}" if last == point.low else f".{point.low} to {point.address}.{last}"
