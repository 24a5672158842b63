"""What was read in one run, and for which purpose: the material that is judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique

from drivers.errors import ACCEPTED, BUSY, PATH_UNAVAILABLE, TARGET_SILENT, ConnectProblem
from lift_manager.commissioning.prober import Identity, ProbeAnswer
from register_maps.words import Table

PAUSE_S = 0.5
"""How long nothing is sent, to see whether the connection survives it."""


@unique
class Probe(StrEnum):
    """Reads that a manager would not make."""

    OFFSET = "offset"
    TABLE = "table"
    UNIT = "unit"
    RANGE = "range"
    BLOCK = "block"
    IDENTITY = "identity"
    SLOT = "slot"
    PORT = "port"


@unique
class Purpose(StrEnum):
    """What a read was made for."""

    POLL = "poll"
    POINT = "point"
    """One address of a block that was refused."""
    OUTPUTS = "outputs"
    PAUSE = "pause"
    OFFSET = "offset"
    TABLE = "table"
    UNIT = "unit"
    RANGE = "range"
    BLOCK = "block"


NOT_REFUSED = frozenset({ACCEPTED, BUSY, PATH_UNAVAILABLE, TARGET_SILENT})
"""Exceptions that are about the moment or the unit, and not about the addresses."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One read and what became of it."""

    at_s: float
    """When it was sent, from the beginning of the run."""
    purpose: Purpose
    unit: int
    table: Table
    address: int
    count: int
    took_s: float = 0.0
    values: tuple[int, ...] | None = None
    exception: int | None = None
    trouble: str = ""
    echoes_tid: bool = True
    turn: int = 0
    """Which poll it belongs to."""

    @classmethod
    def of(cls, got: ProbeAnswer, at_s: float, purpose: Purpose, turn: int) -> Answer:
        """Record what a prober brought."""
        request = got.request
        return cls(
            at_s,
            purpose,
            request.unit,
            request.table,
            request.address,
            request.count,
            got.took_s,
            got.values,
            got.exception,
            got.trouble,
            got.echoes_tid,
            turn,
        )

    @property
    def is_answer(self) -> bool:
        """Whether the controller answered, with values or with an exception."""
        return self.values is not None or self.exception is not None

    @property
    def is_refusal(self) -> bool:
        """Whether the controller refuses these addresses, and not just now."""
        return self.exception is not None and self.exception not in NOT_REFUSED

    @property
    def proves_unit(self) -> bool:
        """Whether a unit of this id exists: an exception proves it, but for those by which a gateway says the opposite."""
        return self.values is not None or self.exception not in (None, PATH_UNAVAILABLE, TARGET_SILENT)


@dataclass(frozen=True, slots=True)
class SlotEvidence:
    """What further connections came to while the first one was in use."""

    further: int
    """How many of them answered."""
    tried: int
    first_survived: bool
    """Whether the first connection still answered afterwards."""


@dataclass(frozen=True, slots=True)
class ControllerEvidence:
    """Everything that one controller answered."""

    problem: ConnectProblem | None = None
    """Why the first connection could not be made."""
    problem_text: str = ""
    answers: tuple[Answer, ...] = ()
    connects: int = 0
    """Connections that were made for the polls; 1 where none was lost."""
    survives_pause: bool | None = None
    """Whether the connection was still there after a pause; None if that was not tried."""
    slots: SlotEvidence | None = None
    open_ports: tuple[int, ...] | None = None
    """Ports that accept a connection; None if that was not tried."""
    identities: Mapping[int, Identity] | None = None
    """What each unit says that it is; None if that was not asked."""

    def of(self, *purposes: Purpose) -> Iterator[Answer]:
        """Yield the answers to reads for these purposes."""
        return (answer for answer in self.answers if answer.purpose in purposes)


@dataclass(frozen=True, slots=True)
class Evidence:
    """Everything that was read in one run."""

    controllers: Mapping[str, ControllerEvidence]
    seconds: float
    probes: frozenset[Probe] = field(default_factory=frozenset)
