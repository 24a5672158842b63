"""The forms in which golden vectors are written down.

Bytes are hex, as they stand in a packet after the transaction id: protocol id, length, unit, function, data. They are
typed from the source of a map, never computed; only this makes them a witness against the codec, which driver and
simulator share.
"""

from dataclasses import dataclass

from drivers.model import Command, LiftValues, Proof


@dataclass(frozen=True, slots=True)
class Says:
    """One answer to the poll, and what the driver must make of it."""

    words: str
    answer: str
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
    poll_before: str
    """Answer to the poll while the command is given."""
    poll_after: str
    """Answer to the poll once the first write was answered."""
    proof: Proof | None
    """What confirms a press; None: it is a hold, and `held` must say so."""
    exchanges: tuple[Exchange, ...]
    let_go_s: float | None = None
    """When it is told to let go; None: it does so by itself."""


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
    poll: str
    takes_over: tuple[tuple[str, str], ...]
    """How the driver looks at its own outputs over a new connection: requests, with answers that show them at rest."""
    says: tuple[Says, ...]
    does: tuple[Does, ...]
    key: str
    """Key switch of the simulated lift."""
    face: tuple[Face, ...]
