"""The rows of the journal: who requested what, what was written because of it, and what became of it. Pure values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum, unique

Json = str | int | float | bool | None | Sequence["Json"] | Mapping[str, "Json"]

FLOOR_LETTERS = 64
"""Longest part of a floor's name that is kept: as long as a site file allows; callers make up longer ones."""


@unique
class RowKind(StrEnum):
    """What a row is about; stable words for filters and exports."""

    MANAGER = "manager"
    """A manager started on this journal, or ended; with the maps it commands by and their hashes."""
    REQUEST = "request"
    """What a caller requested, and the immediate reply."""
    PRESS = "press"
    """What is about to be pressed; nothing of it leaves before this row is on the disk."""
    WRITE = "write"
    """What reached the wire, or may have. Of repeated writes only the changes."""
    OUTCOME = "outcome"
    SESSION = "session"
    MODE = "mode"
    LINK = "link"
    """A controller can be read, or cannot."""
    ALARM = "alarm"
    PERSON = "person"
    """A person's decision: acknowledged, locked out, took the lift from its holder."""
    KEY = "key"
    """A key was made or revoked, or a browser logged in or out with it; never the key itself."""
    ANCHOR = "anchor"
    """Where the journal was cut: the number and hash of the last row that is gone."""
    GAP = "gap"
    """Rows that could not be written while the disk took none, and how many they were."""


@dataclass(frozen=True, slots=True)
class Row:
    """One fact. The journal gives it a number, a time and a hash."""

    kind: RowKind
    text: str
    """One line for people."""
    lift: str = ""
    """Empty where it concerns the whole site."""
    caller: str = ""
    """`<face>:<name>` of the caller, or the name of the person; empty if there is neither."""
    data: Mapping[str, Json] = field(default_factory=dict)
    """For programs: stable keys, no secrets."""
    event: str = field(default="", compare=False)
    """The id of the event that this is the row of, as in the log and the event stream; empty for a row without one. It says when
    something was written, not what: rows with the same content are equal."""

    @property
    def written_data(self) -> Mapping[str, Json]:
        """`data` as it is written, with the id of the event under the key `event`."""
        return {**self.data, "event": self.event} if self.event else self.data


def short(text: str) -> str:
    """Return a caller's text, no longer than the name of any floor or lift."""
    return text if len(text) <= FLOOR_LETTERS else f"{text[:FLOOR_LETTERS]}..."
