"""The schema of one command of a map."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from register_maps.fields import Address, Codes, Part, Pause, Seconds, Word
from register_maps.signal_schema import floor_codes, keyed

_Addresses = Annotated[tuple[Address, ...], Field(min_length=2)]

PLACE_KEYS: tuple[tuple[str, ...], ...] = (("at",), ("one_of",))
READ_KEYS: tuple[tuple[str, ...], ...] = (("read_at",), ("read_one_of",))


class Confirm(Part):
    """What shows that a command took effect; an echo of the write alone confirms nothing."""

    any_of: tuple[str, ...] = Field(min_length=1)
    """Signal names, or `effect` (the lift does it), or `readback` (the point still holds what was written)."""
    within_s: Seconds


class Payload(Part):
    """The value written is a time."""

    time: Literal["width_s", "max_hold_s"]
    unit_s: Seconds
    """Seconds in one count."""


class Command(Part):
    """One command to the lift."""

    at: Address | None = None
    one_of: _Addresses | None = None
    """One output per floor."""
    codes: Codes | None = None
    """The floor code of each entry of `one_of`; 0, 1, 2 and so on by default."""
    read_at: Address | None = None
    """Where the output is read back, if not where it is written."""
    read_one_of: _Addresses | None = None
    type: Literal["uint16", "int16"] = "uint16"
    as_: Literal["floor"] | None = Field(default=None, alias="as")
    code: Literal["binary", "bcd"] = "binary"
    """How the floor code is written: `bcd` has four bits for each decimal digit."""
    byte_order: Literal["high_first", "low_first"] = "high_first"
    """Which half of the register is its high byte; Modbus sends the high byte first."""
    action: Literal["pulse", "hold", "count", "toggle"]
    """`count` and `toggle` are for the heartbeat."""
    on: Word = Field(default=1, alias="press")
    """Raw value of a held or pulsed point that carries neither floor nor time."""
    rest: Word = 0
    """Raw value that releases the output."""
    payload: Payload | None = None
    width_s: Seconds | None = None
    """How long a pulse stays on."""
    timed_by: Literal["us", "device"] = "us"
    """Who ends a pulse: our second write, or the device itself."""
    every_s: Seconds | None = None
    """How often a heartbeat is written."""
    until: Literal["arrived", "closed", "robot_in_place", "robot_left"] | None = None
    """What ends a hold by itself."""
    max_hold_s: Seconds | None = None
    refresh_s: Seconds | None = None
    repeat_pulse_s: Seconds | None = None
    """A hold for a controller that drops a stuck button: pressed for `width_s`, and again this often."""
    self_clearing: bool = False
    """The controller accepts the hold and clears its point, so the point does not show whether the hold is on."""
    cleared_after_s: Seconds | None = None
    """The controller clears the point of a hold after this long, and continues the hold if it is written again: not a drop."""
    released_after_s: Seconds | None = None
    """Of a door hold: this long after its press the controller releases the door by itself, however often it is written again."""
    on_link_loss: Literal["device_watchdog", "timed_by_device", "latches"] | None = None
    bounded_by: Literal["session"] | None = None
    requires: tuple[str, ...] = ()
    """Flags that must read yes immediately before a press."""
    granted_by: Literal["robot_mode_on"] | None = None
    """The flag by which the controller grants the command."""
    granted_within_s: Seconds = 600.0
    """Ten minutes: the longest mode change documented (elevator-interfaces 1.10, Fujitec cargo lift)."""
    excludes: tuple[str, ...] = ()
    gap_s: Pause = 0.0
    reset_first_s: Pause = 0.0
    """For a controller that needs an edge: the rest value is written and held for this long before each press."""
    min_repeat_s: Pause = 0.0
    """Least time from one press to the next."""
    arrive_within_s: Seconds = 120.0
    """Two minutes: the travel time-out of the same cargo lift."""
    shared_word: Literal["owned", "mask_write", "accepted"] | None = None
    """A command in some bits of a register. `owned`: nobody else uses the word, it is written whole and its spare bits as
    0; `mask_write`: function 22; `accepted`: a fresh read before each write, and a lost update is accepted."""
    confirm: Confirm | None = None
    note: str = ""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.at is None) == (self.one_of is None):
            raise ValueError("give its place exactly once: `at` or `one_of`")
        if self.action == "pulse" and self.width_s is None:
            raise ValueError("a pulse needs `width_s`")
        if self.action == "hold" and (self.max_hold_s is None or self.on_link_loss is None):
            raise ValueError("a hold needs `max_hold_s` and `on_link_loss`")
        if self.repeat_pulse_s is not None and (self.action != "hold" or self.width_s is None):
            raise ValueError("`repeat_pulse_s` belongs to a hold, with `width_s` for each of its pulses")
        fixed = self.as_ is None and self.one_of is None and self.payload is None
        if self.on == self.rest and fixed and self.action in ("pulse", "hold"):
            raise ValueError("`press` and `rest` are the same value: the command would do nothing")
        return self

    @property
    def keyed_addresses(self) -> tuple[tuple[tuple[str | int, ...], str], ...]:
        """Every address this command writes to, with its key."""
        return keyed(self, PLACE_KEYS)

    @property
    def keyed_read_addresses(self) -> tuple[tuple[tuple[str | int, ...], str], ...]:
        """Every separate address at which this command is read back, with its key; none if it is read where it is written."""
        return keyed(self, READ_KEYS)

    @property
    def addresses(self) -> tuple[str, ...]:
        """Every address this command writes to."""
        return tuple(address for _, address in self.keyed_addresses)

    @property
    def floor_codes(self) -> tuple[int, ...]:
        """The floor code of each of its outputs, where it has one output per floor."""
        return floor_codes(self.codes, self.one_of)

    @property
    def is_heartbeat(self) -> bool:
        """Whether it is our heartbeat: always written, never pressed."""
        return self.action in ("count", "toggle")

    @property
    def ends_itself(self) -> bool:
        """Whether the device ends it: it needs no release, and cannot be read back."""
        return self.timed_by == "device" and self.action == "pulse"
