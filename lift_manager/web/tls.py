"""HTTPS: the certificate that is shown, whose clients are heard, and the files' renewal while the manager runs."""

from __future__ import annotations

import logging
import ssl
from dataclasses import dataclass
from pathlib import Path

from lift_manager.web.errors import ListenError

_log = logging.getLogger(__name__)

_Stamp = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, slots=True)
class ServerTls:
    """Files in PEM form."""

    certificate: Path
    key: Path
    client_ca: Path | None = None
    """Then every client must show a certificate of this CA."""


class ServerCertificates:
    """What is shown to clients and asked of them: what the files said when they were last looked at."""

    def __init__(self, files: ServerTls) -> None:
        """Read the files. Raises ListenError."""
        self._files = files
        self._stamp = _stamp(files)
        try:
            self._latest = _read(files)
        except (OSError, ValueError) as error:
            raise ListenError(f"api.tls: {files.certificate} cannot be used with {files.key} ({error})") from error

    def next_context(self) -> ssl.SSLContext:
        """Return the TLS of the next connection, of version 1.2 or later. Touches no file.

        Where clients have to show certificates, no session is ever resumed: that asks for no certificate, and would let in a client
        whose CA has gone from the file, or whose certificate has expired.
        """
        if self._files.client_ca is None:
            return self._latest
        # What TLS remembers of sessions belongs to the context with which a connection began: here that ends with it.
        # Python cannot switch the memory of TLS 1.2 off.
        own = _empty(verify=True)
        own.options |= ssl.OP_NO_TICKET
        own.num_tickets = 0
        own.sni_callback = self._show
        return own

    def renew(self) -> None:
        """Look at the files, and take what changed for the next connection. It may block as long as their disk does."""
        stamp = _stamp(self._files)
        if stamp == self._stamp:
            return
        try:
            self._latest = _read(self._files)
        except (OSError, ValueError) as error:
            message = "api: the renewed certificate %s cannot be used yet, the last one is shown on: %s"
            _log.warning(message, self._files.certificate, error)
        else:
            _log.info("api: certificate %s was renewed, and is shown from here on", self._files.certificate)
        self._stamp = stamp

    def _show(self, connection: ssl.SSLObject, name: str | None, own: ssl.SSLContext) -> None:
        """Called for every client, whether it says a name or not."""
        connection.context = self._latest


def _empty(*, verify: bool) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_alpn_protocols(["http/1.1"])
    if verify:
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def _read(files: ServerTls) -> ssl.SSLContext:
    # a new one each time: loading a certificate into the one in use would leave it without a key between two files
    context = _empty(verify=files.client_ca is not None)
    context.load_cert_chain(files.certificate, files.key, password=_no_passphrase)
    if files.client_ca is not None:
        context.load_verify_locations(files.client_ca)
    return context


def _stamp(files: ServerTls) -> _Stamp:
    """What changes when one of the files does."""
    found = []
    for path in (files.certificate, files.key, files.client_ca):
        try:
            seen = None if path is None else path.stat()
        except OSError:
            seen = None
        found.append((0, 0, 0) if seen is None else (seen.st_mtime_ns, seen.st_size, seen.st_ino))
    return tuple(found)


def _no_passphrase() -> str:
    # without this OpenSSL would ask at the terminal, and the manager would stand still
    raise ValueError("the key is protected by a passphrase; store it without one, readable for the manager alone")
