import json
import logging

import pytest

from lift_manager.api.roles import ROUTES, AccessLevel, Route
from lift_manager.lift.refusals import Accepted
from lift_manager.lift.session import Holder
from lift_manager.web.app import make_app
from tests.lift_manager.web.fake import BASE, CALL, REQUEST, FakeSite, ask, ask_app
from tests.support.rows import each_row


class BrokenSite(FakeSite):
    def request(self, lift: str, holder: Holder, floor: str, **more: object) -> Accepted:
        raise ZeroDivisionError("a bug")


@each_row(
    "path",
    [
        "/open-rmf",
        "/open-rmf/",
        BASE,
        f"{BASE}/",
        f"{BASE}/lift_names/",
        f"{BASE}/Lift_names",
        f"{BASE}/%2e%2e/docs",
        "/open-rmf/other/lift_names",
        "/open-rmf/%00",
        "/open-rmf/%C3%A4",
    ],
)
def test_an_unknown_workshop_path_is_404_in_the_envelope(path: str) -> None:
    answer = ask(FakeSite(), "GET", path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/json"
    envelope = json.loads(answer.content)
    assert (envelope["data"], envelope["success"]) == ({}, False)
    assert envelope["msg"].startswith("Not Found; under /open-rmf/demo-lift/ there are: GET lift_names, ")


@each_row("path", sorted({route.path for route in ROUTES}))
def test_405_names_every_method_that_a_path_takes_and_no_other(path: str) -> None:
    url = (
        path.replace("{path:path}", "x.js")
        .replace(":path}", "}")
        .format(lift="lift", session="s1", command="1", ride="r1", link="plc", file="enters.wav")
    )
    allowed = list(dict.fromkeys(method for route in ROUTES if route.path == path for method in route.methods))
    for method in ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"):
        if method not in allowed:
            answer = ask(FakeSite(), method, url)
            assert (answer.status_code, answer.headers["allow"]) == (405, ", ".join(allowed)), method


@each_row(
    ("method", "path", "allowed"),
    [("POST", "lift_names", "GET"), ("PUT", "lift_state", "GET"), ("GET", "lift_request", "POST")],
)
def test_a_wrong_method_is_405_in_the_envelope_and_names_the_right_one(method: str, path: str, allowed: str) -> None:
    answer = ask(FakeSite(), method, f"{BASE}/{path}")
    assert answer.status_code == 405
    assert answer.headers["allow"] == allowed
    assert answer.json()["success"] is False


@each_row("path", ["/nothing", "/open-rmfx", "/docs/", "/docs/nothing.js", "/redoc/%2e%2e/x", "/%FF"])
def test_any_other_unknown_path_is_404_in_json(path: str) -> None:
    answer = ask(FakeSite(), "GET", path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/json"
    assert answer.content == b'{"detail":"Not Found"}'


def test_the_root_is_the_page() -> None:
    answer = ask(FakeSite(), "GET", "/")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"


def test_a_bug_is_logged_once_with_its_traceback_and_answered_without(caplog: pytest.LogCaptureFixture) -> None:
    answer = ask(BrokenSite(), "POST", REQUEST, content=CALL)
    assert answer.status_code == 500
    assert answer.content == (b'{"data":{},"success":false,"msg":"internal error; the manager\'s log has the details"}')
    (record,) = (entry for entry in caplog.records if entry.levelno >= logging.ERROR)
    assert record.exc_info is not None
    assert record.exc_info[0] is ZeroDivisionError
    assert record.getMessage() == f"POST {BASE}/lift_request failed"


def test_a_bug_elsewhere_is_answered_in_json() -> None:
    app = make_app(FakeSite(), routes=[*ROUTES, Route(("GET",), "/bug", AccessLevel.READ)])

    @app.get("/bug")
    async def bug() -> None:
        raise ZeroDivisionError

    answer = ask_app(app, "GET", "/bug")
    assert answer.status_code == 500
    assert answer.json() == {"detail": "internal error; the manager's log has the details"}


def test_two_applications_in_one_process_do_not_disturb_each_other() -> None:
    first, second = make_app(FakeSite()), make_app(FakeSite({}))
    assert ask_app(first, "GET", f"{BASE}/lift_names").json()["data"]["lift_names"] == ["lift", "goods"]
    assert ask_app(second, "GET", f"{BASE}/lift_names").json()["data"]["lift_names"] == []
    assert ask_app(second, "GET", "/docs").status_code == 200
