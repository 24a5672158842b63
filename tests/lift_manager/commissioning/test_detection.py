"""What can be seen of each fault is said for every map, and follows from what the map reads."""

from lift_manager.commissioning.detection import MODES, Detection, FaultEffect, detections
from lift_manager.lab.world.fault_names import every_device_fault, fault_name
from register_maps.codec import compile_map
from register_maps.load import MapChanges, load, shipped
from register_maps.words import Mode
from simulator.faults import ForeignWriter
from tests.support.rows import each_row


def of(name: str, **override: object) -> dict[str, Detection]:
    codec = compile_map(load(name, changes=MapChanges(override=override)).map)
    return {one.fault: one for one in detections(codec, max_age_s=1.0)}


@each_row("name", shipped())
def test_no_fault_is_left_out_on_any_map(name: str) -> None:
    known = {fault_name(fault) for fault in every_device_fault()} | {fault_name(ForeignWriter("go_to"))}
    assert set(of(name)) == known


@each_row("name", shipped())
def test_every_class_says_why_and_what_is_wrong_meanwhile(name: str) -> None:
    for one in of(name).values():
        assert one.how
        if one.within_s is None:
            assert one.lies, one


def test_registers_that_stand_still_are_seen_by_their_heartbeat() -> None:
    assert of("generic-registers")["frozen_registers"].within_s == 4.0  # 3 s in the map, and the age of a reading


def test_without_a_heartbeat_nobody_sees_that_registers_stand_still() -> None:
    frozen = of("generic-registers", signals={"alive": None})["frozen_registers"]
    assert frozen.within_s is None
    assert FaultEffect.OPEN in frozen.lies
    assert "no heartbeat" in frozen.how


def test_a_car_that_goes_to_the_wrong_floor_again_and_again_is_said_to_be_an_alarm() -> None:
    assert "twice in a row with the same offset, are an alarm" in of("two-stop-agv")["wrong_floor"].how


def test_a_mode_that_no_signal_tells_is_undetectable() -> None:
    assert of("generic-coils")["in_mode.fire"].within_s is not None
    assert of("robotnik-il-eth")["in_mode.fire"].within_s is None


def test_a_map_that_tells_no_mode_but_robot_mode_says_what_may_still_be_seen_of_one() -> None:
    assert "withdrawn robot mode" in of("two-stop-agv")["in_mode.fire"].how
    assert "withdrawn" not in of("robotnik-il-eth")["in_mode.fire"].how


def test_every_mode_is_seen_where_one_word_tells_them_all() -> None:
    told = of("generic-registers")
    assert all(told[f"in_mode.{mode}"].within_s is not None for mode in MODES)


def test_fire_is_among_the_modes_that_a_controller_changes_to_by_itself() -> None:
    assert Mode.FIRE in MODES
    assert Mode.NORMAL not in MODES


def test_a_door_with_one_contact_cannot_contradict_itself() -> None:
    told = of("robotnik-il-eth")
    assert told["contradicting_limits"].fault == "contradicting_limits"
    assert of("generic-coils")["contradicting_limits"].within_s is not None


def test_a_press_that_gets_lost_shows_where_the_controller_answers_with_a_lamp() -> None:
    lamp = {"confirm": {"any_of": ["call_accepted"], "within_s": 2}}
    told = of("generic-registers", commands={"go_to": lamp})["lost_press"]
    assert (told.within_s, told.lies) == (2.0, ())


def test_somebody_else_who_writes_is_told_and_still_obeyed() -> None:
    told = of("generic-registers")["foreign_writer"]
    assert told.within_s is not None
    assert told.goes_on
