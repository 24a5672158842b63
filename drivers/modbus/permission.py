"""Whether something may be pressed: asked once when a step is carried out, and once more when its bytes leave."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from drivers.driver import Permit
from drivers.modbus.endings import ended
from drivers.modbus.presses import Press, Presses
from drivers.modbus.recipe import Outputs
from drivers.modbus.steps import NEED_PERMIT, Step, StepKind
from drivers.model import LiftValues, Result
from register_maps.codec import CommandCodec


class Permissions:
    """The permits of one lift's wishes, and what the lift itself says against a press."""

    def __init__(
        self,
        commands: Mapping[str, CommandCodec],
        signals: Collection[str],
        outputs: Outputs,
        presses: Presses,
        values: Callable[[], LiftValues | None],
        is_unread: Callable[[], bool],
    ) -> None:
        """`values` gives what the lift said last; `is_unread` says whether a connection is new and was not read yet."""
        self._commands = commands
        self._signals = signals
        self._outputs = outputs
        self._presses = presses
        self._values = values
        self._is_unread = is_unread
        self._permits: dict[str, Permit] = {}

    def note(self, name: str, permit: Permit) -> None:
        """Ask this from now on when the command of that name is pressed or refreshed."""
        self._permits[name] = permit

    def missing(self, name: str) -> list[str]:
        """List the flags that a command requires and the lift does not show."""
        values = self._values()
        flags = values.flags if values is not None else {}
        return [flag for flag in self._commands[name].spec.requires if not flags.get(flag, False)]

    def of(self, step: Step, press: Press | None) -> Permit | None:
        """Return what is asked immediately before a step leaves; None for what lets go, which nobody can refuse.

        A write would press its neighbours again: what may not be pressed now is let go with it, and is asked for once more
        when the bytes leave.
        """
        if step.kind not in NEED_PERMIT:
            if step.kind in (StepKind.LOOK, StepKind.CYCLE):
                return None
            neighbours = self._outputs.neighbours(step)
            if step.kind in (StepKind.BEAT, StepKind.RESET) and neighbours:
                return lambda: self._first_refusal(neighbours)
            self._drop_refused(step)
            return None

        if self._refusal(step.name) is None:
            self._drop_refused(step)

        def allowed() -> str | None:
            if not self._outputs.still_wanted(step):
                return "nobody wants it any more"
            if press is not None and self.missing(step.name):
                press.not_granted = True
            return self._refusal(step.name) or self._first_refusal(self._outputs.neighbours(step))

        return allowed

    def _drop_refused(self, step: Step) -> None:
        """Let go of the neighbours that this write may not press again."""
        for name in self._outputs.neighbours(step):
            if (reason := self._refusal(name)) is not None:
                self._outputs.let_go(name)
                self._presses.end(name, Result.UNCONFIRMED, f"let go together with {step.name}: {reason}")

    def _refusal(self, name: str) -> str | None:
        """Say why an output may not be written as pressed now."""
        if self._is_unread():
            return "the connection is new and has not been read yet"
        if missing := self.missing(name):
            return f"{name} needs {', '.join(missing)}"
        values = self._values()
        if values is not None and name in ended({name: self._commands[name]}, values, self._signals):
            return "the door is shut or opens, or something is in its way"
        return self._permits[name]()

    def _first_refusal(self, names: tuple[str, ...]) -> str | None:
        reasons = ((name, self._refusal(name)) for name in names)
        return next((f"{name} would be pressed with it: {reason}" for name, reason in reasons if reason), None)
