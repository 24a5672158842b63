"""A web page whose name was made to lead to the manager after it was loaded cannot ask it: a browser asks by address."""

from collections.abc import Mapping

import pytest

from lift_manager.domain.access import Role
from tests.lift_manager.web.fake import ACCEPTED, CALL, REQUEST, STATE, FakeManager, ask
from tests.lift_manager.web.keyed import bearing, ring
from tests.lift_manager.web.test_people import refused

REBOUND = {"host": "evil.example:5003", "origin": "http://evil.example:5003"}
"""Of one site, as far as the browser can tell."""
ASKED = [
    ("GET", "/api/v1/lifts"),
    ("GET", "/api/v1/lifts/lift"),
    ("GET", "/api/v1/events"),
    ("GET", "/api/v1/links"),
    ("POST", "/api/v1/rides"),
    ("POST", "/api/v1/lifts/lift/sessions"),
    ("POST", "/api/v1/lifts/lift/acknowledge"),
]
BY_BROWSER: list[Mapping[str, str]] = [
    {"origin": "http://evil.example:5003"},
    {"sec-fetch-site": "same-origin"},
    {"sec-fetch-site": "none", "sec-fetch-user": "?1"},
    {"Sec-Fetch-Mode": "cors"},
]
OWN = ["127.0.0.1:5003", "localhost:5003", "localhost", "192.0.2.7", "[::1]:5003", "[2001:db8::7]"]


@pytest.mark.parametrize(("method", "path"), ASKED)
@pytest.mark.parametrize("marks", BY_BROWSER, ids=str)
def test_without_keys_a_browser_that_asks_by_a_name_is_told_to_ask_by_address(
    method: str, path: str, marks: Mapping[str, str]
) -> None:
    facade = FakeManager()
    said = refused(ask(facade, method, path, headers={"host": "evil.example:5003", **marks}), 403, "another_site")
    assert "by a name" in said
    assert "localhost" in said
    assert "lift-manager keys make" in said
    assert facade.changes == []
    assert [away.code for away in facade.away] == ["another_site"]


def test_the_workshop_takes_no_call_from_it_either() -> None:
    facade = FakeManager()
    answer = ask(facade, "POST", REQUEST, headers=REBOUND, content=CALL)
    assert (answer.status_code, answer.json()["success"]) == (403, False)
    assert "by a name" in answer.json()["msg"]
    assert facade.changes == []


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "127.0.0.1x", "", "[::1"]
)
def test_what_only_looks_like_an_address_is_none(host: str) -> None:
    facade = FakeManager()
    answer = ask(facade, "GET", "/api/v1/lifts", headers={"host": host, "sec-fetch-site": "same-origin"})
    refused(answer, 403, "another_site")


@pytest.mark.parametrize("host", OWN)
def test_a_browser_that_asks_by_address_is_served(host: str) -> None:
    facade = FakeManager()
    headers = {"host": host, "origin": f"http://{host}", "sec-fetch-site": "same-origin"}
    assert ask(facade, "GET", "/api/v1/lifts", headers=headers).status_code == 200
    assert ask(facade, "POST", "/api/v1/lifts/lift/sessions", headers=headers).status_code == 201
    assert ask(facade, "POST", REQUEST, headers=headers, content=CALL).content == ACCEPTED


def test_programs_ask_by_any_name() -> None:
    facade = FakeManager()
    headers = {"host": "lifts.example"}
    assert ask(facade, "GET", "/api/v1/lifts", headers=headers).status_code == 200
    assert ask(facade, "POST", REQUEST, headers=headers, content=CALL).content == ACCEPTED


def test_what_tells_nothing_and_commands_nothing_is_served_by_any_name() -> None:
    for path in ("/docs", "/openapi.json", "/healthz", f"{STATE}?lift_name=lift"):
        assert ask(FakeManager(), "GET", path, headers=REBOUND).status_code == 200, path


def test_where_there_are_keys_a_browser_asks_by_any_name_with_one() -> None:
    facade, keys = FakeManager(), ring(Role.OPERATOR)
    headers = {**REBOUND, **bearing(Role.OPERATOR)}
    assert ask(facade, "GET", "/api/v1/lifts", keys=keys, headers=headers).status_code == 200
    assert ask(facade, "POST", REQUEST, keys=keys, headers=headers, content=CALL).content == ACCEPTED
