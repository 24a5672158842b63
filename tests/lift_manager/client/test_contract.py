"""The same tests for HTTP by hand and for the typed client, against a running manager of a simulated lift."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager

import pytest

from lift_manager.lab.bench import LiftSite
from tests.lift_manager.client.speakers import Said, Speaker, by_hand, typed

LIFT = "lift"
Speaks = Callable[[str], AbstractAsyncContextManager[Speaker]]
Works = Callable[[Speaker], Awaitable[None]]

pytestmark = pytest.mark.lift(LIFT, speed=20)


@pytest.fixture(params=[by_hand, typed])
def speak(request: pytest.FixtureRequest, lift_site: LiftSite) -> Callable[[Works], None]:
    speaks: Speaks = request.param

    def run(work: Works) -> None:
        async def main() -> None:
            async with asyncio.timeout(40), speaks(lift_site.address) as speaker:
                await work(speaker)

        asyncio.run(main())

    return run


Speak = Callable[[Works], None]


@asynccontextmanager
async def session(speaker: Speaker, robot: str = "amr-7") -> AsyncIterator[Said]:
    opened = await speaker.open(LIFT, robot, f"key of {robot}".replace(" ", "-"))
    yield opened
    await speaker.close(LIFT, opened["id"])


async def until(look: Callable[[], Awaitable[Said]], wanted: Callable[[Said], bool]) -> Said:
    async with asyncio.timeout(20):
        while not wanted(found := await look()):  # noqa: ASYNC110  by hand there is nothing to wait for
            await asyncio.sleep(0.02)
    return found


def test_the_lifts_are_told_with_age_doors_and_what_they_can_do(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        (lift,) = (await speaker.lifts())["lifts"]
        assert (lift["name"], lift["floors"]) == (LIFT, ["L1", "L2", "L3", "L4"])
        one = await speaker.lift(LIFT)
        assert (one["quality"], one["floor"], one["robot_door"]) == ("live", "L1", "closed")
        assert 0.0 <= one["age_s"] <= one["max_age_s"]
        assert one.keys() == lift.keys()
        able = await speaker.capabilities(LIFT)
        assert (able["access"], "go_to" in able["commands"]) == ("control", True)
        signals = await speaker.signals(LIFT)
        assert {signal["name"] for signal in signals["signals"]} <= set(able["signals"])
        assert all(signal["addresses"] for signal in signals["signals"])

    speak(work)


def test_what_there_is_not_is_refused_by_name(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        for no in (await speaker.lift("attic"), await speaker.capabilities("a"), await speaker.open("a", "r", "k")):
            assert (no["status"], no["code"]) == (404, "unknown_lift")
        assert (await speaker.session(LIFT, "none"))["code"] == "no_such_session"
        assert (await speaker.ride("none"))["code"] == "unknown_ride"
        async with session(speaker) as held:
            no = await speaker.command(LIFT, held["id"], {"do": "go_to", "floor": "L9"}, 0.0)
            assert (no["status"], no["code"]) == (422, "unknown_floor") or no["code"] == "unknown_floor"
            assert (await speaker.followed(LIFT, held["id"], "none", 0.0))["code"] == "no_such_command"

    speak(work)


def test_one_key_opens_one_session_and_others_are_told_who_holds_the_lift(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        async with session(speaker) as held:
            again = await speaker.open(LIFT, "amr-7", "key-of-amr-7")
            assert again["id"] == held["id"]
            no = await speaker.open(LIFT, "amr-8", "key-of-amr-8")
            assert (no["status"], no["code"], no["holder"]) == (409, "held", "api:amr-7")
            assert (await speaker.lift(LIFT))["session"]["name"] == "amr-7"
            renewed = await speaker.renew(LIFT, held["id"], 40.0)
            assert 0 < renewed["lease_ends_in_s"] <= 40.0
        over = await speaker.session(LIFT, held["id"])
        assert over["over"]["reason"] == "released"
        assert (await speaker.renew(LIFT, held["id"], 40.0))["code"] == "session_over"

    speak(work)


def test_a_command_is_followed_to_its_end_and_the_door_opens(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        async with session(speaker) as held:
            wish = {"do": "go_to", "floor": "L2", "idempotency_key": "k1"}
            command = await speaker.command(LIFT, held["id"], wish, 10.0)
            assert (command["status"], command["floor"]) == ("confirmed", "L2")
            assert (await speaker.command(LIFT, held["id"], wish, 0.0))["id"] == command["id"]
            assert (await speaker.followed(LIFT, held["id"], command["id"], 0.0))["status"] == "confirmed"
            there = await until(lambda: speaker.lift(LIFT), lambda lift: lift["robot_door"] == "open")
            assert (there["floor"], there["standing"]) == ("L2", True)

    speak(work)


def test_a_session_is_handed_over_and_taken_by_a_person(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        async with session(speaker) as held:
            given = await speaker.hand_over(LIFT, held["id"], "amr-8")
            assert (given["holder"], given["id"] != held["id"]) == ("api:amr-8", True)
            released = await speaker.person(LIFT, "session/force-release", "M. Weber", "carried away")
            assert (released["holder"], released["reason"]) == ("api:amr-8", "carried away")
            assert (await speaker.person(LIFT, "session/force-release", "M. Weber", "again"))["code"] == "not_held"

    speak(work)


def test_people_keep_robots_off(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        assert (await speaker.person(LIFT, "acknowledge", "M. Weber"))["code"] == "nothing_to_acknowledge"
        assert (await speaker.person(LIFT, "lockout", "M. Weber", "new ropes"))["by"] == "M. Weber"
        no = await speaker.open(LIFT, "amr-7", "k")
        assert (no["status"], no["code"]) == (409, "locked_out")
        assert "new ropes" in (await speaker.lift(LIFT))["restrictions"]["lockout"]
        assert (await speaker.person(LIFT, "lockout/end", "A. Beck"))["lockout"]["reason"] == "new ropes"

    speak(work)


def test_events_begin_with_how_things_are(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        event = await speaker.first_event(LIFT)
        assert (event["event"], [lift["name"] for lift in event["lifts"]]) == ("snapshot", [LIFT])
        assert event["lost"] is False

    speak(work)


WISH = {"lift": "any", "from": "L2", "to": "L3", "robot": "amr-7", "idempotency_key": "k1"}


def test_a_ride_is_planned_begun_danced_and_done(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        assert await speaker.plan(WISH) == {"lift": LIFT, "ahead": 0, "reason": ""}
        ride = await speaker.begin(WISH)
        assert (ride["lift"], ride["from"], ride["to"]) == (LIFT, "L2", "L3")
        assert (await speaker.begin(WISH))["id"] == ride["id"]
        told = await speaker.word(ride["id"], "left")
        assert (told["status"], told["code"]) == (409, "not_now")
        for guidance, word in (("enter", "entered"), ("leave", "left")):
            await until(lambda: speaker.ride(ride["id"]), lambda ride: ride["guidance"] == guidance)  # noqa: B023
            assert (await speaker.word(ride["id"], word))["id"] == ride["id"]
        assert (await speaker.ride(ride["id"]))["phase"] == "done"
        assert (await speaker.word(ride["id"], "here"))["code"] == "not_now"

    speak(work)


def test_a_ride_is_cancelled_before_it_begins_twice_is_once(speak: Speak) -> None:
    async def work(speaker: Speaker) -> None:
        ride = await speaker.begin(WISH)
        for _ in range(2):
            assert (await speaker.cancel(ride["id"], "withdrawn"))["phase"] == "cancelled"
        assert "withdrawn" in (await speaker.ride(ride["id"]))["reason"]

    speak(work)
