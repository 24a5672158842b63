"""The API of a hub: who may send what, and what a caller learns when a site does not reply."""

import asyncio
import json
import re
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from nats.aio.msg import Msg

from lift_manager.api.keys import Key, KeyRing, digest_of, token
from lift_manager.api.lifts import Lift
from lift_manager.api.roles import AccessLevel, LiftIn, Role, refusal
from lift_manager.hub import web
from lift_manager.hub.api import ROUTES
from lift_manager.hub.feed import HubFeed
from lift_manager.hub.messages import RemoteLift
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.service import Hub
from lift_manager.hub.web import make_hub_app
from lift_manager.lift.state import Quality
from lift_manager.web.error_codes import HUB_CODES
from lift_manager.web.events.readers import OpenStreams
from tests.lift_manager.hub.rig import Rig, RunningHub, until
from tests.lift_manager.web.fake import FakeSite, ask_app
from tests.lift_manager.web.fake_lifts import IDLE
from tests.support.journal import Journal

SECRET = "7" * 64
KEYS = {role: Key(f"{number:08x}", f"the {role}", role) for number, role in enumerate(Role)}
KEYS[Role.ROBOT] = Key("00000001", "the robot", Role.ROBOT, ("berlin/goods",))
RING = KeyRing((key, digest_of(SECRET)) for key in KEYS.values())
SIGNED = {"ticket": "t", "key_id": "0" * 8, "signature": "A" * 43}
BODIES = {
    "off": {"by": "M. Weber", "reason": "none"},
    "on": {"by": "M. Weber"},
    "commands": {**SIGNED, "action": "{}"},
    "rides": {**SIGNED, "action": json.dumps({"what": "ride", "body": {"lift": "goods", "from": "L1", "to": "L2"}})},
    "cancel": {**SIGNED, "action": json.dumps({"what": "cancel_ride", "ride": "r1"})},
}


def statuses(rig: Rig, lift: str) -> dict[tuple[str, str, Role | None], int]:
    """The status of every request, without a key and with each, on a hub that runs no NATS server."""

    async def main() -> dict[tuple[str, str, Role | None], int]:
        app = make_hub_app(Hub(rig.place), RING)
        transport = httpx.ASGITransport(app, client=("127.0.0.1", 1))
        found = {}
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            for route in ROUTES:
                if route.path == "/api/v1/events" or ":path" in route.path:
                    continue  # a stream has no end; the files of /docs are those of every manager
                path = route.path.replace("{site}", "berlin").replace("{lift}", lift).replace("{ride}", "r1")
                for role in (None, *Role):
                    headers = {}
                    if role is not None:
                        headers["Authorization"] = f"Bearer {token(KEYS[role].id, SECRET).reveal()}"
                    body = BODIES.get(path.rpartition("/")[2]) if route.methods == ("POST",) else None
                    reply = await client.request(route.methods[0], path, headers=headers, json=body)
                    found[route.methods[0], route.path, role] = reply.status_code
        return found

    return asyncio.run(main())


@pytest.mark.parametrize("lift", ["goods", "other"])
def test_every_role_may_send_what_the_table_says_and_no_more(rig: Rig, lift: str) -> None:
    found = statuses(rig, lift)
    for route in ROUTES:
        for role in (None, *Role):
            status = found.get((route.methods[0], route.path, role))
            if status is None:
                continue
            if role is None:
                allowed = route.need is AccessLevel.NOTHING
                assert (status == 401) is not allowed, route
                continue
            named = (f"berlin/{lift}",) if route.lift_in is LiftIn.PATH else KEYS[role].lifts
            allowed = not refusal(role, KEYS[role].lifts, route.need, named if route.lift_in else ())
            assert (status != 403) is allowed, (route, role, status)


def test_the_key_of_a_robot_reaches_only_the_lifts_that_it_names(rig: Rig) -> None:
    rig.add("rome")
    ride = {"from": "L1", "to": "L2"}
    requests: dict[str, list[object]] = {
        "berlin/rides": [{"what": "ride", "body": {**ride, "lift": lift}} for lift in ("other", "any")],
        "rome/rides/r1/cancel": [{"what": "cancel_ride", "ride": "r1"}],
        "rome/tickets": [None],
    }

    async def main() -> None:
        async with rig.hub(RING) as hub:
            key = {"Authorization": f"Bearer {token(KEYS[Role.ROBOT].id, SECRET).reveal()}"}
            for path, actions in requests.items():
                for action in actions:
                    refused = await hub.post(f"/sites/{path}", {**SIGNED, "action": json.dumps(action)}, **key)
                    assert (refused.status_code, refused.json()["code"]) == (403, "not_allowed"), refused.text

    asyncio.run(main())


def test_a_hub_without_keys_lets_only_its_own_computer_switch_sites_off(rig: Rig) -> None:
    async def main() -> None:
        app = make_hub_app(Hub(rig.place), KeyRing())
        for client, status in (("127.0.0.1", 200), ("192.0.2.9", 403)):
            transport = httpx.ASGITransport(app, client=(client, 1))
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as here:
                path = "off" if client == "127.0.0.1" else "on"
                reply = await here.post(f"/api/v1/sites/berlin/{path}", json=BODIES[path])
                assert reply.status_code == status, reply.text
                page = await here.post("/api/v1/sites/berlin/on", json=BODIES["on"], headers={"Origin": "http://a.b"})
                assert (page.status_code, page.json()["code"]) == (403, "another_site")

    asyncio.run(main())


def test_a_site_is_unknown_until_the_hub_reaches_its_nats_server_and_off_once_it_is_switched_off(rig: Rig) -> None:
    rig.add("rome")
    rig.place.switch_off("rome", "M. Weber", "its key was copied")
    app = make_hub_app(Hub(rig.place), KeyRing())
    sites = ask_app(app, "GET", "/api/v1/sites").json()["sites"]
    assert {site["id"]: site["state"] for site in sites} == {"berlin": "unknown", "rome": "off"}
    reasons = {site: ask_app(app, "GET", f"/api/v1/sites/{site}/lifts").json()["detail"] for site in ("berlin", "rome")}
    assert "has not reached its NATS server yet" in reasons["berlin"]
    assert "is switched off" in reasons["rome"]


def test_every_code_of_a_hub_is_raised_somewhere_in_it() -> None:
    folder = Path(web.__file__).parent
    text = "".join(file.read_text("utf-8") for file in folder.glob("*.py"))
    assert {code for code in HUB_CODES if f'"{code}"' not in text} == set()


def test_the_document_of_the_api_names_every_route(rig: Rig) -> None:
    app = make_hub_app(Hub(rig.place), KeyRing())
    paths = app.openapi()["paths"]
    assert {route.path for route in ROUTES if route.path.startswith("/api/")} == {
        path for path in paths if path.startswith("/api/")
    }
    assert re.search("guid", str(paths["/api/v1/sites/{site}/lifts"])) is None


def test_a_lift_that_was_too_long_under_way_is_offline() -> None:
    lift = RemoteLift.of(Lift.of(IDLE, max_age_s=1.0))
    age_s = lift.age_s or 0.0
    assert lift.after(0.9 - age_s) is lift
    late = lift.after(1.1 - age_s)
    assert (late.quality, late.floor, late.doors, late.age_s) == (Quality.OFFLINE, None, {}, lift.age_s)


def test_the_reply_to_a_command_that_is_lost_leaves_it_unconfirmed(rig: Rig) -> None:
    async def main() -> None:
        received = []

        async def swallow(message: Msg) -> None:
            received.append(message.data)

        async with rig.hub() as hub:
            missing = await hub.post("/sites/berlin/lifts/goods/commands", BODIES["commands"])
            assert (missing.status_code, missing.json()["code"]) == (503, "site_silent")
            with rig.leaf("berlin"):
                async with rig.client("berlin") as client:
                    await client.subscribe("site.berlin.request.command", cb=swallow)

                    async def unconfirmed() -> bool:
                        reply = await hub.post("/sites/berlin/lifts/goods/commands", BODIES["commands"])
                        return (reply.status_code, reply.json()["code"]) == (504, "unconfirmed")

                    await until(unconfirmed)
                    assert len(received) == 1

    asyncio.run(main())


def test_commands_need_that_the_site_opts_in(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                await hub.until_reached("berlin")
                refused = await hub.post("/sites/berlin/tickets")
                assert (refused.status_code, refused.json()["code"]) == (409, "monitor_only")
                sent = await hub.post("/sites/berlin/lifts/goods/commands", BODIES["commands"])
                assert sent.json()["code"] == "monitor_only"
                await hub.until_state("berlin", SiteState.ONLINE)
                assert (await hub.get("/sites/berlin")).json()["commands"] is False

    asyncio.run(main())


def test_a_reader_that_reconnects_gets_what_it_has_missed_and_then_what_comes(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                journal.write("a", "b")
                await hub.until_row("berlin", "b")
                numbers = [event.number for event in hub.stored("berlin") if event.name == "row"]
                feed = HubFeed(hub.hub, OpenStreams(4))
                with (
                    feed.reader("berlin", event_id(hub, numbers[0]), lambda: True) as reader,
                    feed.reader(None, None, lambda: True) as new,
                ):
                    assert texts(await reader.next()) == ["b"]
                    journal.write("c")
                    await hub.until_row("berlin", "c")
                    assert texts(await reader.next()) == ["c"]
                    assert texts(await new.next()) == ["c"]

    asyncio.run(main())


def event_id(hub: RunningHub, number: int) -> str:
    with closing(hub.hub.open_rows()) as rows:
        return f"{rows.id}-{number}"


def texts(chunk: bytes | None) -> list[str]:
    """The texts of rows in a piece of an event stream."""
    assert chunk is not None
    return re.findall(r'"event":"row".*?"text":"(.*?)"', chunk.decode())
