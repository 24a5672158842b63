"""What can go wrong between a program and the manager.

ClientError
├── Unreachable      nothing came back: no connection, no answer in time, TLS
├── NotAManager      something answered, and not as a lift manager does
├── Refused          the manager said no; `problem` has its words and values
│   ├── Held         somebody else holds the lift, or waited for it before
│   ├── Stale        the lift cannot be read, so nothing is done with it
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
    """Nothing came back from the manager."""

    def __init__(self, text: str, *, url: str, may_have_arrived: bool) -> None:
        super().__init__(f"no manager answers at {url} ({text})")
        self.text = text
        """Why, without the address."""
        self.url = url
        self.may_have_arrived = may_have_arrived
        """The manager may have taken the request all the same."""


class NotAManager(ClientError):
    """Another program answered, or something between here and the manager."""

    def __init__(self, text: str, *, url: str, status: int) -> None:
        super().__init__(f"what answers at {url} is no lift manager (HTTP {status}): {text}")
        self.url = url
        self.status = status
        """Of HTTP."""


class Refused(ClientError):
    """The manager said no, and why."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem
        """All that it said: `code`, `holder`, `mode`, `since_s`, `age_s`, `ahead`, `field`."""

    @property
    def code(self) -> str:
        """Stable, for programs."""
        return self.problem.code

    @property
    def status(self) -> int:
        """Of HTTP."""
        return self.problem.status


class Held(Refused):
    """Somebody else holds the lift, or waited for it before; `problem.holder` or `problem.ahead` says so."""


class Stale(Refused):
    """The lift cannot be read; `problem.age_s` is the age of what is known."""


class NotFound(Refused):
    """There is no such lift, session, command, ride or link."""


class NotAllowed(Refused):
    """No key was sent, it does not count there, or it may not do this."""


class SessionLost(ClientError):
    """The session is over, and its holder did not close it. The lift may do anything; the advice is for a robot at its door."""

    def __init__(self, text: str, over: Over | None = None) -> None:
        super().__init__(text)
        self.over = over
        """Reason and advice in the manager's words; None where the manager was not heard until the lease had ended."""


_BY_CODE: dict[str, type[Refused]] = {"held": Held, "queued": Held, "offline": Stale}
_BY_STATUS: dict[int, type[Refused]] = {401: NotAllowed, 403: NotAllowed, 404: NotFound}


def refusal(problem: Problem) -> Refused:
    """Return the error for an answer no."""
    kind = _BY_CODE.get(problem.code) or _BY_STATUS.get(problem.status) or Refused
    return kind(problem)
