"""A hub and sites over real NATS servers: live state, the journal across outages, and the off switch."""

import asyncio
import os
import shutil
import signal
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lift_manager.hub.errors import FolderUnusable
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.service import Hub
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality
from tests.lift_manager.hub.rig import NATS_SERVER, Rig, until
from tests.lift_manager.web.fake import FakeSite
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.fake_rides import a_ride
from tests.support.certificates import Authority
from tests.support.journal import Journal
from tests.support.programs import HANGS_S


def rows(*texts: str, first: int = 1) -> list[tuple[str, tuple[int, str]]]:
    return [("row", (number, text)) for number, text in enumerate(texts, start=first)]


def test_state_is_requested_from_the_site_for_each_reply_and_guides_no_robot(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        lifts = FakeSite()
        async with rig.hub() as hub:
            with rig.leaf("berlin"):
                async with rig.manager("berlin", lifts, journal):
                    reply = await hub.until_reached("berlin")
                    assert reply["site"] == "berlin"
                    assert 0 <= reply["round_trip_s"] < 2
                    assert [lift["name"] for lift in reply["lifts"]] == ["lift", "goods"]
                    assert not {"robot_door", "permissions", "releases_in_s"} & set(reply["lifts"][0])
                    lifts.lifts["goods"] = replace(IDLE, lift="goods", quality=Quality.OFFLINE, reason="unplugged")
                    one = (await hub.get("/sites/berlin/lifts/goods")).json()
                    assert one["lift"]["reason"] == "unplugged"
                    lifts.fake_rides.going_on(a_ride(Holder("ride", "amr-7")))
                    (ride,) = (await hub.get("/sites/berlin/rides")).json()["rides"]
                    assert (ride["from"], ride["to"], ride["caller"]) == ("L1", "L2", "ride:amr-7")
                    assert not {"guidance", "reason", "advice"} & set(ride)
                    missing = await hub.get("/sites/berlin/lifts/none")
                    assert (missing.status_code, missing.json()["code"]) == (404, "unknown_lift")

                    async def reported() -> dict[str, Any] | None:
                        # of itself the site reports now and then: what it reported last may be from before
                        found = (await hub.get("/sites?state=online")).json()["sites"]
                        return next((site for site in found if site["live"] == 1), None)

                    site = await until(reported)
                    assert site is not None
                    assert (site["name"], site["lifts"], site["commands"]) == ("The berlin", 2, False)
                silent = await hub.get("/sites/berlin/lifts")
                assert (silent.status_code, silent.json()["code"]) == (503, "site_silent")
                await hub.until_state("berlin", SiteState.OFFLINE)
                assert [one["id"] for one in (await hub.get("/sites?state=offline")).json()["sites"]] == ["berlin"]
                scraped = (await hub.client.get("/metrics")).text
                assert 'lift_manager_hub_site_offline_total{site="berlin"} 1\n' in scraped
            unknown = await hub.get("/sites/rome/lifts")
            assert (unknown.status_code, unknown.json()["code"]) == (404, "unknown_site")

    asyncio.run(main())


def test_every_row_arrives_once_and_in_order_whatever_was_away(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        journal.write("a", "b")
        async with rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                async with rig.hub() as hub:
                    assert await hub.until_row("berlin", "b") == rows("a", "b")
                journal.write("while the hub was away")
                async with rig.hub() as hub:
                    await hub.until_row("berlin", "while the hub was away")
            journal.write("while the leaf node was away")
            async with rig.hub() as hub:
                with rig.leaf("berlin"):
                    await hub.until_row("berlin", "while the leaf node was away")
                rig.lose_stream("berlin")
                journal.write("after the stream was lost")
                with rig.leaf("berlin"):
                    found = await hub.until_row("berlin", "after the stream was lost")
        texts = ("a", "b", "while the hub was away", "while the leaf node was away", "after the stream was lost")
        assert found == rows(*texts)

    asyncio.run(main())


def test_rows_that_were_removed_before_they_could_be_published_are_a_gap(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        with rig.leaf("berlin"):
            async with rig.hub() as hub:
                journal.write("a")
                async with rig.manager("berlin", FakeSite(), journal):
                    await hub.until_row("berlin", "a")
                journal.write("b", "c", "d")
                journal.cut_through(3)
                async with rig.manager("berlin", FakeSite(), journal):
                    found = await hub.until_row("berlin", "d")
        assert found[:3] == [*rows("a"), ("gap", (2, 3)), *rows("d", first=4)]

    asyncio.run(main())


def test_a_site_that_is_switched_off_is_refused_and_the_others_go_on(
    rig: Rig, journal: Journal, tmp_path: Path
) -> None:
    async def main() -> None:
        second = Journal(tmp_path / "rome.db")
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                await hub.until_reached("berlin")
                rig.add("rome")
                with rig.leaf("rome"):
                    async with rig.manager("rome", FakeSite({"only": replace(IDLE, lift="only")}), second):
                        assert [lift["name"] for lift in (await hub.until_reached("rome"))["lifts"]] == ["only"]
                        assert (await hub.get("/sites/berlin/lifts")).status_code == 200
                        body = {"by": "M. Weber", "reason": "its key was copied"}
                        assert (await hub.post("/sites/berlin/off", body)).status_code == 200
                        # it counts at once, before the NATS server has followed
                        assert (await hub.get("/sites/berlin")).json()["state"] == "off"
                        assert (await hub.post("/sites/berlin/off", body)).json()["code"] == "not_now"
                        silent = await hub.get("/sites/berlin/lifts")
                        assert (silent.status_code, silent.json()["code"]) == (503, "site_silent")
                        assert (await hub.get("/sites/berlin")).json()["off"]["reason"] == body["reason"]

                        async def is_refused() -> bool:
                            # 429: so often is too often
                            assert (await hub.get("/sites/rome/lifts")).status_code in (200, 429)
                            return "Authorization Violation" in rig.log_of("berlin")

                        await until(is_refused)
                        journal.write("while it was off")
                        assert (await hub.post("/sites/berlin/on", {"by": "M. Weber"})).status_code == 200
                        assert (await hub.get("/sites/berlin")).json()["off"] is None
                        await hub.until_reached("berlin")
                        await hub.until_row("berlin", "while it was off")
        second.end()

    asyncio.run(main())


def test_a_leaf_node_connects_only_to_a_server_with_a_certificate_of_its_ca_which_may_be_renewed(
    rig: Rig, journal: Journal, tmp_path: Path
) -> None:
    authority, stranger = Authority(tmp_path / "ca", "ours"), Authority(tmp_path / "ca", "another")
    shown, foreign = authority.issue("hub", "127.0.0.1"), stranger.issue("foreign", "127.0.0.1")

    async def main() -> None:
        tls = {"certificate": str(shown.certificate), "key": str(shown.key)}
        rig.settings |= {"tls": tls, "ca": str(authority.file)}
        rig.add("rome")
        async with rig.hub() as hub, rig.manager("rome", FakeSite(), journal):
            with rig.leaf("rome"):
                await hub.until_reached("rome")
            shutil.copy(foreign.key, shown.key)
            shutil.copy(foreign.certificate, shown.certificate)

            async def is_refused() -> bool:
                return "certificate signed by unknown authority" in rig.log_of("rome")

            async def is_read() -> bool:
                return "Reloaded server configuration" in (rig.place.path / "nats.log").read_text()

            await until(is_read)
            with rig.leaf("rome"):
                await until(is_refused)
                authority.issue("hub", "127.0.0.1")
                await hub.until_reached("rome")

    asyncio.run(main())


def test_a_server_that_ends_is_started_again(rig: Rig, journal: Journal, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
            with rig.leaf("berlin"):
                await hub.until_reached("berlin")
                os.kill(int((rig.place.path / "nats.pid").read_text()), signal.SIGKILL)

                async def is_noticed() -> bool:
                    return "has ended with -9, and is started again" in caplog.text

                await until(is_noticed)
                await hub.until_reached("berlin")
                journal.write("a")
                await hub.until_row("berlin", "a")

    asyncio.run(main())


def test_a_hub_that_was_killed_leaves_no_server_that_the_next_one_cannot_reach(rig: Rig) -> None:
    async def main() -> None:
        command = [NATS_SERVER, "-c", str(rig.place.nats_conf)]
        orphan = subprocess.Popen(command, stderr=subprocess.DEVNULL)  # noqa: ASYNC220
        try:
            await until(rig.has_pid)
            async with rig.hub() as hub:
                assert orphan.wait(HANGS_S) is not None
                with pytest.raises(FolderUnusable, match="another hub runs with"):
                    await Hub(rig.place).run(lambda: None)
                assert (await hub.get("/sites")).status_code == 200
        finally:
            orphan.kill()
            orphan.wait()

    asyncio.run(main())


def test_a_manager_ends_in_time_while_its_leaf_node_hangs(rig: Rig, journal: Journal) -> None:
    async def main() -> None:
        with rig.leaf("berlin") as leaf:
            async with rig.hub() as hub:
                journal.write("a")
                async with rig.manager("berlin", FakeSite(), journal):
                    await hub.until_row("berlin", "a")
                    leaf.send_signal(signal.SIGSTOP)
                    journal.write("b")
                    began = asyncio.get_running_loop().time()
                assert asyncio.get_running_loop().time() - began < 20
                leaf.send_signal(signal.SIGCONT)

    asyncio.run(main())
