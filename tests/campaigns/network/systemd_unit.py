"""systemd's own checker reads the unit files, and that of the manager with the drop-in that a site makes."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.network import printed
from tests.support.programs import ROOT

pytestmark = pytest.mark.external("systemd-analyze")

UNITS = ROOT / "deploy" / "systemd"
UNIT = UNITS / "lift-manager.service"
OTHERS = [
    "lift-manager-hub.service",
    "lift-manager-nats.service",
    "lift-manager-leaf.service",
    "lift-manager-packet-filter.service",
]


def unit(folder: Path, *, drop_in: bool) -> Path:
    """The unit with a program that is there, in a folder of its own."""
    path = folder / UNIT.name
    path.write_text(UNIT.read_text("utf-8").replace("/opt/lift-manager/bin/python", sys.executable), "utf-8")
    if drop_in:
        (folder / f"{UNIT.name}.d").mkdir()
        made = printed(ROOT / "examples" / "two-endpoints.yaml", "--systemd", "--clients", "10.0.0.0/24")
        (folder / f"{UNIT.name}.d" / "network.conf").write_text(made, "utf-8")
    return path


def other_unit(name: str, folder: Path) -> Path:
    """The unit of a hub, of a NATS server, or of a packet filter, with programs that are there."""
    text = (UNITS / name).read_text("utf-8").replace("/opt/lift-manager/bin/python", sys.executable)
    (folder / name).write_text(text.replace("=nats-server", f"={sys.executable}"), "utf-8")
    return folder / name


def analyze(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["systemd-analyze", *words], capture_output=True, text=True, timeout=30, check=False, stdin=subprocess.DEVNULL
    )


def exposure(path: Path) -> str:
    done = analyze("security", "--offline=true", "--no-pager", path)
    (level,) = re.findall(r"Overall exposure level for \S+: (\S+)", done.stdout)
    return str(level)


@pytest.mark.parametrize("drop_in", [False, True], ids=["alone", "with a drop-in"])
def test_systemd_finds_nothing_wrong_with_the_unit(drop_in: bool, tmp_path: Path) -> None:
    done = analyze("verify", "--man=no", unit(tmp_path, drop_in=drop_in))
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("name", OTHERS)
def test_systemd_finds_nothing_wrong_with_the_other_units(name: str, tmp_path: Path) -> None:
    path = other_unit(name, tmp_path)
    done = analyze("verify", "--man=no", path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    of = "this" if name == "lift-manager-packet-filter.service" else "a hub"
    assert f"the exposure of {of} {exposure(path)}, " in (ROOT / "deploy" / "README.md").read_text("utf-8")


def test_a_word_that_systemd_does_not_know_is_found(tmp_path: Path) -> None:
    path = unit(tmp_path, drop_in=True)
    with (tmp_path / f"{UNIT.name}.d" / "network.conf").open("a", encoding="utf-8") as file:
        file.write("IPAddressAllow=nowhere\n")
    assert "nowhere" in analyze("verify", "--man=no", path).stderr


def test_the_exposure_is_what_the_readme_says(tmp_path: Path) -> None:
    alone, narrowed = tmp_path / "alone", tmp_path / "narrowed"
    for folder in (alone, narrowed):
        folder.mkdir()
    levels = exposure(unit(alone, drop_in=False)), exposure(unit(narrowed, drop_in=True))
    text = (ROOT / "deploy" / "README.md").read_text("utf-8")
    assert f"says {levels[0]}, and {levels[1]} with the drop-in" in text
