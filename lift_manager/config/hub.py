"""Checks the `hub` of a site file, and reads the files of its leaf node: the password for it, and where it connects to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from lift_manager.config.problem import Problem
from lift_manager.config.site import Site
from lift_manager.config.tls import path_of


def hub_problems(site: Site, folder: Path) -> list[Problem]:
    """Return every reason why the file cannot be used."""
    if site.hub is None:
        return []
    if site.cluster is not None:
        message = "a site with a `cluster` cannot take part in a hub yet: each of its machines has a journal of its own"
        return [Problem(("hub",), message)]
    path = path_of(folder, site.hub.password)
    try:
        text, mode = path.read_text("utf-8"), path.stat().st_mode
    except FileNotFoundError:
        problem = "does not exist; paths are relative to the site file, and `lift-manager hub site add` makes it"
    except (OSError, UnicodeDecodeError) as error:
        problem = f"cannot be read: {error.strerror if isinstance(error, OSError) else 'it is not text'}"
    else:
        if mode & 0o007:
            problem = "can be read by everybody on this computer; `chmod 600` corrects it"
        elif not text.strip():
            problem = "is empty"
        else:
            return []
    return [Problem(("hub", "password"), f"{path} {problem}")]


def hub_password(site: Site, folder: Path) -> str:
    """Return the password of a site with a hub whose file has no problem."""
    assert site.hub is not None  # noqa: S101  for mypy
    return path_of(folder, site.hub.password).read_text("utf-8").strip()


class Server(NamedTuple):
    """A NATS server as a URL names it."""

    host: str
    port: int
    uses_tls: bool

    @classmethod
    def of(cls, url: str) -> Server:
        """Return the server of a URL. Raises ValueError."""
        parts = urlsplit(url)
        if not parts.hostname or not parts.port:
            raise ValueError(f"{url} has no host and port")
        return cls(parts.hostname, parts.port, parts.scheme == "tls")


class LeafUnreadable(Exception):
    """The configuration of a leaf node cannot be read; the sentence says why."""


def leaf_files(site: Site, folder: Path) -> tuple[Path, Path]:
    """Return where `lift-manager hub site add` puts the configuration of the leaf node, and the CA of the hub: beside the password."""
    assert site.hub is not None  # noqa: S101  for mypy
    password = path_of(folder, site.hub.password)
    return password.with_name("leaf.conf"), password.with_name("ca.pem")


def hub_servers(leaf_conf: Path) -> tuple[Server, ...]:
    """Return the NATS servers of the hub, to which a leaf node connects. Raises LeafUnreadable."""
    try:
        # a comment, and then JSON without its outer braces
        found = json.loads("{" + leaf_conf.read_text("utf-8").partition("\n")[2] + "}")
        return tuple(Server.of(url) for remote in found["leafnodes"]["remotes"] for url in remote["urls"])
    except OSError as error:
        raise LeafUnreadable(f"{leaf_conf} cannot be read ({error.strerror or error})") from error
    except (ValueError, LookupError, TypeError) as error:
        raise LeafUnreadable(f"{leaf_conf} is not as `lift-manager hub site add` writes it") from error
