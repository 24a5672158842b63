"""Everything that the hub raises on purpose.

HubError
├── NatsMissing     nats-py or a NATS server is not installed; the message says what to do
├── FolderUnusable  a file of the hub's folder cannot be used
├── SiteSilent      a site did not reply in time, or is not connected
├── BadReply        a site sent a reply that cannot be read
├── SiteRefused     a site replied that it does not do what was requested
├── HubSilent       the hub did not reply to a site, or is not connected
└── UpdateRefused   a configuration update cannot be made, offered or taken; the message says why and what to do
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lift_manager.hub.messages import ProblemMessage


class HubError(Exception):
    """Root of everything that the hub raises on purpose."""


class NatsMissing(HubError):
    """Something has to be installed first."""

    def __init__(self, cause: object) -> None:
        super().__init__(
            f"the hub needs nats-py, and it does not load ({cause}).\n"
            "Install the manager with its extra `hub`: pip install '.[hub]' in its folder, in its own environment."
        )


class FolderUnusable(HubError):
    """A file of the hub's folder cannot be used; the message says why and what to do."""


class SiteSilent(HubError):
    """A site did not reply. `was_sent` says whether the request may have reached it."""

    def __init__(self, text: str, *, was_sent: bool) -> None:
        super().__init__(text)
        self.was_sent = was_sent


class BadReply(HubError):
    """A site sent a reply that cannot be read; what was requested may have been done."""


class SiteRefused(HubError):
    """A site replied that it does not do what was requested."""

    def __init__(self, problem: ProblemMessage) -> None:
        super().__init__(problem.message)
        self.problem = problem


class HubSilent(HubError):
    """The hub did not reply to a site."""


class UpdateRefused(HubError):
    """A configuration update cannot be made, offered or taken; the message says why and what to do."""


@contextmanager
def file_errors(path: Path, done: str) -> Iterator[None]:
    """Raise UpdateRefused where a file cannot be `done`, such as `read`."""
    try:
        yield
    except OSError as error:
        raise UpdateRefused(f"{path} cannot be {done} ({error.strerror or error})") from error
