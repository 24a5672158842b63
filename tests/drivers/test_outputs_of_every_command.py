"""Outputs of every kind the map language has, as state machines: on plain numbers as time."""

import math

from drivers.modbus.output import REJECTED_PAUSE_S, RETRY_S
from drivers.modbus.outputs import Outputs
from drivers.modbus.steps import KINDS_WITH_PERMIT, Phase, Step, StepKind
from register_maps.words import Table
from tests.support.written_maps import written_map

SIGNALS = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "discrete:1"}}\n'
HOLD = "max_hold_s: 30, on_link_loss: latches"
READBACK = "confirm: {any_of: [readback], within_s: 2}"
EFFECT = "confirm: {any_of: [effect], within_s: 5}"


def outputs(commands: str, rest: str = "") -> Outputs:
    codec = written_map(f"{SIGNALS}commands:\n{commands}\n{rest}")
    return Outputs(codec.commands, codec.written)


def carry_out(made: Outputs, now: float) -> Step:
    step = made.next_step(now)
    assert step is not None
    made.record_write(step, now)
    if step.kind in (StepKind.PRESS, StepKind.REFRESH, StepKind.RELEASE):
        made.record_look(step, holds=True, now=now)
    return step


def test_a_pulse_that_the_device_ends_is_never_let_go_by_us() -> None:
    made = outputs(
        '  close_door.front: {at: "coil:512", action: pulse, width_s: 0.5, timed_by: device,'
        " payload: {time: width_s, unit_s: 0.1}, " + EFFECT + "}"
    )
    made.press("close_door.front", 1, 0.0)
    assert carry_out(made, 0.0).kind is StepKind.PRESS
    made.release("close_door.front")
    assert made.next_step(0.4) is None
    assert not made.all_at_rest
    assert made.wake_at() == 0.5
    assert made.next_step(0.5) is None
    assert made.all_at_rest


def test_a_pulse_that_the_device_may_have_begun_rests_after_its_time() -> None:
    made = outputs(
        '  close_door.front: {at: "coil:512", action: pulse, width_s: 0.5, timed_by: device, ' + EFFECT + "}"
    )
    made.press("close_door.front", 1, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.record_failure(step, maybe_sent=True, now=1.0)
    assert made.next_step(1.4) is None
    assert not made.all_at_rest
    assert made.next_step(1.5) is None
    assert made.all_at_rest


def test_a_controller_that_needs_an_edge_gets_the_rest_value_first() -> None:
    made = outputs(
        '  close_door.front: {at: "coil:20", action: pulse, width_s: 0.5, reset_first_s: 0.5, ' + EFFECT + "}"
    )
    made.press("close_door.front", 1, 0.0)
    assert carry_out(made, 0.0) == Step(StepKind.RESET, "close_door.front", None)
    assert made.next_step(0.49) is None
    assert made.wake_at() == 0.5
    assert carry_out(made, 0.5).kind is StepKind.PRESS
    assert carry_out(made, 1.0).kind is StepKind.RELEASE
    made.press("close_door.front", 1, 2.0)
    assert carry_out(made, 2.0).kind is StepKind.RESET


def test_a_press_whose_reset_failed_is_given_up() -> None:
    made = outputs(
        '  close_door.front: {at: "coil:20", action: pulse, width_s: 0.5, reset_first_s: 0.5, ' + EFFECT + "}"
    )
    made.press("close_door.front", 1, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.record_failure(step, maybe_sent=True, now=0.3)
    assert not made.is_pending("close_door.front")
    assert made.all_at_rest
    assert made.next_step(9.0) is None


def test_a_reset_that_nobody_wants_any_more_arms_nothing() -> None:
    made = outputs(
        '  close_door.front: {at: "coil:20", action: pulse, width_s: 0.5, reset_first_s: 0.5, ' + EFFECT + "}"
    )
    made.press("close_door.front", 1, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.release("close_door.front")
    made.record_write(step, 0.1)
    made.press("close_door.front", 1, 5.0)
    assert carry_out(made, 5.0).kind is StepKind.RESET


def test_a_hold_for_a_controller_that_drops_stuck_buttons_is_pressed_again_and_again() -> None:
    made = outputs(
        f'  hold_door.front: {{at: "coil:2", action: hold, width_s: 1, repeat_pulse_s: 3, {HOLD}, {EFFECT}}}'
    )
    made.hold("hold_door.front", 0.0)
    assert carry_out(made, 0.0).kind is StepKind.PRESS
    assert carry_out(made, 1.0) == Step(StepKind.PAUSE, "hold_door.front", None)
    assert made.phase("hold_door.front") is Phase.ON
    assert made.next_step(2.9) is None
    assert carry_out(made, 3.0).kind is StepKind.REFRESH
    assert carry_out(made, 4.0).kind is StepKind.PAUSE
    made.release("hold_door.front")
    assert carry_out(made, 4.5).kind is StepKind.RELEASE
    assert made.all_at_rest


def test_the_end_of_one_pulse_of_a_hold_is_tried_again() -> None:
    made = outputs(
        f'  hold_door.front: {{at: "coil:2", action: hold, width_s: 1, repeat_pulse_s: 3, {HOLD}, {EFFECT}}}'
    )
    made.hold("hold_door.front", 0.0)
    carry_out(made, 0.0)
    step = made.next_step(1.0)
    assert step is not None
    made.record_failure(step, maybe_sent=False, now=1.0)
    assert carry_out(made, 1.0 + RETRY_S) == Step(StepKind.PAUSE, "hold_door.front", None)


def test_the_next_press_waits_for_its_least_distance() -> None:
    made = outputs('  go_to: {at: "holding:1", as: floor, action: pulse, width_s: 1, min_repeat_s: 5, ' + EFFECT + "}")
    made.press("go_to", 2, 0.0)
    carry_out(made, 0.0)
    carry_out(made, 1.0)
    made.press("go_to", 3, 1.5)
    assert made.next_step(4.99) is None
    assert carry_out(made, 5.0) == Step(StepKind.PRESS, "go_to", 3)


def test_a_rejected_press_does_not_shorten_the_least_distance() -> None:
    made = outputs('  go_to: {at: "holding:1", as: floor, action: pulse, width_s: 1, min_repeat_s: 9, ' + EFFECT + "}")
    made.press("go_to", 2, 0.0)
    carry_out(made, 0.0)
    carry_out(made, 1.0)
    made.press("go_to", 3, 9.0)
    step = made.next_step(9.0)
    assert step is not None
    made.record_failure(step, maybe_sent=False, now=9.0, rejected=True)
    made.press("go_to", 3, 9.0)
    assert made.next_step(9.0 + REJECTED_PAUSE_S - 0.01) is None
    assert carry_out(made, 9.0 + REJECTED_PAUSE_S).kind is StepKind.PRESS


def test_a_heartbeat_counts_whether_or_not_anything_is_wanted_and_skips_the_zero() -> None:
    made = outputs('  heartbeat: {at: "holding:41", action: count, every_s: 0.5}')
    assert [carry_out(made, at).code for at in (0.0, 0.5, 1.0)] == [1, 2, 3]
    assert made.next_step(1.2) is None
    assert made.wake_at() == 1.5
    assert made.all_at_rest
    made.record_write(Step(StepKind.BEAT, "heartbeat", 65535), 1.5)
    assert carry_out(made, 2.0).code == 1


def test_a_heartbeat_that_toggles_a_coil_toggles_it() -> None:
    made = outputs('  heartbeat: {at: "coil:41", action: toggle, every_s: 0.5}')
    assert [carry_out(made, at).code for at in (0.0, 0.5, 1.0)] == [1, 0, 1]


def test_a_lost_heartbeat_is_sent_again_soon_with_the_same_count() -> None:
    made = outputs('  heartbeat: {at: "holding:41", action: count, every_s: 2}')
    step = made.next_step(0.0)
    assert step is not None
    made.record_failure(step, maybe_sent=True, now=0.0)
    assert carry_out(made, RETRY_S).code == 1


CYCLIC = (
    '  call: {at: "holding:0", as: floor, action: hold, until: robot_in_place, max_hold_s: 300, on_link_loss: latches, '
    + EFFECT
    + "}\n"
    '  go: {at: "holding:1", as: floor, action: hold, until: robot_left, max_hold_s: 300, on_link_loss: latches, '
    + EFFECT
    + "}\n"
    f'  robot_in_place: {{at: "holding:2", action: pulse, width_s: 5, {READBACK}}}\n'
    f'  robot_left: {{at: "holding:3", action: pulse, width_s: 5, {READBACK}}}'
)
BLOCK = 'write_blocks: [{at: "holding:0", count: 4, function: 16, every_s: 0.5}]\n'


def test_a_cyclic_block_is_written_although_nothing_is_wanted() -> None:
    made = outputs(CYCLIC, BLOCK)
    step = carry_out(made, 0.0)
    assert (step.kind, step.block is not None, step.kind in KINDS_WITH_PERMIT) == (StepKind.CYCLE, True, False)
    assert made.cells(step) == {("", Table.HOLDING, address): 0 for address in range(4)}
    assert made.next_step(0.49) is None
    assert made.wake_at() == 0.5
    assert carry_out(made, 0.5).kind is StepKind.CYCLE
    assert made.all_at_rest


def test_a_cyclic_block_with_something_on_is_written_with_permission() -> None:
    made = outputs(CYCLIC, BLOCK)
    carry_out(made, 0.0)
    made.press("call", 3, 0.1)
    assert carry_out(made, 0.1).kind is StepKind.PRESS
    assert made.next_step(0.59) is None
    step = carry_out(made, 0.6)
    assert (step.kind, step.name) == (StepKind.REFRESH, "call")
    assert made.cells(step)["", Table.HOLDING, 0] == 3
    made.release("call")
    assert carry_out(made, 0.7).kind is StepKind.RELEASE
    assert carry_out(made, 1.2).kind is StepKind.CYCLE


def test_a_pulse_in_a_cyclic_block_heals_itself_too() -> None:
    made = outputs(CYCLIC, BLOCK)
    carry_out(made, 0.0)
    made.press("robot_in_place", 1, 0.1)
    carry_out(made, 0.1)
    assert carry_out(made, 0.6) == Step(StepKind.REFRESH, "robot_in_place", 1)
    assert carry_out(made, 5.1).kind is StepKind.RELEASE


LAMP = (
    'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, calls_registered: {each_of: ["coil:16", "coil:17"]}}\n'
    "commands:\n"
    '  go_to: {one_of: ["coil:16", "coil:17"], action: pulse, width_s: 0.5, confirm: {any_of: [calls_registered], within_s: 2}}\n'
)


def test_a_lamp_at_the_point_of_its_button_is_not_taken_for_our_press() -> None:
    codec = written_map(LAMP)
    made = Outputs(codec.commands, codec.written)
    lit = {("", Table.COIL, 16): 0, ("", Table.COIL, 17): 1}
    made.record_reconnect(lit, 0.0)
    assert made.all_at_rest
    assert made.next_step(0.0) is None
    made.press("go_to", 1, 1.0)
    assert carry_out(made, 1.0) == Step(StepKind.PRESS, "go_to", 1)
    made.record_reconnect(lit, 1.2)
    assert carry_out(made, 1.2) == Step(StepKind.RELEASE, "go_to", None)


def test_bits_of_one_register_are_put_side_by_side() -> None:
    made = outputs(
        f'  hold_door.front: {{at: "holding:9.3", action: hold, shared_word: owned, {HOLD}, {READBACK}}}\n'
        f'  close_door.front: {{at: "holding:9.0", action: pulse, width_s: 1, shared_word: owned, {EFFECT}}}'
    )
    made.hold("hold_door.front", 0.0)
    step = carry_out(made, 0.0)
    assert made.cells(step) == {("", Table.HOLDING, 9): 0b1000}
    made.press("close_door.front", 1, 0.1)
    step = carry_out(made, 0.1)
    assert made.cells(step) == {("", Table.HOLDING, 9): 0b1001}
    made.record_reconnect({("", Table.HOLDING, 9): 0xF008}, 5.0)
    assert made.is_verified("hold_door.front")
    assert carry_out(made, 5.0) == Step(StepKind.RELEASE, "close_door.front", None)


def test_nothing_to_do_waits_for_ever() -> None:
    made = outputs(f'  hold_door.front: {{at: "coil:2", action: hold, {HOLD}, {READBACK}}}')
    assert made.next_step(0.0) is None
    assert made.wake_at() == math.inf
