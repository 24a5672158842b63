"""Requests over HTTP: each with a time limit on the whole of it, on connections that another thread can cut.

`http.client` alone bounds each read, so that an answer of one byte a second never ends. No proxy is used, no redirect followed.
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
"""Of an address that is no URL: the manager's own."""
ANSWER_LIMIT = 16 * 1024 * 1024
"""Chosen: in bytes; a thousand lifts are a tenth of it."""
_PIECE = 64 * 1024


class BadAddress(ValueError):
    """An address, a key or a CA file that cannot be used. The message never holds the key."""


class NoAnswer(Exception):
    """Nothing whole came back; the message says why, without the address."""


class _Stale(NoAnswer):
    """A connection that had served before was closed before a byte of this answer came."""


@dataclass(frozen=True)
class Address:
    """Where a manager is."""

    host: str
    port: int
    tls: bool = False
    prefix: str = ""
    """What comes before `/api/v1`, where a proxy adds something."""

    @classmethod
    def of(cls, text: str, port: int | None = None) -> Address:
        """Read `host`, `host:port` or a URL; `port` counts where the text has none. Raises BadAddress."""
        bare, text = "://" not in text, text.strip()
        try:
            parts = urlsplit(f"http://{text}" if bare else text)
            told = parts.port
        except ValueError as error:
            raise BadAddress(f"{_shown(text)} is no address; {_ADDRESSES}") from error
        # urlsplit leaves out tabs, and takes blanks anywhere and letters behind the bracket of an IPv6 address
        readable = text.isprintable() and " " not in text and not re.search(r"\][^:/?#]", text)
        host, is_http = parts.hostname or "", parts.scheme in ("http", "https")
        if not (readable and host and is_http and parts.path.isascii()) or parts.query or parts.fragment:
            raise BadAddress(f"{_shown(text)} is no address; {_ADDRESSES}")
        if parts.username is not None or parts.password is not None:
            raise BadAddress("the address holds a user's name; a manager takes a key, and not in its address")
        tls = parts.scheme == "https"
        usual = DEFAULT_PORT if bare else 443 if tls else 80
        found = next(number for number in (told, port, usual) if number is not None)
        if not 1 <= found <= 65535:
            raise BadAddress(f"port {found} does not exist; it is a number from 1 to 65535")
        return cls(host, found, tls, parts.path.rstrip("/"))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{self.port}{self.prefix}"


_ADDRESSES = "write a host, host:port, or a URL such as https://lifts.example:5003"


def _shown(text: str) -> str:
    """A mistyped URL may hold a password."""
    return "what holds an @" if "@" in text else repr(text)


class Server:
    """A manager's address, and the key that it is asked with; shows itself without the key."""

    def __init__(self, address: Address, key: str = "", ca_file: Path | None = None) -> None:
        """`ca_file` is for https: who signed the manager's certificate, where the system does not know it. Raises BadAddress."""
        if not (key.isascii() and key.isprintable()) or " " in key:
            raise BadAddress("the key holds a blank, a line break or a letter that no key has; copy it anew")
        if ca_file is not None and not address.tls:
            raise BadAddress(f"a CA file is for https, and the address is {address}")
        self.address = address
        self.tls = _context(ca_file) if address.tls else None
        self._key = key

    def __repr__(self) -> str:
        return f"Server({self.address})"

    def headers(self) -> dict[str, str]:
        """Return what each request carries."""
        return {"Authorization": f"Bearer {self._key}"} if self._key else {}

    def without_key(self, text: str) -> str:
        """Return what somebody else wrote as one line that may be shown."""
        line = "".join(letter if letter.isprintable() else " " for letter in text)
        return (line.replace(self._key, "...") if self._key else line)[:_SHOWN]


_SHOWN = 400
"""Chosen: in characters; a refusal of a manager is about half of it."""


def _context(ca_file: Path | None) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=ca_file)
    except OSError as error:  # ssl.SSLError is one
        why = error.strerror if not isinstance(error, ssl.SSLError) else "it holds no certificate in PEM form"
        raise BadAddress(f"the CA file {ca_file} cannot be used: {why}") from error
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


@dataclass(frozen=True)
class Reply:
    """A whole answer, whatever it says."""

    status: int
    kind: str
    """Its content type, without parameters."""
    body: bytes


class Incoming:
    """An answer whose body is still to come."""

    def __init__(self, response: http.client.HTTPResponse, wire: _Wire) -> None:
        self._response = response
        self._wire = wire
        self.status = response.status
        self.kind = response.headers.get_content_type()

    def more(self, within_s: float) -> bytes:
        """Return the next piece as soon as there is one; empty at the end. Raises NoAnswer."""
        try:
            self._wire.limit(time.monotonic() + within_s)
            return self._response.read1(_PIECE)
        except (http.client.HTTPException, OSError, ValueError) as error:
            raise NoAnswer(why(error)) from error

    def close(self) -> None:
        """Let go of what did not come yet."""
        self._response.close()

    def whole(self) -> bytes:
        """Return the body within the time limit of its request. Raises OSError and http.client's errors."""
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
    """One connection, kept open between requests. One thread asks; any thread may `cut` it, for good."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._wire = _Wire(server)

    def cut(self) -> None:
        """End what goes on, and refuse everything after it."""
        self._wire.cut()

    def close(self) -> None:
        """Let go of the connection; called by the thread that asks."""
        self._wire.close()

    def ask(self, method: str, path: str, body: Mapping[str, object] | None = None, *, within_s: float) -> Reply:
        """Send a request that does no harm twice, and return what came back. Raises NoAnswer.

        A server may close an idle connection at the moment at which the request leaves: where a connection that had served before
        ends without a byte of an answer, the request goes out once more on a fresh one. In no other case.
        """
        ends_at = time.monotonic() + within_s
        try:
            return self._asked(method, path, body, ends_at)
        except _Stale:
            return self._asked(method, path, body, ends_at)

    def open(self, path: str, kind: str, *, within_s: float) -> Incoming:
        """Ask for what is sent bit by bit, on a connection of its own. Raises NoAnswer."""
        self._wire.close()
        return self._sent("GET", path, None, {"Accept": kind, "Cache-Control": "no-store"}, time.monotonic() + within_s)

    def _asked(self, method: str, path: str, body: Mapping[str, object] | None, ends_at: float) -> Reply:
        headers = {"Accept": "application/json, application/problem+json"}
        try:
            with closing(self._sent(method, path, body, headers, ends_at)) as coming:
                return Reply(coming.status, coming.kind, coming.whole())
        except (http.client.HTTPException, OSError, ValueError) as error:
            self._wire.close()
            raise NoAnswer(why(error)) from error

    def _sent(
        self, method: str, path: str, body: Mapping[str, object] | None, headers: dict[str, str], ends_at: float
    ) -> Incoming:
        has_served = self._wire.is_idle()
        sent = None if body is None else json.dumps(body).encode()
        if sent is not None:
            headers["Content-Type"] = "application/json"
        try:
            self._wire.limit(ends_at)
            self._wire.request(method, self._server.address.prefix + path, sent, {**headers, **self._server.headers()})
            return Incoming(self._wire.getresponse(), self._wire)
        except (http.client.HTTPException, OSError, ValueError) as error:
            is_stale = has_served and not self._wire.has_heard and isinstance(error, _CLOSED)
            self._wire.close()
            raise (_Stale if is_stale else NoAnswer)(why(error)) from error


_CLOSED = (ConnectionError, ssl.SSLEOFError, ssl.SSLZeroReturnError)
_CERTIFICATE = "its certificate is not trusted here ({}); give the file of the CA that signed it"


def why(error: Exception) -> str:
    """Return in words why there was no answer. Nothing that came over the network is in it."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return _CERTIFICATE.format(error.verify_message)
    if isinstance(error, socket.gaierror | UnicodeError):
        return "its name is not known to this computer"
    if isinstance(error, OSError) and error.strerror and not isinstance(error, tuple(kind for kind, _ in _WORDS)):
        return error.strerror
    return next((words for kind, words in _WORDS if isinstance(error, kind)), "what answers there does not speak HTTP")


_WORDS: tuple[tuple[type[Exception], str], ...] = (
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
    """`http.client` over a socket with a time limit."""

    def __init__(self, server: Server) -> None:
        address = server.address
        super().__init__(address.host, address.port)
        self.default_port = 443 if address.tls else 80
        self._tls = server.tls
        self._ends_at = 0.0
        self._guard = threading.Lock()
        self._open: socket.socket | None = None
        self._is_cut = False
        self.has_heard = False
        """Whether a byte came since the last `limit`."""

    def limit(self, ends_at: float) -> None:
        """Let what follows end at this monotonic time."""
        self._ends_at = ends_at
        self.has_heard = False

    def left_s(self) -> float:
        """Return what is left of the limit. Raises TimeoutError once nothing is."""
        left = self._ends_at - time.monotonic()
        if left <= 0:
            raise TimeoutError
        return left

    def cut(self) -> None:
        """Wake whoever reads, writes or connects. Any thread may."""
        with self._guard:
            self._is_cut = True
            if self._open is not None:
                _shut(self._open)

    def connect(self) -> None:
        """Connect within the limit, to whichever of its addresses answers; only for looking up a name the system has a limit of its own."""
        sock = self._connected()
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._tls is not None:
                sock = self._tls.wrap_socket(sock, server_hostname=self.host, do_handshake_on_connect=False)
                self._use(sock)
                sock.settimeout(self.left_s())
                sock.do_handshake()
        except BaseException:
            sock.close()
            raise
        self.sock = _Limited(sock, self)

    def is_idle(self) -> bool:
        """Whether there is a connection that may be used again; one that its server has closed is let go of."""
        if self.sock is None:
            return False
        looking = select.poll()
        looking.register(self.sock, select.POLLIN)
        # nothing is due between two answers, so what can be read is the end of the connection
        if looking.poll(0):
            self.close()
        return self.sock is not None

    def _connected(self) -> socket.socket:
        found = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        failure: OSError | None = None
        for number, (family, kind, protocol, _, address) in enumerate(found):
            sock = socket.socket(family, kind, protocol)
            try:
                self._use(sock)
                # one address that swallows everything leaves time for the next
                sock.settimeout(self.left_s() / (len(found) - number))
                sock.connect(address)
                return sock
            except OSError as error:
                sock.close()
                failure = error
        raise failure or OSError("its name leads nowhere")

    def _use(self, sock: socket.socket) -> None:
        with self._guard:
            if self._is_cut:
                raise ConnectionAbortedError
            self._open = sock


def _shut(sock: socket.socket) -> None:
    try:
        # that of a TLS socket lets go of what its reader is using
        socket.socket.shutdown(sock, socket.SHUT_RDWR)
    except OSError:
        # not connected any more, which is what was wanted
        return


class _Limited:
    """What of a socket `http.client` uses."""

    def __init__(self, sock: socket.socket, wire: _Wire) -> None:
        self._sock = sock
        self._wire = wire

    def fileno(self) -> int:
        return self._sock.fileno()

    def sendall(self, data: bytes) -> None:
        self._sock.settimeout(self._wire.left_s())
        self._sock.sendall(data)

    def makefile(self, mode: str) -> io.BufferedReader:
        return io.BufferedReader(_Reader(self._sock, self._wire))

    def close(self) -> None:
        self._sock.close()


class _Reader(io.RawIOBase):
    """Reads within the limit. It keeps the socket open, as `http.client` expects, until it is closed."""

    def __init__(self, sock: socket.socket, wire: _Wire) -> None:
        self._sock = sock
        self._raw = sock.makefile("rb", buffering=0)
        self._wire = wire

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int | None:  # type: ignore[override]
        self._sock.settimeout(self._wire.left_s())
        count = self._raw.readinto(buffer)
        self._wire.has_heard = self._wire.has_heard or bool(count)
        return count

    def close(self) -> None:
        self._raw.close()
        super().close()
