"""What a manager that is not active replies: where the active one is, and never a state."""

import asyncio

import httpx
import pytest
from starlette.responses import PlainTextResponse

from lift_manager.web.standby import Standby, WhileActive
from tests.support.rows import each_row

ADDRESS = "http://192.0.2.11:5003"


def get(app: object, path: str, method: str = "GET") -> httpx.Response:
    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(app=app)  # type: ignore[arg-type]  # any application
        async with httpx.AsyncClient(transport=transport, base_url="http://south") as client:
            return await client.request(method, path)

    return asyncio.run(send())


def standby(address: str = ADDRESS, trouble: str = "") -> Standby:
    return Standby(lambda: address, lambda: trouble)


@each_row(
    ("method", "path"),
    [
        ("GET", "/open-rmf/demo-lift/lift_state?lift_name=main"),
        ("POST", "/open-rmf/demo-lift/lift_request?lift_name=main"),
        ("GET", "/open-rmf/demo-lift/lift_names"),
    ],
)
def test_the_workshop_gets_no_success_and_the_address_of_the_active_one(method: str, path: str) -> None:
    reply = get(standby(), path, method)
    assert reply.status_code == 200
    assert reply.json() == {
        "data": {},
        "success": False,
        "msg": f"this manager is the standby; the active one is at {ADDRESS}",
    }


@each_row(("method", "path"), [("GET", "/api/v1/lifts"), ("POST", "/api/v1/rides"), ("DELETE", "/api/v1/rides/1")])
def test_the_api_gets_a_problem_with_the_address_of_the_active_one(method: str, path: str) -> None:
    reply = get(standby(), path, method)
    assert (reply.status_code, reply.headers["content-type"]) == (503, "application/problem+json")
    assert (reply.json()["code"], reply.headers["retry-after"]) == ("standby", "1")
    assert ADDRESS in reply.json()["detail"]


@each_row(
    ("address", "trouble", "expected"),
    [
        ("", "", "no other is active yet"),
        ("", "etcd does not answer", "cannot become so: etcd does not answer"),
        (ADDRESS, "etcd does not answer", "cannot become so: etcd does not answer"),
    ],
)
def test_what_is_not_known_is_not_told(address: str, trouble: str, expected: str) -> None:
    detail = get(standby(address, trouble), "/api/v1/lifts").json()["detail"]
    assert expected in detail
    assert ADDRESS not in detail


@each_row(
    ("path", "trouble", "status"),
    [
        ("/healthz", "etcd does not answer", 200),
        ("/readyz", "", 200),
        ("/readyz", "etcd does not answer", 503),
        ("/readyz?role=active", "", 503),
    ],
)
def test_readiness_tells_a_good_standby_from_the_active_one(path: str, trouble: str, status: int) -> None:
    assert get(standby(trouble=trouble), path).status_code == status


def test_after_its_term_a_manager_replies_as_a_standby_before_it_has_noticed() -> None:
    remaining_s = [1.0]

    class Served:
        async def __call__(self, scope, receive, send) -> None:  # type: ignore[no-untyped-def]
            await PlainTextResponse("a state")(scope, receive, send)

        def reply_at_once(self, scope, content) -> PlainTextResponse:  # type: ignore[no-untyped-def]
            return PlainTextResponse("a state at once")

    app = WhileActive(Served(), lambda: remaining_s[-1], standby(""))  # type: ignore[arg-type]
    scope = {"type": "http", "path": "/open-rmf/demo-lift/lift_state", "query_string": b"", "headers": []}
    assert get(app, "/open-rmf/demo-lift/lift_state").text == "a state"
    reply = app.reply_at_once(scope, b"")
    assert reply is not None
    assert reply.body == b"a state at once"
    remaining_s.append(0.0)
    assert get(app, "/open-rmf/demo-lift/lift_state").json()["success"] is False
    reply = app.reply_at_once(scope, b"")
    assert reply is not None
    assert b"a state" not in reply.body


@pytest.mark.parametrize("path", ["/", "/docs"])
def test_any_other_page_says_where_to_go(path: str) -> None:
    assert ADDRESS in get(standby(), path).json()["detail"]
