"""The planned requests are those that leave: held against the bytes that were typed by hand from each map's source."""

import pytest

from drivers.model import Command
from lift_manager.commissioning.maps_plan import Plan, PlannedRequest, PlanSection, lines, plan
from register_maps.load import MapChanges, load
from tests.register_maps.golden.vectors import Golden, frames_of
from tests.register_maps.test_golden_vectors import GOLDEN
from tests.support.rows import each_row
from tests.support.written_maps import written_map

each_map = each_row("golden", GOLDEN)

GENERIC_REGISTERS = """\
One poll: 1 request, so 1 round trip
  each poll   signals of the lift: alive, car_floor, motion, door.front, mode, fire, robot_mode_on,
              level, obstruction.front, overload, destination, call_accepted: read 8 holding
              registers from 0, unit 1
              00 00 00 06 01 03 00 00 00 08

On a new connection, after the first poll and before anything is written
  once        state of our outputs: go_to: read 1 holding register from 16, unit 1
              00 00 00 06 01 03 00 10 00 01
  once        state of our outputs: hold_door.front: read 1 holding register from 17, unit 1
              00 00 00 06 01 03 00 11 00 01
  once        state of our outputs: robot_mode: read 1 holding register from 18, unit 1
              00 00 00 06 01 03 00 12 00 01
  once        state of our outputs: close_door.front: read 1 holding register from 19, unit 1
              00 00 00 06 01 03 00 13 00 01

go_to B1 (code -1): pressed for 0.5 s, then released
  0 s         press: write holding register 16 := 65535, unit 1
              00 00 00 06 01 06 00 10 FF FF
  0.5 s       release: write holding register 16 := 0, unit 1
              00 00 00 06 01 06 00 10 00 00
  0.5 s       read back: read 1 holding register from 16, unit 1
              00 00 00 06 01 03 00 10 00 01

go_to L2 (code 2): otherwise as for B1
  0 s         press: write holding register 16 := 2, unit 1
              00 00 00 06 01 06 00 10 00 02

hold_door.front: held until released, at most 30 s unless renewed; written again every 1 s; cleared
  by the controller after 27 s, to see it written again
  0 s         press: write holding register 17 := 1, unit 1
              00 00 00 06 01 06 00 11 00 01
  0 s         read back: read 1 holding register from 17, unit 1
              00 00 00 06 01 03 00 11 00 01
  1 s         check that it is still on: read 1 holding register from 17, unit 1
              00 00 00 06 01 03 00 11 00 01
  1 s         written again: write holding register 17 := 1, unit 1
              00 00 00 06 01 06 00 11 00 01
  at the end  release: write holding register 17 := 0, unit 1
              00 00 00 06 01 06 00 11 00 00
  at the end  read back: read 1 holding register from 17, unit 1
              00 00 00 06 01 03 00 11 00 01
"""

TWO_STOP_AGV = """\
One poll: 1 request, so 1 round trip
  each poll   signals of the lift: door.front, car_floor, robot_mode_on, fault: read 6 discrete
              inputs from 0, unit 1
              00 00 00 06 01 02 00 00 00 06

On a new connection, after the first poll and before anything is written
  once        state of our outputs: go_to, hold_door.front, close_door.front: read 4 coils from 0,
              unit 1
              00 00 00 06 01 01 00 00 00 04

go_to 4F (code 0): held until the car is there, at most 120 s unless renewed; written again every 2
  s
  0 s         press: write 4 coils from 0 := on off off off, unit 1
              00 00 00 08 01 0F 00 00 00 04 01 01
  2 s         check that it is still on: read 4 coils from 0, unit 1
              00 00 00 06 01 01 00 00 00 04
  2 s         written again: write 4 coils from 0 := on off off off, unit 1
              00 00 00 08 01 0F 00 00 00 04 01 01
  at the end  release: write 4 coils from 0 := off off off off, unit 1
              00 00 00 08 01 0F 00 00 00 04 01 00
  at the end  read back: read 4 coils from 0, unit 1
              00 00 00 06 01 01 00 00 00 04

go_to 5F (code 1): otherwise as for 4F
  0 s         press: write 4 coils from 0 := off on off off, unit 1
              00 00 00 08 01 0F 00 00 00 04 01 02
  2 s         check that it is still on: read 4 coils from 0, unit 1
              00 00 00 06 01 01 00 00 00 04
  2 s         written again: write 4 coils from 0 := off on off off, unit 1
              00 00 00 08 01 0F 00 00 00 04 01 02
"""


def planned(golden: Golden) -> Plan:
    changes = MapChanges(parameters=golden.parameters, override=golden.override)
    return plan(load(golden.map_name, changes=changes).map, golden.floors)


def typed(one: PlannedRequest) -> str:
    """A request as the golden vectors have it."""
    device = f"{one.received.endpoint}: " if one.received.endpoint else ""
    return device + one.bytes_hex


def part_of(found: Plan, command: Command) -> list[PlanSection]:
    """The parts of a command; of a call also that to the first floor, to which the others refer."""
    return [part for part in found.commands if part.heading.split(" ")[0] == command.name]


@each_map
def test_a_poll_is_the_typed_requests_and_nothing_else(golden: Golden) -> None:
    assert tuple(map(typed, planned(golden).poll.requests)) == frames_of(golden.poll)


@each_map
def test_a_new_connection_asks_for_our_outputs_by_the_typed_requests(golden: Golden) -> None:
    assert [typed(one) for one in planned(golden).connected.requests] == [request for request, _ in golden.takes_over]


@each_map
def test_every_typed_request_of_a_command_is_planned_for_it(golden: Golden) -> None:
    found = planned(golden)
    for vector in golden.does:
        if vector.before is not None:
            continue  # the command before it changes the words that both share
        sent = {typed(one) for part in part_of(found, vector.command) for one in part.requests}
        assert {step.request for step in vector.exchanges} <= sent, vector.words


@each_map
def test_the_first_typed_write_of_a_command_is_planned_to_leave_first(golden: Golden) -> None:
    found = planned(golden)
    for vector in golden.does:
        parts = part_of(found, vector.command)
        if vector.before is None and vector.command.floor is not None:
            parts = [part for part in parts if part.heading.split(" ")[1] == vector.command.floor]
        if vector.before is None:
            assert typed(parts[0].requests[0]) == vector.exchanges[0].request, vector.words


@pytest.mark.parametrize("golden", [golden for golden in GOLDEN if golden.cycle], ids=lambda golden: golden.title)
def test_a_block_that_is_written_all_the_time_is_planned_once(golden: Golden) -> None:
    assert golden.cycle is not None
    (one,) = planned(golden).always.requests
    assert typed(one) == golden.cycle[0]
    assert f"every {golden.cycle_s:g} s" in one.purpose


def test_the_text_of_generic_registers_is_this() -> None:
    text = "\n".join(lines(plan(load("generic-registers").map, {"B1": -1, "L2": 2})))
    assert text.startswith(GENERIC_REGISTERS)


def test_the_text_of_two_stop_agv_is_this() -> None:
    text = "\n".join(lines(plan(load("two-stop-agv").map, {"4F": 0, "5F": 1})))
    assert text.startswith(TWO_STOP_AGV)


def sent_by(text: str) -> list[str]:
    """When, what for and the bytes of every command of a map written down here."""
    found = plan(written_map(text).map, {"L1": 1, "L2": 2})
    return [
        f"{one.when} {one.purpose}: {one.bytes_hex}"
        for part in (found.always, *found.commands)
        for one in part.requests
    ]


def test_a_shared_word_is_read_afresh_before_each_write() -> None:
    assert sent_by("""\
signals: {overload: {at: "holding:5.1"}}
commands:
  hold_door.front:
    {at: "holding:5.0", action: hold, max_hold_s: 30, on_link_loss: latches, shared_word: accepted,
     confirm: {any_of: [readback], within_s: 2}}
""") == [
        "0 s read first, because others use this register too: 00 00 00 06 01 03 00 05 00 01",
        "0 s press: 00 00 00 06 01 06 00 05 00 01",
        "0 s read back: 00 00 00 06 01 03 00 05 00 01",
        "2 s read back: 00 00 00 06 01 03 00 05 00 01",
        "at the end read first, because others use this register too: 00 00 00 06 01 03 00 05 00 01",
        "at the end release: 00 00 00 06 01 06 00 05 00 00",
        "at the end read back: 00 00 00 06 01 03 00 05 00 01",
    ]


def test_function_22_changes_our_bits_alone() -> None:
    assert sent_by("""\
signals: {overload: {at: "holding:5.1"}}
commands:
  hold_door.front:
    {at: "holding:5.4", action: hold, max_hold_s: 30, on_link_loss: latches, shared_word: mask_write,
     confirm: {any_of: [readback], within_s: 2}}
""")[:2] == [
        "0 s press: 00 00 00 08 01 16 00 05 FF EF 00 10",
        "0 s read back: 00 00 00 06 01 03 00 05 00 01",
    ]


def test_a_heartbeat_is_planned_with_two_of_its_beats_and_beside_no_command() -> None:
    assert sent_by("""\
signals: {ready: {at: "holding:5"}}
commands:
  heartbeat: {at: "holding:41", action: count, every_s: 0.5}
  close_door.front: {at: "coil:3", action: pulse, width_s: 1, confirm: {any_of: [ready], within_s: 2}}
""") == [
        "0 s heartbeat, every 0.5 s: 00 00 00 06 01 06 00 29 00 01",
        "0.5 s heartbeat, every 0.5 s: 00 00 00 06 01 06 00 29 00 02",
        "0 s press: 00 00 00 06 01 05 00 03 FF 00",
        "1 s release: 00 00 00 06 01 05 00 03 00 00",
        "1 s read back: 00 00 00 06 01 01 00 03 00 01",
    ]


def test_a_press_that_must_be_an_edge_is_preceded_by_its_rest_value() -> None:
    assert sent_by("""\
signals: {ready: {at: "holding:5"}}
commands:
  close_door.front:
    {at: "coil:3", action: pulse, width_s: 1, reset_first_s: 0.5, confirm: {any_of: [ready], within_s: 2}}
""")[:2] == [
        "0 s rest first, so that the press is an edge: 00 00 00 06 01 05 00 03 00 00",
        "0.5 s press: 00 00 00 06 01 05 00 03 FF 00",
    ]


def test_a_hold_made_of_pulses_shows_the_end_of_a_pulse_and_the_next_one() -> None:
    assert sent_by("""\
signals: {ready: {at: "holding:5"}}
commands:
  hold_door.front:
    {at: "coil:3", action: hold, max_hold_s: 30, repeat_pulse_s: 4, width_s: 1, on_link_loss: latches,
     confirm: {any_of: [ready], within_s: 2}}
""") == [
        "0 s press: 00 00 00 06 01 05 00 03 FF 00",
        "1 s end of one press: 00 00 00 06 01 05 00 03 00 00",
        "4 s written again: 00 00 00 06 01 05 00 03 FF 00",
        "at the end release: 00 00 00 06 01 05 00 03 00 00",
        "at the end read back: 00 00 00 06 01 01 00 03 00 01",
    ]


def test_what_goes_to_a_second_device_says_so() -> None:
    found = plan(
        written_map("""\
endpoints: {sensor: {unit_id: 7, served: {discrete: [[0, 9]]}}}
signals:
  door.front: {at: "sensor/discrete:3"}
  overload: {at: "holding:5"}
""").map
    )
    assert [(one.words, one.bytes_hex) for one in found.poll.requests] == [
        ("read 1 holding register from 5, unit 1", "00 00 00 06 01 03 00 05 00 01"),
        ("read 1 discrete input from 3, unit 7 (sensor)", "00 00 00 06 07 02 00 03 00 01"),
    ]
    assert found.poll.remark == "2 requests, so 2 round trips"


def test_a_device_with_outputs_only_is_polled_for_one_of_them() -> None:
    (one,) = plan(load("adam-pushbutton").map).poll.requests
    assert one.purpose == "one of our outputs, to check that the device is connected"
    assert one.bytes_hex == "00 00 00 06 01 01 00 10 00 01"


def test_a_map_of_which_nothing_can_be_read_says_so() -> None:
    text = """\
signals: {}
commands:
  close_door.front:
    {at: "coil:3", action: pulse, width_s: 1, timed_by: device, confirm: {any_of: [effect], within_s: 2}}
needs: {car_floor: given elsewhere, door.front: given elsewhere}
"""
    assert plan(written_map(text).map).poll.remark == "no request, because the map has nothing that can be read"


def test_the_cost_of_a_poll_tells_the_pauses_that_the_device_wants() -> None:
    text = """\
link: {min_gap_s: 0.05, min_poll_s: 1}
signals: {overload: {at: "holding:5"}, fault: {at: "coil:5"}}
"""
    assert plan(written_map(text).map).poll.remark == (
        "2 requests, so 2 round trips, 0.05 s apart; not more often than every 1 s"
    )


def test_a_floor_that_a_map_cannot_express_is_refused_with_its_reason() -> None:
    with pytest.raises(ValueError, match="codes 0 to 1; 7 is none of them"):
        plan(load("two-stop-agv").map, {"L1": 0, "L7": 7})


def test_a_command_that_is_written_again_without_end_is_refused() -> None:
    text = """\
signals: {ready: {at: "holding:5"}}
commands:
  heartbeat: {at: "holding:41", action: count, every_s: 0.000001}
  close_door.front: {at: "coil:3", action: pulse, width_s: 1, confirm: {any_of: [ready], within_s: 2}}
"""
    with pytest.raises(ValueError, match="so often that it never ends"):
        plan(written_map(text).map)
