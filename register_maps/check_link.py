"""Checks that what a map says of its link can be kept at the same time."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.errors import Problem
from register_maps.schema import RegisterMap


def check_link(source: RegisterMap) -> Iterator[Problem]:
    """Yield a limit of silence that the pace of the link cannot keep."""
    link, key = source.link, ("link", "idle_timeout_s")
    if link.idle_timeout_s is not None and link.silence_s(link.min_poll_s) >= link.idle_timeout_s:
        message = (
            f"{link.idle_timeout_s:g} s without a request cannot be avoided: a poll comes every {link.min_poll_s:g} s at most (min_poll_s),"
            f" and an answer may take {link.timeout_s:g} s (timeout_s); correct one of them"
        )
        yield Problem(key, message)
