"""Faults and surprising behaviour of a lift and its controller, as values; other modules carry them out. Pure.

A fault is present from `RegisterFace.begin` to `RegisterFace.end`. The machine acts out
`MachineFault` in its scans, the registers act out `RegisterFault`, and the server acts out `NetworkFault`.
"""

from __future__ import annotations

from dataclasses import dataclass

from register_maps.words import Mode, Side, Table

# -- the machine: car, doors and the program that moves them


@dataclass(frozen=True, slots=True)
class StuckDoor:
    """A door stays where it is, whatever is ordered; the controller believes its limits."""

    side: Side = Side.FRONT


@dataclass(frozen=True, slots=True)
class ReopeningDoor:
    """A closing door reopens before it is shut, again and again, as with a small object in its sill."""

    side: Side = Side.FRONT


@dataclass(frozen=True, slots=True)
class NudgingDoor:
    """The doors close slowly and do not reverse, not even for the open button; the controller reports nudging.

    A call for the floor where they close is served when they are shut. Too much load and a recall still hold them open.
    """


@dataclass(frozen=True, slots=True)
class WrongFloor:
    """The car is sent to the floor next to the one that was called."""

    by: int = 1
    """How many floors too high; too low when below 0. At the end of the shaft it is the other side."""

    def __post_init__(self) -> None:
        if self.by == 0:
            raise ValueError("WrongFloor: by must not be 0, which is the right floor")


@dataclass(frozen=True, slots=True)
class Relevelling:
    """The car sinks while it stands open, and re-levels with its doors open; normal on rope lifts."""

    every_s: float = 2.0
    """Mechanical seconds for which it stands level before it sinks again."""
    sinks_m: float = 0.012
    """More than the level tolerance, well within the door zone; half the door zone at most is acted out."""

    def __post_init__(self) -> None:
        if self.every_s <= 0 or self.sinks_m <= 0:
            raise ValueError(f"Relevelling: every_s and sinks_m must be above 0, not {self.every_s} and {self.sinks_m}")


@dataclass(frozen=True, slots=True)
class Homing:
    """The car has lost its position: it drives to the lowest floor with its doors shut, and accepts no call before.

    One run while this is present; if it is ended earlier, the car knows its position again.
    """


@dataclass(frozen=True, slots=True)
class CallsCancelled:
    """The controller drops every call at the moment this begins, as for anti-nuisance or a change of mode."""


@dataclass(frozen=True, slots=True)
class RobotModeWithdrawn:
    """Robot mode is refused, and withdrawn if it was granted."""


_MODES_WITHOUT_ROBOTS = (Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE)


@dataclass(frozen=True, slots=True)
class InMode:
    """A mode without robots: a fire alarm, emergency power, a key switch, a lift out of service."""

    mode: Mode
    """fire, emergency, inspection, independent or out_of_service."""

    def __post_init__(self) -> None:
        if self.mode not in _MODES_WITHOUT_ROBOTS:
            listed = ", ".join(_MODES_WITHOUT_ROBOTS)
            raise ValueError(f"InMode: {self.mode} is not one of the modes that a lift can be put into: {listed}")


@dataclass(frozen=True, slots=True)
class Overload:
    """Too much load: the doors stay open and the car does not start."""


MachineFault = (
    StuckDoor
    | ReopeningDoor
    | NudgingDoor
    | WrongFloor
    | Relevelling
    | Homing
    | CallsCancelled
    | RobotModeWithdrawn
    | InMode
    | Overload
)


# -- the registers: what is read, and what becomes of what is written


@dataclass(frozen=True, slots=True)
class SaysWrongFloor:
    """The floor shown is wrong, as with a sensor or a coding that is off by one."""

    by: int = 1
    """How many floors too high; too low when below 0. At the end of the shaft it is the other side."""

    def __post_init__(self) -> None:
        if self.by == 0:
            raise ValueError("SaysWrongFloor: by must not be 0, which is the right floor")


@dataclass(frozen=True, slots=True)
class FloorAhead:
    """The floor shown changes as the car departs to that of the next stop, as on an indicator that runs ahead.

    If each floor has its own switch, that of the next stop is on all the way, also between floors.
    """


@dataclass(frozen=True, slots=True)
class ContradictingLimits:
    """A door reports open and closed at once; a door with one value reports a code that its map does not list.

    With open limits only, those of two floors are on. A single bit, of which both values are listed, stays true.
    """

    side: Side = Side.FRONT


@dataclass(frozen=True, slots=True)
class DisconnectedSignal:
    """The wires of one signal are off their terminals: its bits read 0, and with them any other signal at the same points.

    The lift itself is not affected.
    """

    signal: str


@dataclass(frozen=True, slots=True)
class FrozenRegisters:
    """All values read stand still, including the heartbeat, while the lift runs on and writes take effect."""


@dataclass(frozen=True, slots=True)
class FrozenHeartbeat:
    """Only the alive counter stands still."""


@dataclass(frozen=True, slots=True)
class Stopped:
    """The program is in STOP: the device answers, values read stand still, and writes are stored without effect.

    The car brakes and stands, and the doors stay as they are. Writes can be read back where no signal of the lift is. The program
    resumes where it stopped, with the values written by then.
    """


@dataclass(frozen=True, slots=True)
class LostPress:
    """The next writes that press something are answered and stored, but not seen by the program.

    A lost press stays lost while it lasts, however often it is written again.
    """

    times: int = 1

    def __post_init__(self) -> None:
        if self.times < 1:
            raise ValueError(f"LostPress: times must be 1 or more, not {self.times}")


@dataclass(frozen=True, slots=True)
class IgnoredWrites:
    """Writes are answered as if carried out, but are not; they do not feed the watchdog either."""

    stored: bool = False
    """Whether they can be read back all the same; the program sees the stored values once this is over."""


@dataclass(frozen=True, slots=True)
class ForeignWriter:
    """Somebody else writes one of our commands repeatedly, from the moment this begins.

    Of a command with one output per floor all outputs are written. It does not feed the watchdog unless it is the heartbeat,
    which it counts up. Writes while the device is off the network are lost.
    """

    command: str
    floor: int | None = None
    """The index of the floor for a call. Other commands are pressed or released, by `pressed`."""
    pressed: bool = True
    every_s: float = 1.0

    def __post_init__(self) -> None:
        if self.every_s <= 0:
            raise ValueError(f"ForeignWriter: every_s must be above 0, not {self.every_s}")


@dataclass(frozen=True, slots=True)
class ForeignCell:
    """Somebody else writes one cell of the controller repeatedly, by its address on the wire."""

    table: Table
    address: int
    value: int
    every_s: float = 1.0
    endpoint: str = ""

    def __post_init__(self) -> None:
        if self.every_s <= 0:
            raise ValueError(f"ForeignCell: every_s must be above 0, not {self.every_s}")


RegisterFault = (
    SaysWrongFloor
    | FloorAhead
    | ContradictingLimits
    | DisconnectedSignal
    | FrozenRegisters
    | FrozenHeartbeat
    | Stopped
    | LostPress
    | IgnoredWrites
    | ForeignWriter
    | ForeignCell
)


# -- the device on its network


@dataclass(frozen=True, slots=True)
class Reboot:
    """The controller restarts: it is off the network while this lasts, loses calls and outputs, and starts with its homing run.

    The car brakes and stands meanwhile, and its doors stay as they are.
    """

    homes: bool = True
    """Whether it drives to the lowest floor before it accepts a call."""


@dataclass(frozen=True, slots=True)
class PowerLoss:
    """The communication module loses power and is off the network while this lasts; the lift itself runs on."""

    outputs_held: bool = False
    """Whether its outputs stay on meanwhile and after; otherwise all outputs are at rest."""


@dataclass(frozen=True, slots=True)
class SlotKept:
    """The device holds the slot of a connection that is gone, and accepts no other while this lasts.

    A server with a number of slots counts: each connection that ends while this lasts keeps its slot.
    """


NetworkFault = Reboot | PowerLoss | SlotKept

Fault = MachineFault | RegisterFault | NetworkFault
