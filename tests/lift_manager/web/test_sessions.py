"""Sessions over HTTP: who a caller is, whose a session is, and what becomes of what is asked within it."""

import json
from typing import Any

import httpx

from lift_manager.api.keys import Key, KeyRing, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.lift.commands import CommandRequest, CommandType
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from register_maps.words import Side
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import FakeSite, ask
from tests.lift_manager.web.fake_sessions import a_command, a_session
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row

SESSIONS = "/api/v1/lifts/lift/sessions"
S1 = f"{SESSIONS}/s1"
GO = {"do": "go_to", "floor": "L2"}
ANYBODY = Holder("api", "anonymous")
CHANGES: list[tuple[str, dict[str, object]]] = [
    ("renew", {}),
    ("close", {}),
    ("hand-over", {"to": "amr-8"}),
    ("commands", {**GO}),
]


def of(holder: Holder, lift: str = "lift") -> FakeSite:
    """A manager with the session s1 of this holder, and its command 1."""
    site = FakeSite()
    session = a_session(holder, "s1", lift)
    site.there(session)
    site.commands["s1", "1"] = a_command(session, "1")
    return site


def post(site: FakeSite, url: str, **more: Any) -> httpx.Response:
    return ask(site, "POST", url, **more)


def test_a_session_is_opened_with_201_and_the_address_where_it_is() -> None:
    site = FakeSite()
    answer = post(site, SESSIONS, json={"robot": "amr-7", "ttl_s": 60, "idempotency_key": "k1"})
    assert answer.status_code == 201
    assert site.done == [("open", "lift", Holder("api", "amr-7"), "k1", 60.0)]
    there = answer.url.join(answer.headers["location"]).path
    assert there == f"{SESSIONS}/{answer.json()['id']}"
    assert ask(site, "GET", there).json() == answer.json()
    assert answer.headers["cache-control"] == "no-store"


def test_the_same_idempotency_key_gives_the_same_session_with_200() -> None:
    site = FakeSite()
    first, again = (post(site, SESSIONS, json={"robot": "amr-7", "idempotency_key": "k1"}) for _ in range(2))
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json()
    assert "location" not in again.headers


def test_an_idempotency_key_of_nobody_in_particular_is_refused() -> None:
    site = FakeSite()
    answer = post(site, SESSIONS, json={"idempotency_key": "k1"})
    assert "without keys an idempotency key needs a robot name" in refused(answer, 422, "malformed")
    assert answer.json()["field"] == "robot"
    assert site.done == []
    more = {"keys": ring(Role.ROBOT), "headers": bearing(Role.ROBOT)}
    assert post(site, SESSIONS, json={"idempotency_key": "k1"}, **more).status_code == 201


@each_row("content", [b"", b"  ", b"{}"])
def test_who_wants_nothing_special_sends_no_body(content: bytes) -> None:
    site = of(ANYBODY)
    assert post(site, SESSIONS, content=content).status_code == 201
    assert site.done == [("open", "lift", ANYBODY, "", None)]
    assert post(site, f"{S1}/renew", content=content).status_code == 200
    assert post(site, f"{S1}/close", content=content).status_code == 200


@each_row(
    ("role", "robot", "name"),
    [
        (None, None, "anonymous"),
        (None, "amr-7", "amr-7"),
        (Role.ROBOT, None, "the robot"),
        (Role.ROBOT, "amr-7", "the robot/amr-7"),
        (Role.OPERATOR, "a/b", "the operator/a/b"),
    ],
)
def test_a_caller_is_its_key_and_its_robot(role: Role | None, robot: str | None, name: str) -> None:
    site = FakeSite()
    keys, headers = (ring(), {}) if role is None else (ring(role), bearing(role))
    post(site, SESSIONS, keys=keys, headers=headers, json={"robot": robot})
    assert site.done == [("open", "lift", Holder("api", name), "", None)]


def test_renew_and_close_and_hand_over_speak_in_the_name_of_the_session() -> None:
    holder = Holder("api", "the robot/amr-7")
    more = {"keys": ring(Role.ROBOT, Role.OPERATOR), "headers": bearing(Role.ROBOT)}
    site = of(holder)
    assert post(site, f"{S1}/renew", json={"ttl_s": 30}, **more).json()["lease_ends_in_s"] == 30.0
    assert post(site, f"{S1}/close", json={"robot": "left"}, **more).json()["over"]["reason"] == "released"
    handed = post(site, f"{S1}/hand-over", json={"to": "the operator", "robot": "amr-9"}, **more).json()
    assert (handed["holder"], handed["id"]) == ("api:the operator/amr-9", "s1-2")
    assert site.done == [
        ("renew", "lift", "s1", holder, 30.0),
        ("close", "lift", "s1", holder, RobotWord.LEFT),
        ("hand over", "lift", "s1", holder, Holder("api", "the operator/amr-9")),
    ]


@each_row(
    ("to", "why"),
    [
        ("the robott", "is not the name of a live key"),
        ("the robot/amr-7", "is not the name of a live key"),
        ("the viewer", "is the name of a key that may not command lift"),
        ("elsewhere", "is the name of a key that may not command lift"),
    ],
)
def test_a_session_goes_to_no_name_that_is_not_a_key_which_may_command_the_lift(to: str, why: str) -> None:
    site = of(Holder("api", "am"))
    others = [
        (Key("0000000a", "the viewer", Role.VIEWER), digest_of("x")),
        (Key("0000000b", "elsewhere", Role.ROBOT, ("another lift",)), digest_of("y")),
        (Key(dict(FLEET)["am"], "am", Role.ROBOT, ("lift",)), digest_of(digest_of("am"))),
    ]
    answer = post(site, f"{S1}/hand-over", keys=KeyRing(others), headers=bearer("am"), json={"to": to})
    assert why in refused(answer, 422, "malformed")
    assert answer.json()["field"] == "to"
    assert site.done == []


def test_without_keys_a_session_goes_to_any_name() -> None:
    assert post(of(ANYBODY), f"{S1}/hand-over", json={"to": "amr-8"}).json()["holder"] == "api:amr-8"


def test_a_command_is_taken_with_202_and_the_address_where_its_outcome_will_be() -> None:
    site = of(ANYBODY)
    body = {"do": "close_door", "door": "rear", "clear": True, "idempotency_key": "k2"}
    answer = post(site, f"{S1}/commands", json=body)
    assert (answer.status_code, answer.json()["status"]) == (202, "pending")
    assert site.done == [
        (
            "command",
            "lift",
            CommandRequest(session="s1", holder=ANYBODY, kind=CommandType.CLOSE_DOOR, side=Side.REAR, key="k2"),
        )
    ]
    there = answer.url.join(answer.headers["location"]).path
    assert ask(site, "GET", there).json() == answer.json()
    assert site.waited_s == []


@each_row("wait", ["5", "0.5", "30", "3e1", "+5"])
def test_who_waits_is_answered_once_the_command_has_ended(wait: str) -> None:
    site = of(ANYBODY)
    answer = post(site, f"{S1}/commands?wait={wait.replace('+', '%2B')}", json=GO)
    assert (answer.status_code, answer.json()["status"]) == (202, "confirmed")
    assert ask(site, "GET", f"{S1}/commands/1?wait={wait.replace('+', '%2B')}").json()["status"] == "confirmed"
    assert site.waited_s == [float(wait)] * 2


@each_row("wait", ["", "x", "-1", "30.1", "nan", "inf", "1&wait=2", "1" * 5000, f"5&x={'1' * 5000}"])
def test_a_wait_that_is_none_is_422_before_anything_is_asked(wait: str) -> None:
    site = of(ANYBODY)
    for method, url in (("POST", f"{S1}/commands?wait={wait}"), ("GET", f"{S1}/commands/1?wait={wait}")):
        answer = ask(site, method, url, json=GO)
        refused(answer, 422, "malformed")
        assert answer.json()["field"] == "wait"
    assert site.done == []


def test_an_unknown_session_or_command_is_404() -> None:
    site = of(ANYBODY)
    refused(ask(site, "GET", f"{SESSIONS}/s9"), 404, "no_such_session")
    refused(ask(site, "GET", f"{S1}/commands/9"), 404, "no_such_command")
    refused(ask(site, "GET", f"{S1}/commands/9?wait=1"), 404, "no_such_command")
    refused(ask(site, "GET", "/api/v1/lifts/elevator/sessions/s1"), 404, "unknown_lift")
    refused(post(site, "/api/v1/lifts/elevator/sessions"), 404, "unknown_lift")


FLEET = [("amr", "11111111"), ("amr-2", "22222222"), ("am", "33333333")]


def bearer(name: str) -> dict[str, str]:
    number = dict(FLEET)[name]
    return {"Authorization": f"Bearer {token(number, digest_of(name)).reveal()}"}


KEYS = KeyRing(
    (Key(number, name, Role.OPERATOR if name == "am" else Role.ROBOT, ("lift",)), digest_of(digest_of(name)))
    for name, number in FLEET
)


@each_row("owner", ["amr", "amr/robot", "amr/amr-2"])
def test_a_session_is_its_keys_alone_and_all_others_are_told_what_they_are_told_of_none(owner: str) -> None:
    for name, _ in FLEET:
        site = of(Holder("api", owner))
        urls: list[tuple[str, str, str | None]] = [("GET", S1, None), ("GET", f"{S1}/commands/1", None)]
        bodies = [{"to": "amr-2"} if what == "hand-over" else body for what, body in CHANGES]
        urls += [("POST", f"{S1}/{what}", json.dumps(body)) for (what, _), body in zip(CHANGES, bodies, strict=True)]
        for method, url, body in urls:
            answer = ask(site, method, url, keys=KEYS, headers=bearer(name), content=body)
            if name == "amr":
                assert answer.is_success, (url, answer.text)
                site.there(a_session(Holder("api", owner)))
                continue
            unknown = ask(site, method, url.replace("s1", "s9"), keys=KEYS, headers=bearer(name), content=body)
            refused(answer, 404, "no_such_session")
            assert (answer.content, answer.headers) == (unknown.content, unknown.headers)
            assert site.away[-1].code == "no_such_session"
            assert site.away[-1].caller == name
        assert (site.done == []) is (name != "amr")


@each_row("holder", [Holder("ride", "amr"), Holder("workshop", "amr"), Holder("rmf", "rmf")])
def test_a_session_of_another_face_is_none_here_even_with_the_same_key(holder: Holder) -> None:
    site = of(holder)
    refused(ask(site, "GET", S1, keys=KEYS, headers=bearer("amr")), 404, "no_such_session")
    refused(ask(site, "POST", f"{S1}/close"), 404, "no_such_session")
    assert site.done == []


def test_a_floor_that_the_lift_has_not_is_422_with_its_field() -> None:
    answer = post(of(ANYBODY), f"{S1}/commands", json={"do": "go_to", "floor": "L9"})
    assert "the floors are L1, L2" in refused(answer, 422, "unknown_floor")
    assert answer.json()["field"] == "floor"
