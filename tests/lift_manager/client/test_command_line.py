"""`lift-manager lifts` and `lift-manager ride` against a running manager."""

import json
import os
import pty
import shlex
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest

from lift_manager.lab.bench import LiftSite
from lift_manager.lift.occupancy import RobotWord
from tests.support.forked import Forked
from tests.support.programs import HANGS_S, Started, call, free_port, run

pytestmark = pytest.mark.lift("main", speed=20)
RIDE = ("ride", "any", "L2", "L3", "--robot", "amr-7", "--manager")


def test_the_lifts_are_shown_in_a_table_and_as_json(lift_site: LiftSite) -> None:
    table = call("lifts", "--manager", lift_site.address)
    assert table.returncode == 0
    head, line = table.stdout.splitlines()
    assert head.split() == ["lift", "floor", "door", "motion", "mode", "held", "by", "age"]
    assert line.split()[:5] == ["main", "L1", "front", "closed", "stopped"]
    (lift,) = json.loads(call("lifts", "--json", "--manager", lift_site.address).stdout)
    assert (lift["name"], lift["quality"]) == ("main", "live")


def test_what_keeps_robots_off_stands_below_the_table_and_is_not_folded(lift_site: LiftSite) -> None:
    lift_site.lock_out(by="M. Weber", reason="new ropes, and a car that waits for its second inspection on Monday")
    _, line, note = call("lifts", "--manager", lift_site.address).stdout.splitlines()
    assert line.startswith("main ")
    assert note.startswith("main: locked out by M. Weber")
    assert note.endswith("inspection on Monday")


def test_changes_are_followed(lift_site: LiftSite) -> None:
    with Started() as start:
        following = start("lifts", "--follow", "--manager", lift_site.address)
        following.says(r"main: normal, at L1, door front closed, stopped")
        lift_site.request("L1", by="amr-9", robot=RobotWord.IN_PLACE)
        following.says(r"main: .*held by amr-9 \(bench\)")
        lift_site.request("L1", by="amr-9", hold_door=False)
        following.says(r"main: .*, robot amr-9 \(bench\) may be in the car")
        lift_site.lock_out(by="M. Weber", reason="new ropes")
        following.says(r"main: .*new ropes")
        code, _ = following.stop(signal.SIGINT)
        assert code == 0
        # on a busy computer the manager may be late
        assert set(following.err.splitlines()) <= {"the manager does not answer; this continues once it does"}


def test_without_a_manager_one_sentence_says_so(tmp_path: Path) -> None:
    for words in (("lifts", "--manager"), ("lifts", "--follow", "--manager"), (*RIDE[:-1], "--yes", "--manager")):
        done = call(*words, f"http://127.0.0.1:{free_port()}")
        assert done.returncode == 1
        assert done.stderr.startswith("no manager answers at http://127.0.0.1:")
        assert "Traceback" not in done.stderr


def test_a_ride_by_itself_gets_there(lift_site: LiftSite) -> None:
    done = call(*RIDE, lift_site.address, "--yes")
    assert done.returncode == 0, done
    told = [line.partition(": ")[2].split(";")[0] for line in done.stdout.splitlines()]
    assert [word for word in told if word in ("enter", "leave", "done")] == ["enter", "leave", "done"]


@pytest.mark.external("curl")
def test_what_the_demo_says_to_type_shows_its_lifts_and_rides_one() -> None:
    with Started() as start:
        demo = start("demo", "--port", "0", "--speed", "20")
        manager = demo.says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
        demo.says("Ctrl-C ends the demo")
        lifts, ride, events = (
            shlex.split(demo.says(rf"\n  {name}: +(.*)\n")[1]) for name in ("lifts", "ride", "events")
        )
        assert Path(ride[0]).name == "lift-manager"
        assert ride[1:] == ["ride", "lift", "L1", "L2", "--robot", "demo", "--yes", "--manager", manager]
        done = call(*ride[1:])
        assert (done.returncode, done.stdout.count(": done")) == (0, 1)
        told = subprocess.run([*lifts, "-s"], capture_output=True, check=True, timeout=HANGS_S).stdout
        assert [lift["name"] for lift in json.loads(told)["lifts"]] == ["lift", "tower", "goods"]
        # curl ends with 28 at its own limit: the stream itself has no end
        stream = subprocess.run([*events, "-s", "-m", "0.5"], capture_output=True, check=False, timeout=HANGS_S)
        assert (stream.returncode, b"event: snapshot" in stream.stdout) == (28, True)


def test_without_a_terminal_nobody_can_say_the_words(lift_site: LiftSite) -> None:
    done = run(*RIDE, lift_site.address)
    assert done.returncode == 2
    assert "--yes" in done.stderr


def test_what_the_manager_refuses_is_said_in_its_words(lift_site: LiftSite) -> None:
    done = call("ride", "main", "L2", "L9", "--robot", "amr-7", "--yes", "--manager", lift_site.address)
    assert done.returncode == 1
    assert "L9" in done.stderr


def test_ctrl_c_cancels_and_waits_for_the_end(lift_site: LiftSite) -> None:
    with lift_site.held("L4"), Started() as start:
        program = start(*RIDE, lift_site.address, "--yes")
        program.says(r"wait \(1 ahead\)")
        code, _ = program.stop(signal.SIGINT)
        assert code == 3
        assert "cancelled" in program.out


def test_a_closed_terminal_cancels_and_the_end_is_seen_although_nobody_reads_it(lift_site: LiftSite) -> None:
    ours, theirs = pty.openpty()
    with lift_site.held("L4"):
        program = Forked([*RIDE, lift_site.address, "--yes"], env=os.environ, stdin=theirs, out=theirs, err=theirs)
        os.close(theirs)
        try:
            seen = b""
            while b"(1 ahead)" not in seen:
                seen += os.read(ours, 4096)
            os.close(ours)
            program.send_signal(signal.SIGHUP)
            assert program.wait(HANGS_S) == 3
        finally:
            program.kill()


@dataclass
class AtATerminal:
    """A program at whose keyboard a person sits; what it says is read line by line."""

    program: Forked
    keyboard: int
    out: IO[bytes]
    err: IO[bytes]

    def type(self, keys: bytes) -> None:
        os.write(self.keyboard, keys)


@contextmanager
def at_a_terminal(*words: str) -> Iterator[AtATerminal]:
    keyboard, terminal = pty.openpty()
    (out, its_out), (err, its_err) = os.pipe(), os.pipe()
    program = Forked(words, env=os.environ, stdin=terminal, out=its_out, err=its_err)
    for file in (terminal, its_out, its_err):
        os.close(file)
    with os.fdopen(out, "rb") as said, os.fdopen(err, "rb") as asked:
        try:
            yield AtATerminal(program, keyboard, said, asked)
        finally:
            program.kill()
            os.close(keyboard)


def test_at_a_terminal_a_person_says_the_words(lift_site: LiftSite) -> None:
    with at_a_terminal(*RIDE, lift_site.address) as person:
        for prompt in (b"is inside", b"is outside"):
            assert prompt in person.err.readline()
            person.type(b"\n")
        assert person.program.wait(HANGS_S) == 0
        assert b"done" in person.out.read()


def test_enter_before_it_is_asked_for_and_the_end_of_the_input_are_no_words(lift_site: LiftSite) -> None:
    with at_a_terminal(*RIDE, lift_site.address) as person:
        assert b": wait" in person.out.readline()
        person.type(b"\n\n")
        assert b"is inside" in person.err.readline()
        person.type(b"\x04")
        assert person.err.readline().startswith(b"cancelled")
        assert b"is outside" in person.err.readline()
        person.type(b"\n")
        assert person.program.wait(HANGS_S) == 3
        assert b"L3: stay" not in person.out.read()
