"""The recording of a ride: what every readable address showed, and what a person said meanwhile. Saved and loaded as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum, unique
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from lift_manager.commissioning.learn.survey import Span, Survey
from register_maps.words import Table


class SamplesUnusable(Exception):
    """A file holds no recording that can be analysed; the sentence says why."""


@unique
class MarkKind(StrEnum):
    """What a person said of the lift at one moment."""

    OPEN = "open"
    """The car stands at a floor, its door is fully open."""
    CLOSED = "closed"
    """The car stands, its door is fully closed."""
    DOOR = "door"
    """The car stands, its door is opening or closing."""
    MOVING = "moving"
    """The car moves."""


@dataclass(frozen=True, slots=True)
class Mark:
    """What a person said, and when."""

    at_s: float
    kind: MarkKind
    floor: str = ""
    """The name of the floor, with `open`."""


@dataclass(slots=True)
class BlockReads:
    """One block of adjacent addresses, and every time it was read."""

    table: Table
    start: int
    count: int
    reads: list[tuple[float, tuple[int, ...] | None]] = field(default_factory=list)
    """Second, and values; None for the values of the read before."""

    def add(self, at_s: float, values: tuple[int, ...], *, is_new: bool) -> None:
        """Add a read; `is_new` says whether it differs from the one before."""
        self.reads.append((round(at_s, 3), values if is_new else None))

    def each_read(self) -> Iterator[tuple[float, tuple[int, ...]]]:
        """Yield every read with its values."""
        last: tuple[int, ...] | None = None
        for at_s, values in self.reads:
            last = values if values is not None else last
            if last is not None:
                yield at_s, last


@dataclass(slots=True)
class Recording:
    """Everything that was read during a ride."""

    schema: Literal[1]
    peer: str
    """Address of the controller."""
    unit: int
    began: str
    """Date and time, ISO 8601."""
    spans: tuple[Span, ...]
    most_registers: int
    most_bits: int
    blocks: list[BlockReads]
    marks: list[Mark] = field(default_factory=list)
    floors: tuple[str, ...] = ()
    """The floors from the lowest to the highest, as far as they were named."""

    @property
    def named_floors(self) -> tuple[str, ...]:
        """The floors that were named during the ride, in that order."""
        return tuple(dict.fromkeys(mark.floor for mark in self.marks if mark.floor))


_FILE = TypeAdapter(Recording)


def begin(survey: Survey, *, peer: str, unit: int, began: str) -> Recording:
    """Return an empty recording of everything that a survey found."""
    blocks = [
        BlockReads(span.table, start, min(survey.most(span.table), span.last - start + 1))
        for span in survey.spans
        for start in range(span.first, span.last + 1, survey.most(span.table))
    ]
    return Recording(1, peer, unit, began, survey.spans, survey.most_registers, survey.most_bits, blocks)


def to_json(recording: Recording) -> bytes:
    """Return a recording as the content of a file."""
    return _FILE.dump_json(recording)


def load_samples(path: Path) -> Recording:
    """Read a recording. Raises SamplesUnusable."""
    try:
        recording = _FILE.validate_json(path.read_bytes())
    except OSError as error:
        raise SamplesUnusable(f"{path} cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise SamplesUnusable(
            f"{path} is no recording of `learn`: {where}: {first['msg']}; --samples FILE makes one"
        ) from error
    for block in recording.blocks:
        if any(values is not None and len(values) != block.count for _, values in block.reads):
            raise SamplesUnusable(
                f"{path} is damaged: a read of {block.table} {block.start} has too few values or too many"
            )
    return recording


def guess_order(floors: Sequence[str]) -> tuple[str, ...]:
    """Return floors from the lowest to the highest, as names usually go: B2, B1, G, 1, 2; unusual names keep their order."""
    keyed = [(_height(name), index, name) for index, name in enumerate(floors)]
    if any(height is None for height, _, _ in keyed):
        return tuple(floors)
    return tuple(name for _, _, name in sorted(keyed, key=lambda item: (item[0] or 0.0, item[1])))


_GROUND = {"G", "GF", "E", "EG", "RC", "LG", "LOBBY", "UG"}
_BELOW = ("B", "U", "UG", "P", "-")


def _height(name: str) -> float | None:
    """Return how high a floor of this name usually lies, in storeys; None if the name does not say."""
    text = name.strip().upper()
    if text in _GROUND:
        return 0.0
    letters, digits = text.rstrip("0123456789"), text[len(text.rstrip("0123456789")) :]
    if not digits:
        return None
    if letters in _BELOW:
        return -float(digits)
    return float(digits) if letters in ("", "L", "F", "OG", "EG", "+", "FLOOR ", "LEVEL ") else None
