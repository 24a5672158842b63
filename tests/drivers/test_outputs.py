"""Outputs as state machines: on plain numbers as time."""

import math

import pytest

from drivers.modbus.output import RETRY_S
from drivers.modbus.outputs import Outputs
from drivers.modbus.steps import Phase, Step, StepKind
from register_maps.words import Table
from tests.support.shipped_maps import compiled


def outputs(name: str = "generic-registers") -> Outputs:
    return Outputs(compiled(name).commands)


def carry_out(made: Outputs, now: float) -> Step:
    step = made.next_step(now)
    assert step is not None
    made.record_write(step, now)
    made.record_look(step, holds=True, now=now)
    return step


def test_a_pulse_is_pressed_stays_on_for_its_width_and_is_let_go() -> None:
    made = outputs()
    made.press("go_to", 3, 10.0)
    assert carry_out(made, 10.0) == Step(StepKind.PRESS, "go_to", 3)
    assert made.next_step(10.49) is None
    assert made.wake_at() == 10.5
    assert carry_out(made, 10.5) == Step(StepKind.RELEASE, "go_to", None)
    assert made.all_at_rest
    assert made.wake_at() == math.inf


def test_a_press_is_tried_once() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.record_failure(step, maybe_sent=False, now=0.5)
    assert made.all_at_rest
    assert made.next_step(100.0) is None


def test_a_press_that_may_have_arrived_is_let_go_and_not_pressed_again() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.record_failure(step, maybe_sent=True, now=0.5)
    assert carry_out(made, 0.5).kind is StepKind.RELEASE
    assert made.next_step(100.0) is None


def test_a_release_is_tried_again_until_it_is_seen_to_hold() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    carry_out(made, 0.0)
    release = made.next_step(0.5)
    assert release is not None
    made.record_failure(release, maybe_sent=True, now=1.0)
    assert made.next_step(1.0) is None
    again = made.next_step(1.0 + RETRY_S)
    assert again == release
    made.record_write(release, 1.3)
    made.record_look(release, holds=False, now=1.3)
    assert not made.all_at_rest
    assert made.next_step(1.3 + RETRY_S) is None, "each try waits longer"
    assert carry_out(made, 1.3 + 2 * RETRY_S) == release
    assert made.all_at_rest


def test_releases_go_before_presses() -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    carry_out(made, 0.0)
    made.release("hold_door.front")
    made.press("go_to", 2, 0.1)
    assert [carry_out(made, 0.1).kind for _ in range(2)] == [StepKind.RELEASE, StepKind.PRESS]


def test_a_hold_is_refreshed_on_time_and_falls_at_its_limit() -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    assert carry_out(made, 0.0).kind is StepKind.PRESS
    for second in range(1, 30):
        assert made.next_step(second - 0.01) is None
        assert carry_out(made, float(second)).kind is StepKind.REFRESH
    assert carry_out(made, 30.0).kind is StepKind.RELEASE
    assert made.all_at_rest


def test_renewing_a_hold_moves_its_limit() -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    carry_out(made, 0.0)
    made.hold("hold_door.front", 20.0)
    assert carry_out(made, 49.9).kind is StepKind.REFRESH
    assert carry_out(made, 50.0).kind is StepKind.RELEASE


def test_what_excludes_each_other_is_let_go_first() -> None:
    made = outputs("two-stop-agv")
    made.press("go_to", 1, 0.0)
    carry_out(made, 0.0)
    made.hold("hold_door.front", 1.0)
    assert carry_out(made, 1.0) == Step(StepKind.RELEASE, "go_to", None)
    assert carry_out(made, 1.0) == Step(StepKind.PRESS, "hold_door.front", 1)
    assert made.cells(Step(StepKind.REFRESH, "hold_door.front", 1)) == {
        ("", Table.COIL, n): int(n == 2) for n in range(4)
    }


def test_a_hold_that_does_not_stick_is_written_again_soon_and_does_not_count_as_verified() -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.record_write(step, 0.0)
    made.record_look(step, holds=False, now=0.0)
    assert not made.is_verified("hold_door.front")
    assert made.next_step(RETRY_S) is None, "it waits for another beginning"
    made.output("hold_door.front").begin += 1
    assert made.wake_at() == pytest.approx(RETRY_S)
    assert carry_out(made, RETRY_S) == Step(StepKind.PRESS, "hold_door.front", 1)


def test_a_new_call_while_one_is_pressed_waits_for_the_release() -> None:
    made = outputs()
    made.press("go_to", 2, 0.0)
    carry_out(made, 0.0)
    made.press("go_to", 3, 0.1)
    assert carry_out(made, 0.1) == Step(StepKind.RELEASE, "go_to", None)
    assert carry_out(made, 0.1) == Step(StepKind.PRESS, "go_to", 3)


def test_letting_everything_go_forgets_what_was_due_and_what_was_to_follow() -> None:
    made = outputs()
    made.press("go_to", 2, 0.0)
    carry_out(made, 0.0)
    made.press("go_to", 3, 0.1)
    made.hold("hold_door.front", 0.1)
    made.release_all()
    assert carry_out(made, 0.1).kind is StepKind.RELEASE
    assert made.all_at_rest


def test_after_a_reconnect_a_wanted_hold_is_adopted_or_written_again_and_a_call_is_not() -> None:
    cells = {("", Table.HOLDING, address): 0 for address in range(16, 20)}
    for still_on in (True, False):
        made = outputs()
        made.hold("hold_door.front", 0.0)
        carry_out(made, 0.0)
        made.press("go_to", 2, 0.0)
        carry_out(made, 0.0)
        made.record_reconnect(cells | {("", Table.HOLDING, 17): int(still_on)}, 5.0)
        assert made.is_verified("hold_door.front") is still_on
        assert carry_out(made, 5.0) == Step(StepKind.RELEASE, "go_to", None)
        made.output("hold_door.front").begin += 1
        again = StepKind.REFRESH if still_on else StepKind.PRESS
        assert carry_out(made, 5.0) == Step(again, "hold_door.front", 1)
        assert made.phase("go_to") is Phase.REST


@pytest.mark.parametrize(("found_off_at", "then"), [(27.5, StepKind.REFRESH), (12.0, StepKind.RELEASE)])
def test_a_kept_hold_that_the_controller_cleared_to_see_it_written_goes_on_over_a_reconnect(
    found_off_at: float, then: StepKind
) -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    carry_out(made, 0.0)
    made.output("hold_door.front").keep()
    made.record_reconnect({("", Table.HOLDING, address): 0 for address in range(16, 20)}, found_off_at)
    step = made.next_step(found_off_at)
    assert step is not None
    assert step.kind is then


def test_after_a_reconnect_what_nobody_wants_is_let_go() -> None:
    made = outputs()
    made.record_reconnect(
        {
            ("", Table.HOLDING, 16): 3,
            ("", Table.HOLDING, 17): 0,
            ("", Table.HOLDING, 18): 1,
            ("", Table.HOLDING, 19): 0,
        },
        5.0,
    )
    assert {carry_out(made, 5.0).name for _ in range(2)} == {"go_to", "robot_mode"}
    assert made.all_at_rest


def test_a_level_call_that_the_controller_still_holds_is_adopted() -> None:
    made = outputs("two-stop-agv")
    made.press("go_to", 1, 0.0)
    carry_out(made, 0.0)
    made.record_reconnect({("", Table.COIL, n): int(n == 1) for n in range(4)}, 1.0)
    assert made.phase("go_to") is Phase.ON
    made.record_reconnect({("", Table.COIL, n): 0 for n in range(4)}, 2.0)
    assert carry_out(made, 2.0) == Step(StepKind.RELEASE, "go_to", None)
    assert made.all_at_rest


def test_a_press_that_is_let_go_while_it_is_on_its_way_is_released_when_it_has_arrived() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.release("go_to")
    assert not made.all_at_rest
    made.record_write(step, 0.1)
    assert carry_out(made, 0.1) == Step(StepKind.RELEASE, "go_to", None)
    assert made.all_at_rest


def test_a_hold_that_is_pressed_again_and_let_go_on_its_way_is_released_when_it_has_arrived() -> None:
    made = outputs()
    made.hold("hold_door.front", 0.0)
    carry_out(made, 0.0)
    made.record_reconnect({("", Table.HOLDING, address): 0 for address in range(16, 20)}, 5.0)
    made.output("hold_door.front").begin += 1
    again = made.next_step(5.0)
    assert again == Step(StepKind.PRESS, "hold_door.front", 1)
    made.release("hold_door.front")
    made.record_write(again, 5.01)
    assert made.phase("hold_door.front") is Phase.RELEASING
    assert carry_out(made, 5.01).kind is StepKind.RELEASE
    assert made.all_at_rest


def test_a_press_that_is_let_go_on_its_way_and_never_left_needs_no_release() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    step = made.next_step(0.0)
    assert step is not None
    made.release("go_to")
    made.record_failure(step, maybe_sent=False, now=0.1)
    assert made.all_at_rest


def test_a_newer_press_waits_for_the_one_on_its_way_to_be_let_go() -> None:
    made = outputs()
    made.press("go_to", 3, 0.0)
    first = made.next_step(0.0)
    assert first is not None
    made.press("go_to", 2, 0.05)
    made.record_write(first, 0.1)
    assert carry_out(made, 0.1) == Step(StepKind.RELEASE, "go_to", None)
    assert carry_out(made, 0.1) == Step(StepKind.PRESS, "go_to", 2)
