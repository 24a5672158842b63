"""Sessions over time and over restarts: whatever the clocks do, none lasts longer than it may."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta, tzinfo
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Ask, Blocking, Refusal, Refused
from lift_manager.domain.boarding import KeptBoarding, Who
from lift_manager.domain.session import (
    NO_LEASE,
    Session,
    admit,
    ends_at,
    handed_over,
    kept,
    lease_ends_at,
    restored,
    silent_for,
    unclaimed,
)
from lift_manager.domain.state import Holder

AT = datetime(2026, 3, 2, 12, tzinfo=UTC)
ONE, OTHER, RMF = Holder("api", "r1"), Holder("api", "r2"), Holder("rmf", "fleet/r1")
LEASE_S = 300.0
seconds = st.floats(0, 1e6).map(lambda value: round(value, 3))


def opened(holder: Holder = ONE, at: float = 100.0) -> Session:
    session = admit(None, Ask("lift", holder, "L1", hold_door=True), number=1, now=at)
    assert isinstance(session, Session)
    return session


def after_a_restart(session: Session, *, kept_at: float, wall_s: float, now: float) -> Session:
    """Keep it, and take it up on another monotonic clock `wall_s` later by the clock on the wall."""
    written = kept(session, KeptBoarding(), pressed=True, at=AT, now=kept_at)
    return restored(written, number=7, at=AT + timedelta(seconds=wall_s), now=now)


def test_what_is_kept_says_everything_but_the_monotonic_clock() -> None:
    boarding = KeptBoarding(Who.ABOARD, sent_on=True, may_leave_at="L3", in_place_told=True)
    written = kept(opened(), boarding, pressed=True, at=AT, now=160.0)
    assert (written.holder, written.floor, written.hold_door, written.pressed) == (ONE, "L1", True, True)
    assert written.opened_at == written.lease_from == AT - timedelta(seconds=60)
    assert (written.kept_at, written.boarding) == (AT, boarding)


def test_a_restart_counts_the_time_that_it_took() -> None:
    session = after_a_restart(opened(), kept_at=160.0, wall_s=40.0, now=5.0)
    assert (session.number, session.restored, session.heard_at) == (7, True, None)
    assert 5.0 - session.opened_at == 100.0
    assert lease_ends_at(session, LEASE_S) == 5.0 + LEASE_S - 100.0


@given(age_s=seconds, back_s=seconds, now=seconds)
def test_a_wall_clock_that_went_back_counts_as_no_time(age_s: float, back_s: float, now: float) -> None:
    session = after_a_restart(opened(at=0.0), kept_at=age_s, wall_s=-back_s, now=now)
    assert abs(now - session.opened_at - age_s) < 1e-3


@given(age_s=seconds, gone_s=seconds, jump_s=st.floats(-1e6, 1e6), now=seconds)
def test_no_clock_makes_a_lease_longer_than_one_lease(age_s: float, gone_s: float, jump_s: float, now: float) -> None:
    session = after_a_restart(opened(at=0.0), kept_at=age_s, wall_s=gone_s + jump_s, now=now)
    rest_s = lease_ends_at(session, LEASE_S) - now
    assert rest_s <= LEASE_S + 1e-3
    if jump_s >= 0:
        assert rest_s <= LEASE_S - gone_s - age_s + 1e-3


def test_a_time_in_the_future_counts_as_none_gone() -> None:
    written = kept(opened(at=500.0), KeptBoarding(), pressed=False, at=AT, now=100.0)
    assert restored(written, number=1, at=AT, now=50.0).opened_at == 50.0


def test_a_request_of_the_holder_makes_a_restored_session_an_ordinary_one() -> None:
    session = after_a_restart(opened(), kept_at=100.0, wall_s=0.0, now=5.0)
    again = admit(session, Ask("lift", ONE, "L1", hold_door=True), number=8, now=6.0)
    assert isinstance(again, Session)
    assert (again.number, again.restored, silent_for(again, 9.0)) == (7, False, 3.0)
    assert not unclaimed(again)
    assert unclaimed(session)
    assert silent_for(session, 9.0) == 4.0


def test_another_caller_is_told_who_holds_it_and_since_when() -> None:
    refused = admit(opened(at=100.0), Ask("lift", OTHER, "L1", hold_door=True), number=2, now=142.0)
    blocking = Blocking(holder=ONE, since_s=42.0)
    assert refused == Refused(Refusal.HELD, "held by api:r1 since 42 s", blocking)


def test_a_hand_over_renews_the_lease_and_not_the_limit() -> None:
    session = handed_over(opened(at=0.0), OTHER, 50.0)
    assert session.holder == OTHER
    assert lease_ends_at(session, LEASE_S) == 50.0 + LEASE_S
    assert ends_at(session, 3600.0) == 3600.0


def test_a_face_that_cannot_renew_has_a_limit_and_no_lease() -> None:
    assert "rmf" in NO_LEASE
    session = opened(RMF)
    assert lease_ends_at(session, LEASE_S) == float("inf")
    assert ends_at(session, 3600.0) == 3700.0


@pytest.mark.parametrize("zone", [UTC, ZoneInfo("Europe/Berlin")])
@pytest.mark.parametrize("hour", [datetime(2026, 10, 25, 1, 5, tzinfo=UTC), datetime(2026, 3, 29, 1, 5, tzinfo=UTC)])
def test_a_session_counts_the_same_seconds_when_the_clocks_change(hour: datetime, zone: tzinfo) -> None:
    at = hour.astimezone(zone)
    session = replace(opened(at=0.0), holding_since=300.0)
    written = kept(session, KeptBoarding(), pressed=True, at=at, now=600.0)
    assert written.opened_at == hour - timedelta(seconds=600)
    again = restored(written, number=1, at=(hour + timedelta(seconds=2)).astimezone(zone), now=1000.0)
    assert (again.opened_at, again.lease_from, again.holding_since) == (398.0, 398.0, 698.0)


def test_a_manager_that_is_off_while_the_clocks_change_counts_the_seconds_that_passed() -> None:
    berlin, before = ZoneInfo("Europe/Berlin"), datetime(2026, 10, 25, 0, 59, tzinfo=UTC)
    session = opened(at=0.0)
    written = kept(session, KeptBoarding(), pressed=True, at=before.astimezone(berlin), now=0.0)
    written = replace(written, kept_at=before.astimezone(berlin))
    again = restored(written, number=1, at=(before + timedelta(seconds=120)).astimezone(berlin), now=1000.0)
    assert again.opened_at == 880.0


def test_a_session_of_rmf_stays_and_has_no_words_and_one_of_the_api_has() -> None:
    of_rmf = sessions.admit(None, Ask("lift", Holder("rmf", "x"), "L1", hold_door=False, stays=True), number=1, now=0.0)
    assert isinstance(of_rmf, Session)
    assert (of_rmf.stays, of_rmf.has_words) == (True, False)
    of_api = sessions.opened(Holder("api", "x"), number=1, lease_s=None, key="", now=0.0)
    assert (of_api.stays, of_api.has_words) == (True, True)


def test_a_session_that_is_to_end_begins_nothing_and_goes_on_by_its_holders_word() -> None:
    ask = Ask("lift", Holder("rmf", "x"), "L1", hold_door=True, stays=True)
    session = sessions.admit(None, ask, number=1, now=0.0)
    assert isinstance(session, Session)
    ending = sessions.ending(session, 3.0, 10.0)
    assert (ending.over_at, ending.heard_at, ending.may_begin, session.may_begin) == (13.0, 10.0, False, True)
    assert sessions.ending(ending, 30.0, 11.0).over_at == 13.0
    assert sessions.ending(ending, 0.0, 11.0).over_at == 11.0
    assert sessions.stood_open(ending, 11.0) is ending
    again = sessions.admit(ending, ask, number=2, now=12.0)
    assert isinstance(again, Session)
    assert (again.number, again.over_at, again.may_begin) == (1, None, True)
    assert sessions.handed_over(ending, Holder("api", "y"), 12.0).over_at is None


def test_a_session_that_was_given_to_rmf_stays_from_its_first_request_on() -> None:
    ask = Ask("lift", Holder("workshop", "x"), "L1", hold_door=True)
    session = sessions.admit(None, ask, number=1, now=0.0)
    assert isinstance(session, Session)
    handed = sessions.handed_over(session, Holder("rmf", "x"), 1.0)
    asked = sessions.admit(handed, replace(ask, holder=Holder("rmf", "x"), stays=True), number=2, now=2.0)
    assert isinstance(asked, Session)
    assert asked.stays
