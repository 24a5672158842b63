"""The parts of a running manager, put together over real sockets."""

import asyncio
import logging
from pathlib import Path

import pytest

from lift_manager import app
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.plant import simulated_lift
from lift_manager.web.server import listen
from register_maps.codec import compile_map
from register_maps.load import load
from simulator.server import SimulatedController


def site_of(port: int, **controller: object) -> LoadedSite:
    source = load("generic-registers")
    data = {
        "schema": 1,
        "name": "one lift",
        "controllers": {"plc": {"host": "127.0.0.1", "port": port, "map": "generic-registers"} | controller},
        "lifts": {"lift": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.05}},
    }
    return LoadedSite(Site.model_validate(data), {"plc": source}, Path("test"))


def controller() -> SimulatedController:
    codec = compile_map(load("generic-registers").map)
    return SimulatedController({1: simulated_lift(codec, {"L1": 1, "L2": 2})})


def test_a_bug_in_one_part_ends_the_manager_only_after_everything_is_let_go(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        plc = controller()
        await plc.start()
        sock = listen("127.0.0.1", 0)
        sock.close()  # what serves the API breaks at once
        try:
            async with asyncio.timeout(10):
                await app.run(site_of(plc.port), sock, stop=asyncio.Event(), ready=lambda: None)
        finally:
            await plc.stop()

    with caplog.at_level(logging.INFO), pytest.raises(ExceptionGroup, match="because of a bug"):
        asyncio.run(main())
    assert "everything we held is let go and verified" in caplog.text


def test_a_controller_that_wants_a_long_pause_between_connections_gets_it() -> None:
    async def main() -> None:
        building = app.build(site_of(502, reconnect_min_s=5))
        assert building.links[0].settings.reconnect_min_s == 5
        assert building.links[0].settings.reconnect_max_s == 5

    asyncio.run(main())
