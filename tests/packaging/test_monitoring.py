"""What dashboard and alert rules ask for is what a manager and a hub export."""

import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from drivers.model import Command, CommandKind, Outcome, Result
from lift_manager.hub.metrics import HubMetrics
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.update.messages import Phase, Report
from lift_manager.hub.update.rollout import Progress, Rollout, Target
from lift_manager.lift.events import CommandEnded, SessionEnded, SessionOpened
from lift_manager.lift.session import EndReason, Holder
from tests.lift_manager.hub.fake import fake_hub
from tests.lift_manager.metrics.measured import Rig, measured
from tests.support.rows import each_row

DEPLOY = Path(__file__).parents[2] / "deploy"
DASHBOARD = json.loads((DEPLOY / "grafana/lift-manager.json").read_text("utf-8"))
ALERTS = yaml.safe_load((DEPLOY / "prometheus/alerts.yml").read_text("utf-8"))
RULES = [rule for group in ALERTS["groups"] for rule in group["rules"]]
OF_PROMETHEUS = {"instance", "job", "le"}
"""Labels that every series has, or every histogram."""
FUNCTIONS = {
    *("sum", "by", "count", "vector", "rate", "increase", "histogram_quantile", "max_over_time", "label_values"),
    *("and", "or"),
}
_MATCHERS = re.compile(r"([a-z_]\w*)\s*\{([^}]*)\}")
_ON = re.compile(r"\bon \(instance\)")
_BY = re.compile(r"\bby \(([^)]*)\)")
_WORDS = re.compile(r"[a-zA-Z_]\w*")
_STRINGS = re.compile(r'"[^"]*"')
_RANGES = re.compile(r"\[[^\]]*\]")


def exported() -> dict[str, set[str]]:
    """Every sample that a manager exports, with its labels."""
    found: dict[str, set[str]] = {"up": set()}
    robot = Holder("api", "robot")

    async def check(rig: Rig) -> None:
        rig.site.refusals.count("lift", "held")
        rig.publish(
            SessionOpened("lift", robot, "L1"),
            SessionEnded("lift", robot, EndReason.LEASE, "", None),
            CommandEnded("lift", Outcome(Command(CommandKind.GO_TO, "L1"), Result.REJECTED)),
        )
        for name, of_name in (await rig.read()).items():
            found[name] = {label for labels in of_name for label, _ in labels}

    measured(check)
    return found | exported_by_hub()


def exported_by_hub() -> dict[str, set[str]]:
    """The same of a hub."""
    with TemporaryDirectory() as folder, fake_hub(Path(folder), "berlin") as hub:
        hub.fakes["berlin"].report(behind=1)
        hub.certificates = {"api": None}
        report = Report(installed=7, phase=Phase.IDLE, text="", healthy=True)
        rollout = Rollout(
            id="r1",
            number=8,
            made_by="",
            by="",
            at=datetime.now(UTC),
            canaries=(),
            targets={"berlin": Target(size=1, sha256="")},
        )
        hub.roll_out(rollout, {"berlin": report})
        body, _ = HubMetrics(hub, {"held": 1}).scrape("")
    samples = [sample for family in text_string_to_metric_families(body.decode()) for sample in family.samples]
    return {sample.name: set(sample.labels) for sample in samples}


EXPORTED = exported()


def asked() -> Iterator[tuple[str, str]]:
    """Yield every expression, with where it stands."""
    for rule in RULES:
        yield rule["alert"], rule["expr"]
    for panel in DASHBOARD["panels"]:
        for target in panel.get("targets", ()):
            yield panel["title"], target["expr"]
    for variable in DASHBOARD["templating"]["list"]:
        if variable["type"] == "query":
            query = variable["query"]["query"]
            yield f"variable {variable['name']}", re.sub(r", \w+\)$", ")", query)


@each_row(("where", "expression"), list(asked()))
def test_every_metric_and_every_label_that_is_asked_for_is_exported(where: str, expression: str) -> None:
    asks_for_what_is_exported(where, expression)


def asks_for_what_is_exported(where: str, expression: str) -> None:
    labels = {label for group in _BY.findall(expression) for label in _WORDS.findall(group)}
    metrics: set[str] = set()
    for metric, matchers in _MATCHERS.findall(expression):
        assert metric in EXPORTED, where
        told = set(re.findall(r"(\w+)\s*[=!]~?", matchers))
        assert told <= EXPORTED[metric] | OF_PROMETHEUS, where
    bare = _RANGES.sub("", _STRINGS.sub("", _BY.sub("", _ON.sub("", re.sub(r"\{[^}]*\}", "", expression)))))
    metrics = set(_WORDS.findall(bare)) - FUNCTIONS
    assert metrics, where
    assert metrics <= EXPORTED.keys(), where
    assert labels <= {label for metric in metrics for label in EXPORTED[metric]} | OF_PROMETHEUS, where


@each_row(
    "expression",
    [
        "lift_manager_lift_lives == 0",
        'lift_manager_lift_live{floor="L1"} == 0',
        "sum by (door) (lift_manager_lift_live)",
    ],
)
def test_a_name_that_nobody_exports_is_found(expression: str) -> None:
    with pytest.raises(AssertionError):
        asks_for_what_is_exported("here", expression)


@each_row("rule", RULES)
def test_every_alert_says_what_is_wrong_and_what_to_do(rule: dict[str, Any]) -> None:
    said = rule["annotations"]
    assert set(rule["labels"]) == {"severity"}
    assert rule["labels"]["severity"] in {"info", "warning", "critical"}
    assert len(said["summary"]) < 120
    assert len(said["description"]) > 60
    kept = {label for group in _BY.findall(rule["expr"]) for label in _WORDS.findall(group)}
    for label in re.findall(r"\$labels\.(\w+)", said["summary"] + said["description"]):
        # what stands on the left decides which labels an alert has
        left = rule["expr"].partition(" and on ")[0]
        metrics = set(_WORDS.findall(re.sub(r"\{[^}]*\}", "", left))) & EXPORTED.keys()
        assert label in kept or (not kept and any(label in EXPORTED[name] | OF_PROMETHEUS for name in metrics))


def test_the_dashboard_can_be_imported_anywhere() -> None:
    assert [asked["pluginId"] for asked in DASHBOARD["__inputs"]] == ["prometheus"]
    sources = [panel["datasource"]["uid"] for panel in DASHBOARD["panels"] if panel["type"] != "row"]
    assert set(sources) == {"${datasource}"}
    ids = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(ids) == len(set(ids))


def test_the_example_scrapes_the_jobs_that_the_alerts_ask_for() -> None:
    jobs = yaml.safe_load((DEPLOY / "prometheus/scrape.yml").read_text("utf-8"))
    assert [job["job_name"] for job in jobs] == ["lift-manager", "lift-manager-hub"]
    for job in jobs:
        name = job["job_name"]
        assert any(f'job="{name}"' in rule["expr"] for rule in RULES)
        assert job["authorization"] == {"type": "Bearer", "credentials_file": f"/etc/prometheus/{name}.key"}


def test_a_rule_about_states_or_progress_names_one_that_there_is() -> None:
    words = {"state": {state.value for state in SiteState}, "progress": {progress.value for progress in Progress}}
    for label, values in words.items():
        named = {
            word
            for rule in RULES
            for found in re.findall(rf'lift_manager_hub\w+{{{label}=~?"([^"]*)"', rule["expr"])
            for word in found.split("|")
        }
        assert named
        assert named <= values
