"""The pictures of README.md, as SVG files that stand alone."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from itertools import pairwise

from lift_manager.commissioning.checkout.record import Latency
from lift_manager.commissioning.checkout.report.charts import (
    FILLS,
    GRID,
    INK,
    WIDTH,
    drawing,
    histogram,
    line_to,
    round_ticks,
    text_at,
)

LEFT, RIGHT, TOP, HIGH = 60.0, 130.0, 20.0, 200.0
"""Room for the numbers of the axis, for the names at the ends of the lines, and the height of the axis."""
STYLE = "<style>text{font:11px sans-serif;fill:#222}</style>"
PAPER = '<rect width="100%" height="100%" fill="#fff"/>'


def cost_lines(title: str, lines: Mapping[str, Sequence[tuple[float, float]]], x_label: str, y_label: str) -> str:
    """Return one line for each name, from the origin of both axes on, with a dot for each point."""
    points = [point for found in lines.values() for point in found]
    x_ticks, y_ticks = (round_ticks(max(point[axis] for point in points)) for axis in range(2))
    bottom, wide = TOP + HIGH, WIDTH - LEFT - RIGHT
    parts = []
    for tick in y_ticks:
        y = bottom - HIGH * tick / y_ticks[-1]
        parts += [line_to(LEFT, y, LEFT + wide, y, GRID), text_at(LEFT - 6, y + 3.5, f"{tick:g}", "end")]
    for tick in x_ticks:
        parts.append(text_at(LEFT + wide * tick / x_ticks[-1], bottom + 14, f"{tick:g}", "middle"))
    parts.append(line_to(LEFT, bottom, LEFT + wide, bottom, INK))
    parts += [text_at(LEFT + wide / 2, bottom + 28, x_label, "middle"), text_at(LEFT - 6, TOP - 8, y_label, "start")]
    for (name, found), colour in zip(lines.items(), FILLS, strict=False):
        at = [(LEFT + wide * x / x_ticks[-1], bottom - HIGH * y / y_ticks[-1]) for x, y in sorted(found)]
        parts += [line_to(*start, *end, colour) for start, end in pairwise(at)]
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in at]
        parts.append(text_at(at[-1][0] + 8, at[-1][1] + 3.5, name, "start"))
    return _alone(drawing(title, bottom + 36, parts))


def latencies(title: str, samples_ms: Sequence[float]) -> str:
    """Return how often a measurement took how long."""
    percentiles = statistics.quantiles(samples_ms, n=100)
    p50_ms, p99_ms = round(percentiles[49], 2), round(percentiles[98], 2)
    found = Latency(p50_ms=p50_ms, p99_ms=p99_ms, max_ms=round(max(samples_ms), 2), samples_ms=tuple(samples_ms))
    return _alone(histogram(title, found))


def _alone(picture: str) -> str:
    """Return a picture with what the page of a report gives it: a font, and paper, which a dark page does not have."""
    head, end, rest = picture.partition("</title>")
    return f"{head}{end}{STYLE}{PAPER}{rest}\n"
