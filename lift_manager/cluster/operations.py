"""What people do with a cluster: prepare etcd for a site, look at it, let the roles change, and replace what it holds."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lift_manager.cluster.content import (
    Handover,
    Head,
    Place,
    Solo,
    decode_handover,
    decode_head,
    decode_key,
    decode_number,
    decode_solo,
    encode_handover,
    encode_head,
    encode_key,
    encode_number,
    encode_record,
    next_head,
)
from lift_manager.cluster.errors import ClusterUnusable, EtcdUnavailable
from lift_manager.cluster.etcd import Etcd, has_revision, has_value, put, read, read_all, remove, remove_all
from lift_manager.cluster.term import UNCHANGED_S, Key
from lift_manager.runtime.recorder import SavedLift

ACCEPTED_WITHIN_S = 8.0
"""How long a standby may take to accept a handover. Chosen: one that has just started does so after 5 s (`term.ANSWERING_S`)."""

TAKEN_WITHIN_S = 10.0
"""How long the roles may take to change after that."""

EPOCHS_AHEAD = 1_000_000
"""How far an epoch is above the newest that this machine knows where etcd cannot say it. Chosen: the other machine had no more terms that
this one knows nothing of, and 32 bits have room for thousands of times."""

LOOK_EVERY_S = 0.1


@dataclass(frozen=True, slots=True)
class ClusterStatus:
    """What etcd holds for a site."""

    key: Key
    commit: int
    """The number of the newest commit."""
    copied: Mapping[str, int]
    """The newest commit on the disk of each machine."""
    solo: Solo | None = None
    """The machine that goes on alone, if etcd knows of one."""


def prepare(
    etcd: Etcd, place: Place, records: Mapping[str, SavedLift], *, epoch: int = 0, known_epoch: int = 0
) -> None:
    """Begin with these records, once for a site. Raises ClusterError, also if etcd holds the site already.

    Terms begin above `epoch`, the highest one that a controller has obeyed. `known_epoch` is the newest that this machine knows of; an
    etcd that is new begins far above it.
    """
    before = decode_key(etcd.transact([], [read(place.active)]).ranges[0])
    begins = max(epoch, _epoch_from(before.epoch, known_epoch))
    new = [has_revision(key, 0) for key in (place.head, place.solo)]
    new.append(has_revision(place.active, before.revision))
    writes = [put(place.active, encode_key(Key(0, begins))), put(place.head, encode_head(Head(0, "")))]
    writes += [put(place.records + lift, encode_record(record)) for lift, record in records.items()]
    if not etcd.transact(new, writes).succeeded:
        raise ClusterUnusable(
            "etcd holds this site already, with what its managers remember; nothing was changed, and both machines can be started"
        )


def replace(
    etcd: Etcd,
    place: Place,
    records: Mapping[str, SavedLift],
    solo: Solo | None = None,
    *,
    epoch: int = 0,
    known_epoch: int = 0,
    unchanged_s: float = UNCHANGED_S,
) -> int:
    """Replace what etcd holds for a site by these records, in one step; the epoch only rises.

    With `solo` it is the machine that has gone on alone that brings them, and that decision ends; once it has ended, nothing is done.
    Returns how many commits of etcd are not in the journal of that machine. Raises ClusterError, also while a manager is active or
    another machine goes on alone. The epochs are as in `prepare`.
    """
    keys = (place.active, place.head, place.solo, place.joined)
    reads = [*(read(key) for key in keys), read_all(place.records)]
    active, heads, marks, joined, old = etcd.transact([], reads).ranges
    if solo is not None and joined and joined[0].value.decode() == solo.id:
        return 0
    marked = decode_solo(marks)
    if marked is not None and (solo is None or marked.id != solo.id):
        raise ClusterUnusable(
            f"{marked.text}; nothing was changed. `lift-manager cluster join` on {marked.machine} ends that"
        )
    before = decode_key(active)
    time.sleep(unchanged_s if before.owner else 0.0)
    begins = _epoch_from(before.epoch, known_epoch) if solo is None else max(before.epoch, solo.epoch)
    writes = [put(place.active, encode_key(Key(0, max(epoch, begins)))), remove(place.solo), remove_all(place.rows)]
    lost = 0
    if solo is None:
        writes += [put(place.head, encode_head(Head(0, ""))), remove_all(place.copied), remove(place.removed)]
    else:
        newest = max(decode_head(heads[0]).commit if heads else 0, solo.commit)
        lost, number = newest - solo.commit, newest + 1
        writes += [put(place.head, encode_head(next_head(number))), put(place.joined, solo.id.encode())]
        # the other machine has not copied this number, so it notes that its journal has a gap
        writes += [put(key, encode_number(number)) for key in (place.removed, place.copied + solo.machine)]
    new = {place.records + lift: encode_record(record) for lift, record in records.items()}
    writes += [put(key, record) for key, record in new.items()]
    writes += [remove(entry.key) for entry in old if entry.key not in new]
    compare = [has_revision(place.active, before.revision), has_revision(place.solo, marks[0].revision if marks else 0)]
    if not etcd.transact(compare, writes).succeeded:
        raise ClusterUnusable("a manager is active in this cluster; nothing was changed. End both managers first")
    return lost


def _epoch_from(found: int, known: int) -> int:
    """Return the epoch to begin with: that of etcd, unless this machine knows a newer one, because etcd has lost it."""
    return found if found >= known else known + EPOCHS_AHEAD


def forget_solo(etcd: Etcd, place: Place, machine: str, epoch: int = 0, *, unchanged_s: float = UNCHANGED_S) -> None:
    """Let the managers continue with what etcd holds, although this machine goes on alone. Raises ClusterError.

    A controller that arbitrates keeps the epoch in which that machine has commanded it, which is `epoch` or that of its mark. The next
    term begins above that, unless a manager is active: that one stays in its own.
    """
    active, marks = etcd.transact([], [read(place.active), read(place.solo)]).ranges
    key, marked = decode_key(active), decode_solo(marks)
    if marked is not None and marked.machine != machine:
        raise ClusterUnusable(f"{marked.text}, and not {machine}; nothing was changed")
    compare, forget = [has_revision(place.solo, marks[0].revision if marks else 0)], [remove(place.solo)]
    epoch = max(epoch, 0 if marked is None else marked.epoch)
    if epoch > key.epoch:
        time.sleep(unchanged_s if key.owner else 0.0)
        unmoved = [*compare, has_revision(place.active, key.revision)]
        if etcd.transact(unmoved, [*forget, put(place.active, encode_key(Key(0, epoch)))]).succeeded:
            return
    if not etcd.transact(compare, forget).succeeded:
        raise ClusterUnusable("etcd was changed at the same time; try again")


def answering_member(members: Iterable[Etcd], place: Place) -> Etcd | None:
    """Return a member that has a majority behind it; None if none has. Raises EtcdRefused."""
    for member in members:
        try:
            member.transact([], [read(place.active)])
        except EtcdUnavailable:
            continue
        return member
    return None


def best_informed(members: Iterable[Etcd], place: Place) -> tuple[Etcd, Key, int] | None:
    """Return the member that knows most, without a majority, with its key and newest commit; None if no member answers.

    Raises ClusterUnusable.
    """
    found: list[tuple[Etcd, Key, int]] = []
    for member in members:
        try:
            active, head = member.transact([], [read(place.active, local=True), read(place.head, local=True)]).ranges
        except EtcdUnavailable:
            continue
        found.append((member, decode_key(active), decode_head(head[0]).commit if head else 0))
    return max(found, key=lambda one: (one[2], one[1].revision), default=None)


def read_status(etcd: Etcd, place: Place) -> ClusterStatus:
    """Return what etcd holds for a site. Raises ClusterError."""
    reads = [read(place.active), read(place.head), read_all(place.copied), read(place.solo)]
    active, head, copied, solo = etcd.transact([], reads).ranges
    if not active or not head:
        raise ClusterUnusable("etcd holds nothing for this site yet: `lift-manager cluster init` begins it")
    numbers = {entry.key.removeprefix(place.copied): decode_number(entry) for entry in copied}
    return ClusterStatus(decode_key(active), decode_head(head[0]).commit, numbers, decode_solo(solo))


def find_active(
    etcd: Etcd, place: Place, *, unchanged_s: float = UNCHANGED_S, look_every_s: float = LOOK_EVERY_S
) -> str:
    """Return in words which machine commands the lifts now; empty if none does. Raises ClusterError.

    A key that has an owner and is not renewed for `unchanged_s` is that of a manager that has ended.
    """
    ends_at, first = math.inf, None
    while True:
        asked_at = time.monotonic()
        active, solo = etcd.transact([], [read(place.active), read(place.solo)]).ranges
        key, marked = decode_key(active), decode_solo(solo)
        if marked is not None:
            return marked.text
        if not key.owner:
            return ""
        if first is not None and key.revision != first.revision:
            return f"{key.owner} is active, at {key.address}"
        if first is None:
            ends_at = time.monotonic() + unchanged_s
        elif asked_at >= ends_at:
            return ""
        first = key
        time.sleep(look_every_s)


def hand_over(etcd: Etcd, place: Place, by: str, *, accepted_within_s: float = ACCEPTED_WITHIN_S) -> Key:
    """Let the standby take over, and return its key. Raises ClusterError if there is none."""
    status = read_status(etcd, place)
    before = status.key
    if status.solo is not None:
        raise ClusterUnusable(f"{status.solo.text}, so there is nothing to hand over")
    if not before.owner:
        raise ClusterUnusable("no manager is active, so there is nothing to hand over")
    request = Handover(before.epoch, by)
    etcd.transact([], [put(place.handover, encode_handover(request))])
    accept_by, take_by = time.monotonic() + accepted_within_s, time.monotonic() + TAKEN_WITHIN_S
    while time.monotonic() < take_by:
        active, handover = etcd.transact([], [read(place.active), read(place.handover)]).ranges
        key, found = decode_key(active), decode_handover(handover)
        if key.owner and key.epoch > before.epoch:
            return key
        if found == request and time.monotonic() >= accept_by:
            withdraw = [put(place.handover, encode_handover(Handover(0, by)))]
            if etcd.transact([has_value(place.handover, encode_handover(request))], withdraw).succeeded:
                raise ClusterUnusable(
                    f"no standby has answered within {accepted_within_s:g} s, so {before.owner} stays active; start the manager of the"
                    " other machine first"
                )
        time.sleep(LOOK_EVERY_S)
    raise ClusterUnusable(
        f"the roles have not changed within {TAKEN_WITHIN_S:g} s; `lift-manager cluster status` shows them"
    )
