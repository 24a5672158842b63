"""A hostile site, with all that its own leaf node and key allow, can neither be another site nor hold up the hub; nor can a hub hold up a site."""

import asyncio
import contextlib
import json

import pytest
from nats.aio.msg import Msg
from nats.errors import Error

from lift_manager.hub.messages import News, Position
from lift_manager.hub.remote_site import MOST_NEWS, SiteState
from lift_manager.hub.site_face import MOST_REQUESTS
from lift_manager.lift.state import LiftState
from tests.lift_manager.hub.rig import Rig, until
from tests.lift_manager.web.fake import FakeSite
from tests.support.journal import Journal
from tests.support.programs import HANGS_S

COMMAND = {"ticket": "t", "key_id": "0" * 8, "signature": "A" * 43, "action": "{}"}
FORGED = News(name="forged", version="1", lifts=0, live=0, commands=False, newest=Position(stream="x", at=10**6))


@pytest.fixture
def rig(rig: Rig) -> Rig:
    rig.add("evil")
    return rig


def test_it_can_neither_publish_nor_reply_for_another_site_nor_listen_to_it(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        received: list[str] = []

        async def reply(message: Msg) -> None:
            received.append(message.subject)
            if message.reply:
                await message.respond(b'{"lifts":[]}')

        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"), rig.leaf("evil"):
                async with rig.client("evil") as evil:
                    for subject in ("site.berlin.>", "site.*.request.>", "_INBOX.>", "$SYS.>"):
                        await evil.subscribe(subject, cb=reply)
                    await hub.until_reached("berlin")
                    await hub.until_state("berlin", SiteState.ONLINE)
                    # what it sends about itself arrives, so what it sends about others has had its chance
                    await hub.until_reached("evil")
                    for _ in range(20):
                        await evil.publish("site.berlin.news", FORGED.model_dump_json().encode())
                        await evil.publish("site.berlin.rows", b"{}", reply="site.berlin.news")
                    await evil.publish("site.evil.news", FORGED.model_dump_json().encode())
                    await hub.until_state("evil", SiteState.ONLINE)
                    for _ in range(20):
                        found = (await hub.get("/sites/berlin/lifts")).json()
                        assert [lift["name"] for lift in found["lifts"]] == ["lift", "goods"]
                    journal.write("a")
                    await hub.until_row("berlin", "a")
                    assert hub.hub.sites["berlin"].unreadable == 0
                    news = hub.hub.sites["berlin"].news
                    assert news is not None
                    assert news.name == "The berlin"
                    # of others it has received what it published itself, on its own leaf node
                    assert {subject for subject in received if "request" in subject} == {"site.evil.request.lifts"}
                    assert not [subject for subject in received if subject.startswith(("_INBOX", "$SYS"))]

    asyncio.run(main())


def test_rows_and_replies_that_mean_nothing_are_counted_and_change_nothing(rig: Rig) -> None:
    async def main() -> None:
        async def rubbish(message: Msg) -> None:
            await message.respond(b'{"lifts":[{"name":"\\u0000"}]}')

        with rig.leaf("evil"):
            async with rig.hub() as hub, rig.client("evil") as evil:

                async def another(message: Msg) -> None:
                    reply = {"code": "no_such_code", "status": 404, "message": "x" * 100}
                    await evil.publish(message.reply, json.dumps(reply).encode(), headers={"Lift-Manager": "problem"})

                async def rows(message: Msg) -> None:
                    for number in ("7", "-1", "7", "9" * 5000, "", "\u0662"):
                        row = b'{"journal":"j","seq":-5}'
                        await evil.publish(message.reply, row, headers={"Nats-Sequence": number})
                    await evil.publish(message.reply, b"", headers={"Status": "204"})

                await evil.subscribe("site.evil.request.command", cb=rubbish)
                await evil.subscribe("site.evil.request.lifts", cb=rubbish)
                await evil.subscribe("site.evil.request.ticket", cb=another)
                await evil.subscribe("$JS.API.DIRECT.GET.JOURNAL", cb=rows)

                async def connected() -> bool:
                    return str((await hub.get("/sites/evil/lifts")).json()["detail"]).endswith("cannot be read")

                await until(connected)
                unreadable = await hub.get("/sites/evil/lifts")
                assert (unreadable.status_code, unreadable.json()["code"]) == (502, "bad_reply")
                sent = await hub.post("/sites/evil/lifts/goods/commands", COMMAND)
                assert (sent.status_code, sent.json()["code"]) == (504, "unconfirmed"), sent.text
                refused = await hub.post("/sites/evil/tickets")
                assert (refused.status_code, refused.json()["code"]) == (502, "bad_reply")
                before = hub.hub.sites["evil"].unreadable
                await evil.publish("site.evil.news", b"not json")
                await evil.publish("site.evil.news", FORGED.model_dump_json().encode())

                async def counted() -> bool:
                    return hub.hub.sites["evil"].unreadable == before + 7

                await until(counted)
                assert hub.events("evil") == []

    asyncio.run(main())


def test_one_that_floods_is_not_listened_to_and_the_others_are_served_as_before(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"), rig.leaf("evil"):
                await hub.until_reached("berlin")
                async with rig.client("evil") as evil:

                    async def flood() -> None:
                        while True:
                            for _ in range(10 * MOST_NEWS):
                                await evil.publish("site.evil.news", b"x" * 1000)
                            await evil.flush()

                    flooding = asyncio.create_task(flood())
                    try:
                        await hub.until_state("evil", SiteState.FLOODING)
                        refused = await hub.get("/sites/evil/lifts")
                        assert (refused.status_code, refused.json()["code"]) == (503, "site_silent")
                        for number in range(10):
                            journal.write(f"row {number}")
                            assert (await hub.get("/sites/berlin/lifts")).status_code == 200
                        await hub.until_row("berlin", "row 9")
                        assert hub.hub.state("berlin") is SiteState.ONLINE
                    finally:
                        flooding.cancel()

    asyncio.run(main())


def test_a_hub_that_floods_a_site_is_refused_most_of_it(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        async with rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                async with rig.client("berlin") as local:
                    # the account of the site has the subjects of its requests, which only the hub uses
                    async def replies() -> bool:
                        with contextlib.suppress(Error):
                            return bool(await local.request("site.berlin.request.lifts", b"{}", timeout=0.5))
                        return False

                    await until(replies)
                    served = refused = 0
                    for _ in range(3 * MOST_REQUESTS):
                        reply = await local.request("site.berlin.request.lifts", b"{}", timeout=HANGS_S)
                        is_refused = b"too_often" in reply.data
                        served, refused = served + (not is_refused), refused + is_refused
                    assert refused > 0
                    assert served > 0

    asyncio.run(main())


def test_what_a_site_sends_that_is_a_bug_here_ends_neither_the_hub_nor_the_site(
    rig: Rig, journal: Journal, caplog: pytest.LogCaptureFixture
) -> None:
    class Breaks(FakeSite):
        def state(self, lift: str) -> LiftState:
            raise ZeroDivisionError

    async def main() -> None:
        async with rig.hub() as hub, rig.manager("berlin", Breaks(), journal):
            with rig.leaf("berlin"):

                async def retried() -> bool:
                    return caplog.text.count("hub: a bug;") >= 2

                await until(retried)
                assert (await hub.get("/sites")).status_code == 200

    asyncio.run(main())
