"""The NATS subjects of a site, and the name of its stream. A site may use `site.<id>.>` and nothing else."""

from __future__ import annotations

STREAM = "JOURNAL"
"""The stream in the JetStream domain of a site: the rows of its journal."""

ACCOUNT = "SITE"
"""The account of the manager on the leaf node of its site."""


def prefix(site: str) -> str:
    """Return what all subjects of a site begin with."""
    return f"site.{site}"


def domain(site: str) -> str:
    """Return the JetStream domain of a site."""
    return f"site-{site}"


def journal(site: str) -> str:
    """Return the subject of the rows; they stay on the leaf node, in the stream."""
    return f"{prefix(site)}.journal"


def rows(site: str) -> str:
    """Return where the hub reads the stream. The leaf node maps it to a direct get, so the hub can do nothing else with the stream."""
    return f"{prefix(site)}.rows"


def news(site: str) -> str:
    """Return where the manager reports that it runs, and which row is the newest in the stream."""
    return f"{prefix(site)}.news"


def request(site: str, kind: str) -> str:
    """Return where the hub sends a request of a kind to the manager; `>` for all kinds."""
    return f"{prefix(site)}.request.{kind}"


def update(site: str, kind: str) -> str:
    """Return where a site sends a request about configuration updates of a kind to the hub; `*` for all kinds."""
    return f"{prefix(site)}.update.{kind}"


def inbox(site: str) -> str:
    """Return under which subject the replies to them arrive."""
    return f"{prefix(site)}.inbox"
