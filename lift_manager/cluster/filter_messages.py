"""What a manager and the packet filter of its machine say to each other: a line of JSON each, over a Unix socket. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from ipaddress import ip_address

ANSWER_S = 0.5
"""How long a manager waits for an answer. Chosen: it takes less than a millisecond, and a term has room for four that do not come."""

MOST_BYTES = 65536
"""Of a line. Chosen: many times what a site with a hundred controllers needs."""


@dataclass(frozen=True, slots=True)
class PermissionRequest:
    """A manager requests that its packets pass until its term ends."""

    epoch: int
    """Of its term. What another one has left in the kernel is not sent."""
    until: float
    """When the term ends on CLOCK_BOOTTIME, which both read: for how long that is, only who applies it can know."""
    controllers: tuple[str, ...]
    """Those of its site, which have to be those of the filter: any other one would be reached unfiltered."""


@dataclass(frozen=True, slots=True)
class PermissionAnswer:
    """The filter has answered."""

    refused: str = ""
    """Why nothing passes; empty if it does."""


class BadMessage(ValueError):
    """A line is no such message."""


def encode(message: PermissionRequest | PermissionAnswer) -> bytes:
    """Return a message as a line."""
    return json.dumps(asdict(message)).encode() + b"\n"


def decode_request(line: bytes) -> PermissionRequest:
    """Read a request. Raises BadMessage."""
    match _object(line):
        case {"epoch": int(epoch), "until": float(until), "controllers": [*controllers]}:
            return PermissionRequest(epoch, until, tuple(map(str, controllers)))
        case _:
            raise BadMessage("it is no request of a manager of this version")


def decode_answer(line: bytes) -> PermissionAnswer:
    """Read an answer. Raises BadMessage."""
    match _object(line):
        case {"refused": str(refused)}:
            return PermissionAnswer(refused)
        case _:
            raise BadMessage("its answer is none of this version")


def controller_names(controllers: Iterable[tuple[str, int]]) -> tuple[str, ...]:
    """Name controllers by address and port, each once and in order, however the site file writes an address."""
    places = {(str(ip_address(host)), port) for host, port in controllers}
    return tuple(f"[{host}]:{port}" if ":" in host else f"{host}:{port}" for host, port in sorted(places))


def _object(line: bytes) -> object:
    try:
        return json.loads(line)
    except ValueError as error:
        raise BadMessage("it is no JSON") from error
