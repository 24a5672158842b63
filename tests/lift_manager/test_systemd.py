"""What systemd hears: over a real datagram socket, on virtual time where time matters, and from a real process."""

import asyncio
import configparser
import logging
import os
import signal
from pathlib import Path

import pytest

from drivers.model import Command, LiftReading, LiftValues, PressId
from lift_manager import app
from lift_manager.config.load import load_site
from lift_manager.lift.config import LiftConfig
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.runtime.site import Site
from lift_manager.systemd import Notifier, notifier, report_to_systemd
from tests.lift_manager.runtime.scripted import PLAIN, ScriptedDriver
from tests.support.programs import LIFT_MANAGER, OUT_WITHIN_S, ROOT, free_port, started
from tests.support.rows import each_row
from tests.support.systemd import Systemd, systemd_at
from tests.support.virtual_time import elapse, run_virtual

WATCHDOG_S = 4.0
PATIENCE_S = 10.0
EVERY_TWO_SECONDS = (17, 18, 19)
"""So often within 36 seconds; what comes in the first or the last moment may count or not."""
UNIT = ROOT / "deploy" / "systemd" / "lift-manager.service"


class Hanging(ScriptedDriver):
    """A lift whose reading never returns once it is told so: a bug of ours."""

    hangs = False

    async def read(self) -> LiftReading:
        if self.hangs:
            await asyncio.Event().wait()
        return await super().read()

    def press(self, press: PressId, command: Command, leave_by: float) -> None:
        raise AssertionError("nothing is pressed here")


def watched_lift(name: str, driver: ScriptedDriver) -> LiftConfig:
    return LiftConfig(
        name=name,
        source=driver.source,
        floors=("L1", "L2"),
        doors_at={},
        control=False,
        capabilities=driver.capabilities,
    )


def watched(systemd: Systemd, address: str, *, silent: bool = False, hangs: bool = False) -> list[str]:
    """What systemd hears in the last 36 seconds of a minute; the second of two lifts is like this from the tenth on."""

    async def main() -> list[str]:
        drivers = [Hanging(PLAIN, LiftValues()), Hanging(PLAIN, LiftValues())]
        bus: Bus[Event] = Bus()
        recorder = MemoryRecorder()
        lifts = [
            LiftActor(driver, watched_lift(name, driver), bus, recorder)
            for name, driver in zip(("east", "west"), drivers, strict=True)
        ]
        life = SiteLife(Site(lifts, bus, recorder), lifts)
        limits = {"east": PATIENCE_S, "west": PATIENCE_S}
        alive = report_to_systemd(Notifier(address, WATCHDOG_S), limits, life.polls, lambda: "well")
        tasks = [asyncio.ensure_future(work) for work in (life.run(), alive)]
        heard: list[str] = []
        for second in range(60):
            if second == 10:
                drivers[1].silent, drivers[1].hangs = silent, hangs
            await elapse(1)
            news = systemd.heard()  # taken every second, for a socket keeps only a few datagrams that nobody takes
            heard += news if second >= 10 + PATIENCE_S + WATCHDOG_S else []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return heard

    return run_virtual(main)


@pytest.fixture
def address(tmp_path: Path) -> str:
    return str(tmp_path / "notify")


def test_a_manager_whose_lifts_are_polled_gives_a_sign_of_life_twice_in_the_time_of_the_watchdog(address: str) -> None:
    with systemd_at(address) as systemd:
        assert watched(systemd, address).count("WATCHDOG=1") in EVERY_TWO_SECONDS


def test_a_dead_controller_does_not_starve_the_watchdog(address: str) -> None:
    with systemd_at(address) as systemd:
        assert watched(systemd, address, silent=True).count("WATCHDOG=1") in EVERY_TWO_SECONDS


def test_one_poll_loop_that_hangs_starves_the_watchdog_and_is_named(
    address: str, caplog: pytest.LogCaptureFixture
) -> None:
    with systemd_at(address) as systemd:
        heard = watched(systemd, address, hangs=True)
    assert "WATCHDOG=1" not in heard
    assert set(heard) == {"STATUS=polls stand still: west"}
    assert [record.message for record in caplog.records if record.levelno == logging.ERROR] == [
        "the polls of west no longer advance, and no controller is the cause; systemd is notified"
    ]


def test_readiness_comes_first_and_with_the_status(address: str) -> None:
    async def main() -> None:
        task = asyncio.ensure_future(report_to_systemd(Notifier(address, None), {}, dict, lambda: "2 lifts, 1 live"))
        await elapse(25)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    with systemd_at(address) as systemd:
        run_virtual(main)
        assert systemd.hear() == ["READY=1", "STATUS=2 lifts, 1 live"]
        # without a watchdog nothing but the status follows, at 10 and 20 s
        assert systemd.heard() == ["STATUS=2 lifts, 1 live"] * 2


def test_readiness_that_could_not_be_told_is_told_later(address: str) -> None:
    async def main() -> list[str]:
        task = asyncio.ensure_future(report_to_systemd(Notifier(address, WATCHDOG_S), {}, dict, lambda: "well"))
        await elapse(1)
        with systemd_at(address) as systemd:
            await elapse(WATCHDOG_S)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            return systemd.heard()

    assert run_virtual(main) == ["READY=1", "WATCHDOG=1", "STATUS=well", "WATCHDOG=1", "STATUS=well"]


def test_outside_systemd_nothing_is_watched() -> None:
    async def main() -> None:
        await report_to_systemd(notifier({}), {}, dict, lambda: "well")

    run_virtual(main)
    assert not notifier({}).is_enabled
    notifier({}).send("READY=1")


def test_an_abstract_socket_is_found() -> None:
    address = f"@lift-manager-test-{os.getpid()}"
    with systemd_at(address) as systemd:
        notifier({"NOTIFY_SOCKET": address}).send("READY=1", "STATUS=well")
        assert systemd.hear() == ["READY=1", "STATUS=well"]


@each_row(
    ("told", "watchdog_s"),
    [
        ({"WATCHDOG_USEC": "30000000"}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid())}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_ours_only_if_it_is_meant_for_this_process(
    told: dict[str, str], watchdog_s: float | None
) -> None:
    assert notifier({"NOTIFY_SOCKET": "/run/notify"} | told).watchdog_s == watchdog_s
    assert notifier(told).watchdog_s is None


@pytest.mark.parametrize("told", [{"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "-1"}])
def test_a_watchdog_that_is_no_time_is_reported(told: dict[str, str], caplog: pytest.LogCaptureFixture) -> None:
    assert notifier({"NOTIFY_SOCKET": "/run/notify"} | told).watchdog_s is None
    assert "WATCHDOG_USEC" in caplog.text


def test_a_socket_of_another_kind_is_reported_and_left_alone(caplog: pytest.LogCaptureFixture) -> None:
    assert not notifier({"NOTIFY_SOCKET": "vsock:2:1234"}).is_enabled
    assert "vsock" in caplog.text


def test_a_systemd_that_hears_nothing_is_reported_once_and_harms_nobody(
    address: str, caplog: pytest.LogCaptureFixture
) -> None:
    nobody = Notifier(address, 1.0)
    nobody.send("WATCHDOG=1")
    nobody.send("WATCHDOG=1")
    assert caplog.text.count("to systemd over") == 1
    with systemd_at(address) as systemd:
        nobody.send("WATCHDOG=1")
        assert systemd.hear() == ["WATCHDOG=1"]


def site(folder: Path, port: int) -> Path:
    path = folder / "site.yaml"
    text = f"schema: 1\nname: one\ncontrollers: {{plc: {{host: 127.0.0.1, port: {port}, map: generic-registers}}}}\n"
    path.write_text(text + "lifts: {lift: {controller: plc, floors: {L1: 1, L2: 2}}}\n", "utf-8")
    return path


def test_the_patience_follows_from_map_and_site(tmp_path: Path) -> None:
    loaded = load_site(site(tmp_path, 502))
    links = app.build(loaded).links
    (limit_s,) = app.poll_patience_s(loaded, links).values()
    # eight registers are polled and four outputs read back, each behind three commands
    settings = links[0].settings
    assert limit_s == pytest.approx(0.2 + 12 * 4 * (settings.most_timeout_s + 3 * 0.05))


def test_a_real_process_tells_systemd_how_it_stands_while_its_controller_is_dead(tmp_path: Path, address: str) -> None:
    variables = (f"NOTIFY_SOCKET={address}", "WATCHDOG_USEC=400000")
    command = ("env", *variables, *LIFT_MANAGER, "serve", str(site(tmp_path, free_port())), "--port", "0")
    with systemd_at(address) as systemd, started(*command) as program:
        ready, alive, status = systemd.hear()
        assert (ready, alive) == ("READY=1", "WATCHDOG=1")
        assert status.startswith("STATUS=1 lift, 0 live, ")
        program.says("http://")
        counts = []
        for _ in range(4):
            alive, status = systemd.hear()
            assert alive == "WATCHDOG=1"
            counts.append(int(status.split()[-2]))
        assert counts == sorted(set(counts))
        program.tell(signal.SIGSTOP)
        systemd.heard()
        with pytest.raises(TimeoutError):
            systemd.hear(0.8)
        program.tell(signal.SIGCONT)
        assert systemd.hear()[0] == "WATCHDOG=1"
        program.tell(signal.SIGTERM)
        while "STOPPING=1" not in (last := systemd.hear()):
            assert last[0] == "WATCHDOG=1"
        assert last == ["STOPPING=1", "STATUS=releasing everything"]
        assert program.ended() == 0


def test_the_unit_file_fits_the_program() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]  # systemd's names have capitals
    unit.read_string(UNIT.read_text("utf-8"))
    service = unit["Service"]
    assert (service["Type"], service["NotifyAccess"]) == ("notify", "main")
    assert " -I " in service["ExecStart"]
    assert " -m lift_manager serve " in service["ExecStart"]
    assert float(service["TimeoutStopSec"]) > OUT_WITHIN_S
    assert float(service["TimeoutStartSec"]) > 10 * app.FIRST_READING_S
    assert float(service["WatchdogSec"]) > 2 * app.RELEASE_WITHIN_S
    assert service["StateDirectory"] == "lift-manager"
