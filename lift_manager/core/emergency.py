"""What a mode without robots does to a lift: in fire the robot is told first, and then everything is let go."""

from __future__ import annotations

from collections.abc import Callable

from lift_manager.core.announce import Announcer
from lift_manager.core.options import LiftOptions
from lift_manager.core.people import PeopleFirst
from lift_manager.domain.service import Advice
from lift_manager.domain.sight import Sight, on_fire
from lift_manager.domain.state import Holder
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode


class Emergency:
    """The mode of one lift, as far as it takes the lift from robots."""

    def __init__(self, options: LiftOptions, people: PeopleFirst, say: Announcer) -> None:
        self._options = options
        self._people = people
        self._say = say
        self.release_at: float | None = None
        """The robot has been told of the fire; then everything is let go."""

    def seen(self, sight: Sight, holder: Holder | None, advice: Callable[[], Advice], now: float) -> str | None:
        """Take what the lift says. A text is why everything has to be let go at once; in a fire `release_at` says when."""
        mode = sight.values.mode
        if on_fire(sight.values) and not self._people.fire_latched:
            self._people.latch_fire()
            self.release_at = now
            if holder is not None and mode is Mode.FIRE:
                self.release_at += self._options.fire_release_delay_s
            self._say.fire(holder, advice())
        if mode not in ROBOT_FORBIDDEN_MODES or mode is Mode.UNKNOWN:
            return None
        if self.release_at is None:
            return f"the mode is {mode}"
        if mode is not Mode.FIRE:
            self.release_at = now
        return None
