"""Which lifts are still being polled: this decides whether the manager is alive. Pure.

A failed poll is progress: a dead controller is a problem of its own lift, and a restart of the manager would not solve it. A poll
that never ends is not: then our own loop hangs.
"""

from __future__ import annotations

from collections.abc import Mapping

COMMANDS_AHEAD = 3
"""How many commands may go before a waiting read (the command lane of a link)."""


class Progress:
    """Remembers when the polls of each lift were last seen to advance."""

    def __init__(self, patience_s: Mapping[str, float], now: float) -> None:
        """`patience_s` says for each lift how long its polls may stand still; at `now` all of them count as fresh."""
        self._patience_s = dict(patience_s)
        self._polls = dict.fromkeys(patience_s, 0)
        self._advanced_at = dict.fromkeys(patience_s, now)

    def stuck(self, polls: Mapping[str, int], now: float) -> tuple[str, ...]:
        """Compare how many polls of each lift have ended; return the lifts whose number stood still for too long."""
        for lift, count in polls.items():
            if count != self._polls[lift]:
                self._polls[lift], self._advanced_at[lift] = count, now
        return tuple(lift for lift, at in self._advanced_at.items() if now - at > self._patience_s[lift])


def patience_s(*, poll_s: float, addresses: int, lifts: int, answer_s: float, gap_s: float) -> float:
    """How long one lift may take from the end of one poll to the end of the next, whatever its controller does.

    A poll makes at most `addresses` requests, or once one for every address by itself where the device refuses a block. Each
    request waits behind one of every other of the `lifts` on the same link and behind a few commands, and each of those takes
    `answer_s` at most, with `gap_s` after it. The first that takes longer ends the poll.
    """
    return poll_s + addresses * (lifts + COMMANDS_AHEAD) * (answer_s + gap_s)
