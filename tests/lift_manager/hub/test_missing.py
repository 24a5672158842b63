"""What nobody asked for is not loaded: nats-py and etcd; and without the extra `[hub]`, a site with a hub says what to install."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from lift_manager.hub.nats_server import NatsServerMissing, find_program
from tests.lift_manager.config.site_files import GENERIC
from tests.support.programs import running_script

LOADS = """
import json, sys
import lift_manager.cli.serve
loaded = {"command": list(sys.modules)}
import lift_manager.app
loaded["alone"] = list(sys.modules)
import lift_manager.hub.site_face
loaded["site of a hub"] = list(sys.modules)
import lift_manager.cli.hub, lift_manager.hub.web, lift_manager.cli.check
loaded["everything"] = list(sys.modules)
print(json.dumps(loaded))
"""
"""In one process: three would import most of it three times."""
WITHOUT = """
import sys
sys.path.insert(0, sys.argv.pop(1))
from lift_manager.cli.main import app
app()
"""


@pytest.fixture(scope="module")
def loaded() -> dict[str, list[str]]:
    """The modules that a process has loaded, by what it does."""
    done = subprocess.run([sys.executable, "-c", LOADS], check=True, capture_output=True, text=True)
    found: dict[str, list[str]] = json.loads(done.stdout)
    assert "lift_manager.hub.site_face" in found["site of a hub"]
    return found


def test_no_command_loads_it_before_it_is_needed(loaded: dict[str, list[str]]) -> None:
    assert [name for name in loaded["everything"] if name.partition(".")[0] == "nats"] == []


def test_a_manager_that_is_alone_loads_no_client_of_etcd(loaded: dict[str, list[str]]) -> None:
    assert {"httpx", "lift_manager.takeover", "lift_manager.cluster.etcd"}.isdisjoint(loaded["command"])


def test_a_manager_without_a_hub_loads_nothing_of_it(loaded: dict[str, list[str]]) -> None:
    assert [name for name in loaded["alone"] if name.startswith("lift_manager.hub")] == []


def test_a_manager_without_a_hub_loads_nothing_that_reads_certificates(loaded: dict[str, list[str]]) -> None:
    assert [name for name in loaded["alone"] if name.partition(".")[0] == "cryptography"] == []


def test_a_site_of_a_hub_that_takes_no_updates_loads_nothing_of_them(loaded: dict[str, list[str]]) -> None:
    assert [name for name in loaded["site of a hub"] if name.startswith("lift_manager.hub.update")] == []


@pytest.mark.parametrize("command", ["serve", "hub"])
def test_a_command_that_needs_it_says_what_to_install(tmp_path: Path, command: str) -> None:
    (tmp_path / "nats").mkdir()
    (tmp_path / "nats" / "__init__.py").write_text("raise ModuleNotFoundError('No module named nats')")
    (tmp_path / "password").write_text("x")
    (tmp_path / "password").chmod(0o600)
    site = yaml.safe_load(GENERIC) | {"hub": {"site": "a", "password": "password"}, "state": "kept"}
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site))
    words = {"serve": ["serve", "site.yaml", "--port", "0"], "hub": ["hub"]}[command]
    with running_script(WITHOUT, tmp_path, *words, cwd=tmp_path) as program:
        assert program.ended() == 2, program.err
        assert "it does not load (No module named nats)" in program.err
        assert "extra `hub`: pip install '.[hub]'" in program.err


def test_a_server_that_is_not_there_is_named_with_where_to_get_it() -> None:
    with pytest.raises(NatsServerMissing, match="there is no program no-such-server: get it from nats"):
        find_program("no-such-server")
