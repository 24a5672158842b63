"""What people do with a cluster: prepare etcd for a site, look at it, and let the roles change."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

from lift_manager.cluster.content import (
    Handover,
    Head,
    Place,
    decode_handover,
    decode_head,
    decode_key,
    decode_number,
    encode_handover,
    encode_head,
    encode_key,
    encode_record,
)
from lift_manager.cluster.errors import ClusterUnusable
from lift_manager.cluster.etcd import Etcd, has_revision, has_value, put, read, read_all, remove_all
from lift_manager.cluster.term import UNCHANGED_S, Key
from lift_manager.runtime.recorder import SavedLift

ACCEPTED_WITHIN_S = 3.0
"""How long a standby may take to accept a handover. Chosen: it looks every 0.3 s."""

TAKEN_WITHIN_S = 10.0
"""How long the roles may take to change after that."""

LOOK_EVERY_S = 0.1


@dataclass(frozen=True, slots=True)
class ClusterStatus:
    """What etcd holds for a site."""

    key: Key
    commit: int
    """The number of the newest commit."""
    copied: Mapping[str, int]
    """The newest commit on the disk of each machine."""


def prepare(etcd: Etcd, place: Place, records: Mapping[str, SavedLift], *, epoch: int = 0) -> int:
    """Begin with these records, once for a site. Raises ClusterError, also if etcd holds the site already.

    `epoch` is the highest one that a controller has obeyed. Returns the epoch that etcd has now: terms begin above it.
    """
    before = decode_key(etcd.transact([], [read(place.active)]).ranges[0])
    begins = max(before.epoch, epoch)
    new = [has_revision(place.active, before.revision), has_revision(place.head, 0)]
    writes = [put(place.active, encode_key(Key(0, begins))), put(place.head, encode_head(Head(0, "")))]
    writes += [put(place.records + lift, encode_record(record)) for lift, record in records.items()]
    if not etcd.transact(new, writes).succeeded:
        raise ClusterUnusable(
            "etcd holds this site already, with what its managers remember; nothing was changed, and both machines can be started"
        )
    return begins


def clear(etcd: Etcd, place: Place, *, unchanged_s: float = UNCHANGED_S) -> None:
    """Remove what etcd holds for a site, except for the epoch. Raises ClusterError, also while a manager is active."""
    before = decode_key(etcd.transact([], [read(place.active)]).ranges[0])
    time.sleep(unchanged_s if before.owner else 0.0)
    writes = [put(place.active, encode_key(Key(0, before.epoch)))]
    writes += [remove_all(key) for key in (place.head, place.records, place.rows, place.copied, place.removed)]
    if not etcd.transact([has_revision(place.active, before.revision)], writes).succeeded:
        raise ClusterUnusable("a manager is active in this cluster; nothing was changed. End both managers first")


def read_status(etcd: Etcd, place: Place) -> ClusterStatus:
    """Return what etcd holds for a site. Raises ClusterError."""
    active, head, copied = etcd.transact([], [read(place.active), read(place.head), read_all(place.copied)]).ranges
    if not active or not head:
        raise ClusterUnusable("etcd holds nothing for this site yet: `lift-manager cluster init` begins it")
    numbers = {entry.key.removeprefix(place.copied): decode_number(entry) for entry in copied}
    return ClusterStatus(decode_key(active), decode_head(head[0]).commit, numbers)


def hand_over(etcd: Etcd, place: Place, by: str, *, accepted_within_s: float = ACCEPTED_WITHIN_S) -> Key:
    """Let the standby take over, and return its key. Raises ClusterError if there is none."""
    before = read_status(etcd, place).key
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
