"""What the README and the demo's guide tell a newcomer to type, typed as printed; only the ports are free ones."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.dds_rig import settings_of_test
from tests.support.programs import LIFT_MANAGER, ROOT, Program, Started, eventually, free_port, started

README = (ROOT / "README.md").read_text("utf-8")
DEMO_PORT, CONTROLLER_PORT = "5003", "5020"
DONE = b'{"data":{},"success":true,"msg":""}'


@pytest.fixture
def start() -> Iterator[Started]:
    with Started() as programs:
        yield programs


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


COMMANDS = [line for block in blocks("sh") for line in block.splitlines() if line]


def commands(start: str) -> list[str]:
    return [command for command in COMMANDS if command.startswith(start)]


def with_interpreter(command: str) -> str:
    """The same command with the interpreter of this test run, for a checkout need not have a `.venv`."""
    program = shlex.join(LIFT_MANAGER)
    return command.replace("./scripts/demo", f"{program} demo", 1).replace(".venv/bin/lift-manager", program, 1)


def shell(command: str) -> bytes:
    """What a command prints that is typed into bash."""
    done = subprocess.run(["bash", "-c", command], capture_output=True, timeout=30, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def ride_by(call: str, look: str, release: str) -> None:
    """Run three curl lines the way a newcomer does: call, watch until a robot could drive, let go."""

    def state() -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(shell(look))
        assert answer["success"], answer
        data: dict[str, Any] = answer["data"]
        return data

    assert state()["current_floor"] == "L1"
    assert shell(call) == DONE
    assert state()["destination_floor"] == "L2"
    eventually(lambda: (state()["current_floor"], state()["door_state"]) == ("L2", 2), 10)
    assert shell(release) == DONE
    eventually(lambda: state()["door_state"] == 0, 10)


def test_every_command_of_the_readme_is_run_by_some_test() -> None:
    run_here = [*commands("./scripts/demo"), *commands("curl "), *commands(".venv/bin/lift-manager ")]
    run_by_test_scripts = ["./scripts/test"]
    assert sorted(COMMANDS) == sorted([*run_here, *run_by_test_scripts])
    assert [len(commands(start)) for start in ("./scripts/demo", "curl ", ".venv/bin/lift-manager ")] == [1, 3, 10]


@pytest.mark.external("curl")
def test_the_curl_lines_of_the_readme_and_of_the_demos_guide_make_the_ride_that_they_promise(start: Started) -> None:
    (demo,) = commands("./scripts/demo")
    assert f"`{demo} --speed 10`" in README
    program = typed(start, f"{with_interpreter(demo)} --speed 10 --port 0")
    program.says("Ctrl-C ends the demo")
    address = program.says(r"http://(127\.0\.0\.1:\d+)/docs")[1]
    printed = re.findall(r"^ *(curl .*)$", program.out, re.MULTILINE)
    assert printed == [line.replace(f"127.0.0.1:{DEMO_PORT}", address) for line in commands("curl ")]
    call, look, release = printed
    ride_by(call, look, release)
    assert f"http://127.0.0.1:{DEMO_PORT}/docs" in README
    assert b"<title>" in shell(f"curl http://{address}/docs")
    ride = commands(".venv/bin/lift-manager ride ")[0]
    ridden = shell(f"{with_interpreter(ride)} --manager http://{address}").decode()
    assert ridden.index("enter") < ridden.index("stay") < ridden.index("leave")
    three_lines = textwrap.indent(blocks("python")[0].replace("Client()", f"Client('http://{address}')"), "    ")
    code = f"import asyncio\nfrom lift_manager.client import LiftManagerClient\nasync def main():\n{three_lines}\nasyncio.run(main())"
    looked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=20)
    assert [line.split()[0] for line in looked.stdout.splitlines()] == ["lift", "tower", "goods"]


@pytest.mark.external("curl")
def test_the_readmes_lift_of_its_own_is_simulated_checked_and_served(start: Started, tmp_path: Path) -> None:
    simulate, check, serve, *_ = commands(".venv/bin/lift-manager ")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    site, port = tmp_path / "examples" / "first-site.yaml", str(free_port())
    for known in (simulate, site.read_text("utf-8")):
        assert known.count(CONTROLLER_PORT) == 1
    site.write_text(site.read_text("utf-8").replace(CONTROLLER_PORT, port), "utf-8")

    controller = typed(start, with_interpreter(simulate).replace(CONTROLLER_PORT, port))
    controller.says("Ctrl-C ends it")
    assert "Floors: G = 1, First = 2, Second = 3" in controller.out
    checked = shell(f"cd {shlex.quote(str(tmp_path))} && {with_interpreter(check)}").decode()
    assert checked.splitlines()[-1] == "examples/first-site.yaml: no mistakes"
    manager = typed(start, f"{with_interpreter(serve)} --port 0", cwd=tmp_path)
    base = manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1] + "/open-rmf/demo-lift"
    answer = json.loads(shell(f"curl '{base}/lift_state?lift_name=main'"))
    assert answer["data"] == {
        "available_floors": ["G", "First", "Second"],
        "current_floor": "G",
        "destination_floor": "G",
        "door_state": 0,
        "motion_state": 0,
    }
    assert (
        shell(f"""curl -X POST '{base}/lift_request?lift_name=main' -d '{{"floor": "First", "door_state": 0}}'""")
        == DONE
    )
    assert manager.stop()[0] == 0
    assert controller.stop()[0] == 0


def test_the_readmes_lift_is_named_as_on_the_building_map_and_moved_by_rmf(start: Started, tmp_path: Path) -> None:
    compare, serve, *asks, watch = commands(".venv/bin/lift-manager ")[4:9]
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    site, port = tmp_path / "examples" / "rmf" / "site.yaml", str(free_port())
    assert blocks("yaml")[1] in site.read_text("utf-8")
    site.write_text(site.read_text("utf-8").replace(CONTROLLER_PORT, port), "utf-8")
    compared = subprocess.run(
        ["bash", "-c", with_interpreter(compare)], capture_output=True, timeout=20, check=False, cwd=tmp_path
    )
    assert compared.returncode == 2
    suggested = yaml.safe_load(compared.stdout.decode().partition("# to be written")[2].partition("\n")[2])
    rmf = yaml.safe_load(site.read_text("utf-8"))["lifts"]["main"]["rmf"]
    assert suggested == {"lifts": {"main": {"rmf": rmf}}}

    simulate = commands(".venv/bin/lift-manager simulate ")[0]
    controller = typed(start, f"{with_interpreter(simulate).replace(CONTROLLER_PORT, port)} --speed 10")
    controller.says("Ctrl-C ends it")
    own = settings_of_test()
    uri = shlex.quote(own.cyclonedds_uri)
    here = f"env ROS_DOMAIN_ID={own.domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST CYCLONEDDS_URI={uri} "
    manager = typed(start, f"{here}{with_interpreter(serve)} --port 0", cwd=tmp_path)
    manager.says("/docs")
    watching = typed(start, here + with_interpreter(watch))
    watching.says("Lift1: at L1, door closed, stopped, HUMAN, free")
    for ask in asks:
        done = subprocess.run(
            ["bash", "-c", here + with_interpreter(ask)], capture_output=True, timeout=40, check=False, cwd=tmp_path
        )
        assert done.returncode == 0, done.stdout + done.stderr
    watching.says("Lift1: at L3, door open, stopped, AGV, held by lift-manager")
    for program in (watching, manager, controller):
        program.stop()


@pytest.mark.external("mbpoll")
def test_the_mbpoll_line_of_the_readme_reads_the_simulated_lift(start: Started) -> None:
    (line,) = re.findall(r"`(mbpoll [^`]*)`", README)
    port = str(free_port())
    simulate = commands(".venv/bin/lift-manager simulate ")[0]
    typed(start, with_interpreter(simulate).replace(CONTROLLER_PORT, port)).says("Ctrl-C ends it")
    assert line.count(CONTROLLER_PORT) == 1
    assert re.search(rb"\[1\]:\s+1\s", shell(line.replace(CONTROLLER_PORT, port))), "the car stands at code 1"


def typed(start: Started, command: str, cwd: Path | None = None) -> Program:
    """A command that keeps running, as typed into bash."""
    return start.enter_context(started("bash", "-c", f"exec {command}", cwd=cwd))


def test_the_site_file_in_the_readme_is_the_one_in_the_examples() -> None:
    (site,) = (block for block in blocks("yaml") if block.startswith("schema:"))
    assert site == (ROOT / "examples" / "first-site.yaml").read_text("utf-8")


def test_every_relative_link_of_the_readme_leads_to_a_file() -> None:
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if link and not (ROOT / link).is_file()] == []


def test_the_readmes_scenario_ends_as_it_should() -> None:
    (scenario,) = commands(".venv/bin/lift-manager scenario ")
    assert b"FAILED" not in shell(f"cd {shlex.quote(str(ROOT))} && {with_interpreter(scenario)}")
