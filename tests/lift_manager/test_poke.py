"""`poke` at the command line: what it asks, what it sends without being asked, and how it ends."""

import json
import os
import re
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pyModbusTCP.server import DataBank, ModbusServer

from register_maps.load import MAPS
from tests.support.forked import Forked
from tests.support.programs import HANGS_S, Started, call, eventually, free_port, run
from tests.support.rows import each_row

LIFT = "east"
FLOORS = {"L1": 1, "L2": 2, "L3": 3}


class Controller(DataBank):  # type: ignore[misc]  # pyModbusTCP has no types
    """pyModbusTCP's memory as a controller of generic-registers: an idle lift at L1 with its door shut. Remembers what is written."""

    def __init__(self) -> None:
        super().__init__(h_regs_size=32, coils_size=1, d_inputs_size=1, i_regs_size=1)
        self._beats = 0
        self.writes: list[tuple[int, list[int]]] = []
        self.reads = 0
        super().set_holding_registers(1, [1, 1, 1, 1, 0b101, 0, 0])

    def get_holding_registers(self, address: int, number: int = 1, srv_info: object = None) -> Any:
        self.reads += 1
        super().set_holding_registers(0, [self.reads & 0xFFFF])
        return super().get_holding_registers(address, number, srv_info)

    def set_holding_registers(self, address: int, word_list: list[int], srv_info: object = None) -> Any:
        if srv_info is not None:
            self.writes.append((address, word_list))
        return super().set_holding_registers(address, word_list, srv_info)


def site_file(folder: Path, port: int, **lift: object) -> Path:
    content = {
        "schema": 1,
        "name": "Bench",
        "timezone": "Europe/Berlin",
        "state": "kept",
        "controllers": {"plc": {"host": "127.0.0.1", "port": port, "map": "generic-registers"}},
        "lifts": {LIFT: {"controller": "plc", "floors": FLOORS, "poll_s": 0.1, "max_age_s": 10, **lift}},
    }
    file = folder / "site.yaml"
    file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
    return file


@pytest.fixture
def start() -> Iterator[Started]:
    with Started() as programs:
        yield programs


@pytest.fixture
def controller(start: Started) -> tuple[Controller, int]:
    made, port = Controller(), free_port()
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=made)
    server.start()
    start.callback(server.stop)
    return made, port


@pytest.fixture
def simulated(start: Started) -> int:
    """The port of a simulated controller."""
    port = free_port()
    program = start("simulate", "generic-registers", "--port", str(port), "--speed", "10")
    program.says(str(port))
    return port


class Terminal:
    """`lift-manager` at a terminal, in front of which a person types."""

    def __init__(self, start: Started, *arguments: str | Path) -> None:
        own, other = os.openpty()
        start.callback(os.close, own)
        self._text, self._own = b"", own
        words = list(map(str, arguments))
        self.process = Forked(words, env=os.environ | {"TERM": "dumb"}, stdin=other, out=other, err=other)
        os.close(other)
        start.callback(self._end)
        threading.Thread(target=self._read, daemon=True).start()

    def shows(self, pattern: str) -> re.Match[str]:
        return eventually(lambda: re.search(pattern, self.text))

    def types(self, line: str) -> None:
        os.write(self._own, f"{line}\n".encode())

    def ended(self) -> int:
        return self.process.wait(HANGS_S)

    @property
    def text(self) -> str:
        return self._text.decode("utf-8", "replace")

    def _read(self) -> None:
        while True:
            try:
                self._text += os.read(self._own, 4096)
            except OSError:
                # the program has ended
                return

    def _end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(HANGS_S)


def test_without_a_terminal_the_frames_are_printed_and_not_one_byte_is_sent(
    tmp_path: Path, controller: tuple[Controller, int]
) -> None:
    plc, port = controller
    file = site_file(tmp_path, port, access="control")
    done = run("poke", LIFT, "hold_door.front", "--site", file)
    assert (done.returncode, done.stderr) == (0, "")
    assert "FC06 write holding register 17 := 1, unit 1" in " ".join(done.stdout.split())
    assert "01 06 00 11 00 01" in done.stdout
    assert done.stdout.endswith(
        "dry run: nothing was sent (there is no terminal to ask at; --yes sends without asking)\n"
    )
    assert plc.reads > 0
    assert plc.writes == []
    assert not (tmp_path / "kept").exists()


def test_a_lift_alone_lists_its_commands(tmp_path: Path, controller: tuple[Controller, int]) -> None:
    done = run("poke", LIFT, "--site", site_file(tmp_path, controller[1]))
    assert done.returncode == 0
    assert re.search(r"^go_to FLOOR\n +brings the car to a floor", done.stdout, re.MULTILINE)
    assert "holding:18; on the wire holding 18" in done.stdout
    assert controller[0].writes == []


def test_a_watched_lift_is_not_commanded_through_the_running_manager(
    tmp_path: Path, start: Started, controller: tuple[Controller, int]
) -> None:
    file = site_file(tmp_path, controller[1], access="monitor")
    url = start("serve", file, "--port", "0").says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
    done = call("poke", LIFT, "hold_door.front", "--yes", "--manager", url)
    assert done.returncode == 1
    assert "east is only watched: the manager's site file does not say `access: control`" in done.stderr
    beside = run("poke", LIFT, "hold_door.front", "--yes", "--site", file)
    assert beside.returncode == 1
    assert "without --site this works through the running manager" in beside.stderr
    assert controller[0].writes == []


def test_what_latches_needs_a_technician_at_the_panel(tmp_path: Path, controller: tuple[Controller, int]) -> None:
    overrides = {"commands": {"hold_door.front": {"on_link_loss": "latches"}}}
    file = site_file(tmp_path, controller[1], override=overrides)
    done = run("poke", LIFT, "hold_door.front", "--yes", "--site", file)
    assert done.returncode == 1
    assert "holding:17 STAYS ON and nothing releases it" in " ".join(done.stdout.split())
    assert "the lift technician has to stand at the panel; give the name with --at-panel NAME" in done.stderr
    assert controller[0].writes == []


def test_a_person_is_asked_for_a_word_and_sees_what_the_lift_does(
    tmp_path: Path, start: Started, simulated: int
) -> None:
    file = site_file(tmp_path, simulated, access="monitor")
    words = ("poke", LIFT, "hold_door.front", "--for", "1", "--site", file)
    refused = Terminal(start, *words)
    refused.shows("Type yes to send it: ")
    refused.types("")
    assert refused.ended() == 1
    assert "nothing was sent: yes was not typed" in refused.text
    taken = Terminal(start, *words)
    taken.shows("01 06 00 11 00 01(.|\n)*Type yes to send it: ")
    taken.types("yes")
    assert taken.ended() == 0, taken.text
    assert re.search(r"output hold_door.front: .* -> held", taken.text)
    assert "verified: robot_mode, hold_door.front are at rest" in taken.text
    assert "east: hold_door.front: confirmed" in taken.text
    assert "hold_door.front" in call("audit", file).stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_every_signal_releases_what_is_held(
    tmp_path: Path, start: Started, simulated: int, number: signal.Signals
) -> None:
    file = site_file(tmp_path, simulated, access="control")
    url = start("serve", file, "--port", "0").says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
    poke = start("poke", LIFT, "hold_door.front", "--for", "60", "--yes", "--manager", url)
    poke.says("stays on for 60 s")
    assert poke.stop(number)[0] == 1
    assert "verified: robot_mode, hold_door.front are at rest" in poke.out


# -- unlocked


def draft_map(folder: Path) -> Path:
    """A map like generic-registers, which holds the door at another address."""
    text = (MAPS / "generic-registers.yaml").read_text("utf-8")
    changes = {"name: generic-registers": "name: draft", 'at: "holding:17"': 'at: "holding:25"', "[16, 19]": "[16, 25]"}
    draft = folder / "draft.yaml"
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    draft.write_text(text, "utf-8")
    return draft


def unlocked_site(folder: Path, port: int, *ranges: str) -> Path:
    file = site_file(folder, port)
    content = json.loads(file.read_text("utf-8"))
    content["controllers"]["plc"]["writable_ranges"] = ranges
    file.write_text(json.dumps(content), "utf-8")
    return file


UNLOCK = ("--draft", "draft.yaml", "--by", "M. Weber", "--reason", "which coil holds the door")


def test_a_draft_map_is_unlocked_for_a_while_and_written_down(
    tmp_path: Path, controller: tuple[Controller, int]
) -> None:
    plc, port = controller
    draft_map(tmp_path)
    file = unlocked_site(tmp_path, port, "holding 16", "holding 18 to 25")
    words = ("poke", LIFT, "hold_door.front", "--site", file, "--for", "60", *UNLOCK)
    dry = run(*words, "--unlock", "10m", cwd=tmp_path)
    assert dry.returncode == 0, dry
    assert "UNLOCKED: the commands of the draft map draft.yaml" in dry.stdout
    assert "write holding register 25 := 1, unit 1" in " ".join(dry.stdout.split())
    assert plc.writes == []
    done = run(*words, "--unlock", "8s", "--yes", cwd=tmp_path)
    assert done.returncode == 1
    assert "the unlock has ended after 8 s, and the trial with it" in done.stderr
    assert "verified: robot_mode, hold_door.front are at rest" in done.stdout
    assert (25, [1]) in plc.writes
    assert plc.writes[-2:] in ([(25, [0]), (18, [0])], [(18, [0]), (25, [0])])
    assert 17 not in {address for address, _ in plc.writes}
    (row,) = (line for line in call("audit", file).stdout.splitlines() if "unlocked" in line)
    assert "M. Weber" in row
    assert "which coil holds the door" in row


def test_nothing_is_unlocked_outside_the_ranges_of_the_site(tmp_path: Path, controller: tuple[Controller, int]) -> None:
    draft_map(tmp_path)
    file = unlocked_site(tmp_path, controller[1], "holding 16", "holding 18 to 19")
    done = run("poke", LIFT, "hold_door.front", "--site", file, "--yes", "--unlock", "10m", *UNLOCK, cwd=tmp_path)
    assert done.returncode == 1
    assert "hold_door.front writes holding 25 on the wire, which is in none of `writable_ranges`" in done.stderr
    assert controller[0].reads == 0


@each_row(
    ("words", "why"),
    [
        (("--unlock", "10m", "--site", "site.yaml"), "an unlock needs"),
        (("--unlock", "10m", *UNLOCK), "only without a running manager"),
        (("--unlock", "2h", "--site", "site.yaml", *UNLOCK), "at most 30m"),
    ],
)
def test_an_unlock_is_bounded_local_and_somebody_s(words: tuple[str, ...], why: str) -> None:
    done = call("poke", LIFT, "hold_door.front", *words)
    assert done.returncode == 2
    assert why in " ".join(re.sub(r"[│╭╮╰╯─]", " ", done.stderr).split())
