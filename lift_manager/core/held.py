"""Whether a door that is held was read while it was held. Pure."""

from __future__ import annotations


class ReadWhileHeld:
    """Sees to it that no robot is invited on a reading from before the hold.

    A door that was read open may have begun to close by its own timer before the hold reached the lift, and goes on closing
    until the lift obeys: "open" of that reading would let a robot drive at it.
    """

    def __init__(self) -> None:
        self._since: float | None = None

    def __call__(self, *, held: bool, read_at: float, now: float) -> bool:
        """Return whether the lift was asked at `read_at` after the hold was seen to be on; to be called whenever anything is looked at."""
        if not held:
            self._since = None
            return False
        if self._since is None:
            self._since = now
        return read_at > self._since
