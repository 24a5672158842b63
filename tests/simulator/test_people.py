"""Passengers: who comes follows from the seed, everybody gets somewhere, and the lift stays a lift."""

from dataclasses import dataclass, field, replace
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from register_maps.words import Door, Mode
from simulator.controller import Inputs, ShownState
from simulator.faults import InMode, MachineFault, NudgingDoor, StuckDoor
from simulator.people import Counts, People, Traffic
from tests.simulator.bench import FRONT, Lift, floors
from tests.support.examples import examples

LOOK_S = 0.25
NO_HABITS = Traffic(holders=0.0, wrong_button=0.0, all_buttons=0.0, bold=0.0, heavy=0.0)
BUSY = replace(NO_HABITS, per_minute=20.0)


@dataclass
class House:
    """A lift on a bench, its people, and what was seen of both; somebody looks four times a second."""

    people: People
    lift: Lift = field(default_factory=Lift)
    others: Inputs = field(default_factory=Inputs)
    now: float = 0.0
    did: list[tuple[float, Inputs]] = field(default_factory=list)
    seen: list[ShownState] = field(default_factory=list)

    def live(self, duration_s: float) -> Counts:
        for _ in range(round(duration_s / LOOK_S)):
            if self.now >= self.people.next_at:
                self.others = self.people.act(self.now, self.lift.see(), self.others)
                self.did.append((self.now, self.others))
            self.lift.inputs = self.others
            self.seen.append(self.lift.run(LOOK_S))
            self.now += LOOK_S
            assert self.people.counts.riding <= self.people.traffic.load
        return self.people.counts

    def fail(self, *faults: MachineFault) -> None:
        self.others = replace(self.others, faults=frozenset(faults))

    def ask_for_robots(self, *, on: bool) -> None:
        self.others = replace(self.others, robot_mode_request=on)


def house(seed: int = 1, traffic: Traffic | None = None) -> House:
    return House(People(seed, 5, traffic or Traffic()))


def stop_coming(one: House) -> None:
    one.people.traffic = replace(one.people.traffic, per_minute=1e-9)


# -- they get where they want


def test_on_a_lift_that_works_everybody_who_comes_is_delivered() -> None:
    one = house(1, replace(NO_HABITS, patience_s=600.0))
    one.live(300)
    stop_coming(one)
    counts = one.live(200)
    assert counts == Counts(0, 0, counts.come, 0)
    assert counts.come > 10


def test_people_with_all_their_habits_are_delivered_too() -> None:
    counts = house(3).live(400)
    assert counts.delivered > 8
    assert counts.given_up < counts.delivered / 8


def test_people_are_delivered_while_robots_take_the_lift_every_other_minute() -> None:
    one = house(1)
    for _ in range(3):
        one.ask_for_robots(on=True)
        one.live(90)
        one.ask_for_robots(on=False)
        one.live(60)
    granted = sum(picture.robot_mode_on for picture in one.seen) / len(one.seen)
    assert granted > 0.2
    assert one.people.counts.delivered > 7


@given(seed=st.integers(0, 10_000), per_minute=st.sampled_from([1.0, 6.0, 40.0]))
@examples(4)
def test_nobody_vanishes_and_nobody_comes_from_nowhere(seed: int, per_minute: float) -> None:
    one = house(seed, Traffic(per_minute=per_minute))
    before = one.people.counts
    for _ in range(60):
        counts = one.live(5)
        assert counts.come >= before.come
        assert counts.delivered >= before.delivered
        assert counts.given_up >= before.given_up
        assert counts.come - before.come <= per_minute  # a twelfth is expected
        before = counts


def test_who_has_waited_too_long_takes_the_stairs() -> None:
    one = house(1, NO_HABITS)
    one.fail(InMode(Mode.OUT_OF_SERVICE))
    counts = one.live(600)
    assert counts.delivered == counts.riding == 0
    assert counts.given_up > 15
    assert counts.waiting < 15


def test_who_is_in_the_car_gets_out_when_it_goes_out_of_service_with_its_doors_open() -> None:
    one = house(4, BUSY)
    while one.people.counts.riding < 2:
        one.live(LOOK_S)
    stop_coming(one)
    one.fail(InMode(Mode.EMERGENCY))
    counts = one.live(60)
    assert counts.riding == 0
    assert counts.given_up >= 2


def test_people_stay_where_they_are_behind_a_door_that_does_not_open() -> None:
    one = house(4, BUSY)
    while one.people.counts.riding < 2 or one.lift.see().door_open_floor is not None:
        one.live(LOOK_S)
    while one.lift.see().doors != dict.fromkeys(FRONT, Door.CLOSED):
        one.live(LOOK_S)
    riding = one.people.counts.riding
    one.fail(StuckDoor())
    assert one.live(100).riding == riding
    one.fail()
    stop_coming(one)
    assert one.live(300).riding == 0


# -- how they do it


def test_they_call_at_the_landing_and_press_in_the_car_and_break_the_light_curtain_on_the_way() -> None:
    one = house(1, NO_HABITS)
    while not one.people.counts.delivered:
        one.live(LOOK_S)
    did = [inputs for _, inputs in one.did]
    called = next(n for n, inputs in enumerate(did) if inputs.landing_buttons)
    walked = next(n for n, inputs in enumerate(did) if inputs.obstruction)
    pressed = next(n for n, inputs in enumerate(did) if inputs.car_buttons)
    assert called < walked < pressed


def test_the_light_curtain_is_broken_only_at_a_floor_where_the_door_was_open() -> None:
    one = house(5, Traffic(per_minute=15.0))
    one.live(200)
    for picture in one.seen:
        if picture.obstruction:
            assert picture.level_floor is not None


def test_a_button_is_let_go_of_and_pressed_again_while_its_lamp_stays_dark() -> None:
    one = house(1, NO_HABITS)
    one.fail(InMode(Mode.OUT_OF_SERVICE))  # registers no call
    one.live(60)
    presses = [bool(inputs.landing_buttons) for _, inputs in one.did]
    assert presses.count(True) > 4
    assert presses.count(False) > 4


def test_a_holder_keeps_the_door_open_by_button_or_by_standing_in_it() -> None:
    one = house(1, replace(NO_HABITS, holders=1.0))
    one.live(300)
    assert any(inputs.hold_door for _, inputs in one.did)
    longest = run = 0
    for picture in one.seen:
        run = run + 1 if picture.door_open_floor is not None else 0
        longest = max(longest, run)
    assert longest * LOOK_S > 10
    assert one.people.counts.delivered > 5


def test_a_child_presses_every_floor_and_the_car_stops_at_all_of_them() -> None:
    one = house(1, replace(NO_HABITS, all_buttons=1.0))
    while not one.people.counts.delivered:
        one.live(LOOK_S)
    assert any(inputs.car_buttons == floors(0, 1, 2, 3, 4) for _, inputs in one.did)


def test_who_presses_a_wrong_button_presses_the_right_one_after_it() -> None:
    one = house(2, replace(NO_HABITS, wrong_button=1.0, patience_s=600.0))
    one.live(300)
    stop_coming(one)
    counts = one.live(200)
    assert counts == Counts(0, 0, counts.come, 0)
    assert counts.come > 5


def test_too_much_load_makes_the_car_complain_until_it_is_out_again() -> None:
    one = house(1, replace(NO_HABITS, heavy=1.0))
    one.live(300)
    assert any(picture.overload for picture in one.seen)
    stop_coming(one)
    counts = one.live(300)
    assert counts == Counts(0, 0, 0, counts.come)
    assert not one.seen[-1].overload


def test_one_too_many_overloads_the_car_for_a_moment_and_waits_for_the_next() -> None:
    crowd = replace(NO_HABITS, per_minute=60.0, load=2, from_lowest=1.0)
    one = house(1, crowd)
    one.live(200)
    assert any(picture.overload for picture in one.seen)
    assert one.people.counts.delivered >= 5


@pytest.mark.parametrize(("share", "rides"), [(0.0, False), (1.0, True)])
def test_only_the_bold_get_into_a_car_in_robot_mode(share: float, rides: bool) -> None:
    one = house(1, replace(BUSY, bold=share))
    one.ask_for_robots(on=True)
    one.live(5)
    for _ in range(8):
        one.others = replace(one.others, car_buttons=floors(0, 1, 2, 3))
        one.live(10)
        one.others = replace(one.others, car_buttons=floors())
        one.live(10)
    assert any(picture.robot_mode_on and picture.door_open_floor is not None for picture in one.seen)
    assert (one.people.counts.delivered > 0) is rides


# -- the seed


def history(seed: int) -> list[tuple[float, Inputs]]:
    one = house(seed)
    one.live(120)
    return one.did


def test_the_same_seed_and_the_same_looks_give_the_same_people_and_another_seed_gives_others() -> None:
    seven = history(7)
    assert history(7) == seven
    assert history(8) != seven


def test_who_comes_does_not_depend_on_what_the_lift_does() -> None:
    whole, broken = house(9), house(9)
    broken.fail(StuckDoor(), NudgingDoor(), InMode(Mode.OUT_OF_SERVICE))
    for _ in range(36):
        assert whole.live(5).come == broken.live(5).come
    assert whole.people.counts.come > 5


def test_they_begin_to_come_at_the_first_look() -> None:
    people = People(1, 5)
    picture = Lift().see()
    assert people.act(1000.0, picture, Inputs()) == Inputs()
    assert people.counts == Counts(0, 0, 0, 0)
    assert 1000.0 < people.next_at < inf


def test_with_nobody_there_the_next_look_is_when_somebody_comes() -> None:
    people = People(1, 5)
    picture = Lift().see()
    people.act(0.0, picture, Inputs())
    due = people.next_at
    people.act(due, picture, Inputs())
    assert people.counts.waiting == 1
    assert people.next_at == due + people.traffic.looks_s


def test_what_others_do_at_the_same_inputs_stays() -> None:
    one = house(6, BUSY)
    theirs = Inputs(hold_door=FRONT, robot_mode_request=True, fire=False, faults=frozenset({NudgingDoor()}))
    one.others = theirs
    one.live(120)
    assert one.people.counts.come > 10
    assert one.others.hold_door == FRONT
    assert one.others.robot_mode_request
    assert one.others.faults == theirs.faults


@pytest.mark.parametrize("many", [0, 1])
def test_nobody_rides_where_there_is_nowhere_to_go(many: int) -> None:
    with pytest.raises(ValueError, match="two or more"):
        People(1, many)


@pytest.mark.parametrize("wrong", [{"per_minute": 0.0}, {"load": 0}, {"looks_s": 0.0}])
def test_traffic_without_people_or_room_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="traffic needs"):
        Traffic(**wrong)  # type: ignore[arg-type]  # the wrong numbers of each field
