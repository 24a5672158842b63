"""What is sent, how often, and what becomes of each kind of answer."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import httpx
import pytest

from lift_manager.api.keys import Secret
from lift_manager.api.rides import RideRequest
from lift_manager.client import (
    ClientError,
    Held,
    LiftManagerClient,
    NotAllowed,
    NotAManager,
    NotFound,
    Refused,
    Stale,
    Unreachable,
)
from lift_manager.lift.state import Quality
from lift_manager.rides.ride import Phase, RideWord
from register_maps.words import Mode
from tests.lift_manager.client.manager import IDLE, LIFT, QUEUED, URL, Manager, no, said
from tests.support.rows import each_row
from tests.support.virtual_time import run_virtual

Ask = Callable[[LiftManagerClient], Awaitable[Any]]
RIDE = RideRequest.model_validate({"lift": "any", "from": "L1", "to": "L2", "robot": "amr-7"})


def ask(manager: Manager, what: Ask, key: str | None = None) -> Any:
    async def main() -> Any:
        async with LiftManagerClient(URL, key, transport=manager) as client:
            return await what(client)

    return run_virtual(main)


@each_row("name", ["east wing", "a/b", "a/b/sessions", "..", ".", "Güter 1", "100%", "a?b#c", "50%2F", "\\"])
def test_a_lift_of_any_name_is_asked_for_by_that_name(name: str) -> None:
    manager = Manager({name: IDLE.model_copy(update={"name": name})})
    manager.handlers["GET", f"/api/v1/lifts/{name}"] = lambda _: said(200, manager.lifts[name].model_dump_json())
    assert ask(manager, lambda client: client.lift(name)).name == name
    assert manager.asked == [f"GET /api/v1/lifts/{name}"]


REPEATED: list[Ask] = [
    lambda client: client.lifts(),
    lambda client: client.lift(LIFT),
    lambda client: client.begin_ride(RIDE),
    lambda client: client.cancel_ride("r1"),
    lambda client: client.ride_word("r1", RideWord.LEFT),
]
ONCE: list[Ask] = [
    lambda client: client.ride_word("r1", RideWord.ENTERED),
    lambda client: client.acknowledge(LIFT, "M. Weber"),
    lambda client: client.lock_out(LIFT, "M. Weber", "ropes"),
    lambda client: client.force_release(LIFT, "M. Weber", "gone"),
    lambda client: client.renew_session(LIFT, "s1"),
    lambda client: client.hand_over_session(LIFT, "s1", "amr-8"),
]


@each_row("what", REPEATED)
def test_what_reads_or_lets_go_or_has_a_key_of_its_own_is_sent_again_once(what: Ask) -> None:
    manager = Manager(ride=QUEUED.model_copy(update={"phase": Phase.BOARDING}), loses=1)
    ask(manager, what)
    assert [asked for asked in manager.asked if asked == manager.asked[0]] == manager.asked[:2]
    assert manager.asked[0] == manager.asked[1]
    assert manager.bodies[0] == manager.bodies[1]
    manager = Manager(ride=QUEUED, loses=2)
    with pytest.raises(Unreachable) as caught:
        ask(manager, what)
    assert caught.value.may_have_arrived


@each_row("what", ONCE)
def test_nothing_else_is_ever_sent_twice(what: Ask) -> None:
    manager = Manager(ride=QUEUED, loses=1)
    with pytest.raises(Unreachable) as caught:
        ask(manager, what)
    assert caught.value.may_have_arrived
    assert len(manager.asked) == 1


def test_each_ride_has_a_key_of_its_own() -> None:
    manager = Manager()

    async def twice(client: LiftManagerClient) -> None:
        await client.begin_ride(RIDE)
        await client.begin_ride(RIDE)

    ask(manager, twice)
    first, second = (body["idempotency_key"] for body in manager.bodies)
    assert first != second
    assert manager.bodies[0]["from"] == "L1"


def test_a_manager_that_refuses_connections_was_not_told_anything() -> None:
    with pytest.raises(Unreachable, match="no manager answers at http://lifts") as caught:
        ask(Manager(up=False), lambda client: client.lifts())
    assert not caught.value.may_have_arrived
    assert isinstance(caught.value.__cause__, httpx.ConnectError)


def test_a_manager_that_hangs_is_given_up_after_the_time_for_each_try() -> None:
    async def main() -> float:
        async with LiftManagerClient(URL, within_s=2.0, transport=Manager(deaf=True)) as client:
            with pytest.raises(Unreachable, match="no reply within 2 s") as caught:
                await client.lifts()
        assert caught.value.may_have_arrived
        return asyncio.get_running_loop().time()

    assert run_virtual(main) == pytest.approx(4.2)


@each_row(
    ("status", "code", "kind"),
    [
        (409, "held", Held),
        (409, "queued", Held),
        (409, "offline", Stale),
        (404, "unknown_lift", NotFound),
        (404, "no_such_session", NotFound),
        (401, "key_needed", NotAllowed),
        (403, "not_allowed", NotAllowed),
        (409, "mode", Refused),
        (422, "malformed", Refused),
        (503, "stopping", Refused),
    ],
)
def test_a_refusal_is_of_the_kind_that_a_program_branches_on(status: int, code: str, kind: type[Refused]) -> None:
    manager = Manager()
    manager.handlers["GET", "/api/v1/lifts"] = lambda _: no(status, code, "the reason in words")
    with pytest.raises(Refused, match="the reason in words") as caught:
        ask(manager, lambda client: client.lifts())
    assert type(caught.value) is kind
    assert (caught.value.status, caught.value.code) == (status, code)
    assert len(manager.asked) == 1


def test_a_refusal_has_what_stands_in_the_way_as_values_and_takes_what_it_does_not_know() -> None:
    manager = Manager()
    body = {"type": "x", "title": "t", "status": 409, "detail": "d", "code": "mode", "mode": "fire", "since_s": 3.5}
    manager.handlers["GET", "/api/v1/lifts"] = lambda _: said(409, body | {"weather": "rain"})
    with pytest.raises(Refused) as caught:
        ask(manager, lambda client: client.lifts())
    assert (caught.value.problem.mode, caught.value.problem.since_s) == (Mode.FIRE, 3.5)
    manager.handlers["GET", "/api/v1/lifts"] = lambda _: said(409, body | {"mode": "holiday"})
    with pytest.raises(Refused) as caught:
        ask(manager, lambda client: client.lifts())
    assert (caught.value.problem.mode, caught.value.code) == (None, "mode")


@each_row("status", [200, 302, 404, 500])
@each_row(
    "body", ["<html>", "", "[]", '"text"', "{}", "\ud83d".encode("utf-8", "surrogatepass").decode("latin-1"), "9" * 99]
)
def test_an_answer_of_another_program_is_not_taken_for_one(status: int, body: str) -> None:
    manager = Manager()
    manager.handlers["GET", "/api/v1/lifts/lift"] = lambda _: said(status, body)
    manager.handlers["POST", "/api/v1/lifts/lift/acknowledge"] = lambda _: said(status, body)
    for what in (lambda client: client.lift(LIFT), lambda client: client.acknowledge(LIFT, "A. Beck")):
        with pytest.raises(NotAManager, match=rf"is not a lift manager \(HTTP {status}\)"):
            ask(manager, what)


def test_an_answer_with_more_in_it_than_this_client_knows_is_taken() -> None:
    manager = Manager()
    told = {"lift": LIFT, "by": "A. Beck", "at": "2026-03-01T20:15:00Z", "acknowledged": ["fire"], "thanks": True}
    manager.handlers["POST", "/api/v1/lifts/lift/acknowledge"] = lambda _: said(200, told)
    assert ask(manager, lambda client: client.acknowledge(LIFT, "A. Beck")).by == "A. Beck"


def test_an_answer_without_end_is_given_up() -> None:
    class Endless(httpx.AsyncByteStream):
        async def __aiter__(self) -> Any:
            while True:
                yield b" " * 1_000_000

    manager = Manager()
    manager.handlers["GET", "/api/v1/lifts"] = lambda _: httpx.Response(200, stream=Endless())
    with pytest.raises(NotAManager, match="has no end"):
        ask(manager, lambda client: client.lifts())


def test_a_lift_that_has_not_changed_is_not_sent_again_and_gets_its_new_age() -> None:
    manager = Manager()

    def lift(request: httpx.Request) -> httpx.Response:
        tag = 'W/"1"'
        if request.headers.get("if-none-match") == tag:
            return httpx.Response(304, headers={"etag": tag, "lift-age-s": "0.450"})
        return said(200, IDLE.model_dump_json(), etag=tag)

    manager.handlers["GET", "/api/v1/lifts/lift"] = lift

    async def twice(client: LiftManagerClient) -> tuple[Any, Any]:
        return await client.lift(LIFT), await client.lift(LIFT)

    first, second = ask(manager, twice)
    assert (first.age_s, second.age_s) == (0.1, 0.45)
    assert second.model_copy(update={"age_s": 0.1}) == first


def test_a_lift_without_an_age_is_no_live_one_for_long() -> None:
    manager = Manager()
    answers = iter([said(200, IDLE.model_dump_json(), etag='"1"'), httpx.Response(304)])
    manager.handlers["GET", "/api/v1/lifts/lift"] = lambda _: next(answers)

    async def look(client: LiftManagerClient) -> Quality:
        await client.lift(LIFT)
        (known,) = await client.known_lifts(LIFT, within_s=1.0)
        return known.at(asyncio.get_running_loop().time()).quality

    assert ask(manager, look) is Quality.OFFLINE


def test_the_key_is_sent_in_its_header_and_shown_nowhere() -> None:
    key = f"lm_{'0' * 8}_{'1' * 64}"
    manager = Manager(handlers={("GET", "/api/v1/lifts"): lambda _: no(401, "bad_key")})
    for given in (key, Secret(key)):
        with pytest.raises(NotAllowed) as caught:
            ask(manager, lambda client: client.lifts(), given)  # type: ignore[arg-type]
        assert manager.headers[-1]["authorization"] == f"Bearer {key}"
        assert key not in repr(caught.value) + str(manager.asked)


def test_a_manager_that_is_not_ready_says_why() -> None:
    told = {"ready": False, "journal": "not written", "state": "written", "lifts": 3, "live": 2}
    manager = Manager(handlers={("GET", "/readyz"): lambda _: said(503, told)})
    ready = ask(manager, lambda client: client.readiness())
    assert (ready.ready, ready.journal, ready.live) == (False, "not written", 2)


@each_row("url", ["lifts:5003", "ftp://lifts", "", "http://", "http://[::1"])
def test_what_is_no_address_is_told_as_a_manager_that_does_not_answer(url: str) -> None:
    async def main() -> None:
        async with LiftManagerClient(url) as client:
            await client.lifts()

    with pytest.raises(ClientError) as caught:
        asyncio.run(main())
    assert isinstance(caught.value, Unreachable)
    assert not caught.value.may_have_arrived
