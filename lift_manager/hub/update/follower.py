"""The part of a running manager that takes configuration updates: it fetches them, waits for quiet, applies, and judges the trial.

It connects to nothing by itself: `request_updates` uses the connection of the site's face. Without it a trial is judged all the same.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass

from pydantic import BaseModel, ValidationError

from drivers.own_files import replace_file
from drivers.thread import in_thread
from lift_manager.hub.errors import HubSilent, UpdateRefused, file_errors
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import Installed, Version, apply, prove, roll_back, without_notes
from lift_manager.hub.update.messages import PART_BYTES, REQUEST_EVERY_S, Failure, Offer, PartRequest, Phase, Report
from lift_manager.hub.update.package import LARGEST
from lift_manager.hub.update.trial import Judgement, Trial
from lift_manager.lift.events import Alarm
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.state import Quality
from lift_manager.rides.ride import OVER
from lift_manager.runtime.bus import Occurrence
from lift_manager.runtime.site import Site

LOOK_EVERY_S = 5.0
"""How often to look at the lifts. Chosen: next to no work for a thousand of them."""
QUIET_S = 5.0
"""How long nothing may have been under way. Chosen: a fleet sends its next robot sooner."""
MOST_WAIT_S = 86_400.0
"""How long an update waits for quiet before it is refused. Chosen: every lift is quiet at some time of a day."""
CONFIRMED_S = 3 * REQUEST_EVERY_S
"""How long an offer counts that the hub has not repeated: a roll-out that was stopped must not go on at a site that is cut off."""

Request = Callable[[str, bytes], Awaitable[bytes]]
"""Sends a request of a kind to the hub, and returns its reply. Raises HubSilent."""
Stage = Callable[[], Awaitable[Version]]
"""Checks the package that has arrived. Raises UpdateRefused."""
RunBlocking = Callable[[Callable[[], None]], Awaitable[None]]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """An update that was checked, and is to be applied."""

    staged: Version
    rollout: str
    since: float


class Follower:
    """The updates of one site."""

    def __init__(self, installation: Installation, stage: Stage, run_blocking: RunBlocking = in_thread) -> None:
        """`run_blocking` runs what waits for the disk, without keeping the lifts waiting. Raises UpdateRefused."""
        self._installation, self._stage, self._run_blocking = installation, stage, run_blocking
        self._installed: Installed = installation.read()
        self._waiting: _Waiting | None = None
        self._refused: Failure | None = None
        """Refused by this process; one that was rolled back is in `_installed`."""
        self._text = ""
        self._confirmed_at = 0.0
        self._quiet_since: float | None = None
        self._trial: Trial | None = None
        self._alarm = ""
        self._change: Callable[[Installed], Installed] | None = None
        """What is written at the end of this process."""
        self._news = asyncio.Event()
        self._note: Callable[[Row], None] = lambda _: None
        self._is_healthy = True
        self.has_run = False
        """The manager has come up: what ends it afterwards is no failure to start."""

    @property
    def ends_for_restart(self) -> bool:
        """Whether the process was ended for another configuration."""
        return self._change is not None

    async def run(self, site: Site, note: Callable[[Row], None], stop: Callable[[], None]) -> None:
        """Judge the trial, and wait for quiet, until cancelled; `stop` ends the manager in order, and `finish` comes next."""
        self._note, self.has_run = note, True
        self._trial = Trial(_now()) if self._installed.on_trial else None
        with site.overhear(self._receive):
            while True:
                try:
                    await self._write_notes()
                    while not await self._look(site, _now()):  # noqa: ASYNC110  it waits for the lifts
                        await asyncio.sleep(LOOK_EVERY_S)
                    stop()
                    return
                # logged and not raised: the lifts do not depend on updates
                except Exception:  # noqa: BLE001
                    _log.exception("hub: a bug; the configuration stays as it is, and the lifts are served as before")
                await asyncio.sleep(REQUEST_EVERY_S)

    def finish(self, site: Site, *, released: bool) -> None:
        """Change the configuration, once everything is released and nothing is under way. Otherwise the next start is as this one was."""
        if self._change is None:
            return
        if why := (under_way(site) if released else "not every output could be verified as released"):
            _log.warning("the configuration stays as it is until another time: %s", why)
            return
        try:
            self._installation.write(self._change(self._installed))
        except UpdateRefused as error:
            _log.error("the configuration stays as it is: %s", error)

    async def request_updates(self, request: Request) -> None:
        """Report to the hub, and take what it offers, until cancelled."""
        silent = False
        while True:
            self._news.clear()
            try:
                await self._request_once(request)
                silent = False
            except HubSilent as error:
                if not silent:
                    _log.warning("hub: no configuration updates are known: %s", error)
                silent = True
            with suppress(TimeoutError):
                async with asyncio.timeout(REQUEST_EVERY_S):
                    await self._news.wait()

    def report(self) -> Report:
        """Return what the hub is told."""
        phase, text = Phase.IDLE, ""
        if self._installed.on_trial:
            trial = self._trial
            phase, text = Phase.TRIAL, "" if trial is None else f"{trial.why}{self._text and f'; {self._text}'}"
        elif self._waiting is not None:
            phase, text = Phase.WAITING, self._text
        failed = self._refused or self._installed.failed
        return Report(
            installed=self._installed.current.number,
            phase=phase,
            text=text[:1000],
            healthy=self._is_healthy,
            failed=failed,
        )

    # -- what the hub offers

    async def _request_once(self, request: Request) -> None:
        offer = await _requested(request, "offer", self.report(), Offer)
        if self._change is not None:
            return
        waiting = self._waiting
        if waiting is not None and (offer.number, offer.rollout) != (waiting.staged.number, waiting.rollout):
            self._row(f"configuration update {waiting.staged.number} is no longer offered, and is not applied")
            self._waiting, self._text = None, ""
            self._news.set()
        self._confirmed_at = _now()
        if offer.number is None or self._waiting is not None or self._installed.on_trial or self._has_failed(offer):
            return
        try:
            await self._fetch(request, offer)
            staged = await self._stage()
        except UpdateRefused as error:
            self._refuse(offer.number, offer.rollout, str(error))
            return
        self._refused = None
        self._waiting = _Waiting(staged, offer.rollout, _now())
        self._text = "it was just checked"
        self._row(
            f"configuration update {staged.number}, made by {staged.made_by} and signed with {staged.signed_by}, is checked; it is"
            " applied once nothing is under way"
        )
        self._news.set()

    def _has_failed(self, offer: Offer) -> bool:
        return any(
            failed is not None and (failed.number, failed.rollout) == (offer.number, offer.rollout)
            for failed in (self._refused, self._installed.failed)
        )

    async def _fetch(self, request: Request, offer: Offer) -> None:
        """Fetch the package that is offered, part by part. Raises HubSilent and UpdateRefused."""
        if not 0 < offer.size <= LARGEST or offer.number is None:
            raise UpdateRefused(f"the package has {offer.size:,} bytes, and {LARGEST:,} are the most")
        package = bytearray()
        while len(package) < offer.size:
            part = await request("part", _encoded(PartRequest(number=offer.number, at=len(package))))
            if not part or len(part) > PART_BYTES:
                raise HubSilent("a part of the update did not arrive")
            package += part
        if hashlib.sha256(package).hexdigest() != offer.sha256:
            raise HubSilent("the update that arrived is not the one that was offered")
        with file_errors(self._installation.incoming, "written"):
            await self._run_blocking(lambda: replace_file(self._installation.incoming, bytes(package)))

    def _refuse(self, number: int, rollout: str, why: str) -> None:
        self._refused = Failure(number=number, rollout=rollout, what="refused", why=why[:1000])
        self._waiting, self._text = None, ""
        self._row(f"configuration update {number} is refused: {why}")
        self._news.set()

    # -- what the lifts do

    def _receive(self, occurrence: Occurrence) -> None:
        event = occurrence.event
        # an alarm about one robot's session is about that robot
        if isinstance(event, Alarm) and event.holder is None and not self._alarm:
            self._alarm = f"{event.lift}: {event.text}"

    async def _look(self, site: Site, now: float) -> bool:
        """Look at the lifts once; returns whether the manager is to end now for another configuration."""
        names = site.lift_names()
        live = tuple(name for name in names if site.lasting_state(name).quality is Quality.LIVE)
        offline = [name for name in self._installed.live if name in names and name not in live]
        self._is_healthy = not offline
        change = await self._next_change(now, offline, live)
        if change is None:
            self._quiet_since = None
            return False
        if why := under_way(site):
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = now
        self._text = f"waits for a moment in which nothing is under way; {why or 'it is quiet just now'}"
        if self._quiet_since is None or now - self._quiet_since < QUIET_S:
            return False
        self._change = change
        _log.warning("the manager ends, to be started again with another configuration")
        return True

    async def _next_change(
        self, now: float, offline: list[str], live: tuple[str, ...]
    ) -> Callable[[Installed], Installed] | None:
        """Return what is to become of the configuration, once it is quiet; None for nothing."""
        if self._trial is not None:
            return await self._judged(self._trial.observed(now, offline, self._alarm))
        waiting = self._waiting
        if waiting is None or now - self._confirmed_at > CONFIRMED_S:
            return None
        if now - waiting.since > MOST_WAIT_S:
            self._refuse(
                waiting.staged.number,
                waiting.rollout,
                f"within {MOST_WAIT_S / 3600:g} h it never was quiet: {self._text}",
            )
            return None
        return lambda installed: apply(installed, waiting.staged, live, waiting.rollout)

    async def _judged(self, trial: Trial) -> Callable[[Installed], Installed] | None:
        self._trial = trial
        if trial.judgement is Judgement.PASSED:
            self._trial = None
            await self._write(prove(self._installed))
            await self._write_notes()
            self._news.set()
        if trial.judgement is not Judgement.FAILED:
            return None
        return lambda installed: roll_back(installed, trial.why)

    # -- the record

    async def _write(self, installed: Installed) -> None:
        self._installed = installed
        try:
            await self._run_blocking(lambda: self._installation.write(installed))
        except (UpdateRefused, OSError) as error:
            _log.error("%s; it is written at the next change", error)

    async def _write_notes(self) -> None:
        """Write down what happened while no journal was open."""
        for text in self._installed.notes:
            self._row(text)
        if self._installed.notes:
            await self._write(without_notes(self._installed))

    def _row(self, text: str) -> None:
        _log.warning("%s", text)
        self._note(Row(RowKind.MANAGER, text, data={"update": self._installed.current.number}))


def under_way(site: Site) -> str:
    """Return what is under way at a site, for people; empty if there is nothing."""
    for lift in site.lift_names():
        if why := site.under_way(lift):
            return f"{lift}: {why}"
    ride = next((ride for ride in site.rides.all() if ride.phase not in OVER), None)
    return "" if ride is None else f"{ride.lift}: a ride"


async def _requested(request: Request, kind: str, message: BaseModel, model: type[Offer]) -> Offer:
    try:
        return model.model_validate_json(await request(kind, _encoded(message)))
    except ValidationError as error:
        raise HubSilent("the hub sent a reply that cannot be read") from error


def _encoded(message: BaseModel) -> bytes:
    return message.model_dump_json().encode()


def _now() -> float:
    return asyncio.get_running_loop().time()
