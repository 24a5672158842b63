"""The socket of a service manager, for what a program sends to systemd."""

import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager

from tests.support.programs import HANGS_S


class Systemd:
    """The socket of a service manager."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self._socket.settimeout(HANGS_S)

    def hear(self, within_s: float = HANGS_S) -> list[str]:
        """One datagram, line by line."""
        self._socket.settimeout(within_s)
        return self._socket.recv(4096).decode().split("\n")

    def heard(self) -> list[str]:
        """Everything that has come by now."""
        self._socket.settimeout(0)
        lines: list[str] = []
        while True:
            try:
                lines += self._socket.recv(4096).decode().split("\n")
            except BlockingIOError:
                return lines

    def close(self) -> None:
        self._socket.close()


@contextmanager
def systemd_at(address: str) -> Iterator[Systemd]:
    with closing(Systemd(address)) as systemd:
        yield systemd
