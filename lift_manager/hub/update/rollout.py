"""A roll-out of an update at the hub: which site may have it when. Pure.

The canaries have it first. The others follow, a few at a time, once every canary has run well by it for a while. An update that one
site refuses or goes back from is offered to no further site, until a person begins another roll-out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum, unique

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from lift_manager.hub.update.messages import REQUEST_EVERY_S, Phase, Report

SILENT_S = 3 * REQUEST_EVERY_S
"""A site that has not reported for this long is not known to run well."""
HEALTHY_S = 1800.0
"""How long every canary runs well before the others follow. Chosen: three trials, and some rides at a busy site."""
LEAST_HEALTHY_S = 300.0
"""Chosen: more than SILENT_S, so that a hub that has just started hears every canary first."""
AT_ONCE = 20
"""How many sites may have an update before its trial is over. Chosen: as many as two people can visit within a day."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Target(_Part):
    """The package for a site."""

    size: int
    sha256: str


class Stop(_Part):
    """Who or what has stopped a roll-out."""

    by: str
    why: str
    at: AwareDatetime


class Rollout(_Part):
    """rollout.json: what a person has decided."""

    format: str = Field(default="lift-manager roll-out", pattern="^lift-manager roll-out$")
    version: int = Field(default=1, ge=1, le=1)
    id: str
    number: int
    made_by: str
    by: str
    """Who has begun it."""
    at: AwareDatetime
    canaries: tuple[str, ...]
    targets: Mapping[str, Target]
    """By site."""
    healthy_s: float = HEALTHY_S
    at_once: int = AT_ONCE
    stopped: Stop | None = None
    """By a person, or because of a site."""


@unique
class Progress(StrEnum):
    """How far a site is."""

    NOT_YET = "not yet"
    """Its turn has not come, or it has not asked since."""
    OFFERED = "offered"
    """It was told of the update, and has not reported since."""
    WAITING = "waiting"
    """It has checked the update, and waits for quiet."""
    TRIAL = "on trial"
    DONE = "done"
    REFUSED = "refused"
    ROLLED_BACK = "rolled back"


UNDER_WAY = frozenset({Progress.OFFERED, Progress.WAITING, Progress.TRIAL})
FAILED = frozenset({Progress.REFUSED, Progress.ROLLED_BACK})


@dataclass(frozen=True, slots=True)
class SiteStatus:
    """What the hub knows of a site. Times are monotonic seconds of the hub."""

    report: Report | None = None
    at: float | None = None
    """When it reported; None if that was before the hub was started."""
    healthy_since: float | None = None
    """Since when it has reported without a pause that it runs well by the update."""
    offered: bool = False


def reported(before: SiteStatus, report: Report, rollout: Rollout | None, now: float) -> SiteStatus:
    """Return what is known of a site after another report."""
    is_well = (
        rollout is not None and report.healthy and report.phase is Phase.IDLE and report.installed == rollout.number
    )
    since = None
    if is_well:
        went_on = before.healthy_since is not None and not _is_silent(before, now)
        since = before.healthy_since if went_on else now
    return replace(before, report=report, at=now, healthy_since=since)


def progress(rollout: Rollout, known: SiteStatus) -> Progress:
    """Return how far a site is with a roll-out."""
    report = known.report
    if report is None:
        return Progress.OFFERED if known.offered else Progress.NOT_YET
    failed = report.failed
    if failed is not None and (failed.number, failed.rollout) == (rollout.number, rollout.id):
        return Progress.REFUSED if failed.what == "refused" else Progress.ROLLED_BACK
    if report.installed >= rollout.number:
        return Progress.TRIAL if report.phase is Phase.TRIAL else Progress.DONE
    if report.phase is Phase.WAITING:
        return Progress.WAITING
    return Progress.OFFERED if known.offered else Progress.NOT_YET


def is_offered(rollout: Rollout, sites: Mapping[str, SiteStatus], site: str, now: float) -> bool:
    """Whether a site that asks now may have the update."""
    if rollout.stopped is not None or site not in rollout.targets:
        return False
    known = {name: progress(rollout, sites.get(name, SiteStatus())) for name in rollout.targets}
    if known[site] in UNDER_WAY:
        return True
    if known[site] is not Progress.NOT_YET:
        return False
    if site in rollout.canaries:
        return True
    if any(lacking(rollout, sites, now)):
        return False
    return sum(one in UNDER_WAY for one in known.values()) < rollout.at_once


def lacking(rollout: Rollout, sites: Mapping[str, SiteStatus], now: float) -> Iterator[str]:
    """Yield what the canaries still lack, for people."""
    for site in rollout.canaries:
        known = sites.get(site, SiteStatus())
        well_s = 0.0 if known.healthy_since is None or _is_silent(known, now) else now - known.healthy_since
        if well_s < rollout.healthy_s:
            yield f"{site} has run well by it for {well_s / 60:.0f} of {rollout.healthy_s / 60:.0f} minutes"


def _is_silent(known: SiteStatus, now: float) -> bool:
    return known.at is None or now - known.at > SILENT_S


def failure(rollout: Rollout, site: str, known: SiteStatus) -> str:
    """Return why a roll-out has to stop because of a site; empty if it has not."""
    word = progress(rollout, known)
    if word not in FAILED or known.report is None or known.report.failed is None:
        return ""
    return f"{site} has {'refused it' if word is Progress.REFUSED else 'rolled it back'}: {known.report.failed.why}"
