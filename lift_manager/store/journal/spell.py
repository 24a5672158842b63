"""One spell of trouble with the disk: what is told of it, when it is over, and what the journal says of it afterwards."""

from __future__ import annotations

from lift_manager.domain.journal import Row, RowKind

CALM_COMMITS = 3
"""So many commits in a row have to end in time before a disk that was silent is trusted again. Chosen: a disk that is slow every
other time must not give presses back for a second each."""

RELAPSE_S = 600.0
"""A spell that begins so soon after another needs twice as many of them to end, up to MOST_COMMITS. Chosen: presses that come and go
all day help no robot, and a disk on the brink is not told of more than a few times an hour."""
MOST_COMMITS = 96

REASONS = 10
"""Kept of one spell. Chosen: more than a disk has ways to fail."""


class Spell:
    """From the first commit that fails or is late to the one after which rows are written again."""

    def __init__(self, since_us: int, why: str, calm_commits: int = CALM_COMMITS) -> None:
        """Begin one, for a reason that ends with what to do; `calm_commits` end it if the disk was silent."""
        self.calm_commits = calm_commits
        self.taken = False
        """Whether the disk took the last commit: it is slow, no more."""
        self._since_us = since_us
        self._reasons = [why]
        self._wanted = 1
        self._calm = 0

    def is_news(self, why: str) -> bool:
        """Whether nobody was told of this reason yet."""
        if why in self._reasons or len(self._reasons) >= REASONS:
            return False
        self._reasons.append(why)
        return True

    def late(self) -> None:
        """Take it that the disk is silent: one commit in time is not enough then."""
        self._wanted, self._calm = self.calm_commits, 0

    def failed(self) -> None:
        """Take it that a commit has failed."""
        self.taken, self._calm = False, 0

    def over(self, *, in_time: bool) -> bool:
        """Take it that a commit has reached the disk, and say whether that is the end."""
        self.taken = True
        self._calm = self._calm + 1 if in_time else 0
        return self._calm >= self._wanted

    def row(self, now_us: int) -> Row:
        """Return the one row that the journal has of it."""
        why = self._reasons[0].split("; ", maxsplit=1)[0]
        text = f"no row could be written for {max(now_us - self._since_us, 0) / 1e6:.0f} s: {why}"
        return Row(RowKind.ALARM, text, data={"from": self._since_us, "to": now_us, "why": self._reasons})
