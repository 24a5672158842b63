"""HTTP requests, each with one deadline for the whole request, on connections that another thread can cut.

`http.client` alone bounds each read, so an answer of one byte a second would never end. Proxies and redirects are not followed.
"""

from __future__ import annotations

import http.client
import io
import json
import re
import select
import socket
import ssl
import threading
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

DEFAULT_PORT = 5003
"""The manager's own port, for an address that is not a URL."""
MANAGER = f"http://127.0.0.1:{DEFAULT_PORT}"
"""Where a manager is if nothing else is given."""
ANSWER_LIMIT = 16 * 1024 * 1024
"""In bytes. Chosen: a thousand lifts are a tenth of it."""
_PIECE = 64 * 1024


class BadAddress(ValueError):
    """An address, a key or a CA file that cannot be used. The message never holds the key."""


class NoAnswer(Exception):
    """No complete answer came back; the message says why, without the address."""


class _StaleConnection(NoAnswer):
    """A connection that had served earlier requests was closed before the first byte of this answer."""


@dataclass(frozen=True)
class Address:
    """Where a manager is."""

    host: str
    port: int
    tls: bool = False
    prefix: str = ""
    """The path that a proxy adds before `/api/v1`."""

    @classmethod
    def of(cls, text: str, port: int | None = None) -> Address:
        """Parse `host`, `host:port` or a URL; `port` applies if the text has none. Raises BadAddress."""
        bare, text = "://" not in text, text.strip()
        try:
            parts = urlsplit(f"http://{text}" if bare else text)
            given_port = parts.port
        except ValueError as error:
            raise BadAddress(f"{_shown_text(text)} is no address; {_ADDRESS_ADVICE}") from error
        # urlsplit drops tabs, and accepts blanks anywhere and letters after the bracket of an IPv6 address
        readable = text.isprintable() and " " not in text and not re.search(r"\][^:/?#]", text)
        host, is_http = parts.hostname or "", parts.scheme in ("http", "https")
        if not (readable and host and is_http and parts.path.isascii()) or parts.query or parts.fragment:
            raise BadAddress(f"{_shown_text(text)} is no address; {_ADDRESS_ADVICE}")
        if parts.username is not None or parts.password is not None:
            raise BadAddress("the address contains a user name; a manager takes a key, and not in its address")
        tls = parts.scheme == "https"
        usual = DEFAULT_PORT if bare else 443 if tls else 80
        found = next(number for number in (given_port, port, usual) if number is not None)
        if not 1 <= found <= 65535:
            raise BadAddress(f"port {found} does not exist; it is a number from 1 to 65535")
        return cls(host, found, tls, parts.path.rstrip("/"))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{self.port}{self.prefix}"


_ADDRESS_ADVICE = "write a host, host:port, or a URL such as https://lifts.example:5003"


def _shown_text(text: str) -> str:
    """Hide a text that may contain a password, as a mistyped URL does."""
    return "an address with an @" if "@" in text else repr(text)


class Server:
    """A manager's address and the key to send to it. Its `repr` does not show the key."""

    def __init__(self, address: Address, key: str = "", ca_file: Path | None = None) -> None:
        """`ca_file` is for https: the CA of the manager's certificate, if the system does not trust it. Raises BadAddress."""
        if not (key.isascii() and key.isprintable()) or " " in key:
            raise BadAddress("the key contains a blank, a line break or a letter that no key has; copy it again")
        if ca_file is not None and not address.tls:
            raise BadAddress(f"a CA file is for https, and the address is {address}")
        self.address = address
        self.tls = _context(ca_file) if address.tls else None
        self._key = key

    def __repr__(self) -> str:
        return f"Server({self.address})"

    def headers(self) -> dict[str, str]:
        """Return the headers that every request carries."""
        return {"Authorization": f"Bearer {self._key}"} if self._key else {}

    def without_key(self, text: str) -> str:
        """Return text from elsewhere as one short line without control characters and without the key."""
        line = "".join(letter if letter.isprintable() else " " for letter in text)
        return (line.replace(self._key, "...") if self._key else line)[:_SHOWN_LIMIT]


_SHOWN_LIMIT = 400
"""In characters. Chosen: a refusal of a manager is about half of it."""


def _context(ca_file: Path | None) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=ca_file)
    except OSError as error:  # ssl.SSLError is one
        cause = error.strerror if not isinstance(error, ssl.SSLError) else "it contains no certificate in PEM form"
        raise BadAddress(f"the CA file {ca_file} cannot be used: {cause}") from error
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


@dataclass(frozen=True)
class Reply:
    """A complete answer of any status."""

    status: int
    kind: str
    """Its content type, without parameters."""
    body: bytes


class StreamedReply:
    """An answer whose body is read piece by piece."""

    def __init__(self, response: http.client.HTTPResponse, wire: _Wire) -> None:
        self._response = response
        self._wire = wire
        self.status = response.status
        self.kind = response.headers.get_content_type()

    def read_piece(self, within_s: float) -> bytes:
        """Return the next piece as soon as it arrives; empty at the end. Raises NoAnswer."""
        try:
            self._wire.set_deadline(time.monotonic() + within_s)
            return self._response.read1(_PIECE)
        except (http.client.HTTPException, OSError, ValueError) as error:
            raise NoAnswer(describe_error(error)) from error

    def close(self) -> None:
        """Discard the rest of the body."""
        self._response.close()

    def read_all(self) -> bytes:
        """Return the whole body, within the deadline of its request. Raises OSError and http.client's errors."""
        pieces: list[bytes] = []
        size = 0
        while piece := self._response.read(_PIECE):
            pieces.append(piece)
            size += len(piece)
            if size > ANSWER_LIMIT:
                raise http.client.HTTPException("its answer has no end")
        if self._response.length:
            raise http.client.IncompleteRead(b"")
        return b"".join(pieces)


class Connection:
    """One connection, kept open between requests. One thread sends requests; any thread may `cut` it, for good."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._wire = _Wire(server)

    def cut(self) -> None:
        """Abort the request under way and refuse all later ones."""
        self._wire.cut()

    def close(self) -> None:
        """Close the connection; called by the thread that sends requests."""
        self._wire.close()

    def request(self, method: str, path: str, body: Mapping[str, object] | None = None, *, within_s: float) -> Reply:
        """Send a request that is safe to repeat and return the answer. Raises NoAnswer.

        A server may close an idle connection just as the request leaves. So if a connection that had served earlier requests ends
        without a byte of an answer, the request is sent once more on a new one. It is repeated in no other case.
        """
        deadline = time.monotonic() + within_s
        try:
            return self._request(method, path, body, deadline)
        except _StaleConnection:
            return self._request(method, path, body, deadline)

    def open(self, path: str, kind: str, *, within_s: float) -> StreamedReply:
        """Request a streamed answer, on a new connection. Raises NoAnswer."""
        self._wire.close()
        return self._send("GET", path, None, {"Accept": kind, "Cache-Control": "no-store"}, time.monotonic() + within_s)

    def _request(self, method: str, path: str, body: Mapping[str, object] | None, deadline: float) -> Reply:
        headers = {"Accept": "application/json, application/problem+json"}
        try:
            with closing(self._send(method, path, body, headers, deadline)) as streamed:
                return Reply(streamed.status, streamed.kind, streamed.read_all())
        except (http.client.HTTPException, OSError, ValueError) as error:
            self._wire.close()
            raise NoAnswer(describe_error(error)) from error

    def _send(
        self, method: str, path: str, body: Mapping[str, object] | None, headers: dict[str, str], deadline: float
    ) -> StreamedReply:
        has_served = self._wire.is_idle()
        sent = None if body is None else json.dumps(body).encode()
        if sent is not None:
            headers["Content-Type"] = "application/json"
        try:
            self._wire.set_deadline(deadline)
            self._wire.request(method, self._server.address.prefix + path, sent, {**headers, **self._server.headers()})
            return StreamedReply(self._wire.getresponse(), self._wire)
        except (http.client.HTTPException, OSError, ValueError) as error:
            is_stale = has_served and not self._wire.has_received and isinstance(error, _CLOSED)
            self._wire.close()
            raise (_StaleConnection if is_stale else NoAnswer)(describe_error(error)) from error


_CLOSED = (ConnectionError, ssl.SSLEOFError, ssl.SSLZeroReturnError)
_CERTIFICATE = "its certificate is not trusted here ({}); give the file of the CA that signed it"


def describe_error(error: Exception) -> str:
    """Explain in words why there was no answer, without quoting anything that came over the network."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return _CERTIFICATE.format(error.verify_message)
    if isinstance(error, socket.gaierror | UnicodeError):
        return "its name is not known to this computer"
    if (
        isinstance(error, OSError)
        and error.strerror
        and not isinstance(error, tuple(kind for kind, _ in _DESCRIPTIONS))
    ):
        return error.strerror
    return next(
        (words for kind, words in _DESCRIPTIONS if isinstance(error, kind)), "what answers there does not speak HTTP"
    )


_DESCRIPTIONS: tuple[tuple[type[Exception], str], ...] = (
    (TimeoutError, "no whole answer came in time"),
    (ConnectionRefusedError, "nothing listens there: is the manager running?"),
    (http.client.RemoteDisconnected, "the connection was closed without an answer"),
    (http.client.IncompleteRead, "half an answer came, and the connection was closed"),
    (ConnectionError, "the connection broke"),
    (ssl.SSLEOFError, "the connection broke"),
    (ssl.SSLZeroReturnError, "the connection broke"),
    (ssl.SSLError, "what answers there does not speak TLS as we do: is its address http, not https?"),
)


class _Wire(http.client.HTTPConnection):
    """`http.client` over a socket with a deadline."""

    def __init__(self, server: Server) -> None:
        address = server.address
        super().__init__(address.host, address.port)
        self.default_port = 443 if address.tls else 80
        self._tls = server.tls
        self._deadline = 0.0
        self._guard = threading.Lock()
        self._open: socket.socket | None = None
        self._is_cut = False
        self.has_received = False
        """Whether a byte arrived since the last `set_deadline`."""

    def set_deadline(self, deadline: float) -> None:
        """Bound everything that follows by this monotonic time."""
        self._deadline = deadline
        self.has_received = False

    def remaining_s(self) -> float:
        """Return the time until the deadline. Raises TimeoutError once it has passed."""
        remaining = self._deadline - time.monotonic()
        if remaining <= 0:
            raise TimeoutError
        return remaining

    def cut(self) -> None:
        """Wake the thread that reads, writes or connects. Called from any thread."""
        with self._guard:
            self._is_cut = True
            if self._open is not None:
                _shut_down(self._open)

    def connect(self) -> None:
        """Connect before the deadline to the first of its addresses that answers. Only the name lookup has a time limit of the system."""
        sock = self._open_socket()
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._tls is not None:
                sock = self._tls.wrap_socket(sock, server_hostname=self.host, do_handshake_on_connect=False)
                self._use(sock)
                sock.settimeout(self.remaining_s())
                sock.do_handshake()
        except BaseException:
            sock.close()
            raise
        self.sock = _DeadlineSocket(sock, self)

    def is_idle(self) -> bool:
        """Whether the connection can be used again; one that the server has closed is dropped."""
        if self.sock is None:
            return False
        looking = select.poll()
        looking.register(self.sock, select.POLLIN)
        # nothing is due between two answers, so readable data means the end of the connection
        if looking.poll(0):
            self.close()
        return self.sock is not None

    def _open_socket(self) -> socket.socket:
        found = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        failure: OSError | None = None
        for number, (family, kind, protocol, _, address) in enumerate(found):
            sock = socket.socket(family, kind, protocol)
            try:
                self._use(sock)
                # an address that never answers leaves time for the next one
                sock.settimeout(self.remaining_s() / (len(found) - number))
                sock.connect(address)
                return sock
            except OSError as error:
                sock.close()
                failure = error
        raise failure or OSError("its name has no address")

    def _use(self, sock: socket.socket) -> None:
        with self._guard:
            if self._is_cut:
                raise ConnectionAbortedError
            self._open = sock


def _shut_down(sock: socket.socket) -> None:
    try:
        # the `shutdown` of a TLS socket would free what its reader is using
        socket.socket.shutdown(sock, socket.SHUT_RDWR)
    except OSError:
        # already disconnected
        return


class _DeadlineSocket:
    """The part of a socket that `http.client` uses, bounded by the deadline."""

    def __init__(self, sock: socket.socket, wire: _Wire) -> None:
        self._sock = sock
        self._wire = wire

    def fileno(self) -> int:
        return self._sock.fileno()

    def sendall(self, data: bytes) -> None:
        self._sock.settimeout(self._wire.remaining_s())
        self._sock.sendall(data)

    def makefile(self, mode: str) -> io.BufferedReader:
        return io.BufferedReader(_DeadlineReader(self._sock, self._wire))

    def close(self) -> None:
        self._sock.close()


class _DeadlineReader(io.RawIOBase):
    """Reads before the deadline. It keeps the socket open, as `http.client` expects, until it is closed."""

    def __init__(self, sock: socket.socket, wire: _Wire) -> None:
        self._sock = sock
        self._raw = sock.makefile("rb", buffering=0)
        self._wire = wire

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int | None:  # type: ignore[override]
        self._sock.settimeout(self._wire.remaining_s())
        count = self._raw.readinto(buffer)
        self._wire.has_received = self._wire.has_received or bool(count)
        return count

    def close(self) -> None:
        self._raw.close()
        super().close()
