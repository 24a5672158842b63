"""`lift-manager init` and `doctor` as commands, against a simulated controller that listens on a port."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import gettempdir

import pytest
import yaml

from drivers.errors import ControllerTaken
from drivers.modbus.controller_lock import controller_lock
from tests.support.forked import Forked
from tests.support.programs import HANGS_S, Started, call, eventually, free_port
from tests.support.rows import each_row

SLOW = {
    "too-slow",
    "slow",
    "late-answers",
    "silent-reads",
    "unstable",
    "drops-idle",
    "heartbeat-slow",
    "heartbeat-still",
}
"""What a controller is found to be on a busy computer, whatever it is."""


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A simulated lift of generic-registers, in a process of its own."""
    with Started() as start:
        simulated = start("simulate", "generic-registers", "--port", "0")
        yield int(simulated.says(r"127\.0\.0\.1:(\d+), unit 1")[1])


def init(file: Path, port: int, *more: str) -> subprocess.CompletedProcess[str]:
    floors = "G=1,First=2,2=3"
    return call("init", file, "--host", f"127.0.0.1:{port}", "--map", "generic-registers", "--floors", floors, *more)


def is_taken(port: int) -> bool:
    """Whether a process has the lock of the controller."""
    try:
        with controller_lock("127.0.0.1", port):
            return False
    except ControllerTaken:
        return True


def taken_last_by(port: int) -> str:
    """The id of the process that took the lock of the controller last: an attempt to take it could turn that one away."""
    file = Path(gettempdir()) / f"lift-manager-{os.getuid()}" / f"127.0.0.1_{port}.lock"
    return file.read_text("utf-8") if file.exists() else ""


def codes(printed: str) -> set[str]:
    return set(re.findall(r"\[([a-z-]+)\]$", printed, re.MULTILINE))


def test_init_shows_the_lift_writes_the_file_and_check_accepts_it(port: int, tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    done = init(file, port)
    assert done.returncode == 0, done.stderr
    assert "main: car at G, door closed, stopped" in done.stdout
    assert f"  lift-manager doctor {file}" in done.stdout
    written = yaml.safe_load(file.read_text("utf-8"))
    assert written["lifts"]["main"] == {
        "controller": "plc",
        "access": "monitor",
        "floors": {"G": 1, "First": 2, "2": 3},
    }
    assert file.read_text("utf-8").count("#") > 4
    checked = call("check", file)
    assert checked.returncode == 0, checked.stderr


def test_init_replaces_a_file_only_when_told_to(tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    file.write_text("mine")
    refused = init(file, 9, "--offline")
    assert (refused.returncode, file.read_text("utf-8")) == (1, "mine")
    assert "--force" in refused.stderr
    assert init(file, 9, "--offline", "--force").returncode == 0
    assert file.read_text("utf-8") != "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["site.yaml"]


def test_init_writes_the_file_of_a_controller_that_is_off(tmp_path: Path) -> None:
    done = init(tmp_path / "site.yaml", free_port())
    assert done.returncode == 0
    assert "ERROR plc: it refuses the connection" in done.stdout


@each_row(
    "words, reason",
    [
        (("--map", "generic-registers", "--floors", "G=1,L1=2"), "Invalid value for --host: is needed"),
        (("--host", "a/b", "--map", "generic-registers", "--floors", "G=1,L1=2"), "neither a site file"),
        (("--host", "plc", "--map", "generic-registers"), "Invalid value for --floors: is needed"),
        (("--host", "plc", "--map", "generic-registers", "--floors", "G=1"), "two floors or more"),
        (("--host", "plc", "--map", "generic-coils", "--floors", "G=0,L1=8"), "codes 0 to 7"),
        (("--host", "plc", "--map", "generic-coil", "--floors", "G=0,L1=8"), "did you mean `generic-coils`"),
        (("--host", "plc", "--map", "adam-pushbutton", "--floors", "G=0,L1=1"), "needs a second device"),
        (("--host", "plc", "--map", "seer-generic", "--floors", "G=1,L1=2"), "dest_floor is needed"),
        (("--host", "plc", "--map", "generic-coils", "--floors", "G=0,L1=1", "--set", "x=1"), "has none"),
        (("--host", "plc", "--map", "generic-coils", "--floors", "G=0,L1=1", "--lift", "ä"), "the name of a lift"),
    ],
)
def test_init_says_what_is_missing_or_wrong_and_writes_nothing(
    words: tuple[str, ...], reason: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("init")
    done = call("init", folder / "site.yaml", "--offline", *words)
    assert done.returncode == 2, done
    assert reason in re.sub(r"[\s│]+", " ", done.stderr), done.stderr
    assert list(folder.iterdir()) == []


def test_init_names_a_map_of_ones_own_by_its_path_from_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sites").mkdir()
    (tmp_path / "maps").mkdir()
    shown = Path(__file__).parents[2] / "register_maps" / "maps" / "generic-registers.yaml"
    (tmp_path / "maps" / "mine.yaml").write_text(
        shown.read_text("utf-8").replace("name: generic-registers", "name: mine")
    )
    monkeypatch.chdir(tmp_path)
    words = ("--host", "plc", "--map", "maps/mine.yaml", "--floors", "G=1,L1=2", "--offline")
    assert call("init", "sites/site.yaml", *words).returncode == 0
    assert (
        yaml.safe_load((tmp_path / "sites" / "site.yaml").read_text("utf-8"))["controllers"]["plc"]["map"]
        == "../maps/mine.yaml"
    )
    assert call("check", "sites/site.yaml").returncode == 0


class Person:
    """Somebody at a terminal, who answers what is asked."""

    def __init__(self, *words: str, folder: Path) -> None:
        self._near, far = pty.openpty()
        self.printed = ""
        self._read_up_to = 0
        self.process = Forked(words, env=os.environ | {"TERM": "dumb"}, stdin=far, out=far, err=far, cwd=folder)
        os.close(far)

    def read_until(self, text: str) -> None:
        ends_at = time.monotonic() + HANGS_S
        while text not in self.printed[self._read_up_to :]:
            assert time.monotonic() < ends_at, self.printed
            if select.select([self._near], [], [], 1.0)[0]:
                self.printed += os.read(self._near, 4096).decode()
        self._read_up_to = self.printed.index(text, self._read_up_to) + len(text)

    def answer(self, question: str, text: str) -> None:
        self.read_until(question)
        os.write(self._near, f"{text}\n".encode())

    def ended(self) -> int:
        reader = threading.Thread(target=self._drain, daemon=True)
        reader.start()
        code = self.process.wait(HANGS_S)
        reader.join(HANGS_S)
        return code

    def _drain(self) -> None:
        try:
            while data := os.read(self._near, 4096):
                self.printed += data.decode()
        except OSError:
            return  # the terminal is closed with its last user

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(HANGS_S)
        os.close(self._near)


@pytest.fixture
def people() -> Iterator[list[Person]]:
    found: list[Person] = []
    yield found
    for person in found:
        person.close()


def test_a_person_at_a_terminal_is_asked_for_everything_and_asked_again(
    port: int, tmp_path: Path, people: list[Person]
) -> None:
    person = Person("init", folder=tmp_path)
    people.append(person)
    person.answer("Address of the controller", "192.0.2.10:99999")
    person.answer("neither a site file", "")
    person.answer("Address of the controller", f"127.0.0.1:{port}")
    person.read_until("generic-registers: Generic lift controller")
    person.answer("Map:", "generic-register")
    person.read_until("did you mean `generic-registers`")
    person.answer("Map:", "generic-registers")
    person.answer("Name of the lift [main]:", "")
    person.answer("Name of the building [My site]:", "Clinic")
    person.answer("Floors", "G=1")
    person.read_until("two floors or more")
    person.answer("Floors", "G=0,First=1")
    person.read_until("code 0")
    person.answer("Floors", "G=1,First=2")
    person.read_until("car at G")
    assert person.ended() == 0
    assert yaml.safe_load((tmp_path / "site.yaml").read_text("utf-8"))["name"] == "Clinic"


def test_ctrl_c_ends_doctor_at_once(port: int, tmp_path: Path, people: list[Person]) -> None:
    before = taken_last_by(port)
    person = Person("doctor", f"127.0.0.1:{port}", "--map", "generic-registers", "--seconds", "3000", folder=tmp_path)
    people.append(person)
    eventually(lambda: taken_last_by(port) != before)
    person.process.send_signal(signal.SIGINT)
    assert person.ended() == 2
    assert "stopped; nothing was written" in person.printed
    assert not is_taken(port)


def test_doctor_reads_a_site_prints_a_line_per_finding_and_keeps_it_for_later(port: int, tmp_path: Path) -> None:
    file, kept = tmp_path / "site.yaml", tmp_path / "as-left.json"
    init(file, port, "--offline")
    done = call("doctor", file, "--seconds", "2")
    assert codes(done.stdout) - SLOW == {"never-changed"}
    assert "plc at 127.0.0.1:" in done.stdout
    assert "main: car at G, door closed" in done.stdout
    data = call("doctor", file, "--seconds", "2", "--json")
    assert data.returncode == done.returncode or codes(done.stdout) & SLOW
    kept.write_text(data.stdout)
    assert json.loads(data.stdout)["lifts"]["main"]["map"] == "generic-registers"
    again = call("doctor", file, "--seconds", "2", "--against", kept)
    assert again.returncode == ("Nothing differs from the earlier run." not in again.stdout)
    assert "the map was changed" not in again.stdout


def test_doctor_at_an_address_finds_the_wrong_map_and_exits_with_1(port: int) -> None:
    done = call("doctor", f"127.0.0.1:{port}", "--map", "generic-coils", "--seconds", "1")
    assert done.returncode == 1
    assert "table-refused" in codes(done.stdout)


def test_doctor_finds_a_port_where_nothing_listens(tmp_path: Path) -> None:
    done = call("doctor", f"127.0.0.1:{free_port()}", "--map", "generic-registers")
    assert done.returncode == 1
    assert codes(done.stdout) == {"refused"}
    assert done.stdout.endswith("1 error to be dealt with.\n")
    assert list(tmp_path.iterdir()) == []


def test_doctor_without_a_map_says_that_it_looked_only_at_the_connection(port: int) -> None:
    done = call("doctor", f"127.0.0.1:{port}", "--seconds", "1")
    assert "what its registers mean was not looked at (--map MAP)" in done.stdout or codes(done.stdout) & SLOW


def test_the_risk_of_a_probe_is_printed_before_it_is_made(port: int) -> None:
    done = call("doctor", f"127.0.0.1:{port}", "--map", "generic-registers", "--seconds", "1", "--probe", "slot")
    assert done.stderr.startswith("probe slot: opens up to 3 more connections; a controller may drop another client")
    assert "slots" in codes(done.stdout) or codes(done.stdout) & SLOW


def test_a_simulated_controller_says_that_it_is_simulated(port: int) -> None:
    done = call("doctor", f"127.0.0.1:{port}", "--map", "generic-registers", "--seconds", "1", "--probe", "identity")
    assert done.stderr.startswith("probe identity: asks for vendor, product code and revision with function 43")
    assert "vendor lift-manager, product code simulated generic-registers, revision " in done.stdout


def test_doctor_stays_off_a_controller_that_a_manager_has(port: int) -> None:
    with controller_lock("127.0.0.1", port):
        done = call("doctor", f"127.0.0.1:{port}", "--map", "generic-registers", "--seconds", "1")
    assert done.returncode == 2
    assert "is driven by process" in done.stderr
    assert done.stdout == ""


@each_row(
    "words, reason",
    [
        (("a/b",), "neither a site file that exists nor an address"),
        (("none.yaml",), "there is no such file"),
        (("plc:502", "--probe", "offst"), "did you mean `offset`?"),
        (("plc:502", "--map", "none"), "no map has this name"),
        (("plc:502", "--against", "none.json"), "none.json: No such file"),
        (("plc:0",), "neither a site file"),
    ],
)
def test_what_cannot_run_exits_with_2(words: tuple[str, ...], reason: str) -> None:
    done = call("doctor", *words)
    assert done.returncode == 2
    assert reason in re.sub(r"[\s│]+", " ", done.stderr), done.stderr
