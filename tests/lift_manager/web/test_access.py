"""Who asks: what is told to whoever may not, what is done in whose name, and what is written down about it."""

import json
import logging
from collections.abc import Mapping

import httpx
import pytest

from lift_manager.api.roles import Role
from lift_manager.lift.session import Holder
from lift_manager.web.app import make_app
from lift_manager.web.authenticator import MAX_LOGGED_REFUSALS, REFUSAL_WINDOW_S, RefusalLog
from tests.lift_manager.web.fake import BASE, CALL, REQUEST, STATE, FakeSite, ask, ask_app
from tests.lift_manager.web.keyed import bearing, key, ring
from tests.support.rows import each_row

LOCKOUT = "/api/v1/lifts/lift/lockout"
WORDS = {"by": "M. Weber", "reason": "new ropes"}
EVERYWHERE = [("GET", f"{BASE}/lift_names"), ("POST", REQUEST), ("POST", LOCKOUT), ("GET", "/nothing")]

everywhere = each_row(("method", "url"), EVERYWHERE)


def form_of(answer: httpx.Response, url: str) -> tuple[str, str]:
    """Check that the answer no has the form of its face; returns its words and its code."""
    said = answer.json()
    if url.startswith("/open-rmf"):
        assert answer.headers["content-type"] == "application/json"
        assert list(said) == ["data", "success", "msg"]
        assert (said["data"], said["success"]) == ({}, False)
        return said["msg"], ""
    if url.startswith("/api"):
        assert answer.headers["content-type"] == "application/problem+json"
        assert said["status"] == answer.status_code
        return said["detail"], said["code"]
    assert list(said) == ["detail"]
    return said["detail"], ""


@everywhere
def test_without_a_key_the_answer_is_401_in_the_form_of_its_face_and_says_how_to_send_one(
    method: str, url: str
) -> None:
    site = FakeSite()
    answer = ask(site, method, url, keys=ring(Role.VIEWER), content=CALL)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == 'Bearer realm="lift-manager"'
    text, code = form_of(answer, url)
    assert "`Authorization: Bearer lm_...`" in text
    assert code in {"", "key_needed"}
    assert (site.requests, site.decisions) == ([], [])


RIGHT = key(Role.OPERATOR)
BAD: list[dict[str, str]] = [
    {"Authorization": "Bearer"},
    {"Authorization": "Bearer "},
    {"Authorization": f"Basic {RIGHT}"},
    {"Authorization": RIGHT},
    {"Authorization": f"Bearer {RIGHT[:-1]}"},
    {"Authorization": f"Bearer {RIGHT[:-1]}x"},
    {"Authorization": f"Bearer {RIGHT} {RIGHT}"},
    {"Authorization": f"Bearer {key(Role.VIEWER)}"},
    {"Authorization": f"Bearer lm_ffffffff_{'0' * 64}"},
    {"Authorization": f"Bearer {'x' * 20000}"},
    {"Authorization": "Bearer \xe4\xf6\xfc"},
]


@everywhere
def test_every_bad_key_gets_the_same_answer_whether_or_not_its_id_is_known(method: str, url: str) -> None:
    site = FakeSite()
    sent = [{name: value.encode("latin-1") for name, value in headers.items()} for headers in BAD]
    answers = [ask(site, method, url, keys=ring(Role.OPERATOR), headers=headers) for headers in sent]
    assert {answer.status_code for answer in answers} == {401}
    assert {answer.content for answer in answers} == {answers[0].content}
    assert {answer.headers["www-authenticate"] for answer in answers} == {
        'Bearer realm="lift-manager", error="invalid_token"'
    }
    assert "does not count" in form_of(answers[0], url)[0]
    assert (site.requests, site.decisions) == ([], [])


def test_two_keys_in_one_request_are_none() -> None:
    headers = [("Authorization", f"Bearer {RIGHT}"), ("Authorization", f"Bearer {RIGHT}")]
    assert ask(FakeSite(), "GET", f"{BASE}/lift_names", keys=ring(Role.OPERATOR), headers=headers).status_code == 401


@each_row("scheme", ["Bearer", "bearer", "BEARER"])
def test_the_scheme_is_read_in_any_case(scheme: str) -> None:
    headers = {"Authorization": f"{scheme}  {RIGHT} "}
    assert ask(FakeSite(), "GET", f"{BASE}/lift_names", keys=ring(Role.OPERATOR), headers=headers).is_success


@each_row(
    ("role", "method", "url", "words"),
    [
        (Role.VIEWER, "POST", REQUEST, "the role robot, operator or commissioner; this key's is viewer"),
        (Role.VIEWER, "POST", LOCKOUT, "the role operator or commissioner; this key's is viewer"),
        (Role.ROBOT, "POST", LOCKOUT, "the role operator or commissioner; this key's is robot"),
        (Role.ROBOT, "POST", f"{BASE}/lift_request?lift_name=elevator", "this key commands lift and no other"),
        (Role.ROBOT, "POST", f"{BASE}/lift_request", "this key commands lift and no other"),
        (Role.ROBOT, "POST", f"{REQUEST}&lift_name=goods", "this key commands lift and no other"),
    ],
)
def test_a_key_that_may_not_is_403_and_says_which_role_or_lift_it_takes(
    role: Role, method: str, url: str, words: str
) -> None:
    site = FakeSite()
    answer = ask(site, method, url, keys=ring(role), headers=bearing(role), content=CALL)
    assert answer.status_code == 403
    assert words in form_of(answer, url)[0]
    assert (site.requests, site.decisions) == ([], [])


@everywhere
def test_a_site_that_is_closed_without_keys_lets_nobody_in(method: str, url: str) -> None:
    assert ask(FakeSite(), method, url, keys=ring(open_without_keys=False)).status_code == 401
    assert (
        ask(FakeSite(), method, url, keys=ring(open_without_keys=False), headers=bearing(Role.OPERATOR)).status_code
        == 401
    )


def test_what_does_not_exist_is_404_only_to_who_has_a_key() -> None:
    assert ask(FakeSite(), "GET", "/api/v1/nothing", keys=ring(Role.VIEWER)).status_code == 401
    answer = ask(FakeSite(), "GET", "/api/v1/nothing", keys=ring(Role.VIEWER), headers=bearing(Role.VIEWER))
    assert (answer.status_code, answer.json()["code"]) == (404, "no_such_path")


@pytest.mark.parametrize("headers", [{}, {"Authorization": "Basic bm9ib2R5Og=="}])
def test_while_there_are_no_keys_nobody_needs_one_and_all_are_the_workshop(headers: Mapping[str, str]) -> None:
    site = FakeSite()
    assert ask(site, "POST", REQUEST, content=CALL, headers=headers).json()["success"] is True
    assert site.requests[0].holder == Holder("workshop", "workshop")
    assert str(site.requests[0].holder) == "workshop"


@pytest.mark.parametrize("headers", [{"Authorization": "Bearer nonsense"}, bearing(Role.OPERATOR)])
def test_while_there_are_no_keys_a_key_is_refused(headers: Mapping[str, str]) -> None:
    site = FakeSite()
    answer = ask(site, "POST", REQUEST, content=CALL, headers=headers)
    assert (answer.status_code, site.requests) == (401, [])
    assert "this key does not count here" in answer.text
    assert ask(site, "GET", "/healthz", headers=headers).status_code == 200


@each_row("role", [Role.ROBOT, Role.OPERATOR, Role.COMMISSIONER])
def test_a_caller_with_a_key_holds_the_lift_in_its_own_name(role: Role) -> None:
    site = FakeSite()
    assert ask(site, "POST", REQUEST, content=CALL, keys=ring(*Role), headers=bearing(role)).is_success
    assert str(site.requests[0].holder) == f"workshop:the {role}"


def test_what_a_person_says_is_signed_with_the_name_of_the_key_from_any_computer() -> None:
    site = FakeSite()
    url = f"http://192.0.2.7{LOCKOUT}"
    answer = ask(site, "POST", url, keys=ring(*Role), headers=bearing(Role.OPERATOR), json=WORDS)
    assert answer.json()["by"] == "M. Weber (key the operator)"
    assert site.decisions == [("lock_out", "lift", "M. Weber (key the operator)", "new ropes")]


def test_a_web_page_of_another_site_is_refused_also_with_a_key() -> None:
    headers = {**bearing(Role.OPERATOR), "origin": "http://evil.example"}
    answer = ask(FakeSite(), "POST", LOCKOUT, keys=ring(*Role), headers=headers, json=WORDS)
    assert (answer.status_code, answer.json()["code"]) == (403, "another_site")


@pytest.mark.parametrize("keys", [ring(), ring(*Role)], ids=["without keys", "with keys"])
@pytest.mark.parametrize(
    ("method", "url"),
    [
        ("GET", f"{STATE}?lift_name={RIGHT}"),
        ("GET", f"{STATE}?lift_name=lift&key={RIGHT}"),
        ("GET", f"{STATE}?lift_name=lift&key={RIGHT.replace('_', '%5F')}"),
        ("GET", f"{STATE}?lift_name=lift&key={RIGHT[12:]}"),
        ("POST", f"/api/v1/lifts/{RIGHT}/lockout"),
        ("GET", f"/{RIGHT[:-3]}"),
        ("GET", f"/docs/{RIGHT}"),
    ],
)
def test_a_key_in_the_address_is_refused_in_words_that_do_not_repeat_it(
    method: str, url: str, keys: object, caplog: pytest.LogCaptureFixture
) -> None:
    answer = ask(FakeSite(), method, url, keys=keys, headers=bearing(Role.OPERATOR), json=WORDS)  # type: ignore[arg-type]
    assert answer.status_code == 400
    assert "revoke that key" in form_of(answer, url)[0]
    assert RIGHT[12:40] not in answer.text + caplog.text


@each_row(
    ("url", "body", "status"),
    [
        (REQUEST, {"floor": RIGHT, "door_state": 0}, 200),
        (REQUEST, {"floor": "L2", "door_state": 0, RIGHT: 1}, 200),
        (REQUEST, {"floor": "L2", "door_state": [RIGHT]}, 200),
        (LOCKOUT, WORDS | {"reason": f"my key is {RIGHT}"}, 422),
        (LOCKOUT, WORDS | {"by": RIGHT[12:]}, 422),
        (LOCKOUT, WORDS | {RIGHT: "x"}, 422),
    ],
)
@each_row("escaped", [False, True])
def test_a_key_in_a_body_reaches_nobody_and_is_not_repeated(
    url: str, body: dict[str, object], status: int, escaped: bool
) -> None:
    site = FakeSite()
    content = json.dumps(body).replace("_", "\\u005f") if escaped else json.dumps(body)
    content = content.replace("door\\u005fstate", "door_state")
    answer = ask(site, "POST", f"http://127.0.0.1{url}", content=content)
    assert answer.status_code == status
    assert "looks like an API key" in form_of(answer, url)[0]
    assert RIGHT[12:40] not in answer.text
    assert (site.requests, site.decisions) == ([], [])


def test_a_key_that_is_in_a_body_twice_is_not_repeated() -> None:
    answer = ask(FakeSite(), "POST", REQUEST, content=f'{{"{RIGHT}": 1, "{RIGHT}": 2}}')
    assert "the key [an API key] is in the body twice" in answer.text
    assert RIGHT[12:40] not in answer.text


def test_the_document_names_the_scheme_and_the_roles_and_every_refusal() -> None:
    document = ask(FakeSite(), "GET", "/openapi.json", keys=ring(*Role)).json()
    scheme = document["components"]["securitySchemes"]["key"]
    assert (scheme["type"], scheme["scheme"]) == ("http", "bearer")
    for path, operations in document["paths"].items():
        for operation in operations.values():
            if path in {"/healthz", "/readyz"}:
                assert operation["security"] == []
                assert "401" not in operation["responses"]
                assert "another_site" in operation["responses"]["403"]["description"]
                continue
            assert (operation["security"][0], operation["security"][-1]) == ({"key": []}, {})
            assert "allowed roles: " in operation["description"]
            assert {"400", "401", "403", "431", "500"} <= operation["responses"].keys()
            assert "WWW-Authenticate" in operation["responses"]["401"]["headers"]


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_refusals_are_logged_once_a_minute_for_each_address_and_ten_lines_at_the_most(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = Clock()
    log = RefusalLog(clock)
    for _ in range(1000):
        log.log_refusal("192.0.2.7", "it has no key")
    assert caplog.messages == ["a request from 192.0.2.7 was refused: it has no key"]
    for number in range(1000):
        log.log_refusal(f"192.0.2.{number}", "it has no key")
    assert len(caplog.messages) == MAX_LOGGED_REFUSALS
    clock.now += REFUSAL_WINDOW_S
    log.log_refusal("192.0.2.7", "it has no key")
    assert caplog.messages[MAX_LOGGED_REFUSALS:] == [
        f"{2000 - MAX_LOGGED_REFUSALS} more requests were refused since, and not logged each",
        "a request from 192.0.2.7 was refused: it has no key",
    ]


def test_a_refusal_is_logged_with_its_address_and_without_what_was_sent(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    headers = {"Authorization": f"Bearer {RIGHT}"}
    app = make_app(FakeSite(), ring(Role.VIEWER))  # one that has refused nobody, for it logs the same only once
    ask_app(app, "GET", f"{BASE}/lift_names", headers=headers)
    ask_app(app, "POST", REQUEST, headers=bearing(Role.VIEWER))
    assert "a request from 127.0.0.1 was refused: its key does not count" in caplog.messages
    assert "a request from 127.0.0.1 was refused: the key the viewer may not do this" in caplog.messages
    assert RIGHT[12:40] not in caplog.text


@each_row(
    ("headers", "url", "code", "lift", "caller"),
    [
        ({}, REQUEST, "key_needed", "", ""),
        ({"Authorization": f"Bearer {RIGHT[:-1]}x"}, REQUEST, "bad_key", "", ""),
        (bearing(Role.VIEWER), REQUEST, "not_allowed", "lift", "workshop:the viewer"),
        (bearing(Role.ROBOT), f"{BASE}/lift_request?lift_name=cellar", "not_allowed", "cellar", "workshop:the robot"),
        (bearing(Role.ROBOT), LOCKOUT, "not_allowed", "lift", "the robot"),
        (
            bearing(Role.OPERATOR),
            f"{BASE}/lift_request?lift_name=cellar",
            "unknown_lift",
            "cellar",
            "workshop:the operator",
        ),
    ],
)
def test_whoever_is_turned_away_is_written_down_with_the_name_of_its_key_and_never_the_key(
    headers: Mapping[str, str], url: str, code: str, lift: str, caller: str
) -> None:
    site = FakeSite()
    ask(site, "POST", url, keys=ring(Role.VIEWER, Role.ROBOT, Role.OPERATOR), headers=headers, content=CALL)
    (away,) = site.away
    assert (away.code, away.lift, away.caller, away.address) == (code, lift, caller, "127.0.0.1")
    assert "lm_" not in str(away)


def test_a_word_of_a_person_from_elsewhere_is_written_down_as_refused() -> None:
    site = FakeSite()
    ask(site, "POST", LOCKOUT, json=WORDS, headers={"Via": "1.1 a proxy"})
    assert [(away.code, away.lift) for away in site.away] == [("other_computer", "lift")]


def test_a_request_that_is_served_is_turned_away_by_nobody() -> None:
    site = FakeSite()
    ask(site, "POST", REQUEST, keys=ring(Role.ROBOT), headers=bearing(Role.ROBOT), content=CALL)
    assert (len(site.requests), site.away) == (1, [])
