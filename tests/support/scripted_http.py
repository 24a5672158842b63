"""A server of HTTP that does what a test says, good manners or not."""

import json
import os
import queue
import socket
import ssl
import struct
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, BinaryIO, Self

WITHIN_S = 60.0
"""Nothing in a test takes so long; who waits longer has found a bug."""


@dataclass(frozen=True)
class Asked:
    """A request as it came."""

    method: str
    path: str
    headers: Mapping[str, str]
    body: bytes
    connection: int
    """Counted from 0, in the order in which they were taken."""

    @property
    def json(self) -> Any:
        return json.loads(self.body)


class Wire:
    """The connection on which a request came. What a client does not want any more is not an error of the server."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self.is_gone = False

    def send(self, *pieces: bytes) -> None:
        try:
            for piece in pieces:
                self._sock.sendall(piece)
        except OSError:
            self.is_gone = True

    def hang_up(self) -> None:
        with suppress(OSError):
            self._sock.shutdown(socket.SHUT_RDWR)

    def reset(self) -> None:
        """Hang up with a reset, as a killed process may."""
        self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        os.close(self._sock.detach())


Script = Callable[[Asked, Wire], None]


def said(status: int, body: Any = None, kind: str = "application/json", *, also: str = "") -> bytes:
    """Return a whole answer; `also` are further lines of its head, each with its end."""
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    head = f"HTTP/1.1 {status} Said\r\ncontent-type: {kind}\r\ncontent-length: {len(content)}\r\n{also}\r\n"
    return head.encode() + content


def says_and_hangs_up(answer: bytes) -> Script:
    def script(_: Asked, wire: Wire) -> None:
        wire.send(answer)
        wire.hang_up()

    return script


def answers(status: int, body: Any = None, kind: str = "application/json", *, also: str = "") -> Script:
    return lambda _, wire: wire.send(said(status, body, kind, also=also))


def problem(status: int, code: str, detail: str = "no") -> bytes:
    return said(status, {"status": status, "code": code, "detail": detail}, "application/problem+json")


@dataclass
class Scripted:
    """Calls `script` for each request, in a thread for each connection; ends with its context."""

    script: Script
    tls: ssl.SSLContext | None = None
    asked: list[Asked] = field(default_factory=list)
    port: int = 0
    """Any free one, unless it is given."""

    def __post_init__(self) -> None:
        self._news: queue.Queue[Asked] = queue.Queue()
        self._threads: list[threading.Thread] = []
        self._socks: list[socket.socket] = []
        self._listener: socket.socket | None = None
        self._is_over = False

    def __enter__(self) -> Self:
        self.listen()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def listen(self) -> None:
        """Take connections, on the port of before."""
        self._is_over = False
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._begin(self._accept, self._listener)

    def stop(self) -> None:
        """End everything, as a killed process does: the port is free, and all connections are gone."""
        assert self._listener is not None
        self._is_over = True
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for sock in list(self._socks):
            Wire(sock).hang_up()
        for thread in self._threads:
            thread.join(WITHIN_S)
            assert not thread.is_alive(), "a script still waits"
        self._threads.clear()
        self._socks.clear()

    def next(self, method: str = "GET") -> Asked:
        """Wait for the next request of this method, passing over others."""
        while (asked := self._news.get(timeout=WITHIN_S)).method != method:
            pass
        return asked

    def _begin(self, target: Callable[..., None], *arguments: object) -> None:
        thread = threading.Thread(target=target, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        number = 0
        with suppress(OSError):
            while True:
                sock, _ = listener.accept()
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._socks.append(sock)
                self._begin(self._serve, sock, number)
                number += 1

    def _serve(self, sock: socket.socket, number: int) -> None:
        with suppress(OSError), sock:
            if self.tls is not None:
                sock = self.tls.wrap_socket(sock, server_side=True)
                self._socks.append(sock)
            with sock, sock.makefile("rb") as file:
                if file.peek(1)[:1] == _TLS:
                    sock.sendall(said(400))
                    sock.shutdown(socket.SHUT_WR)
                    file.read()  # what is left unread would turn the end into a reset, and the answer be lost
                while (asked := _request(file, number)) is not None and not self._is_over:
                    self.asked.append(asked)
                    self._news.put(asked)
                    self.script(asked, Wire(sock))


_TLS = b"\x16"
"""The first byte of a client that speaks TLS: a server of plain HTTP says at once that it is none."""


def _request(file: BinaryIO, number: int) -> Asked | None:
    first = file.readline()
    if not first:
        return None
    method, path, _ = first.decode().split(" ", 2)
    headers: dict[str, str] = {}
    while (line := file.readline().strip()) != b"":
        name, _, value = line.decode().partition(":")
        headers[name.lower()] = value.strip()
    return Asked(method, path, headers, file.read(int(headers.get("content-length", 0))), number)
