"""The metrics of a manager that polls a simulated controller over a link, all in memory."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.modbus.memory import MemoryDevice
from lift_manager.app import ManagerParts, build
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.bus import StateChanged
from lift_manager.runtime.links import WireFrame
from lift_manager.runtime.refusals import FaceRefusal
from register_maps.load import load
from register_maps.words import Table
from tests.lift_manager.metrics.measured import Labels, samples
from tests.support.refusals import refusal
from tests.support.virtual_time import elapse, run_virtual

ROBOT = Holder("workshop", "workshop")


@dataclass
class Running:
    """A manager at work, and the device behind its only link."""

    building: ManagerParts
    device: MemoryDevice

    async def read(self) -> dict[str, dict[Labels, float]]:
        return samples(*await self.building.metrics.scrape(""))

    async def value(self, sample: str, **labels: str) -> float:
        return (await self.read())[sample][tuple(sorted(labels.items()))]


def standing() -> MemoryDevice:
    """A lift of generic-registers that stands closed at floor 1, healthy, and whose program is alive."""
    device = MemoryDevice(delay_s=0.03)
    device.values[Table.HOLDING] = dict(enumerate((0, 1, 1, 1, 1, 0b101, 0, 0)))
    return device


def site() -> LoadedSite:
    data = {
        "schema": 1,
        "name": "one lift",
        "controllers": {"plc": {"host": "127.0.0.1", "port": 502, "map": "generic-registers"}},
        "lifts": {"lift": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.1}},
    }
    return LoadedSite(Site.model_validate(data), {"lift": load("generic-registers")}, Path("test"))


def running(check: Callable[[Running], Awaitable[None]]) -> None:
    async def main() -> None:
        device = standing()
        building = build(site(), lambda _: device.wire())

        async def beat() -> None:
            while True:
                await elapse(0.2)
                device.values[Table.HOLDING][0] += 1

        links: Sequence[Awaitable[None]] = [link.run() for link in building.links]
        work = [*links, building.life.run(), building.metrics.run(), *building.life.drives(), beat()]
        tasks = [asyncio.ensure_future(part) for part in work]
        await elapse(2.0)
        try:
            await check(Running(building, device))
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main, limit_s=600)


def test_a_lift_that_is_polled_is_live_and_its_link_says_how_it_fares() -> None:
    async def check(made: Running) -> None:
        read = await made.read()
        assert read["lift_manager_lift_live"] == {(("lift", "lift"),): 1}
        assert read["lift_manager_link_up"] == {(("link", "plc"),): 1}
        assert read["lift_manager_lift_mode"][("lift", "lift"), ("mode", "normal")] == 1
        requests = read["lift_manager_link_requests_total"][(("link", "plc"),)]
        trips = read["lift_manager_link_round_trip_seconds_bucket"]
        assert requests > 15
        assert trips[("le", "0.05"), ("link", "plc")] in (requests, requests - 1)
        assert trips[("le", "0.025"), ("link", "plc")] == 0
        assert read["lift_manager_polls_total"][(("lift", "lift"),)] > 15

    running(check)


def test_a_controller_that_falls_silent_shows_in_its_link_and_in_its_lift() -> None:
    async def check(made: Running) -> None:
        made.device.fall_silent(1e9)
        await elapse(20.0)
        read = await made.read()
        assert read["lift_manager_lift_live"] == {(("lift", "lift"),): 0}
        assert read["lift_manager_lift_reading_age_seconds"][(("lift", "lift"),)] == pytest.approx(20.0, abs=0.3)
        assert read["lift_manager_link_answer_age_seconds"][(("link", "plc"),)] == pytest.approx(20.0, abs=0.3)
        assert read["lift_manager_link_timeouts_total"][(("link", "plc"),)] >= 4
        assert read["lift_manager_link_recycles_total"][(("link", "plc"),)] >= 2

    running(check)


def test_refusals_of_requests_and_at_the_door_are_counted_under_the_lifts_of_the_site_only() -> None:
    async def check(made: Running) -> None:
        site = made.building.site
        refused = refusal(lambda: site.request("lift", ROBOT, "L9", hold_door=True))
        assert refused.code is Refusal.UNKNOWN_FLOOR
        refusal(lambda: site.request("a name that a caller made up", ROBOT, "L1", hold_door=True))
        site.turned_away(FaceRefusal("bad_key", "its key does not count", "", "", "10.0.0.9"))
        refusal(lambda: site.end_lockout("lift", "M. Weber"))
        read = await made.read()
        found = {
            tuple(value for _, value in labels): count for labels, count in read["lift_manager_refusals_total"].items()
        }
        assert found == {
            ("unknown_floor", "lift"): 1,
            ("unknown_lift", ""): 1,
            ("bad_key", ""): 1,
            ("not_locked_out", "lift"): 1,
        }

    running(check)


def test_a_session_is_counted_and_its_command_with_what_became_of_it() -> None:
    async def check(made: Running) -> None:
        made.device.values[Table.HOLDING][5] = 0b111  # robot mode is granted, and the call is taken without a sign
        made.building.site.request("lift", ROBOT, "L2", hold_door=True)
        await elapse(5.0)
        read = await made.read()
        assert read["lift_manager_sessions_opened_total"][("face", "workshop"), ("lift", "lift")] == 1
        assert read["lift_manager_session_held_seconds"][(("lift", "lift"),)] == pytest.approx(5.0, abs=0.1)
        ended = {labels: count for labels, count in read["lift_manager_commands_total"].items() if count}
        told = (("command", "go_to"), ("lift", "lift"), ("reason", "no_evidence"), ("result", "unconfirmed"))
        assert ended == {told: 1}
        assert read["lift_manager_link_wait_seconds_count"][("lane", "command"), ("link", "plc")] >= 1

    running(check)


def test_measuring_alone_has_no_state_published() -> None:
    async def check(made: Running) -> None:
        made.device.values[Table.HOLDING][2] = 2
        await elapse(1.0)
        assert await made.value("lift_manager_events_total", event="state_changed") == 0
        heard: list[object] = []
        with made.building.site.tap(lambda occurrence: heard.append(occurrence.event)):
            made.device.values[Table.HOLDING][2] = 1
            await elapse(1.0)
        assert any(isinstance(event, StateChanged) for event in heard)
        assert await made.value("lift_manager_events_total", event="state_changed") == len(heard)

    running(check)


def test_the_frames_of_a_link_are_heard_by_the_name_of_its_controller() -> None:
    async def check(made: Running) -> None:
        frames: list[WireFrame] = []
        sources = made.building.sources
        assert sources.link_names() == ("plc",)
        with sources.tap_frames("plc", frames.append):
            await elapse(0.25)
        count = len(frames)
        assert count >= 4
        assert {frame.link for frame in frames} == {"plc"}
        assert {frame.sent for frame in frames} == {True, False}
        assert [frame.at for frame in frames] == sorted(frame.at for frame in frames)
        await elapse(1.0)
        assert len(frames) == count
        with pytest.raises(KeyError), sources.tap_frames("another", frames.append):
            pass

    running(check)
