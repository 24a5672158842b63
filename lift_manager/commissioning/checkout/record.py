"""The record of an acceptance test: one JSON file per lift and stage, next to the store of its site.

Results are only ever added; the newest of an item counts. A result counts for as long as the parts of the map and of the site file
that its item depends on stay the same, which the digest of the item tells.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum, unique
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.own_files import read_own, replace_file
from lift_manager.plain.text import counted

VERSION: Literal[1] = 1
CALLED = "called_s"
"""The figure of a trip that says how long the robot waited for the open door."""
WRITTEN = "written: "
"""How a line of evidence begins that is about a write, and not for people."""


@unique
class Stage(StrEnum):
    """Which test it is. A factory acceptance test has the item numbers of the site acceptance test."""

    FAT = "fat"
    """Against a simulator or a controller on the desk."""
    SAT = "sat"
    """At the lift."""
    PROOF = "proof"
    """The yearly test of fire and watchdog: a part of the items."""


@unique
class Outcome(StrEnum):
    """What an item came to."""

    PASSED = "pass"
    FAILED = "fail"
    NOT_APPLICABLE = "not applicable"
    DOCUMENT = "proved by document"
    SKIPPED = "skipped"


@unique
class Severity(StrEnum):
    """How bad an open point is."""

    A = "A"
    """Robots may not use the lift before it is mended."""
    B = "B"
    """To be mended by a date; robots may use the lift under a condition until then."""
    C = "C"
    """A remark."""


@unique
class Topic(StrEnum):
    """What is settled before the test begins, and again before each abnormal test."""

    IO_LIST = "io_list"
    """Approved revision of the I/O list."""
    PERMIT = "permit"
    """Number of the permit to work."""
    INSTRUMENTS = "instruments"
    """Instruments and the date of their calibration."""
    CAR_EMPTY = "car_empty"
    LANDINGS = "landings_barricaded"
    FIRE_PANEL = "fire_panel_isolated"
    BACKUP_BEFORE = "backup_before"
    """The PLC program is backed up before the test."""
    BACKUP_AFTER = "backup_after"
    LATCHING = "technician_at_panel"
    """The lift technician stands at the panel, because outputs stay on if this computer stops."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class MapIdentity(_Part):
    """The register map that was tested."""

    name: str
    title: str = ""
    sha256: str
    """Of the file and the changes of the site."""
    lift_sha256: str = ""
    """Of what the site file adds: floors and their codes, doors, offset, unit and further devices."""


class ServedRange(_Part):
    """Addresses on the wire that the controller answers for."""

    table: str
    first: int
    last: int
    unit: int = 1


class ConstantWord(_Part):
    """A word or bit that did not change between readings while nobody used the lift, and belongs to no signal."""

    table: str
    address: int
    """On the wire."""
    value: int
    unit: int = 1


class Latency(_Part):
    """How long the controller took to answer, in milliseconds."""

    p50_ms: float
    p99_ms: float
    max_ms: float
    samples_ms: tuple[float, ...] = ()
    """In the order of measurement, for a histogram."""


class Fingerprint(_Part):
    """What can be known of a controller that has no identity of its own."""

    served: tuple[ServedRange, ...] = ()
    constants: tuple[ConstantWord, ...] = ()
    latency: Latency | None = None
    # excluded while it is empty, so that a record from before there was one keeps its hash
    identity: dict[str, str] = Field(default_factory=dict, exclude_if=lambda texts: not texts)
    """What the controller says that it is, by name, such as `vendor` and `revision`; empty if it says nothing or was not asked."""
    taken_at: AwareDatetime

    @property
    def sha256(self) -> str:
        """Hash of what stays the same from one day to the next, and is always read: not of latency and identity."""
        return _hash(self.model_dump(mode="json", include={"served", "constants"}))


class Controller(_Part):
    """The controller that was tested."""

    name: str
    """In the site file."""
    host: str
    port: int
    unit: int
    identity: str = ""
    """Maker, serial number and version of the program, as the lift technician reads them off."""
    fingerprint: Fingerprint | None = None


class Person(_Part):
    """Somebody who takes part."""

    name: str
    company: str = ""


class People(_Part):
    """Who takes part."""

    run_by: Person
    technician: Person | None = None
    """Of the lift company. Only this person disconnects or simulates an input."""
    witness: Person | None = None


class Instrument(_Part):
    """A measuring instrument."""

    name: str
    serial: str = ""
    calibrated: str = ""
    """The date, as on its label."""


class Precondition(_Part):
    """One answer about a condition of the test; the newest of a topic and item counts."""

    topic: Topic
    text: str
    """What was asked."""
    is_met: bool
    """False: skipped, with a reason."""
    value: str = ""
    """A revision, a number or a file name."""
    reason: str = ""
    item: str = ""
    """Before which item it was asked; empty for the beginning or the end of the test."""
    by: str
    at: AwareDatetime


class ItemPoint(_Part):
    """One address that an item is about."""

    name: str
    """The signal or command."""
    printed: str
    """As in the table of the vendor."""
    wire: str
    """As on the wire, such as `coil 12` or `holding 40.3`."""


class Item(_Part):
    """One thing to test. Its number is the same at every stage, and after a change of the map."""

    id: str
    """Such as `S-07`."""
    group: str
    title: str
    points: tuple[ItemPoint, ...] = ()
    action: str
    """What to do."""
    expected: str
    kind: str
    """The procedure, such as `signal` or `command`."""
    subject: str = ""
    """What it is done to: a signal, a command, a floor or a door."""
    is_abnormal: bool = False
    """Whether the preconditions are confirmed again before it."""
    estimate_s: float = 60.0
    digest: str
    """Of the parts of the map and the site file that it depends on."""


class Result(_Part):
    """What somebody found out about one item, once."""

    item: str
    digest: str
    """The digest of the item at that time."""
    outcome: Outcome
    by: str
    confirmed_by: str = ""
    """A second person who saw it."""
    began_at: AwareDatetime
    at: AwareDatetime
    note: str = ""
    """The reason of what was skipped, the document that proves it, or what was wrong, in a sentence."""
    photos: tuple[str, ...] = ()
    """Paths of files, relative to the folder of the record or absolute."""
    evidence: tuple[str, ...] = ()
    """What the controller showed and what people answered, a line each."""
    figures: dict[str, float] = Field(default_factory=dict)
    """Measured values by name; the unit ends the name, as in `door_opens_s`."""


class Confirmation(_Part):
    """A second person saw how an item came to its result."""

    item: str
    result: int
    """Which of the results of the record, counted from 1: an item that is done again needs another confirmation."""
    name: str
    by: Literal["phone"] = "phone"
    at: AwareDatetime


class Trip(_Part):
    """One whole trip of a robot, or one travel of the empty car."""

    number: int
    item: str
    from_: str = Field(alias="from")
    to: str
    at: AwareDatetime
    is_complete: bool
    text: str = ""
    """Why it was not completed."""
    figures: dict[str, float] = Field(default_factory=dict)
    """`called_s`, `opened_s`, `travel_s`, `door_opens_s`, `door_closes_s`, `total_s`, as far as they were seen."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, populate_by_name=True)


class PunchEntry(_Part):
    """An open point. Every item that failed or was skipped has one; the newest of a number counts."""

    number: int
    item: str = ""
    text: str
    severity: Severity
    condition: str = ""
    """Under which robots may use the lift meanwhile."""
    accepted_by: str = ""
    """Who accepts that condition; empty: it is not accepted."""
    due: str = ""
    raised_at: AwareDatetime
    closed_at: AwareDatetime | None = None
    closed_by: str = ""

    @property
    def is_open(self) -> bool:
        """Whether it is still to be mended."""
        return self.closed_at is None

    @property
    def is_accepted(self) -> bool:
        """Whether the lift may be used with it. A point of severity A cannot be accepted."""
        return self.severity is Severity.C or (self.severity is Severity.B and bool(self.accepted_by))


class AsBuiltChange(_Part):
    """A difference between the approved I/O list and what was found and tested."""

    subject: str
    approved: str
    as_built: str
    reason: str = ""
    by: str
    at: AwareDatetime


class HandBack(_Part):
    """The lift is given back to its passengers."""

    in_normal_service: bool
    handed_over_by: str
    taken_back_by: str
    at: AwareDatetime
    note: str = ""


@unique
class Role(StrEnum):
    """As what somebody signs."""

    RUN_BY = "run by"
    TECHNICIAN = "lift technician"
    WITNESS = "witness"
    OWNER = "owner"


class Signature(_Part):
    """A name under the record."""

    role: Annotated[Role, Field(strict=False)]
    name: str
    at: AwareDatetime
    statement: str = ""
    record_sha256: str
    """Hash of the record that was signed."""


class Record(_Part):
    """Everything about one acceptance test of one lift at one stage."""

    format: Literal["lift-manager checkout"] = "lift-manager checkout"
    version: Literal[1] = VERSION
    stage: Stage
    site: str
    lift: str
    floors: dict[str, int]
    """Code by name, lowest first."""
    map: MapIdentity
    controller: Controller
    versions: dict[str, str]
    """Of the programs that were used, such as `lift-manager`."""
    people: People
    instruments: tuple[Instrument, ...] = ()
    preconditions: tuple[Precondition, ...] = ()
    items: tuple[Item, ...]
    results: tuple[Result, ...] = ()
    # excluded while there are none, so that a record from before there were any keeps its hash
    confirmations: tuple[Confirmation, ...] = Field(default=(), exclude_if=lambda given: not given)
    """By a second person on the page for a phone; `confirmed_by` of a result is what was typed at the laptop."""
    trips: tuple[Trip, ...] = ()
    punch_list: tuple[PunchEntry, ...] = ()
    as_built: tuple[AsBuiltChange, ...] = ()
    hand_back: HandBack | None = None
    signatures: tuple[Signature, ...] = ()
    baseline: dict[str, Any] | None = None
    """The as-left findings of the doctor, as its JSON."""
    started_at: AwareDatetime
    ended_at: AwareDatetime | None = None

    @model_validator(mode="after")
    def _numbered_once(self) -> Self:
        ids = [item.id for item in self.items]
        if len(set(ids)) < len(ids):
            raise ValueError("two items have the same number")
        return self

    @property
    def sha256(self) -> str:
        """Hash of the record without its signatures, which is what people sign and what is printed on each page."""
        return _hash(self.model_dump(mode="json", by_alias=True, exclude={"signatures"}))

    @property
    def newest(self) -> Mapping[str, Result]:
        """The result that counts, by number of the item; none for an item that was not done, or has changed since."""
        digests = {item.id: item.digest for item in self.items}
        return {result.item: result for result in self.results if digests.get(result.item) == result.digest}

    def confirmations_of(self, result: Result) -> tuple[Confirmation, ...]:
        """Return who confirmed a result of this record on the page for a phone."""
        numbers = [number for number, one in enumerate(self.results, 1) if one is result]
        return tuple(one for one in self.confirmations if one.result in numbers)

    @property
    def punch(self) -> tuple[PunchEntry, ...]:
        """The newest state of each entry of the punch list, in order of their numbers."""
        newest = {entry.number: entry for entry in self.punch_list}
        return tuple(newest[number] for number in sorted(newest))

    def changed_since(self, item: Item) -> bool:
        """Whether an item was done before the map or the site file changed."""
        return item.id not in self.newest and any(result.item == item.id for result in self.results)

    def find_mismatch(self, *, map_sha256: str, lift_sha256: str | None = None, fingerprint: str | None = None) -> str:
        """Return what is no longer as it was tested, in a sentence for people; empty if everything given is the same."""
        if map_sha256 != self.map.sha256:
            return f"the map of {self.lift} has changed since the checkout (sha256 {map_sha256[:12]}, tested {self.map.sha256[:12]})"
        if lift_sha256 is not None and self.map.lift_sha256 and lift_sha256 != self.map.lift_sha256:
            return f"floors, doors, offset or unit of {self.lift} in the site file have changed since the checkout"
        tested = self.controller.fingerprint
        if fingerprint is not None and tested is not None and tested.sha256 != fingerprint:
            return f"the controller of {self.lift} is no longer the one that was tested, or its program has changed"
        return ""

    def matches(self, *, map_sha256: str, lift_sha256: str | None = None, fingerprint: str | None = None) -> bool:
        """Whether everything given is as it was tested."""
        return not self.find_mismatch(map_sha256=map_sha256, lift_sha256=lift_sha256, fingerprint=fingerprint)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a record says about its lift."""

    passed: bool
    """Robots may use the lift: nothing is open, or what is open is accepted under conditions."""
    conditionally: bool
    """Whether it passed under conditions."""
    remaining: tuple[str, ...]
    """Items without a result that counts."""
    failed: tuple[str, ...]
    skipped: tuple[str, ...]
    open_points: tuple[int, ...]
    """Numbers of entries of the punch list that are open and not accepted."""
    conditions: tuple[str, ...]
    is_handed_back: bool
    """The lift is in normal service again, and somebody took it back."""
    is_signed: bool
    """The person who ran it signed it as it is now, and so did the lift technician if there was one."""

    @property
    def complete(self) -> bool:
        """Whether every item has a result that counts."""
        return not self.remaining

    @property
    def text(self) -> str:
        """The verdict in a sentence."""
        if self.remaining:
            return f"not complete: no result of {counted(len(self.remaining), 'item')} ({_some(self.remaining)})"
        if not self.passed:
            bad = (*self.failed, *self.skipped)
            points = ", ".join(str(number) for number in self.open_points)
            return f"not passed: {_some(bad) or 'the punch list'}" + (f"; open points {points}" if points else "")
        return "passed under conditions" if self.conditionally else "passed"


def verdict(record: Record) -> Verdict:
    """Return what a record says about its lift.

    An item that failed or was skipped keeps the test from passing, unless an entry of the punch list about it is accepted or closed.
    """
    newest = record.newest
    of = {
        outcome: tuple(item.id for item in record.items if _outcome(newest, item.id) is outcome) for outcome in Outcome
    }
    remaining = tuple(item.id for item in record.items if item.id not in newest)
    settled = {entry.item for entry in record.punch if entry.is_accepted and entry.is_open}
    refused = tuple(entry.number for entry in record.punch if entry.is_open and not entry.is_accepted)
    bad = {*of[Outcome.FAILED], *of[Outcome.SKIPPED]}
    conditions = tuple(entry.condition or entry.text for entry in record.punch if entry.is_open and entry.is_accepted)
    return Verdict(
        passed=not remaining and not refused and bad <= settled,
        conditionally=bool(conditions),
        remaining=remaining,
        failed=of[Outcome.FAILED],
        skipped=of[Outcome.SKIPPED],
        open_points=refused,
        conditions=conditions,
        is_handed_back=record.hand_back is not None and record.hand_back.in_normal_service,
        is_signed=_is_signed(record),
    )


class RecordUnusable(Exception):
    """A record cannot be read or written; the text says why and what to do."""


def record_path(store: Path, lift: str, stage: Stage) -> Path:
    """Return the file of a record, next to the store of the site."""
    words = re.sub(r"[^0-9A-Za-z.]+", "-", lift).strip("-.").lower()
    digest = hashlib.sha256(lift.encode()).hexdigest()[:8]
    return store.with_name(f"{store.stem}.checkout.{words or 'lift'}-{digest}.{stage}.json")


def archive_path(path: Path, record: Record) -> Path:
    """Return where a finished record is kept when a new test of the same stage begins."""
    return path.with_name(f"{path.stem}.{record.started_at.astimezone(UTC):%Y%m%dT%H%M%SZ}.json")


def save(path: Path, record: Record) -> None:
    """Replace the file durably, or leave it as it was. Raises RecordUnusable."""
    try:
        replace_file(path, record.model_dump_json(indent=1, by_alias=True).encode() + b"\n")
    except OSError as error:
        raise RecordUnusable(f"{path} cannot be written ({error.strerror or error})") from error


def load(path: Path) -> Record | None:
    """Return the record in a file; None without one. Raises RecordUnusable."""
    try:
        data, _ = read_own(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordUnusable(f"{path} cannot be read ({error.strerror or error})") from error
    try:
        head = json.loads(data)
        found = head.get("version") if isinstance(head, dict) else None
        if isinstance(found, int) and found != VERSION:
            raise RecordUnusable(
                f"{path} has version {found}; start the version that wrote it: this one reads version {VERSION}"
            )
        return Record.model_validate_json(data)
    except (ValidationError, ValueError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}" if first else str(error)
        raise RecordUnusable(
            f"{path} is no record of a checkout ({what}); restore a copy of it, or move it away"
        ) from error


def now() -> datetime:
    """Return the time of the clock, to the millisecond, as records have it."""
    at = datetime.now(UTC)
    return at.replace(microsecond=at.microsecond // 1000 * 1000)


def _outcome(newest: Mapping[str, Result], item: str) -> Outcome | None:
    return newest[item].outcome if item in newest else None


def _is_signed(record: Record) -> bool:
    needed = {Role.RUN_BY} | ({Role.TECHNICIAN} if record.people.technician is not None else set())
    hashed = record.sha256
    return needed <= {one.role for one in record.signatures if one.record_sha256 == hashed}


def _hash(data: object) -> str:
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _some(ids: Iterable[str]) -> str:
    names = list(ids)
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
