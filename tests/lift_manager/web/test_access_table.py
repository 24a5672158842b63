"""ACCESS.md is what the code says, and what the application does: every cell of it is asked."""

import asyncio
from collections.abc import Iterator, Mapping
from urllib.parse import quote

import httpx
import pytest
from fastapi.routing import iter_route_contexts

from lift_manager.domain.access import ROUTES, Need, Role, Route
from lift_manager.web.access_table import COLUMNS, FILE, NO_KEYS, access_table
from lift_manager.web.app import make_app
from tests.lift_manager.web.fake import FakeManager, ask, ask_app
from tests.lift_manager.web.keyed import NAMED, OTHER, bearing, key, ring

ASKERS: dict[str, tuple[Role | None, tuple[str, ...]]] = {
    "no key": (None, (NAMED, OTHER)),
    "viewer": (Role.VIEWER, (NAMED, OTHER)),
    "robot, its lift": (Role.ROBOT, (NAMED,)),
    "robot, another lift": (Role.ROBOT, (OTHER,)),
    "operator": (Role.OPERATOR, (NAMED, OTHER)),
    "commissioner": (Role.COMMISSIONER, (NAMED, OTHER)),
}
BODY = {"floor": "L2", "door_state": 0, "by": "M. Weber", "reason": "new ropes"}
KEYS_OF = {
    "lift_request": ("floor", "door_state"),
    "lockout": ("by", "reason"),
    "force-release": ("by", "reason"),
    "acknowledge": ("by",),
    "end": ("by",),
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


def url_of(path: str, lift: str) -> str:
    asset = "swagger-ui.css" if path.startswith("/docs") else "logo-mini.svg"
    named = path.replace("{lift:path}", quote(lift, safe="")).replace("{path:path}", asset)
    return f"{named}?lift_name={quote(lift)}" if "lift_" in path else named


def body_of(path: str) -> Mapping[str, object]:
    return {name: BODY[name] for name in KEYS_OF.get(path.rsplit("/", 1)[-1], ())}


def test_the_file_is_what_the_code_says() -> None:
    assert FILE.read_text("utf-8") == access_table(), "run `python -m lift_manager.web.access_table`"


def test_the_application_has_every_route_of_the_table_and_no_other() -> None:
    found = set()
    for route in iter_route_contexts(make_app(FakeManager()).router.routes):
        assert route.path is not None
        methods = route.methods or {"GET", "HEAD"}  # a mount of files
        path = route.path if route.methods else f"{route.path}/{{path:path}}"
        found |= {(method, path) for method in methods}
    assert found == {(method, route.path) for route in ROUTES for method in route.methods}


@pytest.mark.parametrize(("method", "path", "column", "may"), list(cells(COLUMNS)))
def test_with_keys_the_application_does_what_the_table_says(method: str, path: str, column: str, may: bool) -> None:
    role, lifts = ASKERS[column]
    for lift in lifts:
        facade = FakeManager()
        headers = {} if role is None else bearing(role)
        answer = ask(facade, method, url_of(path, lift), keys=ring(*Role), headers=headers, json=body_of(path))
        if may:
            assert answer.status_code in {200, 307}, answer.text
        else:
            assert answer.status_code == (401 if role is None else 403), answer.text
        assert bool(facade.asked or facade.said) is (may and method == "POST")


@pytest.mark.parametrize(("method", "path", "column", "may"), list(cells(NO_KEYS)))
def test_without_keys_the_application_does_what_the_table_says(method: str, path: str, column: str, may: bool) -> None:
    facade = FakeManager()
    client = "127.0.0.1" if column == "this computer" else "192.0.2.7"

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(make_app(facade), client=(client, 50000))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:5003") as http:
            return await http.request(method, url_of(path, NAMED), json=body_of(path))

    answer = asyncio.run(once())
    assert (answer.status_code in {200, 307}) is may, answer.text
    assert may or answer.status_code == 403
    assert bool(facade.asked or facade.said) is (may and method == "POST")


def test_a_route_that_is_not_in_the_table_does_not_exist_with_any_key_or_none() -> None:
    reached = []
    for keys, headers in ((ring(), {}), (ring(*Role), bearing(Role.COMMISSIONER))):
        app = make_app(FakeManager(), keys)

        @app.post("/api/v1/forgotten")
        @app.delete("/api/v1/lifts/{lift:path}/lockout")
        async def forgotten() -> None:
            reached.append("forgotten")

        assert ask_app(app, "POST", "/api/v1/forgotten", headers=headers).status_code == 404
        wrong_method = ask_app(app, "DELETE", "/api/v1/lifts/lift/lockout", headers=headers)
        assert (wrong_method.status_code, wrong_method.headers["allow"]) == (405, "POST")
        assert "/api/v1/forgotten" not in ask_app(app, "GET", "/openapi.json").json()["paths"]
    assert reached == []


def test_a_route_in_the_table_is_reached() -> None:
    routes = [*ROUTES, Route(("GET",), "/api/v1/remembered", Need.READ)]
    app = make_app(FakeManager(), ring(Role.VIEWER), routes)

    @app.get("/api/v1/remembered")
    async def remembered() -> str:
        return "here"

    assert ask_app(app, "GET", "/api/v1/remembered").status_code == 401
    assert ask_app(app, "GET", "/api/v1/remembered", headers=bearing(Role.VIEWER)).json() == "here"
    assert key(Role.VIEWER) != key(Role.ROBOT)
