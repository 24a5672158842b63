"""Which readings of a held lift need no step: those that repeat one that has changed nothing but how long the holds last."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest

from drivers.model import Capabilities, LiftReading, OutputState
from lift_manager.lift.commands import CommandType
from lift_manager.lift.inputs import CommitFailed, EndSession, OutputChanged
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.state import same_but_for_time
from lift_manager.lift.step import PAST_S, RENEWED_EVERY_S, RENEWED_SHARE
from lift_manager.lift.trust import Trust
from register_maps.words import Door, Motion
from tests.lift_manager.lift.paper import HANDSHAKE, PLAIN, ROBOT, PaperLift

STEP_S = 0.2
HELD_FOR_S = 30.0
BOUNDED = replace(
    PLAIN,
    signals=PLAIN.signals | {"destination"},
    max_hold_s={"hold_door.front": HELD_FOR_S, "robot_mode": 2 * HELD_FOR_S},
)
BY_CALL = replace(
    HANDSHAKE,
    signals=HANDSHAKE.signals | {"destination"},
    max_hold_s={"call": HELD_FOR_S, "go": HELD_FOR_S},
    same_floor_call=True,
)


def standing() -> PaperLift:
    """Return a lift that stands for its holder with its door held, and has stood so for a while."""
    lift = PaperLift(BOUNDED)
    lift.called_to("L2")
    polls(lift, 1.2)
    return lift


def polls(lift: PaperLift, seconds: float) -> None:
    """Poll a lift that stays as it is."""
    for _ in range(round(seconds / STEP_S)):
        lift.now += STEP_S
        lift.poll()


def repeats(lift: PaperLift) -> bool:
    """Whether one of the next five readings needs no step if the lift stays as it is."""
    for _ in range(5):
        lift.now += STEP_S
        if lift.repeats(LiftReading(lift.now, 1, lift.values)):
            return True
        lift.poll()
    return False


def test_a_reading_that_repeats_that_of_a_held_lift_is_no_news() -> None:
    lift = standing()
    assert repeats(lift)
    assert not lift.repeats(LiftReading(lift.now, 2, lift.values))
    assert not lift.repeats(LiftReading(lift.now, 1, lift.values, ("a notice",)))
    assert not lift.repeats(LiftReading(lift.now, 1, replace(lift.values, doors={})))


def test_holds_are_renewed_long_before_they_end_and_none_lasts_longer_than_its_map_allows() -> None:
    lift = standing()
    for _ in range(round(3 * HELD_FOR_S / STEP_S)):
        polls(lift, STEP_S)
        left_s = lift.holds["hold_door.front"].until - lift.read_at
        assert HELD_FOR_S - RENEWED_EVERY_S - PAST_S <= left_s <= HELD_FOR_S + PAST_S


def test_a_short_hold_is_renewed_more_often() -> None:
    lift = PaperLift(replace(PLAIN, max_hold_s={"hold_door.front": 4.0}))
    lift.called_to("L2")
    for _ in range(30):
        polls(lift, STEP_S)
        assert lift.holds["hold_door.front"].until - lift.read_at >= 4.0 * (1 - RENEWED_SHARE) - PAST_S


def test_one_step_a_second_is_enough_for_a_held_lift() -> None:
    lift, steps = standing(), 0
    for _ in range(50):
        lift.now += STEP_S
        before = lift.newest
        lift.poll()
        steps += lift.newest is not before
    assert steps <= 12


def _has_pressed(lift: PaperLift) -> None:
    lift.accept("L3")
    assert lift.pressed


def _waits_for_a_grant(lift: PaperLift) -> None:
    lift.able = replace(BOUNDED, requires={"go_to": frozenset({"robot_mode_on"})})
    lift.config = replace(lift.config, capabilities=lift.able)
    lift.read(robot_mode_on=False)
    lift.accept("L3")
    assert "robot_mode_on" in lift.state.restrictions.waiting_for


def _has_lost_its_hold(lift: PaperLift) -> None:
    lift.obeys = False
    lift.status["hold_door.front"] = OutputState.LOST
    lift.take(OutputChanged(dict(lift.status)))


def _is_about_to_end(lift: PaperLift) -> None:
    lift.take(EndSession(ROBOT, grace_s=3.0))
    assert lift.state.ending


def _cannot_write_down(lift: PaperLift) -> None:
    lift.take(CommitFailed("the disk is full"))


def _is_travelling_with_an_open_door(lift: PaperLift) -> None:
    lift.read("L2", Door.OPEN, motion=Motion.UP)


@pytest.mark.parametrize(
    "happens",
    [
        _has_pressed,
        _waits_for_a_grant,
        _has_lost_its_hold,
        _is_about_to_end,
        _cannot_write_down,
        _is_travelling_with_an_open_door,
    ],
)
def test_every_reading_of_a_held_lift_counts_while_it(happens: Callable[[PaperLift], None]) -> None:
    lift = standing()
    happens(lift)
    assert not repeats(lift)


def test_every_reading_counts_in_the_turn_of_people() -> None:
    lift = PaperLift(BOUNDED, site={"between_sessions_s": 5.0})
    lift.called_to("L2")
    lift.accept("L2", hold=False)
    lift.accept("L2")
    assert "people" in lift.state.restrictions.waiting_for
    assert not repeats(lift)


def test_every_reading_counts_until_a_held_door_invites_its_robot() -> None:
    lift = PaperLift(BOUNDED)
    lift.read("L2", Door.OPEN)
    lift.accept("L2")
    for _ in range(20):
        before = lift.door
        lift.now += 0.02
        assert not (lift.repeats(LiftReading(lift.now, 1, lift.values)) and before != "open")
        lift.poll()
    assert lift.door == "open"


# -- a lift that is stepped with every reading, and one that is not


@dataclass
class Twins:
    """One lift twice; the second one steps every reading. Whatever is done to one is done to the other."""

    sparing: PaperLift
    other: PaperLift

    def do(self, act: Callable[[PaperLift], object]) -> None:
        act(self.sparing)
        act(self.other)
        self.compare()

    def polls(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.do(lambda lift: polls(lift, STEP_S))

    def compare(self) -> None:
        one, other = self.sparing, self.other
        assert same_but_for_time(one.state, other.state)
        if one.record.session is not None:
            assert one.record.renewed(0.0) == other.record.renewed(0.0)
        assert one.events == other.events
        assert one.holds.keys() == other.holds.keys()
        for name, hold in one.holds.items():
            assert 0.0 <= other.holds[name].until - hold.until <= RENEWED_EVERY_S + PAST_S


class Unsparing(PaperLift):
    """Steps every reading."""

    def repeats(self, reading: LiftReading) -> bool:
        return False


def _arrives(twins: Twins, floor: str) -> None:
    twins.do(lambda lift: lift.answer())
    twins.do(lambda lift: lift.read(None, Door.CLOSED, motion=Motion.UP, destination=floor))
    twins.polls(3.0)
    twins.do(lambda lift: lift.read(floor, Door.CLOSED, motion=Motion.STOPPED, destination=None))
    twins.polls(1.0)
    twins.do(lambda lift: lift.read(floor, Door.OPEN))


def _stands_until_its_hold_is_spent(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    _arrives(twins, "L2")
    twins.polls(30.0)
    assert twins.sparing.record.session is not None
    assert twins.sparing.record.session.hold_spent
    twins.do(lambda lift: lift.read(door=Door.CLOSED))
    twins.polls(5.0)


def _stands_until_its_lease_is_over(twins: Twins) -> None:
    twins.do(lambda lift: lift.open(ttl_s=15.0))
    twins.do(lambda lift: lift.command(CommandType.GO_TO, "L2"))
    _arrives(twins, "L2")
    twins.polls(20.0)
    assert twins.sparing.holder is None


def _rides_with_words(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    _arrives(twins, "L2")
    twins.polls(12.0)
    twins.do(lambda lift: lift.accept("L3", robot=RobotWord.IN_PLACE))
    twins.do(lambda lift: lift.answer())
    twins.polls(2.0)
    _arrives(twins, "L3")
    twins.polls(12.0)
    twins.do(lambda lift: lift.accept("L3", hold=False, robot=RobotWord.LEFT))
    twins.polls(4.0)
    twins.do(lambda lift: lift.answer())
    twins.polls(4.0)


def _finds_its_door_shut(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    _arrives(twins, "L2")
    twins.polls(3.0)
    twins.do(lambda lift: lift.read(door=Door.CLOSED))
    twins.polls(20.0)


def _stands_while_it_is_restarted(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    _arrives(twins, "L2")
    twins.polls(3.0)
    _continues_after_a_restart(twins, twins.sparing.record.durable)


def _is_restarted_with_a_door_that_is_not_proven_and_no_word_of_its_invitation(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    _arrives(twins, "L2")
    twins.polls(3.0)
    durable = twins.sparing.record.durable
    assert durable.session is not None
    uninvited = replace(durable.session, opened_at_target=False)
    _continues_after_a_restart(twins, replace(durable, session=uninvited, trust=Trust()))


def _continues_after_a_restart(twins: Twins, durable: DurableRecord) -> None:
    before = twins.sparing
    made = [kind(before.able, durable, before.site, now=before.now + 4.9) for kind in (PaperLift, Unsparing)]
    for lift in made:
        lift.status, lift.values = dict(before.status), before.values
    twins.sparing, twins.other = made
    twins.polls(15.0)


def _loses_its_call(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    twins.do(lambda lift: lift.answer())
    twins.do(lambda lift: lift.read(destination="L2"))
    twins.polls(3.0)
    twins.do(lambda lift: lift.read(destination=None))
    twins.polls(3.0)
    call = twins.sparing.record.call
    assert call is not None
    assert "disappeared" in call.reason


def _is_brought_elsewhere_twice(twins: Twins) -> None:
    _is_brought_elsewhere(twins, "L2", "L3")
    _is_brought_elsewhere(twins, "L1", "L2")
    assert twins.sparing.record.durable.trust.distrust


def _is_brought_elsewhere(twins: Twins, floor: str, elsewhere: str) -> None:
    twins.do(lambda lift: lift.accept(floor))
    twins.do(lambda lift: lift.answer())
    twins.do(lambda lift: lift.read(None, motion=Motion.UP))
    twins.do(lambda lift: lift.read(elsewhere, motion=Motion.STOPPED))
    twins.polls(35.0)


def _proves_its_door(twins: Twins) -> None:
    twins.do(lambda lift: lift.accept("L2"))
    twins.do(lambda lift: lift.answer())
    twins.do(lambda lift: lift.read("L2", Door.CLOSED))
    twins.do(lambda lift: lift.read("L2", Door.OPEN))
    twins.polls(6.0)


STORIES = (
    _rides_with_words,
    _stands_until_its_hold_is_spent,
    _stands_until_its_lease_is_over,
    _finds_its_door_shut,
    _stands_while_it_is_restarted,
    _is_restarted_with_a_door_that_is_not_proven_and_no_word_of_its_invitation,
    _loses_its_call,
    _proves_its_door,
)


def twins_of(able: Capabilities, durable: DurableRecord) -> Twins:
    site = {"max_session_hold_s": 20.0, "clear_s": 5.0}
    twins = Twins(PaperLift(able, durable, site), Unsparing(able, durable, site))
    twins.do(lambda lift: lift.read())
    return twins


@pytest.mark.parametrize("able", [BOUNDED, BY_CALL], ids=["holds", "calls"])
@pytest.mark.parametrize("story", STORIES)
def test_a_held_lift_is_the_same_whether_or_not_repeated_readings_are_stepped_if_it(
    able: Capabilities, story: Callable[[Twins], None]
) -> None:
    trust = Trust() if story is _proves_its_door else Trust("1f", door_proven=True)
    story(twins_of(able, DurableRecord(trust=trust)))


def test_a_car_that_rests_at_another_floor_is_judged_as_soon_as_if_every_reading_were_stepped() -> None:
    """Its map shows no call, so only the time at the other floor says that it was not on its way."""
    _is_brought_elsewhere_twice(twins_of(replace(BOUNDED, signals=PLAIN.signals), DurableRecord()))
