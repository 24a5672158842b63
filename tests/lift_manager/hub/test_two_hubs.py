"""Two hubs at once on the same NATS server, which runs by itself: they give the same answers, and a command through both begins nothing twice."""

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from lift_manager.api.keys import Key, KeyRing, digest_of, token
from lift_manager.api.roles import Role
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.signing import sign, signed_text
from lift_manager.lift.session import Holder
from tests.lift_manager.hub.rig import Journal, Rig, RunningHub, until
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_rides import a_ride

SECRET = "5" * 64
RING = KeyRing([(Key("00000002", "desk", Role.OPERATOR), digest_of(SECRET))])
OPEN = {"what": "open", "body": {"ttl_s": 60.0, "idempotency_key": "a"}}


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    rig = Rig(tmp_path / "hub")
    rig.use_separate_server()
    rig.add("berlin")
    return rig


async def opened(ticket_of: RunningHub, through: RunningHub) -> str:
    """Open a session through a hub, and return its id."""
    ticket, action = (await ticket_of.post("/sites/berlin/tickets")).json()["ticket"], json.dumps(OPEN)
    key_id, signature = sign(token("00000002", SECRET), signed_text("berlin", "goods", ticket, action))
    body = {"ticket": ticket, "key_id": key_id, "signature": signature, "action": action}
    reply = (await through.post("/sites/berlin/lifts/goods/commands", body)).json()
    return str(reply["session"]["id"])


def without_ages(found: Any) -> Any:
    """Without what differs from one moment to the next."""
    if isinstance(found, list):
        return [without_ages(each) for each in found]
    if isinstance(found, dict):
        passing = ("age_s", "news_age_s", "round_trip_s")
        return {name: without_ages(each) for name, each in found.items() if name not in passing}
    return found


def test_both_give_the_same_answers_and_a_command_through_both_begins_once(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        lifts = FakeSite()
        lifts.fake_rides.going_on(a_ride(Holder("ride", "amr-7")))
        with rig.nats_server():
            place = rig.second_place()
            async with rig.hub() as first, rig.hub(place=place) as second:
                with rig.leaf("berlin"):
                    async with rig.manager("berlin", lifts, journal, RING):
                        for hub in (first, second):
                            await hub.until_reached("berlin")
                            await hub.until_state("berlin", SiteState.ONLINE)
                        journal.write("a", "b", "c")
                        assert await first.until_row("berlin", "c") == await second.until_row("berlin", "c")

                        async def is_read() -> bool:
                            sites = [(await hub.get("/sites/berlin")).json() for hub in (first, second)]
                            return all(site["rows_behind"] == 0 for site in sites)

                        await until(is_read)
                        for path in ("/sites", "/sites/berlin", "/sites/berlin/lifts", "/sites/berlin/rides"):
                            one, other = [(await hub.get(path)).json() for hub in (first, second)]
                            assert without_ages(one) == without_ages(other), path

                        # a ticket is one of the site, whichever hub passed it on
                        found = {await opened(*pair) for pair in ((first, first), (second, second), (first, second))}
                        assert len(found) == 1
                        assert list(lifts.sessions) == [("goods", *found)]

    asyncio.run(main())


def test_a_site_that_is_switched_off_at_one_is_so_at_the_other_once_it_has_the_file(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        with rig.nats_server():
            place = rig.second_place()
            async with rig.hub() as first, rig.hub(place=place) as second:
                with rig.leaf("berlin"):
                    async with rig.manager("berlin", FakeSite(), journal):
                        for hub in (first, second):
                            await hub.until_reached("berlin")
                        await first.post("/sites/berlin/off", {"by": "M. Weber", "reason": "its key was copied"})

                        async def is_refused() -> bool:
                            return "Authorization Violation" in rig.log_of("berlin")

                        # the server is that of both
                        await until(is_refused)
                        assert (await second.get("/sites/berlin/lifts")).json()["code"] == "site_silent"
                        shutil.copy2(rig.place.registry_file, place.registry_file)
                        await second.until_state("berlin", SiteState.OFF)
                        off = [(await hub.get("/sites/berlin")).json()["off"]["reason"] for hub in (first, second)]
                        assert off == ["its key was copied"] * 2

    asyncio.run(main())
