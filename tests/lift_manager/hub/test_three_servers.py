"""A hub on three NATS servers in one cluster, with the configuration that is shipped: one of them ends, or has an old copy of the accounts."""

import asyncio
import logging
import re
from pathlib import Path

import pytest

from lift_manager.hub.folder import COMPRESSION, MAX_PAYLOAD, PING
from lift_manager.hub.remote_site import SiteState
from tests.lift_manager.hub.rig import Rig, until
from tests.lift_manager.hub.servers import NAMES, SHIPPED, Servers
from tests.lift_manager.web.fake import FakeSite
from tests.support.journal import Journal


@pytest.fixture
def servers(tmp_path: Path) -> Servers:
    return Servers(Rig(tmp_path / "hub"), tmp_path)


def server_of_hub(servers: Servers, caplog: pytest.LogCaptureFixture) -> str:
    """The server to which the hub has connected last."""
    return servers.at(re.findall(r"hub: connected to (tls:\S+)", caplog.text)[-1])


def test_a_site_and_the_hub_go_on_with_the_servers_that_are_left(
    servers: Servers, journal: Journal, caplog: pytest.LogCaptureFixture
) -> None:
    rig = servers.rig
    rig.add("berlin")
    caplog.set_level(logging.INFO)

    async def main() -> None:
        with servers.running():
            async with rig.hub() as hub, rig.manager("berlin", FakeSite(), journal):
                with rig.leaf("berlin"):
                    await hub.until_reached("berlin")
                    servers.kill(server_of_hub(servers, caplog))
                    journal.write("with two servers")
                    await hub.until_row("berlin", "with two servers")
                    servers.kill(servers.of_site("berlin"))
                    journal.write("with one server")
                    await hub.until_row("berlin", "with one server")
                    assert (await hub.until_reached("berlin"))["site"] == "berlin"

    asyncio.run(main())


def test_a_site_that_is_switched_on_is_reached_though_its_server_learned_too_late_that_it_was_off(
    servers: Servers, journal: Journal, caplog: pytest.LogCaptureFixture
) -> None:
    rig = servers.rig
    rig.add("rome")
    caplog.set_level(logging.INFO)

    async def main() -> None:
        with servers.running():
            async with rig.hub() as hub, rig.manager("rome", FakeSite(), journal):
                other = next(name for name in NAMES if name not in ("n1", server_of_hub(servers, caplog)))
                servers.let_sites_connect_to(other)
                rig.add("berlin")
                servers.copy_accounts()
                async with rig.manager("berlin", FakeSite(), journal):
                    with rig.leaf("berlin"):
                        await hub.until_reached("berlin")
                        changes = caplog.text.count("the sites have changed")
                        await hub.post("/sites/berlin/off", {"by": "M. Weber", "reason": "its key was copied"})
                        await hub.until_state("berlin", SiteState.OFF)

                        async def is_back() -> bool:
                            # not before the server of the hub knows: of what it never knew, it cannot tell the others
                            is_applied = caplog.text.count("the sites have changed") > changes
                            return is_applied and servers.is_connected(other)

                        # it was disconnected, and its server, which has the old file, takes it again
                        await until(is_back)
                        read = servers.times_read(other)
                        servers.copy_accounts()

                        async def has_read() -> bool:
                            return servers.times_read(other) > read

                        await until(has_read)
                        await hub.post("/sites/berlin/on", {"by": "M. Weber"})
                        servers.copy_accounts()
                        await hub.until_reached("berlin")

    asyncio.run(main())


def test_a_new_site_is_reached_though_the_server_of_the_hub_got_its_account_last_and_nobody_told_it(
    servers: Servers, journal: Journal, caplog: pytest.LogCaptureFixture
) -> None:
    rig = servers.rig
    rig.settings["servers"] = servers.urls("n2", "n3")
    rig.add("rome")
    caplog.set_level(logging.INFO)

    async def main() -> None:
        with servers.running():
            async with rig.hub() as hub, rig.manager("rome", FakeSite(), journal):
                other = next(name for name in ("n2", "n3") if name != server_of_hub(servers, caplog))
                servers.let_sites_connect_to(other)
                rig.add("berlin")
                servers.copy_accounts(other)
                async with rig.manager("berlin", FakeSite(), journal):
                    with rig.leaf("berlin"):

                        async def is_connected() -> bool:
                            is_applied = "there are 2 now" in caplog.text
                            return is_applied and "Leafnode connection created" in rig.log_of("berlin")

                        await until(is_connected)
                        servers.copy_accounts(tell=False)
                        await hub.until_reached("berlin")

    asyncio.run(main())


def test_the_shipped_configuration_is_like_that_of_the_server_that_a_hub_runs() -> None:
    text = SHIPPED.read_text()
    for line in (f'ping_interval: "{PING}"', f"max_payload: {MAX_PAYLOAD}", f'compression: "{COMPRESSION}"'):
        assert f"{line}\n" in text
