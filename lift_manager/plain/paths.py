"""Paths of the REST API under /api/v1. Pure."""

from __future__ import annotations

from urllib.parse import quote

API = "/api/v1"
EVENTS = f"{API}/events"
RMF = f"{API}/rmf"
"""The site as an Open-RMF adapter needs it."""


def part(name: str) -> str:
    """Quote a name as one part of a path, including `/` and the dots of `..`, which HTTP clients would resolve."""
    return quote(name, safe="").replace(".", "%2E")


def lift_path(lift: str, *more: str) -> str:
    """Return the path of a lift, or of something below it."""
    return "/".join([API, "lifts", part(lift), *more])


def session_path(lift: str, session: str, *more: str) -> str:
    """Return the path of a session, or of something below it."""
    return lift_path(lift, "sessions", part(session), *more)


def ride_path(ride: str, *more: str) -> str:
    """Return the path of a ride, or of something below it."""
    return "/".join([API, "rides", part(ride), *more])


def frames_path(link: str) -> str:
    """Return the path of the frames on a link."""
    return "/".join([API, "links", part(link), "frames"])


def rmf_path(lift: str, word: str) -> str:
    """Return the path to which an Open-RMF adapter reports a session: `wanted` or `ended`."""
    return lift_path(lift, "rmf", word)
