"""`ack` and `lockout` at the command line, against a running manager that is started again in between."""

import json
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from pyModbusTCP.server import DataBank, ModbusServer

from lift_manager.store.place import store_path
from tests.support.programs import HANGS_S, Program, Started, call, eventually, free_port, run
from tests.support.rows import each_row

NAME = "Main hospital"
LIFT = "east-wing"
OPEN = 2


class Controller(DataBank):  # type: ignore[misc]  # pyModbusTCP has no types
    """pyModbusTCP's memory as a controller of generic-registers: an idle lift at L1 with its door shut, and a fire input."""

    def __init__(self) -> None:
        super().__init__(h_regs_size=32, coils_size=1, d_inputs_size=1, i_regs_size=1)
        self._beats = 0
        self.fire(False)

    def fire(self, active: bool) -> None:
        self.set_holding_registers(1, [1, 1, 1, 1, 0b100 | (not active), 0, 0])

    def get_holding_registers(self, address: int, number: int = 1, srv_info: object = None) -> Any:
        self._beats += 1
        self.set_holding_registers(0, [self._beats & 0xFFFF])
        return super().get_holding_registers(address, number, srv_info)


class Site:
    """A manager of one lift, and people who talk to it."""

    def __init__(self, start: Started, folder: Path) -> None:
        self.controller, modbus = Controller(), free_port()
        server = ModbusServer("127.0.0.1", modbus, no_block=True, data_bank=self.controller)
        server.start()
        start.callback(server.stop)
        lift = {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.1}
        lift |= {"display_name": "Ostflügel [2]", "max_age_s": 10}  # so that a busy computer takes no lift offline
        content = {
            "schema": 1,
            "name": NAME,
            "timezone": "Asia/Singapore",
            "state": "kept",
            "controllers": {"plc": {"host": "127.0.0.1", "port": modbus, "map": "generic-registers"}},
            "lifts": {LIFT: lift},
        }
        self.kept = folder / "kept"
        self._start, self.file = start, folder / "site.yaml"
        self.file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
        self.manager, self.url = self._serve()

    def _serve(self) -> tuple[Program, str]:
        manager = self._start("serve", self.file, "--port", "0")
        return manager, manager.says(r"(http://127\.0\.0\.1:\d+)/docs")[1]

    def restart(self, number: signal.Signals = signal.SIGTERM) -> None:
        self.manager.tell(number)
        self.manager.ended()
        self.manager, self.url = self._serve()

    def refuses(self) -> str:
        """What a robot is told, empty where it is accepted."""
        url = f"{self.url}/open-rmf/demo-lift/lift_request"
        body = {"floor": "L2", "door_state": OPEN}
        answer = httpx.post(url, params={"lift_name": LIFT}, json=body, trust_env=False, timeout=HANGS_S).json()
        assert answer["success"] is (not answer["msg"])
        return str(answer["msg"])

    def say(self, *words: str, code: int = 0) -> str:
        done = call(*words, "--manager", self.url)
        assert done.returncode == code, done
        return (done.stderr if code else done.stdout).strip()


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with Started() as programs:
        yield Site(programs, tmp_path)


def test_a_fire_is_latched_until_somebody_acknowledges_it_also_when_the_manager_was_killed(site: Site) -> None:
    site.controller.fire(True)
    eventually(lambda: "fire:" in site.manager.err)
    site.restart()
    assert "still reports a fire" in site.say("ack", LIFT, "--by", "M. Weber", code=1)
    site.controller.fire(False)
    told = eventually(lambda: message if "fire service" in (message := site.refuses()) else "")
    assert "`lift-manager ack east-wing --by NAME`" in told
    site.restart(signal.SIGKILL)
    assert "fire service" in site.refuses()
    assert "a fire at" in site.manager.err
    said = site.say("ack", LIFT, "--by", "M. Weber")
    assert said.startswith("east-wing: M. Weber acknowledged the fire, ")
    assert said.endswith("robots are taken again")
    assert site.refuses() == ""
    assert "nothing to acknowledge" in site.say("ack", LIFT, "--by", "M. Weber", code=1)


def test_the_table_of_the_lifts_shows_what_people_call_them(site: Site) -> None:
    table = eventually(lambda: table if " L1 " in (table := site.say("lifts")) else "")
    head, line, *_ = table.splitlines()
    assert head.split()[:4] == ["lift", "called", "floor", "door"]
    assert line.split()[:2] == [LIFT, "Ostflügel"]
    assert "[2]" in table


@pytest.mark.parametrize("which", [LIFT, "--all"])
def test_a_drain_is_begun_and_ended_by_a_named_person(site: Site, which: str) -> None:
    begun = site.say("drain", which, "--by", "M. Weber", "--reason", "new ropes")
    assert f"{LIFT}: no new session begins; drain by M. Weber since" in begun
    assert "drain" in site.say("drain", which, "--by", "A. Beck", "--reason", "cleaning", code=1)
    assert "(new ropes) is ended by A. Beck" in site.say("drain", which, "--by", "A. Beck", "--end")


def test_a_lockout_is_told_to_robots_survives_a_restart_and_is_ended_by_a_named_person(site: Site) -> None:
    locked = site.say("lockout", LIFT, "--by", "M. Weber", "--reason", "new ropes")
    assert locked.startswith("east-wing: locked out by M. Weber since 20")
    assert locked.endswith(": new ropes")
    site.restart()
    told = site.refuses()
    assert "is locked out by M. Weber since 20" in told
    assert "new ropes; a person ends it with `lift-manager lockout east-wing --by NAME --end`" in told
    assert "end that one first" in site.say("lockout", LIFT, "--by", "A. Beck", "--reason", "cleaning", code=1)
    ended = site.say("lockout", LIFT, "--by", "A. Beck", "--end")
    assert ended.endswith("(new ropes) is ended by A. Beck")
    assert site.refuses() == ""
    assert "is not locked out" in site.say("lockout", LIFT, "--by", "A. Beck", "--end", code=1)
    assert "the lifts are east-wing" in site.say("lockout", "west", "--by", "A. Beck", "--end", code=1)


def test_a_damaged_state_stops_the_start_in_one_sentence(site: Site) -> None:
    site.manager.stop()
    (file,) = site.kept.glob("*.db")
    file.write_bytes(file.read_bytes()[:40])
    second = run("serve", site.file, "--port", "0")
    assert second.returncode == 1
    (line,) = [line for line in second.stderr.splitlines() if "WARNING" not in line]
    assert line.startswith(f"{file} is not a store of a lift manager")
    assert "so nothing starts without it" in line
    assert "Traceback" not in second.stderr


def test_a_state_that_cannot_be_written_is_in_force_all_the_same(tmp_path: Path) -> None:
    place = store_path(NAME, "kept", tmp_path / "site.yaml", {})
    beside = place.with_name(f"{place.name}.new")
    beside.mkdir(parents=True)
    with Started() as programs:
        site = Site(programs, tmp_path)
        site.manager.logs("decisions of people are in force but do not survive a restart")
        site.say("lockout", LIFT, "--by", "M. Weber", "--reason", "new ropes")
        assert "is locked out" in site.refuses()
        beside.rmdir()
        site.manager.logs("can be written again")
        site.restart(signal.SIGKILL)
        assert "is locked out" in site.refuses()


def test_without_a_manager_the_command_line_says_how_to_get_one() -> None:
    done = call("ack", LIFT, "--by", "M. Weber", "--manager", f"http://127.0.0.1:{free_port()}")
    assert done.returncode == 1
    assert "no manager answers at http://127.0.0.1:" in done.stderr
    assert "start it with `lift-manager serve SITE`, or give its address with --manager ADDRESS" in done.stderr


@contextmanager
def answering(answer: bytes) -> Iterator[str]:
    """Another program at a port: it gives this answer to the first who asks."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(65536)
                connection.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}"
        thread.join(HANGS_S)


@each_row("body", [b"<html>", b"[]", b'"text"', b"{}"])
def test_another_program_at_that_address_is_not_taken_for_a_manager(body: bytes) -> None:
    for status in (b"404 Not Found", b"200 OK"):
        head = b"HTTP/1.1 %s\r\nContent-Length: %d\r\nConnection: close\r\n\r\n" % (status, len(body))
        with answering(head + body) as url:
            done = call("ack", LIFT, "--by", "M. Weber", "--manager", url)
        assert done.returncode == 1
        assert f"is no lift manager (HTTP {status[:3].decode()})" in done.stderr
        assert "Traceback" not in done.stderr


@each_row(
    ("words", "wrong"),
    [
        (("lockout", LIFT, "--by", "A"), "give the reason"),
        (("drain", LIFT, "--by", "A"), "give the reason"),
        (("drain", "--by", "A", "--reason", "x"), "name one lift"),
        (("drain", LIFT, "--all", "--by", "A", "--reason", "x"), "name one lift"),
        (("drain", LIFT, "--by", "A", "--reason", "x", "--end"), "needs no reason"),
        (("lockout", LIFT, "--by", "A", "--reason", " "), "give the reason"),
        (("lockout", LIFT, "--by", "A", "--reason", "x", "--end"), "needs no reason"),
        (("lockout", LIFT, "--reason", "x"), "--by"),
        (("ack", LIFT), "--by"),
    ],
)
def test_a_word_without_a_name_or_a_reason_is_not_sent(words: tuple[str, ...], wrong: str) -> None:
    done = call(*words)
    assert done.returncode == 2
    assert wrong in done.stderr
