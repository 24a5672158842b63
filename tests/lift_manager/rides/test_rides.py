"""All rides of a site: who may begin one, what is remembered, places in queues, and for whom news of a lift matters."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from lift_manager.lift.events import Acknowledged, Advised, Cause, SessionOpened
from lift_manager.lift.inputs import JoinQueue, LeaveQueue
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Advice, Holder
from lift_manager.rides import rides as all_rides
from lift_manager.rides.inputs import FoundOutside, QueueChange
from lift_manager.rides.observation import Lifts
from lift_manager.rides.record import RideRecord
from lift_manager.rides.ride import Phase, RideLimits
from lift_manager.rides.rides import ENDED_FOR_S, MOST, MOST_ENDED, MOST_OF_ONE, Rides
from lift_manager.rides.step import Step
from register_maps.words import Side
from tests.lift_manager.rides.by_hand import (
    ANY,
    CALLER,
    HOLDER,
    NOON,
    OTHER,
    REQUEST,
    SESSION,
    at,
    kept_out,
    lifts,
    ride,
    view,
)

FREE = lifts(view("A"), view("B"))
UNNAMED = replace(REQUEST, robot="")
JOINS, LEAVES = QueueChange("A", JoinQueue(HOLDER)), QueueChange("A", LeaveQueue(HOLDER))


def known(*records: RideRecord) -> Rides:
    made = Rides()
    for record in records:
        made = all_rides.put(made, record)
    return made


def robots(number: int, **more: Any) -> RideRecord:
    """A ride of its own for each number."""
    request = replace(REQUEST, robot=f"amr-{number}", key=f"k{number}")
    return replace(ride(**more), id=f"r{number}", request=request)


def placed(*records: RideRecord) -> Rides:
    made = known(*records)
    for record in records:
        made, _ = all_rides.place(made, record, FREE, 0.0)
    return made


# -- who may begin


def test_one_caller_has_few_rides_at_once_and_keeps_nobody_else_from_riding() -> None:
    made = known(*(robots(n) for n in range(MOST_OF_ONE)))
    refused = all_rides.too_many(made, CALLER)
    assert refused is not None
    assert refused.code is Refusal.TOO_MANY
    assert refused.message.startswith(f"{MOST_OF_ONE} rides of ride:fleet are under way")
    assert all(f"r{n}" in refused.message for n in range(MOST_OF_ONE))
    assert all_rides.too_many(made, Holder("ride", "another")) is None
    assert all_rides.too_many(all_rides.put(made, robots(0, phase=Phase.CANCELLED)), CALLER) is None


def test_all_callers_together_have_as_many_rides_as_the_manager_keeps() -> None:
    many = (
        replace(robots(n), request=replace(REQUEST, caller=Holder("ride", f"fleet-{n // MOST_OF_ONE}")))
        for n in range(MOST)
    )
    refused = all_rides.too_many(known(*many), CALLER)
    assert refused is not None
    assert refused.message.startswith(f"{MOST} rides of all callers")


def test_the_same_key_of_the_same_caller_gives_the_same_ride_over_or_not() -> None:
    for phase in (Phase.QUEUED, Phase.DONE):
        assert all_rides.repeated(known(ride(phase)), REQUEST) == ride(phase)
    made = known(ride())
    assert all_rides.repeated(made, replace(REQUEST, key="k2")) is None
    assert all_rides.repeated(made, replace(REQUEST, caller=Holder("ride", "another"))) is None
    keyless = known(replace(ride(), request=replace(REQUEST, key="")))
    assert all_rides.repeated(keyless, replace(REQUEST, key="")) is None


@pytest.mark.parametrize(
    "change",
    [
        {"destination": "L4"},
        {"start": "L2"},
        {"door": Side.REAR},
        {"lifts": ("B",)},
        {"lifts": ("A", "B"), "any_lift": True},
        {"limits": RideLimits(queued_s=1.0)},
    ],
)
def test_a_key_that_was_used_for_another_ride_is_refused(change: Mapping[str, Any]) -> None:
    refused = all_rides.repeated(known(ride()), replace(REQUEST, **change))
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.KEY_REUSED
    assert "was used for ride r1 from L1 to L3 with A" in refused.message


def test_any_lift_may_stand_for_other_lifts_when_a_key_is_used_again() -> None:
    record = replace(ride(), request=ANY)
    assert all_rides.repeated(known(record), replace(ANY, lifts=("A",))) == record


def test_the_caller_or_an_operator_speaks_for_a_ride() -> None:
    made = known(ride())
    assert all_rides.find(made, "r1", CALLER) == all_rides.find(made, "r1", None) == ride()
    stranger, unknown = all_rides.find(made, "r1", OTHER), all_rides.find(made, "none", None)
    assert isinstance(stranger, Refused)
    assert isinstance(unknown, Refused)
    assert (stranger.code, unknown.code) == (Refusal.NOT_YOUR_RIDE, Refusal.UNKNOWN_RIDE)


# -- what is remembered


def test_a_ride_that_ended_is_forgotten_after_a_while() -> None:
    made = known(ride(Phase.DONE, ended_at=10.0))
    assert all_rides.forget(made, 10.0 + ENDED_FOR_S) == (made, ())
    after, changed = all_rides.forget(made, 10.1 + ENDED_FOR_S)
    assert (dict(after.by_id), after.on("A"), changed) == ({}, (), ("A",))


def test_a_ride_whose_robot_may_be_inside_is_never_forgotten() -> None:
    ended = (robots(n, phase=Phase.DONE, ended_at=1.0) for n in range(2, MOST_ENDED + 3))
    after, changed = all_rides.forget(known(ride(Phase.GAVE_UP, maybe_aboard=True), *ended), 2 * ENDED_FOR_S)
    assert changed == ("A",)
    assert [*after.by_id] == [one.id for one in after.on("A")] == ["r1"]


def test_of_many_rides_that_ended_the_newest_are_remembered() -> None:
    ended = (robots(n, phase=Phase.DONE, ended_at=float(n)) for n in range(MOST_ENDED + 5))
    after, _ = all_rides.forget(known(*ended), 200.0)
    assert [*after.by_id] == [f"r{n}" for n in range(5, MOST_ENDED + 5)]


def test_a_ride_that_takes_another_lift_is_saved_with_that_one() -> None:
    made = known(ride())
    moved, changes = all_rides.take(made, Step(ride(lift="B")), FREE, at(1.0))
    assert (moved.on("A"), moved.on("B")) == ((), (ride(lift="B"),))
    assert changes == (QueueChange("B", JoinQueue(HOLDER)),)
    assert [one.id for one in all_rides.saved(moved, "B", at(1.0))] == ["r1"]
    assert all_rides.saved(moved, "A", at(1.0)) == ()


def test_what_needs_no_watching_is_a_site_without_rides_and_without_robots_in_cars() -> None:
    assert not Rides().matter()
    assert not known(ride(Phase.DONE)).matter()
    assert known(ride(Phase.GAVE_UP, maybe_aboard=True)).matter()
    assert known(ride()).matter()


# -- what rides know of each other


def test_a_ride_waits_for_the_ride_that_has_the_lift() -> None:
    made = known(robots(2, phase=Phase.CALLED, session="s2"), ride())
    seen = all_rides.observe(made, FREE, ride(), None, at(0.0))
    assert seen.busy == "ride r2 of ride:fleet/amr-2 has A"
    assert all_rides.observe(made, FREE, robots(2, phase=Phase.CALLED, session="s2"), SESSION, at(0.0)).busy == ""


def test_a_ride_whose_session_the_lift_does_not_know_sees_why() -> None:
    gone = Refused(Refusal.NO_SUCH_SESSION, "A has no session of that id for you")
    seen = all_rides.observe(Rides(), FREE, ride(Phase.CALLED), gone, at(0.0))
    assert (seen.session, seen.gone) == (None, f"its session is over: {gone.message}")
    assert all_rides.observe(Rides(), FREE, ride(), gone, at(0.0)).gone == ""


def test_an_earlier_ride_of_the_holder_whose_robot_may_be_inside_speaks_against_one_that_waits() -> None:
    earlier = replace(ride(Phase.GAVE_UP, maybe_aboard=True, ended_at=5.0), id="r0")
    made, in_car = known(earlier, ride()), lifts(view("A", kept_out(maybe_aboard=HOLDER)))
    doubt = all_rides.observe(made, in_car, ride(), None, at(9.0)).doubt
    assert doubt is not None
    assert (doubt.ride, doubt.lift, doubt.since, doubt.goes_on) == ("r0", "A", 5.0, False)
    assert all_rides.observe(made, FREE, ride(), None, at(9.0)).doubt is None, "the lift has no doubt"
    assert all_rides.observe(made, in_car, ride(Phase.CALLED), SESSION, at(9.0)).doubt is None


def test_only_robots_without_names_are_confused_with_those_of_rides_that_go_on() -> None:
    going_on = replace(ride(Phase.RIDING), id="r0", request=UNNAMED)
    unnamed = replace(ride(), request=UNNAMED)
    doubt = all_rides.observe(known(going_on, unnamed), FREE, unnamed, None, at(9.0)).doubt
    assert doubt is not None
    assert doubt.goes_on
    named = replace(ride(Phase.RIDING), id="r0")
    assert all_rides.observe(known(named, ride()), FREE, ride(), None, at(9.0)).doubt is None


def test_left_on_an_old_ride_is_meant_for_the_one_that_has_taken_over_its_car() -> None:
    old = replace(ride(Phase.GAVE_UP, maybe_aboard=True), id="r0")
    newer = ride(Phase.CALLED)
    assert all_rides.heirs(known(old, newer), old) == (newer,)
    assert all_rides.heirs(known(old, ride()), old) == ()
    assert all_rides.heirs(known(old, robots(2, phase=Phase.CALLED, session="s2")), old) == ()
    assert all_rides.heirs(known(newer), newer) == ()


def test_a_person_who_looked_settles_every_ride_that_is_over_on_that_lift() -> None:
    made = known(ride(Phase.GAVE_UP, maybe_aboard=True), robots(2, phase=Phase.RIDING, session="s2", maybe_aboard=True))
    looked = Acknowledged("A", "Ana", NOON, (Cause.OCCUPIED,))
    assert all_rides.concerned(made, looked) == (("r1", FoundOutside()),)
    assert all_rides.concerned(made, replace(looked, causes=(Cause.FIRE,))) == ()
    assert all_rides.concerned(made, replace(looked, lift="B")) == ()


def test_an_event_of_a_session_is_for_the_ride_that_has_it() -> None:
    made = known(ride(), replace(ride(Phase.CALLED), id="r2"), robots(3, phase=Phase.CALLED, session="s3"))
    advised = Advised("A", HOLDER, Advice.CLEAR_DOORWAY, "there is a fire")
    assert all_rides.concerned(made, advised) == (("r2", advised),)
    assert all_rides.concerned(made, SessionOpened("A", HOLDER, None)) == ()


# -- places in queues


def test_a_ride_that_waits_joins_the_queue_of_its_lift_once_and_leaves_it_with_its_phase() -> None:
    made, changes = all_rides.place(known(ride()), ride(), FREE, 0.0)
    assert changes == (JOINS,)
    queued = lifts(view("A", kept_out(), HOLDER))
    assert all_rides.place(made, ride(), queued, 1.0) == (made, ())
    _, changes = all_rides.place(made, ride(Phase.CALLED), queued, 1.0)
    assert changes == (LEAVES,)


def test_a_ride_whose_place_the_lift_has_given_up_joins_again() -> None:
    made = placed(ride())
    _, changes = all_rides.place(made, ride(), FREE, 1.0)
    assert changes == (JOINS,)


def test_a_place_that_one_ride_leaves_is_at_the_end_for_the_other_of_the_same_holder() -> None:
    two = replace(ride(), id="r2")
    made = placed(ride(), two)
    assert all_rides.rides_at(made, ("A", HOLDER)) == ("r1", "r2")
    made, changes = all_rides.place(made, ride(Phase.CALLED), FREE, 0.0)
    assert (changes, all_rides.rides_at(made, ("A", HOLDER))) == ((LEAVES, JOINS), ("r2",))
    made, changes = all_rides.place(made, replace(two, phase=Phase.CANCELLED), FREE, 0.0)
    assert (changes, dict(made.places)) == ((LEAVES,), {})


# -- for whom news matters


def due(made: Rides, of: Lifts, *names: str, freed: frozenset[str] = frozenset()) -> tuple[Rides, tuple[str, ...]]:
    return all_rides.due(made, of, names, freed, 0.0)


def test_news_matters_for_rides_with_a_session_and_the_next_and_for_all_where_the_queue_moves_up() -> None:
    waiting = [robots(n) for n in (2, 3)]
    flexible = replace(robots(4), request=replace(ANY, robot="amr-4"))
    over = replace(ride(Phase.DONE), id="over")
    made = placed(ride(Phase.CALLED), *waiting, flexible, over)
    two, three, four = (Holder("ride", f"fleet/amr-{n}") for n in (2, 3, 4))
    before = lifts(view("A", kept_out(), two, three, four), view("B"))
    made, found = due(made, before, "A")
    assert found == ("r1", "r2", "r3", "r4"), "nothing is known of its queue yet"
    made, found = due(made, before, "A")
    assert found == ("r1", "r2")
    after = lifts(view("A", kept_out(), three, four, departures=1), view("B"))
    made, found = due(made, after, "A")
    assert found == ("r1", "r2", "r3", "r4")
    made, found = due(made, after, "A")
    assert found == ("r1", "r3")
    assert due(made, after, "B", freed=frozenset({"B"}))[1] == ("r4",)


def test_where_a_robot_may_be_inside_its_ride_is_next_and_not_the_head_of_the_queue() -> None:
    made = placed(robots(2), robots(9))
    two, nine = (Holder("ride", f"fleet/amr-{n}") for n in (2, 9))
    inside = lifts(view("A", kept_out(maybe_aboard=nine), two, nine))
    made, _ = due(made, inside, "A")
    assert due(made, inside, "A")[1] == ("r9",)


def test_a_lift_is_freed_once() -> None:
    held = lifts(view("A", replace(kept_out(), holder=OTHER)), view("B"))
    made, found = all_rides.freed(Rides(), held, ("A", "B"))
    assert found == frozenset()
    made, found = all_rides.freed(made, FREE, ("B",))
    assert found == frozenset(), "it was not looked at"
    made, found = all_rides.freed(made, FREE, ("A", "B"))
    assert found == {"A"}
    assert all_rides.freed(made, FREE, ("A", "B"))[1] == frozenset()
