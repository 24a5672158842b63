"""An update on its way through real NATS servers: in parts, to the site that it is for, and to no other."""

import asyncio
import json
import os
from pathlib import Path

import pytest

from lift_manager.hub.connection import Connection
from lift_manager.hub.errors import HubSilent
from lift_manager.hub.update.desk import UpdateFiles
from lift_manager.hub.update.follower import Follower
from lift_manager.hub.update.installed import Version
from lift_manager.hub.update.messages import PART_BYTES
from lift_manager.hub.update.package import Content, make_package
from lift_manager.hub.update.stage import stage
from tests.lift_manager.hub.rig import Rig, until
from tests.lift_manager.hub.update.office import AT, Office, served
from tests.lift_manager.web.fake import FakeSite
from tests.support.journal import Journal
from tests.support.programs import HANGS_S


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    rig = Rig(tmp_path / "hub")
    rig.add("berlin")
    rig.add("rome")
    return rig


def large_update(office: Office, folder: Path) -> bytes:
    """Write a package of more than two parts."""
    files = office.content(8, office.site()).unpacked() | {"words.wav": os.urandom(2 * PART_BYTES)}
    package = make_package(Content.of(site="berlin", number=8, made_by="M. Weber", made_at=AT, files=files), office.key)
    (folder / "berlin.update").write_bytes(package)
    return package


def test_a_site_fetches_and_checks_its_update_and_another_site_gets_nothing_of_it(
    rig: Rig, office: Office, tmp_path: Path
) -> None:
    package = large_update(office, tmp_path)
    UpdateFiles(rig.place.path).begin([tmp_path / "berlin.update"], ["berlin"], ["berlin"], "M. Weber")
    installation, journal, staged = office.installation(), Journal(tmp_path / "berlin.db"), list[Version]()

    async def check() -> Version:
        assert installation.incoming.read_bytes() == package
        staged.append(stage(package, installation, served))
        return staged[0]

    async def main() -> None:
        follower = Follower(installation, check)
        async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal, updates=follower):
            with rig.leaf("berlin"), rig.leaf("rome"):

                async def has_waiting_event() -> bool:
                    events = [json.loads(event.text) for event in hub.stored("berlin") if event.name == "update"]
                    return [event["progress"] for event in events] == ["offered", "waiting"]

                await until(has_waiting_event)
                async with rig.client("rome") as stranger:

                    async def received(subject: str) -> bool:
                        inbox = "site.rome.inbox.1"
                        subscription = await stranger.subscribe(inbox)
                        await stranger.publish(subject, b'{"number": 8, "at": 0}', reply=inbox)
                        message = await subscription.next_msg(timeout=HANGS_S)
                        await subscription.unsubscribe()
                        return not (message.headers or {}).get("Status")

                    assert not await received("site.berlin.update.part")

    asyncio.run(main())
    journal.end()
    assert [version.number for version in staged] == [8]


def test_a_site_without_a_leaf_node_or_without_a_hub_learns_so(rig: Rig) -> None:
    async def main() -> None:
        with rig.leaf("berlin"):
            async with rig.client("berlin"):
                pass
            url, password = rig.access("berlin")
            connection = Connection("hub", (url,), "manager", password)
            with pytest.raises(HubSilent, match="no connection to the leaf node"):
                await connection.request("site.berlin.update.offer", b"{}", "site.berlin.inbox", HANGS_S)
            await connection.open()
            with pytest.raises(HubSilent, match="the hub is not connected"):
                await connection.request("site.berlin.update.offer", b"{}", "site.berlin.inbox", HANGS_S)
            await connection.close()

    asyncio.run(main())
