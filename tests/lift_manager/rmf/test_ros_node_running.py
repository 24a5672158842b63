"""The whole node in real time: the way to a manager over HTTP, and how it ends."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from lift_manager.plain.paths import RMF
from lift_manager.plain.rmf import SiteView
from lift_manager.rmf.messages import DOOR_MOVING, DOOR_OPEN, MODE_OFFLINE
from tests.support.fake_rclpy_loader import FOLDER, Ros, installed, lift

HOME = Path(__file__).resolve().parents[3]
ANSWER = json.dumps(dataclasses.asdict(SiteView("boot", 1, (lift(),), 3.0)))
MAIN = "import sys; from lift_manager.rmf.ros_node import main; sys.exit(main())"


class _Manager(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        status, text = (200, ANSWER) if self.path == RMF else (404, "{}")
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text.encode())

    def log_request(self, code: object = "-", size: object = "-") -> None:
        """Say nothing: pytest shows what a test prints."""


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let an adapter hang up in the middle of an answer, which is how it ends."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


@pytest.fixture
def port() -> Iterator[int]:
    """Where a manager of one lift answers."""
    with _Server(("127.0.0.1", 0), _Manager) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


class Running:
    """`run` in this thread, on a node whose publications are seen as they are made."""

    def __init__(self, ros: Ros, port: int) -> None:
        self.ros = ros
        self.said: list[Any] = []
        self.stopping = threading.Event()
        ros.world.real_time = True
        ros.world.parameters.update(manager_address="127.0.0.1", manager_port=port)
        ros.rclpy.init()

    def run(self, on_first: Callable[[], object]) -> None:
        """Do this when the first state goes out."""

        def published(topic: str, message: Any) -> None:
            assert topic == "/lift_states"
            self.said.append(message)
            if len(self.said) == 1:
                on_first()

        self.ros.world.on_published = published
        self.ros.ros_node.run(sys.modules["rclpy.node"].Node("lift_adapter"), self.stopping)


@pytest.fixture(params=["humble", "rolling"])
def running(request: pytest.FixtureRequest, port: int) -> Iterator[Running]:
    with installed(request.param) as ros:
        yield Running(ros, port)


def test_the_last_word_is_that_the_lifts_are_offline(running: Running) -> None:
    before = threading.enumerate()
    running.run(running.stopping.set)
    first, last = running.said[0], running.said[-1]
    assert (first.lift_name, first.current_floor, first.door_state) == ("Lift 1", "L1", DOOR_OPEN)
    assert (last.lift_name, last.current_mode, last.door_state) == ("Lift 1", MODE_OFFLINE, DOOR_MOVING)
    left = [thread.name for thread in threading.enumerate() if thread not in before]
    assert [name for name in left if "process_request_thread" not in name] == []  # of the manager of this test


def test_after_a_bug_the_lifts_are_offline_and_the_program_ends(running: Running) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        running.run(fail)
    assert [state.current_mode for state in running.said][1:] == [MODE_OFFLINE]


def test_where_ros_ends_first_nothing_more_is_published(running: Running) -> None:
    running.run(running.ros.rclpy.shutdown)
    assert [state.current_floor for state in running.said] == ["L1"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_program_in_order(port: int, number: signal.Signals) -> None:
    with _program(port) as program:
        assert program.stdout is not None
        assert "door_state=2" in program.stdout.readline()
        program.send_signal(number)
        rest, errors = program.communicate(timeout=120)
    assert program.returncode == 0
    assert {line.split()[0] for line in errors.splitlines()} == {"[info]"}
    assert "the manager answers: Lift 1" in errors
    last = rest.splitlines()[-1]
    assert f"current_mode={MODE_OFFLINE}" in last
    assert "door_state=1" in last


@pytest.mark.parametrize(
    ("parameter", "why"),
    [
        ("manager_port:=70000", "port 70000 does not exist; it is a number from 1 to 65535"),
        (
            "manager_address:=my lifts",
            "'my lifts' is no address; write a host, host:port, or a URL such as https://lifts.example:5003",
        ),
        (
            "adapter_id:=a@b",
            "the adapter's id is 'a@b'; it is made of letters, digits and . _ / -, at most 300 of them",
        ),
    ],
)
def test_settings_that_cannot_be_used_end_the_program_with_two(parameter: str, why: str) -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with installed("jazzy") as ros:
        try:
            assert ros.ros_node.main(["program", "--ros-args", "-p", parameter]) == 2
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            logging.getLogger("lift_manager").setLevel(logging.NOTSET)
        assert ros.world.log == [("fatal", why)]
        # those of rclpy would end the context before the last word is said
        assert ros.world.signal_handlers == "NO"
        assert not ros.world.context_is_up


def _program(port: int) -> subprocess.Popen[str]:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(FOLDER), str(HOME)]),
        "FAKE_ROS_DISTRO": "jazzy",
        "FAKE_ROS_REAL_TIME": "1",
        "FAKE_ROS_PRINTS": "1",
    }
    where = ["-p", "manager_address:=127.0.0.1", "-p", f"manager_port:={port}"]
    command = [sys.executable, "-c", MAIN, "--ros-args", *where]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
