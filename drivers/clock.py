"""The clock that also counts while the computer is suspended, which the clock of the loop does not."""

from __future__ import annotations

import time


def boottime() -> float:
    """Return the seconds since the computer was started, those in which it was suspended included."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def suspended_s() -> float:
    """Return for how long it was suspended since then."""
    return boottime() - time.monotonic()
