"""Changes the sets of the packet filter over netlink: in the time of a system call, where a run of `nft` takes 10 to 50 ms.

Each change is one transaction (nfnetlink, linux/netfilter/nf_tables.h): the kernel has applied it, or nothing of it, when `send` returns.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Sequence

from lift_manager.cluster.errors import FilterFailed
from lift_manager.cluster.filter_rules import PERMITTED, TABLE

_NETLINK_NETFILTER = 12
_NFTABLES = 10
"""The subsystem."""
_BEGIN, _END = 0x10, 0x11
_NEW_ELEMENTS, _DELETE_ELEMENTS = _NFTABLES << 8 | 12, _NFTABLES << 8 | 14
_REQUEST, _ACKNOWLEDGE, _CREATE = 0x1, 0x4, 0x400
_INET = 1
_NESTED = 0x8000
_ERROR = 2
_HEADER = struct.Struct("=IHHII")
_MOST_BYTES = 65536


class Kernel:
    """The sets of the filter in the kernel; the table is there already. Needs CAP_NET_ADMIN."""

    def __init__(self) -> None:
        """Open the connection to the kernel. Raises FilterFailed."""
        try:
            self._socket = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_CLOEXEC, _NETLINK_NETFILTER)
        except OSError as error:
            raise FilterFailed(f"this kernel has no nftables: {error.strerror or error}") from error
        self._sequence = 0

    def permit(self, user: int, ms: int, forget: Sequence[str] = ()) -> None:
        """Permit the programs of a user, and of nobody else, for this long; first forget every connection in these sets. Raises FilterFailed."""
        flushes = [_flush(name) for name in (*forget, PERMITTED)]
        self._transact(*flushes, (_NEW_ELEMENTS, _CREATE, _elements(PERMITTED, struct.pack("=I", user), ms)))

    def withdraw(self) -> None:
        """Permit nobody. Raises FilterFailed."""
        self._transact(_flush(PERMITTED))

    def close(self) -> None:
        """Close the connection to the kernel; the filter stays as it is."""
        self._socket.close()

    def _transact(self, *changes: tuple[int, int, bytes]) -> None:
        batch = self._message(_BEGIN, 0, b"", family=0, resource=_NFTABLES)
        batch += b"".join(self._message(kind, flags | _ACKNOWLEDGE, body) for kind, flags, body in changes)
        batch += self._message(_END, 0, b"", family=0, resource=_NFTABLES)
        try:
            self._socket.send(batch)
            answers = [self._answer() for _ in changes]
        except OSError as error:
            raise FilterFailed(f"the kernel takes no change of the filter: {error.strerror or error}") from error
        if failed := next(filter(None, answers), 0):
            raise FilterFailed(f"the kernel refuses to change the filter: {os.strerror(failed)}")

    def _message(self, kind: int, flags: int, body: bytes, *, family: int = _INET, resource: int = 0) -> bytes:
        self._sequence = (self._sequence + 1) % 2**32
        generic = struct.pack("!BBH", family, 0, resource)
        return _HEADER.pack(_HEADER.size + 4 + len(body), kind, _REQUEST | flags, self._sequence, 0) + generic + body

    def _answer(self) -> int:
        """Return the error number of the next answer, 0 for none. The kernel has written every answer before `send` returns."""
        answer = self._socket.recv(_MOST_BYTES, socket.MSG_DONTWAIT)
        kind, error = struct.unpack_from("=4xH10xi", answer)
        return -int(error) if kind == _ERROR else 0


def _flush(name: str) -> tuple[int, int, bytes]:
    return _DELETE_ELEMENTS, 0, _set(name)


def _elements(name: str, key: bytes, ms: int) -> bytes:
    value = _attribute(_NESTED | 1, _attribute(_NESTED | 1, _attribute(1, key)) + _attribute(4, struct.pack("!Q", ms)))
    return _set(name) + _attribute(_NESTED | 3, value)


def _set(name: str) -> bytes:
    return _attribute(1, TABLE.encode() + b"\0") + _attribute(2, name.encode() + b"\0")


def _attribute(kind: int, value: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(value), kind) + value + b"\0" * (-len(value) % 4)
