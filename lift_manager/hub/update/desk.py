"""The updates of a hub: stores packages and the roll-out, and replies to sites that ask.

updates/rollout.json     the roll-out, as people have decided it
updates/reports.json     what each site has reported last
updates/8/ID.update      packages
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict, RootModel, ValidationError

from drivers.own_files import read_own, replace_file
from lift_manager.hub.errors import UpdateRefused, file_errors
from lift_manager.hub.update.messages import PART_BYTES, Offer, PartRequest, Report
from lift_manager.hub.update.package import ENDING, read_package
from lift_manager.hub.update.rollout import (
    AT_ONCE,
    HEALTHY_S,
    LEAST_HEALTHY_S,
    Progress,
    Rollout,
    SiteStatus,
    Stop,
    Target,
    failure,
    is_offered,
    progress,
    reported,
)


class _Reports(RootModel[Mapping[str, Report]]):
    model_config = ConfigDict(frozen=True)


class SiteProgress(BaseModel):
    """How far a site is with the roll-out, and why."""

    site: str
    progress: Progress
    installed: int | None
    text: str


@dataclass(frozen=True, slots=True)
class Happened:
    """What the hub records as an event about a site."""

    site: str
    number: int
    progress: str
    text: str


class UpdateFiles:
    """The folder `updates` of a hub. Every method raises UpdateRefused."""

    def __init__(self, hub_folder: Path) -> None:
        self._folder = hub_folder / "updates"
        self._rollout, self._reports = self._folder / "rollout.json", self._folder / "reports.json"

    def changed_at(self) -> int:
        """Return what changes with the roll-out; 0 while there is none."""
        try:
            return self._rollout.stat().st_mtime_ns
        except OSError:
            return 0

    def rollout(self) -> Rollout | None:
        """Return the newest roll-out; None if there was none."""
        data = self._read(self._rollout)
        try:
            return None if data is None else Rollout.model_validate_json(data)
        except ValidationError as error:
            raise UpdateRefused(f"{self._rollout} cannot be used; offer the update again: {error}") from error

    def reports(self) -> Mapping[str, Report]:
        """Return what each site has reported last; none where they cannot be read: the sites report again within a minute."""
        data = self._read(self._reports)
        try:
            return {} if data is None else _Reports.model_validate_json(data).root
        except ValidationError:
            return {}

    def begin(
        self,
        packages: Iterable[Path],
        canaries: Collection[str],
        sites: Collection[str],
        by: str,
        *,
        healthy_s: float = HEALTHY_S,
        at_once: int = AT_ONCE,
    ) -> Rollout:
        """Store packages, and begin their roll-out in place of the one before."""
        found = {path: (data := self._package(path), read_package(data)) for path in packages}
        numbers = {content.number for _, content in found.values()}
        if len(numbers) != 1:
            raise UpdateRefused(
                f"offer the packages of one update; these are {', '.join(map(str, sorted(numbers))) or 'none'}"
            )
        targets = {content.site: data for data, content in found.values()}
        if unknown := sorted(targets.keys() - set(sites)):
            raise UpdateRefused(f"this hub has no site {', '.join(unknown)}; leave it out with --skip, or add it")
        if not canaries or not targets.keys() >= set(canaries):
            raise UpdateRefused(
                f"name the sites that have it first with --canary: some of {', '.join(sorted(targets))}"
            )
        if healthy_s < LEAST_HEALTHY_S:
            raise UpdateRefused(f"canaries have to run well for {LEAST_HEALTHY_S / 60:.0f} minutes at least")
        number = numbers.pop()
        rollout = Rollout(
            id=secrets.token_hex(8),
            number=number,
            made_by=next(content.made_by for _, content in found.values()),
            by=by,
            at=datetime.now(UTC),
            canaries=tuple(sorted(set(canaries))),
            targets={
                site: Target(size=len(data), sha256=hashlib.sha256(data).hexdigest()) for site, data in targets.items()
            },
            healthy_s=healthy_s,
            at_once=at_once,
        )
        for site, data in targets.items():
            self._write(self._path(number, site), data)
        self.write(rollout)
        return rollout

    def stop(self, by: str, why: str) -> Rollout:
        """Stop the roll-out: it is offered to no further site, and withdrawn where it waits."""
        rollout = self.rollout()
        if rollout is None or rollout.stopped is not None:
            raise UpdateRefused("no roll-out is under way")
        stopped = rollout.model_copy(update={"stopped": Stop(by=by, why=why, at=datetime.now(UTC))})
        self.write(stopped)
        return stopped

    def write(self, rollout: Rollout) -> None:
        """Replace the roll-out."""
        self._write(self._rollout, rollout.model_dump_json(indent=1).encode() + b"\n")

    def write_reports(self, reports: Mapping[str, Report]) -> None:
        """Replace the reports."""
        self._write(self._reports, _Reports(reports).model_dump_json(indent=1).encode() + b"\n")

    def part(self, site: str, number: int, at: int) -> bytes:
        """Return a part of the package of a site."""
        try:
            with self._path(number, site).open("rb") as file:
                file.seek(at)
                return file.read(PART_BYTES)
        except OSError as error:
            raise UpdateRefused(
                f"the package of update {number} for {site} cannot be read ({error.strerror})"
            ) from error

    def _path(self, number: int, site: str) -> Path:
        return self._folder / str(number) / f"{site}{ENDING}"

    @staticmethod
    def _package(path: Path) -> bytes:
        with file_errors(path, "read"):
            return path.read_bytes()

    @staticmethod
    def _read(path: Path) -> bytes | None:
        with file_errors(path, "read"), suppress(FileNotFoundError):
            return read_own(path)[0]
        return None

    @staticmethod
    def _write(path: Path, data: bytes) -> None:
        with file_errors(path, "written"):
            replace_file(path, data)


@dataclass(frozen=True, slots=True)
class SiteUpdate:
    """How a site stands with configuration updates."""

    status: SiteStatus
    rollout: Rollout | None
    """The newest roll-out; None if it is not for this site."""

    @property
    def progress(self) -> Progress | None:
        """How far the site is with it."""
        return None if self.rollout is None else progress(self.rollout, self.status)


class Desk:
    """Replies to sites. Not for several threads at once, but for `update_of`; `now` is in monotonic seconds."""

    def __init__(self, files: UpdateFiles) -> None:
        self._files = files
        self._changed_at = -1
        self._rollout: Rollout | None = None
        self._sites: dict[str, SiteStatus] = {}

    def update_of(self, site: str) -> SiteUpdate:
        """Return how a site stands; from memory, and from any thread."""
        rollout = self._rollout
        is_for_it = rollout is not None and site in rollout.targets
        return SiteUpdate(self._sites.get(site, SiteStatus()), rollout if is_for_it else None)

    def offer(self, site: str, data: bytes, now: float) -> tuple[Offer, list[Happened]]:
        """Take a report, and return what is offered to its site, and what has happened. Raises ValidationError and UpdateRefused."""
        report = Report.model_validate_json(data)
        self.refresh()
        rollout, before = self._rollout, self._sites.get(site, SiteStatus())
        self._sites[site] = known = reported(before, report, rollout, now)
        if rollout is None:
            return Offer(), []
        was, happened = progress(rollout, before), []
        if (why := failure(rollout, site, known)) and rollout.stopped is None:
            rollout = self._rollout = self._files.stop("the hub", why)
            happened.append(
                Happened(site, rollout.number, "stopped", f"the roll-out is offered to no further site: {why}")
            )
        offers = is_offered(rollout, self._sites, site, now)
        self._sites[site] = known = replace(known, offered=offers)
        word = progress(rollout, known)
        if word is not was:
            happened.insert(0, Happened(site, rollout.number, word.value, _text(report)))
            self._files.write_reports({name: one.report for name, one in self._sites.items() if one.report is not None})
        if not offers or word is Progress.TRIAL:
            return Offer(), happened
        target = rollout.targets[site]
        return Offer(number=rollout.number, rollout=rollout.id, size=target.size, sha256=target.sha256), happened

    def part(self, site: str, data: bytes) -> bytes:
        """Return a part of the package that is offered to a site. Raises ValidationError and UpdateRefused."""
        request = PartRequest.model_validate_json(data)
        rollout = self._rollout
        if rollout is None or rollout.number != request.number or not self._sites.get(site, SiteStatus()).offered:
            raise UpdateRefused(f"update {request.number} is not offered to {site}")
        return self._files.part(site, request.number, request.at)

    def refresh(self) -> None:
        """Read the roll-out again after a person has changed it. Another one begins with what is known of the sites. Raises UpdateRefused."""
        changed_at = self._files.changed_at()
        if changed_at == self._changed_at:
            return
        is_first, before = self._changed_at == -1, self._rollout
        self._rollout, self._changed_at = self._files.rollout(), changed_at
        if is_first:
            self._sites = {site: SiteStatus(report) for site, report in self._files.reports().items()}
        elif before is None or self._rollout is None or before.id != self._rollout.id:
            self._sites = {site: SiteStatus(one.report, one.at) for site, one in self._sites.items()}


def standing(rollout: Rollout, reports: Mapping[str, Report]) -> list[SiteProgress]:
    """Return how far each site of a roll-out is, as it has reported last."""
    return [
        SiteProgress(
            site=site,
            progress=progress(rollout, SiteStatus(report)),
            installed=None if report is None else report.installed,
            text="" if report is None else _text(report),
        )
        for site in sorted(rollout.targets)
        for report in (reports.get(site),)
    ]


def _text(report: Report) -> str:
    return report.failed.why if report.failed is not None and not report.text else report.text
