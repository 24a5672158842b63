"""ACCESS.md is what the code says, and what the application does: every cell of it is asked."""

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

import httpx
from fastapi import FastAPI
from fastapi.routing import iter_route_contexts
from starlette.types import Message, Scope

from lift_manager.api.keys import KeyRing, Keys
from lift_manager.api.roles import ROUTES, AccessLevel, LiftIn, Role, Route
from lift_manager.lift.session import Holder
from lift_manager.runtime.links import WireFrame
from lift_manager.runtime.site import Site
from lift_manager.web.access_page import COLUMNS, FILE, NO_KEYS, access_table
from lift_manager.web.app import make_app
from tests.lift_manager.web.changes import OF_THE_CALLER
from tests.lift_manager.web.fake import FakeSite, Made, app_of, ask_app
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.fake_sessions import a_command, a_session
from tests.lift_manager.web.keyed import NAMED, OTHER, bearing, key, ring
from tests.lift_manager.web.test_announcements import SOUND
from tests.support.programs import HANGS_S
from tests.support.rows import each_row

ASKERS: dict[str, tuple[Role | None, tuple[str, ...]]] = {
    "no key": (None, (NAMED, OTHER)),
    "viewer": (Role.VIEWER, (NAMED, OTHER)),
    "robot, its lift": (Role.ROBOT, (NAMED,)),
    "robot, another lift": (Role.ROBOT, (OTHER,)),
    "rmf, its lift": (Role.RMF, (NAMED,)),
    "rmf, another lift": (Role.RMF, (OTHER,)),
    "operator": (Role.OPERATOR, (NAMED, OTHER)),
    "commissioner": (Role.COMMISSIONER, (NAMED, OTHER)),
}
BODY = {
    "floor": "L2",
    "door_state": 0,
    "by": "M. Weber",
    "reason": "new ropes",
    "to": "L2",
    "from": "L1",
    "do": "go_to",
    "session_id": "fleet/amr-7",
    "hold_door": True,
    "grace_s": 3,
}
KEYS_OF = {
    "lift_request": ("floor", "door_state"),
    "lockout": ("by", "reason"),
    "drain": ("by", "reason"),
    "force-release": ("by", "reason"),
    "acknowledge": ("by",),
    "end": ("by",),
    "hand-over": ("to",),
    "commands": ("do", "floor"),
    "rides": ("from", "to"),
    "wanted": ("session_id", "floor", "hold_door"),
    "ended": ("session_id", "grace_s"),
}


def cells(columns: tuple[str, ...]) -> Iterator[tuple[str, str, str, bool]]:
    """Every cell of one of the two tables in the file: method, path, column, whether it says yes."""
    _, with_keys, without = FILE.read_text("utf-8").split("| request |")
    text = with_keys if columns == COLUMNS else without
    header, _, *rows = [line for line in text.splitlines() if line.endswith("|")]
    assert tuple(cell.strip() for cell in header.strip("|").split("|"))[1:] == columns
    for row in rows:
        request, _, *said = [cell.strip() for cell in row.strip("|").split("|")]
        *methods, path = request.strip("`").split()
        assert set(said) <= {"yes", "no"}
        for method in methods:
            yield from ((method, path, column, word == "yes") for column, word in zip(columns, said, strict=True))


ASSETS = {"/docs": "swagger-ui.css", "/redoc": "logo-mini.svg", "/page": "main.js"}


def url_of(path: str, lift: str) -> str:
    asset = ASSETS.get(path.partition("/{path")[0], "")
    named = path.replace("{lift}", lift).replace("{path:path}", asset).replace("{file}", SOUND.name)
    named = (
        named.replace("{session}", "s1").replace("{command}", "1").replace("{ride}", "r1").replace("{link:path}", "plc")
    )
    if path.endswith("/writes"):
        return f"{named}?step=press%20go_to%20L2"
    return f"{named}?lift_name={lift}" if "lift_" in path else named


def body_of(path: str, lift: str) -> Mapping[str, object]:
    found = {name: BODY[name] for name in KEYS_OF.get(path.rsplit("/", 1)[-1], ())}
    if path == "/api/v1/rides":
        return found | {"lift": lift}
    return found | {"to": "the operator"} if path.endswith("/hand-over") else found


def manager_of(role: Role | None, lift: str) -> FakeSite:
    """A manager with a session and a ride of this caller, on this lift."""
    site, name = FakeSite(), "anonymous" if role is None else f"the {role}"
    session = a_session(Holder("api", name), "s1", lift)
    site.there(session)
    site.commands["s1", "1"] = a_command(session, "1")
    site.fake_rides.going_on(a_ride(Holder("ride", name), "r1", lift))
    return site


def test_the_file_is_what_the_code_says() -> None:
    assert FILE.read_text("utf-8") == access_table(), "run `python -m lift_manager.web.access_page`"


def test_the_application_has_every_route_of_the_table_and_no_other() -> None:
    found = set()
    for route in iter_route_contexts(make_app(FakeSite()).router.routes):
        assert route.path is not None
        methods = route.methods or {"GET", "HEAD"}  # a mount of files
        path = route.path if route.methods else f"{route.path}/{{path:path}}"
        found |= {(method, path) for method in methods}
    assert found == {(method, route.path) for route in ROUTES for method in route.methods}


class Frames:
    """One link, on which nothing goes."""

    def link_names(self) -> tuple[str, ...]:
        return ("plc",)

    @contextmanager
    def tap_frames(self, link: str, hear: Callable[[WireFrame], None]) -> Iterator[None]:
        yield


def whole(site: FakeSite, keys: KeyRing | None = None) -> FastAPI:
    """The application with every part that it may have."""
    return app_of(site, keys, _whole, _made)


def _whole(site: Site, keys: Keys | None) -> FastAPI:
    return make_app(site, keys, frames=Frames(), metrics=nothing_measured, announcements={"enters": SOUND})


_made: Made = {}
EVERY_KEY = ring(*Role)


async def nothing_measured(accept: str) -> tuple[bytes, str]:
    return b"", accept or "text/plain"


async def status_of(app: FastAPI, request: httpx.Request, client: str = "127.0.0.1") -> int:
    """The status of an answer, hanging up as soon as it has begun: a stream of events would never end."""
    begun = asyncio.get_running_loop().create_future()
    body = [{"type": "http.request", "body": request.content, "more_body": False}]

    async def receive() -> Message:
        if body:
            return body.pop()
        await begun
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        if not begun.done():
            begun.set_result(message["status"])

    path, _, query = request.url.raw_path.partition(b"?")
    scope: Scope = {
        "type": "http",
        "http_version": "1.1",
        "method": request.method,
        "scheme": "http",
        "path": unquote(path.decode()),
        "raw_path": path,
        "root_path": "",
        "query_string": query,
        "headers": [(name.lower(), value) for name, value in request.headers.raw],
        "client": (client, 50000),
        "server": ("127.0.0.1", 5003),
    }
    async with asyncio.timeout(HANGS_S):
        await app(scope, receive, send)
    return int(begun.result())


def told(app: FastAPI, method: str, url: str, *, client: str = "127.0.0.1", **more: Any) -> int:
    return asyncio.run(status_of(app, httpx.Request(method, f"http://127.0.0.1:5003{url}", **more), client))


YES = {200, 201, 202, 307}


def rows(columns: tuple[str, ...]) -> list[tuple[str, str, dict[str, bool]]]:
    """Every row of one of the tables for one method: method, path, and what each column says."""
    found: dict[tuple[str, str], dict[str, bool]] = {}
    for method, path, column, may in cells(columns):
        found.setdefault((method, path), {})[column] = may
    return [(method, path, said) for (method, path), said in found.items()]


def changes_a_lift(method: str, path: str) -> bool:
    return method == "POST" and path not in OF_THE_CALLER


@each_row(("method", "path", "said"), rows(COLUMNS))
def test_with_keys_the_application_does_what_the_table_says(method: str, path: str, said: dict[str, bool]) -> None:
    for column, may in said.items():
        role, lifts = ASKERS[column]
        for lift in lifts:
            site = manager_of(role, lift)
            headers = {} if role is None else bearing(role)
            app = whole(site, EVERY_KEY)
            status = told(app, method, url_of(path, lift), headers=headers, json=body_of(path, lift))
            if may:
                assert status in YES, column
            else:
                assert status == (401 if role is None else 403), column
            assert bool(site.changes) is (may and changes_a_lift(method, path)), column


@each_row(("method", "path", "said"), rows(NO_KEYS))
def test_without_keys_the_application_does_what_the_table_says(method: str, path: str, said: dict[str, bool]) -> None:
    for column, may in said.items():
        site = manager_of(None, NAMED)
        client = "127.0.0.1" if column == "this computer" else "192.0.2.7"
        status = told(whole(site), method, url_of(path, NAMED), client=client, json=body_of(path, NAMED))
        assert (status in YES) is may, column
        assert may or status == 403, column
        assert bool(site.changes) is (may and changes_a_lift(method, path)), column


OF_A_LIFT = [(method, route) for route in ROUTES if route.lift_in is LiftIn.PATH for method in route.methods]


@each_row("lift", ["B-2_goods.1", "sessions", "rides", "capabilities", "signals", "rmf"])
def test_the_application_takes_the_route_and_the_lift_that_the_gate_looked_at(lift: str) -> None:
    for method, route in OF_A_LIFT:
        site = manager_of(None, lift)
        site.lifts = {lift: replace(IDLE, lift=lift)}
        assert told(whole(site), method, url_of(route.path, lift), json=body_of(route.path, lift)) in YES


def test_a_route_that_is_not_in_the_table_does_not_exist_with_any_key_or_none() -> None:
    reached = []
    for keys, headers in ((ring(), {}), (ring(*Role), bearing(Role.COMMISSIONER))):
        app = make_app(FakeSite(), keys)

        @app.post("/api/v1/forgotten")
        @app.delete("/api/v1/lifts/{lift}/lockout")
        async def forgotten() -> None:
            reached.append("forgotten")

        assert ask_app(app, "POST", "/api/v1/forgotten", headers=headers).status_code == 404
        wrong_method = ask_app(app, "DELETE", "/api/v1/lifts/lift/lockout", headers=headers)
        assert (wrong_method.status_code, wrong_method.headers["allow"]) == (405, "POST")
        assert "/api/v1/forgotten" not in ask_app(app, "GET", "/openapi.json").json()["paths"]
    assert reached == []


def test_a_route_in_the_table_is_reached() -> None:
    routes = [*ROUTES, Route(("GET",), "/api/v1/remembered", AccessLevel.READ)]
    app = make_app(FakeSite(), ring(Role.VIEWER), routes)

    @app.get("/api/v1/remembered")
    async def remembered() -> str:
        return "here"

    assert ask_app(app, "GET", "/api/v1/remembered").status_code == 401
    assert ask_app(app, "GET", "/api/v1/remembered", headers=bearing(Role.VIEWER)).json() == "here"
    assert key(Role.VIEWER) != key(Role.ROBOT)
