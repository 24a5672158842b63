"""What is still done for a session that its holder has ended, until its grace is over. Nothing here waits."""

from __future__ import annotations

from collections.abc import Callable

from drivers.model import CommandKind
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import Permit, always
from lift_manager.domain.asking import Ask
from lift_manager.domain.session import Session


def last_word(session: Session | None, options: LiftOptions) -> Ask | None:
    """Return the release that its holder has given already; None for a session that goes on."""
    if session is None or not session.ending or session.closing is not None:
        return None
    return Ask(options.name, session.holder, session.floor or options.floors[0], hold_door=False)


def before_the_end(kind: CommandKind, session: Callable[[], Session | None]) -> Permit:
    """Return what is asked when a press begins: nothing does for a session that ends soon. What is on already stays.

    That a robot left is told in any case: it is what ends a session.
    """
    if kind is CommandKind.ROBOT_LEFT:
        return always

    def begins() -> str | None:
        now = session()
        if now is None or not now.ending:
            return None
        return (
            f"{now.holder} has ended its session" if now.closing is None else f"the session is over: {now.closing[1]}"
        )

    return begins
