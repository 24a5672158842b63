"""Estimates how long to wait for an answer from the answers so far.

The estimator is that of RFC 6298 (sections 2.2 and 2.3: smoothed round trip and its variation) with the lower bound that
Linux gives the variation, and with the slowest recent answer as a floor. Karn's rule against ambiguous samples is not needed: a transaction id is never used for a
second request, so every answer, even a late one, belongs to one request.
"""

from __future__ import annotations

SPARE_S = 0.25
"""Minimum wait beyond the usual round trip. Chosen: TCP sends a lost segment again after 0.2 s at the earliest (Linux), and
one lost segment is no silence."""
_REMEMBERS = 0.995
"""Decay of the slowest answer with each measured one. Chosen: half of it after 140, half a minute to two minutes. Otherwise each occasional
slow cycle of a controller would be a time-out: the variation of RFC 6298 forgets within a second."""


class Latency:
    """The time-out of one unit on one link, estimated across connections."""

    __slots__ = ("_calm_s", "_most_s", "_spare_s", "_usual_s", "_varies_s", "_worst_s", "timeout_s", "unmeasured")

    def __init__(self, first_s: float, *, spare_s: float, most_s: float) -> None:
        """Start with `first_s`; later at least `spare_s` more than the slowest recent round trip, and at most `most_s`."""
        self.timeout_s = first_s
        """How long the next answer may take."""
        self.unmeasured = 0
        """Answers since the last measured one; counted by the caller."""
        self._calm_s = first_s
        """The time-out without backoff."""
        self._spare_s = spare_s
        self._most_s = most_s
        self._usual_s = -1.0
        """Smoothed round trip; less than 0 before the first answer."""
        self._varies_s = 0.0
        self._worst_s = 0.0
        """The slowest recent answer, decaying."""

    @property
    def round_trip_s(self) -> float | None:
        """From request to answer, smoothed; None before the first answer."""
        return None if self._usual_s < 0 else self._usual_s

    def add_answer(self, took_s: float) -> None:
        """Record how long a good answer took, in time or not. Ends the backoff."""
        self.unmeasured = 0
        worst_s = self._worst_s * _REMEMBERS
        if took_s > worst_s:  # noqa: PLR1730
            worst_s = took_s
        self._worst_s = worst_s
        usual_s = self._usual_s
        if usual_s < 0:
            self._usual_s = usual_s = took_s
            self._varies_s = varies_s = took_s / 2
        else:
            off_s = took_s - usual_s
            self._usual_s = usual_s = usual_s + off_s * 0.125
            if off_s < 0:
                off_s = -off_s
            self._varies_s = varies_s = self._varies_s * 0.75 + off_s * 0.25
        # no min and max: this runs with every answer, and each of them costs a third of all the rest
        wait_s = varies_s * 4
        if wait_s < self._spare_s:  # noqa: PLR1730
            wait_s = self._spare_s
        wait_s += usual_s
        if wait_s < worst_s + self._spare_s:  # noqa: PLR1730
            wait_s = worst_s + self._spare_s
        if wait_s > self._most_s:  # noqa: PLR1730
            wait_s = self._most_s
        self.timeout_s = self._calm_s = wait_s

    def add_late_answer(self, took_s: float) -> None:
        """As `add_answer`, for a late answer: it counts as `most_s` at most."""
        self.add_answer(min(took_s, self._most_s))

    def add_timeout(self) -> None:
        """Record a time-out: wait twice as long for each next answer until one comes."""
        self.timeout_s = min(2 * self.timeout_s, self._most_s)

    def end_backoff(self) -> None:
        """End the backoff because another unit on this connection answers, so the connection works."""
        self.timeout_s = self._calm_s
