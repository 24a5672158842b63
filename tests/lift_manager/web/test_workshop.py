import json
from dataclasses import replace
from typing import Any

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality
from register_maps.words import Motion
from tests.lift_manager.web.fake import ACCEPTED, BASE, CALL, REQUEST, STATE, FakeSite, Requested, ask, one_lift
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.rows import each_row

WORKSHOP = Holder("workshop", "workshop")


def post(body: bytes, url: str = REQUEST, **more: Any) -> tuple[bytes, list[Requested]]:
    manager = FakeSite()
    answer = ask(manager, "POST", url, content=body, **more)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    return answer.content, manager.requests


def refusal_of(content: bytes) -> str:
    answer = json.loads(content)
    assert list(answer) == ["data", "success", "msg"]
    assert answer["data"] == {}
    assert answer["success"] is False
    assert answer["msg"]
    assert "Traceback" not in answer["msg"]
    return str(answer["msg"])


def test_lift_names_are_listed_in_the_sites_order_and_in_utf8() -> None:
    answer = ask(FakeSite(), "GET", f"{BASE}/lift_names")
    assert answer.status_code == 200
    assert answer.content == b'{"data":{"lift_names":["lift","goods"]},"success":true,"msg":""}'
    assert answer.headers["content-type"] == "application/json"


def test_lift_state_is_answered_byte_for_byte() -> None:
    answer = ask(FakeSite(), "GET", f"{STATE}?lift_name=lift")
    assert answer.status_code == 200
    assert answer.content == (
        b'{"data":{"available_floors":["L1","L2"],"current_floor":"L1","destination_floor":"L1",'
        b'"door_state":0,"motion_state":0},"success":true,"msg":""}'
    )


def test_a_state_may_not_be_cached() -> None:
    assert ask(FakeSite(), "GET", f"{STATE}?lift_name=lift").headers["cache-control"] == "no-store"


@each_row(("door", "number"), [(RobotDoor.CLOSED, 0), (RobotDoor.MOVING, 1), (RobotDoor.OPEN, 2)])
def test_the_door_is_the_number_of_rmf_lift_msgs(door: RobotDoor, number: int) -> None:
    answer = ask(one_lift(replace(IDLE, robot_door=door)), "GET", f"{STATE}?lift_name=lift")
    assert answer.json()["data"]["door_state"] == number


@each_row(
    ("motion", "number"),
    [(Motion.STOPPED, 0), (Motion.UP, 1), (Motion.DOWN, 2), (Motion.UNKNOWN, 3), (Motion.MOVING, 3)],
)
def test_the_motion_is_the_number_of_rmf_lift_msgs(motion: Motion, number: int) -> None:
    answer = ask(one_lift(replace(IDLE, motion=motion)), "GET", f"{STATE}?lift_name=lift")
    assert answer.json()["data"]["motion_state"] == number


def test_every_word_for_door_and_motion_has_a_number() -> None:
    from lift_manager.web.workshop import DOOR_STATE, MOTION_STATE

    assert set(DOOR_STATE) == set(RobotDoor)
    assert set(MOTION_STATE) == set(Motion)


def test_floors_that_nobody_reports_are_empty_and_never_null() -> None:
    lost = replace(IDLE, floor=None, destination=None)
    answer = ask(one_lift(lost), "GET", f"{STATE}?lift_name=lift")
    assert b'"current_floor":"","destination_floor":"",' in answer.content


def test_a_lift_is_found_percent_encoded_and_a_floor_that_is_not_ascii_is_written_as_it_is() -> None:
    manager = one_lift(replace(IDLE, lift="south-2", floors=("Erdgeschoß",), floor="Erdgeschoß"))
    answer = ask(manager, "GET", f"{STATE}?lift_name=s%6Futh%2D2")
    assert '"available_floors":["Erdgeschoß"],"current_floor":"Erdgeschoß"'.encode() in answer.content


@each_row(
    ("age_s", "reason", "msg"),
    [
        (
            3.24,
            "10.0.0.7:502 is silent, limit 1.0 s",
            'lift "lift" is offline, last reading 3.2 s ago: 10.0.0.7:502 is silent, limit 1.0 s',
        ),
        (
            None,
            "10.0.0.7:502 refused the connection",
            'lift "lift" is offline, no reading yet: 10.0.0.7:502 refused the connection',
        ),
        (60.0, "", 'lift "lift" is offline, last reading 60.0 s ago: no reason known'),
    ],
)
def test_an_offline_lift_says_its_age_and_the_reason_and_nothing_old(
    age_s: float | None, reason: str, msg: str
) -> None:
    offline = replace(IDLE, quality=Quality.OFFLINE, age_s=age_s, reason=reason)
    answer = ask(one_lift(offline), "GET", f"{STATE}?lift_name=lift")
    assert answer.status_code == 200
    assert answer.json() == {"data": {}, "success": False, "msg": msg}


LIFTS = "lift_name must be one of: lift, goods"


@each_row(
    ("query", "msg"),
    [
        ("?lift_name=elevator", f'unknown lift "elevator"; {LIFTS}'),
        ("?lift_name=a/b", f'unknown lift "a/b"; {LIFTS}'),
        ("?lift_name=a%2Fb", f'unknown lift "a/b"; {LIFTS}'),
        ("?lift_name=..%2F..%2Fetc", f'unknown lift "../../etc"; {LIFTS}'),
        ("?lift_name=50%25", f'unknown lift "50%"; {LIFTS}'),
        ("?lift_name=50%", f'unknown lift "50%"; {LIFTS}'),
        ("?lift_name=%00", f'unknown lift "\\u0000"; {LIFTS}'),
        ("?lift_name=lift%00", f'unknown lift "lift\\u0000"; {LIFTS}'),
        ("?lift_name=%E9%9B%BB%E6%A2%AF", f'unknown lift "電梯"; {LIFTS}'),
        ("?lift_name=%ff%fe", f'unknown lift "\ufffd\ufffd"; {LIFTS}'),
        ("?lift_name=LIFT", f'unknown lift "LIFT"; {LIFTS}'),
        ("?lift_name=", f'unknown lift ""; {LIFTS}'),
        (f"?lift_name={'x' * 100}", f'unknown lift "{"x" * 59}...; {LIFTS}'),
        ("", "lift_name is missing; it must be one of: lift, goods"),
        ("?lift=lift", "lift_name is missing; it must be one of: lift, goods"),
        ("?lift_name=lift&lift_name=lift", "lift_name is given 2 times; give it once, as one of: lift, goods"),
        (f"?lift_name={'x' * 5000}", "the query is longer than 4096 bytes; lift_name must be one of: lift, goods"),
    ],
)
def test_a_wrong_lift_name_is_told_the_right_ones(query: str, msg: str) -> None:
    manager = FakeSite()
    state = ask(manager, "GET", STATE + query)
    request = ask(manager, "POST", f"{BASE}/lift_request{query}", content=CALL)
    assert state.status_code == request.status_code == 200
    assert refusal_of(state.content) == refusal_of(request.content) == msg
    assert manager.requests == []


def test_further_query_parameters_are_ignored() -> None:
    assert ask(FakeSite(), "GET", f"{STATE}?verbose=1&lift_name=lift").json()["success"] is True


@each_row(
    ("body", "floor", "hold"),
    [
        (CALL, "L2", False),
        (b'{"floor":"L2","door_state":2}', "L2", True),
        (b'{"floor": "L1", "door_state": 0.0}', "L1", False),
        (b'{"floor": "L1", "door_state": 2.0}', "L1", True),
        (b'{"floor": "L1", "door_state": 2e0}', "L1", True),
        (b'  {"door_state":0,\n"floor":"L2"}\n', "L2", False),
        (b'{"floor":"L2","door_state":2,"session_id":"x","nested":{"floor":"L1"}}', "L2", True),
        (b'\xef\xbb\xbf{"floor":"L2","door_state":2}', "L2", True),
        (b'{"floor":"\\u004c2","door_state":2}', "L2", True),
        ('{"floor":"Erdgeschoß","door_state":2}'.encode(), "Erdgeschoß", True),
        (b'{"floor":"","door_state":2}', "", True),
    ],
)
def test_a_request_is_handed_on_as_asked(body: bytes, floor: str, hold: bool) -> None:
    content, asked = post(body)
    assert content == ACCEPTED
    assert asked == [Requested("lift", WORKSHOP, floor, hold_door=hold)]


@each_row(
    "content_type",
    ["application/json", "application/x-www-form-urlencoded", "text/plain", "multipart/form-data", "", "nonsense"],
)
def test_any_content_type_is_taken_because_curl_and_forms_send_theirs(content_type: str) -> None:
    content, asked = post(CALL, headers={"content-type": content_type})
    assert content == ACCEPTED
    assert len(asked) == 1


FLOORS = "floor must be one of: L1, L2"
DOOR = "0 (no hold; for the current floor a release) or 2 (open and hold)"
EXPECTED = 'expected {"floor": one of L1, L2, "door_state": 0 or 2}'


def wrong_door(shown: str) -> str:
    return f"door_state must be {DOOR}, not {shown}"


@each_row(
    ("body", "msg"),
    [
        (b'{"floor":"L2","door_state":1}', wrong_door("1")),
        (b'{"floor":"L2","door_state":300}', wrong_door("300")),
        (b'{"floor":"L2","door_state":-1}', wrong_door("-1")),
        (b'{"floor":"L2","door_state":"2x"}', wrong_door('"2x"')),
        (b'{"floor":"L2","door_state":"2"}', wrong_door('"2"')),
        (b'{"floor":"L2","door_state":2.5}', wrong_door("2.5")),
        (b'{"floor":"L2","door_state":1e999}', wrong_door("Infinity")),
        (b'{"floor":"L2","door_state":true}', wrong_door("true")),
        (b'{"floor":"L2","door_state":false}', wrong_door("false")),
        (b'{"floor":"L2","door_state":null}', wrong_door("null")),
        (b'{"floor":"L2","door_state":[2]}', wrong_door("a list")),
        (b'{"floor":"L2","door_state":{}}', wrong_door("an object")),
        (b'{"floor":"L2","door_state":"' + b"2" * 999 + b'"}', wrong_door('"' + "2" * 59 + "...")),
        (b'{"floor":"L2"}', f"door_state is missing; it must be {DOOR}"),
        (b'{"door_state":2}', "floor is missing; it must be one of: L1, L2"),
        (b"{}", "floor is missing; it must be one of: L1, L2"),
        (b'{"floor":2,"door_state":2}', f"{FLOORS}; not 2"),
        (b'{"floor":null,"door_state":2}', f"{FLOORS}; not null"),
        (b'{"floor":["L2"],"door_state":2}', f"{FLOORS}; not a list"),
        (b'{"floor":"\\ud800","door_state":2}', f'{FLOORS}; not "\\ud800"'),
        (b'{"floor":"' + b"L" * 300 + b'","door_state":2}', f'{FLOORS}; not "{"L" * 59}...'),
        (b"", f"the body is empty; {EXPECTED}"),
        (b" \r\n", f"the body is empty; {EXPECTED}"),
        (b"call L2", f"the body is not JSON (Expecting value, character 0); {EXPECTED}"),
        (b"floor=L2&door_state=0", f"the body is not JSON (Expecting value, character 0); {EXPECTED}"),
        (
            b'{"floor":"L2","door_state":0',
            f"the body is not JSON (Expecting ',' delimiter, character 28); {EXPECTED}",
        ),
        (CALL + CALL, f"the body is not JSON (Extra data, character 29); {EXPECTED}"),
        (b'{"floor":"L\xff","door_state":0}', f"the body is not UTF-8 (byte 11); {EXPECTED}"),
        (b'["L2",0]', f"the body must be a JSON object, not a list; {EXPECTED}"),
        (b'"L2"', f'the body must be a JSON object, not "L2"; {EXPECTED}'),
        (b"null", f"the body must be a JSON object, not null; {EXPECTED}"),
        (
            b'{"floor":"L1","floor":"L2","door_state":0}',
            f'the key "floor" is in the body twice; {EXPECTED}',
        ),
        (
            b'{"floor":"L1","door_state":0,"door_state":2}',
            f'the key "door_state" is in the body twice; {EXPECTED}',
        ),
        (b'{"floor":"L2","door_state":NaN}', f"NaN is not JSON; {EXPECTED}"),
        (b'{"floor":"L2","door_state":-Infinity}', f"-Infinity is not JSON; {EXPECTED}"),
        (b'{"floor":"L2","door_state":' + b"2" * 5000 + b"}", f"the body holds a number that is too long; {EXPECTED}"),
        (b"[" * 60_000, f"the body is nested too deeply; {EXPECTED}"),
    ],
)
def test_a_wrong_request_is_told_what_is_allowed_and_reaches_nobody(body: bytes, msg: str) -> None:
    content, asked = post(body)
    assert refusal_of(content) == msg
    assert asked == []


@pytest.mark.parametrize("size", [64 * 1024 + 1, 1_000_000])
def test_a_body_over_64_kilobytes_is_refused(size: int) -> None:
    padding = b" " * (size - len(CALL))
    content, asked = post(CALL + padding)
    assert refusal_of(content) == "the body is too long; at most 65536 bytes are read"
    assert asked == []


def test_a_body_of_just_64_kilobytes_is_read() -> None:
    assert post(CALL + b" " * (64 * 1024 - len(CALL)))[0] == ACCEPTED


def test_a_refusal_is_answered_with_the_managers_words() -> None:
    held = FakeSite(refuses=Refused(Refusal.HELD, "held by rmf:fleet/räuber"))
    answer = ask(held, "POST", REQUEST, content=CALL)
    assert answer.status_code == 200
    assert answer.content == '{"data":{},"success":false,"msg":"held by rmf:fleet/räuber"}'.encode()


def test_the_lift_is_named_to_the_manager_as_it_knows_it() -> None:
    manager = FakeSite()
    ask(manager, "POST", f"{BASE}/lift_request?lift_name=goods", content=CALL)
    assert [entry.lift for entry in manager.requests] == ["goods"]


@each_row(
    "headers",
    [
        {"origin": "http://elsewhere.example"},
        {"origin": "null"},
        {"origin": "http://192.0.2.7:8080"},
        {"sec-fetch-site": "cross-site", "origin": "http://192.0.2.7"},
        {"sec-fetch-site": "same-site"},
    ],
)
def test_a_web_page_of_another_site_cannot_call_the_lift(headers: dict[str, str]) -> None:
    content, asked = post(CALL, headers={"host": "192.0.2.7", **headers})
    assert (
        refusal_of(content)
        == "a web page of another site sent the request; only programs and this manager's own pages may"
    )
    assert asked == []


@pytest.mark.parametrize(
    "headers",
    [{"origin": "http://192.0.2.7"}, {"sec-fetch-site": "same-origin", "origin": "https://proxy.example"}],
    ids=str,
)
def test_the_managers_own_pages_can_call_the_lift(headers: dict[str, str]) -> None:
    assert post(CALL, headers={"host": "192.0.2.7", **headers})[0] == ACCEPTED
