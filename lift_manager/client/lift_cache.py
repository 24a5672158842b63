"""What was heard of a lift, its age, and its ETag. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.api.lifts import Lift
from lift_manager.domain.seconds import without_seconds
from lift_manager.domain.state import Quality
from lift_manager.plain.aging import age_s, is_too_old


@dataclass(frozen=True)
class KnownLift:
    """The newest answer about a lift."""

    lift: Lift
    asked_at: float
    """When its question left, in monotonic seconds."""
    etag: str = ""

    def at(self, now: float) -> Lift:
        """Return it as it is to be taken now: with its age, and offline by itself once it is too old."""
        age = age_s(self.lift.age_s, self.asked_at, now)
        if self.lift.quality is Quality.OFFLINE or self.heard_at(now):
            releases_in_s = _after(self.lift.releases_in_s, now - self.asked_at)
            return self.lift.model_copy(update={"age_s": age, "releases_in_s": releases_in_s})
        silent_s = now - self.asked_at
        return self.lift.unread(age, f"the manager has not been heard for {silent_s:.1f} s")

    def heard_at(self, now: float) -> bool:
        """Whether it is still what the manager says, be it that the lift is offline."""
        told_s = 0.0 if self.lift.quality is Quality.OFFLINE else self.lift.age_s
        return not is_too_old(age_s(told_s, self.asked_at, now), self.lift.max_age_s)

    def same(self, told_s: float | None, asked_at: float) -> KnownLift:
        """Return it after the manager said that nothing but the age has changed."""
        held = self.lift.session
        if held is not None:
            held = held.model_copy(update={"for_s": held.for_s + asked_at - self.asked_at})
        releases_in_s = _after(self.lift.releases_in_s, asked_at - self.asked_at)
        lift = self.lift.model_copy(update={"age_s": told_s, "session": held, "releases_in_s": releases_in_s})
        return KnownLift(lift, asked_at, self.etag)


def _after(seconds: float | None, by_s: float) -> float | None:
    """Return what is left of a countdown."""
    return None if seconds is None else max(0.0, seconds - by_s)


def same_but_for_time(one: Lift, other: Lift) -> bool:
    """Whether two differ in nothing but what passes by itself."""
    return _timeless(one) == _timeless(other)


def _timeless(lift: Lift) -> Lift:
    """Return a lift without its age, for how long it is held, and the seconds in its reason; the reason itself stays."""
    held = None if lift.session is None else lift.session.model_copy(update={"for_s": 0.0})
    timeless: dict[str, object] = {"age_s": None, "releases_in_s": None}
    return lift.model_copy(update={**timeless, "session": held, "reason": without_seconds(lift.reason)})
