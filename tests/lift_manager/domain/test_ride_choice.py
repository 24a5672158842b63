"""Which lift a ride takes."""

from dataclasses import replace

import pytest

from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.description import LiftDescription
from lift_manager.domain.ride import RideRequest
from lift_manager.domain.ride_choice import Choice, choose, unfit
from lift_manager.domain.state import Holder, LiftState, Quality, Restrictions
from register_maps.words import Mode, Side
from tests.lift_manager.domain.ride_sights import HOLDER, STATE, WISH
from tests.lift_manager.domain.test_call import ABLE

FLOORS = ("L1", "L2", "L3", "L4")
ANY = replace(WISH, lifts=("A", "B", "C"), any_lift=True)


ABLE_TO_HOLD = replace(ABLE, commands=frozenset({"go_to", "hold_door.front"}))


def described(lift: str = "A", floors: tuple[str, ...] = FLOORS, **more: object) -> LiftDescription:
    made = LiftDescription(
        lift=lift,
        floors=floors,
        doors_at=dict.fromkeys(floors, (Side.FRONT,)),
        control=True,
        able=ABLE_TO_HOLD,
        poll_s=0.1,
        lease_s=300.0,
        max_session_s=3600.0,
        max_session_hold_s=900.0,
        clear_s=10.0,
        robot_hours="",
    )
    return replace(made, **more)  # type: ignore[arg-type]  # fields of LiftDescription


def choice(
    lift: str, state: LiftState = STATE, *, floor: str | None = "L2", waiting: int = 0, refused: str = ""
) -> Choice:
    return Choice(described(lift), replace(state, lift=lift, floor=floor), waiting, refused)


@pytest.mark.parametrize(
    ("lift", "wish", "code", "words"),
    [
        (described(floors=("L1", "L2")), WISH, Refusal.UNKNOWN_FLOOR, "A has no floor 'L3'; its floors are L1, L2"),
        (described(), replace(WISH, destination="L1"), Refusal.NOT_POSSIBLE, "begins and ends at L1"),
        (described(), replace(WISH, door=Side.REAR), Refusal.NOT_POSSIBLE, "no rear door at L1; there it has front"),
        (described(control=False), WISH, Refusal.MONITOR_ONLY, "A is only watched"),
        (described(), replace(WISH, door=Side.FRONT), None, ""),
        (described(able=ABLE), WISH, Refusal.NOT_POSSIBLE, "its map by-hand has no hold for the front door at L1"),
        (described(able=replace(ABLE, until={"call": "robot_left"})), WISH, None, ""),
        (described(doors_at={}), WISH, Refusal.NOT_POSSIBLE, "its map by-hand shows no door at L1"),
        (
            described(able=replace(ABLE_TO_HOLD, doors=())),
            WISH,
            Refusal.NOT_POSSIBLE,
            "its map by-hand shows no door at L1",
        ),
        (
            described(able=replace(ABLE, commands=frozenset({"go"}))),
            WISH,
            Refusal.NOT_POSSIBLE,
            "has neither go_to nor call",
        ),
    ],
)
def test_a_lift_that_can_never_take_a_ride_is_refused(
    lift: LiftDescription, wish: RideRequest, code: Refusal | None, words: str
) -> None:
    refused = unfit(wish, lift)
    assert (None if refused is None else refused.code) == code
    assert refused is None or words in refused.message


BUSY = replace(STATE, holder=Holder("rmf", "tiny"))
OFFLINE = replace(STATE, quality=Quality.OFFLINE)
LATCHED = replace(STATE, restrictions=Restrictions(fire_latched=True))
LOCKED = replace(STATE, restrictions=Restrictions(lockout="by Ana"))
OCCUPIED = replace(STATE, restrictions=Restrictions(maybe_aboard=Holder("rmf", "tiny")))


@pytest.mark.parametrize(
    ("lifts", "best"),
    [
        ((choice("A"), choice("B"), choice("C")), "A"),
        ((choice("A", floor="L4"), choice("B", floor="L1"), choice("C", floor="L2")), "B"),
        ((choice("A", floor=None), choice("B", floor="L4")), "B"),
        ((choice("A", BUSY, floor="L1"), choice("B", floor="L4")), "B"),
        ((choice("A", waiting=2, floor="L1"), choice("B", BUSY, floor="L4")), "B"),
        ((choice("A", OFFLINE), choice("B", BUSY, waiting=3)), "B"),
        ((choice("A", LATCHED), choice("B", BUSY)), "B"),
        ((choice("A", LOCKED), choice("B", BUSY)), "B"),
        ((choice("A", OCCUPIED), choice("B", BUSY)), "B"),
        ((choice("A", replace(STATE, mode=Mode.INSPECTION)), choice("B", BUSY)), "B"),
        ((choice("A", refused="its robot hours are over"), choice("B", BUSY)), "B"),
        ((choice("A", OFFLINE), choice("B", OFFLINE)), "A"),
    ],
)
def test_the_best_lift_takes_robots_then_has_the_shortest_line_then_is_nearest(
    lifts: tuple[Choice, ...], best: str
) -> None:
    chosen = choose(ANY, HOLDER, lifts)
    assert isinstance(chosen, Choice)
    assert chosen.lift == best


def test_a_car_that_may_hold_the_robot_itself_takes_it() -> None:
    own = replace(STATE, restrictions=Restrictions(maybe_aboard=HOLDER))
    chosen = choose(ANY, HOLDER, (choice("A", own), choice("B", BUSY)))
    assert isinstance(chosen, Choice)
    assert chosen.lift == "A"


def test_a_robot_that_may_be_in_a_car_is_given_no_other_though_that_is_nearer_and_free() -> None:
    own = replace(STATE, restrictions=Restrictions(maybe_aboard=HOLDER))
    lifts = (choice("B", floor="L1"), choice("A", own, floor="L4", waiting=3))
    chosen = choose(ANY, HOLDER, lifts)
    assert isinstance(chosen, Choice)
    assert chosen.lift == "A"
    unnamed = choose(replace(ANY, robot=""), HOLDER, lifts)
    assert isinstance(unnamed, Choice)
    assert unnamed.lift == "B", "nobody knows whose robot is in the car"


def test_where_no_lift_serves_both_floors_the_refusal_names_lifts_and_floors() -> None:
    lifts = tuple(Choice(described(lift, ("L1", "L2")), STATE, 0, "") for lift in ("A", "B"))
    refused = choose(ANY, HOLDER, lifts)
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.UNKNOWN_FLOOR
    assert "from L1 to L3" in refused.message
    assert "A has no floor 'L3'; its floors are L1, L2; B has no floor 'L3'" in refused.message


def test_lifts_that_do_not_fit_for_different_reasons_are_not_possible() -> None:
    lifts = (Choice(described("A", ("L1", "L2")), STATE, 0, ""), Choice(described("B", control=False), STATE, 0, ""))
    refused = choose(ANY, HOLDER, lifts)
    assert isinstance(refused, Refused)
    assert refused.code is Refusal.NOT_POSSIBLE


def test_no_lift_at_all_is_refused() -> None:
    refused = choose(ANY, HOLDER, ())
    assert isinstance(refused, Refused)
    assert "none to choose among" in refused.message
