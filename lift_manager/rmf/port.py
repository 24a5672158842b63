"""The manager as an adapter sees it: its requests and answers. `remote_manager` uses HTTP, `local_manager` direct calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from lift_manager.plain.rmf import SiteView


@dataclass(frozen=True)
class SessionDemand:
    """RMF's session demands the lift at a floor: the first one opens the session, each further one changes or repeats the demand."""

    lift: str
    """The site's name, like `floor`."""
    session: str
    """RMF's session id."""
    floor: str
    hold_door: bool
    """Hold the door open there until another floor is demanded or the session ends."""
    adapter: str = ""
    """The id of the requesting adapter: sessions of another adapter at the same manager are different ones, even with the same id."""


@dataclass(frozen=True)
class EndOfSession:
    """RMF's session has ended. Door hold and robot mode stay on for `grace_s`, unless the same session demands the lift again before."""

    lift: str
    session: str
    grace_s: float
    adapter: str = ""


ManagerRequest = SessionDemand | EndOfSession


@dataclass(frozen=True)
class Answer:
    """The manager's answer to one request; for each lift the answers come in the order of the requests."""

    request: ManagerRequest
    accepted: bool
    """The manager has decided so. For a `SessionDemand` the session then holds the lift; acceptance is not arrival."""
    code: str = ""
    """Why it was refused, a problem code; `unreachable` if no manager answered: then it is unknown whether the request arrived."""
    reason: str = ""
    """The refusal as a sentence."""
    boot: str = ""
    event: int = 0
    """If accepted: a `SiteView` of this boot with a lower number does not include it yet."""


UNREACHABLE = "unreachable"
NOT_SENT = "not_sent"
"""The code of a request that was never sent."""


Deliver = Callable[[Callable[[], None]], object]
"""Schedules a callable in the adapter's own thread, in order, like `loop.call_soon_threadsafe`: it never waits, never calls before it
returns, and may be used from any thread."""


class Manager(Protocol):
    """Takes requests without waiting; the answer comes to `ManagerListener.on_answer`."""

    def send(self, request: ManagerRequest) -> None:
        """Pass a request on. Never called for a lift whose last answer has not come."""
        ...


class ManagerListener(Protocol):
    """The callbacks of an adapter for the manager, always called in the adapter's own thread. Times are monotonic seconds."""

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        """Take over an answer, the first of which is complete; `sent_at` is when its request was sent, from which its ages count."""
        ...

    def on_answer(self, answer: Answer, now: float) -> None:
        """Process the answer to a request."""
        ...

    def on_manager_lost(self, reason: str, now: float) -> None:
        """React to a manager that does not answer."""
        ...
