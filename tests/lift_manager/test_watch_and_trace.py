"""`watch`, `trace` and `simulate --replay` at the command line: through a running manager, on their own, in a pipe, at a terminal."""

import csv
import fcntl
import json
import os
import pty
import re
import select
import signal
import socket
import struct
import subprocess
import termios
import time
from pathlib import Path

import pytest

from lift_manager.lab.bench import LiftSimulator, LiftSite
from lift_manager.lab.replay import replayed
from tests.support.programs import HANGS_S, LIFT_MANAGER, call, eventually, run, running

pytestmark = pytest.mark.lift("main", floors={"L1": 1, "L2": 2, "L3": 3}, max_age_s=10)

PLACES = "car_floor", "door.front"


def site_file(folder: Path, port: int) -> Path:
    """A site that only watches the lift on this port."""
    lift = {"controller": "plc", "floors": {"L1": 1, "L2": 2, "L3": 3}, "poll_s": 0.1, "max_age_s": 10}
    content = {
        "schema": 1,
        "name": "One lift",
        "controllers": {"plc": {"host": "127.0.0.1", "port": port, "map": "generic-registers"}},
        "lifts": {"main": lift},
    }
    file = folder / f"site-{port}.yaml"
    file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
    return file


# -- watch


def test_the_table_shows_every_signal_with_both_addresses_and_the_car(lift_site: LiftSite) -> None:
    done = call("watch", "main", "--once", "--manager", lift_site.address)
    assert done.returncode == 0, done
    headline, *_ = done.stdout.splitlines()
    assert headline.startswith("main: live (")
    assert re.search(r"^  L1  \[\|\|\] front closed, stopped$", done.stdout, re.MULTILINE)
    assert re.search(r"^door\.front +closed +1 holding:3 +holding 3 +\d+\.\d ok +-", done.stdout, re.MULTILINE)
    assert re.search(r"^level +yes +1 holding:5\.2 +holding 5\.2 ", done.stdout, re.MULTILINE)
    assert "\x1b" not in done.stdout


def test_it_watches_a_controller_without_a_manager_and_writes_nothing(
    lift_simulator: LiftSimulator, tmp_path: Path
) -> None:
    done = call("watch", "main", "--once", "--signal", "door.front", "--site", site_file(tmp_path, lift_simulator.port))
    assert done.returncode == 0, done
    assert "door.front" in done.stdout
    assert "car_floor" not in done.stdout.replace("floor", "")
    assert done.stderr == ""
    assert lift_simulator.writes == ()


def test_an_old_table_is_an_error_that_says_so_in_words(lift_site: LiftSite, lift_simulator: LiftSimulator) -> None:
    lift_site.modbus_faults().silence()
    lift_site.wait_for(lambda state: state.quality == "offline", within_s=HANGS_S)
    done = call("watch", "main", "--once", "--manager", lift_site.address)
    assert done.returncode == 1
    assert done.stdout.startswith("!!! main: OFFLINE, the values are OLD")
    assert "nobody knows where the car is" in done.stdout
    assert re.search(r"^door\.front +\(closed\) .* OLD ", done.stdout, re.MULTILINE)


def test_unknown_lifts_and_signals_are_named_with_those_there_are(lift_site: LiftSite) -> None:
    here = ("--once", "--manager", lift_site.address)
    assert "the lifts are main" in call("watch", "west", *here).stderr
    unknown = call("watch", "main", "--signal", "door.frnt", *here)
    assert unknown.returncode == 1
    assert "main has no signal 'door.frnt'" in unknown.stderr
    assert "door.front" in unknown.stderr


def test_in_a_pipe_each_change_is_a_line_and_a_row_of_the_recording(
    lift_site: LiftSite, lift_simulator: LiftSimulator, tmp_path: Path
) -> None:
    file = tmp_path / "changes.csv"
    chosen = [word for name in PLACES for word in ("--signal", name)]
    with running("watch", "main", *chosen, "--record", file, "--manager", lift_site.address) as watch:
        watch.says(r"main door\.front closed \(holding:3 = holding 3 on the wire, raw 1\)")
        lift_simulator.press_car("L2")
        watch.says(r"main car_floor L2, was L1 \(holding:1")
        assert watch.stop(signal.SIGINT)[0] == 0
        assert "\x1b" not in watch.out
        assert watch.err == ""
        assert "alive" not in watch.out
    with file.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    floors = [row for row in rows if row["signal"] == "car_floor"]
    assert [(row["value"], row["raw"], row["address"], row["wire"]) for row in floors] == [
        ("L1", "1", "holding:1", "holding 1"),
        ("L2", "2", "holding:1", "holding 1"),
    ]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", floors[0]["time"])
    assert call("watch", "main", "--once", "--record", tmp_path / "b.csv").returncode == 2
    again = call("watch", "main", "--record", file, "--manager", lift_site.address)
    assert again.returncode == 1
    assert again.stderr.startswith(f"{file}: there already; ")


class Terminal:
    """`lift-manager` at a terminal of 80 columns."""

    def __init__(self, *words: str, rows: int = 30) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, 80, 0, 0))
        env = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES", "NO_COLOR")}
        env["TERM"] = "xterm"
        self.process = subprocess.Popen(
            [*LIFT_MANAGER, *words], stdin=slave, stdout=slave, stderr=slave, env=env, start_new_session=True
        )
        os.close(slave)
        self._bytes = b""

    def until(self, pattern: str) -> str:
        """Read until this was printed; return everything."""
        ends = time.monotonic() + HANGS_S
        while not re.search(pattern, self.text):
            assert time.monotonic() < ends, self.text
            if select.select([self._master], [], [], 1.0)[0] and not self._read():
                raise AssertionError(self.text)
        return self.text

    def rest(self) -> str:
        while self._read():
            pass
        os.close(self._master)
        return self.text

    @property
    def text(self) -> str:
        return self._bytes.decode("utf-8", "replace")

    def _read(self) -> bool:
        try:
            data = os.read(self._master, 65536)
        except OSError:  # the other end is closed
            return False
        self._bytes += data
        return bool(data)


def test_at_a_terminal_the_screen_is_drawn_again_and_given_back_at_the_end(lift_site: LiftSite) -> None:
    terminal = Terminal("watch", "main", "--manager", lift_site.address)
    try:
        terminal.until(r"(?s)main: live .*door\.front.*60 s ago")
        terminal.process.send_signal(signal.SIGINT)
        text = terminal.rest()
        assert terminal.process.wait(HANGS_S) == 0
    finally:
        terminal.process.kill()
        terminal.process.wait()
    assert "\x1b[?1049h" in text
    screen, _, after = text.rpartition("\x1b[?1049l")
    assert "\x1b[?25h" in text  # the cursor
    # what was last seen stays, within the width of the terminal
    lines = [re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line).rstrip() for line in after.splitlines()]
    assert any(line.startswith("door.front") for line in lines)
    assert max(map(len, lines)) <= 80
    assert screen


def test_of_a_table_that_is_higher_than_the_terminal_the_rest_is_counted(lift_site: LiftSite) -> None:
    terminal = Terminal("watch", "main", "--manager", lift_site.address, rows=20)
    try:
        terminal.until(r"\.\.\. \d+ more: a higher terminal, --signal or --changed shows them")
    finally:
        terminal.process.kill()
        terminal.process.wait()
        terminal.rest()


# -- trace and replay


def test_a_recording_is_shown_by_name_and_its_replay_reads_as_the_controller_did(
    lift_simulator: LiftSimulator, tmp_path: Path
) -> None:
    name, file = tmp_path / "ride", tmp_path / "ride.jsonl"
    site = site_file(tmp_path, lift_simulator.port)
    with running("serve", site, "--port", "0") as manager:
        address = manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
        with running("trace", "record", "-o", name, "--manager", address) as recording:
            eventually(lambda: file.exists() and "00 01 00 01" in file.read_text("utf-8"))
            lift_simulator.press_car("L3")
            eventually(lambda: "holding from 0: " in file.read_text("utf-8") and floor_of(file) == 3)
            assert recording.stop(signal.SIGINT)[0] == 0
            assert re.search(
                r"ride\.jsonl and ride\.pcapng: \d+ frames in \d+\.\d s, 0 writes, 0 exceptions", recording.out
            )
    shown = run("trace", "show", file, "--map", "generic-registers", "--signal", "car_floor", "--changes")
    assert shown.returncode == 0, shown
    floors = re.findall(r"car_floor (\w+)", shown.stdout)
    assert (floors[0], floors[-1]) == ("1", "3")

    with (
        replayed(file, loop=True) as port,
        running("watch", "main", "--signal", "car_floor", "--site", site_file(tmp_path, port)) as replay,
    ):
        replay.says(r"car_floor L1")
        replay.says(r"car_floor L3")
        assert replay.stop(signal.SIGINT)[0] == 0
        assert replay.err == ""


def floor_of(recording: Path) -> int:
    """The floor register in the newest answer of a recording that is being written."""
    answers = re.findall(r'"holding from 0: \d+ (\d+) .*\n', recording.read_text("utf-8"))
    return int(answers[-1])


def test_it_records_without_a_manager_for_a_given_time(lift_simulator: LiftSimulator, tmp_path: Path) -> None:
    site = site_file(tmp_path, lift_simulator.port)
    done = call("trace", "record", "plc", "--site", site, "-o", tmp_path / "a.jsonl", "--for", "2s")
    assert done.returncode == 0, done
    assert done.stderr == ""
    assert {path.name for path in tmp_path.glob("a.*")} == {"a.jsonl", "a.pcapng"}
    assert lift_simulator.writes == ()
    first, second = map(json.loads, (tmp_path / "a.jsonl").read_text("utf-8").splitlines()[1:3])
    assert (first["direction"], first["at_s"], second["direction"]) == ("request", 0.0, "answer")
    assert first["hex"].startswith("00 01 "), "the first request of a connection"
    again = call("trace", "record", "--site", site, "-o", tmp_path / "a", "--for", "1s")
    assert again.returncode == 1
    assert again.stderr.startswith(f"{tmp_path / 'a.jsonl'}: there already; ")
    shown = call("trace", "show", tmp_path / "a.jsonl", "--site", site, "--changes")
    assert "car_floor L1" in shown.stdout
    assert call("trace", "show", tmp_path / "a.jsonl", "--site", site, "--errors").stdout == ""


def test_a_controller_that_there_is_not_is_refused_with_those_there_are(
    lift_simulator: LiftSimulator, tmp_path: Path
) -> None:
    site = site_file(tmp_path, lift_simulator.port)
    done = call("trace", "record", "plx", "-o", tmp_path / "a", "--site", site)
    assert done.returncode == 1
    assert done.stderr == "no controller 'plx'; did you mean `plc`?; the controllers are plc\n"
    assert list(tmp_path.glob("a.*")) == []


def test_a_recording_without_an_answer_is_kept_and_an_error(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        site = site_file(tmp_path, silent.getsockname()[1])
        done = call("trace", "record", "--site", site, "-o", tmp_path / "a", "--for", "1s")
    assert done.returncode == 1
    assert re.search(r"a\.jsonl and a\.pcapng: [1-9]\d* frames? in .*, [1-9]\d* without a right answer", done.stdout)
    assert done.stderr == f"plc: the controller gave no answer; `lift-manager doctor {site}` shows why\n"


def test_a_recording_of_a_controller_without_power_is_an_error(lift_simulator: LiftSimulator, tmp_path: Path) -> None:
    lift_simulator.begin("power_loss.outputs_held")
    site = site_file(tmp_path, lift_simulator.port)
    done = call("trace", "record", "--site", site, "-o", tmp_path / "a", "--for", "1s")
    assert done.returncode == 1
    assert "plc: the controller gave no answer; " in done.stderr


def test_what_is_no_recording_or_has_no_such_signal_is_refused_in_a_sentence(tmp_path: Path) -> None:
    other = tmp_path / "site.yaml"
    other.write_text("schema: 1\n", "utf-8")
    shown = call("trace", "show", other)
    assert shown.returncode == 1
    assert "is not the recording of a link" in shown.stderr
    replay = call("simulate", "--replay", other)
    assert replay.returncode == 1
    assert "is not the recording of a link" in replay.stderr
    for words in ((), ("generic-registers", "--replay", other), ("generic-registers", "--loop")):
        assert call("simulate", *words).returncode == 2


def test_the_command_that_replays_says_what_it_has_and_what_was_not_recorded(
    lift_simulator: LiftSimulator, tmp_path: Path
) -> None:
    site = site_file(tmp_path, lift_simulator.port)
    assert call("trace", "record", "--site", site, "-o", tmp_path / "a", "--for", "1s").returncode == 0
    with running("simulate", "--replay", tmp_path / "a.jsonl", "--port", "0", "--loop") as replay:
        port = int(replay.says(r"^plc of 20.* on 127\.0\.0\.1:(\d+)")[1])
        replay.says(r"and then begins again")
        seen = call("watch", "main", "--once", "--site", site_file(tmp_path, port))
        assert seen.returncode == 0, seen
        assert "at L1" in seen.stdout
        assert replay.stop(signal.SIGTERM)[0] == 0


def test_help_has_an_example_for_each_tool() -> None:
    for words in (["watch"], ["trace", "record"], ["trace", "show"], ["simulate"]):
        done = call(*words, "--help")
        assert "lift-manager" in done.stdout.partition("Example")[2], words
