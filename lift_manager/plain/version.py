"""The version of the program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def running_version() -> str:
    """Return the version of this program, as installed."""
    try:
        return version("lift-manager")
    except PackageNotFoundError:
        return "0+checkout"
