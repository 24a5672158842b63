"""Rides over HTTP: which lifts a caller may ride on, who speaks for a ride, and what the manager is asked."""

from dataclasses import replace
from typing import Any

import httpx

from lift_manager.api.roles import Role
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import RideLimits, RideRequest
from register_maps.words import Side
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import FakeSite, ask
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.keyed import NAMED, OTHER, bearing, ring
from tests.support.rows import each_row

RIDES = "/api/v1/rides"
WISH = {"lift": "lift", "from": "L1", "to": "L2"}
WORDS = ["entered", "left", "here", "cancel"]
ANYBODY = Holder("ride", "anonymous")
OF_ROBOT = Holder("ride", "the robot")


def post(site: FakeSite, url: str, role: Role | None = None, **more: Any) -> httpx.Response:
    keys, headers = (ring(), {}) if role is None else (ring(*Role), bearing(role))
    return ask(site, "POST", url, keys=keys, headers={**headers, **more.pop("headers", {})}, **more)


def of(holder: Holder, lift: str = "lift") -> FakeSite:
    site = FakeSite()
    site.fake_rides.going_on(a_ride(holder, "r1", lift))
    return site


def test_a_ride_is_begun_with_201_and_the_address_where_it_is() -> None:
    site = FakeSite()
    limits = {"queued_s": 30, "boarding_s": 60.5}
    answer = post(
        site, RIDES, json={**WISH, "door": "rear", "robot": "amr-7", "idempotency_key": "k1", "limits": limits}
    )
    assert answer.status_code == 201
    assert site.fake_rides.requests == [
        RideRequest(
            lifts=("lift",),
            any_lift=False,
            start="L1",
            destination="L2",
            door=Side.REAR,
            robot="amr-7",
            caller=Holder("ride", "amr-7"),
            key="k1",
            limits=RideLimits(queued_s=30.0, boarding_s=60.5),
        )
    ]
    there = answer.url.join(answer.headers["location"]).path
    assert there == f"{RIDES}/r1"
    assert ask(site, "GET", there).json() == answer.json()
    said = answer.json()
    assert (said["from"], said["to"], said["guidance"], said["caller"]) == ("L1", "L2", "enter", "ride:amr-7")


def test_the_same_idempotency_key_gives_the_same_ride_with_200() -> None:
    site = FakeSite()
    first, again = (post(site, RIDES, json={**WISH, "robot": "amr-7", "idempotency_key": "k1"}) for _ in range(2))
    assert (first.status_code, again.status_code, len(site.fake_rides.known)) == (201, 200, 1)
    assert first.json() == again.json()


def test_an_idempotency_key_of_nobody_in_particular_is_refused() -> None:
    site = FakeSite()
    body = {**WISH, "idempotency_key": "k1"}
    answer = post(site, RIDES, json=body)
    assert "without keys an idempotency key needs a robot name" in refused(answer, 422, "malformed")
    assert answer.json()["field"] == "robot"
    assert site.fake_rides.requests == []
    assert post(site, RIDES, Role.ROBOT, json=body).status_code == 201


def test_a_dry_run_is_a_plan_and_begins_nothing() -> None:
    site = FakeSite()
    answer = post(site, RIDES, json={**WISH, "dry_run": True, "idempotency_key": "k1"})
    assert (answer.status_code, answer.json()) == (200, {"lift": "lift", "ahead": 0, "reason": ""})
    assert (len(site.fake_rides.planned), site.fake_rides.requests, site.fake_rides.known) == (1, [], {})


@each_row("dry_run", [False, True])
@each_row(
    ("role", "lift", "lifts"),
    [
        (None, "any", (NAMED, OTHER)),
        (None, OTHER, (OTHER,)),
        (Role.ROBOT, "any", (NAMED,)),
        (Role.ROBOT, NAMED, (NAMED,)),
        (Role.OPERATOR, "any", (NAMED, OTHER)),
        (Role.COMMISSIONER, OTHER, (OTHER,)),
    ],
)
def test_a_caller_rides_on_the_lifts_that_it_commands(
    role: Role | None, lift: str, lifts: tuple[str, ...], dry_run: bool
) -> None:
    site = FakeSite()
    assert post(site, RIDES, role, json={**WISH, "lift": lift, "dry_run": dry_run}).is_success
    (wish,) = site.fake_rides.requests + site.fake_rides.planned
    assert (wish.lifts, wish.any_lift) == (lifts, lift == "any")


@each_row("dry_run", [False, True])
@each_row("lift", [OTHER, "elevator", ""])
def test_a_robots_key_rides_on_no_lift_that_it_does_not_name(lift: str, dry_run: bool) -> None:
    site = FakeSite()
    answer = post(site, RIDES, Role.ROBOT, json={**WISH, "lift": lift, "dry_run": dry_run})
    assert refused(answer, 403, "not_allowed") == (
        "this key commands lift and no other; another lift needs a key that names it"
    )
    assert site.fake_rides.requests + site.fake_rides.planned == []
    assert [(away.code, away.lift, away.caller) for away in site.away] == [("not_allowed", lift, "the robot")]


def test_any_is_refused_where_the_key_names_no_lift_of_the_site() -> None:
    site = FakeSite({"cellar": next(iter(FakeSite().lifts.values()))})
    refused(post(site, RIDES, Role.ROBOT, json={**WISH, "lift": "any"}), 403, "not_allowed")
    assert site.fake_rides.requests == []


def test_a_viewer_sees_rides_and_begins_none() -> None:
    site = of(OF_ROBOT)
    more: dict[str, Any] = {"keys": ring(*Role), "headers": bearing(Role.VIEWER)}
    assert [ride["id"] for ride in ask(site, "GET", RIDES, **more).json()["rides"]] == ["r1"]
    assert ask(site, "GET", f"{RIDES}/r1", **more).json()["caller"] == "ride:the robot"
    for url in (RIDES, *(f"{RIDES}/r1/{word}" for word in WORDS)):
        refused(post(site, url, Role.VIEWER, json=WISH), 403, "not_allowed")
    assert site.changes == []


@each_row("word", WORDS)
@each_row(
    ("role", "owner", "speaker"),
    [
        (None, "anonymous", Holder("ride", "anonymous")),
        (None, "amr-7", Holder("ride", "amr-7")),
        (Role.ROBOT, "the robot", Holder("ride", "the robot")),
        (Role.ROBOT, "the robot/amr-7", Holder("ride", "the robot/amr-7")),
        (Role.OPERATOR, "the robot", None),
        (Role.COMMISSIONER, "somebody else", None),
    ],
)
def test_a_ride_is_spoken_for_by_its_key_and_by_people(
    word: str, role: Role | None, owner: str, speaker: Holder | None
) -> None:
    site = of(Holder("ride", owner))
    assert post(site, f"{RIDES}/r1/{word}", role).status_code == 200
    assert site.fake_rides.reports == [("r1", "no reason given" if word == "cancel" else word, speaker)]


@each_row("word", WORDS)
@each_row("owner", ["the", "the robot 2", "the operator", "amr/the robot"])
def test_a_robots_key_does_not_speak_for_another_keys_ride(word: str, owner: str) -> None:
    site = of(Holder("ride", owner))
    refused(post(site, f"{RIDES}/r1/{word}", Role.ROBOT), 403, "not_your_ride")
    assert site.fake_rides.reports == []
    assert [away.code for away in site.away] == ["not_your_ride"]


@each_row("word", WORDS)
def test_a_key_that_no_longer_names_the_lift_of_its_ride_says_nothing_to_it(word: str) -> None:
    site = of(OF_ROBOT, OTHER)
    refused(post(site, f"{RIDES}/r1/{word}", Role.ROBOT), 403, "not_allowed")
    assert site.fake_rides.reports == []


def test_a_cancel_says_why() -> None:
    site = of(ANYBODY)
    answer = post(site, f"{RIDES}/r1/cancel", json={"reason": "order withdrawn"})
    assert (answer.json()["phase"], answer.json()["reason"]) == ("clearing", "order withdrawn")
    assert site.fake_rides.reports == [("r1", "order withdrawn", ANYBODY)]


@each_row("word", WORDS)
def test_an_unknown_ride_is_404(word: str) -> None:
    site = FakeSite()
    refused(post(site, f"{RIDES}/r9/{word}", Role.ROBOT), 404, "unknown_ride")
    assert '"r9"' in refused(ask(site, "GET", f"{RIDES}/r9"), 404, "unknown_ride")


@each_row(
    ("change", "code", "status", "field"),
    [
        ({"lift": "elevator"}, "unknown_lift", 404, "lift"),
        ({"from": "L9"}, "unknown_floor", 422, "from"),
        ({"to": "L9"}, "unknown_floor", 422, "to"),
        ({"lift": "any", "to": "L9"}, "unknown_floor", 422, "to"),
    ],
)
@each_row("dry_run", [False, True])
def test_what_the_site_has_not_is_refused_with_the_field(
    change: dict[str, str], code: str, status: int, field: str, dry_run: bool
) -> None:
    answer = post(FakeSite(), RIDES, json={**WISH, **change, "dry_run": dry_run})
    refused(answer, status, code)
    assert answer.json()["field"] == field


def test_rides_are_told_in_the_managers_order() -> None:
    site = of(ANYBODY)
    site.fake_rides.going_on(replace(a_ride(OF_ROBOT, "r0"), robot="amr-7"))
    assert [ride["id"] for ride in ask(site, "GET", RIDES).json()["rides"]] == ["r1", "r0"]
