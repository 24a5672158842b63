"""`lift-manager checkout` at a terminal, against a simulated controller: interrupted, resumed, and with a manager that is killed."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from pyModbusTCP.client import ModbusClient

from tests.support.forked import Forked
from tests.support.programs import HANGS_S, Started, call, free_port, run

WHO = ("--by", "Ana Silva, Integrator Ltd", "--technician", "Bo Berg, Lifts Ltd")
PRECONDITIONS = [
    (r"revision of the I/O list", "rev 3"),
    (r"permit to work", "P-7"),
    (r"instruments are used", "skip nothing is measured"),
    (r"backup of the PLC program", "stick 4"),
    (r"car empty", "y"),
    (r"landings barricaded", "n"),
    (r"make it so first[\s\S]*landings barricaded", "y"),
    (r"fire panel isolated", "skip no panel here"),
]
YES_NO, DONE = r"\[y/n/\?\] ", r"\[ENTER/\?\] "
WHERE = r"At which floor[^\[]*\[L1/L2/L3/\?\] "


class Terminal:
    """A program at a terminal."""

    def __init__(self, *words: str) -> None:
        self._ours, theirs = pty.openpty()
        env = os.environ | {"TERM": "dumb", "NO_COLOR": "1"}
        self.program = Forked(words, env=env, stdin=theirs, out=theirs, err=theirs)
        os.close(theirs)
        self.seen = ""
        self._at = 0

    def expect(self, pattern: str) -> str:
        """Wait until the screen shows this after what was expected before; line breaks count as spaces."""
        ends_at = time.monotonic() + HANGS_S
        while True:
            text = re.sub(r"\s+", " ", self.seen)
            if found := re.compile(pattern).search(text, self._at):
                self._at = found.end()
                return found[0]
            assert time.monotonic() < ends_at, f"no {pattern} in {text[self._at :]}"
            if select.select([self._ours], [], [], 1.0)[0]:
                try:
                    self.seen += os.read(self._ours, 4096).decode("utf-8", "replace")
                except OSError:  # its end
                    raise AssertionError(f"it ended without {pattern}: {text[self._at :]}") from None

    def answer(self, pattern: str, line: str) -> None:
        self.expect(pattern)
        os.write(self._ours, f"{line}\n".encode())

    def ended(self) -> int:
        """Read to the end; return the exit code."""
        while True:
            try:
                if not (more := os.read(self._ours, 4096)):
                    break
            except OSError:
                break
            self.seen += more.decode("utf-8", "replace")
        return self.program.wait(HANGS_S)

    def close(self) -> None:
        self.program.kill()
        self.program.wait(HANGS_S)
        os.close(self._ours)


@contextmanager
def terminal(*words: str) -> Iterator[Terminal]:
    found = Terminal(*words)
    try:
        yield found
    finally:
        found.close()


def site_file(folder: Path, port: int) -> Path:
    path = folder / "site.yaml"
    lift = {"controller": "plc", "access": "monitor", "floors": {"L1": 0, "L2": 1, "L3": 2}, "max_age_s": 10}
    content = {
        "schema": 1,
        "name": "bench",
        "state": "kept",
        "controllers": {"plc": {"host": "127.0.0.1", "port": port, "map": "generic-coils"}},
        "lifts": {"lift1": lift},
    }
    path.write_text(json.dumps(content))
    return path


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Path]:
    port = free_port()
    with Started() as start:
        start("simulate", "generic-coils", "--port", str(port), "--speed", "10").says("Ctrl-C")
        yield site_file(tmp_path, port)


def outputs(site: Path) -> list[bool]:
    port = json.loads(site.read_text())["controllers"]["plc"]["port"]
    client = ModbusClient("127.0.0.1", port, unit_id=1, auto_open=True, auto_close=True)
    found: list[bool] = client.read_coils(0, 11)
    return found


def test_a_checkout_is_interrupted_and_resumed_and_survives_a_killed_manager(site: Path) -> None:
    words = ("checkout", str(site), "lift1", *WHO)
    with terminal(*words, "--item", "F-02", "--item", "R-02") as person:
        person.expect("never in the safety chain and never in the shaft")
        for pattern, line in PRECONDITIONS:
            person.answer(pattern, line)
        person.expect("F-02 floor L2.*coil:1 in the vendor's table, coil 1 on the wire")
        person.answer(f"calls the empty car to L2.*{YES_NO}", "y")
        person.expect(WHERE)
        assert any(outputs(site)), "the door is held"
        person.program.send_signal(signal.SIGINT)
        assert person.ended() == 3
        assert "interrupted" in person.seen
    assert not any(outputs(site))

    with terminal(*words, "--item", "F-02", "--item", "A-04", "--item", "R-02") as person:
        person.answer(f"calls the empty car to L2.*{YES_NO}", "y")
        person.answer(WHERE, "L9")
        person.answer(WHERE, "note seen from the landing")
        person.answer(WHERE, "l2")
        person.answer(f"front door open.*{YES_NO}", "y")
        person.expect("F-02: pass")
        for question in ("car empty", "landings barricaded", "fire panel isolated", "is then killed", "and held"):
            person.answer(f"{question}.*?{YES_NO}", "y")
        person.expect("A-04: pass")
        person.answer(f"sill gap.*?{YES_NO}", "doc")
        person.answer(f"needs a few words.*?{YES_NO}", "doc drawing 12")
        assert person.ended() == 3
    (path,) = (site.parent / "kept").glob("*.checkout.*.sat.json")
    record = json.loads(path.read_text())
    results = {one["item"]: one for one in record["results"]}
    assert {number: one["outcome"] for number, one in results.items()} == {
        "F-02": "pass",
        "A-04": "pass",
        "R-02": "proved by document",
    }
    assert results["F-02"]["note"] == "seen from the landing"
    assert 0 < results["A-04"]["figures"]["let_go_s"] < 20
    assert record["people"]["technician"] == {"name": "Bo Berg", "company": "Lifts Ltd"}
    assert record["controller"]["fingerprint"]["served"][0] == {"table": "discrete", "first": 0, "last": 29, "unit": 1}

    content = json.loads(site.read_text())
    content["lifts"]["lift1"]["floors"]["L3"] = 3
    site.write_text(json.dumps(content))
    listed = call("checkout", str(site), "lift1", "--list").stdout
    assert re.search(r"F-02 .*\n", listed)
    assert "pass" not in re.search(r"F-02.*", listed)[0]  # type: ignore[index]
    assert "proved by document" in re.sub(r"\s+", " ", listed)


def test_in_the_factory_a_signal_is_tested_at_the_panel_of_the_simulated_lift(tmp_path: Path) -> None:
    port = free_port()
    site = site_file(tmp_path, port)
    words = ("checkout", str(site), "lift1", *WHO, "--stage", "fat", "--item", "S-27")
    with Started() as start:
        simulated = start("simulate", "generic-coils", "--port", str(port), "--speed", "10", "--panel", "0")
        lift = simulated.says(r"make faults: (http://\S+/)")[1] + "lifts/generic-coils/"
        loose = {"name": "disconnected_signal", "values": {"signal": "independent"}}
        with terminal(*words) as person:
            for pattern, line in PRECONDITIONS[:4]:
                person.answer(pattern, line)
            for pattern, control, body in (
                (f"Make it so: a person has the car by key.*{DONE}", "inputs", {"key": "independent"}),
                (f"Make it no longer so: a person has the car by key.*{DONE}", "inputs", {"key": "normal"}),
                (f"Disconnect the wire of independent.*{DONE}", "faults/begin", loose),
                (f"Connect independent.*again.*{DONE}", "faults/end", loose),
            ):
                person.expect(pattern)
                httpx.post(lift + control, json=body, trust_env=False, timeout=HANGS_S).raise_for_status()
                person.answer("", "")
            person.expect("S-27: pass")
            assert person.ended() == 3


def piped(site: Path, answers: str, *words: str) -> subprocess.CompletedProcess[str]:
    return run("checkout", site, "lift1", *words, piped=answers)


def test_answers_may_come_through_a_pipe_and_their_end_ends_the_checkout(site: Path) -> None:
    answers = "rev 3\nP-7\nnone\nstick 4\ny\ny\ny\nn\nn\n"
    done = piped(site, answers, *WHO, "--item", "R-01", "--item", "R-02")
    assert done.returncode == 3, done
    assert "function 43" not in done.stdout
    assert "R-01: fail" in done.stdout
    assert "R-02: " not in done.stdout

    content = json.loads(site.read_text())
    content["lifts"]["lift1"]["floors"]["L3"] = 3
    site.write_text(json.dumps(content))
    (site.parent / "doctor.json").write_text('{"findings": []}')
    again = piped(site, "y\n", "--failed", "--baseline", str(site.parent / "doctor.json"))
    assert "the map or the site file has changed since; no item that was done depends on it" in again.stdout
    assert "R-01: pass" in again.stdout
    (path,) = (site.parent / "kept").glob("*.checkout.*.sat.json")
    record = json.loads(path.read_text())
    assert record["baseline"] == {"findings": []}
    assert record["floors"] == {"L1": 0, "L2": 1, "L3": 3}
    assert [one["outcome"] for one in record["results"]] == ["fail", "pass"]
    assert [(one["severity"], one["closed_at"] is None) for one in record["punch_list"]] == [("A", True), ("A", False)]


def test_the_end_without_signatures_is_said_and_how_to_go_on(site: Path) -> None:
    piped(site, "rev 3\nP-7\nnone\nstick 4\ny\ny\ny\ny\n", *WHO, "--item", "R-01")
    (path,) = (site.parent / "kept").glob("*.checkout.*.sat.json")
    record = json.loads(path.read_text())
    (passed,) = record["results"]
    record["results"] = [passed | {"item": one["id"], "digest": one["digest"]} for one in record["items"]]
    path.write_text(json.dumps(record))
    ended = piped(site, "")
    assert ended.returncode == 0, ended
    said = re.sub(r"\s+", " ", ended.stdout)
    assert "lift1, sat: passed" in said
    assert "not signed as it is now; the same command asks for what is left" in said


def test_a_controller_is_asked_what_it_is_and_another_one_is_noticed(site: Path) -> None:
    asked = piped(site, "rev 3\nP-7\nnone\nstick 4\ny\ny\ny\nn\nn\n", *WHO, "--item", "R-01", "--probe-identity")
    said = re.sub(r"\s+", " ", asked.stdout)
    assert said.index("probe identity: asks for vendor") < said.index(
        "the controller says that it is: vendor lift-manager"
    )
    (path,) = (site.parent / "kept").glob("*.checkout.*.sat.json")
    identity = json.loads(path.read_text())["controller"]["fingerprint"]["identity"]
    assert identity["product_code"] == "simulated generic-coils"

    path.write_text(path.read_text().replace('"product_code": "simulated', '"product_code": "another'))
    again = re.sub(r"\s+", " ", piped(site, "", "--item", "R-02", "--probe-identity").stdout)
    assert "caution: the controller said that it is vendor lift-manager, product code another generic-coils" in again


def test_a_second_person_confirms_from_a_phone_and_the_terminal_goes_on(site: Path) -> None:
    with terminal(
        "checkout", str(site), "lift1", *WHO, "--item", "R-01", "--item", "R-02", "--phone", "127.0.0.1"
    ) as person:
        url = person.expect(r"http://127\.0\.0\.1:\d+/[a-z2-7]{16}")
        person.answer(*PRECONDITIONS[0])
        person.expect("permit to work.*?> ")
        with httpx.Client(timeout=HANGS_S) as phone:
            assert phone.get(url).status_code == 200
            person.expect("phone: opened from 127.0.0.1.*permit to work.*?> ")
            phone.post(f"{url}/seen", data={"name": "Cy Okafor"})
            person.answer("phone: Cy Okafor takes part.*permit to work", "P-7")
            for pattern, line in PRECONDITIONS[2:]:
                person.answer(pattern, line)
            person.answer(f"R-01.*?{YES_NO}", "y")
            person.expect(f"R-01: pass.*?R-02.*?{YES_NO}")
            number = re.search(r'name="number" value="(\d+)"', phone.get(url).text)
            assert number is not None
            assert phone.post(f"{url}/seen", data={"number": number[1]}).status_code == 200
            person.answer(f"R-01: Cy Okafor saw it, by phone .*?{YES_NO}", "phone")
            assert person.expect(r"http://127\.0\.0\.1:\d+/[a-z2-7]{16}") != url
            assert phone.get(url).status_code == 404
        person.answer(YES_NO, "y")
        assert person.ended() == 3
    (path,) = (site.parent / "kept").glob("*.checkout.*.sat.json")
    (confirmed,) = json.loads(path.read_text())["confirmations"]
    assert (confirmed["item"], confirmed["result"], confirmed["name"], confirmed["by"]) == (
        "R-01",
        1,
        "Cy Okafor",
        "phone",
    )


def test_the_last_result_waits_for_a_phone_that_takes_part(site: Path) -> None:
    with terminal("checkout", str(site), "lift1", *WHO, "--item", "R-01", "--phone", "127.0.0.1") as person:
        url = person.expect(r"http://127\.0\.0\.1:\d+/[a-z2-7]{16}")
        for pattern, line in PRECONDITIONS:
            person.answer(pattern, line)
        person.expect(f"R-01.*?{YES_NO}")
        with httpx.Client(timeout=HANGS_S) as phone:
            phone.get(url)
            phone.post(f"{url}/seen", data={"name": "Cy"})
            person.answer(f"takes part.*?{YES_NO}", "y")
            person.expect(rf"Cy can still confirm R-01 on the phone.*?{DONE}")
            assert phone.post(f"{url}/seen", data={"number": "1"}).status_code == 200
            person.answer(f"R-01: Cy saw it, by phone.*?{DONE}", "")
        assert person.ended() == 3
        with pytest.raises(httpx.TransportError):
            httpx.get(url)


def test_a_running_manager_is_left_alone(site: Path) -> None:
    with Started() as start:
        start("serve", site, "--port", "0").says("/docs")
        done = piped(site, "", *WHO, "--item", "R-01")
    assert done.returncode == 1
    assert "stop that one first, because a checkout runs a manager of its own" in done.stderr


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (("main", *WHO), 1, "has no lift main; it has lift1"),
        (("lift1",), 2, "who runs the test"),
        (("lift1", *WHO, "--phone", "0.0.0.0"), 1, "0.0.0.0 is every address of this computer, and a phone needs one"),
        (("lift1", *WHO, "--item", "S-99"), 1, "there is no item S-99; `--list` shows all of them"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_is_touched(
    tmp_path: Path, words: tuple[str, ...], code: int, reason: str
) -> None:
    site = tmp_path / "site.yaml"
    lift = {"controller": "plc", "floors": {"L1": 0, "L2": 1}}
    content = {
        "schema": 1,
        "name": "bench",
        "state": "kept",
        "controllers": {"plc": {"host": "192.0.2.5", "map": "generic-coils"}},
        "lifts": {"lift1": lift},
    }
    site.write_text(json.dumps(content))
    done = call("checkout", str(site), *words)
    assert done.returncode == code
    assert reason in re.sub(r"[\s│]+", " ", done.stderr)
    assert not list(tmp_path.glob("kept/*.json"))
