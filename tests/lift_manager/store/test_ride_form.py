"""Rides in the file that keeps what outlives the manager."""

import json
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta, timezone

import pytest

from lift_manager.domain.ride import Phase, RideLimits
from lift_manager.domain.ride_record import Clearing, KeptRide, RideRecord, kept, restored
from lift_manager.domain.service import Advice, Remembered
from lift_manager.store.form import LiftForm
from register_maps.words import Side
from tests.lift_manager.domain.ride_sights import NOON, WISH, ride

FULL = ride(
    Phase.CLEARING,
    wish=replace(WISH, lifts=("A", "B"), any_lift=True, door=Side.REAR, limits=RideLimits(queued_s=7.5)),
    reason="cancelled",
    advice=Advice.STAY_ABOARD,
    entered=True,
    could_leave_at="L2",
    clearing=Clearing(Phase.CANCELLED, "no order"),
    clear_at="L2",
)


@pytest.mark.parametrize("record", [ride(), FULL, ride(Phase.GAVE_UP, ended_at=3.0, maybe_aboard=True)])
def test_a_ride_is_read_as_it_was_written(record: RideRecord) -> None:
    said = Remembered(rides=(kept(record, at=NOON, now=5.0),))
    assert LiftForm.model_validate_json(LiftForm.of(said).model_dump_json()).read() == said


def test_a_file_without_rides_holds_none() -> None:
    written = json.loads(LiftForm.of(Remembered()).model_dump_json())
    del written["rides"]
    assert LiftForm.model_validate_json(json.dumps(written)).read().rides == ()


def test_every_field_of_a_ride_that_is_kept_is_taken_up_again() -> None:
    again = restored(kept(FULL, at=NOON, now=5.0), "A", at=NOON, now=5.0)
    gone = {"guidance", "reason", "ahead", "stands", "unheard_since", "asked_at", "trouble"}
    for name in {field.name for field in fields(RideRecord)} - gone:
        assert getattr(again, name) == getattr(FULL, name), name
    assert (again.reason, again.unheard_since) == ("", 5.0)


@pytest.mark.parametrize(
    ("away_s", "passed_s"),
    [(0.0, 40.0), (60.0, 100.0), (-3600.0, 40.0)],
)
def test_the_time_of_a_phase_goes_on_while_the_manager_does_not_run(away_s: float, passed_s: float) -> None:
    written: KeptRide = kept(ride(Phase.RIDING, phase_since=10.0), at=NOON, now=50.0)
    local = (NOON + timedelta(seconds=away_s)).astimezone(timezone(timedelta(hours=9)))
    again = restored(written, "A", at=local, now=1000.0)
    assert 1000.0 - again.phase_since == pytest.approx(passed_s)
    assert written.kept_at == datetime(2026, 11, 21, 12, tzinfo=UTC)
