"""A browser that is logged in: what its cookie is, what it may do with it, and what others may not."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from http.cookies import SimpleCookie
from typing import Any, cast

import httpx
from fastapi import FastAPI

from lift_manager.api.keys import KeyRing, Keys
from lift_manager.api.roles import Role
from lift_manager.lift.session import Holder
from lift_manager.web.app import make_app
from lift_manager.web.authenticator import cookie_name
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import CALL, REQUEST, FakeSite, ask, serving
from tests.lift_manager.web.keyed import bearing, key, ring
from tests.lift_manager.web.listening import EVENTS, Happening, listening
from tests.support.programs import HANGS_S
from tests.support.rows import each_row

LOGIN, LOGOUT, LIFTS = "/api/v1/login", "/api/v1/logout", "/api/v1/lifts"
LOCKOUT = "/api/v1/lifts/lift/lockout"
WORDS = {"by": "M. Weber", "reason": "new ropes"}
HERE = "http://127.0.0.1:5003"
EVERY_KEY = ring(*Role)


class Revocable:
    """Keys that can be revoked."""

    def __init__(self, keys: KeyRing) -> None:
        self.now = keys

    def __getattr__(self, name: str) -> Any:
        return getattr(self.now, name)


@asynccontextmanager
async def browser(app: FastAPI, base: str = HERE) -> AsyncIterator[httpx.AsyncClient]:
    """A client that keeps cookies as a browser does, on a page of the manager."""
    marks = {"origin": base, "sec-fetch-site": "same-origin"}
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=base, headers=marks) as client:
        yield client


async def log_in(client: httpx.AsyncClient, role: Role) -> str:
    """Log in; returns the token for changes."""
    answer = await client.post(LOGIN, headers=bearing(role))
    assert answer.status_code == 200, answer.text
    token: str = answer.json()["csrf"]
    return token


def cookie_of(answer: httpx.Response) -> Mapping[str, Any]:
    ((_, cookie),) = SimpleCookie(answer.headers["set-cookie"]).items()
    return {**cookie, "value": cookie.value}


def test_the_cookie_is_out_of_reach_of_scripts_and_of_other_sites_and_holds_no_key() -> None:
    answer = ask(FakeSite(), "POST", f"{HERE}{LOGIN}", keys=EVERY_KEY, headers=bearing(Role.OPERATOR))
    cookie = cookie_of(answer)
    assert (cookie["httponly"], cookie["samesite"], cookie["max-age"]) == (True, "Strict", str(12 * 3600))
    # without a path it is for the folder of this request: /api/v1, also behind a proxy that adds a prefix
    assert (cookie["path"], cookie["domain"]) == ("", "")
    assert key(Role.OPERATOR)[12:] not in answer.headers["set-cookie"] + answer.text
    assert answer.headers["cache-control"] == "no-store"
    said = answer.json()
    assert (said["key"], said["role"], said["ends_in_s"] > 12 * 3600 - 60) == ("the operator", "operator", True)


@each_row(
    ("base", "origin", "secure"),
    [
        (HERE, HERE, ""),
        (HERE.replace("http:", "https:"), HERE.replace("http:", "https:"), True),
        (HERE, HERE.replace("http:", "https:"), True),  # a proxy ends TLS
    ],
)
def test_over_https_the_cookie_is_never_sent_in_plain(base: str, origin: str, secure: object) -> None:
    headers = {**bearing(Role.VIEWER), "origin": origin}
    answer = ask(FakeSite(), "POST", f"{base}{LOGIN}", keys=EVERY_KEY, headers=headers)
    assert cookie_of(answer)["secure"] == secure


def test_managers_on_two_ports_of_one_computer_have_cookies_of_their_own() -> None:
    assert cookie_name({"server": ("127.0.0.1", 5003)}) != cookie_name({"server": ("127.0.0.1", 5004)})


def test_a_login_acts_as_its_key_also_after_the_page_was_loaded_again() -> None:
    site = FakeSite()

    async def use() -> None:
        app = make_app(site, EVERY_KEY)
        async with browser(app) as client:
            await log_in(client, Role.OPERATOR)
            assert (await client.get(LIFTS)).status_code == 200
            again = (await client.get(LOGIN)).json()
            assert (again["key"], again["role"]) == ("the operator", "operator")
            headers = {"x-csrf-token": again["csrf"]}
            assert (await client.post(LOCKOUT, json=WORDS, headers=headers)).status_code == 200
            opened = await client.post("/api/v1/lifts/lift/sessions", json={"robot": "page"}, headers=headers)
            assert opened.json()["holder"] == "api:the operator/page"

    asyncio.run(use())
    assert site.decisions == [("lock_out", "lift", "M. Weber (key the operator)", "new ropes")]
    assert site.done[-1][2] == Holder("api", "the operator/page")


def test_a_login_may_no_more_than_its_key() -> None:
    site = FakeSite()

    async def use() -> None:
        async with browser(make_app(site, EVERY_KEY)) as client:
            token = await log_in(client, Role.VIEWER)
            answer = await client.post(LOCKOUT, json=WORDS, headers={"x-csrf-token": token})
            refused(answer, 403, "not_allowed")

    asyncio.run(use())
    assert site.changes == []


@each_row("sent", [{}, {"x-csrf-token": ""}, {"x-csrf-token": "x" * 43}, {"x-csrf-token": "\xe4"}, {"cookie2": "x"}])
@each_row("path", [LOCKOUT, "/api/v1/rides", LOGOUT, LOGIN, "/api/v1/lifts/lift/sessions"])
def test_a_login_changes_nothing_without_its_token(sent: Mapping[str, str], path: str) -> None:
    site = FakeSite()

    async def use() -> None:
        async with browser(make_app(site, EVERY_KEY)) as client:
            await log_in(client, Role.OPERATOR)
            headers = httpx.Headers(dict(sent), "latin-1")
            refused(await client.post(path, json=WORDS, headers=headers), 403, "csrf_token")
            assert (await client.get(LIFTS)).status_code == 200

    asyncio.run(use())
    assert site.changes == []
    assert [(away.code, away.caller) for away in site.away] == [("csrf_token", "the operator")]


def test_the_token_of_one_login_is_not_that_of_another() -> None:
    site = FakeSite()

    async def use() -> None:
        app = make_app(site, EVERY_KEY)
        async with browser(app) as one, browser(app) as other:
            token = await log_in(one, Role.OPERATOR)
            await log_in(other, Role.OPERATOR)
            refused(await other.post(LOCKOUT, json=WORDS, headers={"x-csrf-token": token}), 403, "csrf_token")

    asyncio.run(use())
    assert site.changes == []


@each_row(
    "marks",
    [
        {"sec-fetch-site": "cross-site", "origin": "http://evil.example"},
        {"sec-fetch-site": "same-site", "origin": "http://127.0.0.1:8000"},  # another port of this computer
        {"sec-fetch-site": "same-site"},
    ],
)
@each_row("method", ["GET", "POST"])
def test_a_page_of_another_origin_gets_nothing_with_the_cookie_not_even_with_its_token(
    method: str, marks: Mapping[str, str]
) -> None:
    site = FakeSite()

    async def use() -> None:
        async with browser(make_app(site, EVERY_KEY)) as client:
            token = await log_in(client, Role.OPERATOR)
            path = LIFTS if method == "GET" else LOCKOUT
            answer = await client.request(method, path, json=WORDS, headers={"x-csrf-token": token, **marks})
            refused(answer, 403, "another_site")

    asyncio.run(use())
    assert site.changes == []


def test_a_page_of_another_site_logs_nobody_in() -> None:
    headers = {**bearing(Role.OPERATOR), "origin": "http://evil.example", "sec-fetch-site": "cross-site"}
    answer = ask(FakeSite(), "POST", f"{HERE}{LOGIN}", keys=EVERY_KEY, headers=headers)
    refused(answer, 403, "another_site")
    assert "set-cookie" not in answer.headers


def test_after_a_logout_the_cookie_is_gone_and_a_copy_of_it_worthless() -> None:
    async def use() -> None:
        app = make_app(FakeSite(), EVERY_KEY)
        async with browser(app) as client, browser(app) as thief:
            token = await log_in(client, Role.OPERATOR)
            thief.cookies.update(client.cookies)
            assert (await thief.get(LIFTS)).status_code == 200
            assert (await client.post(LOGOUT, headers={"x-csrf-token": token})).status_code == 200
            assert dict(client.cookies) == {}
            refused(await client.get(LIFTS), 401, "key_needed")
            answer = await thief.get(LIFTS)
            refused(answer, 401, "login_over")
            assert answer.headers["www-authenticate"].startswith("Bearer")

    asyncio.run(use())


def test_the_journal_gets_every_login_and_logout_by_the_name_of_its_key() -> None:
    async def use() -> None:
        site = FakeSite()
        async with browser(make_app(site, EVERY_KEY)) as client:
            token = await log_in(client, Role.OPERATOR)
            await client.post(LOGOUT, headers={"x-csrf-token": token})
            assert site.logins == [("the operator", "127.0.0.1", False), ("the operator", "127.0.0.1", True)]

    asyncio.run(use())


def test_a_login_ends_with_its_key_and_another_ones_does_not() -> None:
    keys = Revocable(ring(Role.OPERATOR, Role.VIEWER))

    async def use() -> None:
        app = make_app(FakeSite(), cast("Keys", keys))
        async with browser(app) as desk, browser(app) as wall:
            await log_in(desk, Role.OPERATOR)
            await log_in(wall, Role.VIEWER)
            keys.now = ring(Role.VIEWER)
            refused(await desk.get(LIFTS), 401, "login_over")
            assert (await wall.get(LIFTS)).status_code == 200

    asyncio.run(use())


def test_a_manager_that_was_started_again_asks_for_the_key_again() -> None:
    async def use() -> None:
        async with (
            browser(make_app(FakeSite(), EVERY_KEY)) as before,
            browser(make_app(FakeSite(), EVERY_KEY)) as after,
        ):
            await log_in(before, Role.VIEWER)
            after.cookies.update(before.cookies)
            refused(await after.get(LIFTS), 401, "login_over")

    asyncio.run(use())


def test_a_stream_of_a_login_ends_with_a_logout() -> None:
    async def use() -> None:
        app = make_app(Happening(), EVERY_KEY)
        async with serving(app) as port:
            base = f"http://127.0.0.1:{port}"
            async with httpx.AsyncClient(base_url=base, trust_env=False, timeout=HANGS_S) as client:
                token = (await client.post(LOGIN, headers=bearing(Role.VIEWER))).json()["csrf"]
                cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
                async with listening(port, EVENTS, {"Cookie": cookie}) as stream:
                    assert await stream.begin() == 200
                    await stream.take(1)
                    assert (await client.post(LOGOUT, headers={"x-csrf-token": token})).status_code == 200
                    await stream.rest()

    asyncio.run(use())


def test_a_login_is_made_with_a_key_so_that_it_cannot_last_for_ever() -> None:
    async def use() -> None:
        async with browser(make_app(FakeSite(), EVERY_KEY)) as client:
            token = await log_in(client, Role.OPERATOR)
            refused(await client.post(LOGIN, headers={"x-csrf-token": token}), 401, "key_needed")

    asyncio.run(use())


@each_row(
    ("headers", "code"),
    [
        ({}, "key_needed"),
        ({"Authorization": "Bearer nonsense"}, "bad_key"),
        ({"Authorization": f"Bearer {key(Role.OPERATOR)[:-1]}x"}, "bad_key"),
    ],
)
def test_a_login_that_fails_is_refused_and_written_down_as_any_bad_key(headers: Mapping[str, str], code: str) -> None:
    site = FakeSite()
    answer = ask(site, "POST", f"{HERE}{LOGIN}", keys=EVERY_KEY, headers=headers)
    refused(answer, 401, code)
    assert "set-cookie" not in answer.headers
    assert [away.code for away in site.away] == [code]


def test_a_key_in_the_header_counts_before_any_cookie_and_needs_no_token() -> None:
    site = FakeSite()

    async def use() -> None:
        async with browser(make_app(site, EVERY_KEY)) as client:
            await log_in(client, Role.VIEWER)
            assert (await client.post(LOCKOUT, json=WORDS, headers=bearing(Role.OPERATOR))).status_code == 200
            refused(await client.get(LIFTS, headers={"Authorization": "Bearer x"}), 401, "bad_key")

    asyncio.run(use())
    assert len(site.decisions) == 1


def test_two_logins_in_one_request_are_none() -> None:
    async def use() -> None:
        async with browser(make_app(FakeSite(), EVERY_KEY)) as client:
            await log_in(client, Role.OPERATOR)
            ((name, value),) = client.cookies.items()
            client.cookies.clear()
            for sent in (f"{name}={value}", f"a=b;{name}={value}", f"{name}={value}; {name}x=y"):
                assert (await client.get(LIFTS, headers={"cookie": sent})).status_code == 200
            for sent in (f"{name}={value}; {name}={value}", f"{name}=; {name}={value}", f"{name}={value[:-1]}", name):
                refused(await client.get(LIFTS, headers={"cookie": sent}), 401, "login_over")

    asyncio.run(use())


def test_a_login_counts_nowhere_but_under_api() -> None:
    site = FakeSite()

    async def use() -> None:
        async with browser(make_app(site, EVERY_KEY)) as client:
            token = await log_in(client, Role.COMMISSIONER)
            cookie = {"cookie": "; ".join(f"{name}={value}" for name, value in client.cookies.items())}
            assert (await client.get("/metrics", headers=cookie)).status_code == 401
            headers = {**cookie, "x-csrf-token": token}
            assert (await client.post(REQUEST, content=CALL, headers=headers)).status_code == 401

    asyncio.run(use())
    assert site.changes == []


def test_a_site_without_keys_has_nothing_to_log_in_to() -> None:
    nobody = {"key": None, "role": None, "csrf": None, "ends_in_s": None}
    for method, path in (("POST", LOGIN), ("GET", LOGIN), ("POST", LOGOUT)):
        answer = ask(FakeSite(), method, f"{HERE}{path}")
        assert (answer.status_code, answer.json()) == (200, nobody)
        assert "set-cookie" not in answer.headers


def test_the_document_has_the_cookie_and_its_token_where_they_count() -> None:
    document = ask(FakeSite(), "GET", "/openapi.json", keys=EVERY_KEY).json()
    schemes = document["components"]["securitySchemes"]
    assert (schemes["login"]["in"], schemes["csrf"]["in"], schemes["csrf"]["name"]) == (
        "cookie",
        "header",
        "x-csrf-token",
    )
    paths = document["paths"]
    assert paths[LIFTS]["get"]["security"] == [{"key": []}, {"login": []}, {}]
    assert paths[LOCKOUT.replace("/lift/", "/{lift}/")]["post"]["security"] == [
        {"key": []},
        {"login": [], "csrf": []},
        {},
    ]
    assert paths["/metrics"]["get"]["security"] == [{"key": []}, {}]
    assert "`login_over`" in paths[LIFTS]["get"]["responses"]["401"]["description"]
