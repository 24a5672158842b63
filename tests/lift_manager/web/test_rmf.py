"""What an adapter of Open-RMF is told over HTTP, and what it may say."""

import json
from dataclasses import fields, replace
from typing import Any

import httpx

from lift_manager.api.roles import Role
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.rmf_view import RmfRules, rmf_holder, rmf_session
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality, Restrictions
from lift_manager.plain.rmf import Alarms, HeldBy, LiftView, SiteView, parse_site
from lift_manager.runtime.rmf_view import rmf_site
from register_maps.words import Mode, Motion
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import FakeSite, Requested, ask
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row

LIFT = "/api/v1/lifts/lift/rmf"
WANTED = {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True}
ENDED = {"session_id": "fleet/amr-7", "grace_s": 3}
AMR = Holder("rmf", "fleet/amr-7")
every_word = each_row(("what", "body"), [("wanted", WANTED), ("ended", ENDED)])
RIDING = replace(
    IDLE,
    lift="goods",
    floors=("B1", "L1"),
    age_s=0.123,
    floor=None,
    standing=False,
    destination="L1",
    robot_door=RobotDoor.MOVING,
    motion=Motion.UP,
    mode=Mode.ROBOT,
    holder=AMR,
    held_since_s=3.0,
    permissions={"robot_mode_on": True, "ready": True},
    restrictions=Restrictions(
        fire_latched=True,
        lockout="by M. Weber",
        maybe_aboard=Holder("workshop", "r2"),
        distrusted="door contact inverted?",
        waiting_for="people",
    ),
)
LOST = replace(IDLE, quality=Quality.OFFLINE, reason="no answer", age_s=None, robot_door=RobotDoor.MOVING)
RULES = RmfRules(
    end_grace_s=5,
    fire_alarm=True,
    emergency_signal=True,
    emergency_fleets=("tinyRobot",),
    clear_on_acknowledge=True,
)


class Named(FakeSite):
    """A manager whose site has names for RMF."""

    def config(self, lift: str) -> LiftConfig:
        return replace(super().config(lift), rmf_name=f"Güter {lift}", rmf_floors={"B1": "basement"})


def post(site: FakeSite, what: str, **more: Any) -> httpx.Response:
    return ask(site, "POST", f"{LIFT}/{what}", **more)


def told(site: FakeSite) -> SiteView:
    answer = ask(site, "GET", "/api/v1/rmf")
    assert answer.status_code == 200
    assert answer.headers["cache-control"] == "no-store"
    return parse_site(answer.json())


def test_a_manager_that_ends_does_not_say_that_its_sessions_are_over() -> None:
    answer = ask(FakeSite(stopping=True), "GET", "/api/v1/rmf")
    assert (answer.status_code, answer.json()["code"]) == (503, "stopping")


def test_the_whole_site_is_told_as_an_adapter_reads_it() -> None:
    site = Named({"goods": RIDING, "lift": LOST}, newest=7, rmf=RULES)
    answer = told(site)
    assert answer == SiteView(
        boot="b0",
        event=7,
        lifts=answer.lifts,
        end_grace_s=5,
        alarms=Alarms(
            fire_alarm=True, emergency_signal=True, emergency_fleets=("tinyRobot",), clear_on_acknowledge=True
        ),
    )
    riding, lost = answer.lifts
    assert riding == LiftView(
        lift="goods",
        name="Güter goods",
        floors={"B1": "basement", "L1": "L1"},
        live=True,
        reason="",
        age_s=0.123,
        max_age_s=2.0,
        floor=None,
        standing=False,
        destination="L1",
        door="moving",
        motion="up",
        mode="robot",
        robot_mode_on=True,
        holder=HeldBy("rmf", "fleet/amr-7"),
        ending=False,
        fire_latched=True,
        waiting_for="people",
        keeps_off="locked out by M. Weber; a robot of workshop:r2 may be in the car; its signals are distrusted: door contact inverted?",
    )
    assert (lost.live, lost.reason, lost.age_s, lost.robot_mode_on) == (False, "no answer", None, None)
    assert (lost.holder, lost.keeps_off) == (None, "")
    assert list(riding.floors) == ["B1", "L1"], "lowest first"


def test_the_keys_are_the_fields_that_an_adapter_knows() -> None:
    said = ask(FakeSite({"goods": RIDING}), "GET", "/api/v1/rmf").json()
    assert list(said) == [field.name for field in fields(SiteView)]
    assert list(said["lifts"][0]) == [field.name for field in fields(LiftView)]
    assert list(said["lifts"][0]["holder"]) == [field.name for field in fields(HeldBy)]
    assert list(said["alarms"]) == [field.name for field in fields(Alarms)]


def test_an_adapter_inside_the_manager_is_told_the_same() -> None:
    site = Named({"goods": RIDING, "lift": LOST}, newest=7, rmf=RULES)
    assert told(site) == rmf_site(site)


def test_a_lift_without_names_of_its_own_has_those_of_the_site() -> None:
    (lift, _) = told(FakeSite()).lifts
    assert (lift.name, lift.floors) == ("lift", {"L1": "L1", "L2": "L2"})


def test_what_rmf_wants_is_a_request_of_a_session_that_stays() -> None:
    site = FakeSite(newest=4)
    answer = post(site, "wanted", json=WANTED)
    assert (answer.status_code, answer.json()) == (200, {"boot": "b0", "event": 4})
    post(site, "wanted", json={**WANTED, "floor": "L1", "hold_door": False})
    assert site.requests == [
        Requested("lift", AMR, "L2", hold_door=True, stays=True),
        Requested("lift", AMR, "L1", hold_door=False, stays=True),
    ]


def test_an_end_is_passed_on_with_its_grace() -> None:
    site = FakeSite(newest=4)
    answer = post(site, "ended", json=ENDED)
    assert (answer.status_code, answer.json()) == (200, {"boot": "b0", "event": 4})
    post(site, "ended", json={"session_id": "x", "grace_s": 0})
    assert site.ends == [("lift", AMR, 3.0), ("lift", Holder("rmf", "x"), 0.0)]


def test_an_adapter_with_an_id_has_sessions_of_its_own() -> None:
    site = FakeSite()
    assert post(site, "wanted", json={**WANTED, "adapter": "5/b1"}).status_code == 200
    assert post(site, "ended", json={**ENDED, "adapter": "5/b1"}).status_code == 200
    theirs = Holder("rmf", "fleet/amr-7@5/b1")
    assert (site.requests[0].holder, site.ends[0][1]) == (theirs, theirs)
    told_of = told(FakeSite({"goods": replace(RIDING, holder=theirs)})).lifts[0].holder
    assert told_of == HeldBy("rmf", "fleet/amr-7", "5/b1")
    assert str(told_of) == str(theirs)


@each_row("session", ["fleet/amr-7", "amr@fleet", "@", "a@b@c"])
@each_row("adapter", ["", "5", "b1/x.y_z-0"])
def test_session_and_adapter_are_told_apart_whatever_is_in_a_session_id(session: str, adapter: str) -> None:
    site = FakeSite()
    post(site, "ended", json={**ENDED, "session_id": session, "adapter": adapter})
    assert rmf_session(site.ends[0][1]) == (session, adapter)
    other = rmf_holder(f"{session}@{adapter}", "")
    assert site.ends[0][1] != other


@each_row("adapter", ["a@b", "a b", "a\n", "x" * 301, 5, None])
@every_word
def test_an_id_of_an_adapter_that_is_none_is_refused(what: str, body: dict[str, object], adapter: object) -> None:
    site = FakeSite()
    answer = post(site, what, json={**body, "adapter": adapter})
    refused(answer, 422, "malformed")
    assert answer.json()["field"] == "adapter"
    assert site.changes == []


class Deciding(FakeSite):
    """What is decided is published, partly only when somebody asks for it."""

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Any:
        self.happens(Alarm("lift", "something"))
        return super().end_session(lift, holder, grace_s)

    def freshen(self, lift: str | None = None) -> None:
        self.happens(Alarm("lift", "more"))


def test_the_event_of_an_answer_is_the_newest_after_the_decision() -> None:
    site = Deciding()
    assert post(site, "ended", json=ENDED).json()["event"] == 3
    assert told(site).event == 3


def test_an_unknown_floor_names_the_key_that_is_to_blame() -> None:
    site = FakeSite(refuses=Refused(Refusal.UNKNOWN_FLOOR, "no floor L9"))
    answer = post(site, "wanted", json={**WANTED, "floor": "L9"})
    refused(answer, 422, "unknown_floor")
    assert answer.json()["field"] == "floor"


@each_row("session", ["", "x" * 257, "a\nb", "a\x7fb", "\ud800", "a\u00a0b", "a\u202eb", 7, None, ["x"], True])
@every_word
def test_a_session_id_is_printable_text_of_1_to_256_characters(
    what: str, body: dict[str, object], session: object
) -> None:
    site = FakeSite()
    answer = post(site, what, content=json.dumps({**body, "session_id": session}).encode())
    refused(answer, 422, "malformed")
    assert site.changes == []


@each_row("session", ["x", "x" * 256, " fleet / Röbotér ", "lift_request#0e6b", "日本/1"])
def test_a_session_id_is_passed_on_as_it_is(session: str) -> None:
    site = FakeSite()
    assert post(site, "ended", json={**ENDED, "session_id": session}).status_code == 200
    assert site.ends == [("lift", Holder("rmf", session), 3.0)]


@every_word
def test_a_key_of_rmf_speaks_for_the_lifts_that_it_names_and_reads_all(what: str, body: dict[str, object]) -> None:
    site = FakeSite()
    key: dict[str, Any] = {"keys": ring(*Role), "headers": bearing(Role.RMF)}
    assert post(site, what, json=body, **key).status_code == 200
    other = ask(site, "POST", f"/api/v1/lifts/goods/rmf/{what}", json=body, **key)
    assert "another lift needs a key that names it" in refused(other, 403, "not_allowed")
    assert ask(site, "GET", "/api/v1/rmf", **key).status_code == 200
    for path in ("sessions", "lockout", "acknowledge"):
        refused(ask(site, "POST", f"/api/v1/lifts/lift/{path}", json={}, **key), 403, "not_allowed")
    assert len(site.changes) == 1
