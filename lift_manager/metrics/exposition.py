"""What Prometheus reads: families of numbers as text, in its own format and in that of OpenMetrics 1.0.

Written here and not by prometheus-client, which takes 15 us for a sample: with 100 lifts a scrape would hold up every lift for a tenth of
a second. The tests read the text with the parsers of prometheus-client.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum, unique
from itertools import accumulate

PLAIN_TYPE = "text/plain; version=0.0.4; charset=utf-8"
OPEN_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"


@unique
class Kind(StrEnum):
    """How a family is to be read."""

    COUNTER = "counter"
    GAUGE = "gauge"
    HISTOGRAM = "histogram"


class Family:
    """All samples of one name."""

    __slots__ = ("help", "kind", "lines", "name")

    def __init__(self, name: str, kind: Kind, help_text: str) -> None:
        """`name` as the samples have it; of a counter it ends in `_total`."""
        self.name = name
        self.kind = kind
        self.help = help_text
        self.lines: list[str] = []

    def add(self, labels: str, value: float) -> None:
        """Add a sample; `labels` as `labelled` makes them."""
        self.lines.append(f"{self.name}{{{labels}}} {value}\n")

    def add_histogram(self, labels: str, bounds: Sequence[float], counts: Sequence[int], total: float) -> None:
        """Add the samples of a histogram: `counts` by range, each duration once."""
        start = f'{self.name}_bucket{{{labels},le="'
        so_far = tuple(accumulate(counts))
        self.lines += [f'{start}{bound}"}} {count}\n' for bound, count in zip(bounds, so_far, strict=False)]
        self.lines.append(
            f'{start}+Inf"}} {so_far[-1]}\n{self.name}_count{{{labels}}} {so_far[-1]}\n{self.name}_sum{{{labels}}} {total}\n'
        )

    def text(self, *, open_metrics: bool) -> str:
        """Return the family as text."""
        name = self.name.removesuffix("_total") if open_metrics else self.name
        return f"# HELP {name} {self.help}\n# TYPE {name} {self.kind}\n{''.join(self.lines)}"


def labelled(**words: str) -> str:
    """Return labels as a sample has them, whatever a site file calls its lifts."""
    return ",".join([f'{name}="{_escaped(word)}"' for name, word in words.items()])


def _escaped(word: str) -> str:
    # three of these take a tenth of what `translate` takes, and there are thousands in a scrape
    return word.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def wants_open_metrics(accept: str) -> bool:
    """Whether an `Accept` header names OpenMetrics; Prometheus puts it first where it reads it."""
    return any(part.partition(";")[0].strip().lower() == "application/openmetrics-text" for part in accept.split(","))
