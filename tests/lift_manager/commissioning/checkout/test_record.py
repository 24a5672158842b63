"""The record of an acceptance test, and what it says about its lift."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from lift_manager.commissioning.checkout.record import (
    Confirmation,
    Controller,
    Fingerprint,
    HandBack,
    Item,
    MapIdentity,
    Outcome,
    People,
    Person,
    PunchEntry,
    Record,
    RecordUnusable,
    Result,
    Role,
    Severity,
    Signature,
    Stage,
    Trip,
    load,
    record_path,
    save,
    verdict,
)

AT = datetime(2026, 11, 23, 9, 0, tzinfo=UTC)


def item(number: str, digest: str = "d1") -> Item:
    return Item(
        id=number,
        group="Signals",
        title="car_floor",
        action="Drive to each floor.",
        expected="It shows the floor.",
        kind="signal",
        digest=digest,
    )


def result(number: str, outcome: Outcome, digest: str = "d1") -> Result:
    return Result(item=number, digest=digest, outcome=outcome, by="Ana", began_at=AT, at=AT)


def record(*results: Result, items: tuple[Item, ...] = (item("S-01"), item("S-02")), **more: object) -> Record:
    base = Record(
        stage=Stage.SAT,
        site="Hotel",
        lift="lift1",
        floors={"L1": 1, "L2": 2},
        map=MapIdentity(name="generic-coils", sha256="ab" * 32, lift_sha256="cd" * 32),
        controller=Controller(name="plc", host="192.0.2.5", port=502, unit=1),
        versions={"lift-manager": "1"},
        people=People(run_by=Person(name="Ana"), technician=Person(name="Bo", company="Lifts Ltd")),
        items=items,
        results=results,
        started_at=AT,
    )
    return base.model_copy(update=more)


def punch(severity: Severity, item_id: str = "S-02", accepted_by: str = "", *, closed: bool = False) -> PunchEntry:
    return PunchEntry(
        number=1,
        item=item_id,
        text="does not show a fire",
        severity=severity,
        condition="no robots at night",
        accepted_by=accepted_by,
        raised_at=AT,
        closed_at=AT if closed else None,
    )


PASSED, FAILED, SKIPPED = Outcome.PASSED, Outcome.FAILED, Outcome.SKIPPED


def test_a_saved_record_is_read_back_as_it_was(tmp_path: Path) -> None:
    trip = Trip(number=1, item="T-01", from_="L1", to="L2", at=AT, is_complete=True, figures={"total_s": 20.5})
    before = record(result("S-01", PASSED), trips=(trip,), baseline={"findings": [{"what": "unit", "value": 1}]})
    save(tmp_path / "r.json", before)
    assert load(tmp_path / "r.json") == before
    assert load(tmp_path / "other.json") is None


def test_each_lift_and_stage_has_a_file_of_its_own_next_to_the_store(tmp_path: Path) -> None:
    paths = {record_path(tmp_path / "hotel-1.db", lift, stage) for lift in ("a b", "a-b") for stage in Stage}
    assert len(paths) == 6
    assert {path.parent for path in paths} == {tmp_path}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "is no record"),
        ("[]", "is no record"),
        ('{"format": "lift-manager checkout", "version": 2}', "has version 2; start the version that wrote it"),
        ('{"format": "something else", "version": 1}', "format: Input should be 'lift-manager checkout'"),
    ],
)
def test_a_file_that_is_no_record_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(RecordUnusable, match=reason):
        load(tmp_path / "r.json")


def test_the_newest_result_of_an_item_counts() -> None:
    found = verdict(record(result("S-01", FAILED), result("S-02", PASSED), result("S-01", PASSED)))
    assert (found.complete, found.passed, found.conditionally) == (True, True, False)
    assert found.text == "passed"


def test_after_a_change_of_the_map_only_items_that_depend_on_it_are_open() -> None:
    changed = record(
        result("S-01", PASSED), result("S-02", PASSED), items=(item("S-01"), item("S-02", "other")), ended_at=AT
    )
    assert verdict(changed).remaining == ("S-02",)
    assert [changed.changed_since(one) for one in changed.items] == [False, True]


@pytest.mark.parametrize(
    ("entry", "passed", "conditionally"),
    [
        (None, False, False),
        (punch(Severity.A, accepted_by="Cy"), False, False),
        (punch(Severity.B), False, False),
        (punch(Severity.B, accepted_by="Cy"), True, True),
        (punch(Severity.C), True, True),
        (punch(Severity.B, accepted_by="Cy", item_id="S-01"), False, True),
        (punch(Severity.B, accepted_by="Cy", closed=True), False, False),
    ],
)
@pytest.mark.parametrize("bad", [FAILED, SKIPPED])
def test_a_bad_item_passes_only_under_an_accepted_condition(
    bad: Outcome, entry: PunchEntry | None, passed: bool, conditionally: bool
) -> None:
    entries = () if entry is None else (entry,)
    found = verdict(record(result("S-01", PASSED), result("S-02", bad), punch_list=entries))
    assert (found.passed, found.conditionally) == (passed, conditionally)


def test_the_newest_state_of_a_point_counts() -> None:
    entries = (punch(Severity.A), punch(Severity.A, closed=True))
    found = verdict(record(result("S-01", PASSED), result("S-02", PASSED), punch_list=entries))
    assert (found.passed, found.conditionally, found.open_points) == (True, False, ())


@pytest.mark.parametrize("proof", [Outcome.NOT_APPLICABLE, Outcome.DOCUMENT])
def test_not_applicable_and_proved_by_document_are_results(proof: Outcome) -> None:
    assert verdict(record(result("S-01", PASSED), result("S-02", proof))).passed


def test_a_signature_is_for_the_record_as_it_was_signed() -> None:
    unsigned = record(result("S-01", PASSED))
    signed = unsigned.model_copy(
        update={
            "signatures": tuple(
                Signature(role=role, name="x", at=AT, record_sha256=unsigned.sha256)
                for role in (Role.RUN_BY, Role.TECHNICIAN)
            )
        }
    )
    assert signed.sha256 == unsigned.sha256
    assert verdict(signed).is_signed
    assert not verdict(unsigned).is_signed
    changed = signed.model_copy(update={"results": (*signed.results, result("S-02", FAILED))})
    assert not verdict(changed).is_signed


def test_what_was_never_recorded_does_not_change_the_hash_of_a_signed_record() -> None:
    assert "identity" not in Fingerprint(taken_at=AT).model_dump()
    asked = Fingerprint(taken_at=AT, identity={"vendor": "Thyra"})
    assert asked.model_dump()["identity"] == {"vendor": "Thyra"}
    assert asked.sha256 == Fingerprint(taken_at=AT).sha256
    unsigned = record(result("S-01", PASSED))
    assert "confirmations" not in unsigned.model_dump()
    seen = Confirmation(item="S-01", result=1, name="Cy", at=AT)
    assert unsigned.model_copy(update={"confirmations": (seen,)}).sha256 != unsigned.sha256


def test_the_lift_is_handed_back_when_it_is_in_normal_service() -> None:
    back = HandBack(in_normal_service=True, handed_over_by="Ana", taken_back_by="Bo", at=AT)
    assert verdict(record(hand_back=back)).is_handed_back
    assert not verdict(record()).is_handed_back


def test_a_record_matches_the_map_and_the_floors_that_were_tested() -> None:
    tested = record()
    assert tested.matches(map_sha256="ab" * 32, lift_sha256="cd" * 32)
    assert "the map of lift1 has changed" in tested.find_mismatch(map_sha256="ff" * 32)
    assert "floors, doors, offset" in tested.find_mismatch(map_sha256="ab" * 32, lift_sha256="ee" * 32)
