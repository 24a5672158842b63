"""HTTPS: the server certificate, client certificates, and renewal of the files while the manager runs."""

from __future__ import annotations

import logging
import ssl
from dataclasses import dataclass
from pathlib import Path

from lift_manager.plain.file_stamp import FileStamp, file_stamp
from lift_manager.web.errors import ListenError

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ServerTls:
    """Files in PEM form."""

    certificate: Path
    key: Path
    client_ca: Path | None = None
    """If set, every client must present a certificate of this CA."""


class ServerCertificates:
    """The TLS settings for new connections, as of the last check of the files."""

    def __init__(self, files: ServerTls) -> None:
        """Read the files. Raises ListenError."""
        self._files = files
        self._read_stamp = _file_stamp(files)
        try:
            self._latest = _load_context(files)
        except (OSError, ValueError) as error:
            raise ListenError(f"api.tls: {files.certificate} cannot be used with {files.key} ({error})") from error

    def next_context(self) -> ssl.SSLContext:
        """Return the TLS context of the next connection, version 1.2 or later. Does not access files.

        With client certificates, TLS sessions are never resumed: resumption does not check the certificate, and would admit a
        client whose CA was removed from the file, or whose certificate has expired.
        """
        if self._files.client_ca is None:
            return self._latest
        # The TLS session cache belongs to the context of a connection, so a context per connection disables it.
        # Python cannot switch off the cache of TLS 1.2.
        context = _new_context(verify=True)
        context.options |= ssl.OP_NO_TICKET
        context.num_tickets = 0
        context.sni_callback = self._use_latest
        return context

    def renew(self) -> None:
        """Reload the files if they have changed, for the next connection. Blocks as long as the disk does."""
        stamp = _file_stamp(self._files)
        if stamp == self._read_stamp:
            return
        try:
            self._latest = _load_context(self._files)
        except (OSError, ValueError) as error:
            message = "api: the renewed certificate %s cannot be used yet, the previous one stays in use: %s"
            _log.warning(message, self._files.certificate, error)
        else:
            _log.info("api: certificate %s was renewed, and is used from now on", self._files.certificate)
        self._read_stamp = stamp

    def _use_latest(self, connection: ssl.SSLObject, name: str | None, context: ssl.SSLContext) -> None:
        """Switch to the latest certificate; OpenSSL calls this for every client, with or without a name."""
        connection.context = self._latest


def _new_context(*, verify: bool) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_alpn_protocols(["http/1.1"])
    if verify:
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def _load_context(files: ServerTls) -> ssl.SSLContext:
    # always a new context: loading into the one in use would leave it with a certificate that does not match its key
    context = _new_context(verify=files.client_ca is not None)
    context.load_cert_chain(files.certificate, files.key, password=_no_passphrase)
    if files.client_ca is not None:
        context.load_verify_locations(files.client_ca)
    return context


def _file_stamp(files: ServerTls) -> FileStamp:
    paths = (files.certificate, files.key, files.client_ca)
    return file_stamp(path for path in paths if path is not None)


def _no_passphrase() -> str:
    # without this OpenSSL would prompt at the terminal, and the manager would hang
    raise ValueError("the key is protected by a passphrase; store it without one, readable for the manager alone")
