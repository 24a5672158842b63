"""From evidence to findings: tables of what was read, and the codes that it comes to."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from drivers.errors import ConnectProblem
from drivers.modbus.wire import CLOSED_BY_CONTROLLER, NOT_MODBUS
from lift_manager.commissioning.doctor.capability_findings import largest_blocks
from lift_manager.commissioning.doctor.evidence import (
    Answer,
    ControllerEvidence,
    Evidence,
    Probe,
    Purpose,
    SlotEvidence,
)
from lift_manager.commissioning.doctor.finding import Severity
from lift_manager.commissioning.doctor.findings import judge
from lift_manager.commissioning.doctor.probes import RISKS
from lift_manager.commissioning.doctor.subjects import Subjects, subjects_at
from lift_manager.commissioning.doctor.timing_findings import Latency, milliseconds
from lift_manager.config.devices import Device
from register_maps.codec import Codec, Value
from register_maps.frames import unpack_bits
from register_maps.load import MapChanges, load
from register_maps.words import Door, Mode, Motion, Table
from tests.support.rows import each_row

FLOORS = {"L1": 1, "L2": 2, "L3": 3}
PLC = "plc:502"
AT_REST: Mapping[str, Value] = {
    "alive": 0,
    "car_floor": 1,
    "motion": Motion.STOPPED,
    "door.front": Door.CLOSED,
    "mode": Mode.NORMAL,
    "fire": False,
    "robot_mode_on": False,
    "level": True,
    "obstruction.front": False,
    "overload": False,
    "destination": None,
    "call_accepted": None,
}


def subjects(
    name: str = "generic-registers",
    floors: Mapping[str, int] | None = FLOORS,
    override: Mapping[str, object] | None = None,
) -> Subjects:
    return subjects_at("plc", 502, load(name, changes=MapChanges({}, override or {})), floors=floors)


def registers(codec: Codec, **values: Value) -> tuple[int, ...]:
    """Return what the poll of generic-registers reads at rest, with some signals at other values."""
    image = codec.empty_image()
    for name, value in {**AT_REST, **{name.replace("__", "."): value for name, value in values.items()}}.items():
        codec.signals[name].insert(image, value)
    return tuple(image["holding"][0:8])


def polls(*rows: Sequence[int], every_s: float = 1.0, took_s: float = 0.004) -> tuple[Answer, ...]:
    """Return polls of the eight registers, one after another."""
    return tuple(
        Answer(turn * every_s, Purpose.POLL, 1, Table.HOLDING, 0, 8, took_s, tuple(row), turn=turn)
        for turn, row in enumerate(rows)
    )


def timeline(*changes: Mapping[str, Value]) -> tuple[Answer, ...]:
    """Return polls of a lift whose alive counter counts, each with its own values."""
    codec = subjects().lifts["lift"].codec
    return polls(*(registers(codec, **{"alive": turn, **change}) for turn, change in enumerate(changes)))


def codes(evidence: ControllerEvidence, examined: Subjects | None = None, *probes: Probe) -> list[str]:
    """Return the codes of everything that needs work, the worst first."""
    found = judge(examined or subjects(), Evidence({PLC: evidence}, 8.0, frozenset(probes)))
    return [finding.code for finding in found if finding.needs_work]


def read(*answers: Answer, survives_pause: bool | None = True, connects: int = 1) -> ControllerEvidence:
    return ControllerEvidence(answers=answers, connects=connects, survives_pause=survives_pause)


def unanswered(trouble: str, purpose: Purpose = Purpose.POLL) -> Answer:
    return Answer(0.0, purpose, 1, Table.HOLDING, 0, 8, 2.0, trouble=trouble)


def outputs(*rows: Sequence[int]) -> tuple[Answer, ...]:
    """Return reads of go_to, hold_door, robot_mode and close_door."""
    return tuple(
        Answer(turn + 0.5, Purpose.OUTPUTS, 1, Table.HOLDING, 16, 4, 0.004, tuple(row), turn=turn)
        for turn, row in enumerate(rows)
    )


REST = timeline(*[{}] * 8)


def test_a_lift_at_rest_needs_no_work() -> None:
    assert codes(read(*REST, *outputs(*[(0, 0, 0, 0)] * 3))) == []


@each_row(
    "problem, code",
    [
        (ConnectProblem.REFUSED, "refused"),
        (ConnectProblem.TIMED_OUT, "no-connection"),
        (ConnectProblem.HOST_NOT_FOUND, "host-not-found"),
        (ConnectProblem.TLS, "tls"),
        (ConnectProblem.OTHER, "no-connection"),
    ],
)
def test_a_connection_that_cannot_be_made_is_one_finding(problem: ConnectProblem, code: str) -> None:
    assert codes(ControllerEvidence(problem, "plc:502: why")) == [code]


@each_row(
    "trouble, code",
    [
        ("no answer within 2 s", "silent"),
        (CLOSED_BY_CONTROLLER, "slot-taken"),
        ("no new connection: plc:502: refused", "slot-taken"),
        (f"{NOT_MODBUS}: protocol id 21584", "wrong-port"),
        ("it answers in TLS; to speak Modbus/TCP Security ...", "wrong-port"),
        ("read 8 holding registers from 0, unit 1: expected function 3, got function 4", "wrong-answers"),
    ],
)
def test_a_connection_over_which_nothing_is_answered_is_one_finding(trouble: str, code: str) -> None:
    assert codes(read(*[unanswered(trouble)] * 3, survives_pause=None)) == [code]


@each_row(
    "evidence, expected",
    [
        (read(*REST, unanswered("no answer within 2 s")), ["silent-reads"]),
        (read(*REST, unanswered(CLOSED_BY_CONTROLLER), connects=2), ["unstable"]),
        (read(*REST, connects=3), ["unstable"]),
        (read(*REST, survives_pause=False), ["drops-idle"]),
        (read(*(replace(answer, echoes_tid=False) for answer in REST)), ["transaction-ids"]),
        (replace(read(*REST), slots=SlotEvidence(0, 1, first_survived=True)), ["single-slot"]),
        (replace(read(*REST), slots=SlotEvidence(3, 3, first_survived=False)), ["drops-oldest"]),
        (replace(read(*REST), slots=SlotEvidence(3, 3, first_survived=True)), []),
    ],
)
def test_the_connection_is_judged(evidence: ControllerEvidence, expected: list[str]) -> None:
    assert codes(evidence) == expected


@each_row(
    "took_s, expected",
    [(0.02, []), (0.19, []), (0.29, []), (0.35, ["slow"]), (0.49, ["slow"]), (0.51, ["too-slow"]), (1.0, ["too-slow"])],
)
def test_answers_are_compared_with_the_time_that_the_manager_has(took_s: float, expected: list[str]) -> None:
    assert codes(read(*(replace(answer, took_s=took_s) for answer in REST))) == expected


def test_the_reads_of_all_lifts_of_a_controller_count_together() -> None:
    one = subjects()
    lift = one.lifts["lift"]
    both = Subjects(one.controllers, {"a": replace(lift, name="a"), "b": replace(lift, name="b")})
    evidence = read(*(replace(answer, took_s=0.3) for answer in REST))
    assert codes(evidence) == []
    assert codes(evidence, both) == ["too-slow", "too-slow"]


def test_one_late_answer_in_a_hundred_is_a_warning() -> None:
    late = (*polls(*[[0, 1, 1, 1, 1, 5, 0, 0]] * 40), replace(REST[-1], took_s=0.9, at_s=50.0))
    assert "late-answers" in codes(read(*late))


@each_row(
    "changes, expected",
    [
        ({"door__front": Door.OPEN}, ["door-open"]),
        ({"fire": True}, ["asserted"]),
        ({"mode": Mode.FIRE}, ["in-mode"]),
        ({"mode": Mode.ROBOT}, []),
        ({"overload": True}, ["asserted"]),
        ({"obstruction__front": True}, ["asserted"]),
        ({"level": False}, ["not-level"]),
        ({"car_floor": None}, ["no-floor"]),
        ({"car_floor": 9}, ["no-such-floor"]),
        ({"car_floor": -1}, ["no-such-floor"]),
        ({"alive": 7}, ["heartbeat-still"]),
        ({"door__front": Door.OPENING}, ["door-between"]),
        ({"door__front": Door.OPEN, "motion": Motion.UP, "level": False}, ["open-under-way"]),
        ({"door__front": Door.OPEN, "level": False}, ["door-open", "open-not-level", "not-level"]),
    ],
)
def test_a_state_that_lasts_is_judged(changes: Mapping[str, Value], expected: list[str]) -> None:
    assert codes(read(*timeline(*[changes] * 8))) == expected


@each_row("signal", ["overload", "fire"])
def test_a_flag_that_a_number_shows_is_no_contact_to_be_inverted(signal: str) -> None:
    shown = {"at": "holding:6", "active": None, "yes_from": 110}
    changed = subjects(override={"signals": {"destination": None, signal: shown}})
    rows = [(turn, 1, 1, 1, 1, 5, 120, 0) for turn in range(8)]
    found = judge(changed, Evidence({PLC: read(*polls(*rows))}, 8.0, frozenset()))
    (one,) = [finding for finding in found if finding.code == "asserted"]
    assert "compare `yes_from: 110` with the vendor's table: it reads 120" in one.cure


@each_row(
    "raw, expected",
    [(512, ["bytes-swapped"]), (0x6300, ["no-such-floor"]), (65535, ["no-such-floor"]), (7, ["no-such-floor"])],
)
def test_a_floor_is_explained_where_it_can_be(raw: int, expected: list[str]) -> None:
    rows = [(turn, raw, 1, 1, 1, 5, 0, 0) for turn in range(8)]
    assert codes(read(*polls(*rows))) == expected


@each_row(
    "raw, text",
    [
        (9, "reads 9, which the map does not list; its table has 1 = stopped, 2 = up, 3 = down"),
        (512, "reads 512, which is 2 x 256: with its two bytes exchanged it is 2, up"),
    ],
)
def test_a_value_that_no_table_lists_is_shown_with_what_it_could_be(raw: int, text: str) -> None:
    evidence = read(*polls(*[(turn, 1, raw, 1, 1, 5, 0, 0) for turn in range(8)]))
    (finding,) = (one for one in judge(subjects(), Evidence({PLC: evidence}, 8.0)) if one.needs_work)
    assert finding.where == "motion at holding:2"
    assert finding.text == text


def test_without_named_floors_only_impossible_codes_are_odd() -> None:
    unnamed = subjects(floors=None)
    assert codes(read(*polls(*[(turn, 25344, 1, 1, 1, 5, 0, 0) for turn in range(8)])), unnamed) == ["bytes-swapped"]
    assert codes(read(*timeline(*[{"car_floor": 42}] * 8)), unnamed) == []


def test_a_door_that_stands_open_because_somebody_holds_it_is_no_finding_of_its_own() -> None:
    held = (*timeline(*[{"door__front": Door.OPEN}] * 8), *outputs(*[(0, 1, 0, 0)] * 3))
    assert codes(read(*held)) == ["output-on"]


@each_row(
    "rows, expected",
    [
        ([(0, 0, 0, 0), (2, 0, 0, 0), (0, 0, 0, 0)], ["second-master"]),
        ([(0, 0, 0, 0), (0, 1, 0, 0)], ["second-master"]),
        ([(0, 0, 1, 0)] * 3, ["output-on"]),
        ([(77, 0, 0, 0)] * 3, ["odd-output"]),
        ([(0, 5, 0, 0)] * 3, ["odd-output"]),
    ],
)
def test_outputs_that_nobody_here_wrote_are_judged(rows: list[Sequence[int]], expected: list[str]) -> None:
    assert codes(read(*REST, *outputs(*rows))) == expected


def test_a_stuck_contact_shows_when_the_car_goes_from_floor_to_floor() -> None:
    doors = [Door.CLOSED, Door.OPEN] * 4
    floors: list[Value] = [1, 1, 1, 2, 2, 2, 3, 3]
    still = [{"car_floor": floor, "level": floor == 1} for floor in floors]
    moves = [{"motion": Motion.UP if turn == 4 else Motion.STOPPED} for turn in range(8)]
    follows = timeline(*({**a, **b, "door__front": door} for a, b, door in zip(still, moves, doors, strict=True)))
    stuck = timeline(*({**a, **b} for a, b in zip(still, moves, strict=True)))
    assert codes(read(*follows)) == []
    assert codes(read(*stuck)) == ["stuck"]


def test_a_heartbeat_may_stand_still_for_as_long_as_the_map_says() -> None:
    def beats(counts: Sequence[int]) -> list[str]:
        return codes(read(*timeline(*({"alive": count} for count in counts))))

    assert beats([0, 0, 0, 1, 1, 1, 2, 2]) == []
    assert beats([0, 0, 0, 0, 0, 1, 1, 1]) == ["heartbeat-slow"]
    assert beats([0, 0, 0]) == []


def test_points_that_are_refused_are_named_one_by_one_and_a_whole_table_once() -> None:
    block = Answer(0.0, Purpose.POLL, 1, Table.HOLDING, 0, 8, 0.004, exception=2)
    rest = registers(subjects().lifts["lift"].codec)
    points = [Answer(0.1, Purpose.POINT, 1, Table.HOLDING, at, 1, 0.004, values=(rest[at],)) for at in range(8)]
    refused = [replace(point, values=None, exception=2) for point in points]
    assert codes(read(block, *points[:5], *refused[5:6], *points[6:])) == ["refused-point"]
    assert codes(read(block, *refused)) == ["table-refused"]
    assert codes(read(block, *points)) == ["refused-block"]


def test_outputs_that_cannot_be_read_back_are_one_finding_with_their_names() -> None:
    refused = Answer(0.5, Purpose.OUTPUTS, 1, Table.HOLDING, 16, 4, 0.004, exception=2)
    found = judge(subjects(), Evidence({PLC: read(*REST, refused)}, 8.0))
    assert [(one.code, one.where) for one in found if one.needs_work] == [("refused-output", "go_to at holding:16")]
    assert "go_to, hold_door.front, robot_mode, close_door.front cannot be read back (exception 02)" in found[0].text


def test_a_unit_that_a_gateway_does_not_reach_is_offline() -> None:
    offline = [Answer(turn, Purpose.POLL, 1, Table.HOLDING, 0, 8, 0.004, exception=0x0B) for turn in range(3)]
    assert codes(read(*offline)) == ["unit-offline"]


@each_row(
    "units, expected",
    [
        ({1: (5, 1), 247: (5, 1)}, ["any-unit"]),
        ({1: (5, 1), 247: (6, 1)}, ["any-unit"]),
        ({1: (5, 1), 247: (9, 9)}, []),
        ({1: (5, 1), 247: None}, []),
    ],
)
def test_a_unit_that_nobody_uses_and_that_answers_alike_shows_a_deaf_gateway(
    units: Mapping[int, tuple[int, int] | None], expected: list[str]
) -> None:
    probed = [
        Answer(9.0, Purpose.UNIT, unit, Table.HOLDING, 0, 2, 0.004, values, trouble="" if values else "no answer")
        for unit, values in units.items()
    ]
    assert codes(read(*REST, *probed), None, Probe.UNIT) == expected


def test_the_longest_read_is_the_last_one_that_was_answered() -> None:
    tried = [
        Answer(9.0, Purpose.BLOCK, 1, Table.HOLDING, 0, count, 0.004, (0,) * count if count <= 5 else None)
        for count in (1, 2, 4, 8, 6, 5)
    ]
    assert largest_blocks(read(*tried)) == {(1, Table.HOLDING, 0): (5, 6)}
    assert codes(read(*REST, *tried), None, Probe.BLOCK) == ["largest-block"]


def test_latencies_are_those_of_the_polls() -> None:
    assert Latency.of(read(*REST, replace(REST[0], purpose=Purpose.UNIT, took_s=2.0))) == Latency(0.004, 0.004)
    assert Latency.of(read(unanswered("no answer within 2 s"))) is None
    assert [milliseconds(s) for s in (0.0042, 0.0421, 1.25)] == ["4.2 ms", "42 ms", "1.2 s"]


def test_every_probe_has_a_risk_that_a_person_reads_before() -> None:
    assert RISKS.keys() == set(Probe)


def test_findings_come_the_worst_first() -> None:
    found = judge(subjects(), Evidence({PLC: read(*timeline(*[{"fire": True, "alive": 1}] * 8))}, 8.0))
    assert [finding.severity for finding in found] == [Severity.ERROR, Severity.WARNING, Severity.NOTE]


@pytest.mark.parametrize("offset", [1, -1])
def test_bits_of_another_offset_are_explained_only_by_more_than_one_signal(offset: int) -> None:
    examined = subjects("generic-coils", {"L1": 0, "L2": 1})
    codec = examined.lifts["lift"].codec
    at_rest = 1 << 0 | 1 << 17 | 1 << 18 | 0b111111 << 24
    bits = at_rest << 1 if offset > 0 else at_rest >> 1
    row = unpack_bits(bits.to_bytes(4, "little"), 30)
    beside = unpack_bits(bits.to_bytes(5, "little"), 31)[30] if offset > 0 else at_rest & 1
    answers = [Answer(turn, Purpose.POLL, 1, Table.DISCRETE, 0, 30, 0.004, row, turn=turn) for turn in range(9)]
    probe = Answer(9.5, Purpose.OFFSET, 1, Table.DISCRETE, 30 if offset > 0 else 0xFFFF, 1, 0.004, (beside,))
    assert set(codec.served) == {"discrete", "coil"}
    assert codes(read(*answers, probe), examined, Probe.OFFSET) == ["off-by-one"]


def test_a_controller_that_is_busy_at_times_is_not_taken_for_one_that_refuses_addresses() -> None:
    busy = Answer(9.0, Purpose.POLL, 1, Table.HOLDING, 0, 8, 0.004, exception=6, turn=9)
    assert codes(read(*REST, busy)) == ["busy"]


def test_a_unit_that_is_silent_beside_one_that_answers_is_named_with_its_lift() -> None:
    one = subjects()
    lift = one.lifts["lift"]
    other = replace(lift, name="other", devices={"": Device(PLC, 2)})
    both = Subjects(one.controllers, {"lift": lift, "other": other})
    silent = replace(unanswered("no answer within 2 s"), unit=2)
    found = judge(both, Evidence({PLC: read(*REST, silent)}, 8.0))
    assert [finding.text for finding in found if finding.needs_work] == [
        "unit 2 (lift other) never answers, and another unit here does"
    ]


@each_row(
    "ports, text",
    [(None, "`--probe port` tries"), ((502, 5020), "port 502 and 5020 accepts"), ((), "none of the usual ports")],
)
def test_a_refused_connection_names_the_ports_that_accept_one(ports: tuple[int, ...] | None, text: str) -> None:
    evidence = ControllerEvidence(ConnectProblem.REFUSED, "plc:502: refused", open_ports=ports)
    (finding,) = judge(subjects(), Evidence({PLC: evidence}, 8.0))
    assert text in finding.cure


def test_levelling_with_an_open_door_is_no_contradiction_and_travel_is_one() -> None:
    shut: Mapping[str, Value] = {}
    level: Mapping[str, Value] = {"door__front": Door.OPEN}
    moves: Mapping[str, Value] = {"door__front": Door.OPEN, "motion": Motion.UP, "level": False}
    assert codes(read(*timeline(shut, level, moves, level, moves, moves, level, shut))) == []
    assert codes(read(*timeline(shut, level, moves, moves, moves, moves, moves, shut))) == ["open-under-way"]


def test_a_door_that_is_open_from_one_floor_to_another_is_a_contradiction() -> None:
    open_at: list[Mapping[str, Value]] = [{"door__front": Door.OPEN, "car_floor": floor} for floor in (1, 2)]
    assert "open-under-way" in codes(read(*timeline({}, *open_at, {"car_floor": 2})))
    assert "open-under-way" not in codes(read(*timeline({}, open_at[0], {}, open_at[1])))


def test_a_gap_between_two_reads_is_no_pause_of_the_heartbeat() -> None:
    codec = subjects().lifts["lift"].codec
    rows = polls(*(registers(codec, alive=count) for count in range(4)), every_s=9.0)
    assert codes(read(*rows)) == []


def test_a_ride_past_many_floors_is_no_restless_floor() -> None:
    tower = subjects(floors={f"L{code}": code for code in range(1, 40)})
    codec = tower.lifts["lift"].codec
    trip: list[Value] = [*range(1, 40, 3), *range(39, 0, -3)]
    rows = [registers(codec, alive=turn, car_floor=floor, motion=Motion.UP) for turn, floor in enumerate(trip)]
    assert "restless" not in codes(read(*polls(*rows, every_s=2.0)), tower)
    assert codes(read(*polls(*rows, every_s=0.2)), tower)[0] == "restless"
