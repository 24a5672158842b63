"""What is saved of a lift, as text: read as it was written, or refused with what is wrong."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from lift_manager.lift.session import Advice
from lift_manager.rides.record import Clearing, RideRecord, save
from lift_manager.rides.ride import Phase, RideLimits
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.record import RecordDamaged, decode, encode
from register_maps.words import Side
from tests.lift_manager.rides.by_hand import REQUEST, at, ride
from tests.lift_manager.store.test_recall_contract import RECORD, VALUES
from tests.support.rows import each_row

CLEARING = replace(
    ride(
        Phase.CLEARING,
        reason="cancelled",
        advice=Advice.STAY_ABOARD,
        has_entered=True,
        could_exit_at="L2",
        clearing=Clearing(Phase.CANCELLED, "no order"),
        clear_at="L2",
    ),
    request=replace(REQUEST, lifts=("A", "B"), any_lift=True, door=Side.REAR, limits=RideLimits(queued_s=7.5)),
)
FULL = SavedLift(RECORD, (save(CLEARING, at(5.0)),))


@each_row("record", [ride(), CLEARING, ride(Phase.GAVE_UP, ended_at=3.0, maybe_aboard=True)])
def test_a_ride_is_read_as_it_was_written(record: RideRecord) -> None:
    saved = SavedLift(rides=(save(record, at(5.0)),))
    assert decode(encode(saved)) == saved


@each_row("value", VALUES)
def test_a_record_is_read_as_it_was_written(value: SavedLift) -> None:
    assert decode(encode(value)) == value


def spoilt(spoil: Callable[[dict[str, Any]], object]) -> str:
    content = json.loads(encode(FULL))
    spoil(content)
    with pytest.raises(RecordDamaged) as damaged:
        decode(json.dumps(content))
    return str(damaged.value)


@each_row(
    ("spoil", "words"),
    [
        (lambda c: c.update(more=1), "more: Unexpected keyword argument"),
        (lambda c: c["record"]["session"].update(more=1), "record.session.more: Unexpected"),
        (lambda c: c["record"].pop("fire_since"), "record.fire_since: is missing"),
        (lambda c: c["record"]["session"].pop("key"), "record.session.key: is missing"),
        (lambda c: c["rides"][0]["request"]["limits"].pop("queued_s"), "rides.0.request.limits.queued_s: is missing"),
        (lambda c: c["record"]["restrictions"][0].pop("by"), "record.restrictions.0.by: Field required"),
        (lambda c: c["record"].update(fire_since="2026-03-02T21:30:00"), "record.fire_since: is a time without a zone"),
        (lambda c: c["record"].update(fire_since="9999-12-31T23:59:59-12:00"), "fire_since: the year 9999 cannot be"),
        (
            lambda c: c["record"]["trust"]["distrust"][0].update(since="0001-01-01T00:00:00+12:00"),
            "record.trust.distrust.0.since",
        ),
        (lambda c: c["record"]["occupied"].update(aboard="yes"), "occupied.aboard: Input should be a valid boolean"),
        (
            lambda c: c["record"]["session"]["boarding"].update(occupancy="gone"),
            "record.session.boarding.occupancy: Input should be",
        ),
        (lambda c: c.update(rides={}), "rides: Input should be a valid"),
    ],
)
def test_anything_that_no_manager_writes_is_refused_with_its_place(
    spoil: Callable[[dict[str, Any]], object], words: str
) -> None:
    assert words in spoilt(spoil)


@each_row("text", ["", "{", "null", "[]", "{}, {}", "\ud800", "[" * 10_000])
def test_what_is_no_record_is_refused(text: str) -> None:
    with pytest.raises(RecordDamaged):
        decode(text)
