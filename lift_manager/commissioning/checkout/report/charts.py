"""Charts as inline SVG, drawn for paper: dark enough for a black-and-white printer, without a script. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

from lift_manager.commissioning.checkout.record import Latency
from lift_manager.commissioning.checkout.report.figures import Times

WIDTH = 640.0
_LABEL, _RIGHT = 110.0, 74.0
"""Room for the labels of the rows, and for the numbers behind the bars."""
_ROW, _GAP, _TOP, _AXIS = 15.0, 7.0, 26.0, 30.0
_PAGE = 740.0
"""The most height of the bars of one chart. Chosen: with its axis and a heading it fits on a page."""
FILLS = ("#2b4a6b", "#a9bdd2")
GRID, INK = "#d5d9de", "#222"
_BINS = 24
_TAIL = 1.5
"""The histogram ends at this many times the 99th percentile; what took longer is in its last bin."""


def bars(title: str, series: Sequence[tuple[str, Sequence[Times]]]) -> str:
    """Return horizontal bars of medians, one group per label and one bar per series, with a dot for each measurement.

    Several charts on one scale where one would not fit on a page; empty without any measurement.
    """
    labels = list(dict.fromkeys(times.label for _, found in series for times in found))
    seconds = [value for _, found in series for times in found for value in times.seconds]
    if not seconds:
        return ""
    ticks, fits = round_ticks(max(seconds)), int(_PAGE / (_ROW * len(series) + _GAP))
    return "".join(
        _bar_chart(title, labels[first : first + fits], series, ticks) for first in range(0, len(labels), fits)
    )


def _bar_chart(
    title: str, labels: Sequence[str], series: Sequence[tuple[str, Sequence[Times]]], ticks: Sequence[float]
) -> str:
    scale = (WIDTH - _LABEL - _RIGHT) / ticks[-1]
    group = _ROW * len(series) + _GAP
    bottom = _TOP + group * len(labels)
    by_label = [{times.label: times for times in found} for _, found in series]
    parts = [*_legend([name for name, _ in series]), *_grid(ticks, scale, bottom)]
    for index, label in enumerate(labels):
        top = _TOP + _GAP / 2 + index * group
        parts.append(text_at(_LABEL - 8, top + _ROW * len(series) / 2 + 3.5, label, "end"))
        for row, found in enumerate(by_label):
            if (times := found.get(label)) is not None:
                parts += _bar(times, top + row * _ROW, scale, FILLS[row % len(FILLS)])
    return drawing(title, bottom + _AXIS, parts)


def histogram(title: str, latency: Latency) -> str:
    """Return the distribution of answer times with its percentiles. Empty without samples."""
    samples = latency.samples_ms
    if not samples:
        return ""
    end = round_ticks(min(max(samples), max(latency.p99_ms * _TAIL, 1e-3)))[-1]
    counts = [0] * _BINS
    for value in samples:
        counts[min(int(value / end * _BINS), _BINS - 1)] += 1
    left, right, height, bottom = 46.0, 16.0, 120.0, 150.0
    wide = WIDTH - left - right
    most = round_ticks(max(counts))
    parts = []
    for tick in most:
        y = bottom - height * tick / most[-1]
        parts += [line_to(left, y, WIDTH - right, y, GRID), text_at(left - 6, y + 3.5, f"{tick:g}", "end")]
    for index, count in enumerate(counts):
        if count:
            bar = height * count / most[-1]
            x = left + wide * index / _BINS
            parts.append(
                f'<rect x="{x + 0.7:.1f}" y="{bottom - bar:.1f}" width="{wide / _BINS - 1.4:.1f}" height="{bar:.1f}" fill="{FILLS[0]}"/>'
            )
    parts.append(line_to(left, bottom, WIDTH - right, bottom, INK))
    for tick in round_ticks(end):
        parts.append(text_at(left + wide * tick / end, bottom + 14, f"{tick:g}", "middle"))
    parts.append(text_at(WIDTH / 2, bottom + 28, "milliseconds from request to answer", "middle"))
    marks = [("p50", latency.p50_ms), ("p99", latency.p99_ms)]
    for row, (name, value) in enumerate(marks):
        x = left + wide * min(value, end) / end
        parts.append(f'<path d="M{x:.1f} 8V{bottom}" stroke="{INK}" stroke-dasharray="3 3" fill="none"/>')
        aside, anchor = (4, "start") if x < WIDTH / 2 else (-4, "end")
        parts.append(text_at(x + aside, 16 + 12 * row, f"{name} {value:g} ms", anchor))
    above = sum(value >= end for value in samples)
    if above and max(samples) > end:
        note = f"last bar: {above} above {end:g} ms, the longest {latency.max_ms:g} ms"
        parts.append(text_at(WIDTH - right, 40, note, "end"))
    return drawing(title, bottom + 36, parts)


def _bar(times: Times, top: float, scale: float, fill: str) -> Iterator[str]:
    length, middle = times.median * scale, top + _ROW / 2
    yield f'<rect x="{_LABEL}" y="{top + 2:.1f}" width="{length:.1f}" height="{_ROW - 4}" fill="{fill}"/>'
    dots = times.seconds if len(times.seconds) > 1 else ()
    for value in dots:
        yield f'<circle cx="{_LABEL + value * scale:.1f}" cy="{middle:.1f}" r="2" fill="#fff" stroke="{INK}" stroke-width="0.8"/>'
    behind = _LABEL + max(times.seconds) * scale + 7
    yield text_at(behind, middle + 3.5, f"{times.median:.1f} s", "start")


def _legend(names: Sequence[str]) -> Iterator[str]:
    x = _LABEL
    for index, name in enumerate(names):
        yield f'<rect x="{x:.0f}" y="6" width="10" height="10" fill="{FILLS[index % len(FILLS)]}"/>'
        yield text_at(x + 15, 15, name, "start")
        x += 35 + 6.2 * len(name)


def _grid(ticks: Sequence[float], scale: float, bottom: float) -> Iterator[str]:
    for tick in ticks:
        x = _LABEL + tick * scale
        yield line_to(x, _TOP, x, bottom, GRID)
        yield text_at(x, bottom + 14, f"{tick:g}", "middle")
    yield line_to(_LABEL, _TOP, _LABEL, bottom, INK)
    yield text_at(
        _LABEL + ticks[-1] * scale / 2, bottom + 27, "seconds (bar: median; dots: each measurement)", "middle"
    )


def round_ticks(most: float) -> list[float]:
    """Return round numbers from 0 to the first one that is not below `most`, four to seven of them."""
    rough = max(most, 1e-9) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * (1 - 1e-9))
    return [round(index * step, 12) for index in range(math.ceil(most / step - 1e-9) + 1)]


def drawing(title: str, height: float, parts: Sequence[str]) -> str:
    """Return a picture of this height and `WIDTH`."""
    name = escape(title)
    return (
        f'<svg class="chart" role="img" aria-label="{name}" viewBox="0 0 {WIDTH:g} {height:g}" xmlns="http://www.w3.org/2000/svg">'
        f"<title>{name}</title>{''.join(parts)}</svg>"
    )


def text_at(x: float, y: float, text: str, anchor: str) -> str:
    """Return a text; `anchor` says which end of it is at x."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def line_to(x: float, y: float, to_x: float, to_y: float, colour: str) -> str:
    """Return a straight line."""
    return f'<path d="M{x:.1f} {y:.1f}L{to_x:.1f} {to_y:.1f}" stroke="{colour}" fill="none"/>'
