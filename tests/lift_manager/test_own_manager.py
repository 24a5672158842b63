"""A manager that a tool runs for itself: what it may write, who else may use it, and how it ends."""

import json
import logging
import signal
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import pytest
import typer

from drivers.modbus.controller_lock import controller_lock
from lift_manager.cli.own_manager import run_directly
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import Refused
from lift_manager.lab.bench import LiftSimulator
from lift_manager.lab.world.truth import Truth
from tests.support.programs import HANGS_S, call, running_script
from tests.support.rows import each_row

HOLD = "hold_door.front"

pytestmark = pytest.mark.lift("main", speed=20.0)

TOOL = """
import asyncio, sys
from pathlib import Path
import typer
from lift_manager.cli.own_manager import run_directly

async def hold(client):
    async with client.session("main", robot="tool") as session:
        await session.go_to("L2", hold_door=True, wait=20)
        await asyncio.Event().wait()

def tool():
    run_directly(Path(sys.argv[1]), hold, name="tool", may_command=["main"], is_recorded=True)

app = typer.Typer()
app.command()(tool)
app(args=[])
"""
"""Calls the car and holds its door until a signal ends it."""


@pytest.fixture
def site(lift_simulator: LiftSimulator, tmp_path: Path) -> Path:
    """The file of a site with control of the simulated lift."""
    floors = {name: code for code, name in enumerate(lift_simulator.floors, 1)}
    lift = {"controller": "plc", "access": "control", "floors": floors, "poll_s": 0.1, "max_age_s": 10, "clear_s": 0.5}
    content = {
        "schema": 1,
        "name": "One lift",
        "state": "kept",
        "controllers": {"plc": {"host": "127.0.0.1", "port": lift_simulator.port, "map": "generic-registers"}},
        "lifts": {"main": lift},
    }
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
    return file


Work = Callable[[LiftManagerClient], Awaitable[str]]


@pytest.fixture
def hold_door(lift_simulator: LiftSimulator) -> Work:
    """Call the car, and return once its door is held; or return why that is refused."""

    async def work(client: LiftManagerClient) -> str:
        try:
            async with client.session("main", robot="tool") as session:
                await session.go_to("L2", hold_door=True, wait=20)
                await lift_simulator.when(is_held, within_s=HANGS_S)
                return "held"
        except Refused as refused:
            return str(refused)

    return work


def is_held(truth: Truth) -> bool:
    return HOLD in dict(truth.given)


def holds(lift: LiftSimulator) -> list[bool]:
    """Every beginning and end of the hold that was written."""
    return [write.on for write in lift.writes if write.command == HOLD]


def test_nothing_is_written_to_a_lift_that_the_tool_may_not_command_although_the_site_says_control(
    lift_simulator: LiftSimulator, site: Path, hold_door: Work
) -> None:
    async def work(client: LiftManagerClient) -> str:
        assert (await client.capabilities("main")).access == "monitor"
        return await hold_door(client)

    assert "only watched" in run_directly(site, work, name="watch")
    assert lift_simulator.writes == ()


def test_a_lift_that_the_tool_may_command_is_released_at_its_end(
    lift_simulator: LiftSimulator, site: Path, hold_door: Work
) -> None:
    assert run_directly(site, hold_door, name="poke", may_command=["main"]) == "held"
    assert holds(lift_simulator) == [True, False]


def test_presses_are_in_the_journal_where_the_tool_records_them(site: Path, hold_door: Work) -> None:
    run_directly(site, hold_door, name="poke", may_command=["main"], is_recorded=True)
    rows = call("audit", site)
    assert rows.returncode == 0
    assert "hold_door" in rows.stdout
    assert "tool" in rows.stdout


def test_without_recording_there_is_no_store(site: Path, hold_door: Work) -> None:
    run_directly(site, hold_door, name="poke", may_command=["main"])
    assert not list(site.parent.glob("kept/*.db"))


def test_a_controller_of_another_manager_is_named_in_one_sentence(
    lift_simulator: LiftSimulator, site: Path, hold_door: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    with controller_lock("127.0.0.1", lift_simulator.port), pytest.raises(typer.Exit) as ended:
        run_directly(site, hold_door, name="watch")
    assert ended.value.exit_code == 1
    said = capsys.readouterr()
    assert said.out == ""
    (sentence,) = said.err.splitlines()
    assert f"127.0.0.1:{lift_simulator.port}" in sentence
    assert sentence.endswith("without --site this works through the running manager")


def test_a_lift_is_not_commanded_at_addresses_where_another_lift_of_the_site_is(
    site: Path, hold_door: Work, lift_simulator: LiftSimulator, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads(site.read_text("utf-8"))
    for name in ("main", "other"):
        content["lifts"][name] = content["lifts"]["main"] | {"access": "monitor"}
    site.write_text(json.dumps(content), "utf-8")
    with pytest.raises(typer.Exit) as ended:
        run_directly(site, hold_door, name="tool", may_command=["main"])
    assert ended.value.exit_code == 1
    assert "other writes the same registers as main (go_to writes where go_to of main does)" in capsys.readouterr().err
    assert lift_simulator.writes == ()
    assert run_directly(site, reads, name="tool") == "read"


async def reads(client: LiftManagerClient) -> str:
    await client.lifts()
    return "read"


def test_nobody_else_can_use_its_port(site: Path) -> None:
    async def work(client: LiftManagerClient) -> list[int]:
        async with httpx.AsyncClient(base_url=client.url, trust_env=False, timeout=HANGS_S) as stranger:
            paths = ("/api/v1/lifts", "/api/v1/links/plc/frames", "/open-rmf/demo-lift/lift_state?lift_name=main")
            return [(await stranger.get(path)).status_code for path in paths]

    assert run_directly(site, work, name="watch") == [401, 401, 401]


def test_the_log_of_the_manager_is_not_mixed_into_what_the_tool_prints(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def work(_: LiftManagerClient) -> None:
        logging.getLogger("lift_manager").warning("the disk is nearly full")
        assert capsys.readouterr().err == ""

    run_directly(site, work, name="watch")
    assert capsys.readouterr().err == ""


def test_what_the_manager_has_logged_is_printed_after_the_error_of_a_tool(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def work(client: LiftManagerClient) -> None:
        logging.getLogger("lift_manager").warning("the disk is nearly full")
        await client.lift("west")

    with pytest.raises(typer.Exit):
        run_directly(site, work, name="watch")
    logged, sentence = capsys.readouterr().err.splitlines()
    assert logged.endswith("WARNING the disk is nearly full")
    assert "the lifts are main" in sentence


@each_row(("number", "times"), [(signal.SIGINT, 1), (signal.SIGINT, 3), (signal.SIGTERM, 3), (signal.SIGHUP, 1)])
def test_a_signal_releases_a_held_door_however_often_it_comes(
    lift_simulator: LiftSimulator, site: Path, number: signal.Signals, times: int
) -> None:
    before = len(holds(lift_simulator))
    with running_script(TOOL, site, cwd=site.parent) as tool:
        lift_simulator.wait_for(is_held, within_s=HANGS_S)
        for _ in range(times):
            tool.tell(number)
        # 130 for Ctrl-C; 1 as well where a busy machine could not verify the release in time
        assert tool.ended() in ((130, 1) if number is signal.SIGINT else (1,))
        assert "Traceback" not in tool.err
    # by a write: the watchdog of the controller leaves what was written as it is
    assert holds(lift_simulator)[before:] == [True, False]


def test_outputs_that_could_not_be_verified_as_released_are_an_error(
    lift_simulator: LiftSimulator, site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def work(client: LiftManagerClient) -> None:
        async with client.session("main", robot="tool") as session:
            await session.go_to("L2", hold_door=True, wait=20)
            await lift_simulator.when(is_held, within_s=HANGS_S)
            lift_simulator.begin("ignored_writes")

    with pytest.raises(typer.Exit):
        run_directly(site, work, name="poke", may_command=["main"])
    assert "not every output could be verified as released: look at the lift" in capsys.readouterr().err
