"""What people say about one lift, and what follows from it for the session that holds it. Nothing here waits."""

from __future__ import annotations

import asyncio

from lift_manager.core.keeper import SessionKeeper
from lift_manager.domain.asking import Refused
from lift_manager.domain.service import Acknowledged, EndReason, ForceReleased, Lockout


class PeopleWords:
    """The words of people to one lift."""

    def __init__(self, keeper: SessionKeeper) -> None:
        self._keeper = keeper
        self._people = keeper.people

    def lock_out(self, by: str, reason: str) -> Lockout | Refused:
        """Keep robots off until a person says otherwise, and let everything go at once."""
        keeper, answer = self._keeper, self._people.lock_out(by, reason)
        if isinstance(answer, Lockout):
            now = _now()
            keeper.end(EndReason.LOCKOUT, f"locked out by {by}: {reason}", now)
            keeper.handshake.let_go()
            keeper.act(now)
            keeper.changed()
        return answer

    def force_release(self, by: str, reason: str) -> ForceReleased | Refused:
        """End the session at a person's word. Whatever may be in the car stays there, and so does what is known of it."""
        keeper, now = self._keeper, _now()
        if isinstance(held := keeper.held_by(None, now), Refused):
            return held
        keeper.end(EndReason.FORCED, f"released by {by}: {reason}", now)
        in_car = keeper.handshake.occupied_by(None) is not None
        released = ForceReleased(by, self._people.clock(), reason, held.holder, in_car)
        keeper.say.released(released)
        keeper.act(now)
        keeper.changed()
        return released

    def acknowledge(self, by: str, *, offline: str) -> Acknowledged | Refused:
        """Take it that a person has checked the lift. `offline` says why, should it be offline."""
        keeper = self._keeper
        too_early = keeper.admission.too_early(offline=offline, letting_go=keeper.letting_go)
        if too_early is not None:
            return too_early
        held = keeper.session.holder if keeper.session is not None else None
        left = keeper.handshake.to_see_to(keeper.session, fire=self._people.fire_latched)
        answer = self._people.acknowledge(by, occupied=left is not None, held=held)
        if left is not None and isinstance(answer, Acknowledged):
            left(_now())
            keeper.act(_now())
        keeper.changed()
        return answer


def _now() -> float:
    return asyncio.get_running_loop().time()
