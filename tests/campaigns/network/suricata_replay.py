"""Suricata, which nobody here wrote, reads real traffic of the manager and forged writes with the rules that the site file makes.

The manager (127.0.0.1) drives simulated controllers over the loopback interface, dumpcap records, and other programs write in
between: on the manager's computer, and from 127.0.0.2. What must raise an alert is told apart by the port it was sent from.
"""

import json
import signal
import socket
import struct
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from register_maps import frames
from register_maps.frames import WRITES, Request
from register_maps.words import Table
from tests.support.programs import Program, Started, eventually, free_port, run, started
from tests.support.suricata import Event, alerts, suricata

pytestmark = [pytest.mark.external("suricata", "dumpcap"), pytest.mark.timeout(120)]

MANAGER, STRANGER = "127.0.0.1", "127.0.0.2"

MASKED = """\
schema: 1
name: masked-and-block
title: Two bits among others in one register, and a call that is written as a block
provenance: {trust: template, sources: [this test]}
addressing: {base: 1}
served: {holding: [[1, 60]]}
signals:
  car_floor: {at: "holding:1", as: floor}
  motion: {at: "holding:2", values: {0: stopped, 1: up, 2: down}}
  door.front: {at: "holding:3", values: {0: closed, 1: moving, 2: open}}
  fire: {at: "holding:4", means_yes: 9}
commands:
  go_to: {at: "holding:31", as: floor, action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 5}}
  hold_door.front:
    {at: "holding:40.2", shared_word: mask_write, action: hold, max_hold_s: 30, refresh_s: 1, on_link_loss: device_watchdog,
     confirm: {any_of: [readback], within_s: 2}}
write_blocks: [{at: "holding:30", count: 3, function: 16, gaps: 0}]
at_floor_evidence: {kind: motion_stopped}
at_same_floor: call
"""


@dataclass(frozen=True)
class Case:
    """One map, and writes that none of its commands makes, though the manager's own computer sends them."""

    map: str
    floors: str
    forged: Mapping[str, Request]
    functions: frozenset[int]
    """What its commands write with."""
    declared: Request
    """As the manager writes it: nobody's business on its computer, and an alert from anywhere else."""


CASES = {
    "registers": Case(
        "generic-registers",
        "{L1: 1, L2: 2, L3: 3}",
        {
            "below the commands": frames.write_register(15, 1),
            "above the commands": frames.write_register(20, 1),
            "the first address": frames.write_register(0, 1),
            "the last address": frames.write_register(65535, 1),
            "a function that no command uses": frames.write_registers(16, [1]),
            "a coil": frames.write_coil(16, value=True),
            "a mask write": frames.mask_write(16, 0xFFFE, 1),
            "a unit without a lift": frames.write_register(16, 1, unit=7),
        },
        frozenset({6}),
        frames.write_register(16, 0),
    ),
    "coils": Case(
        "generic-coils",
        "{L1: 0, L2: 1, L3: 2}",
        {
            "one coil of a block": frames.write_coil(1, value=True),
            "a block that begins inside and ends outside": frames.write_coils(14, [False] * 40),
            "a coil far away": frames.write_coil(4000, value=True),
            "a register": frames.write_register(1, 1),
        },
        frozenset({5, 15}),
        frames.write_coils(0, [False] * 8),
    ),
    "mask and block": Case(
        "masked.yaml",
        "{L1: 1, L2: 2, L3: 3}",
        {
            "the masked register as a whole": frames.write_register(39, 0),
            "the masked register in a block": frames.write_registers(39, [0]),
            "a mask write elsewhere": frames.mask_write(30, 0xFFFF, 0),
            "the block and one more": frames.write_registers(29, [0, 0, 0, 0]),
            "what the lift says": frames.write_registers(0, [3]),
        },
        frozenset({16, 22}),
        frames.mask_write(39, 0xFFFF, 0),
    ),
}


@dataclass
class Heard:
    """What Suricata says of one capture."""

    events: list[Event]
    sent: dict[str, int]
    """What was sent besides the manager's own traffic: its name and the port it came from."""

    def of(self, name: str) -> set[str]:
        return {each["alert"]["signature"] for each in alerts(self.events) if each["src_port"] == self.sent[name]}

    @property
    def own_functions(self) -> set[int]:
        """The functions that the manager used."""
        modbus = [each for each in self.events if each["event_type"] == "modbus"]
        return {
            each["modbus"]["request"]["function_raw"] for each in modbus if each["src_port"] not in self.sent.values()
        }

    @property
    def others(self) -> list[Event]:
        """Alerts about anything that was not forged here."""
        return [each for each in alerts(self.events) if each["src_port"] not in self.sent.values()]


def send(source: str, port: int, data: bytes) -> int:
    """Send one frame from this address over a connection of its own; returns the port it came from."""
    with closing(socket.create_connection((MANAGER, port), timeout=5, source_address=(source, 0))) as link:
        own: int = link.getsockname()[1]
        link.sendall(data)
        link.settimeout(0.3)
        with suppress(TimeoutError):  # a device may leave a unit that it does not have unanswered
            link.recv(300)
    return own


def site_file(case: Case, folder: Path, port: int, access: str = "control") -> Path:
    (folder / "masked.yaml").write_text(MASKED, "utf-8")
    named = f"./{case.map}" if case.map.endswith(".yaml") else case.map
    path = folder / "site.yaml"
    path.write_text(
        f"schema: 1\nname: Captured\nstate: {folder}\ncontrollers:\n  plc: {{host: {MANAGER}, port: {port}, map: {named}}}\n"
        f"lifts:\n  lift: {{controller: plc, access: {access}, floors: {case.floors}, between_sessions_s: 0}}\n",
        "utf-8",
    )
    return path


def rules(site: Path, *options: str) -> str:
    made = run("network", site, "--suricata", "--manager", MANAGER, *options)
    assert made.returncode == 0, made.stderr
    return made.stdout


def ride(base: str) -> None:
    """Call the lift, let it hold its door, and let go of it: every kind of command that the map has."""

    def ask(path: str, body: Mapping[str, object] | None = None) -> dict[str, Any]:
        data = None if body is None else json.dumps(body).encode()
        query = urllib.request.Request(f"{base}{path}?lift_name=lift", data, {"Content-Type": "application/json"})
        with urllib.request.urlopen(query, timeout=5) as answer:
            said: dict[str, Any] = json.load(answer)
        return said

    def stands_open() -> bool:
        data = ask("/lift_state")["data"]
        return (data.get("current_floor"), data.get("door_state")) == ("L2", 2)

    assert ask("/lift_request", {"floor": "L2", "door_state": 2})["success"]
    eventually(stands_open, 30)
    assert ask("/lift_request", {"floor": "L2", "door_state": 0})["success"]
    eventually(lambda: ask("/lift_state")["data"].get("door_state") == 0, 15)


def recorded(case: Case, folder: Path) -> Iterator[tuple[Path, Path, int, dict[str, int]]]:
    """Run manager, simulator and forgers; yield the capture, the site file, the controller's port and who sent what."""
    port = free_port()
    site, capture = site_file(case, folder, port), folder / "all.pcap"
    with Started() as programs:
        named = case.map if not case.map.endswith(".yaml") else str(folder / case.map)
        floors = case.floors.strip("{}").replace(": ", "=").replace(" ", "")
        programs("simulate", named, "--port", str(port), "--floors", floors, "--speed", "10").says("Ctrl-C ends it")
        dumpcap = recording(programs, port, capture)
        manager = programs("serve", site, "--port", "0")
        base = manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1] + "/open-rmf/demo-lift"
        ride(base)
        sent = {
            name: send(MANAGER, port, frames.frame(request, number))
            for number, (name, request) in enumerate(case.forged.items(), start=1)
        }
        sent["declared, by another program here"] = send(MANAGER, port, frames.frame(case.declared, 90))
        sent["declared, by another host"] = send(STRANGER, port, frames.frame(case.declared, 91))
        sent["a read by another host"] = send(STRANGER, port, frames.frame(frames.read(Table.HOLDING, 0), 92))
        sent["a diagnostic by another host"] = send(STRANGER, port, struct.pack(">HHHBBHH", 93, 0, 6, 1, 8, 4, 0))
        sent["something else"] = send(STRANGER, port, b"GET / HTTP/1.0\r\n\r\n")
        assert manager.stop()[0] == 0
        dumpcap.stop(signal.SIGINT)
        yield capture, site, port, sent


def recording(programs: ExitStack, port: int, capture: Path) -> Program:
    """Record the loopback interface; returns once a connection of ours is in the file."""
    dumpcap = programs.enter_context(started("dumpcap", "-q", "-i", "lo", "-f", f"tcp port {port}", "-w", str(capture)))

    def is_recording() -> bool:
        with closing(socket.create_connection((MANAGER, port), timeout=5)):
            return capture.exists() and capture.stat().st_size > 1000

    eventually(is_recording, 15, 0.1)
    return dumpcap


@pytest.fixture(scope="module", params=CASES)
def heard(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Case, Heard, Heard]]:
    """The case, what the rules say, and what they say with `--reads`."""
    case, folder = CASES[request.param], tmp_path_factory.mktemp("suricata")
    for capture, site, port, sent in recorded(case, folder):
        plain = Heard(suricata(capture, rules(site), folder / "plain", str(port)), sent)
        strict = Heard(suricata(capture, rules(site, "--reads"), folder / "strict", str(port)), sent)
        yield case, plain, strict


def test_the_manager_itself_raises_no_alert_whatever_it_commands(heard: tuple[Case, Heard, Heard]) -> None:
    case, plain, strict = heard
    assert plain.own_functions & WRITES == case.functions, "the ride has to use every function of the map's commands"
    assert plain.others == []
    assert strict.others == []


def test_every_forged_write_raises_an_alert_that_names_the_map(heard: tuple[Case, Heard, Heard]) -> None:
    case, plain, _ = heard
    name = case.map.removesuffix(".yaml") if not case.map.startswith("masked") else "masked-and-block"
    for forged in case.forged:
        said = plain.of(forged)
        assert said, f"no alert for: {forged}"
        assert all(f"map {name}" in text for text in said), said


def test_only_the_managers_host_may_write(heard: tuple[Case, Heard, Heard]) -> None:
    _, plain, _ = heard
    assert plain.of("declared, by another program here") == set()
    (said,) = plain.of("declared, by another host")
    assert said.startswith("lift-manager: another host writes to plc (127.0.0.1:")


def test_reads_of_others_raise_an_alert_only_where_that_was_asked_for(heard: tuple[Case, Heard, Heard]) -> None:
    _, plain, strict = heard
    assert plain.of("a read by another host") == set()
    (said,) = strict.of("a read by another host")
    assert "another host reads" in said


def test_what_is_no_business_of_a_lift_raises_an_alert_whoever_sends_it(heard: tuple[Case, Heard, Heard]) -> None:
    _, plain, _ = heard
    (said,) = plain.of("a diagnostic by another host")
    assert "function 08, which is never used" in said
    (said,) = plain.of("something else")
    assert "something other than Modbus" in said
