"""Every refusal that a site raises.

RequestRefused          a request is not taken: `code` is stable, the message names the cure, `blocking` is what stands in the way
    NotFound            what the request names does not exist: a lift, a ride, a session, a command
    Invalid             the request names a value that the lift does not have
    Conflict            the lift, its session or its people forbid it now
        LiftTaken       another caller holds the lift, or comes first: send another request
    TooOften            the caller has to be slower
    Unavailable         the manager takes no requests now: it stops, or its disk takes nothing
"""

from __future__ import annotations

from lift_manager.lift.refusals import Blocking, Refusal, Refused


class RequestRefused(Exception):
    """A request is not taken."""

    def __init__(self, code: Refusal, message: str, blocking: Blocking | None = None) -> None:
        """`code` is one of `Refusal`."""
        super().__init__(message)
        self.code, self.message, self.blocking = code, message, blocking


class NotFound(RequestRefused):
    """What the request names does not exist."""


class Invalid(RequestRefused):
    """The request names a value that the lift does not have."""


class Conflict(RequestRefused):
    """The lift, its session or its people forbid it now."""


class LiftTaken(Conflict):
    """Another caller holds the lift, or comes first."""


class TooOften(RequestRefused):
    """The caller has to be slower."""


class Unavailable(RequestRefused):
    """The manager takes no requests now."""


_KINDS: dict[Refusal, type[RequestRefused]] = {
    Refusal.UNKNOWN_LIFT: NotFound,
    Refusal.UNKNOWN_RIDE: NotFound,
    Refusal.NO_SUCH_SESSION: NotFound,
    Refusal.NO_SUCH_COMMAND: NotFound,
    Refusal.UNKNOWN_FLOOR: Invalid,
    Refusal.HELD: LiftTaken,
    Refusal.QUEUED: LiftTaken,
    Refusal.TOO_OFTEN: TooOften,
    Refusal.TOO_MANY: TooOften,
    Refusal.NOT_RECORDED: Unavailable,
    Refusal.STOPPING: Unavailable,
}


def raised(refused: Refused) -> RequestRefused:
    """Return what is raised for a refusal of the rules."""
    return _KINDS.get(refused.code, Conflict)(refused.code, refused.message, refused.blocking)
