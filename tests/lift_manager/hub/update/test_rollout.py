"""Who may have an update when: canaries first, the others a few at a time, and nobody after a failure."""

from dataclasses import replace
from typing import Any

import pytest

from lift_manager.hub.update.messages import REQUEST_EVERY_S, Failure, Phase, Report
from lift_manager.hub.update.rollout import (
    Progress,
    Rollout,
    SiteStatus,
    Stop,
    Target,
    failure,
    is_offered,
    lacking,
    progress,
    reported,
)
from tests.lift_manager.hub.update.office import AT

SITES = ("berlin", "london", "paris", "rome")
ROLLOUT = Rollout(
    id="r1",
    number=8,
    made_by="M. Weber",
    by="M. Weber",
    at=AT,
    canaries=("berlin",),
    targets={site: Target(size=1, sha256="") for site in SITES},
    healthy_s=600.0,
    at_once=2,
)
OLD = Report(installed=7, phase=Phase.IDLE, text="", healthy=True)
DONE = Report(installed=8, phase=Phase.IDLE, text="", healthy=True)
TRIAL = replace(SiteStatus(), report=Report(installed=8, phase=Phase.TRIAL, text="", healthy=True))


def failed(**changes: Any) -> Report:
    failure = {"number": 8, "rollout": "r1", "what": "rolled back", "why": "goods is offline"} | changes
    return OLD.model_copy(update={"failed": Failure.model_validate(failure)})


def well(seconds: float, report: Report = DONE) -> SiteStatus:
    """A site that has reported every minute for this long; the last report is at that time."""
    known, now = SiteStatus(), 0.0
    while True:
        known = reported(known, report, ROLLOUT, now)
        if now >= seconds:
            return known
        now = min(now + REQUEST_EVERY_S, seconds)


def offered(sites: dict[str, SiteStatus], now: float = 600.0, rollout: Rollout = ROLLOUT) -> set[str]:
    return {site for site in SITES if is_offered(rollout, sites, site, now)}


def test_canaries_have_it_first_and_the_others_wait_until_these_have_run_well_for_long_enough() -> None:
    assert offered({}) == {"berlin"}
    assert offered({"berlin": TRIAL}) == {"berlin"}
    assert offered({"berlin": well(599.0)}, 599.0) == set()
    assert offered({"berlin": well(600.0)}) == {"london", "paris", "rome"}


def test_a_canary_that_is_silent_or_unwell_for_a_moment_begins_again() -> None:
    known = reported(well(500.0), DONE.model_copy(update={"healthy": False}), ROLLOUT, 560.0)
    known = reported(known, DONE, ROLLOUT, 620.0)
    assert offered({"berlin": known}, 620.0) == set()
    assert list(lacking(ROLLOUT, {"berlin": known}, 620.0)) == ["berlin has run well by it for 0 of 10 minutes"]
    silent = reported(well(300.0), DONE, ROLLOUT, 700.0)
    assert offered({"berlin": silent}, 700.0) == set()
    gone = well(600.0)
    assert offered({"berlin": gone}, 601.0 + 3 * REQUEST_EVERY_S) == set()


def test_only_so_many_sites_are_under_way_at_once() -> None:
    sites = {"berlin": well(600.0), "london": TRIAL, "paris": SiteStatus(OLD, 600.0, offered=True)}
    assert offered(sites) == {"london", "paris"}
    assert offered({**sites, "london": SiteStatus(DONE, 600.0)}) == {"paris", "rome"}


def test_a_site_that_has_it_is_offered_nothing() -> None:
    assert "london" not in offered({"berlin": well(600.0), "london": SiteStatus(DONE, 600.0)})
    newer = DONE.model_copy(update={"installed": 9})
    assert "london" not in offered({"berlin": well(600.0), "london": SiteStatus(newer, 600.0)})


def test_a_stopped_roll_out_is_offered_to_nobody_also_where_it_waits() -> None:
    stopped = ROLLOUT.model_copy(update={"stopped": Stop(by="the hub", why="x", at=AT)})
    waiting = SiteStatus(Report(installed=7, phase=Phase.WAITING, text="a session", healthy=True), 600.0, offered=True)
    assert offered({"berlin": well(600.0), "london": waiting}, rollout=stopped) == set()


@pytest.mark.parametrize(
    ("report", "offered", "word"),
    [
        (None, False, Progress.NOT_YET),
        (None, True, Progress.OFFERED),
        (OLD, True, Progress.OFFERED),
        (OLD.model_copy(update={"phase": Phase.WAITING}), True, Progress.WAITING),
        (TRIAL.report, True, Progress.TRIAL),
        (DONE, False, Progress.DONE),
        (failed(), False, Progress.ROLLED_BACK),
        (failed(what="refused"), False, Progress.REFUSED),
        (failed(number=7), False, Progress.NOT_YET),
        (failed(rollout="r0"), False, Progress.NOT_YET),
    ],
)
def test_how_far_a_site_is_follows_from_its_report(report: Report | None, offered: bool, word: Progress) -> None:
    assert progress(ROLLOUT, SiteStatus(report, offered=offered)) is word


def test_a_failure_of_this_roll_out_stops_it_and_one_of_another_does_not() -> None:
    assert failure(ROLLOUT, "paris", SiteStatus(failed())) == "paris has rolled it back: goods is offline"
    assert failure(ROLLOUT, "paris", SiteStatus(failed(what="refused", why="no map"))) == "paris has refused it: no map"
    assert failure(ROLLOUT, "paris", SiteStatus(failed(rollout="r0"))) == ""
    assert failure(ROLLOUT, "paris", SiteStatus(DONE)) == ""
