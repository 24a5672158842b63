"""The bodies of the hub's own routes, and which role each needs."""

from __future__ import annotations

import json
from typing import Literal

from pydantic import AwareDatetime, Field

from lift_manager.api.fields import Answer, RequestModel, Seconds, ShortName, Words
from lift_manager.api.roles import AccessLevel, LiftIn, Route
from lift_manager.hub.messages import RemoteLift, RemoteRide
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.rows import StoredEvent
from lift_manager.hub.update.desk import SiteUpdate
from lift_manager.hub.update.messages import Phase
from lift_manager.hub.update.rollout import Progress

_GET, _POST, _FILE = ("GET",), ("POST",), ("GET", "HEAD")
_SITE = "/api/v1/sites/{site}"

ROUTES: tuple[Route, ...] = (
    Route(_GET, "/", AccessLevel.NOTHING),
    Route(_FILE, "/page/{path:path}", AccessLevel.NOTHING),
    Route(_FILE, "/hub/{path:path}", AccessLevel.NOTHING),
    Route(_GET, "/errors", AccessLevel.NOTHING),
    Route(_GET, "/docs", AccessLevel.NOTHING),
    Route(_FILE, "/docs/{path:path}", AccessLevel.NOTHING),
    Route(_GET, "/redoc", AccessLevel.NOTHING),
    Route(_FILE, "/redoc/{path:path}", AccessLevel.NOTHING),
    Route(_FILE, "/openapi.json", AccessLevel.NOTHING),
    Route(_GET, "/healthz", AccessLevel.NOTHING),
    Route(_GET, "/readyz", AccessLevel.NOTHING),
    Route(_GET, "/metrics", AccessLevel.READ),
    Route(("GET", "POST"), "/api/v1/login", AccessLevel.READ),
    Route(_POST, "/api/v1/logout", AccessLevel.READ),
    Route(_GET, "/api/v1/sites", AccessLevel.READ),
    Route(_GET, "/api/v1/events", AccessLevel.READ),
    Route(_GET, _SITE, AccessLevel.READ),
    Route(_GET, f"{_SITE}/events", AccessLevel.READ),
    Route(_GET, f"{_SITE}/update", AccessLevel.READ),
    Route(_POST, f"{_SITE}/off", AccessLevel.OPERATE),
    Route(_POST, f"{_SITE}/on", AccessLevel.OPERATE),
    Route(_POST, f"{_SITE}/tickets", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_GET, f"{_SITE}/lifts", AccessLevel.READ),
    Route(_GET, f"{_SITE}/rides", AccessLevel.READ),
    Route(_POST, f"{_SITE}/rides", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_GET, f"{_SITE}/rides/{{ride}}", AccessLevel.READ),
    Route(_POST, f"{_SITE}/rides/{{ride}}/cancel", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_GET, f"{_SITE}/lifts/{{lift}}", AccessLevel.READ, LiftIn.PATH),
    Route(_POST, f"{_SITE}/lifts/{{lift}}/commands", AccessLevel.COMMAND, LiftIn.PATH),
)
"""All requests that a hub serves."""


class Off(Answer):
    """Who switched a site off, and why."""

    by: str
    reason: str
    at: AwareDatetime


class RemoteSiteInfo(Answer):
    """One site, as far as the hub knows without contacting it."""

    id: str = Field(examples=["berlin"])
    name: str = Field(description="As its site file has it; empty before the first news.")
    state: SiteState
    news_age_s: Seconds | None = Field(
        description="How long ago the newest news arrived, on the clock of the hub; null before the first."
    )
    version: str
    lifts: int = Field(description="How many lifts it has, according to the newest news.")
    live: int = Field(description="How many of them could be read then.")
    commands: bool = Field(description="Whether it takes commands from the hub.")
    rows_behind: int | None = Field(
        description="How many rows of its journal the hub has still to read, as far as it knows; null while the site has no stream."
    )
    off: Off | None = Field(description="Who switched it off; null while it is not.")


class SitesAnswer(Answer):
    """The sites of the hub."""

    sites: tuple[RemoteSiteInfo, ...]


class RemoteLiftsAnswer(Answer):
    """The lifts of a site, requested from it for this reply."""

    site: str
    round_trip_s: Seconds = Field(
        description="How long request and reply took. A reading is at most its `age_s` plus this old when the hub sends it."
    )
    lifts: tuple[RemoteLift, ...]


class RemoteLiftAnswer(Answer):
    """One lift of a site, requested from it for this reply."""

    site: str
    round_trip_s: Seconds = Field(description="How long request and reply took.")
    lift: RemoteLift


class RemoteRidesAnswer(Answer):
    """The rides of a site, requested from it for this reply."""

    site: str
    round_trip_s: Seconds = Field(description="How long request and reply took.")
    rides: tuple[RemoteRide, ...]


class RemoteRideAnswer(Answer):
    """One ride of a site, requested from it for this reply."""

    site: str
    round_trip_s: Seconds = Field(description="How long request and reply took.")
    ride: RemoteRide


class Lost(Answer):
    """An event: it is unknown what this reader has missed."""

    event: Literal["lost"] = "lost"
    text: str


class SiteEvent(Answer):
    """An event of a site as people read it: without what is for programs alone, such as the maps of a row about a start."""

    number: int = Field(
        description="The number of the event in the database of the hub; newer events have higher ones."
    )
    event: Literal["row", "gap", "site", "update"]
    at: int | None = Field(
        default=None,
        description="Microseconds since 1970, of a row on the clock of the site, else on that of the hub; null where it is not known.",
    )
    kind: str = Field(default="", description="Of a row: what it is about.")
    lift: str = Field(default="", description="Of a row; empty where it concerns the whole site.")
    caller: str = Field(default="", description="Of a row.")
    text: str = ""
    state: str = Field(default="", description="Of a `site` event.")
    first: int | None = Field(default=None, description="Of a gap: the number of the first row that is missing.")
    last: int | None = Field(default=None, description="The number of the last one.")
    update: int | None = Field(default=None, description="Of an `update` event: the number of the update.")
    progress: str = Field(default="", description="How far the site is with it.")

    @classmethod
    def of(cls, stored: StoredEvent) -> SiteEvent:
        """Return an event that the hub has stored."""
        found = json.loads(stored.text)
        update = found.pop("number", None)
        known = {name: found[name] for name in cls.model_fields if name in found}
        return cls(number=stored.number, update=update, **known)


class SiteEventsAnswer(Answer):
    """The newest events of a site, the newest first."""

    site: str
    events: tuple[SiteEvent, ...]


class FailedUpdate(Answer):
    """An update that a site has refused, or has gone back from."""

    number: int
    what: Literal["refused", "rolled back"]
    why: str


class SiteRollout(Answer):
    """The newest roll-out of an update, as far as it concerns one site."""

    number: int = Field(description="Of the update.")
    progress: Progress = Field(description="How far the site is with it.")
    is_canary: bool = Field(description="Whether the site has it first.")
    stopped: str = Field(description="Why it is offered to no further site; empty while it is under way.")


class SiteUpdateAnswer(Answer):
    """How a site stands with configuration updates, as it has reported last."""

    site: str
    reported_age_s: Seconds | None = Field(
        description="How long ago it reported, on the clock of the hub; null if it has not since the hub was started."
    )
    installed: int | None = Field(
        description="The number of the update by which it runs; 0 for none, null if it has never reported."
    )
    phase: Phase | None = Field(description="What it does with updates at the moment; null if it has never reported.")
    text: str = Field(description="What it waits for, or what it lacks.")
    failed: FailedUpdate | None = Field(description="The newest update that came to nothing; null for none.")
    rollout: SiteRollout | None = Field(description="The newest roll-out; null if it is not for this site.")

    @classmethod
    def of(cls, site: str, found: SiteUpdate, now: float) -> SiteUpdateAnswer:
        """Return how a site stands at a moment, in monotonic seconds of the hub."""
        report, rollout, progress = found.status.report, found.rollout, found.progress
        failed = None if report is None else report.failed
        shown = None
        if rollout is not None and progress is not None:
            stopped = "" if rollout.stopped is None else f"{rollout.stopped.by}: {rollout.stopped.why}"
            shown = SiteRollout(
                number=rollout.number, progress=progress, is_canary=site in rollout.canaries, stopped=stopped
            )
        return cls(
            site=site,
            reported_age_s=None if found.status.at is None else now - found.status.at,
            installed=None if report is None else report.installed,
            phase=None if report is None else report.phase,
            text="" if report is None else report.text,
            failed=None if failed is None else FailedUpdate(number=failed.number, what=failed.what, why=failed.why),
            rollout=shown,
        )


class SwitchOffRequest(RequestModel):
    """Switch a site off."""

    by: ShortName = Field(examples=["M. Weber"])
    reason: Words = Field(examples=["its key was copied"])


class SwitchOnRequest(RequestModel):
    """Switch a site on."""

    by: ShortName = Field(examples=["M. Weber"])


class SwitchedAnswer(Answer):
    """The site is switched; the NATS server follows within a second."""

    site: str
    off: Off | None
