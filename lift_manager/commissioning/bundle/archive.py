"""The archive of a support bundle, with a list of what is in it and what was left out, and why."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from lift_manager.commissioning.bundle.redact import Redactor

LARGEST = 50_000_000
"""Bytes of one file. Chosen: a day of a trace, compressed to a tenth of it, still goes into a mail."""
MANIFEST = "MANIFEST.txt"
NEVER = (
    ("the key file of the site", "key digests are secrets"),
    ("private keys and certificates, of the manager and of controllers", "private keys are secrets"),
    ("environment variables and the key that this command used", "they may be secrets"),
    (
        "the store itself (the database)",
        "it holds the names of people; the newest rows of its journal are here as text",
    ),
    ("comments of the site file and of maps of your own", "they are free text, in which anything may stand"),
)
"""What no bundle contains, with the reason."""


class SecretFound(Exception):
    """A secret of this computer would be in the bundle; the sentence says in which file."""


@dataclass(frozen=True, slots=True)
class Piece:
    """One file of a bundle."""

    name: str
    about: str
    content: bytes


@dataclass(slots=True)
class Bundle:
    """The pieces of a bundle, and what was left out."""

    redactor: Redactor
    pieces: list[Piece] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    """What, and why."""

    def add_text(self, name: str, about: str, text: str) -> None:
        """Add a text, without its secrets and names."""
        self.add_redacted(name, about, self.redactor.text(text))

    def add_redacted(self, name: str, about: str, text: str) -> None:
        """Add a text that the redactor has seen."""
        self._add(name, about, text.encode("utf-8"))

    def add_file(self, name: str, about: str, content: bytes) -> None:
        """Add a file of a person: a text without its secrets and names, anything else as it is."""
        if len(content) > LARGEST:
            self.leave_out(name, f"it has {len(content) // 1_000_000} MB, and {LARGEST // 1_000_000} are the most")
            return
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError:
            self._add(name, f"{about}; no text, so it was put in as it is", content)
            return
        self.add_text(name, about, text)

    def leave_out(self, what: str, why: str) -> None:
        """Note that something is not in the bundle."""
        self.left_out.append((what, self.redactor.text(why)))

    def _add(self, name: str, about: str, content: bytes) -> None:
        taken = {piece.name for piece in self.pieces}
        stem, dot, ending = name.rpartition(".")
        numbered = (
            f"{stem or ending}-{number}{dot if stem else ''}{ending if stem else ''}" for number in range(2, 10_000)
        )
        self.pieces.append(Piece(next(one for one in (name, *numbered) if one not in taken), about, content))

    def archive(self, *, made_at: datetime, version: str, secrets: Sequence[str]) -> bytes:
        """Return the zip file. Raises SecretFound if one of these secrets is in it all the same."""
        manifest = "\n".join([*self._manifest(made_at, version), ""]).encode("utf-8")
        everything = [Piece(MANIFEST, "this list", manifest), *self.pieces]
        for piece in everything:
            if any(
                secret.encode() in piece.content or secret.encode("utf-16-le") in piece.content for secret in secrets
            ):
                raise SecretFound(f"{piece.name} holds a secret of this computer in a form that cannot be removed")
        target = io.BytesIO()
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for piece in everything:
                stamp = zipfile.ZipInfo(piece.name, made_at.timetuple()[:6])
                stamp.external_attr = 0o600 << 16
                archive.writestr(stamp, piece.content, zipfile.ZIP_DEFLATED)
        return target.getvalue()

    def _manifest(self, made_at: datetime, version: str) -> Iterable[str]:
        yield f"Support bundle of lift-manager {version}, {made_at.isoformat(timespec='seconds')}"
        yield ""
        yield "Files"
        for piece in self.pieces:
            digest = hashlib.sha256(piece.content).hexdigest()[:16]
            yield f"  {piece.name}  ({len(piece.content)} bytes, sha256 {digest}...): {piece.about}"
        yield ""
        yield "Left out"
        for what, why in (*self.left_out, *NEVER):
            yield f"  {what}: {why}"
        yield ""
        yield "Replaced inside of these files"
        for what, count in sorted(self.redactor.counts.items()):
            yield f"  {what}: {'once' if count == 1 else f'{count} times'}"
        if not self.redactor.counts:
            yield "  nothing"
        yield ""
        yield "Names of people and robots are numbers here, the same number for the same name, unless --with-names was given."
        yield "Addresses of controllers stay. Read the files before you send them."
