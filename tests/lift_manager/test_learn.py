"""`lift-manager learn`: the whole command, with a recording and against a controller; what it prints, writes and refuses."""

import os
import pty
import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from lift_manager.cli.main import app
from lift_manager.commissioning.learn.samples import to_json
from register_maps.load import load
from tests.lift_manager.commissioning.learn.riding import ridden
from tests.support.programs import LIFT_MANAGER, eventually, free_port, running
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled


def learned(*words: str | Path) -> Result:
    done = CliRunner().invoke(app, ["learn", *map(str, words)], env={"COLUMNS": "80", "TERM": "dumb"})
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


@pytest.fixture
def ride(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording in the folder where the command runs."""
    monkeypatch.chdir(tmp_path)
    recording = ridden(compiled("generic-registers")).recording
    recording.floors = ()
    path = tmp_path / "ride.json"
    path.write_bytes(to_json(recording))
    return path


def test_a_recording_becomes_a_draft_that_passes_maps_check(ride: Path) -> None:
    done = learned("--from-samples", ride, "-o", "East wing.yaml")
    assert done.exit_code == 0, done.output
    assert load("./East wing.yaml").map.name == "east-wing"
    assert done.stdout.splitlines()[0] == "sure: car_floor {at: 'holding:1', as: floor}"
    assert "floors of the site file: L1 = 1, L2 = 2, L3 = 3, L4 = 4" in done.stdout
    checked = CliRunner().invoke(app, ["maps", "check", "./East wing.yaml"])
    assert checked.exit_code == 0, checked.output


def test_the_order_of_the_floors_can_be_said_afterwards(ride: Path) -> None:
    done = learned("--from-samples", ride, "--floors", "L4,L3,L2,L1")
    assert done.exit_code == 0, done.output
    assert load("./draft.yaml").map.signals["motion"].values == {1: "stopped", 2: "down", 3: "up"}


def test_files_that_are_there_are_kept(ride: Path) -> None:
    Path("draft.yaml").write_text("mine")
    done = learned("--from-samples", ride)
    assert (done.exit_code, Path("draft.yaml").read_text()) == (1, "mine")
    assert "draft.yaml: there already; give another name, or --force to replace it" in done.stderr
    assert learned("--from-samples", ride, "--force").exit_code == 0


@each_row(
    ("words", "says"),
    [
        ((), "give the address of a controller"),
        (("192.0.2.1", "--from-samples", "ride.json"), "give the address of a controller"),
        (("192.0.2.1:99999",), "write HOST:PORT, such as 192.0.2.10:502"),
        (("not an address",), "write HOST:PORT"),
        (("192.0.2.1", "--from", "9", "--to", "3"), "9 is above --to 3"),
        (("192.0.2.1", "--floors", "L1,,L2"), "name every floor once"),
        (("192.0.2.1", "-o", "draft.txt"), "give the file the ending .yaml"),
        (("--from-samples", "none.json"), "none.json cannot be read"),
    ],
)  # fmt: skip
def test_a_wrong_command_line_is_refused_with_its_reason(
    words: tuple[str, ...], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = learned(*words)
    assert done.exit_code in (1, 2)
    assert says in " ".join(re.sub("[│╭╮╰╯─]", " ", done.stderr).split())


def test_a_controller_that_is_not_there_is_reported_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with running("learn", f"127.0.0.1:{free_port()}", "--yes", cwd=tmp_path) as program:
        assert program.ended() == 1
        assert "refused" in program.err
        assert "check address and port" in program.err
        assert not Path("draft.yaml").exists()


class Terminal:
    """A program at a terminal of its own, and what it shows there."""

    def __init__(self, *words: str | Path, cwd: Path) -> None:
        self.pid, self._fd = pty.fork()
        if not self.pid:  # pragma: no cover  the child
            os.chdir(cwd)
            os.environ["COLUMNS"] = "80"
            command = [*LIFT_MANAGER, *map(str, words)]
            os.execv(command[0], command)
        self.shown = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:
            while chunk := os.read(self._fd, 4096):
                self.shown += chunk.decode("utf-8", "replace")
        except OSError:  # the program has closed it
            return

    def types(self, text: str) -> None:
        os.write(self._fd, text.encode())

    def shows(self, pattern: str) -> None:
        eventually(lambda: re.search(pattern, self.shown))

    def ended(self) -> int:
        _, status = os.waitpid(self.pid, 0)
        self.pid = 0
        self._reader.join(10)
        return os.waitstatus_to_exitcode(status)

    def close(self) -> None:
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self._fd)


@contextmanager
def at_terminal(*words: str | Path, cwd: Path) -> Iterator[Terminal]:
    terminal = Terminal(*words, cwd=cwd)
    try:
        yield terminal
    finally:
        terminal.close()


@pytest.fixture
def controller() -> Iterator[str]:
    """The address of a simulated controller."""
    port = free_port()
    with running("simulate", "two-stop-agv", "--port", str(port)) as program:
        program.says("Ctrl-C ends it")
        yield f"127.0.0.1:{port}"


def test_it_says_the_risk_first_and_reads_nothing_without_a_yes(controller: str, tmp_path: Path) -> None:
    with at_terminal("learn", controller, cwd=tmp_path) as person:
        person.shows(r"begin reading from .*\[y/N\]")
        assert "It takes the controller's only slot" in " ".join(person.shown.split())
        person.types("n\n")
        assert person.ended() == 1
        assert "nothing was read" in person.shown


def test_a_person_at_a_terminal_answers_marks_and_orders_the_floors(controller: str, tmp_path: Path) -> None:
    with at_terminal("learn", controller, "--from", "0", "--to", "9", "--pause", "0.01", cwd=tmp_path) as person:
        person.shows(r"\[y/N\]")
        person.types("y\n")
        person.shows("10 addresses can be read: discrete 0 to 5, coil 0 to 3")
        person.shows("floor name at this stop")
        person.types("lower\n")
        person.shows("at lower, door open: .*still wanted: a second floor")
        person.types("upper\ndone\n")
        person.shows("the floors from the lowest to the highest")
        person.types("\n")
        assert person.ended() == 1  # the car never moved, so that there is nothing to find
        assert "a draft without a signal" in person.shown
    assert load(tmp_path / "draft.yaml").map.served


def test_ctrl_c_ends_it_at_once_and_keeps_what_was_recorded(controller: str, tmp_path: Path) -> None:
    words = ("learn", controller, "--yes", "--from", "0", "--to", "9", "--pause", "0.01", "--samples", "ride.json")
    with at_terminal(*words, cwd=tmp_path) as person:
        person.shows("floor name at this stop")
        person.types("lower\n")
        person.shows("at lower, door open")
        person.types("\x03")
        assert person.ended() == 130
        assert "nothing was written to the controller" in person.shown
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ride.json"]
    assert learned("--from-samples", tmp_path / "ride.json", "-o", tmp_path / "draft.yaml").exit_code == 1


def test_without_a_person_it_ends_and_two_at_once_are_refused(controller: str, tmp_path: Path) -> None:
    words = ("learn", controller, "--yes", "--from", "0", "--to", "9")
    with at_terminal(*words, cwd=tmp_path) as first:
        first.shows("floor name at this stop")
        with running(*words, cwd=tmp_path) as second:
            assert second.ended() == 1
            assert "stop it first: `learn` needs the connection for itself" in second.err
    with running(*words, cwd=tmp_path) as third:
        assert third.ended() == 1
        assert "a draft without a signal" in third.err
