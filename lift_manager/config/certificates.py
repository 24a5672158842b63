"""What is in the files of certificates and keys.

`tls` imports it only for a site that names such files: the library behind it takes 3 MB.
"""

from __future__ import annotations

import errno
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization

EXPIRY_WARNING = timedelta(days=30)
"""Chosen: a person who renews certificates by hand needs a month for it."""
ROLE = x509.ObjectIdentifier("1.3.6.1.4.1.50316.802.1")
"""The role in a certificate, one UTF8String: Modbus/TCP Security, R-21, R-22 and R-65."""
_PEM_ADVICE = "a file in PEM form has lines with BEGIN and END; `openssl` turns other forms into it"


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


def certificate_problem(path: Path) -> str | None:
    """Return why a file is no certificate that can be used."""
    if (problem := _read_problem(path)) is not None:
        return problem
    return None if certificates_in(path) else f"holds no certificate that can be read; {_PEM_ADVICE}"


def key_problem(path: Path) -> str | None:
    """Return why a file is no private key that can be used."""
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


def certificates_in(path: Path) -> list[x509.Certificate]:
    """Return the certificates in a file; none if it cannot be read."""
    try:
        return x509.load_pem_x509_certificates(_read_file(path))
    except (OSError, ValueError):
        return []


def expiry_text(certificate: x509.Certificate, now: datetime) -> str | None:
    """Return what a person should know about the validity of a certificate."""
    until, since = certificate.not_valid_after_utc, certificate.not_valid_before_utc
    if now > until:
        return f"has expired on {until:%Y-%m-%d}, and others will refuse it; renew it"
    if now < since:
        return f"is not valid before {since:%Y-%m-%d %H:%M} UTC; check the clock of this computer"
    if until - now < EXPIRY_WARNING:
        return f"expires on {until:%Y-%m-%d}, in {(until - now).days} days; renew it before that"
    return None


def subject_names(certificate: x509.Certificate) -> list[str]:
    """Return the host names and addresses that a certificate is for."""
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    addresses = [str(address) for address in found.get_values_for_type(x509.IPAddress)]
    return [*found.get_values_for_type(x509.DNSName), *addresses]


def role(certificate: x509.Certificate) -> str | None:
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
