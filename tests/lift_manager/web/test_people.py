"""What people say about a lift, over HTTP: taken from this computer alone, and every no says why."""

import asyncio
from typing import Any

import httpx
import pytest
from starlette.requests import Request

from lift_manager.api.keys import KeyRing
from lift_manager.api.roles import Role
from lift_manager.lift.journal import RowKind
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.web.app import make_app
from lift_manager.web.origin import is_from_this_computer
from tests.lift_manager.runtime.ride_building import building
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import NAME, FakeSite, ask
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row
from tests.support.virtual_time import run_virtual

BASE = "http://127.0.0.1:5003/api/v1/lifts"
BY = {"by": "M. Weber"}
LOCKOUT = {"by": "M. Weber", "reason": "new ropes"}
RELEASE = {"by": "M. Weber", "reason": "carried away"}
SAYINGS = [
    ("acknowledge", BY),
    ("lockout", LOCKOUT),
    ("lockout/end", BY),
    ("drain", LOCKOUT),
    ("drain/end", BY),
    ("session/force-release", RELEASE),
]

every_saying = each_row(("what", "body"), SAYINGS)


def say(site: FakeSite, what: str, lift: str = "lift", **more: Any) -> httpx.Response:
    return ask(site, "POST", f"{BASE}/{lift}/{what}", **more)


def test_an_acknowledgement_says_what_was_acknowledged() -> None:
    site = FakeSite()
    answer = say(site, "acknowledge", json=BY)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    assert answer.json() == {
        "lift": "lift",
        "by": "M. Weber",
        "at": "2026-03-01T20:15:00Z",
        "acknowledged": ["fire", "occupied"],
    }
    assert site.decisions == [("acknowledge", "lift", "M. Weber")]


def test_a_drain_and_its_end_say_who_since_when_and_why() -> None:
    site = FakeSite()
    assert say(site, "drain", json=LOCKOUT).json()["since"] == "2026-03-01T20:15:00Z"
    ended = say(site, "drain/end", json=BY).json()
    assert (ended["by"], ended["drain"]["by"]) == ("M. Weber", "A. Beck")
    assert site.decisions == [("begin_drain", "lift", "M. Weber", "new ropes"), ("end_drain", "lift", "M. Weber")]


@pytest.mark.parametrize("what", ["lockout", "session/force-release"])
def test_now_says_that_a_held_door_does_not_wait_for_a_robot_in_the_doorway(what: str) -> None:
    site = FakeSite()
    body = {"by": "M. Weber", "reason": "new ropes"}
    say(site, what, json=body)
    say(site, what, json=body | {"now": True})
    assert [said[4:] for said in site.decisions] == [(), ("now",)]


def test_a_lockout_and_its_end_say_who_since_when_and_why() -> None:
    site = FakeSite()
    made = say(site, "lockout", json={"by": "  M. Weber ", "reason": "new ropes"})
    expected = {"lift": "lift", "by": "M. Weber", "reason": "new ropes", "since": "2026-03-01T20:15:00Z"}
    assert (made.status_code, made.json()) == (200, expected)
    ended = say(site, "lockout/end", json=BY).json()
    assert (ended["by"], ended["at"], ended["lockout"]["by"]) == ("M. Weber", "2026-03-01T20:15:00Z", "A. Beck")
    assert site.decisions == [("lock_out", "lift", "M. Weber", "new ropes"), ("end_lockout", "lift", "M. Weber")]


def test_a_session_that_a_person_ends_says_whose_it_was_and_what_is_left_to_do() -> None:
    site = FakeSite()
    answer = say(site, "session/force-release", json=RELEASE)
    assert answer.status_code == 200
    said = answer.json()
    text = said.pop("text")
    assert said == {
        "lift": "lift",
        "by": "M. Weber",
        "reason": "carried away",
        "at": "2026-03-01T20:15:00Z",
        "holder": "workshop:robot-1",
        "maybe_aboard": True,
        "clear_s": 0.0,
    }
    assert "`lift-manager ack lift --by NAME`" in text
    assert site.decisions == [("force_release", "lift", "M. Weber", "carried away")]


STOOD = {"stood_at_lift": True}


@each_row(("what", "body"), [("acknowledge", BY), ("lockout", LOCKOUT), ("lockout/end", BY)])
@each_row(
    ("keys", "said", "signed"),
    [
        (None, STOOD, "M. Weber (stood at the lift)"),
        (ring(Role.OPERATOR), STOOD, "M. Weber (key the operator, stood at the lift)"),
        (ring(Role.OPERATOR), {"stood_at_lift": False}, "M. Weber (key the operator)"),
        (None, {}, "M. Weber"),
    ],
)
def test_who_says_to_have_stood_at_the_lift_is_written_down_so(
    what: str, body: dict[str, str], keys: KeyRing | None, said: dict[str, bool], signed: str
) -> None:
    site = FakeSite()
    headers = {} if keys is None else bearing(Role.OPERATOR)
    assert say(site, what, json=body | said, keys=keys, headers=headers).status_code == 200
    assert site.decisions[0][2] == signed


@every_saying
def test_a_lift_with_any_name_can_be_named(what: str, body: dict[str, str]) -> None:
    site = FakeSite({name: next(iter(FakeSite().lifts.values())) for name in ("B-2_goods.1", "lockout")})
    for quoted in ("B-2_goods%2E1", "lockout"):
        assert say(site, what, quoted, json=body).status_code == 200
    assert [said[1] for said in site.decisions] == ["B-2_goods.1", "lockout"]


@every_saying
@each_row(
    "headers",
    [
        {"host": NAME},
        {"host": "10.0.0.7:5003", "origin": "http://10.0.0.7:5003"},
        {"host": "10.0.0.7:5003"},
        {"x-forwarded-for": "10.0.0.7"},
        {"forwarded": "for=10.0.0.7"},
        {"via": "1.1 proxy"},
        {"x-forwarded-host": "lift.example"},
        {"x-forwarded-proto": "https"},
        {"cf-connecting-ip": "203.0.113.9"},
        {"true-client-ip": "203.0.113.9"},
        {"x-client-ip": "203.0.113.9"},
    ],
)
def test_what_comes_by_another_name_or_through_a_proxy_is_refused(
    what: str, body: dict[str, str], headers: dict[str, str]
) -> None:
    site = FakeSite()
    detail = refused(say(site, what, json=body, headers=headers), 403, "other_computer")
    assert "this site has no keys" in detail
    assert site.decisions == []


@every_saying
@each_row("host", ["evil.example", "", "[", "127.0.0.1:5003, evil.example", "127.0.0.1:0"])
def test_what_comes_by_an_unknown_name_is_refused(what: str, body: dict[str, str], host: str) -> None:
    site = FakeSite()
    refused(say(site, what, json=body, headers={"host": host}), 403, "another_site")
    assert site.decisions == []


@each_row(
    ("client", "host", "taken"),
    [
        ("127.0.0.1", "127.0.0.1:5003", True),
        ("127.0.0.1", "localhost:5003", True),
        ("::1", "[::1]:5003", True),
        ("::ffff:127.0.0.1", "127.0.0.1", True),
        ("10.0.0.7", "127.0.0.1:5003", False),
        ("::ffff:10.0.0.7", "127.0.0.1:5003", False),
        ("fe80::1", "localhost", False),
    ],
)
def test_only_this_computer_is_taken_at_its_word(client: str, host: str, *, taken: bool) -> None:
    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(make_app(FakeSite()), client=(client, 50000))
        async with httpx.AsyncClient(transport=transport) as browser:
            return await browser.post(f"{BASE}/lift/acknowledge", json=BY, headers={"host": host})

    answer = asyncio.run(once())
    if taken:
        assert answer.status_code == 200
    else:
        refused(answer, 403, "other_computer")


def asked(client: str, to: str, host: str, http_version: str = "1.1") -> Request:
    """A request from an address to an address, by a name."""
    scope: dict[str, Any] = {"type": "http", "http_version": http_version, "method": "POST", "path": "/"}
    scope |= {"query_string": b"", "client": (client, 50000), "server": (to, 5003)}
    return Request(scope | {"headers": [(b"host", host.encode())]})


def test_a_proxy_that_leaves_no_trace_but_the_old_protocol_is_no_program_of_this_computer() -> None:
    assert is_from_this_computer(asked("127.0.0.1", "127.0.0.1", "127.0.0.1:5003"))
    assert not is_from_this_computer(asked("127.0.0.1", "127.0.0.1", "127.0.0.1:5003", "1.0"))


def test_a_manager_that_listens_on_one_address_is_told_by_its_own_computer() -> None:
    assert is_from_this_computer(asked("192.0.2.10", "192.0.2.10", "192.0.2.10:5003"))
    assert is_from_this_computer(asked("2001:db8::1", "2001:db8::1", "[2001:db8::1]:5003"))
    assert not is_from_this_computer(asked("192.0.2.11", "192.0.2.10", "192.0.2.10:5003"))
    assert not is_from_this_computer(asked("192.0.2.10", "192.0.2.10", "evil.example:5003"))
    assert not is_from_this_computer(asked("192.0.2.10", "192.0.2.10", "192.0.2.11:5003"))


@each_row(("by", "kept"), [("M.\u00a0Weber", "M. Weber"), ("عل\u200cر", "عل\u200cر"), ("👩\u200d🔧", "👩\u200d🔧")])
def test_names_in_any_script_are_taken(by: str, kept: str) -> None:
    site = FakeSite()
    assert say(site, "acknowledge", json={"by": by}).status_code == 200
    assert site.decisions == [("acknowledge", "lift", kept)]


def test_a_decision_about_a_lift_that_there_is_not_is_counted_and_written_down_once() -> None:
    async def main() -> None:
        recorder = MemoryRecorder()
        async with building("lift", recorder=recorder) as made:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(make_app(made.site))) as browser:
                refused(await browser.post(f"{BASE}/elevator/lockout", json=LOCKOUT), 404, "unknown_lift")
            (row,) = [row for row in recorder.rows if row.lift == "elevator"]
            assert (row.kind, row.caller) == (RowKind.PERSON, "M. Weber")
            assert row.text == 'lockout refused: no lift "elevator"; the lifts are lift'
            assert row.data == {"said": "lockout", "refused": "unknown_lift"}
            assert made.site.refusals.counts == {("", "unknown_lift"): 1}

    run_virtual(main, limit_s=9000)


def test_a_path_or_a_method_that_does_not_exist_is_a_problem_too() -> None:
    refused(ask(FakeSite(), "PUT", f"{BASE}/lift/lockout"), 405, "wrong_method")
    refused(ask(FakeSite(), "POST", f"{BASE}/lift/nothing"), 404, "no_such_path")
    refused(ask(FakeSite(), "POST", "/api/v1/nothing"), 404, "no_such_path")
