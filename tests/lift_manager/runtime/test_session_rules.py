"""Who keeps a lift, for how long, and who may take it or give it away."""

from dataclasses import replace

import pytest

from lift_manager.lift.events import ForceReleased, HandedOver, SessionEnded
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import NO_LEASE, Advice, EndReason, Holder
from register_maps.words import Door, Motion
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.scripted import OTHER, PERMITTING, PLAIN, ROBOT, Bench, boarded, on_bench
from tests.support.refusals import refusal
from tests.support.virtual_time import elapse

RMF = Holder("rmf", "fleet/robot1")
FACES = [Holder(face, name) for face in ("workshop", "api", "rmf", "page", "commissioning") for name in ("r1", "r2")]


async def reasons(made: Bench) -> list[EndReason]:
    return [event.reason for event in only(await heard(made.heard), SessionEnded)]


@pytest.mark.parametrize("holder", FACES, ids=str)
def test_a_release_by_anybody_but_the_holder_ends_nothing(holder: Holder) -> None:
    async def check(made: Bench) -> None:
        made.accept("L2", holder=holder)
        await elapse(1)
        for other in FACES:
            if other == holder:
                continue
            for robot in (None, RobotWord.LEFT):
                refused = made.refuse("L2", robot, hold=False, holder=other)
                assert refused.code is Refusal.HELD
                assert f"held by {holder} since" in refused.message
            handed = refusal(made.site.hand_over, "lift", other, other)
            assert handed.code is Refusal.HELD
        assert made.state.holder == holder
        made.accept("L2", hold=False, holder=holder)
        assert await reasons(made) == [EndReason.RELEASED]

    on_bench(check, PLAIN)


@pytest.mark.parametrize(("face", "over"), [("api", True), ("workshop", True), ("rmf", False)])
def test_a_face_that_cannot_renew_has_no_lease(face: str, *, over: bool) -> None:
    assert (face in NO_LEASE) is not over

    async def check(made: Bench) -> None:
        made.accept("L2", holder=Holder(face, "r1"))
        await elapse(40)
        assert (made.state.holder is None) is over

    on_bench(check, PLAIN, lease_s=30)


@pytest.mark.parametrize("renewed", [False, True])
def test_no_session_lasts_for_ever_renewed_or_not(*, renewed: bool) -> None:
    async def check(made: Bench) -> None:
        made.accept("L2", holder=RMF)
        for _ in range(29):
            await elapse(2)
            if renewed:
                made.accept("L2", holder=RMF)
        assert made.state.holder == RMF
        await elapse(3)
        assert await reasons(made) == [EndReason.MAX_SESSION]

    on_bench(check, PLAIN, max_session_s=60)


def test_a_hand_over_does_not_make_a_session_longer() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        for _ in range(5):
            await elapse(5)
            made.site.hand_over("lift", ROBOT, OTHER)
            await elapse(5)
            made.site.hand_over("lift", OTHER, ROBOT)
        assert made.state.holder == ROBOT
        await elapse(11)
        assert await reasons(made) == [EndReason.MAX_SESSION]

    on_bench(check, PLAIN, max_session_s=60)


async def under_way_with_a_robot(made: Bench) -> None:
    await boarded(made)
    made.driver.values = replace(made.driver.values, floor=None, doors={}, motion=Motion.UP)
    await elapse(0.5)


def test_the_limit_waits_for_a_robot_under_way_until_its_car_stands() -> None:
    async def check(made: Bench) -> None:
        await under_way_with_a_robot(made)
        await elapse(31)
        assert made.state.holder == ROBOT
        made.driver.values = replace(made.driver.values, motion=None)
        await made.ridden_to("L3")
        await elapse(5)
        assert await reasons(made) == [EndReason.MAX_SESSION]

    on_bench(check, PERMITTING, max_session_s=30)


def test_the_limit_waits_no_longer_than_a_car_may_be_under_way_and_then_people_are_told() -> None:
    able = replace(PERMITTING, arrive_within_s=20.0)

    async def check(made: Bench) -> None:
        await under_way_with_a_robot(made)
        await elapse(30 + able.arrive_within_s)
        assert made.state.holder is None
        assert [text for text in await made.alarms() if text.startswith("aboard_abandoned")]

    on_bench(check, able, max_session_s=30)


def silent(texts: list[str]) -> list[str]:
    return [text for text in texts if text.startswith("silent_holder")]


def test_a_silent_holder_is_an_alarm_once_for_each_who_asks() -> None:
    async def check(made: Bench) -> None:
        third = Holder("rmf", "fleet/robot3")
        made.accept("L2")
        for _ in range(40):
            await elapse(1)
            for asker in (OTHER, third):
                assert made.refuse("L3", holder=asker).code is Refusal.HELD
                made.refuse("L3", hold=False, holder=Holder("workshop", "workshop"))
        told = silent(await made.alarms())
        assert len(told) == 2
        assert "api:fleet/robot1 holds the lift" in told[0]
        assert "has sent nothing for 30 s" in told[0]
        assert "api:fleet/robot2 requests it" in told[0]
        assert "`lift-manager release lift --by NAME --reason TEXT`" in told[0]
        assert made.state.holder == ROBOT

    on_bench(check, PLAIN)


def test_a_new_silence_is_a_new_alarm_and_so_is_that_of_the_next_holder() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        for _ in range(2):
            await elapse(31)
            made.refuse("L3", holder=OTHER)
            made.refuse("L3", holder=OTHER)
            made.accept("L2")
        assert len(silent(await made.alarms())) == 2
        third = Holder("rmf", "fleet/robot3")
        made.site.hand_over("lift", ROBOT, third)
        await elapse(31)
        made.refuse("L3", holder=OTHER)
        (told,) = silent(await made.alarms())
        assert "rmf:fleet/robot3 holds the lift" in told

    on_bench(check, PLAIN)


def test_a_holder_that_is_heard_raises_no_alarm_and_loses_nothing() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        for _ in range(8):
            await elapse(5)
            made.accept("L2")
            made.refuse("L3", holder=OTHER)
        assert silent(await made.alarms()) == []
        assert made.state.holder == ROBOT

    on_bench(check, PLAIN, takeover_after_s=20)


def test_askers_with_ever_new_names_do_not_raise_ever_new_alarms() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(31)
        for number in range(300):
            made.refuse("L3", holder=Holder("rmf", f"request#{number}"))
        assert len(silent(await made.alarms())) == 100

    on_bench(check, PLAIN)


def test_an_empty_car_goes_to_the_next_caller_after_the_silence_that_the_site_allows() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await made.car("L2", Door.CLOSED)
        await elapse(19)
        assert made.refuse("L3", holder=OTHER).code is Refusal.HELD
        await elapse(1)
        assert made.refuse("L3", hold=False, holder=OTHER).code is Refusal.HELD
        made.accept("L3", holder=OTHER)
        assert made.state.holder == OTHER
        assert await reasons(made) == [EndReason.TAKEN_OVER]

    on_bench(check, PLAIN, takeover_after_s=20)


def test_a_car_that_may_hold_a_robot_is_not_taken_over() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(40)
        assert made.refuse("L3", holder=OTHER).code is Refusal.HELD
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN, takeover_after_s=20)


def test_a_person_ends_a_session_and_everything_is_let_go() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(1)
        await made.car("L2", Door.OPEN)
        assert made.driver.on
        released = made.site.force_release("lift", "M. Weber", "its battery is flat", at_once=True)
        assert (released.by, released.reason, released.holder) == ("M. Weber", "its battery is flat", ROBOT)
        assert not released.maybe_aboard
        assert "others are refused" not in released.text
        assert made.driver.on == set()
        assert made.presses == []
        events = await heard(made.heard)
        (ended,) = only(events, SessionEnded)
        assert (ended.reason, ended.advice) == (EndReason.FORCED, Advice.CLEAR_DOORWAY)
        assert "released by M. Weber: its battery is flat" in ended.text
        assert only(events, ForceReleased) == [released]
        made.accept("L3", holder=OTHER)

    on_bench(check, PLAIN)


def test_a_car_that_may_hold_a_robot_stays_refused_after_a_person_ended_its_session() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        released = made.site.force_release("lift", "M. Weber", "it is stuck", at_once=True)
        assert released.maybe_aboard
        assert "others are refused until api:fleet/robot1 sends another request or a person has looked" in released.text
        assert "`lift-manager ack lift --by NAME`" in released.text
        assert made.refuse("L3", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        again = refusal(made.site.force_release, "lift", "M. Weber", "it is stuck", at_once=True)
        assert again.code is Refusal.NOT_HELD
        assert "`lift-manager ack lift --by NAME`" in again.message
        made.site.acknowledge("lift", "M. Weber")
        made.accept("L3", holder=OTHER)

    on_bench(check, PLAIN)


def test_robot_mode_is_not_dropped_under_way_when_a_person_ends_the_session() -> None:
    able = replace(
        PLAIN,
        commands=PLAIN.commands | {"robot_mode"},
        signals=PLAIN.signals | {"robot_mode_on", "motion"},
        evidence="motion_stopped",
    )

    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        made.accept("L3")
        await elapse(1)
        made.driver.values = replace(made.driver.values, floor=None, motion=Motion.UP)
        await elapse(1)
        made.site.force_release("lift", "M. Weber", "wrong building")
        await elapse(5)
        assert "robot_mode" in made.driver.on
        made.driver.values = replace(made.driver.values, floor="L3", motion=Motion.STOPPED)
        await elapse(1)
        assert "robot_mode" not in made.driver.on

    on_bench(check, able)


def test_nobody_holds_it_and_nothing_is_released_or_handed_over() -> None:
    async def check(made: Bench) -> None:
        for request in (
            lambda: made.site.force_release("lift", "M. Weber", "?"),
            lambda: made.site.hand_over("lift", ROBOT, OTHER),
        ):
            refused = refusal(request)
            assert (refused.code, refused.message) == (Refusal.NOT_HELD, "nobody holds lift")

    on_bench(check, PLAIN)


def test_a_holder_hands_the_lift_over_with_what_is_known_of_the_robot() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        pressed = list(made.presses)
        made.site.hand_over("lift", ROBOT, OTHER)
        await elapse(29)
        assert made.presses == pressed
        assert made.state.holder == OTHER
        assert made.state.restrictions.maybe_aboard == OTHER
        assert only(await heard(made.heard), HandedOver) == [HandedOver("lift", ROBOT, OTHER)]
        assert made.refuse("L1").code is Refusal.HELD
        await made.ridden_to("L3")
        made.accept("L3", RobotWord.LEFT, hold=False, holder=OTHER)
        await elapse(1)
        assert made.presses == [*pressed, "robot_left"]

    on_bench(check, PERMITTING, lease_s=30)


def test_a_hand_over_starts_the_lease_anew() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(25)
        made.site.hand_over("lift", ROBOT, OTHER)
        await elapse(25)
        assert made.state.holder == OTHER
        await elapse(6)
        assert await reasons(made) == [EndReason.LEASE]

    on_bench(check, PLAIN, lease_s=30)


def test_a_holder_that_hands_the_lift_to_itself_merely_renews_it() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        made.site.hand_over("lift", ROBOT, ROBOT)
        assert made.state.holder == ROBOT
        assert only(await heard(made.heard), HandedOver) == []

    on_bench(check, PLAIN)
