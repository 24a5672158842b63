"""Checks the `hub` of a site file, and reads the password with which a site reaches its leaf node."""

from __future__ import annotations

from pathlib import Path

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
