"""Modbus/TCP Security on our side of a link: which certificates it trusts and presents, and what a failure means."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from drivers.errors import ConnectFailed, ConnectProblem
from drivers.thread import in_thread

_log = logging.getLogger(__name__)
_SHOWN_ON = "%s; the last certificate and key that could be used are shown on"


NO_TLS = "what answers on this port speaks no TLS; a controller without Modbus/TCP Security needs no `tls` (its port is 502 as a rule)"
_ENDED_HANDSHAKE = "the controller ended the connection in the middle of the TLS handshake; it may speak no TLS on this port, or refuse our certificate"
_IS_TLS = "it answers in TLS; to speak Modbus/TCP Security give this controller `tls` in the site file, or take its port without TLS"
_TLS_RECORDS = (b"\x15\x03", b"\x16\x03")
"""An alert or a handshake, of any version since 1.0."""

_NO_TLS_REASONS = {
    "WRONG_VERSION_NUMBER", "HTTP_REQUEST", "HTTPS_PROXY_REQUEST", "UNKNOWN_PROTOCOL", "PACKET_LENGTH_TOO_LONG",
    "RECORD_LAYER_FAILURE", "BAD_RECORD_TYPE",
}  # fmt: skip
_REFUSED_REASONS = {
    "TLSV13_ALERT_CERTIFICATE_REQUIRED": "it received none that it can use",
    "TLSV1_ALERT_UNKNOWN_CA": "it does not know the CA of it; load that CA into the controller",
    "SSLV3_ALERT_BAD_CERTIFICATE": "it reports it as bad",
    "SSLV3_ALERT_UNSUPPORTED_CERTIFICATE": "it does not support this kind",
    "SSLV3_ALERT_CERTIFICATE_REVOKED": "it is revoked",
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": "it has expired, or the clock of the controller is wrong",
    "SSLV3_ALERT_CERTIFICATE_UNKNOWN": "it does not accept it",
    "TLSV1_ALERT_ACCESS_DENIED": "it is valid, but has no access",
    "TLSV1_ALERT_DECRYPT_ERROR": "it could not check its signature",
}
_TOO_OLD_REASONS = {"TLSV1_ALERT_PROTOCOL_VERSION", "UNSUPPORTED_PROTOCOL", "NO_PROTOCOLS_AVAILABLE", "VERSION_TOO_LOW"}
_NOTHING_SHARED_REASONS = {"SSLV3_ALERT_HANDSHAKE_FAILURE", "NO_SHARED_CIPHER", "TLSV1_ALERT_INSUFFICIENT_SECURITY"}

# X509_V_ERR_*, from openssl/x509_vfy.h
_UNKNOWN_ISSUER_CODES = {2, 18, 19, 20, 21}
_NOT_YET_VALID_CODE = 9
_EXPIRED_CODE = 10
_PURPOSE_CODE = 26
_OTHER_NAME_CODES = {62, 64}


class ClientContext(ssl.SSLContext):
    """The TLS context of one link, for one connection at a time; reports when the handshake starts, after the TCP connection."""

    handshake_s = 0.0
    on_handshake: Callable[[], None] | None = None
    began = False
    """Whether the handshake has begun."""

    def wrap_bio(
        self,
        incoming: ssl.MemoryBIO,
        outgoing: ssl.MemoryBIO,
        server_side: bool = False,  # noqa: FBT001, FBT002 - Python's own signature
        server_hostname: str | bytes | None = None,
        session: ssl.SSLSession | None = None,
    ) -> ssl.SSLObject:
        self.began = True
        if self.on_handshake is not None:
            self.on_handshake()
        return super().wrap_bio(incoming, outgoing, server_side, server_hostname, session)


@dataclass(slots=True)
class LatestContext:
    """The context from the files when they were last usable; cached because reading them takes milliseconds."""

    context: ClientContext | None = None
    stamp: tuple[tuple[int, int, int], ...] = ()
    """State of the files before they were read."""
    fault: ConnectFailed | None = None
    """Why the present files cannot be used."""
    pending_read: asyncio.Future[None] | None = None
    """The reading of the files: one at a time, because a disk that hangs keeps its thread."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkTls:
    """Mutual TLS of one link, as Modbus/TCP Security requires: files in PEM form.

    They are read for the first connection, and again when one of them has changed; never on the event loop.
    """

    ca: Path
    """What we trust: the CA of the controller's certificate, or that certificate itself."""
    certificate: Path
    """What we present."""
    key: Path
    server_name: str | None = None
    """The name or address that the controller's certificate must be for; by default that of the host."""
    handshake_s: float = 5.0
    """Longest duration of the handshake, after the TCP connection. Chosen: its arithmetic takes a small controller a second or two."""
    files_s: float = 1.0
    """Longest time for reading the files. Chosen: a disk needs milliseconds; a slower one may never answer, and a link tries again
    every second."""
    latest: LatestContext = field(default_factory=LatestContext, init=False, repr=False, compare=False)


async def client_context(tls: LinkTls, peer: str) -> ClientContext:
    """Return the context for the next connection. Raises ConnectFailed if the files cannot be used.

    While the present files cannot be used or read, the context of the last usable ones remains in use.
    """
    latest = tls.latest
    if latest.pending_read is None or latest.pending_read.done():
        latest.pending_read = asyncio.ensure_future(in_thread(partial(_refresh_context, tls, peer)))
    await asyncio.wait([latest.pending_read], timeout=tls.files_s)
    if not latest.pending_read.done():
        _report_hanging_disk(tls, peer)
    elif (busy := latest.pending_read.exception()) is not None:
        latest.fault = ConnectFailed(peer, ConnectProblem.OTHER, f"cannot read the files of `tls`: {busy}")
    if latest.context is None:
        raise latest.fault or ConnectFailed(peer, ConnectProblem.TLS, "the files of `tls` were not read")
    latest.context.began, latest.context.on_handshake = False, None
    return latest.context


def explain_handshake_failure(error: OSError, tls: LinkTls) -> str:
    """Return what a failed handshake means, and what to do about it."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return _explain_distrust(error, tls)
    if not isinstance(error, ssl.SSLError):
        return _ENDED_HANDSHAKE
    if (words := explain_refusal(error, tls)) is not None:
        return words
    reason = error.reason or ""
    if reason in _NO_TLS_REASONS:
        return NO_TLS
    if reason in _TOO_OLD_REASONS:
        return "the controller does not speak TLS 1.2 or later, which is required for safety and by the specification"
    if reason in _NOTHING_SHARED_REASONS:
        return "the controller and the manager have no cipher in common, or it requires another certificate than ours"
    if isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):
        return _ENDED_HANDSHAKE
    return _explain_failure(error)


def explain_refusal(error: Exception | None, tls: LinkTls) -> str | None:
    """Return why the controller refuses our certificate, in the handshake or, over TLS 1.3, after it; None if it does not."""
    reason = error.reason if isinstance(error, ssl.SSLError) else None
    if reason not in _REFUSED_REASONS:
        return None
    return f"the controller refuses our certificate {tls.certificate}: {_REFUSED_REASONS[reason]}"


def explain_break(error: Exception) -> str:
    """Return what ended a connection after its handshake."""
    return _explain_failure(error) if isinstance(error, ssl.SSLError) else str(error)


def explain_silence(tls: LinkTls) -> str:
    """Return a possible cause of a connection that ended before the first answer."""
    return f"it may refuse our certificate {tls.certificate}; over TLS 1.3 this shows only now"


def explain_tls_data(data: bytes) -> str | None:
    """Return an explanation if data that is not Modbus/TCP is TLS."""
    return _IS_TLS if data.startswith(_TLS_RECORDS) else None


def _explain_failure(error: ssl.SSLError) -> str:
    return f"TLS failed ({(error.reason or '').replace('_', ' ').lower() or error})"


def _explain_distrust(error: ssl.SSLCertVerificationError, tls: LinkTls) -> str:
    code = error.verify_code
    if code in _OTHER_NAME_CODES:
        which = "its `host`" if tls.server_name is None else "`server_name`"
        advice = f"{which} in the site file must be a name or address that the certificate holds"
        if tls.server_name is None:
            advice += ", or set `server_name` to one"
        return f"the certificate of the controller is for another name ({error.verify_message}); {advice}"
    if code == _EXPIRED_CODE:
        return "the certificate of the controller, or of its CA, has expired; renew it, and check the clock of this computer"
    if code == _NOT_YET_VALID_CODE:
        return "the certificate of the controller is not valid yet; check the clock of this computer"
    if code in _UNKNOWN_ISSUER_CODES:
        return f"the certificate of the controller is not from the CA in {tls.ca}; nothing was sent to it"
    if code == _PURPOSE_CODE:
        return "the certificate of the controller is not meant for a server (extended key usage); it needs another one"
    return f"the certificate of the controller is not accepted: {error.verify_message}"


def _files_error(peer: str, what: str, error: OSError | ValueError) -> ConnectFailed:
    if isinstance(error, ssl.SSLError):
        mismatch = error.reason == "KEY_VALUES_MISMATCH"
        why = "the key does not belong to the certificate" if mismatch else "the file is not in PEM form, or too weak"
    else:
        why = error.strerror or str(error) if isinstance(error, OSError) else str(error)
    advice = "`lift-manager check` says more"
    return ConnectFailed(peer, ConnectProblem.TLS, f"cannot use {what}: {why}; {advice}")


def _no_passphrase() -> str:
    # without this OpenSSL would prompt at the terminal and block the manager
    raise ValueError("the key is protected by a passphrase; store it without one, readable by the manager alone")


def _load_context(tls: LinkTls, peer: str) -> ClientContext:
    context = ClientContext(ssl.PROTOCOL_TLS_CLIENT)
    context.handshake_s = tls.handshake_s
    context.minimum_version = ssl.TLSVersion.TLSv1_2  # required by the specification
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN  # `ca` may be the controller's certificate itself
    try:
        context.load_verify_locations(tls.ca)
    except OSError as error:
        raise _files_error(peer, f"the CA file {tls.ca}", error) from error
    try:
        context.load_cert_chain(tls.certificate, tls.key, password=_no_passphrase)
    except (OSError, ValueError) as error:
        files = f"our certificate {tls.certificate} with its key {tls.key}"
        raise _files_error(peer, files, error) from error
    return context


def _report_hanging_disk(tls: LinkTls, peer: str) -> None:
    what = f"{tls.ca}, {tls.certificate} or {tls.key} does not answer within {tls.files_s:g} s; check the disk that it is on"
    fault = ConnectFailed(peer, ConnectProblem.TLS, what)
    if tls.latest.context is not None and str(tls.latest.fault) != str(fault):
        _log.warning(_SHOWN_ON, fault)
    tls.latest.fault = fault


def _refresh_context(tls: LinkTls, peer: str) -> None:
    """Read the files if one of them has changed. Blocks as long as their disk does."""
    latest, stamp = tls.latest, _stamp(tls)
    if latest.context is not None and stamp == latest.stamp:
        return
    try:
        latest.context, latest.fault = _load_context(tls, peer), None
    except ConnectFailed as fault:
        latest.fault = fault
        if latest.context is not None:
            _log.warning(_SHOWN_ON, fault)
    latest.stamp = stamp


def _stamp(tls: LinkTls) -> tuple[tuple[int, int, int], ...]:
    """Return a value that changes when one of the files does."""
    found = []
    for path in (tls.ca, tls.certificate, tls.key):
        try:
            status = path.stat()
        except OSError:
            found.append((0, 0, 0))  # reading it says why
        else:
            found.append((status.st_mtime_ns, status.st_size, status.st_ino))
    return tuple(found)
