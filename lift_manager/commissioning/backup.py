"""The archive of a backup: a compressed tar file that begins with a list of what it holds, each file by its hash.

BackupUnusable    an archive cannot be written or used; the sentence names the file and the problem
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import tarfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, ValidationError

from drivers.own_files import make_own, put_in_place

VERSION: Literal[1] = 1
MANIFEST = "MANIFEST.json"
LARGEST_MANIFEST = 10_000_000
"""Bytes. Chosen: far above that of a thousand lifts, each with a hundred photos."""
BLOCK = 1 << 20
"""Bytes that are read at once. Chosen: little memory, few calls."""


class BackupUnusable(Exception):
    """An archive cannot be written or used; the sentence names the file and the problem."""


def _check_relative(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or not path.parts or ".." in path.parts or str(path) != name:
        raise ValueError("is no path inside a folder")
    return name


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Entry(_Part):
    """One file of a backup."""

    place: Literal["site", "state", "elsewhere"]
    """Below the folder of the site file, below that of the state, or anywhere else."""
    name: Annotated[str, AfterValidator(_check_relative)]
    """Its path below that folder; without the first slash if it was elsewhere."""
    about: str
    mode: int
    owner: str
    group: str
    size: int
    sha256: str

    @property
    def member(self) -> str:
        """Its name in the archive."""
        return f"{self.place}/{self.name}"


class Manifest(_Part):
    """What an archive holds."""

    format: Literal["lift-manager backup"] = "lift-manager backup"
    version: Literal[1] = VERSION
    site: str
    made_at: AwareDatetime
    program: str
    """The version of the lift manager."""
    site_file: Annotated[str, AfterValidator(_check_relative)]
    """The entry that is the site file."""
    site_folder: str
    """Where it was."""
    state_folder: str
    seal: str
    """Of the journal: number and hash of its newest row; empty if there was no row."""
    entries: tuple[Entry, ...]
    left_out: tuple[tuple[str, str], ...] = ()
    """What, and why."""


def hash_of(path: Path) -> str:
    """Return the sha256 of a file. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_archive(target: Path, manifest: Manifest, sources: Iterable[Path]) -> None:
    """Write a backup that only this user may read, whole or not at all, and read it back; `sources` are the files of the entries.

    Raises BackupUnusable and OSError.
    """
    part = target.with_name(f"{target.name}.part")
    try:
        with os.fdopen(make_own(part), "wb") as file:
            with tarfile.open(fileobj=file, mode="w:gz", format=tarfile.PAX_FORMAT) as archive:
                text = manifest.model_dump_json(indent=1).encode() + b"\n"
                archive.addfile(_member(MANIFEST, len(text), 0o600, manifest), io.BytesIO(text))
                for entry, source in zip(manifest.entries, sources, strict=True):
                    with source.open("rb") as content:
                        archive.addfile(_member(entry.member, entry.size, entry.mode, manifest), content)
            file.flush()
            os.fsync(file.fileno())
        _read_back(part)
        put_in_place(part, target)
    finally:
        part.unlink(missing_ok=True)


def _member(name: str, size: int, mode: int, manifest: Manifest) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.size, info.mode, info.mtime = size, mode, int(manifest.made_at.timestamp())
    return info


def _read_back(archive: Path) -> None:
    with _opened(archive) as (manifest, content):
        for entry in manifest.entries:
            for _ in _blocks(archive, entry, content):
                pass


def unpack(archive: Path, folder: Path) -> Manifest:
    """Write every file to `folder`, for this user alone, and compare it with its hash. Raises BackupUnusable and OSError."""
    with _opened(archive) as (manifest, content):
        for entry in manifest.entries:
            target = folder / entry.member
            with _writing(target) as file:
                for block in _blocks(archive, entry, content):
                    file.write(block)
        return manifest


def _blocks(archive: Path, entry: Entry, content: tarfile.TarFile) -> Iterator[bytes]:
    """Yield a file of an archive. Raises BackupUnusable if it is not the one that was put in."""
    changed = BackupUnusable(f"{archive} is damaged: {entry.member} is not the file that was put in")
    try:
        member = content.getmember(entry.member)
    except KeyError:
        raise changed from None
    found = content.extractfile(member) if member.isfile() and member.size == entry.size else None
    if found is None:
        raise changed
    digest = hashlib.sha256()
    while block := found.read(BLOCK):
        digest.update(block)
        yield block
    if digest.hexdigest() != entry.sha256:
        raise changed


@contextmanager
def _writing(target: Path) -> Iterator[IO[bytes]]:
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with os.fdopen(make_own(target), "wb") as file:
            yield file
    except OSError as error:
        raise BackupUnusable(f"{target} cannot be written ({error.strerror or error})") from error


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Manifest, tarfile.TarFile]]:
    """Open an archive. Raises BackupUnusable, also for what is wrong with the files in it."""
    try:
        with tarfile.open(path, "r:gz") as archive:
            first = archive.next()
            listed = None
            if first is not None and first.name == MANIFEST and first.isfile() and first.size <= LARGEST_MANIFEST:
                listed = archive.extractfile(first)
            if listed is None:
                raise BackupUnusable(f"{path} is no backup of a lift manager")
            yield _manifest(path, listed.read()), archive
    except (tarfile.TarError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise BackupUnusable(f"{path} is no backup of a lift manager, or is damaged ({error})") from error
    except OSError as error:
        raise BackupUnusable(f"{path} cannot be read ({error.strerror or error})") from error


def _manifest(path: Path, text: bytes) -> Manifest:
    try:
        head = json.loads(text)
        version = head.get("version") if isinstance(head, dict) else None
        if isinstance(version, int) and version > VERSION:
            raise BackupUnusable(
                f"{path} has version {version} of a backup, and this program reads version {VERSION}: use the newer program that made it"
            )
        return Manifest.model_validate_json(text)
    except ValueError as error:
        first = error.errors(include_input=False)[0] if isinstance(error, ValidationError) else None
        what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}" if first else str(error)
        raise BackupUnusable(f"{path} is no backup of a lift manager, or is damaged ({what})") from error
