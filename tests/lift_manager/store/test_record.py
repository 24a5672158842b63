"""A record as text: read as it was written, or refused with what is wrong."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest

from lift_manager.domain.ride import Phase, RideLimits
from lift_manager.domain.ride_record import Clearing, KeptRide, RideRecord, kept, restored
from lift_manager.domain.service import Advice, Remembered
from lift_manager.store.record import REMEMBERED, RecordDamaged
from register_maps.words import Side
from tests.lift_manager.domain.ride_sights import NOON, WISH, ride
from tests.lift_manager.store.test_memory_contract import EVERYTHING, VALUES

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
    assert REMEMBERED.decode(REMEMBERED.encode(said)) == said


@pytest.mark.parametrize("value", VALUES)
def test_a_record_is_read_as_it_was_written(value: Remembered) -> None:
    assert REMEMBERED.decode(REMEMBERED.encode(value)) == value


def spoilt(spoil: Callable[[dict[str, Any]], object]) -> str:
    content = json.loads(REMEMBERED.encode(replace(EVERYTHING, rides=(kept(FULL, at=NOON, now=5.0),))))
    spoil(content)
    with pytest.raises(RecordDamaged) as damaged:
        REMEMBERED.decode(json.dumps(content))
    return str(damaged.value)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda c: c.update(more=1), "more: Unexpected keyword argument"),
        (lambda c: c["session"].update(more=1), "session.more: Unexpected"),
        (lambda c: c.pop("fire_since"), "fire_since: is missing"),
        (lambda c: c["session"].pop("key"), "session.key: is missing"),
        (lambda c: c["rides"][0]["wish"]["limits"].pop("queued_s"), "rides.0.wish.limits.queued_s: is missing"),
        (lambda c: c["lockout"].pop("by"), "lockout.by: Field required"),
        (lambda c: c.update(fire_since="2026-03-02T21:30:00"), "fire_since: is a time without a zone"),
        (lambda c: c.update(fire_since="9999-12-31T23:59:59-12:00"), "fire_since: the year 9999 cannot be"),
        (lambda c: c["trust"]["distrust"][0].update(since="0001-01-01T00:00:00+12:00"), "trust.distrust.0.since"),
        (lambda c: c["occupied"].update(aboard="yes"), "occupied.aboard: Input should be a valid boolean"),
        (lambda c: c["session"]["boarding"].update(who="gone"), "session.boarding.who: Input should be"),
        (lambda c: c.update(rides={}), "rides: Input should be a valid"),
    ],
)
def test_anything_that_no_manager_writes_is_refused_with_its_place(
    spoil: Callable[[dict[str, Any]], object], words: str
) -> None:
    assert words in spoilt(spoil)


@pytest.mark.parametrize("text", ["", "{", "null", "[]", "{}, {}", "\ud800", "[" * 10_000])
def test_what_is_no_record_is_refused(text: str) -> None:
    with pytest.raises(RecordDamaged):
        REMEMBERED.decode(text)


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
