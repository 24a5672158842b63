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

    def lock_out(self, by: str, reason: str, *, at_once: bool) -> Lockout | Refused:
        """Keep robots off until a person says otherwise; a door that a robot may be in is released `clear_s` later unless `at_once`."""
        answer = self._people.lock_out(by, reason)
        if isinstance(answer, Lockout):
            text = f"locked out by {by}: {reason}"
            self._keeper.end_for_a_person(EndReason.LOCKOUT, text, _now(), at_once=at_once)
        return answer

    def force_release(self, by: str, reason: str, *, at_once: bool) -> ForceReleased | Refused:
        """End the session at a person's request, at the time that `lock_out` ends it. What is known of the car's contents is kept."""
        keeper, now = self._keeper, _now()
        if isinstance(held := keeper.held_by(None, now), Refused):
            return held
        at = self._people.clock()
        clear_s = keeper.end_for_a_person(EndReason.FORCED, f"released by {by}: {reason}", now, at_once=at_once)
        in_car = keeper.handshake.occupied_by(keeper.session if clear_s else None) is not None
        released = ForceReleased(by, at, reason, held.holder, in_car, clear_s)
        keeper.say.released(released)
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
