"""What stays on after its session is over is kept as it is found, and pressed for nobody."""

from collections.abc import Callable

from drivers.modbus.memory import MemoryDevice, exception
from drivers.modbus.steps import Step, StepKind
from drivers.model import Command
from register_maps.words import Table
from tests.drivers.caller import Caller, Permit
from tests.drivers.linked import now
from tests.drivers.rig import CLOSE_FRONT, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.drivers.test_what_was_on_before_is_adopted import (
    BLOCK,
    EXCLUDING,
    MASKED,
    NOT_REFRESHED,
    SHARED,
    SINGLE,
    dropped,
    left_on,
    outputs,
    switched_off_and_on,
    values_of,
)
from tests.support.rows import each_row
from tests.support.virtual_time import elapse

BY_EFFECT = SINGLE.replace("[readback]", "[effect]")
"""Nothing asks for a look after a refresh."""
PULSES = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", action: hold, width_s: 0.3, repeat_pulse_s: 1, max_hold_s: 30,'
    " on_link_loss: device_watchdog, confirm: {any_of: [effect], within_s: 2}}\n"
)
OF_MAP = {
    "coil": (SINGLE, Table.COIL, 8, 0, 1),
    "not refreshed": (NOT_REFRESHED, Table.COIL, 8, 0, 1),
    "by effect": (BY_EFFECT, Table.COIL, 8, 0, 1),
    "shared word": (SHARED, Table.HOLDING, 9, 0xA000, 4),
    "mask write": (MASKED, Table.HOLDING, 9, 0xA000, 4),
    "cyclic block": (BLOCK, Table.COIL, 1, 0, 1),
}


def resting() -> MemoryDevice:
    return left_on({Table.HOLDING: {9: 0xA000}})


async def begun(made: Rig) -> None:
    made.lift.hold(HOLD_FRONT, allowed)
    await elapse(1.0)
    assert made.lift.given(HOLD_FRONT)


async def renewed(made: Rig, for_s: float) -> None:
    for _ in range(round(for_s / 0.1)):
        made.lift.hold(HOLD_FRONT, allowed, begin=False)
        await elapse(0.1)


def written_since(device: MemoryDevice, since: float, table: Table, address: int, bit: int) -> list[bool]:
    """Whether each write of a cell since then has left this bit on."""
    return [bool(value & bit) for value in values_of([h for h in device.received if h.at_s >= since], table, address)]


@each_row("which", OF_MAP)
def test_a_kept_hold_that_falls_while_the_lift_cannot_be_read_is_not_pressed_until_somebody_asks(which: str) -> None:
    text, table, address, rest, bit = OF_MAP[which]
    device = resting()

    async def check(made: Rig) -> None:
        await begun(made)
        made.device.fall_silent(6.0)
        await elapse(4.0)
        made.lift.keep(HOLD_FRONT)
        assert made.lift.given(HOLD_FRONT)
        dropped(made)
        since = now()
        await elapse(3.0)
        await renewed(made, 5.0)
        assert not made.lift.given(HOLD_FRONT)
        assert True not in written_since(device, since, table, address, bit)
        await begun(made)
        assert device.values[table][address] == rest | bit

    on_rig(check, text, {"": device})


@each_row("which", OF_MAP)
def test_a_kept_hold_that_is_found_on_stays_on_without_a_break_and_falls_by_its_limit(which: str) -> None:
    text, table, address, rest, bit = OF_MAP[which]
    device = resting()

    async def check(made: Rig) -> None:
        await begun(made)
        made.lift.keep(HOLD_FRONT)
        since = now()
        device.fall_silent(5.0)
        await elapse(7.0)
        before = len(device.received)
        await renewed(made, 5.0)
        await elapse(8.5)
        assert made.lift.given(HOLD_FRONT)
        assert device.values[table][address] == rest | bit
        assert False not in written_since(device, since, table, address, bit)
        assert len(device.received) - before < 500, "it is looked at no more often than it is refreshed"
        await elapse(2.5)
        assert not made.lift.given(HOLD_FRONT)
        assert device.values[table][address] == rest

    on_rig(check, text, {"": device})


def test_keeping_a_hold_renews_nothing() -> None:
    async def check(made: Rig) -> None:
        await begun(made)
        for _ in range(95):
            made.lift.keep(HOLD_FRONT)
            await elapse(0.1)
        assert not made.lift.given(HOLD_FRONT)

    on_rig(check, SINGLE, {"": resting()})


def test_a_kept_hold_that_the_controller_drops_in_plain_sight_is_not_pressed_again() -> None:
    device = resting()

    async def check(made: Rig) -> None:
        await begun(made)
        made.lift.keep(HOLD_FRONT)
        switched_off_and_on(made)
        await renewed(made, 5.0)
        assert values_of(device.received, Table.COIL, 8).count(1) == 1

    on_rig(check, NOT_REFRESHED, {"": device})


def test_a_kept_hold_is_looked_at_before_it_is_written_again_after_a_refresh_that_failed() -> None:
    async def check(made: Rig) -> None:
        await begun(made)
        made.device.fail_next(exception(4), times=10**6, on=lambda request: request.is_write)
        await elapse(1.5)
        made.lift.keep(HOLD_FRONT)
        dropped(made)
        made.device.clear_faults()
        await renewed(made, 3.0)
        assert made.cells(Table.COIL, 8) == [0]

    on_rig(check, SINGLE, {"": resting()})


def test_what_waits_for_another_to_rest_is_not_pressed_once_it_is_only_kept() -> None:
    async def waits_for_another(made: Rig) -> None:
        made.lift.hold(CLOSE_FRONT, allowed)
        await elapse(0.3)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.1)
        assert made.lift.given(HOLD_FRONT)
        made.lift.keep(HOLD_FRONT)
        assert made.lift.at_rest(HOLD_FRONT)
        await renewed(made, 3.0)
        assert values_of(made.device.received, Table.COIL, 8) == []

    on_rig(waits_for_another, EXCLUDING, {"": resting()})


def test_a_press_that_is_on_its_way_when_it_is_only_kept_comes_about() -> None:
    device = left_on({}, delay_s=0.2)

    async def check(made: Rig) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        while not device.writes:
            await elapse(0.02)
        assert not made.lift.held(HOLD_FRONT), "the answer to the press is still to come"
        made.lift.keep(HOLD_FRONT)
        await renewed(made, 5.0)
        assert made.lift.held(HOLD_FRONT)
        assert len(values_of(device.received, Table.COIL, 8)) >= 3, "it is refreshed"
        switched_off_and_on(made)
        await renewed(made, 3.0)
        assert made.lift.at_rest(HOLD_FRONT)

    on_rig(check, SINGLE, {"": device})


def test_a_hold_made_of_pulses_goes_on_at_its_own_pace_as_nobody_can_see_whether_it_fell() -> None:
    device = resting()

    async def check(made: Rig) -> None:
        await begun(made)
        made.lift.keep(HOLD_FRONT)
        before = len(device.writes)
        await renewed(made, 10.0)
        assert made.lift.given(HOLD_FRONT)
        assert 18 <= len(device.writes) - before <= 22, "one press and one release a second"

    on_rig(check, PULSES, {"": device})


def test_what_was_let_go_or_is_no_command_of_the_map_is_not_kept() -> None:
    async def check(made: Rig) -> None:
        made.lift.keep(CLOSE_FRONT)
        await begun(made)
        made.lift.let_go(HOLD_FRONT)
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.keep(HOLD_FRONT)
        await elapse(1.0)
        assert made.lift.at_rest(HOLD_FRONT)
        assert made.cells(Table.COIL, 8) == [0]

    on_rig(check, SINGLE, {"": resting()})


@each_row("asked", [Caller.hold, Caller.press])
@each_row("is_on", [True, False])
def test_what_was_kept_is_a_hold_like_any_other_once_it_is_asked_for(
    asked: Callable[[Caller, Command, Permit], object], *, is_on: bool
) -> None:
    async def check(made: Rig) -> None:
        if is_on:
            await begun(made)
        made.lift.keep(HOLD_FRONT)
        asked(made.lift, HOLD_FRONT, allowed)
        await elapse(1.0)
        switched_off_and_on(made)
        await renewed(made, 3.0)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, SINGLE, {"": resting()})


def test_a_kept_hold_that_fell_is_pressed_with_no_neighbour_in_its_block_from_the_first_look_on() -> None:
    made = outputs(BLOCK)
    front, mode = ("", Table.COIL, 1), ("", Table.COIL, 2)
    for name in ("hold_door.front", "robot_mode"):
        made.hold(name, 0.0)
    while (step := made.next_step(0.0)) is not None:
        made.record_write(step, 0.0)
        if step.kind is StepKind.PRESS:
            made.record_look(step, holds=True, now=0.0)
    assert made.is_verified("robot_mode")
    made.output("robot_mode").keep()
    made.record_reconnect({front: 0, mode: 0}, 0.5)
    step = Step(StepKind.REFRESH, "hold_door.front", 1)
    assert (made.cells(step)[front], made.cells(step)[mode]) == (1, 0)
    assert made.next_step(0.5) == Step(StepKind.RELEASE, "robot_mode", None, was=1)
