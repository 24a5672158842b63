"""The package of a configuration update: the site file and the maps of one site, with a number, signed by a person.

The signature (Ed25519) is over the bytes of the content as they are. The private key stays with the person; a hub only stores and
offers packages, and cannot make one.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)
from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from drivers.own_files import make_own
from lift_manager.api.fields import first_mistake
from lift_manager.config.site import HUB_SITE_ID
from lift_manager.hub.errors import UpdateRefused, file_errors

LARGEST = 8 * 1024 * 1024
"""Bytes of a package. Chosen: a hundred maps, or some minutes of announcements; a leaf node behind a modem takes it in minutes."""
MOST_FILES = 1000
SITE_FILE = "site.yaml"
"""What the site file is called in a package, whatever it was called before."""
ENDING = ".update"
"""How the name of a package ends; it begins with the id of its site."""
_SIGNED = b"lift-manager configuration update\n"
"""Precedes the content in what is signed, so that no other signature of the same key is one of an update."""


def _relative_path(name: str) -> str:
    path = PurePosixPath(name)
    is_hidden = any(part.startswith(".") for part in path.parts)
    if path.is_absolute() or not path.parts or is_hidden or str(path) != name or not name.isprintable():
        raise ValueError("is no path inside a folder")
    return name


FileName = Annotated[str, StringConstraints(min_length=1, max_length=200), AfterValidator(_relative_path)]
Number = Annotated[int, Field(ge=1, lt=2**31)]


class Content(BaseModel):
    """What is signed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["lift-manager configuration update"] = "lift-manager configuration update"
    version: Literal[1] = 1
    site: Annotated[str, StringConstraints(pattern=HUB_SITE_ID)]
    """The id of the site at its hub: no other site takes it."""
    number: Number
    """Of the update; a site takes only one that is higher than every one before."""
    made_by: Annotated[str, StringConstraints(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$")]
    made_at: AwareDatetime
    """For people; nobody compares it."""
    files: Annotated[Mapping[FileName, str], Field(max_length=MOST_FILES)]
    """By name, in base64."""

    @classmethod
    def of(cls, *, files: Mapping[str, bytes], site: str, number: int, made_by: str, made_at: datetime) -> Content:
        """Return the content with these files. Raises UpdateRefused."""
        texts = {name: base64.b64encode(data).decode() for name, data in files.items()}
        try:
            return cls(site=site, number=number, made_by=made_by, made_at=made_at, files=texts)
        except ValidationError as error:
            raise UpdateRefused(f"the update for {site} cannot be made: {first_mistake(error)}") from error

    def unpacked(self) -> dict[str, bytes]:
        """Return the files. Raises UpdateRefused."""
        try:
            return {name: base64.b64decode(text, validate=True) for name, text in self.files.items()}
        except binascii.Error as error:
            raise UpdateRefused(f"update {self.number} for {self.site} is damaged: {error}") from error


@dataclass(frozen=True, slots=True)
class Verified:
    """A content that somebody has signed whom the site trusts."""

    content: Content
    signed_by: str
    """The key: the name of its file, and the beginning of its fingerprint."""


def make_package(content: Content, key: Ed25519PrivateKey) -> bytes:
    """Return a signed package. Raises UpdateRefused if it is too large."""
    if SITE_FILE not in content.files:
        raise UpdateRefused(f"an update needs a {SITE_FILE}")
    body = content.model_dump_json().encode()
    package = base64.b64encode(key.sign(_SIGNED + body)) + b"\n" + body
    if len(package) > LARGEST:
        text = (
            f"the update for {content.site} has {len(package):,} bytes, and {LARGEST:,} are the most; leave files out"
        )
        raise UpdateRefused(text)
    return package


def read_package(package: bytes) -> Content:
    """Return the content of a package that nobody has verified: for a hub, which shows and offers it. Raises UpdateRefused."""
    return _content(_split(package)[1])


def verify(package: bytes, trusted: Mapping[str, Ed25519PublicKey]) -> Verified:
    """Return the content if one of these keys has signed it; the names are those of their files. Raises UpdateRefused."""
    signature, body = _split(package)
    for name, key in trusted.items():
        try:
            key.verify(signature, _SIGNED + body)
        except InvalidSignature:
            continue
        return Verified(_content(body), f"{Path(name).name} ({fingerprint(key)})")
    names = ", ".join(trusted) or "none"
    raise UpdateRefused(f"the update is not signed with a key that this site trusts (`hub: updates`: {names})")


def _split(package: bytes) -> tuple[bytes, bytes]:
    head, line, body = package.partition(b"\n")
    if len(package) > LARGEST or not line or not re.fullmatch(rb"[A-Za-z0-9+/]{86}==", head):
        raise UpdateRefused("this is no configuration update; `lift-manager hub update make` writes one")
    return base64.b64decode(head), body


def _content(body: bytes) -> Content:
    try:
        content = Content.model_validate_json(body)
    except ValidationError as error:
        raise UpdateRefused(
            f"the update cannot be read: {first_mistake(error)}; is it from a newer program?"
        ) from error
    if SITE_FILE not in content.files:
        raise UpdateRefused(f"the update has no {SITE_FILE}")
    return content


# -- keys


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return the beginning of the SHA-256 of a public key, by which people compare it."""
    return hashlib.sha256(key.public_bytes_raw()).hexdigest()[:16]


def write_key(path: Path, passphrase: str = "") -> tuple[Path, str]:
    """Make a key pair in PEM form, the public key beside the private one; returns its path and fingerprint. Raises UpdateRefused."""
    public_path = path.with_suffix(".pub")
    if existing := next((file for file in (path, public_path) if file.exists()), None):
        raise UpdateRefused(f"{existing} is there already, and is not replaced: updates were perhaps signed with it")
    key = Ed25519PrivateKey.generate()
    locked = BestAvailableEncryption(passphrase.encode()) if passphrase else NoEncryption()
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, locked)
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    try:
        with os.fdopen(make_own(path), "wb") as file:
            file.write(private)
        public_path.write_bytes(public)
    except OSError as error:
        raise UpdateRefused(f"{error.filename or path} cannot be written ({error.strerror or error})") from error
    return public_path, fingerprint(key.public_key())


def read_private_key(path: Path, passphrase: Callable[[], str]) -> Ed25519PrivateKey:
    """Return a private key; `passphrase` is called for one that is encrypted. Raises UpdateRefused."""
    data = _read(path)
    try:
        try:
            key = load_pem_private_key(data, None)
        except TypeError:
            key = load_pem_private_key(data, passphrase().encode())
    except ValueError as error:
        raise UpdateRefused(
            f"{path} cannot be used: it is no private key in PEM form, or the passphrase is wrong"
        ) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise UpdateRefused(f"{path} is no Ed25519 key; make one with `lift-manager hub update key`")
    return key


def read_public_key(path: Path) -> Ed25519PublicKey:
    """Return a public key. Raises UpdateRefused."""
    try:
        key = load_pem_public_key(_read(path))
    except ValueError as error:
        raise UpdateRefused(f"{path} is no public key in PEM form; `lift-manager hub update key` makes one") from error
    if not isinstance(key, Ed25519PublicKey):
        raise UpdateRefused(f"{path} is no Ed25519 key; make one with `lift-manager hub update key`")
    return key


def trusted_keys(files: tuple[str, ...]) -> dict[str, Ed25519PublicKey]:
    """Return the keys that a site trusts, by file. Raises UpdateRefused, also for a file that others can replace."""
    found = {}
    for name in files:
        path = Path(name)
        key = read_public_key(path)
        if path.stat().st_mode & 0o022:
            raise UpdateRefused(
                f"{path} can be written by others, who could put their own key there; `chmod 644 {path}`"
            )
        found[name] = key
    return found


def _read(path: Path) -> bytes:
    with file_errors(path, "read"):
        return path.read_bytes()
