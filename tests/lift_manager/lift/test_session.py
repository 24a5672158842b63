"""Sessions over time and over restarts: whatever the clocks do, none lasts longer than it may."""

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta, tzinfo
from zoneinfo import ZoneInfo

from hypothesis import given
from hypothesis import strategies as st

from lift_manager.lift import lease, restart
from lift_manager.lift import session as sessions
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.draft import Draft
from lift_manager.lift.inhibits import held_by_another
from lift_manager.lift.observation import Moment
from lift_manager.lift.occupancy import BoardingProgress, Occupancy, SavedBoarding
from lift_manager.lift.record import DurableRecord, HandshakeWord, LiftRecord, SavedSession
from lift_manager.lift.refusals import Blocking, Refusal, Refused, how_to_acknowledge, how_to_end_lockout
from lift_manager.lift.session import Advice, EndReason, Holder, Session, advise, policy_for
from lift_manager.lift.step import start
from register_maps.words import Door, Side
from tests.lift_manager.lift.paper import PaperLift
from tests.support.rows import each_row

AT = datetime(2026, 3, 2, 12, tzinfo=UTC)
ONE, OTHER, RMF = Holder("api", "r1"), Holder("api", "r2"), Holder("rmf", "fleet/r1")
LEASE_S, CLEAR_S = 300.0, 10.0
CONFIG = PaperLift(site={"lease_s": LEASE_S, "clear_s": CLEAR_S, "max_session_s": 3600.0}).config
FRONT, REAR = Side.FRONT, Side.REAR
seconds = st.floats(0, 1e6).map(lambda value: round(value, 3))


def opened(holder: Holder = ONE, at: float = 100.0, *, stays: bool = False) -> Session:
    """A session that was requested, and nothing since."""
    return Session(
        number=1,
        holder=holder,
        policy=policy_for(CONFIG, holder, stays=stays),
        floor="L1",
        hold_door=True,
        opened_at=at,
        opened_clock=AT,
        lease_from=at,
        contacted_at=at,
    )


def saved(session: Session, now: float, at: datetime = AT, record: LiftRecord | None = None) -> SavedSession:
    draft = Draft(CONFIG, replace(record or LiftRecord(), session=session), Moment(now, at))
    restart.save(draft)
    assert draft.record.durable.session is not None
    return draft.record.durable.session


def restored(written: SavedSession, now: float, at: datetime) -> Session:
    """Go on with it on another monotonic clock; its lease is long enough."""
    config = replace(CONFIG, lease_s=1e9, max_session_s=1e9)
    session = start(config, DurableRecord(session=written), Moment(now, at)).record.session
    assert session is not None
    return session


# -- over a restart


def test_what_is_saved_says_everything_but_the_monotonic_clock() -> None:
    word = HandshakeWord(Call("L1", CallPhase.CONFIRMED, 120.0))
    call = Call("L1", CallPhase.CONFIRMED, 120.0)
    boarding = BoardingProgress(Occupancy.ABOARD, sent_on=True, may_leave_at="L3")
    written = saved(opened(), 160.0, record=LiftRecord(boarding=boarding, in_place=word, call=call))
    assert (written.holder, written.floor, written.hold_door, written.pressed) == (ONE, "L1", True, True)
    assert written.opened_at == written.lease_from == AT - timedelta(seconds=60)
    assert (written.saved_at, written.boarding) == (
        AT,
        SavedBoarding(Occupancy.ABOARD, sent_on=True, may_leave_at="L3", in_place_taken=True),
    )


def test_a_restart_counts_the_time_that_it_took() -> None:
    session = restored(saved(opened(), 160.0), 5.0, AT + timedelta(seconds=40))
    assert (session.is_restored, session.contacted_at) == (True, None)
    assert 5.0 - session.opened_at == 100.0
    assert lease.lease_ends_at(session, CONFIG) == 5.0 + LEASE_S - 100.0


@given(age_s=seconds, back_s=seconds, now=seconds)
def test_a_wall_clock_that_went_back_counts_as_no_time(age_s: float, back_s: float, now: float) -> None:
    session = restored(saved(opened(at=0.0), age_s), now, AT - timedelta(seconds=back_s))
    assert abs(now - session.opened_at - age_s) < 1e-3


@given(age_s=seconds, gone_s=seconds, jump_s=st.floats(-1e6, 1e6), now=seconds)
def test_no_clock_makes_a_lease_longer_than_one_lease(age_s: float, gone_s: float, jump_s: float, now: float) -> None:
    written = saved(opened(at=0.0), age_s)
    moment = Moment(now, AT + timedelta(seconds=gone_s + jump_s))
    session = start(CONFIG, DurableRecord(session=written), moment).record.session
    rest_s = 0.0 if session is None else lease.lease_ends_at(session, CONFIG) - now
    assert rest_s <= LEASE_S + 1e-3
    if jump_s >= 0:
        # its robot may be in the doorway
        assert rest_s <= max(CLEAR_S, LEASE_S - gone_s - age_s) + 1e-3


def test_a_time_in_the_future_counts_as_none_gone() -> None:
    assert restored(saved(opened(at=500.0), 100.0), 50.0, AT).opened_at == 50.0


@each_row("zone", [UTC, ZoneInfo("Europe/Berlin")])
@each_row("hour", [datetime(2026, 10, 25, 1, 5, tzinfo=UTC), datetime(2026, 3, 29, 1, 5, tzinfo=UTC)])
def test_a_session_counts_the_same_seconds_when_the_clocks_change(hour: datetime, zone: tzinfo) -> None:
    written = saved(replace(opened(at=0.0), holding_since=300.0), 600.0, hour.astimezone(zone))
    assert written.opened_at == hour - timedelta(seconds=600)
    again = restored(written, 1000.0, (hour + timedelta(seconds=2)).astimezone(zone))
    assert (again.opened_at, again.lease_from, again.holding_since) == (398.0, 398.0, 698.0)


def test_a_manager_that_is_off_while_the_clocks_change_counts_the_seconds_that_passed() -> None:
    berlin, before = ZoneInfo("Europe/Berlin"), datetime(2026, 10, 25, 0, 59, tzinfo=UTC)
    written = replace(saved(opened(at=0.0), 0.0, before), saved_at=before.astimezone(berlin))
    again = restored(written, 1000.0, (before + timedelta(seconds=120)).astimezone(berlin))
    assert again.opened_at == 880.0


def test_a_request_of_the_holder_makes_a_restored_session_an_ordinary_one() -> None:
    session = restored(saved(opened(), 100.0), 5.0, AT)
    again = sessions.set_target(session, "L1", 6.0, hold_door=True)
    assert (again.number, again.is_restored, again.silent_for(9.0)) == (session.number, False, 3.0)
    assert (again.is_unclaimed, session.is_unclaimed) == (False, True)
    assert session.silent_for(9.0) == 4.0


# -- who, and for how long


def test_another_caller_is_refused_with_who_holds_it_and_since_when() -> None:
    refused = held_by_another(opened(at=100.0), Moment(142.0, AT))
    blocking = Blocking(holder=ONE, since_s=42.0)
    assert refused == Refused(Refusal.HELD, "held by api:r1 since 42 s", blocking)


def test_a_hand_over_renews_the_lease_and_not_the_limit() -> None:
    session = sessions.hand_session_over(opened(at=0.0), CONFIG, OTHER, "new", 50.0)
    assert (session.holder, session.id) == (OTHER, "new")
    assert lease.lease_ends_at(session, CONFIG) == 50.0 + LEASE_S
    assert lease.longest_until(session, CONFIG) == 3600.0


def test_a_face_that_cannot_renew_has_a_limit_and_no_lease() -> None:
    assert "rmf" in sessions.NO_LEASE
    session = opened(RMF)
    assert lease.lease_ends_at(session, CONFIG) == math.inf
    assert lease.longest_until(session, CONFIG) == 3700.0


@each_row(
    ("holder", "stays", "has_words", "clear_s"),
    [
        (RMF, True, False, CONFIG.rmf_clear_s),
        (RMF, False, False, CONFIG.rmf_clear_s),
        (ONE, True, True, CLEAR_S),
        (ONE, False, False, CLEAR_S),
    ],
)
def test_a_session_of_rmf_has_no_words_and_one_of_the_api_that_stays_has(
    holder: Holder, *, stays: bool, has_words: bool, clear_s: float
) -> None:
    policy = policy_for(CONFIG, holder, stays=stays)
    assert (policy.stays, policy.has_robot_words, policy.clear_s) == (stays, has_words, clear_s)


def test_a_session_that_is_to_end_begins_nothing_and_goes_on_at_its_holders_request() -> None:
    session = opened(RMF, 0.0, stays=True)
    ending = sessions.end_by_holder(session, 3.0, 10.0)
    assert ending.end is not None
    assert (ending.end.at, ending.contacted_at, ending.may_begin, session.may_begin) == (13.0, 10.0, False, True)
    ends_at = [end.at for grace_s in (30.0, 0.0) if (end := sessions.end_by_holder(ending, grace_s, 11.0).end)]
    assert ends_at == [13.0, 11.0]
    assert sessions.door_opened_at_target(ending, 11.0) is ending
    again = sessions.set_target(ending, "L1", 12.0, hold_door=True)
    assert (again.number, again.end, again.may_begin) == (1, None, True)
    assert sessions.hand_session_over(ending, CONFIG, OTHER, "new", 12.0).end is None


def test_a_session_whose_end_was_announced_is_renewed_in_vain_and_may_be_ended_earlier() -> None:
    closing = sessions.announce_end(opened(), EndReason.LOCKOUT, "locked out", 150.0)
    for after in (sessions.renew(closing, 120.0), sessions.set_target(closing, "L3", 120.0, hold_door=True)):
        assert after.end == closing.end
    earlier = sessions.end_by_holder(closing, 0.0, 120.0).end
    assert earlier is not None
    assert (earlier.reason, earlier.at, earlier.is_announced) == (EndReason.LOCKOUT, 120.0, True)


def test_a_session_that_was_given_to_rmf_stays_from_its_first_request_on() -> None:
    lift = PaperLift()
    lift.read()
    workshop = Holder("workshop", "x")
    lift.accept("L1", holder=workshop)
    handed = sessions.hand_session_over(opened(workshop), CONFIG, RMF, "new", 1.0)
    assert not handed.policy.stays
    lift.record = replace(lift.record, session=replace(handed, floor="L1"))
    lift.accept("L2", holder=RMF, stays=True)
    assert lift.record.session is not None
    assert lift.record.session.policy.stays


# -- what robots and people are told


@each_row("doors", [{FRONT: Door.CLOSED}, {FRONT: Door.CLOSED, REAR: Door.CLOSED}])
@each_row("may_be_aboard", [True, False])
def test_a_robot_that_may_be_aboard_behind_shut_doors_stays_there_and_another_one_keeps_out(
    doors: Mapping[Side, Door], *, may_be_aboard: bool
) -> None:
    expected = Advice.STAY_ABOARD if may_be_aboard else Advice.CLEAR_DOORWAY
    assert advise(doors, may_be_aboard=may_be_aboard) is expected


@each_row(
    "doors",
    [
        *({FRONT: door} for door in sorted(set(Door) - {Door.CLOSED})),
        {FRONT: Door.CLOSED, REAR: Door.OPEN},
        {},
        None,
    ],
)
@each_row("may_be_aboard", [True, False])
def test_a_door_that_is_not_seen_to_be_shut_is_kept_clear(
    doors: Mapping[Side, Door] | None, *, may_be_aboard: bool
) -> None:
    assert advise(doors, may_be_aboard=may_be_aboard) is Advice.CLEAR_DOORWAY


def test_the_advice_to_a_person_can_be_pasted_into_a_shell() -> None:
    assert how_to_acknowledge("east wing") == "`lift-manager ack 'east wing' --by NAME`"
    assert how_to_end_lockout("east") == "`lift-manager lockout east --by NAME --end`"
