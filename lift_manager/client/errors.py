"""What can go wrong between a program and the manager.

ClientError
├── Unreachable      no reply: no connection, a timeout, a TLS error
├── NotAManager      a reply that is not from a lift manager
├── Refused          the manager refused the request; `problem` has the details
│   ├── Held         another caller holds the lift, or is ahead in the queue
│   ├── Stale        the lift cannot be read, so it cannot be used
│   ├── NotFound     there is no such lift, session, command, ride or link
│   └── NotAllowed   no key, or one that may not do this
└── SessionLost      the session is over, and not because its holder closed it
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lift_manager.api.problem import Problem

if TYPE_CHECKING:
    from lift_manager.api.sessions import Over


class ClientError(Exception):
    """Root of what this package raises."""


class Unreachable(ClientError):
    """The manager did not reply."""

    def __init__(self, text: str, *, url: str, may_have_arrived: bool) -> None:
        super().__init__(f"no manager answers at {url} ({text})")
        self.text = text
        """Why, without the address."""
        self.url = url
        self.may_have_arrived = may_have_arrived
        """Whether the manager may have received the request anyway."""


class NotAManager(ClientError):
    """Another program replied, or a proxy on the way to the manager."""

    def __init__(self, text: str, *, url: str, status: int) -> None:
        super().__init__(f"the server at {url} is not a lift manager (HTTP {status}): {text}")
        self.url = url
        self.status = status
        """Of HTTP."""


class Refused(ClientError):
    """The manager refused the request."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem
        """The details: `code`, `holder`, `mode`, `since_s`, `age_s`, `ahead`, `field`."""

    @property
    def code(self) -> str:
        """Stable, for programs."""
        return self.problem.code

    @property
    def status(self) -> int:
        """Of HTTP."""
        return self.problem.status


class Held(Refused):
    """Another caller holds the lift, or is ahead in the queue; see `problem.holder` and `problem.ahead`."""


class Stale(Refused):
    """The lift cannot be read; `problem.age_s` is the age of the latest reading."""


class NotFound(Refused):
    """There is no such lift, session, command, ride or link."""


class NotAllowed(Refused):
    """No key was sent, it is not valid there, or it may not do this."""


class SessionLost(ClientError):
    """The session is over, and its holder did not close it. The lift may do anything; the advice is for a robot at its door."""

    def __init__(self, text: str, over: Over | None = None) -> None:
        super().__init__(text)
        self.over = over
        """Reason and advice of the manager; None if it was unreachable until the lease had ended."""


_BY_CODE: dict[str, type[Refused]] = {"held": Held, "queued": Held, "offline": Stale}
_BY_STATUS: dict[int, type[Refused]] = {401: NotAllowed, 403: NotAllowed, 404: NotFound}


def refused_error(problem: Problem) -> Refused:
    """Return the error for a refusal."""
    kind = _BY_CODE.get(problem.code) or _BY_STATUS.get(problem.status) or Refused
    return kind(problem)
