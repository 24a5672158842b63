"""What a hub exports about its sites, their updates and its certificates, and its replies about updates."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from lift_manager.api.keys import KeyRing
from lift_manager.hub.metrics import HubMetrics
from lift_manager.hub.update.messages import Failure, Phase, Report
from lift_manager.hub.update.rollout import Rollout, Stop, Target
from lift_manager.hub.web import make_hub_app
from tests.lift_manager.hub.fake import FakeHub, fake_hub
from tests.lift_manager.web.fake import ask_app
from tests.support.certificates import Authority

AT = datetime(2026, 11, 29, tzinfo=UTC)
ROLLOUT = Rollout(
    id="r1",
    number=8,
    made_by="M. Weber",
    by="M. Weber",
    at=AT,
    canaries=("berlin",),
    targets={site: Target(size=1, sha256="") for site in ("berlin", "rome")},
    stopped=Stop(by="the hub", why="berlin has rolled it back", at=AT),
)
FAILED = Failure(number=8, rollout="r1", what="rolled back", why="goods is offline")


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[FakeHub]:
    with fake_hub(tmp_path, "berlin", "paris", "rome") as hub:
        yield hub


def scraped(hub: FakeHub) -> dict[str, dict[tuple[str, ...], float]]:
    """Every sample, by the values of its labels."""
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(HubMetrics(hub, {}).scrape("")[0].decode()):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sample.labels.values())] = sample.value
    return found


def test_a_roll_out_shows_how_far_each_site_is_and_by_which_update_it_runs(hub: FakeHub) -> None:
    before = scraped(hub)
    assert "lift_manager_hub_site_update_progress" not in before
    hub.roll_out(ROLLOUT, {"berlin": Report(installed=7, phase=Phase.IDLE, text="", healthy=True, failed=FAILED)})
    found = scraped(hub)
    assert found["lift_manager_hub_site_update_installed"] == {("berlin",): 7}
    assert found["lift_manager_hub_site_update_progress"] == {("berlin", "rolled back"): 1, ("rome", "not yet"): 1}


def test_the_reply_about_updates_says_what_runs_and_what_came_to_nothing(hub: FakeHub) -> None:
    app = make_hub_app(hub, KeyRing())
    assert ask_app(app, "GET", "/api/v1/sites/berlin/update").json() == {
        "site": "berlin",
        "reported_age_s": None,
        "installed": None,
        "phase": None,
        "text": "",
        "failed": None,
        "rollout": None,
    }
    waiting = Report(installed=7, phase=Phase.WAITING, text="goods has a session", healthy=True)
    failed = Report(installed=7, phase=Phase.IDLE, text="", healthy=True, failed=FAILED)
    hub.roll_out(ROLLOUT, {"berlin": failed, "rome": waiting})
    berlin, paris, rome = (ask_app(app, "GET", f"/api/v1/sites/{site}/update").json() for site in hub.fakes)
    assert berlin["installed"] == 7
    assert berlin["failed"] == {"number": 8, "what": "rolled back", "why": "goods is offline"}
    assert berlin["rollout"] == {
        "number": 8,
        "progress": "rolled back",
        "is_canary": True,
        "stopped": "the hub: berlin has rolled it back",
    }
    assert paris["rollout"] is None
    assert (rome["phase"], rome["text"]) == ("waiting", "goods has a session")
    assert (rome["rollout"]["progress"], rome["rollout"]["is_canary"]) == ("waiting", False)
    assert ask_app(app, "GET", "/api/v1/sites/oslo/update").json()["code"] == "unknown_site"


def test_how_long_each_certificate_is_valid_and_nothing_of_one_that_cannot_be_read(
    hub: FakeHub, tmp_path: Path
) -> None:
    authority = Authority(tmp_path)
    soon = authority.issue("soon", until=timedelta(days=10))
    tls = f"{{certificate: {soon.certificate}, key: {soon.key}}}"
    missing = tmp_path / "missing.pem"
    settings = f"http: {{tls: {tls}}}\nnats: {{ca: {authority.file}, tls: {{certificate: {missing}, key: {soon.key}}}}}"
    (hub.folder.path / "hub.yaml").write_text(settings)
    hub.certificates = hub.folder.certificates()
    left = scraped(hub)["lift_manager_hub_certificate_remaining_seconds"]
    assert left["api",] == pytest.approx(10 * 86_400, abs=3600)
    assert left["ca",] > 300 * 86_400
    assert left["nats",] == 0


def test_the_sites_of_each_state_are_counted(hub: FakeHub) -> None:
    hub.folder.switch_off("rome", "M. Weber", "its key was copied")
    hub.follow()
    hub.fakes["paris"].cut()
    found = scraped(hub)
    assert found["lift_manager_hub_sites"] == {
        ("online",): 1,
        ("offline",): 1,
        ("off",): 1,
        ("unknown",): 0,
        ("flooding",): 0,
    }
    assert found["lift_manager_hub_site_state"]["rome", "off"] == 1
