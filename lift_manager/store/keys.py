"""The file with the keys of a site: changed from the command line, watched by the running manager."""

from __future__ import annotations

import asyncio
import fcntl
import logging
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import MAXYEAR, MINYEAR, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from drivers.own_files import is_shared, open_own, read_own, replace_file
from drivers.thread import in_thread
from lift_manager.api.fields import first_mistake
from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.errors import KeysUnusable
from lift_manager.store.place import SHARED_FOLDER, unshare_advice

_log = logging.getLogger(__name__)

VERSION: Literal[1] = 1
LOOK_EVERY_S = 0.5
"""How often the file is checked. A revoked key is refused within a second: half to notice the change, half to read it."""

Id = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{8}$")]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$"), Field(repr=False)]
Note = Callable[[Row], None]


def _in_any_zone(at: datetime) -> datetime:
    if not MINYEAR < at.year < MAXYEAR:
        raise ValueError(f"the year {at.year} is out of range")
    return at


Moment = Annotated[AwareDatetime, AfterValidator(_in_any_zone)]
"""A time that every zone can represent."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class KeyEntry(_Part):
    """One key, live or revoked. Its last use is not recorded, because every request would then write to the disk."""

    id: Id
    name: str
    role: Role
    lifts: tuple[str, ...] = ()
    sha256: Digest
    """Of the secret."""
    made_at: Moment
    made_by: str
    revoked_at: Moment | None = None
    revoked_by: str = ""


class KeysForm(_Part):
    """The whole file."""

    format: Literal["lift-manager keys"] = "lift-manager keys"
    version: Literal[1] = VERSION
    site: str
    keys: tuple[KeyEntry, ...] = ()

    @property
    def live(self) -> tuple[KeyEntry, ...]:
        """The keys that are not revoked."""
        return tuple(entry for entry in self.keys if entry.revoked_at is None)


class _Head(BaseModel):
    """The fields that every version of the file has."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    format: Literal["lift-manager keys"]
    version: int
    site: str


def keys_path(state: Path) -> Path:
    """Return the path of the key file, next to the store of the site."""
    return state.with_name(f"{state.stem}.keys.json")


def read_kept_keys(path: Path, site: str) -> KeysForm:
    """Return the keys for a manager to serve with: like `read_keys`, but raises KeysUnusable if the file was lost."""
    keys, lock = read_keys(path, site), _lock_of(path)
    if not path.exists() and lock.exists():
        what = f"is gone, although there were keys: {lock.name} still exists"
        advice = f"restore a copy of it, or make keys with `lift-manager keys make`; if this site is to have none, remove {lock}"
        raise _unusable(path, what, advice)
    return keys


def read_keys(path: Path, site: str) -> KeysForm:
    """Return the keys of a site; without a file there are none. Raises KeysUnusable."""
    if is_shared(path.parent):
        raise _unusable(path, SHARED_FOLDER, unshare_advice(path.parent))
    try:
        data, status = read_own(path)
    except FileNotFoundError:
        return KeysForm(site=site)
    except OSError as error:
        advice = "make it readable for the user that the manager runs as, and for nobody else"
        raise _unusable(path, f"cannot be read ({error.strerror or error})", advice) from error
    if not may_own(status.st_uid, me=os.geteuid(), folder=path.parent.stat().st_uid):
        raise _unusable(
            path, "belongs to another user, who could add keys", "check its keys, then give it to the manager's user"
        )
    if status.st_mode & 0o022:
        raise _unusable(
            path, "can be written by others, who could add keys", f"check its keys, then `chmod 600 {path}`"
        )
    try:
        head = _Head.model_validate_json(data)
        if head.version != VERSION:
            advice = f"start the version that wrote it; this one reads version {VERSION}"
            raise _unusable(path, f"has version {head.version}", advice)
        if head.site != site:
            raise _unusable(
                path, f"belongs to the site {head.site!r}", "move it away, or give this site another folder"
            )
        return KeysForm.model_validate_json(data)
    except ValidationError as error:
        advice = "restore a copy of it, or move it away and make new keys"
        # not `from error`: its text quotes what it read
        raise _unusable(
            path, f"is not a key file of a lift manager, or is damaged ({first_mistake(error)})", advice
        ) from None


def may_own(owner: int, *, me: int, folder: int) -> bool:
    """Whether this user may own the key file: root or the current user; if that is root, also the owner of the `folder`.

    Root creates the file for the owner of its folder.
    """
    return owner in (0, me or folder)


def _unusable(path: Path, what: str, advice: str) -> KeysUnusable:
    return KeysUnusable(f"{path} {what}; it decides who may command the lifts, so nothing works without it: {advice}")


def make_key(path: Path, site: str, key: Key, *, by: str, at: datetime) -> Secret:
    """Add a live key and return its token, which cannot be shown again. The id of `key` is not used. Raises KeysUnusable."""
    with _locked(path):
        form = read_keys(path, site)
        if any(entry.name == key.name for entry in form.live):
            raise KeysUnusable(f"there is a live key named {key.name!r}; revoke it first, or choose another name")
        taken = {entry.id for entry in form.keys}
        key_id = next(new for new in iter(partial(secrets.token_hex, 4), "") if new not in taken)
        secret = secrets.token_hex(32)
        entry = KeyEntry(
            id=key_id,
            name=key.name,
            role=key.role,
            lifts=key.lifts,
            sha256=digest_of(secret),
            made_at=at,
            made_by=by,
        )
        _write(path, form.model_copy(update={"keys": (*form.keys, entry)}))
    return token(key_id, secret)


def revoke_key(path: Path, site: str, name: str, *, by: str, at: datetime) -> KeysForm:
    """Revoke the live key of this name; returns the remaining keys. Raises KeysUnusable."""
    _require_live_key(read_keys(path, site), name)  # before the lock exists: it would indicate that there were keys
    with _locked(path):
        form = read_keys(path, site)
        _require_live_key(form, name)
        revocation = {"revoked_at": at, "revoked_by": by}
        keys = tuple(
            entry.model_copy(update=revocation) if entry.name == name and entry.revoked_at is None else entry
            for entry in form.keys
        )
        remaining = form.model_copy(update={"keys": keys})
        _write(path, remaining)
    return remaining


def _require_live_key(form: KeysForm, name: str) -> None:
    """Raise KeysUnusable if there is no live key of this name."""
    live = [entry.name for entry in form.live]
    if name not in live:
        there = f"the live keys are {', '.join(live)}" if live else "there is no live key"
        raise KeysUnusable(f"no live key is named {name!r}; {there}")


def _lock_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.lock")


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock under which one `lift-manager keys` at a time changes the file."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        lock = open_own(_lock_of(path))
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except (BlockingIOError, PermissionError) as error:
        raise KeysUnusable(f"{path} is being changed by another `lift-manager keys`; try again") from error
    finally:
        os.close(lock)


def _write(path: Path, form: KeysForm) -> None:
    try:
        replace_file(path, form.model_dump_json(indent=2).encode() + b"\n")
        if os.geteuid() == 0:
            # root creates it for a service that runs as the owner of the folder
            owner = path.parent.stat()
            os.chown(path, owner.st_uid, owner.st_gid)
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> KeysUnusable:
    return KeysUnusable(
        f"{path} cannot be written ({error.strerror or error}); run this as the user that the manager runs as"
    )


class KeyFile:
    """The keys of a running manager, at most a second behind the file. Implements Keys."""

    def __init__(self, path: Path, site: str, *, open_without_keys: bool) -> None:
        """Read the file. `open_without_keys`: no key is required while there is no live key. Raises KeysUnusable."""
        self.path = path
        self._site = site
        self._open_without = open_without_keys
        self._last_signature: object = None
        self._live: dict[str, KeyEntry] = {}
        self._trouble = ""
        self._last_signature = _file_signature(path)
        self._use(read_kept_keys(path, site))

    @property
    def are_required(self) -> bool:
        """Whether a request needs a key."""
        return self._ring.are_required

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the live keys."""
        return tuple(entry.name for entry in self._live.values())

    def find(self, secret: Secret) -> Key | None:
        """Return the live key with this token; None for any other token."""
        return self._ring.find(secret)

    def find_by_id(self, key_id: str) -> tuple[Key, str] | None:
        """Return the live key with this id, and the digest of its secret."""
        return self._ring.find_by_id(key_id)

    def find_by_name(self, name: str) -> Key | None:
        """Return the live key of this name."""
        return self._ring.find_by_name(name)

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was admitted with this key, or without one, would still be admitted."""
        return self._ring.admits(key)

    async def run(self, note: Note) -> None:
        """Watch the file until cancelled, and write a row for each change.

        If the file cannot be read, or is gone, the keys stay as they are: that must neither admit everybody nor shut out robots
        that are under way. It is logged once, and the file is read again as soon as possible.
        """
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            found: list[KeysForm] = []
            signatures: list[object] = []
            try:
                await in_thread(partial(self._read_if_changed, found, signatures))
            except (OSError, KeysUnusable) as error:
                self._log_trouble(str(error))
                continue
            if found:
                self._log_trouble("")
                self._last_signature = signatures[0]
                before = self._live
                self._use(found[0])
                for row in _changes(before, self._live, found[0]):
                    _log.info("%s", row.text)
                    note(row)

    def _read_if_changed(self, found: list[KeysForm], signatures: list[object]) -> None:
        """Read the file if it has changed; runs in a thread, because a disk may hang."""
        signature = _file_signature(self.path)
        if signature == self._last_signature:
            return
        if signature is None:
            raise KeysUnusable(f"{self.path} is gone; its keys stay valid until the next start")
        signatures.append(signature)
        found.append(read_keys(self.path, self._site))

    def _use(self, form: KeysForm) -> None:
        self._live = {entry.id: entry for entry in form.live}
        keys = ((_key(entry), entry.sha256) for entry in form.live)
        self._ring = KeyRing(keys, open_without_keys=self._open_without)

    def _log_trouble(self, trouble: str) -> None:
        if trouble and trouble != self._trouble:
            _log.error("keys: %s", trouble)
        self._trouble = trouble


def _file_signature(path: Path) -> object:
    """Return a value that changes with the file; None if there is no file."""
    try:
        now = path.stat()
    except FileNotFoundError:
        return None
    return now.st_ino, now.st_mtime_ns, now.st_ctime_ns, now.st_size


def _key(entry: KeyEntry) -> Key:
    return Key(entry.id, entry.name, entry.role, entry.lifts)


def _changes(before: dict[str, KeyEntry], live: dict[str, KeyEntry], form: KeysForm) -> Iterator[Row]:
    for entry in form.keys:
        was, now = entry.id in before, entry.id in live
        if was is not now:
            done, by = ("made", entry.made_by) if now else ("revoked", entry.revoked_by)
            lifts = f" for {', '.join(entry.lifts)}" if entry.lifts else ""
            text = f"the {entry.role} key {entry.name}{lifts} was {done} by {by}"
            about = {"id": entry.id, "name": entry.name, "role": entry.role.value, "lifts": list(entry.lifts)}
            yield Row(RowKind.KEY, text, caller=by, data={**about, "done": done})
