"""What etcd holds for one site: the names of its keys, and what their values look like.

| key | value |
|---|---|
| `active` | epoch, owner and address of the active manager |
| `head` | number and id of the newest commit, and the version of its writer |
| `records/LIFT` | the record of a lift, as the store on the disk has it, and the version of its writer |
| `rows/NUMBER` | the rows of the journal of one commit, until both machines have them on the disk |
| `copied/MACHINE` | the number of the newest commit that a machine has on the disk |
| `removed` | the number of the newest commit whose rows were removed |
| `handover` | a planned change of roles that was requested |
| `solo` | the machine that goes on alone: while it is there, no standby takes `active` |
| `joined` | the id of the newest such decision that has ended |
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from lift_manager.cluster.errors import ClusterUnusable
from lift_manager.cluster.etcd import Entry
from lift_manager.cluster.term import Key
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.chain import StoredRow
from lift_manager.store.record import decode, encode
from lift_manager.store.sqlite import to_pending, to_stored
from lift_manager.store.store import PendingRow

Migration = Callable[[Any], Any]

MIGRATIONS: tuple[Migration, ...] = ()
"""Migration n turns the JSON of a record of version n + 1 into that of version n + 2. One machine is upgraded before the other, so a
manager reads what older ones wrote; what a newer one wrote it refuses to read, and stands by."""

VERSION = 1 + len(MIGRATIONS)
"""The version of what this program writes to etcd."""


class Place:
    """The keys of one site."""

    def __init__(self, site: str) -> None:
        self._prefix = f"/lift-manager/{site}/"
        self.active = f"{self._prefix}active"
        self.head = f"{self._prefix}head"
        self.records = f"{self._prefix}records/"
        self.rows = f"{self._prefix}rows/"
        self.copied = f"{self._prefix}copied/"
        self.removed = f"{self._prefix}removed"
        self.handover = f"{self._prefix}handover"
        self.solo = f"{self._prefix}solo"
        self.joined = f"{self._prefix}joined"

    def rows_of(self, commit: int) -> str:
        """Return the key of the rows of a commit; keys sort as the numbers do."""
        return f"{self.rows}{commit:016d}"

    def commit_of(self, entry: Entry) -> int:
        """Return the number of the commit whose rows these are."""
        return int(entry.key.removeprefix(self.rows))


@dataclass(frozen=True, slots=True)
class Head:
    """The newest commit."""

    commit: int
    id: str
    """Different for each attempt, so that its writer recognizes it after a lost answer."""
    version: int = VERSION
    """Of what its writer writes."""


@dataclass(frozen=True, slots=True)
class Handover:
    """A planned change of roles."""

    epoch: int
    """Of the active manager that is to step back; in any other epoch it means nothing."""
    by: str
    """Who requested it."""
    accepted_by: str = ""
    """The standby that is ready."""


@dataclass(frozen=True, slots=True)
class Solo:
    """The decision of a person that one machine goes on alone."""

    id: str
    """Different for each decision, so that etcd and the disk are known to mean the same one."""
    machine: str
    off: str
    """The other machine, which is known to be off."""
    by: str
    """Who has decided it."""
    since: str
    """When, for people."""
    epoch: int
    """Higher than any that the other machine may have had."""
    revision: int
    """Of `active`, as it was known to a member of etcd then; 0 if none answered."""
    commit: int
    """The newest commit that this machine had on its disk then."""
    contested: bool = False
    """`active` has moved since, so that only etcd can let this machine go on."""

    @property
    def text(self) -> str:
        """The decision in words."""
        return f"{self.machine} goes on alone since {self.since}, as {self.by} has decided because {self.off} is off"


def new_solo_id() -> str:
    """Return the id of another decision."""
    return secrets.token_hex(8)


def next_head(commit: int) -> Head:
    """Return the head of another attempt."""
    return Head(commit, secrets.token_hex(8))


def encode_key(key: Key) -> bytes:
    """Return the value of `active`: the same bytes for each renewal of an epoch, which commits compare."""
    return _dump({"epoch": key.epoch, "owner": key.owner, "address": key.address})


def decode_key(entries: Sequence[Entry]) -> Key:
    """Return the key that was read; its revision is 0 if there is none. Raises ClusterUnusable."""
    if not entries:
        return Key(0)
    with _reading(entries[0]) as value:
        return Key(entries[0].revision, value["epoch"], value["owner"], value["address"])


def encode_head(head: Head) -> bytes:
    """Return the value of `head`."""
    return _dump({"commit": head.commit, "id": head.id, "version": head.version})


def decode_head(entry: Entry) -> Head:
    """Return the newest commit. Raises ClusterUnusable, also for that of a newer version."""
    with _reading(entry) as value:
        _require_readable(value["version"])
        return Head(value["commit"], value["id"], value["version"])


def encode_handover(handover: Handover) -> bytes:
    """Return the value of `handover`."""
    return _dump({"epoch": handover.epoch, "by": handover.by, "accepted_by": handover.accepted_by})


def decode_handover(entries: Sequence[Entry]) -> Handover | None:
    """Return the handover that was requested, if there is one. Raises ClusterUnusable."""
    if not entries:
        return None
    with _reading(entries[0]) as value:
        return Handover(value["epoch"], value["by"], value["accepted_by"])


def encode_solo(solo: Solo) -> bytes:
    """Return the value of `solo`, and the content of the file on the disk of that machine."""
    return _dump(asdict(solo))


def decode_solo(entries: Sequence[Entry]) -> Solo | None:
    """Return the decision that a machine goes on alone, if there is one. Raises ClusterUnusable."""
    if not entries:
        return None
    with _reading(entries[0]) as value:
        return Solo(**value)


def encode_rows(rows: Iterable[PendingRow]) -> bytes:
    """Return the rows of one commit as one value."""
    return _dump([to_stored(row)[1:7] for row in rows])


def decode_rows(entry: Entry) -> list[PendingRow]:
    """Return the rows of one commit. Raises ClusterUnusable."""
    with _reading(entry) as value:
        return [
            to_pending(StoredRow(0, at, kind, lift, caller, text, data, b""))
            for at, kind, lift, caller, text, data in value
        ]


def encode_record(saved: SavedLift) -> bytes:
    """Return the record of a lift."""
    return f'{{"version":{VERSION},"saved":{encode(saved)}}}'.encode()


def decode_record(entry: Entry, migrations: Sequence[Migration] = MIGRATIONS) -> SavedLift:
    """Return the record of a lift, which an older version may have written. Raises ClusterUnusable, also for that of a newer one."""
    with _reading(entry) as value:
        version, saved = value["version"], value["saved"]
        _require_readable(version, 1 + len(migrations))
        for migrate in migrations[version - 1 :]:
            saved = migrate(saved)
        return decode(json.dumps(saved))


def encode_number(number: int) -> bytes:
    """Return the value of `copied` and `removed`."""
    return _dump(number)


def decode_number(entry: Entry) -> int:
    """Return the number of a commit. Raises ClusterUnusable."""
    with _reading(entry) as value:
        return int(value)


def _require_readable(version: int, newest: int = VERSION) -> None:
    if version > newest:
        raise ClusterUnusable(
            f"what a newer version has written to etcd cannot be read by this one: it is version {version} there, and this manager reads up to"
            f" {newest}; install the newer version on this machine too"
        )


def _dump(value: object) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode()


@contextmanager
def _reading(entry: Entry) -> Iterator[Any]:
    """Parse a value. Raises ClusterUnusable, also for what the body of the `with` misses in it."""
    try:
        yield json.loads(entry.value)
    except (ValueError, KeyError, TypeError) as error:
        raise _unusable(entry, f"{type(error).__name__}: {error}") from error


def _unusable(entry: Entry, why: str) -> ClusterUnusable:
    return ClusterUnusable(
        f"the value of {entry.key} in etcd is not one that a manager of this version writes ({why}); run the same version on both"
        " machines, or restore etcd from a snapshot"
    )
