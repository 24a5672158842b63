"""What every face sees of the manager."""

from __future__ import annotations

from typing import Protocol

from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.service import Acknowledged, Lockout, LockoutEnded, Remembered
from lift_manager.domain.state import LiftState


class LiftFacade(Protocol):
    """All lifts of a site, as a face uses them; nothing here waits, so a hung controller delays nobody."""

    def lift_names(self) -> tuple[str, ...]:
        """Every lift of the site, in the site's order, whether or not it can be reached."""
        ...

    def state(self, lift: str) -> LiftState | None:
        """The newest state, from memory; None when the site has no such lift."""
        ...

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide at once. All session rules live behind this call, the release rule for a closed door included."""
        ...

    def acknowledge(self, lift: str, by: str) -> Acknowledged | Refused:
        """Take a person's word that a lift was checked after a fire, or that no robot is in its car; `by` is their name."""
        ...

    def lock_out(self, lift: str, by: str, reason: str) -> Lockout | Refused:
        """Take a person's word that no robot may command a lift; everything is let go at once."""
        ...

    def end_lockout(self, lift: str, by: str) -> LockoutEnded | Refused:
        """Take a person's word that robots may command a lift again."""
        ...

    def remembered(self, lift: str) -> Remembered | None:
        """What people said about a lift, and what outlives the manager; None when the site has no such lift."""
        ...
