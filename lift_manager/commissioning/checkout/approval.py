"""Finds the record of a lift that lets robots use it, for `serve` and `check`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from lift_manager.commissioning.checkout.plan import lift_digest
from lift_manager.commissioning.checkout.record import (
    Record,
    RecordUnusable,
    Stage,
    load,
    record_path,
    verdict,
)
from lift_manager.config.check import canonical_host
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite

PROOF_DAYS = 366
"""How long fire and watchdog count as proved. Chosen: a year, a leap year too."""


@dataclass(frozen=True, slots=True)
class Approval:
    """What the records say about robots on one lift."""

    record: Record | None
    """The one that lets robots use it."""
    problem: str
    """Why there is none, as part of a sentence; empty if there is."""
    cautions: tuple[str, ...] = ()
    """What else people should know."""


def find_approval(store: Path, loaded: LoadedSite, lift: str, now: datetime) -> Approval:
    """Return what the records next to a store say about a lift as its site file is now. Changes nothing."""
    try:
        tests = _records(store, loaded, lift, Stage.SAT)
        proofs = _records(store, loaded, lift, Stage.PROOF)
    except RecordUnusable as error:
        return Approval(None, f"its checkout record cannot be used: {error}")
    if not tests:
        return Approval(None, f"there is no checkout record of it in {store.parent}")
    newest = next(filter(_counts, tests), None)
    if newest is None:
        return Approval(None, f"the checkout that began on {_day(tests[0].started_at)} is not finished")
    later = next((proof for proof in proofs if _counts(proof) and proof.started_at > newest.started_at), None)
    if problem := _objection(newest, loaded, lift) or _failed_proof(later):
        return Approval(None, problem)
    return Approval(newest, "", tuple(_cautions(newest, later, now)))


def _counts(record: Record) -> bool:
    """Whether a test is finished, or has come far enough to say no: until then the one before it counts."""
    return record.ended_at is not None or bool(verdict(record).failed)


def _records(store: Path, loaded: LoadedSite, lift: str, stage: Stage) -> list[Record]:
    """Return the records of this lift, archived ones included, those that began last first. Raises RecordUnusable."""
    current = record_path(store, lift, stage)
    # one pattern for all lifts: a pattern of its own would have to be compiled for each
    archived = (file for file in store.parent.glob("*.json") if file.name.startswith(f"{current.stem}."))
    files = dict.fromkeys((current, *archived))
    found = [record for file in files if (record := load(file)) is not None]
    own = [record for record in found if (record.site, record.lift, record.stage) == (loaded.site.name, lift, stage)]
    return sorted(own, key=lambda record: record.started_at, reverse=True)


def _objection(record: Record, loaded: LoadedSite, lift: str) -> str:
    """Return why a record does not let robots use the lift; empty if it does."""
    found, day = verdict(record), _day(record.ended_at or record.started_at)
    if not found.passed:
        return f"its checkout of {day} is {found.text}"
    settings = lift_digest(loaded, lift)
    if mismatch := record.find_mismatch(map_sha256=loaded.maps[lift].sha256, lift_sha256=settings):
        return mismatch
    tested, now = (
        _address_text(record.controller.host, record.controller.port, record.controller.unit),
        _controller_address(loaded, lift),
    )
    if tested != now:
        return f"its controller was at {tested} at the checkout of {day}, and is at {now} now"
    if not found.is_signed:
        return f"its checkout of {day} is not signed as it is now"
    return ""


def _controller_address(loaded: LoadedSite, lift: str) -> str:
    spec = loaded.site.lifts[lift]
    device = devices(loaded.site, spec, loaded.maps[lift].map)[""]
    place = loaded.site.controllers[device.controller]
    return _address_text(place.host, place.port, device.unit_id)


def _address_text(host: str, port: int, unit: int) -> str:
    return f"{canonical_host(host)} port {port} unit id {unit}"


def _failed_proof(proof: Record | None) -> str:
    if proof is None or (found := verdict(proof)).passed:
        return ""
    return f"its proof test of {_day(proof.ended_at or proof.started_at)} is {found.text}"


def _cautions(record: Record, proof: Record | None, now: datetime) -> Iterator[str]:
    """Yield what people should know of a record that lets robots use the lift; `proof` is a later test that passed."""
    found = verdict(record)
    if found.conditions:
        yield f"robots may use it only under conditions: {'; '.join(found.conditions)}"
    if not found.is_handed_back:
        yield "nobody took it back into normal service after the checkout"
    newest = record if proof is None else proof
    proved = newest.ended_at or newest.started_at
    if now - proved > timedelta(days=PROOF_DAYS):
        yield f"the yearly proof test of fire and watchdog is due: the last one was on {_day(proved)}"


def _day(at: datetime) -> str:
    return f"{at:%Y-%m-%d}"
