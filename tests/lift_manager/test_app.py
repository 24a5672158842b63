"""The parts of a running manager, put together over real sockets."""

import asyncio
import contextlib
import logging
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.modbus.settings import LinkSettings
from lift_manager import app
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.config.site import Site
from lift_manager.lab.plant import simulated_lift
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.hours import RobotHours, read_hours
from lift_manager.lift.journal import Row
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality
from lift_manager.plain.signals import remember_sigterm
from lift_manager.runtime.recorder import MemoryRecorder, SavedLift
from lift_manager.web.server import listen
from register_maps.load import load
from register_maps.words import Door, Side
from simulator.controller import Inputs
from simulator.server import SimulatedController
from tests.support.shipped_maps import compiled


def site_of(port: int, **controller: object) -> LoadedSite:
    source = load("generic-registers")
    data = {
        "schema": 1,
        "name": "one lift",
        "controllers": {"plc": {"host": "127.0.0.1", "port": port, "map": "generic-registers"} | controller},
        "lifts": {"lift": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.05}},
    }
    return LoadedSite(Site.model_validate(data), {"lift": source}, Path("test"))


def controller() -> SimulatedController:
    codec = compiled("generic-registers")
    return SimulatedController({1: simulated_lift(codec, {"L1": 1, "L2": 2})})


class Module:
    """An I/O module that answers for one unit id: bits to read, and what was written. Its bytes are its own."""

    def __init__(self, unit_id: int, bits: Mapping[int, int]) -> None:
        self.unit_id = unit_id
        self.bits = dict(bits)
        self.written: asyncio.Queue[bytes] = asyncio.Queue()
        self.asked: set[bytes] = set()

    @contextlib.asynccontextmanager
    async def serve(self) -> AsyncIterator[int]:
        """Listen on a free port, and give it."""
        server = await asyncio.start_server(self._connected, "127.0.0.1", 0)
        try:
            yield int(server.sockets[0].getsockname()[1])
        finally:
            server.close()
            await server.wait_closed()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = await reader.readexactly(6)
                body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
                answer = self._answer(body)
                writer.write(head[:4] + len(answer).to_bytes(2, "big") + answer)
        writer.close()

    def _answer(self, body: bytes) -> bytes:
        unit, function, address = body[0], body[1], int.from_bytes(body[2:4], "big")
        if unit != self.unit_id:
            return bytes([unit, function | 0x80, 0x0B])
        if function == 5:
            self.bits[address] = int(body[4] == 0xFF)
            self.written.put_nowait(body)
            return body
        self.asked.add(body[1:])
        count = int.from_bytes(body[4:6], "big")
        packed = sum(self.bits.get(address + index, 0) << index for index in range(count))
        length = (count + 7) // 8
        return bytes([unit, function, length]) + packed.to_bytes(length, "little")


@contextlib.asynccontextmanager
async def running(building: app.ManagerParts) -> AsyncIterator[None]:
    """Everything but the faces of a manager."""
    async with asyncio.TaskGroup() as tasks:
        parts = [*(link.run() for link in building.links), *building.life.drives(), building.life.run()]
        work = [tasks.create_task(part) for part in parts]
        await building.life.first_look()
        yield
        await building.life.stop()
        for task in work:
            task.cancel()


def test_a_bug_in_one_part_ends_the_manager_only_after_everything_is_let_go(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        plc = controller()
        await plc.start()
        sock = listen("127.0.0.1", 0)
        sock.close()  # what serves the API breaks at once
        try:
            async with asyncio.timeout(60):
                await app.run(site_of(plc.port), sock, stop=asyncio.Event(), ready=lambda: None)
        finally:
            await plc.stop()

    with caplog.at_level(logging.INFO), pytest.raises(ExceptionGroup, match="because of a bug"):
        asyncio.run(main())
    assert "stopping: releasing everything" in caplog.text
    # on a busy machine the lift may be too old to be looked at, or the time for it over, and that is said
    said = (
        "everything held is released and verified",
        "so the outputs of its controller could not be verified",
        "not every output",
    )
    assert any(words in caplog.text for words in said)


class Mute:
    """Stands between a manager and a controller, and passes on no answer any more once it is told to."""

    def __init__(self, port: int) -> None:
        self._port = port
        self.is_mute = False
        self.asked = asyncio.Event()
        """Something was asked since then."""

    @contextlib.asynccontextmanager
    async def serve(self) -> AsyncIterator[int]:
        """Listen on a free port, and give it."""
        server = await asyncio.start_server(self._connected, "127.0.0.1", 0)
        try:
            yield int(server.sockets[0].getsockname()[1])
        finally:
            server.close()
            await server.wait_closed()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        behind_reader, behind = await asyncio.open_connection("127.0.0.1", self._port)
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            while head := await reader.readexactly(6):
                behind.write(head + await reader.readexactly(int.from_bytes(head[4:6], "big")))
                answer = await behind_reader.readexactly(6)
                answer += await behind_reader.readexactly(int.from_bytes(answer[4:6], "big"))
                if self.is_mute:
                    self.asked.set()
                else:
                    writer.write(answer)
        behind.close()
        writer.close()


class SettledJournal(MemoryRecorder):
    """Knows what was noted after the end had seen everything on the disk."""

    def __init__(self) -> None:
        super().__init__()
        self.is_settled = False
        self.late: list[str] = []

    def note(self, row: Row) -> None:
        super().note(row)
        if self.is_settled:
            self.late.append(row.text)

    async def settled(self) -> None:
        self.is_settled = True


def test_an_end_with_a_poll_in_flight_notes_nothing_after_the_last_row_is_written() -> None:
    async def main() -> None:
        plc = controller()
        await plc.start()
        mute, journal, stop, ready = Mute(plc.port), SettledJournal(), asyncio.Event(), asyncio.Event()
        async with mute.serve() as port, asyncio.timeout(60), asyncio.TaskGroup() as tasks:
            running = app.run(site_of(port), listen("127.0.0.1", 0), stop=stop, ready=ready.set, recorder=journal)
            tasks.create_task(running)
            await ready.wait()
            mute.is_mute = True
            await mute.asked.wait()
            stop.set()
        await plc.stop()
        assert journal.is_settled
        assert journal.late == []

    asyncio.run(main())


def test_a_manager_that_only_watches_says_at_its_end_that_it_held_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        plc = controller()
        await plc.start()
        site = site_of(plc.port)
        watched = site.site.lifts["lift"].model_copy(update={"access": "monitor"})
        only = replace(site, site=site.site.model_copy(update={"lifts": {"lift": watched}}))
        sock, stop = listen("127.0.0.1", 0), asyncio.Event()
        try:
            async with asyncio.timeout(60):
                assert await app.run(only, sock, stop=stop, ready=stop.set)
        finally:
            await plc.stop()

    with caplog.at_level(logging.INFO):
        asyncio.run(main())
    assert "stopping: nothing is held, every lift is only monitored" in caplog.text
    assert "let go" not in caplog.text


class WatchedRecorder(MemoryRecorder):
    """Knows whether it is still being written, and what was heard of the port, when the end waits for it."""

    def __init__(self, port: int, *, broken: bool) -> None:
        super().__init__()
        self._port = port
        self._is_broken = broken
        self.is_written = False
        self.waited_while_written = False

    def keep(self, lift: str, saved: SavedLift) -> None:
        if self._is_broken:
            raise ZeroDivisionError  # a bug
        super().keep(lift, saved)

    async def run(self, report: Callable[[str], None]) -> None:
        self.is_written = True
        try:
            await super().run(report)
        finally:
            self.is_written = False

    async def settled(self) -> None:
        """Return once the port is closed."""
        self.waited_while_written = self.is_written
        while True:
            try:
                _, writer = await asyncio.open_connection("127.0.0.1", self._port)
            except ConnectionError:
                return
            writer.close()
            await asyncio.sleep(0.01)


async def ended_by_a_fire(*, broken: bool) -> WatchedRecorder:
    """Run a manager until a fire is to be saved, and end it; with a broken recorder it ends by itself."""
    codec = compiled("generic-registers")
    face = simulated_lift(codec, {"L1": 1, "L2": 2})
    plc = SimulatedController({1: face})
    await plc.start()
    face.people(asyncio.get_running_loop().time(), Inputs(fire=True))
    with listen("127.0.0.1", 0) as sock:
        recorder, stop = WatchedRecorder(sock.getsockname()[1], broken=broken), asyncio.Event()
        if not broken:
            asyncio.get_running_loop().call_later(1.0, stop.set)
        try:
            async with asyncio.timeout(60):
                site = site_of(plc.port)
                await app.run(site, sock, stop=stop, ready=lambda: None, recorder=recorder)
        except* ZeroDivisionError:
            assert broken
        finally:
            await plc.stop()
    return recorder


@pytest.mark.parametrize("broken", [True, False])
def test_what_people_say_is_written_until_the_end_also_after_a_bug_in_one_lift(
    caplog: pytest.LogCaptureFixture, *, broken: bool
) -> None:
    recorder = asyncio.run(ended_by_a_fire(broken=broken))
    assert recorder.waited_while_written
    saved = recorder.recall("lift")
    assert (saved is None or saved.record.fire_since is None) is broken
    assert "is not on the disk" not in caplog.text  # the port was closed meanwhile


def test_a_controller_that_wants_a_long_pause_between_connections_gets_it() -> None:
    async def main() -> None:
        building = app.build(site_of(502, reconnect_min_s=5))
        assert building.links[0].settings.reconnect_min_s == 5
        assert building.links[0].settings.reconnect_max_s == 5

    asyncio.run(main())


def test_how_many_clients_a_controller_serves_reaches_its_link(tmp_path: Path) -> None:
    text = (Path(load("generic-registers").path)).read_text("utf-8")
    (tmp_path / "mine.yaml").write_text(text.replace("link: {", "link: {max_connections: 2, "), "utf-8")
    site = "schema: 1\nname: x\ncontrollers: {plc: {host: 127.0.0.1, map: ./mine.yaml}}\n"
    (tmp_path / "site.yaml").write_text(site + "lifts: {lift: {controller: plc, floors: {L1: 1, L2: 2}}}\n", "utf-8")
    (link,) = app.build(load_site(tmp_path / "site.yaml")).links
    assert link.settings.max_connections == 2


HANDSHAKE = """\
schema: 1
name: a lift that wants to know who is aboard
controllers: {plc: {host: 127.0.0.1, map: seer-lps3-two-stop}}
lifts:
  lift:
    controller: plc
    display_name: Güteraufzug Süd / 2
    floors: {L1: 0, L2: 1}
    lease_s: 60
    max_session_hold_s: 100
    infer_occupancy: true
    board_min_s: 8
    robot_hours: ["Mon-Fri 20:00-06:00"]
    between_sessions_s: 12
    fire_release_delay_s: 1.5
    rmf: {name: goods_lift, floors: {L2: level 2}}
"""
TWO_MODULES = """\
schema: 1
name: two modules, one lift
controllers:
  buttons: {host: 127.0.0.1, port: BUTTONS, map: adam-pushbutton, unit_id: 3}
  machine-room: {host: 127.0.0.1, port: SENSORS}
lifts:
  vip:
    controller: buttons
    access: control
    accept_latching: the modules end with the test
    floors: {G: 0, L1: 1, L2: 2}
    poll_s: 0.05
    endpoints: {sensor: {controller: machine-room, unit_id: 7}}
    override:
      endpoints: {sensor: {served: {discrete: [[1, 5]]}}}
      signals:
        car_floor: {one_of: ["sensor/discrete:1", "sensor/discrete:2", "sensor/discrete:3"]}
        door.front: {open_limit: "sensor/discrete:4", closed_limit: "sensor/discrete:5"}
"""


def test_a_link_to_a_controller_that_serves_nobody_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="max_connections must be 1 or more"):
        LinkSettings(max_connections=0)


def test_what_a_site_says_about_a_lift_reaches_the_manager(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(HANDSHAKE, "utf-8")
    loaded = load_site(tmp_path / "site.yaml")
    config = app.build(loaded).site.config("lift")
    assert config == LiftConfig(
        name="lift",
        source=config.source,
        capabilities=config.capabilities,
        display_name="Güteraufzug Süd / 2",
        floors=("L1", "L2"),
        doors_at={"L1": (Side.FRONT,), "L2": (Side.FRONT,)},
        control=False,
        poll_s=0.5,
        poll_ridden_s=0.5,
        lease_s=60,
        max_session_hold_s=100,
        infer_occupancy=True,
        board_min_s=8,
        robot_hours=RobotHours((read_hours("Mon-Fri 20:00-06:00"),)),
        between_sessions_s=12,
        fire_release_delay_s=1.5,
        rmf_name="goods_lift",
        rmf_floors={"L2": "level 2"},
    )


def test_no_device_of_a_lift_is_asked_for_more_than_one_of_them_can_answer(tmp_path: Path) -> None:
    async def main() -> None:
        buttons, sensors = Module(3, {}), Module(7, {1: 1, 4: 1})
        async with buttons.serve() as pressed_at, sensors.serve() as seen_at, asyncio.timeout(60):
            path = tmp_path / "site.yaml"
            text = TWO_MODULES.replace("port: SENSORS", "port: SENSORS, max_bits_per_read: 2")
            path.write_text(text.replace("BUTTONS", str(pressed_at)).replace("SENSORS", str(seen_at)), "utf-8")
            async with running(app.build(load_site(path))):
                pass
            assert {asked[4] for asked in sensors.asked | buttons.asked} == {1, 2}

    asyncio.run(main())


def test_a_lift_on_two_devices_is_seen_on_one_and_called_on_the_other(tmp_path: Path) -> None:
    async def main() -> None:
        buttons, sensors = Module(3, {}), Module(7, {1: 1, 4: 1})
        async with buttons.serve() as pressed_at, sensors.serve() as seen_at, asyncio.timeout(60):
            path = tmp_path / "site.yaml"
            path.write_text(TWO_MODULES.replace("BUTTONS", str(pressed_at)).replace("SENSORS", str(seen_at)), "utf-8")
            building = app.build(load_site(path))
            assert len(building.links) == 2
            async with running(building):
                state = building.site.state("vip")
                assert (state.quality, state.floor, state.doors[Side.FRONT]) == (Quality.LIVE, "L1", Door.CLOSED)
                building.site.request("vip", Holder("test", "test"), "L2", hold_door=False)
                while (press := await buttons.written.get())[4] == 0:
                    assert press[3] in (16, 17)  # the other two buttons are let go first
            # unit 3, function 5, third button (19 as printed, 18 on the wire), on
            assert press == bytes([3, 5, 0, 18, 0xFF, 0])
            assert sensors.written.empty()
            # function 2, the five inputs from the first
            assert sensors.asked == {bytes([2, 0, 0, 0, 5])}

    asyncio.run(main())


def test_a_manager_that_is_told_to_end_before_it_runs_still_lets_go_of_what_an_earlier_one_left_on() -> None:
    async def main() -> None:
        plc = controller()
        await plc.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", plc.port)
        writer.write(bytes.fromhex("0001 0000 0006 01 06 0011 0001"))
        await reader.readexactly(12)
        stop = asyncio.Event()
        stop.set()
        assert await app.run(site_of(plc.port), listen("127.0.0.1", 0), stop=stop, ready=lambda: None)
        writer.write(bytes.fromhex("0002 0000 0006 01 03 0011 0001"))
        assert (await reader.readexactly(11))[-2:] == b"\x00\x00"
        writer.close()
        await plc.stop()

    asyncio.run(main())


def test_sigterm_before_there_is_an_event_loop_is_kept_for_later() -> None:
    before = signal.getsignal(signal.SIGTERM)
    try:
        came = remember_sigterm()
        assert not came()
        signal.raise_signal(signal.SIGTERM)
        assert came()
    finally:
        signal.signal(signal.SIGTERM, before)
