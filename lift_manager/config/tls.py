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

EXPIRY_WARNING = timedelta(days=30)
"""Chosen: a person who renews certificates by hand needs a month for it."""
ROLE = x509.ObjectIdentifier("1.3.6.1.4.1.50316.802.1")
"""The role in a certificate, one UTF8String: Modbus/TCP Security, R-21, R-22 and R-65."""
_PEM_ADVICE = "a file in PEM form has lines with BEGIN and END; `openssl` turns other forms into it"


@dataclass(frozen=True, slots=True)
class _TlsFiles:
    """The TLS files of one connection, as the site file names them."""

    key: Key
    owner: str
    certificate: Path
    private: Path
    ca: Path | None
    ca_key: str


def path_of(folder: Path, file: str) -> Path:
    """Return the path of a file of the site; `folder` is that of the site file."""
    return (folder / Path(file).expanduser()).resolve()


def tls_problems(site: Site, folder: Path) -> list[Problem]:
    """Return every reason why a file cannot be used."""
    problems: list[Problem] = []
    for pair in _tls_files(site, folder):
        pair_problems: list[Problem] = []
        for field, path, check in (
            ("certificate", pair.certificate, _certificate_problem),
            ("key", pair.private, _key_problem),
            (pair.ca_key, pair.ca, _certificate_problem),
        ):
            if path is not None and (problem := check(path)) is not None:
                pair_problems.append(Problem((*pair.key, field), f"{path} {problem}"))
        if not pair_problems and (problem := _pair_problem(pair)) is not None:
            pair_problems.append(Problem((*pair.key, "key"), problem))
        problems += pair_problems
    return problems


def tls_cautions(site: Site, folder: Path, now: datetime | None = None) -> Iterator[str]:
    """Yield cautions about usable files: what expires, and what other users can read."""
    now = now or datetime.now(UTC)
    for name, controller in site.controllers.items():
        if controller.tls is None and controller.port == SECURE_PORT:
            yield f"{name}: port {SECURE_PORT} is that of Modbus/TCP Security, but there is no `tls`: a controller that speaks it there hangs up"
    for pair in _tls_files(site, folder):
        for path in (pair.certificate, pair.ca):
            for certificate in () if path is None else certificates_in(path):
                if (expiry := _expiry_text(certificate, now)) is not None:
                    yield f"{pair.owner}: certificate {path} {expiry}"
        if _is_world_readable(pair.private):
            yield f"{pair.owner}: everybody on this computer can read the key {pair.private}; `chmod 600` corrects it"


def tls_lines(site: Site, folder: Path) -> Iterator[str]:
    """Yield a line about each certificate of the manager."""
    for pair in _tls_files(site, folder):
        for certificate in certificates_in(pair.certificate)[:1]:
            until = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
            if pair.key[0] == "api":
                names = ", ".join(_subject_names(certificate)) or "nothing"
                yield f"{pair.owner}: HTTPS, certificate for {names}, until {until}"
                continue
            if pair.key[0] == "cluster":
                yield f"{pair.owner}: etcd over TLS, certificate until {until}"
                continue
            role = _role(certificate)
            role_text = "without a role" if role is None else f"as {role!r}"
            yield f"{pair.owner}: Modbus/TCP Security, {role_text}, certificate until {until}"


def _tls_files(site: Site, folder: Path) -> Iterator[_TlsFiles]:
    if (api := site.api.tls) is not None:
        ca = None if api.client_ca is None else path_of(folder, api.client_ca)
        own_certificate, key = path_of(folder, api.certificate), path_of(folder, api.key)
        yield _TlsFiles(("api", "tls"), "api", own_certificate, key, ca, "client_ca")
    if site.cluster is not None and (link_to_etcd := site.cluster.tls) is not None:
        own_certificate, key = path_of(folder, link_to_etcd.certificate), path_of(folder, link_to_etcd.key)
        ca = path_of(folder, link_to_etcd.ca)
        yield _TlsFiles(("cluster", "tls"), "cluster", own_certificate, key, ca, "ca")
    for name, controller in site.controllers.items():
        if (link := controller.tls) is not None:
            own_certificate, key = path_of(folder, link.certificate), path_of(folder, link.key)
            yield _TlsFiles(("controllers", name, "tls"), name, own_certificate, key, path_of(folder, link.ca), "ca")


def _read_problem(path: Path) -> str | None:
    try:
        _read_file(path)
    except FileNotFoundError:
        return "does not exist; paths are relative to the site file"
    except PermissionError:
        return "may not be read by the user that runs this; give the file to that user"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return None


def _read_file(path: Path) -> bytes:
    """Read a file. Raises OSError, also for a pipe or a device, which may be endless."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "it is not a file, but a pipe or a device")
    return path.read_bytes()


def _certificate_problem(path: Path) -> str | None:
    if (problem := _read_problem(path)) is not None:
        return problem
    return None if certificates_in(path) else f"holds no certificate that can be read; {_PEM_ADVICE}"


def _key_problem(path: Path) -> str | None:
    if (problem := _read_problem(path)) is not None:
        return problem
    try:
        serialization.load_pem_private_key(_read_file(path), None)
    except TypeError:
        return "is protected by a passphrase, and nobody is there to type it: store it without one, readable for the manager only"
    except (ValueError, UnsupportedAlgorithm):
        # the text of the library is left out: it may contain parts of a key
        return f"holds no private key that can be read; {_PEM_ADVICE}"
    return None


def _pair_problem(pair: _TlsFiles) -> str | None:
    """Return why TLS refuses a certificate and a key that are each valid."""
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(pair.certificate, pair.private)
        if pair.ca is not None:
            context.load_verify_locations(pair.ca)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            return f"{pair.private} does not belong to the certificate {pair.certificate}: it is the key of another one"
        why = (error.reason or "no reason given").replace("_", " ").lower()
        return f"{pair.certificate} and {pair.private} are refused by TLS: {why}"
    return None


def certificates_in(path: Path) -> list[x509.Certificate]:
    """Return the certificates in a file; none if it cannot be read."""
    try:
        return x509.load_pem_x509_certificates(_read_file(path))
    except (OSError, ValueError):
        return []


def _expiry_text(certificate: x509.Certificate, now: datetime) -> str | None:
    until, since = certificate.not_valid_after_utc, certificate.not_valid_before_utc
    if now > until:
        return f"has expired on {until:%Y-%m-%d}, and others will refuse it; renew it"
    if now < since:
        return f"is not valid before {since:%Y-%m-%d %H:%M} UTC; check the clock of this computer"
    if until - now < EXPIRY_WARNING:
        return f"expires on {until:%Y-%m-%d}, in {(until - now).days} days; renew it before that"
    return None


def _is_world_readable(path: Path) -> bool:
    try:
        return os.name == "posix" and bool(path.stat().st_mode & 0o007)
    except OSError:
        return False


def _subject_names(certificate: x509.Certificate) -> list[str]:
    try:
        pair_problems = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    addresses = [str(address) for address in pair_problems.get_values_for_type(x509.IPAddress)]
    return [*pair_problems.get_values_for_type(x509.DNSName), *addresses]


def _role(certificate: x509.Certificate) -> str | None:
    """Return the role that a controller reads; None for a certificate without a role, or whose role is not a UTF8String."""
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
