"""The forms in which golden vectors are written down.

Bytes are hex, as they stand in a packet after the transaction id: protocol id, length, unit, function, data. They are
typed from the source of a map, never computed; only this makes them a witness against the codec, which driver and
simulator share. What travels to a second device has its name in front: `sensor: 00 00 00 06 ...`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.model import Command, LiftValues, Proof

Frames = str | tuple[str, ...]
"""One frame, or those of several requests in their order."""


def frames_of(frames: Frames) -> tuple[str, ...]:
    """Every frame by itself."""
    return (frames,) if isinstance(frames, str) else frames


@dataclass(frozen=True, slots=True)
class Says:
    """One answer to the poll, and what the driver must make of it."""

    words: str
    answer: Frames
    values: LiftValues


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request that must leave next, with the answer it gets."""

    at_s: float
    """Since the command was given."""
    request: str
    answer: str


@dataclass(frozen=True, slots=True)
class Does:
    """One command as it travels, from its first byte to the proof that everything is let go."""

    words: str
    command: Command
    poll_before: Frames
    """Answer to the poll while the command is given."""
    poll_after: Frames
    """Answer to the poll once the first write was answered."""
    proof: Proof | None
    """What confirms a press; None: it is a hold, and `held` must say so."""
    exchanges: tuple[Exchange, ...]
    let_go_s: float | None = None
    """When it is told to let go; None: it does so by itself."""
    lasts_s: float = 0.0
    """How long the device keeps on what it ends by itself, after the last exchange."""
    press: tuple[str, ...] | None = None
    """The writes that are the press; None: the first exchange."""
    shows_after: int = 0
    """Which of the exchanges is answered before the poll says what `poll_after` has."""
    before: Command | None = None
    """Another command, given before this one."""
    before_s: float = 0.3
    """How long before."""
    before_by: tuple[tuple[str, str], ...] = ()
    """The requests of that command, with their answers."""
    gives_way: bool = False
    """Whether that command is let go for this one; else it is a hold that stays on."""


@dataclass(frozen=True, slots=True)
class Face:
    """One request to the simulated lift at this time, and what it must answer."""

    at_s: float
    words: str
    request: str
    answer: str


@dataclass(frozen=True, slots=True)
class Golden:
    """Everything that fixes one map."""

    map_name: str
    floors: dict[str, int]
    """The site's floor codes, lowest floor first."""
    poll: Frames
    takes_over: tuple[tuple[str, str], ...]
    """How the driver looks at its own outputs over a new connection: requests, with answers that show them at rest."""
    says: tuple[Says, ...]
    does: tuple[Does, ...]
    key: str = "robot"
    """Key switch of the simulated lift."""
    face: tuple[Face, ...] = ()
    """Empty where the simulated lift is not asked by bytes."""
    parameters: Mapping[str, int | float | str] = field(default_factory=dict)
    """What the site says for the map's parameters."""
    override: Mapping[str, Any] = field(default_factory=dict)
    """What the site lays over the map: a template's missing half."""
    cycle: tuple[str, str] | None = None
    """A block that is written all the time, at rest: request and answer."""
    cycle_s: float = 0.0
    site: str = ""
    """Tells two sets of vectors of one map apart."""

    @property
    def title(self) -> str:
        """For the names of tests."""
        return f"{self.map_name} ({self.site})" if self.site else self.map_name
