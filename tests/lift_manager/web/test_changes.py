"""What holds for every request of /api/v1 that changes something: who may send it, what its body may be, how it is refused."""

import json

from lift_manager.api.roles import ROUTES
from lift_manager.lift.refusals import Blocking, Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.web.body import LIMIT_BYTES
from lift_manager.web.error_codes import REFUSAL_CODES
from register_maps.words import Mode
from tests.lift_manager.web.changes import CHANGES, HERE, LIFT, OF_THE_CALLER, change, refused, with_all
from tests.lift_manager.web.fake import ask
from tests.support.rows import each_row

every_change = each_row("path", CHANGES)
every_body = each_row("path", [path for path, body in CHANGES.items() if body is not None])


def test_the_table_has_every_change() -> None:
    named = {path.replace("/lift/", "/{lift}/").replace("s1", "{session}").replace("r1", "{ride}") for path in CHANGES}
    posts = {route.path for route in ROUTES if "POST" in route.methods and route.path.startswith("/api/")}
    assert named == posts - OF_THE_CALLER


@every_change
def test_it_is_done(path: str) -> None:
    site = with_all()
    assert change(site, path).is_success
    assert len(site.changes) == 1


@every_change
@each_row("headers", [{"sec-fetch-site": "cross-site"}, {"origin": "http://evil.example"}])
def test_a_web_page_of_another_site_is_refused_and_written_down(path: str, headers: dict[str, str]) -> None:
    site = with_all()
    refused(change(site, path, headers=headers), 403, "another_site")
    assert site.changes == []
    assert [(away.code, away.lift) for away in site.away] == [
        ("another_site", "" if path == "/api/v1/rides" else "lift")
    ]


@every_body
def test_a_body_that_is_too_long_is_413(path: str) -> None:
    site = with_all()
    detail = refused(change(site, path, content=b" " * (LIMIT_BYTES + 1)), 413, "too_long")
    assert "65536 bytes" in detail
    assert site.changes == []


@every_body
def test_a_body_of_the_longest_length_is_read(path: str) -> None:
    content = json.dumps(CHANGES[path]).encode().ljust(LIMIT_BYTES)
    assert change(with_all(), path, content=content).is_success


@every_body
@each_row("declared", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "///"])
def test_a_body_is_json_whatever_type_it_declares(path: str, declared: str) -> None:
    site = with_all()
    content = json.dumps(CHANGES[path]).encode()
    assert change(site, path, content=content, headers={"content-type": declared}).is_success
    assert len(site.changes) == 1


BLOCKING = Blocking(Holder("rmf", "rmf"), Mode.FIRE, 12.0, 3.5, 2)


def says_what_stands_in_the_way(path: str, code: Refusal) -> None:
    answer = change(with_all(refuses=Refused(code, "because", BLOCKING)), path)
    assert refused(answer, REFUSAL_CODES[code].status, code) == "because"
    told = {name: answer.json()[name] for name in ("holder", "mode", "since_s", "age_s", "ahead")}
    assert told == {"holder": "rmf", "mode": "fire", "since_s": 12.0, "age_s": 3.5, "ahead": 2}


@each_row("code", [code for code in Refusal if code is not Refusal.UNKNOWN_FLOOR])
def test_a_refusal_has_the_status_of_its_code_and_says_what_stands_in_the_way(code: Refusal) -> None:
    says_what_stands_in_the_way(f"{LIFT}/sessions", code)


@every_change
def test_every_change_says_what_stands_in_its_way(path: str) -> None:
    says_what_stands_in_the_way(path, Refusal.HELD)


@each_row("path", [path for path in CHANGES if "/sessions/" in path])
def test_every_session_that_is_not_the_callers_is_refused_in_the_same_words(path: str) -> None:
    no = Refused(Refusal.NO_SUCH_SESSION, "because", BLOCKING)
    refused(change(with_all(refuses=no), path), 404, "no_such_session")


@each_row("path", [path for path in CHANGES if path.startswith(LIFT)])
def test_an_unknown_lift_is_404(path: str) -> None:
    answer = ask(with_all(), "POST", HERE + path.replace("/lift/", "/elevator/"), json=CHANGES[path])
    assert "the lifts are" in refused(answer, 404, "unknown_lift")


MALFORMED: list[tuple[str, bytes, str | None, str]] = [
    (f"{LIFT}/acknowledge", b"", None, "the body is empty"),
    (f"{LIFT}/acknowledge", b"[]", None, "must be a JSON object"),
    (f"{LIFT}/acknowledge", b'{"by": "A", "by": "B"}', None, "twice"),
    (f"{LIFT}/acknowledge", b"{}", "by", "by is missing"),
    (f"{LIFT}/acknowledge", b'{"by": 1}', "by", "by must be text"),
    (f"{LIFT}/acknowledge", b'{"by": null}', "by", "by must be text"),
    (f"{LIFT}/acknowledge", b'{"by": "  "}', "by", "by must not be empty"),
    (f"{LIFT}/acknowledge", b'{"by": "A\\nB"}', "by", "one line"),
    (f"{LIFT}/acknowledge", b'{"by": "A\\u202eB"}', "by", "one line"),
    (f"{LIFT}/acknowledge", b'{"by": "\\ud800"}', "by", "by"),
    (f"{LIFT}/acknowledge", json.dumps({"by": "x" * 65}).encode(), "by", "not be longer than 64"),
    (f"{LIFT}/acknowledge", b'{"by": "A", "who": "B"}', "who", "who is not known here"),
    (f"{LIFT}/lockout", b'{"by": "A"}', "reason", "reason is missing"),
    (f"{LIFT}/lockout", b'{"by": "A", "reason": ""}', "reason", "reason must not be empty"),
    (f"{LIFT}/lockout", json.dumps({"by": "A", "reason": "x" * 201}).encode(), "reason", "not be longer than 200"),
    (f"{LIFT}/lockout/end", b'{"by": "A", "reason": "B"}', "reason", "reason is not known here"),
    (f"{LIFT}/sessions", b"[]", None, "must be a JSON object"),
    (f"{LIFT}/sessions", b'{"ttl_s": "60"}', "ttl_s", "ttl_s must be a number"),
    (f"{LIFT}/sessions", b'{"ttl_s": true}', "ttl_s", "ttl_s must be a number"),
    (f"{LIFT}/sessions", b'{"ttl_s": 0.5}', "ttl_s", "ttl_s must be at least 1"),
    (f"{LIFT}/sessions", b'{"ttl_s": 86401}', "ttl_s", "ttl_s must be at most 86400"),
    (f"{LIFT}/sessions", b'{"ttl_s": 1e999}', "ttl_s", "ttl_s must be at most"),
    (f"{LIFT}/sessions", b'{"ttl_s": NaN}', None, "NaN is not JSON"),
    (f"{LIFT}/sessions", b'{"robot": " "}', "robot", "robot must not be empty"),
    (f"{LIFT}/sessions", b'{"robot": "a\\nb"}', "robot", "one line"),
    (f"{LIFT}/sessions", b'{"idempotency_key": "a b"}', "idempotency_key", "must be printable ASCII without blanks"),
    (f"{LIFT}/sessions", b'{"who": 1}', "who", "who is not known here"),
    (f"{LIFT}/sessions/s1/renew", b'{"ttl_s": []}', "ttl_s", "ttl_s must be a number"),
    (f"{LIFT}/sessions/s1/close", b'{"robot": "gone"}', "robot", "robot must be 'in_place' or 'left'"),
    (f"{LIFT}/sessions/s1/hand-over", b"", None, "the body is empty"),
    (f"{LIFT}/sessions/s1/hand-over", b"{}", "to", "to is missing"),
    (f"{LIFT}/sessions/s1/commands", b"", None, "the body is empty"),
    (f"{LIFT}/sessions/s1/commands", b"{}", "do", "do is missing"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "reset"}', "do", "do must be 'go_to', 'hold_door'"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": ["go_to"]}', "do", "do must be 'go_to', 'hold_door'"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "go_to"}', "floor", "floor is missing: go_to needs it"),
    (
        f"{LIFT}/sessions/s1/commands",
        b'{"do": "hold_door", "floor": "L2"}',
        "floor",
        "floor does not go with hold_door",
    ),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "go_to", "floor": 2}', "floor", "floor must be text"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "go_to", "floor": "\\ud800"}', "floor", "floor must be whole characters"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "close_door"}', "clear", "clear is missing: close_door needs it"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "close_door", "clear": false}', "clear", "clear must be true"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "close_door", "clear": 1}', "clear", "clear must be true"),
    (f"{LIFT}/sessions/s1/commands", b'{"do": "close_door", "clear": true, "door": "up"}', "door", "'front' or 'rear'"),
    (
        f"{LIFT}/sessions/s1/commands",
        b'{"do": "go_to", "floor": "L2", "door": "front"}',
        "door",
        "door does not go with go_to",
    ),
    (
        f"{LIFT}/sessions/s1/commands",
        b'{"do": "go_to", "floor": "L2", "hold_door": 1}',
        "hold_door",
        "must be true or false",
    ),
    (f"{LIFT}/rmf/wanted", b'{"session_id": "x", "floor": "L1", "hold_door": 1}', "hold_door", "must be true or false"),
    (f"{LIFT}/rmf/wanted", b'{"session_id": "x", "floor": "", "hold_door": true}', "floor", "must not be empty"),
    (f"{LIFT}/rmf/wanted", b'{"session_id": "x", "floor": "L1"}', "hold_door", "is missing"),
    (f"{LIFT}/rmf/ended", b'{"session_id": "x", "grace_s": -0.1}', "grace_s", "must be at least 0"),
    (f"{LIFT}/rmf/ended", b'{"session_id": "x", "grace_s": 30.1}', "grace_s", "must be at most 30"),
    (f"{LIFT}/rmf/ended", b'{"session_id": "x", "grace_s": "3"}', "grace_s", "must be a number"),
    (f"{LIFT}/rmf/ended", b'{"session_id": "x", "grace_s": Infinity}', None, "Infinity is not JSON"),
    (f"{LIFT}/rmf/ended", b'{"session_id": "x"}', "grace_s", "is missing"),
    ("/api/v1/rides", b'{"lift": null, "from": "L1", "to": "L2"}', "lift", "lift must be text"),
    ("/api/v1/rides", b'{"lift": "any", "from": 1, "to": "L2"}', "from", "from must be text"),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "L2", "from_": "L1"}', "from_", "from_ is not known here"),
    ("/api/v1/rides", b'{"lift": "any", "to": "L2"}', "from", "from is missing"),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "L1"}', "to", "to must be another floor than from"),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "' + b"x" * 201 + b'"}', "to", "not be longer than 200"),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "L2", "door": "left"}', "door", "'front' or 'rear'"),
    (
        "/api/v1/rides",
        b'{"lift": "any", "from": "L1", "to": "L2", "limits": {"boarding_s": 0}}',
        "limits.boarding_s",
        "must be at least 1",
    ),
    (
        "/api/v1/rides",
        b'{"lift": "any", "from": "L1", "to": "L2", "limits": {"nap_s": 5}}',
        "limits.nap_s",
        "is not known here",
    ),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "L2", "limits": 5}', "limits", "must be an object"),
    ("/api/v1/rides", b'{"lift": "any", "from": "L1", "to": "L2", "dry_run": "yes"}', "dry_run", "true or false"),
    ("/api/v1/rides/r1/cancel", b'{"reason": ""}', "reason", "must not be empty"),
]


@each_row(("path", "body", "field", "words"), MALFORMED)
def test_a_malformed_body_is_422_with_the_field_and_what_is_expected(
    path: str, body: bytes, field: str | None, words: str
) -> None:
    site = with_all()
    answer = change(site, path, content=body)
    detail = refused(answer, 422, "malformed")
    assert words in detail
    assert "; expected {" in detail
    assert answer.json().get("field") == field
    assert site.changes == []


def test_what_is_expected_is_told_in_words() -> None:
    detail = refused(change(with_all(), f"{LIFT}/sessions/s1/commands", content=b"{}"), 422, "malformed")
    assert detail.endswith(
        'expected {"do": one of go_to, hold_door, let_go_door, close_door, robot_in_place, robot_left, "floor"?: text,'
        ' "hold_door"?: true or false, "door"?: one of front, rear, "clear"?: true, "idempotency_key"?: text}'
        " (? may be left out)"
    )


@each_row("content", [b"{", b" " * (LIMIT_BYTES + 1), b'{"who": 1}'])
def test_who_may_not_send_a_request_is_told_that_before_anything_about_its_body(content: bytes) -> None:
    site = with_all()
    refused(change(site, f"{LIFT}/lockout", content=content, headers={"via": "1.1 a proxy"}), 403, "other_computer")
    unknown = ask(site, "POST", f"{HERE}{LIFT}/sessions/s9/commands", content=content)
    refused(unknown, 404, "no_such_session")
