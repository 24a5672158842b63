"""A session in a robot's hand: renewed, lost, closed."""

import asyncio
import json
from typing import Any

import httpx
import pytest

from lift_manager.api.events import SessionEvent
from lift_manager.api.sessions import Command, Over, Session
from lift_manager.client import Held, LiftManagerClient, Refused, SessionLost, open_at
from lift_manager.lift.commands import CommandState
from lift_manager.lift.session import Advice, EndReason
from tests.lift_manager.client.manager import AT, IDLE, LIFT, OPEN, URL, Manager, no, said
from tests.support.virtual_time import elapse, run_virtual

SESSION = Session.model_validate(
    {
        "id": "s/1",
        "lift": LIFT,
        "holder": "api:amr-7",
        "floor": None,
        "hold_door": False,
        "opened_at": AT,
        "lease_ends_in_s": 30.0,
        "ends_in_s": 3600.0,
        "hold_ends_in_s": None,
        "arrived": False,
        "door_held": False,
        "robot": "empty",
        "waiting_for": "",
        "restored": False,
        "over": None,
    }
)
OVER = Over(reason=EndReason.FIRE, text="there is a fire", advice=Advice.CLEAR_DOORWAY, at=AT)
PENDING = Command.model_validate(
    {
        "id": "c1",
        "lift": LIFT,
        "do": "go_to",
        "floor": "L2",
        "status": "pending",
        "reason": "",
        "proof": "none",
        "asked_at": AT,
        "ended_at": None,
    }
)
BASE = f"/api/v1/lifts/{LIFT}/sessions"
RENEW = ("POST", f"{BASE}/s/1/renew")


def a_manager() -> Manager:
    manager = Manager({LIFT: IDLE})

    def session(_: httpx.Request) -> httpx.Response:
        return said(200, SESSION.model_dump_json())

    manager.handlers |= {
        ("POST", BASE): session,
        RENEW: session,
        ("POST", f"{BASE}/s/1/close"): session,
        ("GET", f"{BASE}/s/1"): lambda _: said(200, SESSION.model_copy(update={"over": OVER}).model_dump_json()),
        ("POST", f"{BASE}/s/1/commands"): lambda _: said(202, PENDING.model_dump_json()),
    }
    return manager


def client_of(manager: Manager) -> LiftManagerClient:
    return LiftManagerClient(URL, transport=manager)


def now() -> float:
    return asyncio.get_running_loop().time()


def count(manager: Manager, end: str) -> int:
    return sum(asked.endswith(end) for asked in manager.asked)


def test_a_lease_is_renewed_in_time_and_the_session_is_closed_at_the_end() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client:
            async with client.session(LIFT, robot="amr-7", ttl_s=30.0) as lift:
                await elapse(300)
                await lift.go_to("L2")
            assert manager.asked[-1] == f"POST {BASE}/s/1/close"
        assert 28 <= count(manager, "/renew") <= 32
        assert manager.bodies[0]["robot"] == "amr-7"
        assert manager.bodies[0]["idempotency_key"]

    run_virtual(main)


@pytest.mark.parametrize("error", [LookupError, asyncio.CancelledError])
def test_whatever_ends_the_block_closes_the_session_and_comes_out_as_it_is(error: type[BaseException]) -> None:
    async def main() -> None:
        manager = a_manager()

        async def robot() -> None:
            async with client_of(manager) as client, client.session(LIFT):
                raise error

        with pytest.raises(error):
            await robot()
        assert count(manager, "/close") == 1

    run_virtual(main)


def test_a_lift_that_another_holds_is_not_entered() -> None:
    async def main() -> None:
        manager = a_manager()
        manager.handlers["POST", BASE] = lambda _: no(409, "held", "held by rmf:amr-8", holder="rmf:amr-8")
        async with client_of(manager) as client:
            with pytest.raises(Held) as caught:
                async with client.session(LIFT):
                    raise AssertionError("there is no session")
        assert caught.value.problem.holder == "rmf:amr-8"
        assert count(manager, "/close") == 0

    run_virtual(main)


def test_a_session_that_ends_is_lost_for_all_that_wait_and_ask_but_its_block_goes_on() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift:
            async with asyncio.TaskGroup() as tasks:
                waiting, losing = tasks.create_task(waits(lift)), tasks.create_task(lift.lost())
                await elapse(1)
                manager.handlers[RENEW] = lambda _: no(409, "session_over", "it is over")
                manager.publish(SessionEvent(lift=LIFT, what="ended", holder="api:amr-7"))
                told_at = now()
            assert now() - told_at < 0.5
            assert losing.result() is waiting.result()
            assert losing.result().over == OVER
            with pytest.raises(SessionLost, match="there is a fire"):
                await lift.go_to("L2")
            await elapse(10)

    async def waits(lift: Any) -> SessionLost:
        with pytest.raises(SessionLost) as caught:
            await lift.until(open_at("L2"))
        return caught.value

    run_virtual(main)


def test_a_session_that_ends_while_it_is_renewed_is_lost() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift:
            await elapse(1)
            over = SESSION.model_copy(update={"over": OVER})
            manager.handlers[RENEW] = lambda _: said(200, over.model_dump_json())
            async with asyncio.timeout(30):
                assert (await lift.lost()).over == OVER
            with pytest.raises(SessionLost, match="there is a fire"):
                await lift.go_to("L2")

    run_virtual(main)


@pytest.mark.parametrize("fails", ["up", "deaf"])
def test_a_lease_that_could_not_be_renewed_is_lost_when_it_ends_and_not_before(fails: str) -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift:
            await elapse(100)
            setattr(manager, fails, fails == "deaf")
            gone_at = now()
            lost = await lift.lost()
            assert 19.9 <= now() - gone_at <= 31.0
            assert lost.over is None
            assert "could not be renewed" in str(lost)
            setattr(manager, fails, fails == "up")

    run_virtual(main)


def test_a_short_silence_loses_nothing() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift:
            for _ in range(20):
                manager.up = False
                await elapse(15)
                manager.up = True
                await elapse(5)
            await lift.go_to("L2")

    run_virtual(main)


def test_a_manager_that_was_started_again_hears_the_holder_at_once() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT):
            await elapse(2)
            before = count(manager, "/renew")
            manager.restart()
            await elapse(2)
            assert count(manager, "/renew") > before

    run_virtual(main)


def test_a_command_is_waited_for_and_asked_for_only_once() -> None:
    async def main() -> None:
        manager = a_manager()
        done = PENDING.model_copy(update={"status": CommandState.CONFIRMED})
        answers = iter([PENDING, PENDING, done])

        def command(request: httpx.Request) -> httpx.Response:
            assert float(request.url.params["wait"]) <= 5.0
            return said(200, next(answers).model_dump_json())

        manager.handlers["GET", f"{BASE}/s/1/commands/c1"] = command
        async with client_of(manager) as client, client.session(LIFT) as lift:
            manager.loses = 1
            assert (await lift.go_to("L2", wait=30)).status == "confirmed"
            posts = [body for body in manager.bodies if body and body.get("do") == "go_to"]
            assert len({json.dumps(body) for body in posts}) == 1
            assert "wait" not in json.dumps(posts)
            assert (await lift.go_to("L2")).status == "pending"

    run_virtual(main)


def test_what_makes_no_sense_within_a_session_is_refused_and_loses_nothing() -> None:
    async def main() -> None:
        manager = a_manager()
        manager.handlers["POST", f"{BASE}/s/1/commands"] = lambda _: no(409, "not_now", "not now")
        async with client_of(manager) as client, client.session(LIFT) as lift:
            with pytest.raises(Refused, match="not now"):
                await lift.close_door()
            assert manager.bodies[-1]["clear"] is True
            manager.handlers["POST", f"{BASE}/s/1/commands"] = lambda _: said(202, PENDING.model_dump_json())
            await lift.hold_door()

    run_virtual(main)


def test_until_waits_for_the_door_at_the_floor() -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift, asyncio.TaskGroup() as tasks:
            waiting = tasks.create_task(lift.until(open_at("L2")))
            for floor, open_there in (("L1", OPEN), ("L2", IDLE), ("L2", OPEN)):
                await elapse(5)
                assert not waiting.done()
                manager.show(open_there.model_copy(update={"floor": floor}))
            assert (await waiting).floor == "L2"

    run_virtual(main)


@pytest.mark.parametrize(("left", "told"), [(True, {"robot": "left"}), (False, {})])
def test_the_end_says_that_the_robot_left_if_it_was_told_so(left: bool, told: Any) -> None:
    async def main() -> None:
        manager = a_manager()
        async with client_of(manager) as client, client.session(LIFT) as lift:
            await lift.close(left=left)
            with pytest.raises(SessionLost, match="was closed"):
                await lift.go_to("L2")
        assert count(manager, "/close") == 1
        assert manager.bodies[manager.asked.index(f"POST {BASE}/s/1/close")] == told

    run_virtual(main)


def test_the_event_of_its_own_end_calls_for_no_renewal() -> None:
    async def main() -> None:
        manager = a_manager()

        def close(_: httpx.Request) -> httpx.Response:
            ended = SessionEvent(lift=LIFT, what="ended", holder="api:amr-7", reason=EndReason.RELEASED)
            manager.publish(ended)
            return said(200, SESSION.model_dump_json())

        manager.handlers["POST", f"{BASE}/s/1/close"] = close
        async with client_of(manager) as client, client.session(LIFT) as lift:
            await elapse(1.0)
            before = count(manager, "/renew")
            manager.late_s = 1.0
            await lift.close()
            assert count(manager, "/renew") == before

    run_virtual(main)
