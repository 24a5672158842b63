"""Which record lets robots use a lift, and what `serve` and `check` make of it."""

from datetime import datetime, timedelta
from pathlib import Path

import pytest

from lift_manager.cli.serve_checks import cautions, obstacles, with_checkouts
from lift_manager.commissioning.checkout.approval import PROOF_DAYS, find_approval
from lift_manager.commissioning.checkout.engine import Checkout
from lift_manager.commissioning.checkout.plan import lift_digest, make_plan
from lift_manager.commissioning.checkout.record import (
    MapIdentity,
    Outcome,
    PunchEntry,
    Record,
    Severity,
    Stage,
    archive_path,
    record_path,
    save,
)
from lift_manager.config.load import LoadedSite
from lift_manager.lift import config
from lift_manager.store.place import store_path
from tests.lift_manager.commissioning.checkout.records import UNSIGNED, at, result, signed
from tests.lift_manager.config.site_files import GENERIC, load
from tests.support.checkout_rig import LIFT, Rig, TruthfulPerson, new_record, site_of
from tests.support.rows import each_row
from tests.support.virtual_time import run_virtual

NOW = at(60 * 24)
KEPT = ("name: A building", "name: A building\nstate: kept")
REQUIRED = ("name: A building", "name: A building\nstate: kept\nrequire_checkout: true")
ENDED = "2026-11-23"


@pytest.fixture
def loaded(tmp_path: Path) -> LoadedSite:
    return load(tmp_path, GENERIC, KEPT)


def store_of(loaded: LoadedSite) -> Path:
    return store_path(loaded.site.name, loaded.site.state, loaded.path, {})


def record_of(loaded: LoadedSite, **more: object) -> Record:
    """A record of a passed test of the lift as its site file is."""
    base = UNSIGNED.model_copy(
        update={
            "site": loaded.site.name,
            "lift": "main",
            "map": MapIdentity(
                name="generic-registers",
                sha256=loaded.maps["main"].sha256,
                lift_sha256=lift_digest(loaded, "main"),
            ),
            "controller": UNSIGNED.controller.model_copy(update={"host": "10.0.0.5", "port": 502}),
            "items": UNSIGNED.items[:2],
            "results": (result("S-01", Outcome.PASSED, 3), result("S-04", Outcome.PASSED, 5)),
            "punch_list": (),
        }
    )
    return signed(base.model_copy(update=more))


def keep(loaded: LoadedSite, record: Record, *, archived: bool = False) -> None:
    path = record_path(store_of(loaded), record.lift, record.stage)
    save(archive_path(path, record) if archived else path, record)


def problem(loaded: LoadedSite, now: datetime = NOW) -> str:
    return find_approval(store_of(loaded), loaded, "main", now).problem


def test_a_signed_record_of_this_map_lets_robots_use_the_lift(loaded: LoadedSite) -> None:
    keep(loaded, record_of(loaded))
    found = find_approval(store_of(loaded), loaded, "main", NOW)
    assert (found.record, found.problem, found.cautions) == (record_of(loaded), "", ())


def test_without_a_record_the_folder_is_named(loaded: LoadedSite) -> None:
    assert problem(loaded) == f"there is no checkout record of it in {store_of(loaded).parent}"


FAILED = (result("S-01", Outcome.PASSED, 3), result("S-04", Outcome.FAILED, 5))
OPEN_POINT = PunchEntry(number=3, text="no fire signal", severity=Severity.A, raised_at=at(5))


@each_row(
    ("change", "reason"),
    [
        ({"results": FAILED}, f"its checkout of {ENDED} is not passed: S-04"),
        ({"results": FAILED[:1]}, f"its checkout of {ENDED} is not complete: "),
        ({"punch_list": (OPEN_POINT,)}, f"its checkout of {ENDED} is not passed: the punch list; open points 3"),
        ({"ended_at": None}, f"the checkout that began on {ENDED} is not finished"),
        ({"site": "Another building"}, "there is no checkout record of it in "),
        ({"lift": "second"}, "there is no checkout record of it in "),
        ({"stage": Stage.FAT}, "there is no checkout record of it in "),
    ],
)
def test_a_record_that_says_no_or_of_something_else_does_not_count(
    tmp_path: Path, change: dict[str, object], reason: str
) -> None:
    loaded = load(tmp_path, GENERIC, KEPT)
    for old in tmp_path.glob("kept/*"):
        old.unlink()
    record = record_of(loaded, **change)
    save(record_path(store_of(loaded), "main", Stage.SAT), record)
    assert problem(loaded).startswith(reason)


def test_a_record_that_nobody_signed_as_it_is_does_not_count(loaded: LoadedSite) -> None:
    record = record_of(loaded)
    keep(loaded, record.model_copy(update={"results": (*record.results, result("S-01", Outcome.PASSED, 9))}))
    assert problem(loaded) == f"its checkout of {ENDED} is not signed as it is now"


@each_row(
    ("edit", "reason"),
    [
        (
            ("access: control", "access: control\n    override: {door_opens_within_s: 20}"),
            "the map of main has changed",
        ),
        (("L2: 2}", "L2: 3}"), "floors, doors, offset or unit of main in the site file have changed"),
        (
            ("host: 10.0.0.5", "host: 10.0.0.6"),
            f"its controller was at 10.0.0.5 port 502 unit id 1 at the checkout of {ENDED}, and is at 10.0.0.6 port 502 unit id 1 now",
        ),
        (
            ("port: 502,", "port: 502, unit_id: 7,"),
            f"its controller was at 10.0.0.5 port 502 unit id 1 at the checkout of {ENDED}, and is at 10.0.0.5 port 502 unit id 7 now",
        ),
    ],
)
def test_after_a_change_of_map_floors_or_controller_a_record_does_not_count(
    tmp_path: Path, edit: tuple[str, str], reason: str
) -> None:
    before = load(tmp_path, GENERIC, KEPT)
    keep(before, record_of(before))
    assert problem(before) == ""
    assert problem(load(tmp_path, GENERIC, KEPT, edit)).startswith(reason)


def test_a_test_that_was_begun_again_counts_once_it_is_finished_or_something_failed(loaded: LoadedSite) -> None:
    keep(loaded, record_of(loaded), archived=True)
    later = {"started_at": at(600), "ended_at": None}
    keep(loaded, record_of(loaded, **later, results=()))
    assert problem(loaded) == ""
    keep(loaded, record_of(loaded, **later, results=FAILED[1:]))
    assert problem(loaded).startswith(f"its checkout of {ENDED} is not complete")


def test_a_record_that_cannot_be_read_does_not_count(loaded: LoadedSite) -> None:
    path = record_path(store_of(loaded), "main", Stage.SAT)
    path.parent.mkdir(mode=0o700)
    path.write_text("{}")
    assert problem(loaded).startswith(f"its checkout record cannot be used: {path} is no record of a checkout")


def told(loaded: LoadedSite, now: datetime = NOW) -> tuple[str, ...]:
    found = find_approval(store_of(loaded), loaded, "main", now)
    assert not found.problem
    return found.cautions


def test_conditions_and_a_missing_hand_back_are_cautions(loaded: LoadedSite) -> None:
    accepted = OPEN_POINT.model_copy(update={"severity": Severity.B, "condition": "at night", "accepted_by": "Cy"})
    keep(loaded, record_of(loaded, punch_list=(accepted,), hand_back=None))
    assert told(loaded) == (
        "robots may use it only under conditions: at night",
        "nobody took it back into normal service after the checkout",
    )


def test_after_a_year_the_proof_test_is_due_until_it_is_passed(loaded: LoadedSite) -> None:
    keep(loaded, record_of(loaded))
    year = timedelta(days=PROOF_DAYS)
    assert told(loaded, at(122) + year) == ()
    late = at(123) + year
    assert told(loaded, late) == (f"the yearly proof test of fire and watchdog is due: the last one was on {ENDED}",)
    proof = record_of(
        loaded, stage=Stage.PROOF, started_at=late - timedelta(hours=2), ended_at=late - timedelta(hours=1)
    )
    keep(loaded, proof)
    assert told(loaded, late) == ()


def test_a_proof_test_that_failed_keeps_robots_off(loaded: LoadedSite) -> None:
    keep(loaded, record_of(loaded))
    keep(loaded, record_of(loaded, stage=Stage.PROOF, started_at=at(900), ended_at=None, results=FAILED))
    assert problem(loaded) == f"its proof test of {ENDED} is not passed: S-04"


def test_a_start_without_a_record_is_cautioned_about_with_the_command_that_makes_one(loaded: LoadedSite) -> None:
    (line,) = [line for line in cautions(loaded) if "checkout" in line]
    assert line.startswith("main: robots may use it, and there is no checkout record of it in ")
    assert line.endswith(f"test and sign it with `lift-manager checkout {loaded.path} main`")
    assert set(loaded.cautions()) < set(cautions(loaded))
    assert [finding for finding in obstacles(loaded) if "checkout" in finding.message] == []
    keep(loaded, record_of(loaded))
    assert set(loaded.cautions()) == set(cautions(loaded))


def test_a_lift_that_is_only_watched_needs_no_record(tmp_path: Path) -> None:
    watched = load(tmp_path, GENERIC, REQUIRED, ("    access: control\n", ""))
    assert not any("checkout record" in line for line in cautions(watched))
    assert list(obstacles(watched)) == []


def test_a_site_that_requires_a_record_is_not_served_without_one(tmp_path: Path) -> None:
    required = load(tmp_path, GENERIC, REQUIRED)
    (finding,) = obstacles(required)
    assert (finding.file, finding.key) == (str(required.path), "lifts.main")
    assert "there is no checkout record of it" in finding.message
    assert finding.message.endswith(
        f"test and sign it with `lift-manager checkout {required.path} main`, or use `access: monitor` until then"
    )
    keep(required, record_of(required))
    assert list(obstacles(required)) == []


def test_the_manager_knows_the_record_by_its_hash_and_date(loaded: LoadedSite) -> None:
    assert with_checkouts(loaded).checkouts == {}
    record = record_of(loaded)
    keep(loaded, record)
    assert with_checkouts(loaded).checkouts == {"main": config.Checkout(record.sha256, at(122))}


def test_a_test_that_was_run_to_its_end_and_signed_lets_robots_use_the_lift(tmp_path: Path) -> None:
    bench = site_of(tmp_path)
    store = tmp_path / "kept" / "bench.db"
    item = make_plan(bench, LIFT, Stage.SAT)[:1]

    async def main() -> None:
        rig, path = Rig(bench), record_path(store, LIFT, Stage.SAT)
        test = Checkout(
            new_record(bench, item), lambda record: save(path, record), TruthfulPerson(rig), rig, rig.codec, ["plc"]
        )
        await test.run(item)
        assert find_approval(store, bench, LIFT, NOW).problem.endswith("is not finished")
        await test.close()

    run_virtual(main, limit_s=3000.0)
    found = find_approval(store, bench, LIFT, NOW)
    assert (found.problem, found.cautions) == ("", ())
