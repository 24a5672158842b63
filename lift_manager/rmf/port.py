"""The manager as an adapter sees it: what it is asked, what it answers. `beside` speaks HTTP, `inside` calls it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from lift_manager.plain.rmf import SiteView


@dataclass(frozen=True)
class SessionDemand:
    """RMF's session wants the lift at a floor: the first one opens it, each further one changes or repeats what is wanted."""

    lift: str
    """The site's name, like `floor`."""
    session: str
    """RMF's session id."""
    floor: str
    hold_door: bool
    """Hold the door open there until another floor is wanted or the session ends."""
    adapter: str = ""
    """The id of the adapter that asks: other adapters at the same manager have other sessions, even of the same id."""


@dataclass(frozen=True)
class EndOfSession:
    """RMF's session is over. Door hold and robot mode stay for `grace_s`, unless the same session wants the lift again within it."""

    lift: str
    session: str
    grace_s: float
    adapter: str = ""


ManagerRequest = SessionDemand | EndOfSession


@dataclass(frozen=True)
class Answer:
    """What the manager said to one of these; answers come one for one, in order for each lift."""

    request: ManagerRequest
    accepted: bool
    """It is decided so. Of `SessionDemand`: the session holds the lift; acceptance is not arrival."""
    code: str = ""
    """Why not, in a word of `web/ERRORS.md`; `unreachable` where no manager answered: then nobody knows whether it was heard."""
    reason: str = ""
    """The same in a sentence."""
    boot: str = ""
    event: int = 0
    """Of `accepted`: a `SiteView` of this boot with a lower number does not show it yet."""


UNREACHABLE = "unreachable"
NOT_SENT = "not_sent"
"""The code of a wish that never left: the manager has not heard of it."""


Deliver = Callable[[Callable[[], None]], object]
"""Has a callable called in the adapter's own thread, in the order given, as `loop.call_soon_threadsafe` does: never before it returns,
never waiting, and from any thread."""


class Manager(Protocol):
    """Takes what is asked without waiting; the answer comes to `ManagerListener.on_answer`."""

    def send(self, request: ManagerRequest) -> None:
        """Pass it on. Never called again for a lift whose last answer has not come."""
        ...


class ManagerListener(Protocol):
    """What of the adapter a way to the manager calls, always in the adapter's own thread. Times are monotonic seconds."""

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        """Take a whole answer; `sent_at` is when the question for it left, from which its ages count."""
        ...

    def on_answer(self, answer: Answer, now: float) -> None:
        """Take what became of something asked."""
        ...

    def on_manager_lost(self, reason: str, now: float) -> None:
        """The manager cannot be heard."""
        ...
