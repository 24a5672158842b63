"""The keys of a site in one small file: made and revoked from the command line, and watched by the manager that runs."""

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

from drivers.own_files import is_shared, open_own, read_own
from drivers.thread import in_thread
from lift_manager.api.access import Role
from lift_manager.api.keys import Key, KeyRing, Secret, digest_of, token
from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.errors import KeysUnusable
from lift_manager.store.place import SHARED, replace_file, unshared

_log = logging.getLogger(__name__)

VERSION: Literal[1] = 1
LOOK_EVERY_S = 0.5
"""A revoked key is refused within a second: half of it to look, half to read."""

Id = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{8}$")]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$"), Field(repr=False)]
Note = Callable[[Row], None]


def _in_any_zone(at: datetime) -> datetime:
    if not MINYEAR < at.year < MAXYEAR:
        raise ValueError(f"the year {at.year} cannot be")
    return at


Moment = Annotated[AwareDatetime, AfterValidator(_in_any_zone)]
"""A time that can be shown in every zone."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class KeyEntry(_Part):
    """One key, live or revoked. When it was last used is not kept: every request would be a write."""

    id: Id
    name: str
    role: Role
    lifts: tuple[str, ...] = ()
    sha256: Digest
    """Of its secret."""
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
    """What every version of the file begins with."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    format: Literal["lift-manager keys"]
    version: int
    site: str


def keys_path(state: Path) -> Path:
    """Return the file of a site's keys, beside the file of its state."""
    return state.with_name(f"{state.stem}.keys.json")


def read_kept_keys(path: Path, site: str) -> KeysForm:
    """Return the keys of a site that a manager may serve with: as `read_keys`, but keys that got lost are refused, too."""
    keys, lock = read_keys(path, site), _lock_of(path)
    if not path.exists() and lock.exists():
        what = f"is gone, though there were keys: {lock.name} is beside it"
        advice = f"put back a copy of it, or make keys with `lift-manager keys make`; if this site is to have none, remove {lock}"
        raise _unusable(path, what, advice)
    return keys


def read_keys(path: Path, site: str) -> KeysForm:
    """Return the keys of a site; a file that is not there holds none. Raises KeysUnusable."""
    if is_shared(path.parent):
        raise _unusable(path, SHARED, unshared(path.parent))
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
            raise _unusable(path, f"is version {head.version} of that file", advice)
        if head.site != site:
            raise _unusable(
                path, f"belongs to the site {head.site!r}", "move it away, or give this site another folder"
            )
        return KeysForm.model_validate_json(data)
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in found["loc"])
        advice = "put back a copy of it, or move it away and make new keys"
        # not `from error`: its text quotes what it read
        raise _unusable(
            path, f"holds no keys of a lift manager, or is damaged ({where}: {found['msg']})", advice
        ) from None


def may_own(owner: int, *, me: int, folder: int) -> bool:
    """Whether the keys may belong to this user: root, or the one that this runs as; for root also that of the `folder`.

    Root writes the file for the user of its folder.
    """
    return owner in (0, me or folder)


def _unusable(path: Path, what: str, advice: str) -> KeysUnusable:
    return KeysUnusable(f"{path} {what}; it says who may command the lifts, so nothing goes on without it: {advice}")


def make_key(path: Path, site: str, key: Key, *, by: str, at: datetime) -> Secret:
    """Add a live key and return it; nothing can show it again. The id of `key` is not used. Raises KeysUnusable."""
    with _alone(path):
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
    """Take back the live key of this name; returns what is left. Raises KeysUnusable."""
    _named(read_keys(path, site), name)  # before there is a lock: it would say that there were keys
    with _alone(path):
        form = read_keys(path, site)
        _named(form, name)
        gone = {"revoked_at": at, "revoked_by": by}
        keys = tuple(
            entry.model_copy(update=gone) if entry.name == name and entry.revoked_at is None else entry
            for entry in form.keys
        )
        left = form.model_copy(update={"keys": keys})
        _write(path, left)
    return left


def _named(form: KeysForm, name: str) -> None:
    """Raise KeysUnusable where there is no live key of this name."""
    live = [entry.name for entry in form.live]
    if name not in live:
        there = f"the live keys are {', '.join(live)}" if live else "there is no live key"
        raise KeysUnusable(f"no live key is named {name!r}; {there}")


def _lock_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.lock")


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Let one `lift-manager keys` at a time change the file."""
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
            # made by root for a service that runs as somebody else: the folder is that user's
            owner = path.parent.stat()
            os.chown(path, owner.st_uid, owner.st_gid)
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> KeysUnusable:
    return KeysUnusable(
        f"{path} cannot be written ({error.strerror or error}); run this as the user that the manager runs as"
    )


class KeyFile:
    """The Keys of a running manager: what the file says, at most a second ago."""

    def __init__(self, path: Path, site: str, *, open_without: bool) -> None:
        """Read the file. `open_without`: everybody is let in while there is no live key. Raises KeysUnusable."""
        self.path = path
        self._site = site
        self._open_without = open_without
        self._seen: object = None
        self._live: dict[str, KeyEntry] = {}
        self._trouble = ""
        self._seen = _signature(path)
        self._take(read_kept_keys(path, site))

    @property
    def needed(self) -> bool:
        """Whether a request needs a key."""
        return self._ring.needed

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the live keys."""
        return tuple(entry.name for entry in self._live.values())

    def find(self, asked: Secret) -> Key | None:
        """Return the live key that this is; None where there is none, whatever is wrong with it."""
        return self._ring.find(asked)

    def named(self, name: str) -> Key | None:
        """Return the live key of this name."""
        return self._ring.named(name)

    def admits(self, key: Key | None) -> bool:
        """Whether a caller that was let in with this key, or without one, would be let in still."""
        return self._ring.admits(key)

    async def run(self, note: Note) -> None:
        """Look for changes until cancelled, and note each.

        A file that cannot be read any more, or is gone, changes nothing: neither may that let everybody in, nor keep out robots
        that are under way. It is told once, and read again when it can be.
        """
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            found: list[KeysForm] = []
            seen: list[object] = []
            try:
                await in_thread(partial(self._look, found, seen))
            except (OSError, KeysUnusable) as error:
                self._tell(str(error))
                continue
            if found:
                self._tell("")
                self._seen = seen[0]
                before = self._live
                self._take(found[0])
                for row in _changes(before, self._live, found[0]):
                    _log.info("%s", row.text)
                    note(row)

    def _look(self, found: list[KeysForm], seen: list[object]) -> None:
        """Read the file if it changed; in a thread, because a disk may hang."""
        signature = _signature(self.path)
        if signature == self._seen:
            return
        if signature is None:
            raise KeysUnusable(f"{self.path} is gone; the keys that it had count until the next start")
        seen.append(signature)
        found.append(read_keys(self.path, self._site))

    def _take(self, form: KeysForm) -> None:
        self._live = {entry.id: entry for entry in form.live}
        keys = ((_key(entry), entry.sha256) for entry in form.live)
        self._ring = KeyRing(keys, open_without=self._open_without)

    def _tell(self, trouble: str) -> None:
        if trouble and trouble != self._trouble:
            _log.error("keys: %s", trouble)
        self._trouble = trouble


def _signature(path: Path) -> object:
    """Return what tells one content of the file from the next; None where it is not there."""
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
