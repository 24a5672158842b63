"""The schema of one signal of a map."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from register_maps.fields import Address, Codes, Part, Position, Seconds, Word
from register_maps.words import Mode

PLACE_KEYS: tuple[tuple[str, ...], ...] = (
    ("at",),
    ("one_of",),
    ("each_of",),
    ("code_of",),
    ("open_limit", "closed_limit"),
    ("open_limits",),
    ("up", "down"),
)
"""The forms in which a signal gives its place; keys of one form belong together."""

_Bit = Annotated[int, Field(ge=0, le=15)]
_Addresses = Annotated[tuple[Address, ...], Field(min_length=2)]


class Signal(Part):
    """One signal of the lift: at one point, or spread over several bits."""

    at: Address | None = None
    one_of: _Addresses | None = None
    """One bit per floor, at most one of them set; none set means no floor known."""
    each_of: _Addresses | None = None
    """One bit per floor, any number of them set: the lamps of the call buttons."""
    code_of: _Addresses | None = None
    """The bits of a position code, lowest first, from anywhere."""
    open_limit: Address | None = None
    closed_limit: Address | None = None
    open_limits: _Addresses | None = None
    """One fully-open limit per floor, of the same door; none set reads as closed."""
    up: Address | None = None
    down: Address | None = None
    """Two bits of a motion; neither is stopped, both contradict each other."""
    codes: Codes | None = None
    """The floor code of each entry of `one_of`, `each_of` or `open_limits`; 0, 1, 2 and so on by default."""
    type: Literal["uint16", "int16", "uint32", "int32", "counter"] = "uint16"
    word_order: Literal["high_first", "low_first"] | None = None
    """Which half of a 32-bit number has the lower address."""
    byte_order: Literal["high_first", "low_first"] = "high_first"
    """Which half of each register is its high byte; Modbus sends the high byte first."""
    bits: tuple[_Bit, _Bit] | None = None
    """First and last bit (0 = least significant) of a field inside a register."""
    code: Literal["binary", "gray", "bcd"] = "binary"
    """How a number counts: `gray` is the reflected binary code, `bcd` has four bits for each decimal digit."""
    active: Literal["high", "low"] = "high"
    """Which level of a bit means yes; with a position code, of each of its bits."""
    values: dict[Annotated[int, Field(ge=-32768, le=65535)], str] | None = None
    means_yes: Word = 1
    """The code for yes of a flag that fills a whole register or field; 0 is no, and everything else is unknown."""
    yes_from: Position | None = None
    """Of a flag that a number shows: yes from this number on, in the counts of the register."""
    yes_to: Position | None = None
    """Of a flag that a number shows: yes up to this number; with `yes_from`, only between the two."""
    open_at: Position | None = None
    """Of a door that shows how far it is open: the position at which it counts as fully open, and beyond."""
    closed_at: Position | None = None
    """Of a door that shows how far it is open: the position at which it counts as closed, and beyond."""
    range: tuple[Position, Position] | None = None
    """Lowest and highest number of a flag or a door that a number shows; every other one is unknown."""
    as_: Literal["floor"] | None = Field(default=None, alias="as")
    unknown: tuple[Word, ...] = ()
    """Codes that mean "not known"."""
    none: tuple[Word, ...] = ()
    """Codes that mean "no floor", such as no destination."""
    positions: dict[Annotated[int, Field(ge=-32768, le=65535)], Position] | None = None
    """Of `car_position`: the position of each floor, by its code. If the map has no `car_floor`, it is derived from this."""
    tolerance: Annotated[int, Field(ge=0, le=0x7FFF_FFFF)] | None = None
    """How far from the position of a floor the car still counts as being there, in the counts of `car_position`."""
    known_while: Literal["stopped"] | None = None
    """For a car floor that shows the destination under way: it counts only while `motion` is stopped."""
    must_change_within_s: Seconds | None = None
    unit: str = ""
    """Unit of a number, such as kg."""
    unit_s: Seconds | None = None
    """Seconds in one count of `watchdog_time`."""
    note: str = ""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        forms = [keys for keys in PLACE_KEYS if any(getattr(self, key) is not None for key in keys)]
        if len(forms) != 1:
            every = ", ".join(" with ".join(f"`{key}`" for key in keys) for keys in PLACE_KEYS)
            raise ValueError(f"give its place exactly once: {every}")
        missing = [key for key in forms[0] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{' and '.join(f'`{key}`' for key in forms[0])} belong together; {missing[0]} is missing")
        if self.bits is not None and self.bits[0] > self.bits[1]:
            raise ValueError("`bits` are written lowest first, such as [4, 5]")
        if (self.positions is None) != (self.tolerance is None):
            raise ValueError("`positions` and `tolerance` belong together; give both, or neither")
        if (self.open_at is None) != (self.closed_at is None):
            raise ValueError("`open_at` and `closed_at` belong together; give both, or neither")
        return self

    @property
    def thresholds(self) -> dict[str, int]:
        """The thresholds of a flag or a door that a number shows, by their keys; empty for every other signal."""
        keys = ("yes_from", "yes_to", "open_at", "closed_at")
        return {key: getattr(self, key) for key in keys if getattr(self, key) is not None}

    @property
    def names_robot_mode(self) -> bool:
        """Whether one of the words of a mode is `robot`."""
        return Mode.ROBOT in (self.values or {}).values()

    @property
    def floor_codes(self) -> tuple[int, ...]:
        """The floor code of each of its points, where it has one point per floor."""
        return floor_codes(self.codes, self.one_of or self.each_of or self.open_limits)

    @property
    def as_floor(self) -> Signal:
        """The floor signal that a position with a table of `positions` amounts to."""
        return self.model_copy(update={"as_": "floor", "unit": ""})

    @property
    def keyed_addresses(self) -> tuple[tuple[tuple[str | int, ...], str], ...]:
        """Every address this signal is read from, with its key."""
        return keyed(self, PLACE_KEYS)

    @property
    def addresses(self) -> tuple[str, ...]:
        """Every address this signal is read from."""
        return tuple(address for _, address in self.keyed_addresses)

    @property
    def is_wide(self) -> bool:
        """Whether it is a 32-bit number, which also occupies the next register."""
        return self.type in ("uint32", "int32")


def floor_codes(codes: tuple[int, ...] | None, entries: tuple[str, ...] | None) -> tuple[int, ...]:
    """Return the floor code of each entry of a list with one per floor: those given, else 0, 1, 2 and so on."""
    return tuple(range(len(entries or ()))) if codes is None else codes


def keyed(part: Part, forms: tuple[tuple[str, ...], ...]) -> tuple[tuple[tuple[str | int, ...], str], ...]:
    """List the addresses under these keys, each with its own key path."""
    found: list[tuple[tuple[str | int, ...], str]] = []
    for key in (key for keys in forms for key in keys):
        given = getattr(part, key)
        if isinstance(given, str):
            found.append(((key,), given))
        elif given is not None:
            found += [((key, index), address) for index, address in enumerate(given)]
    return tuple(found)
