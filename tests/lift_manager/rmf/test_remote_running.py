"""The way to a manager that runs: what is asked, answered and heard, in its order, and over a kill and a start of the manager."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from lift_manager.lab.bench import LiftSite
from lift_manager.plain.rmf import HeldBy, LiftView, SiteView
from lift_manager.rmf.port import Answer, EndOfSession, SessionDemand
from lift_manager.rmf.remote_manager import Pace, RemoteManager
from tests.lift_manager.rmf.remote_rig import Lost, Received, RecordingListener, connected
from tests.support.programs import Program, Started, free_port

LIFT = "goods-1"
SESSION = "fleet/amr-7"
WANTED = SessionDemand(LIFT, SESSION, "L2", hold_door=True)
PORT = r"127\.0\.0\.1:(\d+)"


def until(listener: RecordingListener, wanted: Callable[[LiftView], bool]) -> SiteView:
    """Hear on until the lift is so; the test's time limit ends it."""
    while not wanted((site := listener.next_site().site).lifts[0]):
        pass
    return site


def ride(remote: RemoteManager, listener: RecordingListener) -> None:
    """Want the floor again, as RMF does, until the door is open there: a press that was lost is made anew."""
    is_there = False
    while not is_there:
        remote.send(WANTED)
        answer = listener.next_answer()
        if answer.code == "offline":
            continue  # on a computer too busy to read its lift in time RMF asks again, too
        assert holder_once_shown(listener, answer) == HeldBy("rmf", SESSION)
        for _ in range(3):
            lift = listener.next_site().site.lifts[0]
            is_there = (lift.door, lift.floor) == ("open", WANTED.floor)


def holder_once_shown(listener: RecordingListener, answer: Answer) -> HeldBy | None:
    """Return who holds the lift by the first answer that shows what was decided."""
    assert answer.accepted, answer
    while (site := listener.next_site().site).event < answer.event:
        assert site.boot == answer.boot
    return site.lifts[0].holder


@pytest.mark.lift(LIFT, speed=10)
class TestALiftThatRuns:
    @pytest.fixture
    def port(self, lift_site: LiftSite) -> int:
        port = urlsplit(lift_site.address).port
        assert port is not None
        return port

    def test_the_lift_is_as_its_site_says(self, port: int) -> None:
        with connected(port, Pace(), key="") as (_, listener):
            lift = until(listener, lambda lift: lift.live).lifts[0]
        assert (lift.lift, lift.name, lift.floor, lift.holder) == (LIFT, LIFT, "L1", None)
        assert list(lift.floors.items()) == [(floor, floor) for floor in ("L1", "L2", "L3", "L4")]

    def test_a_ride_and_its_end_are_shown_by_the_event_of_their_answer(self, port: int) -> None:
        with connected(port, Pace(), key="") as (remote, listener):
            until(listener, lambda lift: lift.live)
            ride(remote, listener)
            remote.send(EndOfSession(LIFT, SESSION, 0.0))
            assert holder_once_shown(listener, listener.next_answer()) is None
            until(listener, lambda lift: lift.door == "closed")

    def test_what_it_does_not_do_it_refuses_with_a_code(self, port: int) -> None:
        with connected(port, Pace(), key="") as (remote, listener):
            until(listener, lambda lift: lift.live)
            for asked, code in (
                (SessionDemand("attic", SESSION, "L1", hold_door=True), "unknown_lift"),
                (SessionDemand(LIFT, SESSION, "L9", hold_door=True), "unknown_floor"),
                (SessionDemand(LIFT, "", "L1", hold_door=True), "malformed"),
                (WANTED, ""),
                (SessionDemand(LIFT, "fleet/amr-8", "L1", hold_door=True), "held"),
            ):
                remote.send(asked)
                answer = listener.next_answer()
                assert (answer.request, answer.accepted, answer.code) == (asked, not code, code), answer


class Building:
    """A simulated lift, and its manager on a port that stays the same."""

    def __init__(self, start: Started, folder: Path) -> None:
        simulator = start("simulate", "generic-registers", "--port", "0", "--floors", "L1=1,L2=2", "--speed", "10")
        controller = {"host": "127.0.0.1", "port": int(simulator.says(PORT)[1]), "map": "generic-registers"}
        lift = {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.1}
        content = {"schema": 1, "name": "A", "state": "kept", "controllers": {"plc": controller}, "lifts": {LIFT: lift}}
        (folder / "site.yaml").write_text(json.dumps(content), "utf-8")  # JSON is YAML
        self._start, self._file, self.port = start, folder / "site.yaml", free_port()
        self.manager = self.serve()

    def serve(self) -> Program:
        self.manager = self._start("serve", self._file, "--port", str(self.port))
        return self.manager

    def kill(self) -> None:
        self.manager.tell(signal.SIGKILL)
        self.manager.ended()


def test_a_session_goes_on_over_a_kill_and_a_start_of_the_manager(tmp_path: Path) -> None:
    with Started() as start:
        building = Building(start, tmp_path)
        with connected(building.port, Pace(), key="") as (remote, listener):
            while isinstance(listener.next(), Lost):
                pass  # it is not there yet
            site = until(listener, lambda lift: lift.live)
            ride(remote, listener)
            building.kill()
            assert "no manager answers" in listener.next_loss()
            remote.send(EndOfSession(LIFT, "fleet/amr-8", 3.0))
            assert listener.next_answer().code == "unreachable"
            building.serve()
            while isinstance(again := listener.next(), Lost):
                pass  # a connection that ends is another reason than one that is refused
            assert isinstance(again, Received)
            assert again.site.boot != site.boot
            assert until(listener, lambda lift: lift.live).lifts[0].holder == HeldBy("rmf", SESSION)
            ride(remote, listener)
