"""Which lift a ride takes, when it begins and while it waits."""

from dataclasses import replace

from lift_manager.lift.config import LiftConfig
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.rides.choice import Candidate, Choices, begin_ride, choose, plan_ride, why_never
from lift_manager.rides.observation import LiftView
from lift_manager.rides.record import RideRecord
from lift_manager.rides.ride import Phase, RidePlan, RideRequest
from lift_manager.rides.rides import MOST_OF_ONE, REFUSED_FOR_S, Rides, put, take
from lift_manager.rides.step import Step
from register_maps.words import Mode, Side
from tests.lift_manager.rides.by_hand import ABLE, ANY, HOLDER, REQUEST, STATE, at, config, lifts, ride, view
from tests.support.rows import each_row

NO_HOLD = replace(ABLE, commands=frozenset({"go_to"}))


def candidate(
    lift: str, state: LiftState = STATE, *, floor: str | None = "L2", waiting: int = 0, refused: str = ""
) -> Candidate:
    return Candidate(config(lift), replace(state, lift=lift, floor=floor), waiting, refused)


@each_row(
    ("lift", "request_", "code", "words"),
    [
        (config(floors=("L1", "L2")), REQUEST, Refusal.UNKNOWN_FLOOR, "A has no floor 'L3'; its floors are L1, L2"),
        (config(), replace(REQUEST, destination="L1"), Refusal.NOT_POSSIBLE, "begins and ends at L1"),
        (config(), replace(REQUEST, door=Side.REAR), Refusal.NOT_POSSIBLE, "no rear door at L1; there it has front"),
        (config(control=False), REQUEST, Refusal.MONITOR_ONLY, "A is only watched"),
        (config(), replace(REQUEST, door=Side.FRONT), None, ""),
        (
            config(capabilities=NO_HOLD),
            REQUEST,
            Refusal.NOT_POSSIBLE,
            "its map by-hand has no hold for the front door at L1",
        ),
        (config(capabilities=replace(NO_HOLD, until={"call": "robot_left"})), REQUEST, None, ""),
        (config(capabilities=replace(ABLE, commands=ABLE.commands - {"go_to"} | {"go_to.front"})), REQUEST, None, ""),
        (config(doors_at={}), REQUEST, Refusal.NOT_POSSIBLE, "its map by-hand shows no door at L1"),
        (
            config(capabilities=replace(ABLE, doors=())),
            REQUEST,
            Refusal.NOT_POSSIBLE,
            "its map by-hand shows no door at L1",
        ),
        (
            config(capabilities=replace(NO_HOLD, commands=frozenset({"go"}))),
            REQUEST,
            Refusal.NOT_POSSIBLE,
            "has neither go_to nor call",
        ),
    ],
)
def test_a_lift_that_can_never_take_a_ride_is_refused(
    lift: LiftConfig, request_: RideRequest, code: Refusal | None, words: str
) -> None:
    refused = why_never(request_, lift)
    assert (None if refused is None else refused.code) == code
    assert refused is None or words in refused.message


BUSY = replace(STATE, holder=Holder("rmf", "tiny"))
OFFLINE = replace(STATE, quality=Quality.OFFLINE)
LATCHED = replace(STATE, restrictions=Restrictions(fire_latched=True))
LOCKED = replace(STATE, restrictions=Restrictions(lockout="by Ana"))
OCCUPIED = replace(STATE, restrictions=Restrictions(maybe_aboard=Holder("rmf", "tiny")))


@each_row(
    ("lifts", "best"),
    [
        ((candidate("A"), candidate("B"), candidate("C")), "A"),
        ((candidate("A", floor="L4"), candidate("B", floor="L1"), candidate("C", floor="L2")), "B"),
        ((candidate("A", floor=None), candidate("B", floor="L4")), "B"),
        ((candidate("A", BUSY, floor="L1"), candidate("B", floor="L4")), "B"),
        ((candidate("A", waiting=2, floor="L1"), candidate("B", BUSY, floor="L4")), "B"),
        ((candidate("A", OFFLINE), candidate("B", BUSY, waiting=3)), "B"),
        ((candidate("A", LATCHED), candidate("B", BUSY)), "B"),
        ((candidate("A", LOCKED), candidate("B", BUSY)), "B"),
        ((candidate("A", OCCUPIED), candidate("B", BUSY)), "B"),
        ((candidate("A", replace(STATE, mode=Mode.INSPECTION)), candidate("B", BUSY)), "B"),
        ((candidate("A", refused="its robot hours are over"), candidate("B", BUSY)), "B"),
        ((candidate("A", OFFLINE), candidate("B", OFFLINE)), "A"),
    ],
)
def test_the_best_lift_takes_robots_then_has_the_shortest_line_then_is_nearest(
    lifts: tuple[Candidate, ...], best: str
) -> None:
    chosen = choose(ANY, HOLDER, lifts)
    assert isinstance(chosen, Candidate)
    assert chosen.lift == best


def test_a_car_that_may_hold_the_robot_itself_takes_it() -> None:
    own = replace(STATE, restrictions=Restrictions(maybe_aboard=HOLDER))
    chosen = choose(ANY, HOLDER, (candidate("A", own), candidate("B", BUSY)))
    assert isinstance(chosen, Candidate)
    assert chosen.lift == "A"


def test_a_robot_that_may_be_in_a_car_is_given_no_other_though_that_is_nearer_and_free() -> None:
    own = replace(STATE, restrictions=Restrictions(maybe_aboard=HOLDER))
    lifts = (candidate("B", floor="L1"), candidate("A", own, floor="L4", waiting=3))
    chosen = choose(ANY, HOLDER, lifts)
    assert isinstance(chosen, Candidate)
    assert chosen.lift == "A"
    unnamed = choose(replace(ANY, robot=""), HOLDER, lifts)
    assert isinstance(unnamed, Candidate)
    assert unnamed.lift == "B", "nobody knows whose robot is in the car"


def test_where_no_lift_serves_both_floors_the_refusal_names_lifts_and_floors() -> None:
    lifts = tuple(Candidate(config(lift, ("L1", "L2")), STATE, 0, "") for lift in ("A", "B"))
    refused = choose(ANY, HOLDER, lifts)
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.UNKNOWN_FLOOR
    assert "from L1 to L3" in refused.message
    assert "A has no floor 'L3'; its floors are L1, L2; B has no floor 'L3'" in refused.message


def test_lifts_that_do_not_fit_for_different_reasons_are_not_possible() -> None:
    lifts = (Candidate(config("A", ("L1", "L2")), STATE, 0, ""), Candidate(config("B", control=False), STATE, 0, ""))
    refused = choose(ANY, HOLDER, lifts)
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.NOT_POSSIBLE


def test_no_lift_at_all_is_refused() -> None:
    refused = choose(ANY, HOLDER, ())
    assert isinstance(refused, Refused)
    assert "none to choose among" in refused.message


# -- when a ride begins, and while it waits

TAKEN = replace(STATE, holder=Holder("rmf", "tiny"))
IN_CAR = replace(STATE, restrictions=Restrictions(maybe_aboard=HOLDER))
INSIDE = ride(Phase.GAVE_UP, maybe_aboard=True, ended_at=5.0)


def choices(*views: LiftView, rides: Rides | None = None, now: float = 9.0) -> Choices:
    return Choices(rides or Rides(), lifts(*views), now)


def begun(made: Choices, request: RideRequest, *, is_stopping: bool = False) -> Step | Refused:
    return begin_ride(made, request, "r9", at(9.0), is_stopping=is_stopping)


def test_a_ride_begins_with_the_lift_that_is_best() -> None:
    done = begun(choices(view("A", TAKEN), view("B"), view("C", TAKEN)), ANY)
    assert isinstance(done, Step)
    assert (done.record.lift, done.record.id, done.record.phase) == ("B", "r9", Phase.QUEUED)


def test_a_lift_that_the_site_does_not_have_is_refused_with_those_that_it_has() -> None:
    refused = begun(choices(view("A"), view("B")), replace(REQUEST, lifts=("X",)))
    assert isinstance(refused, Refused)
    assert (refused.code, refused.message) == (Refusal.UNKNOWN_LIFT, "no lift 'X'; the lifts are A, B")


def test_a_manager_that_stops_begins_and_plans_no_ride() -> None:
    made = choices(view("A"))
    plan = plan_ride(made, REQUEST, at(9.0), is_stopping=True)
    for refused in (begun(made, REQUEST, is_stopping=True), plan):
        assert isinstance(refused, Refused)
        assert refused.code is Refusal.STOPPING


def test_a_caller_with_too_many_rides_begins_none_and_still_plans() -> None:
    many = Rides()
    for number in range(MOST_OF_ONE):
        many = put(many, replace(ride(), id=f"r{number}"))
    made = choices(view("A"), rides=many)
    refused = begun(made, REQUEST)
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.TOO_MANY
    assert isinstance(plan_ride(made, REQUEST, at(9.0), is_stopping=False), RidePlan)


def test_a_plan_names_the_lift_the_wait_and_the_reason() -> None:
    assert plan_ride(choices(view("A")), REQUEST, at(9.0), is_stopping=False) == RidePlan("A", 0, "")
    busy = choices(view("A", TAKEN, Holder("ride", "other")))
    assert plan_ride(busy, REQUEST, at(9.0), is_stopping=False) == RidePlan("A", 2, "A is held by rmf:tiny")
    gone = choices(view("A", replace(STATE, quality=Quality.OFFLINE, age_s=9.0)))
    plan = plan_ride(gone, REQUEST, at(9.0), is_stopping=False)
    assert plan == RidePlan("A", 0, "A is offline since 12:00:00")


def test_a_robot_that_may_be_in_one_car_begins_no_ride_with_another() -> None:
    made = choices(view("A", IN_CAR), view("B"), rides=put(Rides(), INSIDE))
    refused = begun(made, replace(REQUEST, lifts=("B",)))
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.NOT_NOW
    assert "your robot may be in the car of A: send `left` for ride r1" in refused.message
    for robot in ("amr-2", ""):
        assert isinstance(begun(made, replace(REQUEST, lifts=("B",), robot=robot)), Step)


def test_a_ride_that_waits_moves_only_to_a_lift_where_it_is_better_off() -> None:
    waiting = replace(ride(), request=replace(ANY, lifts=("A", "B")))
    nearer = view("B", replace(TAKEN, floor="L1"))
    assert choices(view("A", TAKEN), nearer).better(waiting) is None
    assert choices(view("A", TAKEN), view("B")).better(waiting) == "B"
    assert choices(view("A", TAKEN, HOLDER), view("B")).better(waiting) == "B"


@each_row(
    "stays",
    [
        ride(),
        replace(ride(Phase.CALLED), request=ANY),
        replace(ride(silent_since=0.0), request=ANY),
    ],
)
def test_a_ride_that_may_not_move_stays(stays: RideRecord) -> None:
    assert choices(view("A", TAKEN), view("B"), view("C")).better(stays) is None


def test_a_ride_that_waits_follows_its_robot_to_the_car_that_it_may_be_in() -> None:
    waiting = replace(ride(), id="r2", lift="B", request=ANY)
    made = choices(view("A", IN_CAR), view("B"), view("C"), rides=put(Rides(), INSIDE))
    assert made.better(waiting) == "A"
    assert made.better(replace(waiting, lift="A")) is None


def test_a_lift_that_refused_a_ride_is_left_for_one_that_does_not_for_a_while() -> None:
    waiting = replace(ride(), request=replace(ANY, lifts=("A", "B")))
    views = (view("A"), view("B", replace(STATE, floor="L4"), Holder("ride", "other")))
    turned = Step(waiting, lift_refusal="its robot hours are over")
    rides, _ = take(Rides(), turned, lifts(*views), at(9.0))
    assert choices(*views, rides=rides).better(waiting) == "B"
    assert choices(*views, rides=rides, now=9.0 + REFUSED_FOR_S).better(waiting) is None


def test_a_ride_that_ends_during_a_pass_keeps_the_others_of_its_robot_at_the_car_that_it_may_be_in() -> None:
    waiting = replace(ride(), id="r2", lift="A", request=ANY)
    made = choices(view("A", replace(IN_CAR, mode=Mode.INSPECTION)), view("B"), view("C"))
    assert made.better(waiting) == "B"
    assert made.go_on(put(Rides(), INSIDE), 9.0).better(waiting) is None
