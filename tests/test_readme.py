"""What the README, the tutorials and the demo's guide tell a newcomer to type, typed as printed; only the ports are free ones."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.dds_rig import settings_of_test
from tests.support.pages import blocks, commands
from tests.support.programs import HANGS_S, LIFT_MANAGER, ROOT, Program, Started, eventually, free_port, run, started

README = ROOT / "README.md"
FIRST_RIDE = ROOT / "docs" / "tutorial" / "first-ride.md"
FIRST_LIFT = ROOT / "docs" / "tutorial" / "first-lift.md"
OPEN_RMF = ROOT / "docs" / "how-to" / "open-rmf.md"
OURS = ".venv/bin/lift-manager "
DEMO_PORT, CONTROLLER_PORT = "5003", "5020"
ANSWERED = b'{"data":{},"success":true,"msg":""}'


@pytest.fixture
def start() -> Iterator[Started]:
    with Started() as programs:
        yield programs


def with_interpreter(command: str) -> str:
    """The same command with the interpreter of this test run, for a checkout need not have a `.venv`."""
    program = shlex.join(LIFT_MANAGER)
    return command.replace("./scripts/demo", f"{program} demo", 1)


def words(command: str) -> list[str]:
    """What a command of the program has after its name: what need not be started anew by the shell is forked."""
    program, *arguments = shlex.split(command)
    assert program == ".venv/bin/lift-manager"
    return arguments


def done(*arguments: str, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> str:
    """What the program prints, at whose end nothing is wrong."""
    ended = run(*arguments, cwd=cwd, env=env)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def shell(command: str) -> bytes:
    """What a command prints that is typed into bash."""
    ended = subprocess.run(["bash", "-c", command], capture_output=True, timeout=HANGS_S, check=False)
    assert ended.returncode == 0, ended.stderr.decode()
    return ended.stdout


def ride_by(call: str, look: str, release: str) -> None:
    """Run three curl lines the way a newcomer does: call, watch until a robot could drive, let go."""

    def data() -> dict[str, Any] | None:
        answer: dict[str, Any] = json.loads(shell(look))
        return answer["data"] if answer["success"] else None

    def state() -> dict[str, Any]:
        return eventually(data)  # on a busy machine a reading may be too old; the state recovers by itself

    assert state()["current_floor"] == "L1"
    eventually(lambda: shell(call) == ANSWERED)
    assert state()["destination_floor"] == "L2"
    eventually(lambda: (now := state())["current_floor"] == "L2" and now["door_state"] == 2, every_s=0.25)
    eventually(lambda: shell(release) == ANSWERED)
    eventually(lambda: state()["door_state"] == 0, every_s=0.25)


def test_every_command_of_the_readme_and_of_the_tutorials_is_run_by_some_test() -> None:
    run_by_test_scripts = ["./scripts/test"]
    demo, *curls = commands(README)[:-1]
    assert (demo, commands(README)[-1:]) == ("./scripts/demo", run_by_test_scripts)
    assert len(curls) == len(commands(README, "curl ")) == 3
    for page, number in ((FIRST_RIDE, 2), (FIRST_LIFT, 3), (OPEN_RMF, 5)):
        assert len(commands(page)) == len(commands(page, OURS)) == number


@pytest.mark.external("curl")
def test_the_curl_lines_of_the_readme_and_of_the_demos_guide_make_the_ride_that_they_promise(start: Started) -> None:
    (demo,) = commands(README, "./scripts/demo")
    assert f"`{demo} --speed 10`" in README.read_text("utf-8")
    program = typed(start, f"{with_interpreter(demo)} --speed 10 --port 0")
    program.says("Ctrl-C ends the demo")
    address = program.says(r"http://(127\.0\.0\.1:\d+)/docs")[1]
    printed = re.findall(r"^ *(curl .*)$", program.out, re.MULTILINE)
    assert printed == [line.replace(f"127.0.0.1:{DEMO_PORT}", address) for line in commands(README, "curl ")]
    call, look, release = printed
    ride_by(call, look, release)
    assert f"http://127.0.0.1:{DEMO_PORT}/docs" in README.read_text("utf-8")
    assert b"<title>" in shell(f"curl http://{address}/docs")
    (ride,) = commands(FIRST_RIDE, f"{OURS}ride ")
    ridden = done(*words(ride), "--manager", f"http://{address}")
    assert ridden.index("enter") < ridden.index("stay") < ridden.index("leave")
    three_lines = textwrap.indent(
        blocks(FIRST_RIDE, "python")[0].replace("Client()", f"Client('http://{address}')"), "    "
    )
    code = f"import asyncio\nfrom lift_manager.client import LiftManagerClient\nasync def main():\n{three_lines}\nasyncio.run(main())"
    looked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=HANGS_S)
    assert [line.split()[0] for line in looked.stdout.splitlines()] == ["lift", "tower", "goods"]


@pytest.mark.external("curl")
def test_the_first_lift_is_simulated_checked_and_served(start: Started, tmp_path: Path) -> None:
    simulate, check, serve = commands(FIRST_LIFT)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    site, port = tmp_path / "examples" / "first-site.yaml", str(free_port())
    for known in (simulate, site.read_text("utf-8")):
        assert known.count(CONTROLLER_PORT) == 1
    site.write_text(site.read_text("utf-8").replace(CONTROLLER_PORT, port), "utf-8")

    controller = start(*words(simulate.replace(CONTROLLER_PORT, port)))
    controller.says("Ctrl-C ends it")
    assert "Floors: G = 1, First = 2, Second = 3" in controller.out
    assert done(*words(check), cwd=tmp_path).splitlines()[-1] == "examples/first-site.yaml: no mistakes"
    manager = start(*words(serve), "--port", "0", cwd=tmp_path)
    base = manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1] + "/open-rmf/demo-lift"
    # nothing is shown, and every request refused, while a busy machine does not read the lift in time
    shown = eventually(lambda: json.loads(shell(f"curl '{base}/lift_state?lift_name=main'"))["data"])
    assert shown == {
        "available_floors": ["G", "First", "Second"],
        "current_floor": "G",
        "destination_floor": "G",
        "door_state": 0,
        "motion_state": 0,
    }
    call = f"""curl -X POST '{base}/lift_request?lift_name=main' -d '{{"floor": "First", "door_state": 0}}'"""
    eventually(lambda: shell(call) == ANSWERED)
    assert manager.stop()[0] == 0
    assert controller.stop()[0] == 0


def test_the_first_lift_is_named_as_on_the_building_map_and_moved_by_rmf(start: Started, tmp_path: Path) -> None:
    compare, serve, *asks, watch = commands(OPEN_RMF)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    site, port = tmp_path / "examples" / "rmf" / "site.yaml", str(free_port())
    assert blocks(OPEN_RMF, "yaml")[0] in site.read_text("utf-8")
    site.write_text(site.read_text("utf-8").replace(CONTROLLER_PORT, port), "utf-8")
    compared = run(*words(compare), cwd=tmp_path)
    assert compared.returncode == 2
    suggested = yaml.safe_load(compared.stdout.partition("# to be written")[2].partition("\n")[2])
    rmf = yaml.safe_load(site.read_text("utf-8"))["lifts"]["main"]["rmf"]
    assert suggested == {"lifts": {"main": {"rmf": rmf}}}

    simulate = commands(FIRST_LIFT, f"{OURS}simulate ")[0]
    controller = start(*words(simulate.replace(CONTROLLER_PORT, port)), "--speed", "10")
    controller.says("Ctrl-C ends it")
    own = settings_of_test()
    here = {
        "ROS_DOMAIN_ID": str(own.domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "CYCLONEDDS_URI": own.cyclonedds_uri,
    }
    manager = start(*words(serve), "--port", "0", cwd=tmp_path, env=here)
    manager.says("/docs")
    watching = start(*words(watch), env=here)
    watching.says("Lift1: at L1, door closed, stopped, HUMAN, free")
    for ask in asks:
        done(*words(ask), cwd=tmp_path, env=here)
    watching.says("Lift1: at L3, door open, stopped, AGV, held by lift-manager")
    for program in (watching, manager, controller):
        program.stop()


@pytest.mark.external("mbpoll")
def test_the_mbpoll_line_of_the_first_lift_reads_the_simulated_lift(start: Started) -> None:
    (line,) = re.findall(r"`(mbpoll [^`]*)`", FIRST_LIFT.read_text("utf-8"))
    port = str(free_port())
    simulate = commands(FIRST_LIFT, f"{OURS}simulate ")[0]
    start(*words(simulate.replace(CONTROLLER_PORT, port))).says("Ctrl-C ends it")
    assert line.count(CONTROLLER_PORT) == 1
    assert re.search(rb"\[1\]:\s+1\s", shell(line.replace(CONTROLLER_PORT, port))), "the car stands at code 1"


def typed(start: Started, command: str, cwd: Path | None = None) -> Program:
    """A command that keeps running, as typed into bash."""
    return start.enter_context(started("bash", "-c", f"exec {command}", cwd=cwd))


def test_the_site_file_of_the_first_lift_is_the_one_in_the_examples() -> None:
    (site,) = blocks(FIRST_LIFT, "yaml")
    assert site == (ROOT / "examples" / "first-site.yaml").read_text("utf-8")


def test_the_scenario_of_the_first_ride_ends_as_it_should() -> None:
    (scenario,) = commands(FIRST_RIDE, f"{OURS}scenario ")
    assert "FAILED" not in done(*words(scenario), cwd=ROOT)
