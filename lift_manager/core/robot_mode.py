"""When the lift's robot mode is asked for, and when it is dropped: under way only where the lift itself lets no robot command it."""

from __future__ import annotations

from drivers.model import Command, CommandKind
from lift_manager.core.outputs import LiftOutputs, Permit
from lift_manager.domain.sight import Sight, moving

_ROBOT_MODE = Command(CommandKind.ROBOT_MODE)


class RobotMode:
    """The robot mode of one lift; a lift without one needs none."""

    def __init__(self, outputs: LiftOutputs) -> None:
        self._outputs = outputs
        self._able = outputs.capabilities
        self._keep_until: float | None = None
        """The session is over, but the car still moves."""
        self._pressed = False
        """It was pressed, or may be found on after a restart; a wish that waits for its row was not."""

    @property
    def known(self) -> bool:
        """Whether this lift has one."""
        return _ROBOT_MODE.name in self._able.commands

    @property
    def kept(self) -> bool:
        """Whether it may be on although its session is over."""
        return self._keep_until is not None

    @property
    def kept_until(self) -> float | None:
        """Until when it is kept at the most; None where its session is not over, or it is not on."""
        return self._keep_until

    def hold(self, permit: Permit, *, begin: bool = True) -> None:
        """Ask for it, or renew it; only renew it where it may not `begin`."""
        given = self._outputs.given(_ROBOT_MODE)
        if not given:
            self._pressed = False
        if begin or given:
            self._outputs.hold(_ROBOT_MODE, self._noted(permit), begin=begin)

    def stay(self) -> None:
        """Do not press it again should the lift lose it; what is on is renewed by `hold`."""
        self._outputs.keep(_ROBOT_MODE)

    def _noted(self, permit: Permit) -> Permit:
        """Return a permit that notes when the bytes may leave, which is asked once nothing else is waited for."""

        def allowed() -> str | None:
            refusal = permit()
            self._pressed = self._pressed or refusal is None
            return refusal

        return allowed

    def adopt(self, permit: Permit) -> None:
        """Keep it on if it is found on after a restart."""
        if self.known:
            self._pressed = True
            self._outputs.adopt(_ROBOT_MODE, permit)

    def adopt_rest(self, permit: Permit, until: float | None) -> None:
        """Keep it on if it is found on after a restart and its session is over; None where it is not to be kept."""
        if self.known and until is not None:
            self._keep_until = until
            self.adopt(permit)

    def drop(self) -> None:
        """Let go of it at once."""
        self._keep_until, self._pressed = None, False
        self._outputs.let_go(_ROBOT_MODE)

    def session_ended(self, now: float) -> None:
        """Keep it from here on only for as long as a car may take to come to rest; drop it if it was not pressed yet."""
        self._keep_until = self.kept_after(now)
        if self._keep_until is None:
            self.drop()
        else:
            # at once, for the lift may not be readable: what has fallen by the next connection is not pressed for nobody
            self._outputs.keep(_ROBOT_MODE)

    def kept_after(self, over_at: float) -> float | None:
        """Return until when it would be kept at the most were its session over then."""
        return over_at + self._able.arrive_within_s if self.known and self._pressed else None

    def settle(
        self, sight: Sight | None, last: Sight | None, permit: Permit, *, reporting: bool, now: float
    ) -> str | None:
        """Drop it once the car stands still and nothing is left to report; a text is what a person should know.

        A car that never stands keeps it for a bounded time. While the lift cannot be read, `sight` is None, what it said
        last decides, and the hold is not renewed; one that was never read may be under way.
        """
        granted = last is not None and (
            "robot_mode_on" not in self._able.signals or last.values.flags.get("robot_mode_on", False)
        )
        under_way = last is not None and moving(last) and granted
        until = self._keep_until
        if until is not None and now < until and (last is None or under_way or reporting):
            if sight is not None:
                self.hold(permit, begin=False)
            return None
        self.drop()
        if until is None or not under_way:
            return None
        return f"nobody has seen the car come to rest for {self._able.arrive_within_s:g} s; robot mode is dropped"
