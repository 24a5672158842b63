"""What every face sees of the manager."""

from __future__ import annotations

from typing import Protocol

from lift_manager.domain.asking import Accepted, Ask, Refused, TurnedAway
from lift_manager.domain.service import Acknowledged, ForceReleased, Lockout, LockoutEnded, Remembered
from lift_manager.domain.state import Holder, LiftState


class LiftFacade(Protocol):
    """All lifts of a site, as a face uses them; nothing here waits, so a hung controller delays nobody."""

    @property
    def unwritten(self) -> frozenset[str]:
        """Which of `journal` and `state` cannot be written: then nothing is pressed on any lift."""
        ...

    def lift_names(self) -> tuple[str, ...]:
        """Every lift of the site, in the site's order, whether or not it can be reached."""
        ...

    def state(self, lift: str) -> LiftState | None:
        """The newest state, from memory; None when the site has no such lift."""
        ...

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide at once. All session rules live behind this call, the release rule for a closed door included."""
        ...

    def turned_away(self, who: TurnedAway) -> None:
        """Write down a request that a face refused by itself."""
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

    def force_release(self, lift: str, by: str, reason: str) -> ForceReleased | Refused:
        """Take a person's word that a session is over; everything is let go as at the end of any session."""
        ...

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session of `holder` to another caller, at the holder's own word; the car and its door stay as they are."""
        ...

    def remembered(self, lift: str) -> Remembered | None:
        """What people said about a lift, and what outlives the manager; None when the site has no such lift."""
        ...
