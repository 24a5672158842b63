"""Compiles what each write carries where the controller itself decides which of two managers it obeys. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from register_maps.points import Cell, Image, Point
from register_maps.schema import EPOCH_BITS, Arbitration
from register_maps.signal_codec import Locate
from register_maps.words import BIT_TABLES


@dataclass(frozen=True, slots=True)
class Claim:
    """In which epoch a manager commands, and which machine it runs on."""

    epoch: int
    """Rises with every term of a cluster. 0 claims nothing, and is never obeyed."""
    owner: int
    """The number of the machine; 0 for a manager without a cluster."""

    def is_obeyed_after(self, obeyed: Claim) -> bool:
        """Whether a controller that has obeyed `obeyed` obeys this one: it is of a later epoch, or it is the same."""
        return self.epoch > obeyed.epoch or (self == obeyed and self.epoch > 0)


NO_CLAIM = Claim(0, 0)
"""What a write without a claim amounts to, and what a controller shows that has never obeyed one."""


def claim_alone(obeyed: Claim) -> Claim:
    """Return the claim of a manager without a cluster: the one that the controller has obeyed last, so that it obeys this one too."""
    return obeyed if obeyed.epoch else Claim(1, 0)


@dataclass(frozen=True, slots=True)
class ArbitrationCodec:
    """Where epoch and owner lie in each write."""

    epoch: tuple[Point, ...]
    """Lowest bits first."""
    owner: tuple[Point, ...]

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Every cell of both."""
        return tuple(point.cell for point in (*self.owner, *self.epoch))

    def encode(self, claim: Claim) -> dict[Point, int]:
        """Return the values of the points for a claim."""
        return _spread(self.epoch, claim.epoch) | _spread(self.owner, claim.owner)

    def decode(self, image: Image) -> Claim:
        """Return the claim in a register image."""
        return Claim(_join(self.epoch, image), _join(self.owner, image))


def arbitration_codec(spec: Arbitration, locate: Locate) -> ArbitrationCodec:
    """Compile the arbitration of a map."""
    owner = locate(spec.owner)
    return ArbitrationCodec(
        _points(locate(spec.epoch), EPOCH_BITS, spec.word_order), _points(owner, spec.owner_bits(owner.table))
    )


def _points(first: Point, bits: int, word_order: str = "high_first") -> tuple[Point, ...]:
    if first.table in BIT_TABLES:
        return tuple(replace(first, address=first.address + bit) for bit in range(bits))
    if bits == first.width:
        return (first,)
    after = replace(first, address=first.address + 1)
    return (after, first) if word_order == "high_first" else (first, after)


def _spread(points: Sequence[Point], value: int) -> dict[Point, int]:
    found = {}
    for point in points:
        found[point] = value & point.mask
        value >>= point.width
    return found


def _join(points: Sequence[Point], image: Image) -> int:
    value = shift = 0
    for point in points:
        value |= point.within(image[point.space][point.address]) << shift
        shift += point.width
    return value
