"""The fixtures for robot teams: used here as they would use them, and in small test files of their own where a test must fail."""

import asyncio
import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from lift_manager.lab.bench import Bench, BenchError, ConditionNotMet, LiftSimulator, LiftSite, ModbusFaults
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE
from lift_manager.lift.events import Acknowledged, Alarm, CommandEnded, Restriction, RestrictionEnded, SessionEnded
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Accepted, Refused
from lift_manager.lift.session import EndReason
from lift_manager.lift.state import Quality
from register_maps.load import load
from register_maps.words import Door, Mode, Side
from simulator.faults import InMode, Overload, StuckDoor, WrongFloor
from simulator.wire_faults import Access, DropRequest, LateAnswer, Target
from tests.support.pages import blocks
from tests.support.programs import HANGS_S
from tests.support.rows import each_row

pytest_plugins = "pytester"
pytestmark = pytest.mark.timeout(
    600
)  # real processes and sockets: a loaded machine may take long, and what hangs ends all the same

ROOT = Path(__file__).resolve().parents[3]
CAR_FLOOR = bytes.fromhex("000100000006010300010001")
"""Read the second holding register of unit 1: the car's floor on the generic map."""


def asked(port: int, frame: bytes, timeout_s: float = 5.0) -> bytes:
    """What a device answers, or nothing where the time is over first."""
    with socket.create_connection(("127.0.0.1", port), timeout=timeout_s) as connection:
        connection.sendall(frame)
        try:
            return connection.recv(256)
        except TimeoutError:
            return b""


def is_open_at(floor: str) -> Callable[[Any], bool]:
    return lambda state: state.floor == floor and state.robot_door is RobotDoor.OPEN


# -- the lift and its controller


def test_a_simulated_controller_answers_on_a_port_of_its_own(lift_simulator: LiftSimulator) -> None:
    assert asked(lift_simulator.port, CAR_FLOOR)[-2:] == b"\x00\x01"
    assert (lift_simulator.host, lift_simulator.name) == ("127.0.0.1", "lift")
    assert lift_simulator.floors == ("L1", "L2", "L3", "L4")
    assert lift_simulator.writes == ()


@pytest.mark.lift("goods", map="two-stop-agv", floors={"low": 0, "high": 1}, speed=5, faults=["overload"])
def test_a_marker_chooses_the_lift(lift_simulator: LiftSimulator) -> None:
    assert (lift_simulator.name, lift_simulator.floors) == ("goods", ("low", "high"))
    assert lift_simulator.truth.at == "low"
    assert lift_simulator.faults == {Overload()}


def test_people_bring_the_car_and_nobody_wrote_anything(lift_simulator: LiftSimulator) -> None:
    lift_simulator.press_landing("L3")
    assert lift_simulator.wait_for(lambda truth: truth.open_at == "L3").standing
    lift_simulator.press_car("L2")
    lift_simulator.wait_for(lambda truth: truth.open_at == "L2")
    lift_simulator.wait_for(lambda truth: truth.doors_shut)
    assert lift_simulator.writes == ()
    stops = [truth.open_at for _, truth in lift_simulator.history if truth.open_at is not None]
    assert list(dict.fromkeys(stops)) == ["L3", "L2"]
    times = [at for at, _ in lift_simulator.history]
    assert times == sorted(times)


def test_somebody_in_the_doorway_keeps_the_door_open(lift_simulator: LiftSimulator) -> None:
    lift_simulator.block_doorway(Side.FRONT)
    lift_simulator.press_landing("L1")
    lift_simulator.wait_for(lambda truth: truth.open_at == "L1")
    with pytest.raises(ConditionNotMet):
        lift_simulator.wait_for(lambda truth: truth.doors_shut, within_s=0.6)
    lift_simulator.block_doorway()
    lift_simulator.wait_for(lambda truth: truth.doors_shut)


def test_a_fault_is_given_by_value_or_by_name(lift_simulator: LiftSimulator) -> None:
    assert lift_simulator.begin("stuck_door") == StuckDoor()
    lift_simulator.end(StuckDoor())
    assert lift_simulator.begin("wrong_floor", by=-1) == WrongFloor(-1)
    assert lift_simulator.begin("stuck_door", side="rear") == StuckDoor(Side.REAR)
    with lift_simulator.fault("in_mode.fire") as fire:
        assert fire == InMode(Mode.FIRE)
        assert lift_simulator.faults == {WrongFloor(-1), StuckDoor(Side.REAR), fire}
        lift_simulator.wait_for(lambda truth: truth.mode is Mode.FIRE)
    lift_simulator.wait_for(lambda truth: truth.mode is Mode.NORMAL)


@each_row(
    ("name", "values", "words"),
    [
        ("stuck_doors", {}, "no fault of a lift has the name 'stuck_doors'; did you mean `stuck_door`?"),
        ("stuck_door", {"sid": "rear"}, "stuck_door has no 'sid'; did you mean `side`?; it has side"),
        ("stuck_door", {"side": "left"}, "stuck_door: side Input should be 'front' or 'rear'"),
        ("in_mode", {}, "in_mode needs mode, such as 'in_mode', mode=..."),
        (
            "foreign_writer",
            {"command": "go_to", "floor": "L9"},
            "foreign_writer: no floor 'L9'; there is L1, L2, L3, L4",
        ),
        ("foreign_writer", {"command": "fly"}, "lift: "),
        (DropRequest(), {}, "DropRequest(times=None"),
        (StuckDoor(), {"side": "rear"}, "has its values already; leave out side"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_in_words(
    lift_simulator: LiftSimulator, name: Any, values: dict[str, object], words: str
) -> None:
    with pytest.raises(BenchError, match=re.escape(words)):
        lift_simulator.begin(name, **values)
    assert lift_simulator.faults == frozenset()


def test_what_has_not_begun_cannot_end(lift_simulator: LiftSimulator) -> None:
    with pytest.raises(BenchError, match=r"StuckDoor\(.*\) has not begun, or has ended; present: none"):
        lift_simulator.end("stuck_door")


def test_a_button_of_a_floor_that_is_not_there_is_refused_in_words(lift_simulator: LiftSimulator) -> None:
    with pytest.raises(BenchError, match="no floor 'roof'; there is L1, L2, L3, L4"):
        lift_simulator.press_landing("roof")


def test_people_do_all_that_they_can_do_at_the_panel(lift_simulator: LiftSimulator) -> None:
    at_rest = lift_simulator.inputs
    lift_simulator.set_inputs(overload=True, key="independent", landing_buttons=["L2"])
    lift_simulator.wait_for(lambda truth: truth.mode is Mode.INDEPENDENT)
    assert lift_simulator.inputs.landing_buttons == frozenset({"L2"})
    lift_simulator.begin("stuck_door")
    lift_simulator.reset()
    assert (lift_simulator.inputs, lift_simulator.faults) == (at_rest, frozenset())
    lift_simulator.wait_for(lambda truth: truth.mode is Mode.NORMAL)


@each_row(
    ("changes", "words"),
    [
        ({"keys": "normal"}, "a lift has no input 'keys'; did you mean `key`?; there is car_buttons, "),
        ({"key": "turned"}, "inputs: key Input should be 'normal', 'independent'"),
        ({"obstruction": ["rear"]}, "lift: no rear door; there is front"),
    ],
)
def test_an_input_that_cannot_be_is_refused_in_words(
    lift_simulator: LiftSimulator, changes: dict[str, object], words: str
) -> None:
    with pytest.raises(BenchError, match=re.escape(words)):
        lift_simulator.set_inputs(**changes)


# -- the wire


def test_the_wire_has_a_port_of_its_own_and_its_faults(
    lift_simulator: LiftSimulator, modbus_faults: ModbusFaults
) -> None:
    assert modbus_faults.port != lift_simulator.port
    assert asked(modbus_faults.port, CAR_FLOOR) == asked(lift_simulator.port, CAR_FLOOR)
    with modbus_faults.fault("answer_with_exception", code=6) as busy:
        assert modbus_faults.present == (busy,)
        assert asked(modbus_faults.port, CAR_FLOOR)[-2:] == b"\x83\x06"
        assert [struck.fault for struck in modbus_faults.struck] == [busy]
    assert asked(modbus_faults.port, CAR_FLOOR)[-2:] == b"\x00\x01"


def test_a_silent_wire_answers_nothing_until_it_is_cleared(modbus_faults: ModbusFaults) -> None:
    modbus_faults.silence()
    assert asked(modbus_faults.port, CAR_FLOOR, timeout_s=0.2) == b""
    modbus_faults.clear()
    assert asked(modbus_faults.port, CAR_FLOOR)


def test_a_reset_strikes_one_request(modbus_faults: ModbusFaults) -> None:
    modbus_faults.reset()
    with pytest.raises(ConnectionResetError):
        asked(modbus_faults.port, CAR_FLOOR)
    assert asked(modbus_faults.port, CAR_FLOOR)


def test_a_fault_of_the_wire_has_targets_and_limits_by_name_too(modbus_faults: ModbusFaults) -> None:
    only = Target(access=Access.READS)
    assert modbus_faults.add("late_answer", seconds=0.1, times=2, on=only) == LateAnswer(0.1, times=2, on=only)


@each_row(
    ("name", "values", "words"),
    [
        ("late_answers", {}, "no fault of the wire has the name 'late_answers'; did you mean `late_answer`?"),
        ("delay", {}, "delay needs seconds"),
        ("late_answer", {"secs": 1}, "late_answer has no 'secs'"),
        (StuckDoor(), {}, "is no fault of the wire; there is accept_and_say_nothing"),
    ],
)
def test_a_fault_of_the_wire_that_cannot_be_is_refused_in_words(
    modbus_faults: ModbusFaults, name: Any, values: dict[str, object], words: str
) -> None:
    with pytest.raises(BenchError, match=re.escape(words)):
        modbus_faults.add(name, **values)
    with pytest.raises(BenchError, match=r"HalfOpen.* is not on the wire; there is none"):
        modbus_faults.remove("half_open")


# -- the manager


def test_a_ride_is_seen_from_every_side(lift_site: LiftSite, lift_simulator: LiftSimulator) -> None:
    answer = httpx.post(
        f"{lift_site.url}/lift_request",
        params={"lift_name": "lift"},
        json={"floor": "L2", "door_state": 2},
        timeout=HANGS_S,
    )
    assert answer.json()["success"]
    assert lift_site.wait_for(is_open_at("L2")).doors == {Side.FRONT: Door.OPEN}
    assert lift_simulator.truth.open_at == "L2"
    presses = [(write.command, write.floor) for write in lift_simulator.writes if write.on]
    assert presses == [("robot_mode", None), ("go_to", "L2"), ("hold_door.front", None)]
    lift_site.wait_for_event(lambda event: isinstance(event, CommandEnded))
    assert [str(outcome.command) for outcome in lift_site.outcomes] == ["go_to L2"]
    assert httpx.get(f"{lift_site.address}/docs", timeout=HANGS_S).status_code == 200
    assert lift_site.alarms == ()


def test_what_never_comes_fails_the_test_and_says_what_there_was(lift_site: LiftSite) -> None:
    with pytest.raises(ConditionNotMet, match=r"lift: .* within 0\.1 s\npublished: LiftState.*\ntruth: Truth\(at='L1'"):
        lift_site.wait_for(is_open_at("L2"), within_s=0.1)
    with pytest.raises(ConditionNotMet, match=r"no such event within 0\.1 s; there was nothing"):
        lift_site.wait_for_event(lambda event: isinstance(event, Alarm), within_s=0.1)


def test_a_mistake_in_a_condition_reaches_the_test(lift_site: LiftSite) -> None:
    with pytest.raises(ZeroDivisionError):
        lift_site.wait_for(lambda _: 1 / 0 > 0)
    with pytest.raises(BenchError, match="a condition that is waited for cannot wait itself"):
        lift_site.wait_for(lambda _: lift_site.wait_for(is_open_at("L1")).standing)
    assert lift_site.wait_for(lambda state: lift_site.state() is not None and state.standing).floor == "L1"


def test_an_asyncio_test_goes_on_while_it_waits(lift_site: LiftSite, lift_simulator: LiftSimulator) -> None:
    async def main() -> None:
        waiting = [
            asyncio.create_task(lift_site.when(is_open_at("L2"))),
            asyncio.create_task(lift_simulator.when(lambda truth: truth.open_at == "L2")),
            asyncio.create_task(lift_site.when_event(lambda event: isinstance(event, SessionEnded))),
        ]
        async with httpx.AsyncClient(base_url=lift_site.url, params={"lift_name": "lift"}, timeout=HANGS_S) as client:
            for door in (2, 0):
                await client.post("/lift_request", json={"floor": "L2", "door_state": door})
                await waiting[0]
        await asyncio.gather(*waiting)
        with pytest.raises(ConditionNotMet):
            await lift_site.when(lambda state: state.floor == "L4", within_s=0.05)

    asyncio.run(main())


def test_a_fire_is_latched_until_somebody_acknowledges_it(lift_site: LiftSite, lift_simulator: LiftSimulator) -> None:
    assert isinstance(lift_site.request("L2"), Accepted)
    lift_simulator.set_fire(True)
    ended = lift_site.wait_for_event(lambda event: isinstance(event, SessionEnded)).what
    assert isinstance(ended, SessionEnded)
    assert ended.reason is EndReason.FIRE
    lift_simulator.set_fire(False)
    lift_site.wait_for(lambda state: state.mode is Mode.NORMAL)
    assert isinstance(lift_site.request("L2"), Refused)
    assert isinstance(lift_site.acknowledge(by="Li"), Acknowledged)
    assert isinstance(lift_site.request("L2"), Accepted)
    assert [refused.code for refused in lift_site.refusals] == ["fire_latched"]
    assert any("fire" in text for text in lift_site.alarms)


def test_a_lift_that_somebody_holds_is_free_again_afterwards(lift_site: LiftSite) -> None:
    with lift_site.held("L2", by="cleaner"):
        assert str(lift_site.state().holder) == "bench:cleaner"
        with pytest.raises(BenchError, match="guard may not hold the lift: held by bench:cleaner"):
            lift_site.held("L1", by="guard").__enter__()
    lift_site.wait_for(lambda state: state.holder is None)


def test_a_person_locks_the_lift_out_and_in_again(lift_site: LiftSite) -> None:
    assert isinstance(lift_site.lock_out(by="Li", reason="moving house"), Restriction)
    assert isinstance(lift_site.request("L2"), Refused)
    assert isinstance(lift_site.end_lockout(by="Li"), RestrictionEnded)
    assert isinstance(lift_site.request("L2"), Accepted)


def test_a_manager_that_stops_lets_go_and_is_gone(lift_site: LiftSite, lift_simulator: LiftSimulator) -> None:
    lift_site.request("L2")
    lift_site.wait_for(is_open_at("L2"))
    assert lift_simulator.truth.given
    assert lift_site.stop()
    assert lift_simulator.truth.given == ()
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{lift_site.url}/lift_names")


@pytest.mark.lift("west", faults="power_loss")
@pytest.mark.lift("east", floors={"G": 1, "top": 2})
def test_lifts_of_one_site_have_faults_of_their_own(lift_site: LiftSite, modbus_faults: ModbusFaults) -> None:
    assert lift_site.lifts == ("west", "east")
    assert lift_site.simulator("east").floors == ("G", "top")
    lift_site.wait_for(lambda state: state.quality is Quality.OFFLINE, lift="west")
    assert lift_site.state("east").quality is Quality.LIVE
    modbus_faults.of("east").cut()
    assert lift_site.modbus_faults("west").present == ()
    assert len(modbus_faults.present) == 1
    lift_site.simulator("west").end("power_loss")
    lift_site.wait_for(lambda state: state.quality is Quality.LIVE, lift="west")
    lift_site.wait_for(lambda state: state.quality is Quality.OFFLINE, lift="east")


@pytest.mark.lift("west")
@pytest.mark.lift("east")
def test_of_several_lifts_one_must_be_named(lift_site: LiftSite, modbus_faults: ModbusFaults) -> None:
    with pytest.raises(BenchError, match="there are several lifts, west, east; name one, such as lift='west'"):
        lift_site.state()
    with pytest.raises(BenchError, match="no lift 'north'; there is west, east"):
        lift_site.state("north")
    with pytest.raises(BenchError, match="no lift 'north'; there is west, east"):
        modbus_faults.of("north")
    with pytest.raises(BenchError, match=r"there are 2 lifts; name one, such as modbus_faults.of\('west'\).port"):
        assert modbus_faults.port


SENSOR = {
    "endpoints": {"sensor": {"served": {"discrete": [[1, 5]]}}},
    "signals": {
        "car_floor": {"one_of": ["sensor/discrete:1", "sensor/discrete:2", "sensor/discrete:3"]},
        "door.front": {"open_limit": "sensor/discrete:4", "closed_limit": "sensor/discrete:5"},
    },
}


@pytest.mark.lift(map="adam-pushbutton", floors={"G": 0, "L1": 1, "L2": 2}, override=SENSOR)
def test_a_lift_on_two_devices_has_a_port_and_a_wire_for_each(
    lift_site: LiftSite, lift_simulator: LiftSimulator, modbus_faults: ModbusFaults
) -> None:
    assert set(lift_simulator.ports) == {"", "sensor"}
    lift_site.request("L2")
    lift_simulator.wait_for(lambda truth: truth.at == "L2")
    lift_site.wait_for(lambda state: state.floor == "L2")
    modbus_faults.silence()
    lift_site.wait_for(lambda state: state.quality is Quality.OFFLINE)


# -- what stays when a test is over


def open_files() -> set[str]:
    """What this process has open, by number and kind."""
    links = list(Path("/proc/self/fd").iterdir())
    return {f"{link.name} {link.readlink()}" for link in links if link.is_symlink()}


def test_a_controller_has_as_many_slots_as_its_map_says(tmp_path: Path) -> None:
    shipped = load("generic-registers").path.read_text("utf-8")
    (tmp_path / "one-slot.yaml").write_text(shipped.replace("link: {", "link: {max_connections: 1, ", 1), "utf-8")
    with Bench([{"name": "lift", "map": "./one-slot.yaml"}], near=tmp_path, folder=tmp_path) as bench:
        port = bench.simulator().port
        with socket.create_connection(("127.0.0.1", port)) as first:
            first.sendall(CAR_FLOOR)
            assert first.recv(256)[-2:] == b"\x00\x01"
            with socket.create_connection(("127.0.0.1", port)) as second, pytest.raises(ConnectionResetError):
                second.recv(1)
            first.sendall(CAR_FLOOR)
            assert first.recv(256)[-2:] == b"\x00\x01"


def test_nothing_is_left_of_a_bench(tmp_path: Path) -> None:
    threads, files = threading.active_count(), open_files()
    with Bench([], near=tmp_path, folder=tmp_path) as bench:
        site = bench.site()
        bench.modbus_faults().cut()
        client = socket.create_connection(("127.0.0.1", int(site.address.rpartition(":")[2])))
        site.request("L2")
    assert client.recv(1) == b""
    client.close()
    assert threading.active_count() == threads
    assert open_files() == files


def test_two_benches_at_once_have_nothing_in_common(tmp_path: Path) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    with Bench([], near=tmp_path, folder=folders[0]) as one, Bench([], near=tmp_path, folder=folders[1]) as other:
        sites = one.site(), other.site()
        assert sites[0].address != sites[1].address
        assert one.simulator().port != other.simulator().port
        sites[0].request("L2")
        sites[0].wait_for(is_open_at("L2"))
        assert sites[1].state().holder is None
        assert other.simulator().writes == ()


# -- tests that must fail, in files of their own


def outcome_of(pytester: pytest.Pytester, body: str) -> tuple[dict[str, int], str]:
    """Run a test file; return how its tests ended, and all that pytest said."""
    pytester.makepyfile(f"import logging\nimport pytest\n\n{body}")
    done = pytester.runpytest_inprocess(
        "-p", "no:cacheprovider", "-p", "no:randomly", "-p", "no:schemathesis", "-W", "error", "--strict-markers"
    )
    return done.parseoutcomes(), done.stdout.str()


MISTAKES = [
    ("flors={'L1': 1, 'L2': 2}", "@pytest.mark.lift has no 'flors'; did you mean `floors`?"),
    ("controller='plc'", "@pytest.mark.lift has no 'controller'; the bench sets that itself"),
    ("'a', 'b'", "@pytest.mark.lift takes one name and then keys, not 'a', 'b'"),
    ("'a', name='b'", "@pytest.mark.lift names its lift twice: 'a' and 'b'"),
    ("name=7", "the name of a lift is text, not 7"),
    (
        "map='generic-register'",
        "lift: map generic-register cannot be used: generic-register: no map has this name; did",
    ),
    ("map=7", "lift: map must be the name of a shipped map or a path, not 7"),
    ("map='./nowhere.yaml'", "lift: map ./nowhere.yaml cannot be used: "),
    ("floors=['L1', 'L2']", "lift: floors must be two or more, lowest first"),
    (
        "floors={'L1': 'one', 'L2': 2}",
        'lift: floors are names with codes, such as {"L1": 1}, or {"L1": {"code": 1, "doors": ["rear"]}}, not {\'L1\': \'one\'}',
    ),
    ("floors={'L1': {'code': 1, 'doors': ['left']}, 'L2': 2}", "lift: floors are names with codes, such as "),
    ("floors={'L1': True, 'L2': 2}", "lift: floors are names with codes, such as "),
    ("map='two-stop-agv', floors={'L1': 0, 'L9': 9}", "lift: "),
    ("speed=0", "lift: speed must be a number above 0, such as 20, not 0"),
    ("faults='stuck'", "lift: no fault of a lift has the name 'stuck'; did you mean `stuck_door`?"),
    ("lease_s=-1", "lifts.lift.lease_s: must be more than 0, not -1"),
]
"""Markers, and what is said of them."""
REPORT = re.compile(r"^_+ ERROR at setup of test_(\d+) _+$", re.MULTILINE)


def test_a_mistake_in_a_marker_is_reported_in_one_sentence(pytester: pytest.Pytester) -> None:
    tests = [
        f"@pytest.mark.lift({marker})\ndef test_{number}(lift_site): pass\n"
        for number, (marker, _) in enumerate(MISTAKES)
    ]
    ended, said = outcome_of(pytester, "\n".join(tests))
    assert ended == {"errors": len(MISTAKES)}
    # under CI pytest repeats the whole message in its summary
    _, *reports = REPORT.split(said.partition("short test summary info")[0])
    told = {int(number): report for number, report in zip(reports[::2], reports[1::2], strict=True)}
    assert told.keys() == set(range(len(MISTAKES)))
    for number, (marker, words) in enumerate(MISTAKES):
        assert told[number].count(f"\n{words}") == 1, marker
        assert "Traceback" not in told[number], marker
        assert "exception" not in told[number], marker


def test_the_lift_of_a_test_is_refused_where_there_are_two(pytester: pytest.Pytester) -> None:
    body = "pytestmark = [pytest.mark.lift('a'), pytest.mark.lift('b')]\ndef test_it(lift_simulator): pass\n"
    ended, said = outcome_of(pytester, body)
    assert ended == {"errors": 1}
    assert "this one has a, b; use lift_site.simulator('a')" in said
    ended, said = outcome_of(pytester, body.replace("'b'", "'a'"))
    assert "two lifts have the name 'a'" in said


def test_the_markers_nearest_to_a_test_are_all_it_gets(pytester: pytest.Pytester) -> None:
    body = """
pytestmark = [pytest.mark.lift("a"), pytest.mark.lift("b")]

def test_of_the_module(lift_site):
    assert lift_site.lifts == ("a", "b")

@pytest.mark.lift("c")
class TestClass:
    def test_of_the_class(self, lift_site):
        assert lift_site.lifts == ("c",)

    @pytest.mark.lift("d")
    @pytest.mark.lift("e")
    def test_of_its_own(self, lift_site):
        assert lift_site.lifts == ("d", "e")
"""
    assert outcome_of(pytester, body)[0] == {"passed": 3}


def test_a_map_may_lie_beside_the_test(pytester: pytest.Pytester) -> None:
    source = ROOT / "register_maps" / "maps" / "generic-registers.yaml"
    (pytester.path / "mine.yaml").write_text(source.read_text("utf-8").replace("name: generic-registers", "name: mine"))
    body = "@pytest.mark.lift(map='./mine.yaml')\ndef test_it(lift_site): assert lift_site.state().quality == 'live'\n"
    assert outcome_of(pytester, body)[0] == {"passed": 1}


def test_a_bug_that_nobody_else_would_hear_of_fails_the_test_with_its_traceback(pytester: pytest.Pytester) -> None:
    body = """
def swallow_a_bug(_):
    try:
        raise ValueError("a bug of the manager")
    except ValueError:
        logging.getLogger("lift_manager").exception("swallowed")
    return True

def test_it(lift_site):
    lift_site.wait_for(swallow_a_bug)

def test_after_it(lift_site):
    lift_site.wait_for(lambda state: state.quality == "live")
"""
    ended, said = outcome_of(pytester, body)
    assert ended == {"passed": 2, "errors": 1}
    assert 'raise ValueError("a bug of the manager")' in said
    assert "the manager or the simulator has a bug" in said


PAGE = (ROOT / "docs" / "reference" / "pytest-fixtures.md").read_text("utf-8")


def test_the_page_names_faults_and_methods_that_exist() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    named = {name for row in rows for name in re.findall(r'"([a-z_.]+)"', row.partition("|")[2].rpartition("|")[0])}
    known = {*READY, *DEVICE_FAULTS, *WIRE}
    assert named - {"tower"} <= known
    assert len(named) > 15
    for fixture, kind in (("lift_simulator", LiftSimulator), ("modbus_faults", ModbusFaults), ("lift_site", LiftSite)):
        (row,) = (row for row in rows if row.startswith(f"| `{fixture}` |"))
        methods = set(re.findall(r"`(?:with )?\.(\w+)", row))
        assert len(methods) > 8
        assert methods <= set(dir(kind))


def test_the_examples_of_the_how_to_are_tests_that_pass(pytester: pytest.Pytester) -> None:
    examples = blocks(ROOT / "docs" / "how-to" / "fault-testing.md", "python")
    pytester.makeconftest(
        f"""
import sys
import pytest
sys.path.insert(0, {str(ROOT / "examples" / "robot-team")!r})
from robot import Robot

class Wheels:
    def forward(self): pass
    def back(self): pass

@pytest.fixture
def my_robot():
    return Robot(Wheels(), patience_s=1.0, step_s=0.0)
"""
    )
    ended, said = outcome_of(pytester, "\n".join(examples))
    assert ended == {
        "passed": sum(len(re.findall(r"^(?:async )?def test_", block, re.MULTILINE)) for block in examples)
    }, said
    assert len(examples) >= 3


# -- how pytest meets the plugin


# a plugin that nobody needs here, and that takes two seconds in each process
PYTEST = ("-m", "pytest", "-p", "no:cacheprovider", "-p", "no:schemathesis")


def python(*args: str, path: Path | None = None, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "COV"))}
    environment |= {} if path is None else {"PYTHONPATH": str(path)}
    return subprocess.run(
        [sys.executable, *args], cwd=cwd, env=environment, capture_output=True, text=True, timeout=500, check=False
    )


def test_pytest_without_a_lift_imports_nothing_heavy() -> None:
    code = "import sys, lift_manager.lab.pytest_plugin; print(*sys.modules)"
    loaded = set(python("-c", code).stdout.split())
    ours = {name for name in loaded if name.split(".")[0] in ("lift_manager", "drivers", "simulator", "register_maps")}
    assert ours == {"lift_manager", "lift_manager.__main__", "lift_manager.lab", "lift_manager.lab.pytest_plugin"}
    assert loaded.isdisjoint({"asyncio", "fastapi", "pydantic", "pymodbus", "uvicorn", "yaml"})


def test_pytest_says_which_package_shadows_ours_and_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "simulator").mkdir()
    (tmp_path / "simulator" / "__init__.py").write_text("print('the intruder ran')")
    (tmp_path / "test_it.py").write_text("def test_it(): pass\n")
    done = python(*PYTEST, path=tmp_path, cwd=tmp_path)
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert f"package 'simulator' resolves to {tmp_path / 'simulator'}" in done.stderr
    assert "Traceback" not in done.stderr
    assert "pytest -p no:lift_manager" in done.stderr
    done = python(*PYTEST, "-p", "no:lift_manager", path=tmp_path, cwd=tmp_path)
    assert (done.returncode, "the intruder ran" in done.stdout) == (0, False)


def test_the_example_project_passes(pytester: pytest.Pytester) -> None:
    folder = ROOT / "examples" / "robot-team"
    names = re.findall(r"^def (test_\w+)", (folder / "test_robot.py").read_text("utf-8"), re.MULTILINE)
    assert len(names) >= 6
    done = pytester.runpytest_inprocess(str(folder), "-p", "no:cacheprovider", "-p", "no:schemathesis", "-v")
    done.assert_outcomes(passed=len(names))
