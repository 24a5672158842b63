"""Numbers that are not in use, in the words of Suricata's modbus keyword. Pure.

There addresses count from 1 and `a<>b` leaves out both ends (user guide, Modbus keyword). Measured with Suricata 7.0.10: `0<>b` is
read as `<b` and `a<>65535` as `>a`; the address 65535 on the wire counts as 0, because 65536 does not fit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from lift_manager.commissioning.network.model import Span

HIGHEST_ADDRESS = 0xFFFF
HIGHEST_UNIT = 0xFF


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch that nobody uses."""

    terms: tuple[str, ...]
    """What the keyword calls it; two where one cannot say it. Empty: everything."""
    before: Span | None
    """The last used stretch below; None where there is none."""
    after: Span | None


def address_gaps(used: Sequence[Span]) -> Iterator[Gap]:
    """Yield what lies around the used stretches of one table; `used` are in order and do not touch."""
    if not used:
        yield Gap((), None, None)
        return
    top_is_used = used[-1].last == HIGHEST_ADDRESS
    low, below = (1 if top_is_used else 0), None
    for span in used:
        if low <= span.start:
            yield Gap(tuple(_terms(low, span.start, HIGHEST_ADDRESS)), below, span)
        low, below = span.last + 2, span
    if low <= HIGHEST_ADDRESS:
        yield Gap(tuple(_terms(low, HIGHEST_ADDRESS, HIGHEST_ADDRESS)), below, None)


def unit_gaps(used: Collection[int]) -> Iterator[str]:
    """Yield the unit ids that are not in use, as the keyword calls them."""
    low = 0
    for unit in sorted(used):
        if low < unit:
            yield from _terms(low, unit - 1, HIGHEST_UNIT)
        low = unit + 1
    if low <= HIGHEST_UNIT:
        yield from _terms(low, HIGHEST_UNIT, HIGHEST_UNIT)


def _terms(low: int, high: int, top: int) -> Iterator[str]:
    """Say `low` to `high`, both included; `top` is the highest there is."""
    if low == high:
        yield str(low)
    elif low == 0:
        yield f"<{high + 1}"
    elif low == 1:
        yield "1"
        yield from _terms(2, high, top)
    elif high == top:
        yield f">{low - 1}"
    elif high == HIGHEST_ADDRESS - 1:
        yield from _terms(low, high - 1, top)
        yield str(high)
    else:
        yield f"{low - 1}<>{high + 1}"
