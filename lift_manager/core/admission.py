"""Whether a lift may be commanded now: for a request, a press, and the robot mode that a moving car keeps."""

from __future__ import annotations

from collections.abc import Callable

from drivers.model import Capabilities, CommandKind, FloorName
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import Permit
from lift_manager.core.people import PeopleFirst
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, barred, fire_unread, on_fire
from register_maps.vocabulary import CALLS

_CALLS = frozenset(CALLS) - {CommandKind.GO}
"""Commands that bring the empty car."""
_TOO_OLD = "the last reading is too old"


class Admission:
    """What speaks against commanding one lift, whoever wants to."""

    def __init__(
        self, options: LiftOptions, able: Capabilities, people: PeopleFirst, sight: Callable[[], Sight | None]
    ) -> None:
        """`sight` gives what is known now unless it is too old."""
        self._options = options
        self._able = able
        self._people = people
        self._sight = sight

    def unknown_floor(self, floor: FloorName) -> Refused | None:
        """Refuse a floor that the lift does not have."""
        if floor in self._options.floors:
            return None
        text = f"{self._options.name} has no floor {floor!r}; its floors are {', '.join(self._options.floors)}"
        return Refused(Refusal.UNKNOWN_FLOOR, text)

    def refusal(self, *, offline: str, goes_on: bool) -> Refused | None:
        """Return why a request may not command the lift now. `offline` says why, should the lift be offline.

        `goes_on` tells a robot that has begun already: it has to get out at any hour.
        """
        name, sight, people = self._options.name, self._sight(), self._people
        if (refused := people.locked_out()) is not None:
            return refused
        if not self._options.control:
            return Refused(
                Refusal.MONITOR_ONLY, f"{name} is only watched: its site file does not say `access: control`"
            )
        if not self._able.commands.intersection(_CALLS):
            text = f"{name} cannot be called: its map {self._able.map_name} has neither go_to nor call"
            return Refused(Refusal.NOT_POSSIBLE, text)
        if sight is None:
            return Refused(Refusal.OFFLINE, offline)
        if (refused := people.after_fire()) is not None:
            return refused
        if (why_not := barred(sight.values, self._able)) is not None:
            return Refused(Refusal.MODE, f"{name} takes no robots now: {why_not}")
        return None if goes_on else people.draining() or people.outside_hours()

    def too_early(self, *, offline: str, letting_go: bool) -> Refused | None:
        """Return why nobody can have checked the lift yet: nothing is acknowledged while an alarm may go on.

        `offline` says why, should the lift be offline; `letting_go` tells of a fire in which not everything is let go yet.
        """
        name, sight = self._options.name, self._sight()
        unsure = "nobody can tell whether an alarm is over, so nothing is acknowledged until it is read again"
        if sight is None:
            return Refused(Refusal.OFFLINE, f"{offline}; {unsure}")
        if on_fire(sight.values) or letting_go:
            text = f"{name} still tells of a fire; acknowledge it once the alarm is over and the lift was checked"
            return Refused(Refusal.FIRE_ACTIVE, text)
        signal = fire_unread(sight.values, self._able)
        if signal is None or not self._people.fire_latched:
            return None
        raw = (
            f" reads {sight.values.unknown[signal]}, which its map does not list"
            if signal in sight.values.unknown
            else " cannot be read"
        )
        return Refused(Refusal.FIRE_ACTIVE, f"the signal {signal} of {name}{raw}; {unsure}")

    def why_no_press(self, *, closing: bool = False) -> str | None:
        """Return why nothing may be pressed or held now; a lockout releases what is held for a session only when it has closed."""
        sight = self._sight()
        if sight is None:
            return _TOO_OLD
        return self._people.why_no_press(closing=closing) or barred(sight.values, self._able)

    def permit(self, number: int, session: Callable[[], Session | None]) -> Permit:
        """Return the check that the link makes immediately before the bytes of a press leave, for the session of that number."""

        def permit() -> str | None:
            now = session()
            if now is None or now.number != number:
                return "the session has ended"
            return self.why_no_press(closing=now.closing is not None)

        return permit

    def why_no_robot_mode(self) -> str | None:
        """Return why robot mode may not be renewed for a car under way; a lockout stops presses, and does not drop it."""
        sight = self._sight()
        if sight is None:
            return _TOO_OLD
        return "there was a fire" if self._people.fire_latched else barred(sight.values, self._able)
