"""What is wrong with the certificates and keys that a site file names, and what a person should know about them."""

from __future__ import annotations

import errno
import os
import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import SECURE_PORT, Site

SOON = timedelta(days=30)
"""Chosen: whoever renews certificates by hand wants a month for it."""
ROLE = x509.ObjectIdentifier("1.3.6.1.4.1.50316.802.1")
"""The role in a certificate, one UTF8String: Modbus/TCP Security, R-21, R-22 and R-65."""
_PEM_ADVICE = "a file in PEM form has lines with BEGIN and END; `openssl` turns other forms into it"


@dataclass(frozen=True, slots=True)
class _Pair:
    """What one side shows, where the site file says so."""

    key: Key
    owner: str
    certificate: Path
    private: Path
    believed: Path | None
    believed_as: str


def path_of(folder: Path, file: str) -> Path:
    """Where a file of the site is; `folder` is that of the site file."""
    return (folder / Path(file).expanduser()).resolve()


def tls_problems(site: Site, folder: Path) -> list[Problem]:
    """Return every reason for which a file cannot be used."""
    problems: list[Problem] = []
    for pair in _pairs(site, folder):
        found: list[Problem] = []
        for word, path, judge in (
            ("certificate", pair.certificate, _certificate_fault),
            ("key", pair.private, _key_fault),
            (pair.believed_as, pair.believed, _certificate_fault),
        ):
            if path is not None and (fault := judge(path)) is not None:
                found.append(Problem((*pair.key, word), f"{path} {fault}"))
        if not found and (fault := _pair_fault(pair)) is not None:
            found.append(Problem((*pair.key, "key"), fault))
        problems += found
    return problems


def tls_cautions(site: Site, folder: Path, now: datetime | None = None) -> Iterator[str]:
    """Yield what a person should know about files that can be used: what expires, and what others can read."""
    now = now or datetime.now(UTC)
    for name, controller in site.controllers.items():
        if controller.tls is None and controller.port == SECURE_PORT:
            yield f"{name}: port {SECURE_PORT} is that of Modbus/TCP Security, but there is no `tls`: a controller that speaks it there hangs up"
    for pair in _pairs(site, folder):
        for path in (pair.certificate, pair.believed):
            for certificate in () if path is None else _certificates(path):
                if (told := _time_left(certificate, now)) is not None:
                    yield f"{pair.owner}: certificate {path} {told}"
        if _read_by_others(pair.private):
            yield f"{pair.owner}: everybody on this computer can read the key {pair.private}; `chmod 600` mends it"


def tls_lines(site: Site, folder: Path) -> Iterator[str]:
    """Yield what each certificate of ours says, a line each."""
    for pair in _pairs(site, folder):
        for certificate in _certificates(pair.certificate)[:1]:
            until = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
            if pair.key[0] == "api":
                names = ", ".join(_names(certificate)) or "nothing"
                yield f"{pair.owner}: HTTPS, certificate for {names}, until {until}"
                continue
            role = _role(certificate)
            who = "without a role" if role is None else f"as {role!r}"
            yield f"{pair.owner}: Modbus/TCP Security, {who}, certificate until {until}"


def _pairs(site: Site, folder: Path) -> Iterator[_Pair]:
    if (api := site.api.tls) is not None:
        believed = None if api.client_ca is None else path_of(folder, api.client_ca)
        mine, key = path_of(folder, api.certificate), path_of(folder, api.key)
        yield _Pair(("api", "tls"), "api", mine, key, believed, "client_ca")
    for name, controller in site.controllers.items():
        if (link := controller.tls) is not None:
            mine, key = path_of(folder, link.certificate), path_of(folder, link.key)
            yield _Pair(("controllers", name, "tls"), name, mine, key, path_of(folder, link.ca), "ca")


def _unreadable(path: Path) -> str | None:
    try:
        _content(path)
    except FileNotFoundError:
        return "is not there; paths are relative to the site file"
    except PermissionError:
        return "may not be read by the user that runs this; give the file to that user"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return None


def _content(path: Path) -> bytes:
    """Raises OSError; also for a pipe or a device, which may have no end."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "it is no file, but a pipe or a device")
    return path.read_bytes()


def _certificate_fault(path: Path) -> str | None:
    if (fault := _unreadable(path)) is not None:
        return fault
    return None if _certificates(path) else f"holds no certificate that can be read; {_PEM_ADVICE}"


def _key_fault(path: Path) -> str | None:
    if (fault := _unreadable(path)) is not None:
        return fault
    try:
        serialization.load_pem_private_key(_content(path), None)
    except TypeError:
        return "is protected by a passphrase, and nobody is there to type it: store it without one, readable for the manager alone"
    except (ValueError, UnsupportedAlgorithm):
        # what the library says of it is left out: it is about the content of a key
        return f"holds no private key that can be read; {_PEM_ADVICE}"
    return None


def _pair_fault(pair: _Pair) -> str | None:
    """Try a pair of files, each of which is well by itself, as TLS will."""
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(pair.certificate, pair.private)
        if pair.believed is not None:
            context.load_verify_locations(pair.believed)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            return f"{pair.private} does not belong to the certificate {pair.certificate}: it is the key of another one"
        why = (error.reason or "no reason told").replace("_", " ").lower()
        return f"{pair.certificate} and {pair.private} are refused by TLS: {why}"
    return None


def _certificates(path: Path) -> list[x509.Certificate]:
    """Those in a file; none where it cannot be read."""
    try:
        return x509.load_pem_x509_certificates(_content(path))
    except (OSError, ValueError):
        return []


def _time_left(certificate: x509.Certificate, now: datetime) -> str | None:
    until, since = certificate.not_valid_after_utc, certificate.not_valid_before_utc
    if now > until:
        return f"has expired on {until:%Y-%m-%d}, and whoever it is shown to will refuse it; renew it"
    if now < since:
        return f"is not valid before {since:%Y-%m-%d %H:%M} UTC; look whether the clock of this computer is right"
    if until - now < SOON:
        return f"expires on {until:%Y-%m-%d}, in {(until - now).days} days; renew it before that"
    return None


def _read_by_others(path: Path) -> bool:
    try:
        return os.name == "posix" and bool(path.stat().st_mode & 0o007)
    except OSError:
        return False


def _names(certificate: x509.Certificate) -> list[str]:
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    addresses = [str(address) for address in found.get_values_for_type(x509.IPAddress)]
    return [*found.get_values_for_type(x509.DNSName), *addresses]


def _role(certificate: x509.Certificate) -> str | None:
    """The role that a controller reads, or None for a certificate without one or with one that is no UTF8String."""
    try:
        extension = certificate.extensions.get_extension_for_oid(ROLE).value
    except x509.ExtensionNotFound:
        return None
    if not isinstance(extension, x509.UnrecognizedExtension):
        return None
    # DER: tag, length (short form), text
    tag_and_length, text = extension.value[:2], extension.value[2:]
    if tag_and_length != bytes((0x0C, len(text))) or len(text) > 0x7F:
        return None
    return text.decode("utf-8", "replace")
