"""The generated program does what the lift company is told it does: run in cycles, on each generic map."""

from __future__ import annotations

import pytest

from lift_manager.commissioning.plc.terminals import GUARDS
from register_maps.codec import UNLISTED
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.commissioning.plc.rig import ALL_WELL, ALONE, COILS, CYCLE_S, LAYOUTS, REGISTERS, Layout, Rig
from tests.support.rows import each_row

each_map = pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.map_name)
each_map_alone = pytest.mark.parametrize("layout", ALONE, ids=lambda layout: layout.map_name)
LATE_S = 2 * CYCLE_S
"""A change is seen in the next cycle, and a timer ends in the one after its time."""


@each_map
@pytest.mark.parametrize("left_s", [0.1, 0.5, 0.7, 20.0])
def test_a_call_is_one_press_of_half_a_second_however_long_it_is_left(layout: Layout, left_s: float) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.call("L2")
    rig.run(left_s)
    rig.let_go("L2")
    rig.run(2.0)
    assert rig.pressed.keys() == {"RobotMode", "CallButton3"}
    assert len(rig.pressed["CallButton3"]) == 1
    assert rig.released["CallButton3"][0] - rig.pressed["CallButton3"][0] == pytest.approx(0.5, abs=LATE_S)


@each_map
def test_each_call_presses_the_button_of_its_floor_and_a_repeated_call_presses_again(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    for floor in ("B1", "L2", "L1", "L1"):
        rig.call(floor)
        rig.run(0.5)
        rig.let_go(floor)
        rig.run(1.0)
    assert {name: len(times) for name, times in rig.pressed.items() if name != "RobotMode"} == {
        "CallButton1": 1,
        "CallButton2": 2,
        "CallButton3": 1,
    }


@each_map
def test_some_seconds_after_the_last_write_everything_falls_and_every_command_is_cleared(layout: Layout) -> None:
    rig = Rig(layout)
    rig.manager[layout.hold] = layout.on
    rig.robot_mode()
    rig.run(10.0)
    assert rig.outputs_on() == ["DoorOpenButton", "RobotMode"]
    rig.call("L2")
    rig.write(layout.mode, layout.on)
    rig.manager.clear()
    last = rig.now
    rig.run(layout.falls_s - LATE_S)
    assert rig.outputs_on() == ["DoorOpenButton", "RobotMode"]
    rig.run(2 * LATE_S)
    assert rig.outputs_on() == []
    assert rig.cells() == [layout.rest] * len(layout.commands)
    assert rig.released["RobotMode"] == [pytest.approx(last + layout.falls_s, abs=LATE_S + 1e-6)]
    assert rig.says("robot_mode_on") is False
    rig.run(60.0)
    assert rig.outputs_on() == []


@each_map
def test_one_lost_write_of_the_manager_lets_nothing_fall(layout: Layout) -> None:
    rig = Rig(layout)
    rig.manager[layout.hold] = layout.on
    rig.robot_mode()
    refreshed = dict(rig.manager)
    for _ in range(10):
        rig.manager.clear()
        rig.run(1.0)
        rig.manager.update(refreshed)
        rig.run(1.0)
    assert "RobotMode" not in rig.released
    assert "DoorOpenButton" not in rig.released


@each_map
@pytest.mark.parametrize("wire", GUARDS)
def test_a_cut_wire_takes_every_command_away_in_the_next_cycle_and_nothing_is_pressed_when_it_is_mended(
    layout: Layout, wire: str
) -> None:
    rig = Rig(layout)
    rig.manager[layout.hold] = layout.on
    rig.robot_mode()
    rig.call("L2")
    rig.run(CYCLE_S)
    assert set(rig.outputs_on()) == {"CallButton3", "DoorOpenButton", "RobotMode"}
    rig.manager = {layout.mode: layout.on}
    rig.contacts(**{wire: False})
    rig.run(CYCLE_S)
    assert rig.outputs_on() == []
    assert rig.cells() == [layout.rest] * len(layout.commands)
    assert rig.says("robot_mode_on") is False
    rig.run(5.0)
    rig.call("L1")
    rig.run(5.0)
    rig.contacts(**{wire: True})
    rig.run(5.0)
    assert rig.outputs_on() == ["RobotMode"]
    assert len(rig.pressed["CallButton3"]) == 1
    assert "CallButton2" not in rig.pressed


@each_map
def test_a_cut_fire_wire_reads_as_fire(layout: Layout) -> None:
    rig = Rig(layout)
    rig.run(1.0)
    assert rig.says("fire") is False
    rig.contacts(NoFire=False)
    rig.run(CYCLE_S)
    assert rig.says("fire") is True


@each_map
def test_with_the_key_switch_off_nothing_is_obeyed(layout: Layout) -> None:
    rig = Rig(layout)
    rig.contacts(RobotsAllowed=False)
    rig.manager = {layout.mode: layout.on, layout.hold: layout.on, layout.close: layout.on}
    rig.manager.update([layout.calls["L2"]])
    rig.run(10.0)
    assert rig.pressed == {}
    assert rig.says("robot_mode_on") is False


@each_map
def test_a_call_is_refused_until_robot_mode_is_granted_and_is_not_remembered(layout: Layout) -> None:
    rig = Rig(layout, grants=False)
    rig.robot_mode()
    rig.call("L2")
    rig.run(5.0)
    rig.contacts(RobotModeGranted=True)
    rig.run(5.0)
    assert "CallButton3" not in rig.pressed
    rig.let_go("L2")
    rig.run(CYCLE_S)
    rig.call("L2")
    rig.run(CYCLE_S)
    assert rig.on("CallButton3")


@each_map_alone
def test_a_hold_that_nobody_writes_again_falls_at_its_limit(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.hold, layout.on)
    given = rig.now
    rig.run(60.0)
    assert rig.released["DoorOpenButton"] == [pytest.approx(given + 30.0, abs=LATE_S)]
    assert layout.on not in rig.cells()
    assert rig.on("RobotMode")


@each_map
def test_a_hold_that_is_written_again_lasts_beyond_its_limit_without_a_gap(layout: Layout) -> None:
    rig = Rig(layout)
    rig.manager[layout.hold] = layout.on
    rig.robot_mode()
    rig.run(120.0)
    assert len(rig.pressed["DoorOpenButton"]) == 1
    assert "DoorOpenButton" not in rig.released


@each_map
@pytest.mark.parametrize("held_s", [0.5, 5.0, 26.5])
def test_a_hold_that_is_let_go_falls_in_the_next_cycle(layout: Layout, held_s: float) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.hold, layout.on)
    rig.run(held_s)
    assert rig.on("DoorOpenButton")
    rig.write(layout.hold, layout.rest)
    rig.run(CYCLE_S)
    assert not rig.on("DoorOpenButton")


@each_map_alone
def test_a_hold_comes_back_after_it_fell_at_its_limit_only_when_it_is_written(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.hold, layout.on)
    rig.run(40.0)
    assert not rig.on("DoorOpenButton")
    rig.write(layout.hold, layout.on)
    rig.run(CYCLE_S)
    assert rig.on("DoorOpenButton")


@each_map_alone
def test_a_hold_that_fell_with_robot_mode_does_not_come_back_with_it(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.hold, layout.on)
    rig.run(28.0)  # taken out of its cell, and not at its limit yet
    assert rig.on("DoorOpenButton")
    rig.contacts(RobotsAllowed=False)
    rig.run(CYCLE_S)
    rig.contacts(RobotsAllowed=True)
    rig.run(1.0)
    assert rig.on("RobotMode")
    assert not rig.on("DoorOpenButton")


@each_map
def test_a_close_that_was_refused_is_not_remembered(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.hold, layout.on)
    rig.run(1.0)
    rig.write(layout.close, layout.on)
    rig.run(2 * CYCLE_S)
    rig.write(layout.hold, layout.rest)
    rig.run(2.0)
    assert "DoorCloseButton" not in rig.pressed


@each_map
def test_the_close_button_is_one_press_and_never_against_a_hold_or_an_obstruction(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.write(layout.close, layout.on)
    rig.run(5.0)
    rig.write(layout.close, layout.rest)
    rig.run(1.0)
    assert rig.released["DoorCloseButton"][0] - rig.pressed["DoorCloseButton"][0] == pytest.approx(0.5, abs=LATE_S)

    rig.write(layout.close, layout.on)
    rig.run(2 * CYCLE_S)
    assert rig.on("DoorCloseButton")
    rig.contacts(DoorwayClear=False)
    rig.run(CYCLE_S)
    assert not rig.on("DoorCloseButton")
    assert rig.says("obstruction.front") is True

    rig.contacts(DoorwayClear=True)
    rig.write(layout.close, layout.rest)
    rig.write(layout.hold, layout.on)
    rig.run(1.0)
    rig.write(layout.close, layout.on)
    rig.run(1.0)
    assert len(rig.pressed["DoorCloseButton"]) == 2
    assert rig.on("DoorOpenButton")


def test_two_call_coils_together_are_no_call() -> None:
    rig = Rig(COILS)
    rig.robot_mode()
    rig.call("B1")
    rig.call("L2")
    rig.run(5.0)
    assert rig.pressed.keys() == {"RobotMode"}


def test_a_call_word_that_is_no_floor_presses_nothing() -> None:
    rig = Rig(REGISTERS)
    rig.robot_mode()
    for word in (3, 0x8000, 0x00FF):
        rig.write(16, word)
        rig.run(1.0)
    assert rig.pressed.keys() == {"RobotMode"}


@each_map
def test_nonsense_in_the_cells_of_a_silent_manager_is_cleared(layout: Layout) -> None:
    rig = Rig(layout)
    for cell in layout.commands:
        if cell != layout.mode:
            rig.write(cell, layout.on if layout.in_bits else 0xBEEF)
    rig.run(CYCLE_S)
    assert rig.pressed == {}
    assert rig.cells() == [layout.rest] * len(layout.commands)


@each_map
def test_zeros_and_cut_wires_never_read_as_a_healthy_lift(layout: Layout) -> None:
    rig = Rig(layout)
    rig.contacts(**dict.fromkeys(ALL_WELL, False))
    for cycles in range(3):  # first as the arrays lie in memory before the first cycle
        assert rig.says("fire") is True
        assert rig.says("car_floor") is None
        assert rig.says("robot_mode_on") is False
        assert rig.says("door.front") in ((Door.MOVING,) if layout.in_bits else (UNLISTED,))
        if not layout.in_bits and cycles == 0:
            assert rig.says("motion") is UNLISTED
            assert rig.says("mode") is UNLISTED
        rig.run(CYCLE_S)


def test_the_alive_counter_counts_at_least_once_a_second_and_begins_anew() -> None:
    rig = Rig(REGISTERS)
    rig.machine.values["Beats"] = 65533
    seen: list[object] = []
    rig.run(4.0, lambda: seen.append(rig.says("alive")))
    assert all(seen[index] != seen[index - 20] for index in range(20, len(seen)))
    assert 65535 in seen
    assert 0 in seen


@each_map
def test_the_floor_is_that_of_the_one_switch_that_is_made(layout: Layout) -> None:
    rig = Rig(layout)
    rig.contacts(AtFloor2=True)
    rig.run(CYCLE_S)
    assert rig.says("car_floor") == layout.floors["L1"]
    rig.contacts(AtFloor2=False)
    rig.run(CYCLE_S)
    assert rig.says("car_floor") == (None if layout.in_bits else layout.floors["L1"])
    rig.contacts(AtFloor1=True)
    rig.run(CYCLE_S)
    assert rig.says("car_floor") == layout.floors["B1"]
    rig.contacts(AtFloor3=True)
    rig.run(CYCLE_S)
    assert rig.says("car_floor") is None
    rig.contacts(AtFloor1=False, AtFloor3=False)
    rig.run(CYCLE_S)
    assert rig.says("car_floor") is None


@each_map
def test_a_call_counts_as_accepted_while_its_lamp_is_lit_and_no_longer(layout: Layout) -> None:
    rig = Rig(layout)
    rig.contacts(CallLamp1=True)
    rig.robot_mode()
    assert rig.says("call_accepted") is None
    rig.call("L2")
    rig.run(0.5)
    rig.let_go("L2")
    assert rig.says("call_accepted") is None
    rig.contacts(CallLamp3=True)
    rig.run(CYCLE_S)
    assert rig.says("call_accepted") == layout.floors["L2"]
    rig.contacts(CallLamp3=False)
    rig.run(CYCLE_S)
    assert rig.says("call_accepted") is None
    rig.contacts(CallLamp3=True)  # a passenger
    rig.run(1.0)
    assert rig.says("call_accepted") is None


@each_map
def test_a_passengers_lamp_is_not_taken_for_a_call_that_was_refused(layout: Layout) -> None:
    rig = Rig(layout, grants=False)
    rig.robot_mode()
    rig.call("L2")
    rig.run(1.0)
    rig.let_go("L2")
    rig.contacts(CallLamp3=True)
    rig.run(1.0)
    assert rig.says("call_accepted") is None


@each_map
def test_a_passengers_lamp_is_not_taken_for_a_call_of_an_earlier_robot(layout: Layout) -> None:
    rig = Rig(layout)
    rig.robot_mode()
    rig.call("L2")  # where the car stands: no lamp
    rig.run(1.0)
    rig.manager.clear()
    rig.run(layout.falls_s + 2.0)
    rig.contacts(CallLamp3=True)
    rig.run(1.0)
    assert rig.says("call_accepted") is None


@each_map
@pytest.mark.parametrize(
    ("is_open", "is_closed", "told"),
    [(True, False, Door.OPEN), (False, True, Door.CLOSED), (True, True, Door.FAULT)],
)
def test_the_door_is_what_its_limits_say(layout: Layout, is_open: bool, is_closed: bool, told: Door) -> None:
    rig = Rig(layout)
    rig.contacts(DoorOpenLimit=is_open, DoorClosedLimit=is_closed)
    rig.run(CYCLE_S)
    assert rig.says("door.front") is told


@each_map
def test_between_its_limits_the_door_goes_away_from_the_last_one(layout: Layout) -> None:
    rig = Rig(layout)
    for last, told in (("DoorClosedLimit", Door.OPENING), ("DoorOpenLimit", Door.CLOSING)):
        rig.contacts(**{last: True})
        rig.run(CYCLE_S)
        rig.contacts(**{last: False})
        rig.run(CYCLE_S)
        assert rig.says("door.front") is (Door.MOVING if layout.in_bits else told)


@each_map
@pytest.mark.parametrize(
    ("up", "down", "told"),
    [
        (False, False, Motion.STOPPED),
        (True, False, Motion.UP),
        (False, True, Motion.DOWN),
        (True, True, UNLISTED),
    ],
)
def test_the_motion_is_what_its_contacts_say(layout: Layout, up: bool, down: bool, told: object) -> None:
    rig = Rig(layout)
    rig.contacts(MovesUp=up, MovesDown=down)
    rig.run(CYCLE_S)
    assert rig.says("motion") is told


@each_map
def test_flags_are_told_as_they_are(layout: Layout) -> None:
    rig = Rig(layout)
    for contact, closed, signal, told in (
        ("LevelSwitch", True, "level", True),
        ("LevelSwitch", False, "level", False),
        ("LoadOk", False, "overload", True),
        ("LoadOk", True, "overload", False),
        ("DoorwayClear", False, "obstruction.front", True),
        ("DoorwayClear", True, "obstruction.front", False),
    ):
        rig.contacts(**{contact: closed})
        rig.run(CYCLE_S)
        assert rig.says(signal) is told, contact


@each_row(
    ("wires", "told"),
    [
        ((), Mode.NORMAL),
        (("NoIndependent",), Mode.INDEPENDENT),
        (("NoIndependent", "InService"), Mode.OUT_OF_SERVICE),
        (("InService", "MainsOn"), Mode.EMERGENCY),
        (("MainsOn", "NoFire"), Mode.FIRE),
        (("NoFire", "NoInspection"), Mode.INSPECTION),
        (("RobotsAllowed",), Mode.NORMAL),
    ],
)
def test_the_mode_word_is_the_highest_of_what_is_told(wires: tuple[str, ...], told: Mode) -> None:
    rig = Rig(REGISTERS)
    rig.contacts(**dict.fromkeys(wires, False))
    rig.run(CYCLE_S)
    assert rig.says("mode") is told


def test_the_mode_word_says_robot_once_it_is_granted() -> None:
    rig = Rig(REGISTERS, grants=False)
    rig.robot_mode()
    assert rig.says("mode") is Mode.NORMAL
    rig.contacts(RobotModeGranted=True)
    rig.run(CYCLE_S)
    assert rig.says("mode") is Mode.ROBOT


@each_row(
    ("wire", "signal"),
    [
        ("NoInspection", "inspection"),
        ("NoIndependent", "independent"),
        ("InService", "out_of_service"),
        ("MainsOn", "emergency_power"),
    ],
)
def test_in_bits_each_service_that_keeps_robots_away_has_its_own(wire: str, signal: str) -> None:
    rig = Rig(COILS)
    rig.run(CYCLE_S)
    assert rig.says(signal) is False
    rig.contacts(**{wire: False})
    rig.run(CYCLE_S)
    assert rig.says(signal) is True


def test_the_key_switch_is_told_in_bits() -> None:
    rig = Rig(COILS)
    rig.run(CYCLE_S)
    assert rig.says("robots_allowed") is True
    rig.contacts(RobotsAllowed=False)
    rig.run(CYCLE_S)
    assert rig.says("robots_allowed") is False
