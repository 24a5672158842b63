"""Without the extra `[hub]`: nothing of the product loads nats-py, and a site with a hub says what to install."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from lift_manager.hub.nats_server import NatsServerMissing, find_program
from tests.lift_manager.config.site_files import GENERIC

LOADED = """
import sys
import lift_manager.app, lift_manager.cli.serve, lift_manager.cli.hub, lift_manager.hub.web, lift_manager.cli.check
assert not [name for name in sys.modules if name.partition(".")[0] == "nats"]
"""
ALONE = """
import sys
import lift_manager.app, lift_manager.cli.serve
assert not [name for name in sys.modules if name.startswith("lift_manager.hub")]
"""
WITHOUT_UPDATES = """
import sys
import lift_manager.app, lift_manager.cli.serve, lift_manager.hub.site_face
assert not [name for name in sys.modules if name.startswith("lift_manager.hub.update")]
"""
WITHOUT = """
import sys
sys.path.insert(0, sys.argv.pop(1))
from lift_manager.cli.main import app
app()
"""


def test_no_command_loads_it_before_it_is_needed() -> None:
    subprocess.run([sys.executable, "-c", LOADED], check=True)


def test_a_manager_without_a_hub_loads_nothing_of_it() -> None:
    subprocess.run([sys.executable, "-c", ALONE], check=True)


def test_a_site_of_a_hub_that_takes_no_updates_loads_nothing_of_them() -> None:
    subprocess.run([sys.executable, "-c", WITHOUT_UPDATES], check=True)


@pytest.mark.parametrize("command", ["serve", "hub"])
def test_a_command_that_needs_it_says_what_to_install(tmp_path: Path, command: str) -> None:
    (tmp_path / "nats").mkdir()
    (tmp_path / "nats" / "__init__.py").write_text("raise ModuleNotFoundError('No module named nats')")
    (tmp_path / "password").write_text("x")
    (tmp_path / "password").chmod(0o600)
    site = yaml.safe_load(GENERIC) | {"hub": {"site": "a", "password": "password"}, "state": "kept"}
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site))
    words = {"serve": ["serve", "site.yaml", "--port", "0"], "hub": ["hub"]}[command]
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT, str(tmp_path), *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert "it does not load (No module named nats)" in ended.stderr
    assert "extra `hub`: pip install '.[hub]'" in ended.stderr


def test_a_server_that_is_not_there_is_named_with_where_to_get_it() -> None:
    with pytest.raises(NatsServerMissing, match="there is no program no-such-server: get it from nats"):
        find_program("no-such-server")
