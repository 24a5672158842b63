"""doctor finds every planted mistake that the table of docs/how-to/doctor.md says it finds, and nothing where nothing is wrong."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from drivers.errors import ConnectProblem
from lift_manager.commissioning.doctor.evidence import Probe
from lift_manager.commissioning.doctor.finding import Severity
from lift_manager.commissioning.doctor.report import lines, summary
from lift_manager.lab.plant import default_floors
from register_maps.load import load, shipped
from register_maps.signal_codec import swap_bytes
from register_maps.words import Side, Table
from simulator.state import Inputs
from tests.support.planted import (
    Edit,
    Mistake,
    constant,
    examine,
    inverted,
    loaded,
    subjects_of,
    swapped_bytes,
)
from tests.support.programs import ROOT
from tests.support.rows import each_row

PAGE = ROOT / "docs" / "how-to" / "doctor.md"
H, D, C, I = Table.HOLDING, Table.DISCRETE, Table.COIL, Table.INPUT  # noqa: E741  the four tables
COILS = Mistake(map="generic-coils", floors={"L1": 0, "L2": 1, "L3": 2})
RIDE = ((1.0, Inputs(car_buttons=frozenset({2}))), (2.0, Inputs()))
RIDDEN = replace(COILS, people=RIDE, seconds=40.0)
SINGLE = """\
schema: 1
name: single
title: A lift with one contact for its door
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {discrete: [[0, 15]]}
signals:
  car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"], codes: [1, 2, 3]}
  door.front: {at: "discrete:8"}
  level: {at: "discrete:9"}
  motion: {up: "discrete:10", down: "discrete:11"}
at_floor_evidence: {kind: level}
not_visible: {fire: nothing burns in a test}
"""
WIDE = """\
schema: 1
name: wide
title: A lift with a position in two registers
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {holding: [[0, 9]]}
signals:
  car_position: {at: "holding:0", type: uint32, word_order: low_first, positions: {1: 1000, 2: 4000, 3: 7000}, tolerance: 20}
  door.front: {at: "holding:2", values: {1: closed, 2: open, 3: moving}}
  motion: {at: "holding:3", values: {1: stopped, 2: up, 3: down}}
at_floor_evidence: {kind: motion_stopped}
not_visible: {fire: nothing burns in a test}
"""


def floor_as(number: int) -> Edit:
    return constant(H, 1, number)


def slow_beats(table: Table, address: int, value: int) -> int:
    """Count once where the controller counts twelve times: every 6 s."""
    return value // 12 if (table, address) == (H, 0) else value


def drifting() -> Edit:
    position = [3000]

    def edit(table: Table, address: int, value: int) -> int:
        if (table, address) == (H, 0):
            position[0] += 1
            return position[0] // 3
        return value

    return edit


def no_tid(_request: bytes, answer: bytes) -> bytes:
    return bytes(2) + answer[2:]


def speaks_http(_request: bytes, _answer: bytes) -> bytes:
    return b"HTTP/1.1 400 Bad Request\r\n\r\n"


def planted(folder: Path) -> Mapping[str, Mistake]:
    """Return a controller with each mistake of the page that doctor finds."""
    wide = folder / "wide.yaml"
    wide.write_text(WIDE)
    contact = folder / "single.yaml"
    contact.write_text(SINGLE)
    lift = Mistake()
    single = Mistake(map=str(contact), floors={"L1": 1, "L2": 2, "L3": 3})
    words = Mistake(map=str(wide), floors={"L1": 1, "L2": 2, "L3": 3})
    return {
        "all addresses one too low": replace(lift, shift=1),
        "all addresses one too high": replace(lift, shift=-1),
        "single bits one too low": replace(COILS, shift=1, probes=(Probe.OFFSET,)),
        "wrong unit id": replace(lift, unit=3),
        "wrong unit id, another one answers": replace(lift, unit=3, other_units="gateway", probes=(Probe.UNIT,)),
        "a gateway that answers for any unit id": replace(lift, other_units="as its own", probes=(Probe.UNIT,)),
        "holding registers for input registers": replace(lift, tables={H: I}),
        "holding registers for input registers, with the remedy": replace(lift, tables={H: I}, probes=(Probe.TABLE,)),
        "wrong port: nothing listens": replace(lift, problem=ConnectProblem.REFUSED),
        "wrong port: something else listens": replace(lift, answers=speaks_http),
        "no cable, or a firewall": replace(lift, problem=ConnectProblem.TIMED_OUT),
        "the map of another controller": replace(lift, edit=lambda _, address, value: 100 + 7 * address + value % 2),
        "a controller without a program": replace(lift, edit=lambda *_: 0),
        "bytes of every register exchanged": replace(lift, edit=swapped_bytes),
        "bytes of one register exchanged": replace(lift, floors={"L1": 1, "L2": 99}, edit=floor_as(swap_bytes(99))),
        "words of a 32-bit number exchanged": replace(
            words, edit=lambda _, address, value: {0: 0, 1: 1000}.get(address, value)
        ),
        "floor -1 read as 65535": _unsigned(folder),
        "floor codes shifted by one": replace(
            lift, floors={"L1": 2, "L2": 3, "L3": 4}, controller_floors={"L1": 1, "L2": 2, "L3": 3}
        ),
        "door contact inverted": replace(Mistake(map="seer-siemens-chengdu"), edit=inverted((D, 3, 0))),
        "both door limits inverted": replace(COILS, edit=inverted((D, 16, 0), (D, 17, 0))),
        "one door limit inverted": replace(COILS, edit=inverted((D, 16, 0))),
        "door limits exchanged": replace(COILS, crossed=((D, 16), (D, 17))),
        "door limits exchanged, and the lift is ridden": replace(RIDDEN, crossed=((D, 16), (D, 17))),
        "door and level inputs exchanged": replace(single, crossed=((D, 8), (D, 9))),
        "normally-closed fire contact read as normally open": replace(lift, edit=inverted((H, 5, 0))),
        "normally-closed light curtain read as normally open": replace(lift, edit=inverted((H, 5, 3))),
        "position bits inverted": replace(COILS, edit=inverted(*((D, floor, 0) for floor in range(8)))),
        "exception 02 on a point": replace(lift, refused=((H, 7),)),
        "a block that is too long for the controller": replace(lift, longest=4),
        "a controller that takes 1 s to answer": replace(lift, delay_s=1.0),
        "a controller that takes 0.4 s to answer": replace(lift, delay_s=0.4),
        "the only slot is taken": replace(lift, taken=True),
        "one slot only": replace(lift, clients=1, probes=(Probe.SLOT,)),
        "transaction ids are not repeated": replace(lift, answers=no_tid),
        "the connection is dropped after a short pause": replace(lift, idle_s=0.4),
        "heartbeat of the controller stands still": replace(lift, edit=constant(H, 0, 7)),
        "heartbeat of the controller too slow": replace(lift, edit=slow_beats, seconds=15.0),
        "an input that is stuck": replace(lift, edit=constant(H, 3, 1), people=RIDE, seconds=40.0),
        "an input that drifts": replace(words, edit=drifting()),
        "a second master presses a call": replace(lift, writes=((3.0, H, 16, 3), (3.5, H, 16, 0))),
        "a second master holds the door": replace(lift, writes=((0.0, H, 17, 1),)),
    }


def _unsigned(folder: Path) -> Mistake:
    """The map takes the floor for a number without a sign."""
    text = load("generic-registers").path.read_text("utf-8")
    mistaken = folder / "unsigned.yaml"
    mistaken.write_text(
        text.replace('car_floor: {at: "holding:1", type: int16', 'car_floor: {at: "holding:1", type: uint16')
    )
    return Mistake(map=str(mistaken), controller_map="generic-registers", floors={"B1": -1, "G": 1, "L1": 2})


WORDS = {
    "all addresses one too low": "one address higher.*car_floor at holding:1 reads 15.*`offset: {holding: 1}`",
    "all addresses one too high": "one address lower.*fire at holding:5.0 is on.*`addressing: {base: 1}`",
    "single bits one too low": "one address higher.*door.front at discrete:16, discrete:17 reads 0",
    "wrong unit id": "unit 1 never answers within 2 s. Compare the unit id",
    "wrong unit id, another one answers": "unit 1 does not answer, and unit 3 does. Write `unit_id: 3`",
    "a gateway that answers for any unit id": "every unit id, 247 included.*If this is a gateway",
    "holding registers for input registers": "alive at holding:0: .*exception 02.*whether they are input registers",
    "holding registers for input registers, with the remedy": "makes sense with input registers for holding registers",
    "wrong port: nothing listens": "nothing listens on port 502",
    "wrong port: something else listens": "speaks no Modbus/TCP.*Find the Modbus/TCP port",
    "no cable, or a firewall": "nothing takes the connection. Look at power and cable",
    "the map of another controller": "car_floor at holding:1 reads 108.*this is not the controller that the map",
    "a controller without a program": "all 8 addresses of the map read 0.*whether the controller's program runs",
    "bytes of every register exchanged": "two bytes of each register exchanged .car_floor at holding:1 reads 256",
    "bytes of one register exchanged": "car_floor at holding:1: reads 25344, which is 99 x 256.*it is 99, floor L2",
    "words of a 32-bit number exchanged": "car_position at holding:0: reads 65536000, which is 1000 with its two words",
    "floor -1 read as 65535": "car_floor at holding:1: reads 65535, which is -1 as a signed number, floor B1",
    "floor codes shifted by one": "car_floor at holding:1: reads floor code 1, and the site has L1 = 2.*shift them all",
    "door contact inverted": "door.front at discrete:3: the door reads open.*its contact is inverted",
    "both door limits inverted": "door.front at discrete:16, discrete:17: the door reads open.*its contact is inverted",
    "one door limit inverted": "door.front at discrete:16, discrete:17: .*fully open and fully closed at once",
    "door limits exchanged": "door.front at discrete:16, discrete:17: the door reads open.*two limits are exchanged",
    "door limits exchanged, and the lift is ridden": "door.front at discrete:16, discrete:17: .*not shut while the car moves",
    "door and level inputs exchanged": "door.front at discrete:8: .*level at discrete:9.*may be exchanged",
    "normally-closed fire contact read as normally open": "fire at holding:5.0: reports fire.*`active: high`",
    "normally-closed light curtain read as normally open": "obstruction.front at holding:5.3: .*`active: low`",
    "position bits inverted": "car_floor at discrete:0 to discrete:7: .*they are inverted",
    "exception 02 on a point": "call_accepted at holding:7: .*exception 02 .illegal data address.",
    "a block that is too long for the controller": "holding 0 to 7 on the wire: .*not these 8 in one read",
    "a controller that takes 1 s to answer": "answers take 1.0 s.*gives up after 0.5 s",
    "a controller that takes 0.4 s to answer": "one request of 400 ms.*1 s is the limit",
    "the only slot is taken": "its only slot is taken.*End every other client",
    "one slot only": "serves one client at a time.*`max_connections: 1`",
    "transaction ids are not repeated": "does not repeat transaction ids.*`tid_echo: false`",
    "the connection is dropped after a short pause": "ends the connection after 0.5 s without a request",
    "heartbeat of the controller stands still": "alive at holding:0: .*its program does not run",
    "heartbeat of the controller too slow": "alive at holding:0: .*stood still for 6.0 s, and the map allows 3 s",
    "an input that is stuck": "door.front at holding:3: did not change while the car changed floors",
    "an input that drifts": "car_position at holding:0: went from 1000 to .* while the car stood with its doors shut",
    "a second master presses a call": "go_to at holding:16: changes between 0 and 3, .*another client commands this lift",
    "a second master holds the door": "hold_door.front at holding:17: is on .reads 1. although no manager runs here",
}
"""What the line of each mistake says, with the address as printed in the vendor's table where the mistake has one."""


def rows_of_the_page() -> dict[str, tuple[str, list[str]]]:
    """Return who finds each mistake, and the codes that the row names."""
    table = PAGE.read_text("utf-8").partition("| mistake | found by | how |")[2]
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line.startswith("| ")
    ]
    return {mistake: (by, re.findall(r"`([a-z-]+)`", how)) for mistake, by, how in cells}


ROWS = rows_of_the_page()
BY_DOCTOR = {mistake: codes for mistake, (by, codes) in ROWS.items() if by.startswith("doctor")}


def test_the_page_and_the_planted_mistakes_are_the_same(tmp_path: Path) -> None:
    assert planted(tmp_path).keys() == BY_DOCTOR.keys() == WORDS.keys()
    assert {by for by, _ in ROWS.values() if not by.startswith("doctor")} == {"checkout", "nobody"}


@pytest.mark.parametrize("mistake", BY_DOCTOR)
def test_a_planted_mistake_is_found_in_a_line_with_its_address_that_says_what_to_do(
    mistake: str, tmp_path: Path
) -> None:
    controller = planted(tmp_path)[mistake]
    report, _ = examine(controller, tmp_path)
    named = {finding.code: finding for finding in report.findings}
    assert named.keys() & set(BY_DOCTOR[mistake]), [finding.code for finding in report.findings]
    found = [
        line
        for line in lines(report, subjects_of(controller))
        if any(line.endswith(f"[{code}]") for code in BY_DOCTOR[mistake])
    ]
    assert any(re.search(WORDS[mistake], line) for line in found), found
    assert report.needs_work
    said = [(finding.code, finding.text) for finding in report.findings]
    assert len(set(said)) == len(said), said
    for finding in report.findings:
        assert finding.cure or finding.severity is Severity.NOTE
        assert "\n" not in finding.text + finding.cure


@each_row("name", lambda: [name for name in shipped() if not load(name).map.needs and load(name).map.signals])
def test_a_lift_without_a_mistake_needs_no_work(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    mistake = Mistake(map=name, floors=default_floors(loaded(name).map))
    report, _ = examine(mistake, tmp_path_factory.mktemp("locks"))
    assert [finding.code for finding in report.findings if finding.needs_work] == []


def ridden(floors: int, seed: int) -> tuple[tuple[float, Inputs], ...]:
    """Return what passengers do to a lift in a minute: buttons, the light curtain, the open button."""
    random, at_s = Random(seed), 1.0
    found: list[tuple[float, Inputs]] = []
    while at_s < 60:
        floor, front = frozenset({random.randrange(floors)}), frozenset({Side.FRONT})
        doing = [
            Inputs(car_buttons=floor),
            Inputs(landing_buttons=floor),
            Inputs(obstruction=front),
            Inputs(hold_door=front),
        ]
        found += [(at_s, random.choice(doing)), (at_s + random.uniform(0.5, 3), Inputs())]
        at_s += random.uniform(4, 12)
    return tuple(found)


@each_row("name", ["generic-registers", "generic-coils", "seer-siemens-chengdu", "two-stop-agv", "thingweb-elevator"])
def test_a_lift_that_people_ride_meanwhile_needs_no_work(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    floors = default_floors(loaded(name).map)
    mistake = Mistake(map=name, floors=floors, people=ridden(len(floors), 1), seconds=65.0)
    report, _ = examine(mistake, tmp_path_factory.mktemp("locks"))
    assert [finding.code for finding in report.findings if finding.needs_work] == []


def test_every_probe_of_a_good_controller_comes_to_notes(tmp_path: Path) -> None:
    mistake = Mistake(probes=tuple(probe for probe in Probe if probe is not Probe.PORT))
    report, _ = examine(mistake, tmp_path)
    assert not report.needs_work
    facts = report.controllers["plc:502"]
    assert facts.units == (1,)
    assert facts.clients == 4
    assert facts.served == ("unit 1 holding 0-7, 16-19",)
    assert facts.largest_blocks == ("unit 1 holding 0: 8", "unit 1 holding 16: 4")


def test_a_ride_by_hand_proves_what_changed_and_leaves_the_rest_open(tmp_path: Path) -> None:
    report, _ = examine(Mistake(people=RIDE, seconds=40.0), tmp_path)
    (note,) = report.findings
    assert note.code == "never-changed"
    assert "fire" in note.text
    assert "door.front" not in note.text
    assert summary(report).startswith("Nothing that needs work was found by reading. Not probed: offset, ")
