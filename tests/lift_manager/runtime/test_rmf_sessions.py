"""Sessions of RMF: they end by their holder's word alone, and its repeats do nothing."""

from dataclasses import replace

from lift_manager.lift.events import SessionEnded, SessionOpened
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.rmf_words import HOLD, NEXT, RMF, arrived, ends, is_refused, open_for_it, wants
from tests.lift_manager.runtime.scripted import OTHER, PERMITTING, PLAIN, Bench, on_bench
from tests.support.refusals import reply
from tests.support.virtual_time import elapse

LEVEL_CALL = replace(PLAIN, commands=frozenset({"call", "go"}), until={"call": "robot_in_place", "go": "robot_left"})
"""The call is what holds the door."""


def test_a_session_of_rmf_that_wants_no_door_held_goes_on_after_the_car_has_arrived() -> None:
    async def check(made: Bench) -> None:
        wants(made, "L1", hold=False)
        await elapse(0.5)
        await made.car(None, Door.CLOSED)
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(20)
        assert made.state.holder == RMF
        assert made.driver.log == ["press go_to L1"]

    on_bench(check, PLAIN)


def test_a_request_of_rmf_with_the_door_closed_lets_the_door_go_and_releases_nothing() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        assert HOLD in made.driver.on
        wants(made, "L1", hold=False)
        await elapse(0.2)
        assert made.driver.on == set()
        assert made.state.holder == RMF
        wants(made, "L1")
        await elapse(0.2)
        assert made.driver.on == {HOLD}
        assert made.presses == ["go_to L1"]

    on_bench(check, PLAIN, poll_s=0.2)


def test_a_door_that_the_call_holds_is_let_go_and_held_again_as_rmf_says() -> None:
    able = replace(LEVEL_CALL, held_commands=frozenset({"call", "go"}))

    async def check(made: Bench) -> None:
        await open_for_it(made)
        wants(made, "L1", hold=False)
        await elapse(1)
        assert made.driver.on == set()
        wants(made, "L1")
        await elapse(1)
        assert made.driver.log == ["press call L1", "let go call", "press call L1"]
        for _ in range(20):
            wants(made, "L1")
            await elapse(0.5)
        assert len(made.presses) == 2

    on_bench(check, able, infer=True)


def test_rmf_gets_no_lift_that_has_to_hear_of_robots_unless_the_site_lets_that_be_inferred() -> None:
    """Its robot would ride in, and every further floor would be refused."""

    async def refused(made: Bench) -> None:
        said = is_refused(made, "L1")
        assert said.code is Refusal.NOT_POSSIBLE
        assert "infer_occupancy" in said.message

    async def taken(made: Bench) -> None:
        wants(made, "L1")

    on_bench(refused, PERMITTING)
    on_bench(taken, PERMITTING, infer=True)
    on_bench(taken, PLAIN)


def test_a_door_is_let_go_for_rmf_though_the_lift_takes_no_commands_now() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        made.driver.silent = True
        await elapse(1.1)
        assert is_refused(made, "L3").code is Refusal.OFFLINE
        wants(made, "L1", hold=False)
        assert "let go hold_door.front" in made.driver.log

    on_bench(check, PLAIN)


def test_a_request_without_a_hold_is_decided_as_one_with_it() -> None:
    async def check(made: Bench) -> None:
        wants(made, "L1", hold=False)
        assert is_refused(made, "L2", hold=False, holder=NEXT).code is Refusal.HELD
        ends(made, 0)
        # the car stands at L2: for another face this would be a release that finds nothing
        wants(made, "L2", hold=False, holder=NEXT)
        assert made.state.holder == NEXT
        assert is_refused(made, "L9", hold=False, holder=NEXT).code is Refusal.UNKNOWN_FLOOR

    on_bench(check, PLAIN)


def test_an_idle_face_that_wants_no_door_takes_no_lift_from_a_silent_session_of_rmf_and_rmf_from_another_does() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3", holder=OTHER)
        await elapse(25)
        assert made.refuse("L1", hold=False, holder=Holder("workshop", "x")).code is Refusal.HELD
        wants(made, "L1", hold=False)
        assert made.state.holder == RMF

    on_bench(check, PLAIN, takeover_after_s=20.0)


def test_rmf_may_be_silent_for_longer_than_any_lease() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await elapse(20)
        assert made.state.holder == RMF

    on_bench(check, PLAIN, lease_s=10)


def test_three_repeats_for_each_state_press_nothing_and_are_never_too_often() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        for _ in range(30):
            for _ in range(3):
                wants(made, "L1")
            await elapse(0.5)
        assert made.driver.log == ["press go_to L1", f"hold {HOLD}"]

    on_bench(check, PLAIN)


def test_replans_as_often_as_rmf_makes_them_are_never_too_often() -> None:
    async def check(made: Bench) -> None:
        for number in range(40):
            wants(made, f"L{1 + 2 * (number % 2)}")
            await elapse(3)
        for _ in range(20):
            ends(made, 1)
            await elapse(0.5)
            wants(made, "L1")
            await elapse(2)
        assert made.state.holder == RMF

    on_bench(check, PLAIN, poll_s=0.4)  # three minutes


def test_a_client_that_asks_for_another_floor_at_wire_speed_is_told_to_wait() -> None:
    async def check(made: Bench) -> None:
        answers = [reply(wants, made, floor) for floor in ["L1", "L2"] * 30]
        assert answers[:20] == [None] * 20
        assert is_refused(made, "L3").code is Refusal.TOO_OFTEN

    on_bench(check, PLAIN)


def test_one_session_of_rmf_follows_the_other_in_line() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1", holder=OTHER)
        assert is_refused(made, "L3").code is Refusal.HELD
        assert made.state.waiting == 1
        made.accept("L2", hold=False, holder=OTHER)
        assert made.state.holder is None
        assert made.refuse("L1", holder=OTHER).code is Refusal.QUEUED
        wants(made, "L3", holder=NEXT)

    on_bench(check, PLAIN)


def test_a_whole_ride_is_one_session_from_the_first_request_to_end() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        assert made.state.holder == RMF
        ends(made)
        await elapse(4)
        events = await heard(made.heard)
        assert [opened.holder for opened in only(events, SessionOpened)] == [RMF]
        assert len(only(events, SessionEnded)) == 1
        assert made.driver.log == [
            *("press go_to L1", f"hold {HOLD}", f"let go {HOLD}"),
            *("press go_to L3", f"hold {HOLD}", f"let go {HOLD}"),
        ]
        assert made.state.restrictions.maybe_aboard is None

    on_bench(check, PLAIN)


def test_a_mode_for_people_ends_a_session_of_rmf_and_its_next_request_says_why() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await made.mode(Mode.INDEPENDENT)
        assert made.state.holder is None
        assert made.driver.on == set()
        assert is_refused(made, "L1").code is Refusal.MODE

    on_bench(check, PLAIN)


def test_boarding_is_inferred_from_what_rmf_asks_where_the_site_allows_that() -> None:
    async def check(made: Bench) -> None:
        wants(made, "L1")
        await elapse(0.5)
        await made.car("L1", Door.OPEN, enter=True)
        assert is_refused(made, "L3").code is Refusal.OCCUPANCY_UNKNOWN
        await elapse(6)
        wants(made, "L3")
        await elapse(1)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]

    on_bench(check, PERMITTING, infer=True)
