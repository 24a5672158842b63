"""`lift-manager rmf`, `serve --rmf` and `check --building-map` at the command line."""

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from register_maps.load import MAPS
from tests.support.dds_rig import config, settings_of_test
from tests.support.programs import HANGS_S, Started, call, free_port, running, soon

SITE = """\
schema: 1
name: A building
rmf: {namespace: building1}
controllers:
  plc: {host: 127.0.0.1, port: PORT, map: generic-registers}
lifts:
  main:
    controller: plc
    access: control
    floors: {G: 1, First: 2}
    rmf: {name: Lift1, floors: {G: L1, First: L2}}
"""
NAMESPACE = ("--namespace", "building1")
BUILDING = """\
levels:
  L1: {elevation: 0}
  L2: {elevation: 8}
lifts:
  Lift1: {doors: {door: {}}, level_doors: {L1: [door], L2: [door]}}
name: hospital
"""
GRAPH = """\
levels:
  L1: {vertices: [[0, 0, {lift: Lift1}]]}
  L2: {vertices: [[0, 0.5, {lift: Lift1}]]}
lifts: {Lift1: {}}
"""
NO_CYCLONE = """\
import json, sys
sys.modules["cyclonedds"] = None  # as Python marks a package that is not to be found
from typer.testing import CliRunner
from lift_manager.cli.main import app
said = [CliRunner().invoke(app, call.split()) for call in sys.argv[1:]]
print(json.dumps([[one.exit_code, one.stderr] for one in said]))
"""


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "site.yaml").write_text(SITE.replace("PORT", str(free_port())), "utf-8")
    (tmp_path / "map.yaml").write_text(BUILDING, "utf-8")
    (tmp_path / "0.yaml").write_text(GRAPH, "utf-8")
    (tmp_path / "register-map.yaml").write_bytes((MAPS / "two-stop-agv.yaml").read_bytes())
    return tmp_path


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain of RMF that nobody else is in, for every program that is started."""
    settings = settings_of_test()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(settings.domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("CYCLONEDDS_URI", settings.cyclonedds_uri)
    assert config(settings)


def words(text: str) -> str:
    return " ".join(text.replace("│", " ").split())


def test_a_site_with_the_names_of_the_map_is_said_to_match(files: Path) -> None:
    done = call("check", files / "site.yaml", "--building-map", files / "map.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == f"{files / 'map.yaml'}: the names match: main is Lift1"


def test_names_that_do_not_match_are_mistakes_and_the_part_to_write_is_printed_ready(files: Path) -> None:
    site = files / "site.yaml"
    content = site.read_text("utf-8")
    rmf = "    rmf: {name: Lift1, floors: {G: L1, First: L2}}\n"
    site.write_text(content.replace(rmf, ""), "utf-8")
    done = call("check", site, "--building-map", files / "map.yaml")
    assert done.returncode == 2
    assert "write `rmf: {name: Lift1}` for lift main" in done.stderr
    assert done.stderr.splitlines()[-1] == "3 mistakes"
    block = done.stdout[done.stdout.index("lifts:\n") :]
    assert "      name: Lift1\n" in block
    assert "      floors: {G: L1, First: L2}\n" in block
    part = "".join(f"{line}\n" for line in block.splitlines()[2:] if line)
    site.write_text(content.replace(rmf, part), "utf-8")
    assert call("check", site, "--building-map", files / "map.yaml").returncode == 0


def test_a_door_that_closes_by_its_timer_is_told_of_where_rmf_has_the_sites_own_names(files: Path) -> None:
    site = files / "site.yaml"
    text = (
        (MAPS / "generic-registers.yaml")
        .read_text("utf-8")
        .replace("at_same_floor: open_button", "at_same_floor: call")
    )
    begin, end = text.index("  hold_door.front:"), text.index("at_floor_evidence:")
    (files / "mine.yaml").write_text(text[:begin] + text[end:], "utf-8")
    own = SITE.replace("PORT", str(free_port())).replace("map: generic-registers", "map: ./mine.yaml")
    own = own.replace("    rmf: {name: Lift1, floors: {G: L1, First: L2}}\n", "").replace(
        "{G: 1, First: 2}", "{L1: 1, L2: 2}"
    )
    site.write_text(own.replace("  main:", "  Lift1:"), "utf-8")
    assert "hold_door" not in call("check", site).stdout
    done = call("check", site, "--building-map", files / "map.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert "caution: Lift1: map generic-registers has no hold_door.front" in done.stdout


def test_a_hold_too_short_for_rmf_is_refused_in_the_same_words_wherever_the_site_is_used_with_rmf(files: Path) -> None:
    site = files / "site.yaml"
    short = SITE.replace("PORT", "5020").replace("access: control\n", "access: control\n    max_session_hold_s: 60\n")
    site.write_text(short, "utf-8")
    named = call("check", site)
    assert named.returncode == 2
    assert "lifts.main.max_session_hold_s: 60 s is less than 3 times `rmf.clear_s` (30 s)" in named.stderr

    without = short.replace("rmf: {namespace: building1}\n", "")
    without = without.replace("    rmf: {name: Lift1, floors: {G: L1, First: L2}}\n", "").replace("main:", "Lift1:")
    site.write_text(without.replace("{G: 1, First: 2}", "{L1: 1, L2: 2}"), "utf-8")
    assert call("check", site).returncode == 0
    expected = named.stderr.replace(f"{site}:10", f"{site}:9").replace("lifts.main", "lifts.Lift1")
    with socket.create_server(("127.0.0.1", 0)) as taken:  # so that nothing is served if it is not refused before
        served = call("serve", site, "--rmf", "--port", str(taken.getsockname()[1]))
    assert (served.returncode, served.stderr) == (2, expected)
    compared = call("check", site, "--building-map", files / "map.yaml")
    assert (compared.returncode, compared.stderr) == (2, expected)


def test_a_navigation_graph_is_compared_too(files: Path) -> None:
    done = call("check", files / "site.yaml", "--building-map", files / "map.yaml", "--nav-graph", files / "0.yaml")
    assert done.returncode == 2
    assert "the vertices of lift Lift1 lie 0.50 m apart" in done.stderr


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        ("check site.yaml --nav-graph 0.yaml", 2, "with --building-map"),
        ("check site.yaml --building-map none.yaml", 2, "none.yaml: there is no such file"),
        ("check map.yaml --building-map map.yaml", 2, "mistake"),
        ("check register-map.yaml --building-map map.yaml", 2, "is no site file"),
        ("rmf --domain 3 watch", 2, "lift-manager rmf watch --domain"),
        ("rmf --domain 300", 2, "232"),
        ("rmf --namespace a-b", 2, "letters, digits and _"),
        ("rmf --manager-address ftp://x", 2, "is no address"),
        ("rmf --manager-address=my|lifts", 2, "'my lifts' is no address"),
        ("rmf --adapter-id a@b", 2, "the adapter's id is 'a@b'"),
        ("rmf --key-file none", 1, "none cannot be read"),
        ("rmf request Lift1", 2, "give a floor, or --end without one"),
        ("rmf request Lift1 L1 --end", 2, "give a floor, or --end without one"),
        ("rmf request Lift1 L1 --closed", 2, "add --human"),
        ("rmf request Lift1 L1 --direct --instead-of fleet/r2", 2, "sends to the supervisor"),
        ("rmf request Lift1 --end --instead-of fleet/r2", 2, "sends to the supervisor"),
        ("rmf request Lift1 L1 --session", 2, "requires an argument"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_sentence(files: Path, given: str, code: int, said: str) -> None:
    paths = [str(files / word) if word.endswith(".yaml") else word.replace("|", " ") for word in given.split()]
    done = call(*paths)
    assert done.returncode == code
    assert said in words(done.stderr)


def test_a_domain_in_the_environment_that_is_none_is_a_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "one")
    done = call("rmf", "watch")
    assert done.returncode == 2
    assert "ROS_DOMAIN_ID is 'one'" in words(done.stderr)


def test_without_cyclone_dds_every_command_says_what_to_install(files: Path) -> None:
    commands = ["rmf", "rmf watch", "rmf request Lift1 L1", "serve site.yaml --rmf --port 0"]
    done = subprocess.run(
        [sys.executable, "-I", "-c", NO_CYCLONE, *commands],
        cwd=files,
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=True,
        env=os.environ | {"XDG_STATE_HOME": str(files)},
    )
    for code, said in json.loads(done.stdout):
        assert code == 2
        assert "Install the manager with its extra `rmf`" in said


@pytest.mark.parametrize("way", ["inside", "beside"])
def test_a_lift_moves_when_rmf_asks_for_it_and_is_offline_for_rmf_when_its_adapter_ends(
    tmp_path: Path, domain: None, way: str
) -> None:
    with Started() as start:
        plc = start("simulate", "generic-registers", "--port", "0", "--floors", "G=1,First=2", "--speed", "20")
        port = plc.says(r"127\.0\.0\.1:(\d+), unit 1")[1]
        (tmp_path / "site.yaml").write_text(SITE.replace("PORT", port), "utf-8")
        adapter = start("serve", tmp_path / "site.yaml", "--port", "0", *(["--rmf"] if way == "inside" else []))
        looking = start("rmf", "watch", "Lift1", *NAMESPACE)
        url = adapter.says(r"(http://[\d.]+:\d+)/docs")[1]
        if way == "beside":
            metrics = free_port()
            manager = ("--manager-address", url, "--metrics-port", metrics)
            adapter, url = start("rmf", *NAMESPACE, *map(str, manager)), f"http://127.0.0.1:{metrics}"
        adapter.says("Open-RMF lift adapter: ROS domain .*, /building1/lift_states and /building1/lift_requests")
        looking.says("Lift1: has the floors L1, L2")
        done = call("rmf", "request", "Lift1", "L2", "--direct", "--session", "fleet/r1", *NAMESPACE)
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.splitlines()[-2] == "Lift1: at L2, door open, stopped, AGV, held by fleet/r1"
        looking.says(r"\d\d:\d\d:\d\d\.\d{3} Lift1: fleet/r1 requests L2, door open \(AGV\), to the lift")
        looking.says("Lift1: at L2, door open, stopped, AGV, held by fleet/r1")
        with urllib.request.urlopen(f"{url}/metrics", timeout=HANGS_S) as answer:
            assert 'lift_manager_rmf_requests_total{lift="Lift1",result="begun"} 1' in answer.read().decode()
        assert adapter.stop()[0] == 0
        looking.says("Lift1: at no known floor.*OFFLINE, held by fleet/r1")
        assert looking.stop(signal.SIGINT)[0] == 0


def test_an_adapter_beside_a_manager_that_is_not_there_says_so_goes_on_and_ends_at_once(domain: None) -> None:
    def attempt() -> float:
        metrics = free_port()
        with running("rmf", "--manager-port", str(free_port()), "--metrics-port", str(metrics)) as adapter:
            adapter.says("Open-RMF lift adapter: ROS domain")
            adapter.logs("the manager does not answer: no manager answers")
            with urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics", timeout=HANGS_S) as answer:
                assert b"lift_manager_rmf_requests" in answer.read()
            code, took_s = adapter.stop()
            assert code == 0
            return took_s

    soon(attempt, 2.0)


def test_the_log_of_the_adapter_can_be_read_by_programs(domain: None) -> None:
    with running("rmf", "--manager-port", str(free_port()), "--log-format", "json") as adapter:
        line = adapter.logs(r"(\{.*does not answer.*\})")[1]
        assert json.loads(line)["level"] == "warning"
