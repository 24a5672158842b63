"""A run of doctor as data, as lines and compared with an earlier one."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import ConnectProblem
from lift_manager.commissioning.doctor.evidence import Probe
from lift_manager.commissioning.doctor.report import (
    NotAReport,
    Report,
    as_json,
    differences,
    lines,
    read_report,
    summary,
)
from register_maps.words import Table
from tests.support.planted import Mistake, examine, inverted, subjects_of
from tests.support.rows import each_row

H = Table.HOLDING
PROBED = Mistake(probes=(Probe.UNIT, Probe.RANGE, Probe.BLOCK, Probe.SLOT))


def run(mistake: Mistake, folder: Path) -> Report:
    return examine(mistake, folder)[0]


def kept(mistake: Mistake, folder: Path) -> Mapping[str, Any]:
    """Return a run as it comes back from its file."""
    file = folder / "as-left.json"
    file.write_text(as_json(run(mistake, folder)), "utf-8")
    return read_report(file)


def test_a_run_that_was_kept_differs_in_nothing_from_the_next_one(tmp_path: Path) -> None:
    assert differences(kept(PROBED, tmp_path), run(PROBED, tmp_path)) == ()


def test_the_record_of_a_checkout_has_the_run_of_the_hand_over(tmp_path: Path) -> None:
    record = tmp_path / "east.checkout.json"
    record.write_text(json.dumps({"stage": "sat", "baseline": json.loads(as_json(run(PROBED, tmp_path)))}))
    assert differences(read_report(record), run(PROBED, tmp_path)) == ()


def test_findings_that_were_accepted_at_hand_over_are_no_difference(tmp_path: Path) -> None:
    known = replace(PROBED, edit=inverted((H, 5, 3)))
    before = kept(known, tmp_path)
    assert run(known, tmp_path).needs_work
    assert differences(before, run(known, tmp_path)) == ()
    (gone,) = differences(before, run(PROBED, tmp_path))
    assert gone.startswith("gone: WARNING lift: obstruction.front at holding:5.3: ")


@each_row(
    "change, expected",
    [
        (lambda m: replace(m, delay_s=0.1), "plc:502: an answer took 4.0 ms before, 100 ms now"),
        (lambda m: replace(m, clients=1), "plc:502: clients at once: 4 before, 1 now"),
        (lambda m: replace(m, idle_s=0.4), "plc:502: survives a pause: yes before, no now"),
        (
            lambda m: replace(m, other_units="as its own"),
            "plc:502: unit ids that answer: 1 before, 0, 1, 2, 3, 10, 247, 255 now",
        ),
        (lambda m: replace(m, problem=ConnectProblem.REFUSED), "plc:502: answers: yes before, no now"),
        (lambda m: replace(m, edit=inverted((H, 5, 0))), "new: WARNING lift: fire at holding:5.0: "),
        (lambda m: replace(m, refused=((H, 7),)), "lift: call_accepted at holding:7 is no longer answered"),
        (lambda m: replace(m, longest=4), "plc:502: largest blocks: unit 1 holding 0: 8, unit 1 holding 16: 4 before"),
        (
            lambda m: replace(m, map="generic-coils", floors={"L1": 0, "L2": 1}),
            "lift: the map was changed: generic-registers ",
        ),
    ],
)
def test_what_has_changed_since_is_a_line(
    change: Callable[[Mistake], Mistake], expected: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("run")
    found = differences(kept(PROBED, folder), run(change(PROBED), folder))
    assert any(line.startswith(expected) for line in found), found


def test_what_was_not_probed_in_one_of_the_runs_is_not_compared(tmp_path: Path) -> None:
    assert differences(kept(PROBED, tmp_path), run(Mistake(), tmp_path)) == ()
    assert differences(kept(Mistake(), tmp_path), run(PROBED, tmp_path)) == ()


ACME = "01 01 00 00 03 00 04 41 43 4D 45 01 02 58 31 02 03 32 2E 34"
"""Vendor ACME, product code X1, revision 2.4."""
IDENTIFIED = Mistake(probes=(Probe.IDENTITY,), identity=ACME)


def noted(mistake: Mistake, folder: Path) -> dict[str, str]:
    """Return the notes of a run by their codes."""
    report = run(mistake, folder)
    assert not report.needs_work
    return {finding.code: finding.text for finding in report.findings}


def test_what_a_controller_says_that_it_is_is_a_note_and_among_the_data(tmp_path: Path) -> None:
    assert noted(IDENTIFIED, tmp_path)["identity"] == "it says that it is: vendor ACME, product code X1, revision 2.4"
    acme = {"vendor": "ACME", "product_code": "X1", "revision": "2.4"}
    assert kept(IDENTIFIED, tmp_path)["controllers"]["plc:502"]["identities"] == {"1": acme}


@each_row(
    "says, why",
    [
        ("", "function 43 is answered with exception 01"),
        ("01 01 00 00 01 00 00", "its texts are empty"),
        ("02 01 00 00 00", "read device identification, unit 1: expected unit 1 and 2b 0e 01, received 01 2b 0e 02"),
    ],
)
def test_a_controller_that_does_not_say_what_it_is_has_no_fault(
    says: str, why: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    text = noted(replace(IDENTIFIED, identity=says), tmp_path_factory.mktemp("run"))["no-identity"]
    assert text.startswith(f"it gives no identity ({why}")
    assert text.endswith("; many controllers do not")


def test_nobody_is_asked_what_it_is_without_the_probe(tmp_path: Path) -> None:
    report = run(replace(IDENTIFIED, probes=()), tmp_path)
    assert report.controllers["plc:502"].identities is None
    assert differences(kept(IDENTIFIED, tmp_path), report) == ()


@each_row(
    "before, now, expected",
    [
        (ACME, ACME[:-1] + "5", "revision 2.4 before, 2.5 now"),
        (ACME, ACME.replace("58 31", "58 32"), "product code X1 before, X2 now"),
        (ACME.replace("03 00 04", "02 00 04")[:-15], ACME, "revision none before, 2.4 now"),
    ],
)
def test_another_firmware_than_at_hand_over_is_named(
    before: str, now: str, expected: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("run")
    earlier = kept(replace(IDENTIFIED, identity=before), folder)
    (line,) = differences(earlier, run(replace(IDENTIFIED, identity=now), folder))
    assert line == f"plc:502: unit 1 is another controller or has other firmware: {expected}"


def test_a_run_from_before_there_was_that_probe_is_compared_without_it(tmp_path: Path) -> None:
    before = json.loads(as_json(run(IDENTIFIED, tmp_path)))
    del before["controllers"]["plc:502"]["identities"]
    assert differences(before, run(IDENTIFIED, tmp_path)) == ()


@each_row(
    "text, reason",
    [
        ("no JSON", "is no JSON"),
        ("{}", "was not written by"),
        ('{"stage": "sat", "baseline": null}', "keeps no run: it was made without `--baseline`"),
        ('{"stage": "sat", "baseline": {"findings": []}}', "was not written by"),
        ("[]", "was not written by"),
        ('{"schema": 9}', "was not written"),
    ],
)
def test_a_file_that_is_no_earlier_run_is_refused(
    text: str, reason: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("run") / "other.json"
    file.write_text(text)
    with pytest.raises(NotAReport, match=reason):
        read_report(file)
    with pytest.raises(NotAReport, match="No such file"):
        read_report(file.with_name("none.json"))


def test_the_head_says_how_it_answers_and_where_the_car_is(tmp_path: Path) -> None:
    mistake = Mistake()
    head, controller, lift, *_ = lines(run(mistake, tmp_path), subjects_of(mistake))
    assert head == "lift-manager 1, 2026-11-23T12:00:00+00:00: doctor only reads, and wrote nothing"
    assert controller.startswith("plc:502, unit 1: answers in 4.0 ms, ")
    assert controller.endswith("1 request per poll, repeats transaction ids, survives a pause")
    assert lift.startswith("lift: car at L1, door closed, stopped, mode normal, level (map generic-registers, sha256 ")


def test_every_finding_is_one_line_with_its_code_at_the_end(tmp_path: Path) -> None:
    mistake = Mistake(edit=inverted((H, 5, 0)), delay_s=1.0)
    report = run(mistake, tmp_path)
    found = [line for line in lines(report, subjects_of(mistake)) if line.endswith("]")]
    assert [line.rpartition("[")[2] for line in found] == ["too-slow]", "asserted]", "never-changed]"]
    assert summary(report) == "1 error and 1 warning to be dealt with."


def test_the_data_are_those_that_the_lines_are_made_of(tmp_path: Path) -> None:
    data = json.loads(as_json(run(replace(PROBED, edit=inverted((H, 5, 0))), tmp_path)))
    assert data["controllers"]["plc:502"]["p50_s"] == pytest.approx(0.004)
    assert data["lifts"]["lift"]["signals"]["fire"] == {"where": "holding:5.0", "raw": 0, "value": "yes", "changes": 0}
    assert {finding["code"] for finding in data["findings"] if finding["severity"] == "warning"} == {"asserted"}
    assert all(
        finding.keys() == {"severity", "code", "subject", "where", "text", "cure"} for finding in data["findings"]
    )
