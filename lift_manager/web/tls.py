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


def server_context(files: ServerTls) -> ssl.SSLContext:
    """TLS 1.2 or later; files that were renewed are taken for the next connection. Raises ListenError."""
    return _Renewing(files).outer


class _Renewing:
    """The context of the files as they are now.

    A new context each time, put in when a client says hello: loading a certificate into the one in use would leave it
    without a key while only one of the two files is there.
    """

    def __init__(self, files: ServerTls) -> None:
        self._files = files
        self._stamp = _stamp(files)
        try:
            self.outer = self._latest = _context(files)
        except (OSError, ValueError) as error:
            raise ListenError(f"api.tls: {files.certificate} cannot be used with {files.key} ({error})") from error
        self.outer.sni_callback = self._renew

    def _renew(self, connection: ssl.SSLObject, name: str | None, outer: ssl.SSLContext) -> None:
        """Called for every client, whether it says a name or not."""
        stamp = _stamp(self._files)
        if stamp != self._stamp:
            self._stamp = stamp
            try:
                self._latest = _context(self._files)
            except (OSError, ValueError) as error:
                message = "api: the renewed certificate %s cannot be used yet, the last one is shown on: %s"
                _log.warning(message, self._files.certificate, error)
            else:
                _log.info("api: certificate %s was renewed, and is shown from here on", self._files.certificate)
        connection.context = self._latest


def _context(files: ServerTls) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_alpn_protocols(["http/1.1"])
    context.load_cert_chain(files.certificate, files.key, password=_no_passphrase)
    if files.client_ca is not None:
        context.verify_mode = ssl.CERT_REQUIRED
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
