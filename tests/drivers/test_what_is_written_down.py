"""What the driver tells the log of its writes."""

import math

import pytest

from drivers.modbus.memory import exception, silence
from drivers.model import Command, CommandKind, Written
from register_maps.words import Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.linked import now
from tests.drivers.rig import HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.support.virtual_time import elapse

GO2 = Command(CommandKind.GO_TO, "L2")
HOLDING = HOLD.replace("max_hold_s: 30", "max_hold_s: 60, refresh_s: 0.5")
PLAIN = (
    f'{SIGNALS}commands:\n  go_to: {{at: "holding:40", as: floor, rest: 0, action: pulse, width_s: 0.5, reset_first_s: 0.2,'
    " confirm: {any_of: [readback], within_s: 2}}\n"
    f'  hold_door.front: {{at: "coil:8", {HOLDING}}}\n'
)


async def keep(made: Rig, seconds: float) -> None:
    for _ in range(int(seconds * 10)):
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.1)


def test_presses_releases_and_resets_are_told_with_their_frames() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        _ = made.lift.press(GO2, allowed)
        await elapse(2.0)
        _ = made.lift.press(GO2, allowed)
        await elapse(2.0)

    on_rig(check, PLAIN, log=log)
    one = [
        Written("go_to", "reset", ("010600280000",)),
        Written("go_to", "press", ("010600280002",)),
        Written("go_to", "release", ("010600280000",)),
    ]
    assert log.told == one + one


def test_a_refresh_is_told_only_where_it_differs_from_what_was_told_last() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await keep(made, 5.0)
        assert len(made.writes()) > 8
        made.device.fail_next(exception(4), times=3, on=lambda request: request.is_write)
        await keep(made, 10.0)
        await made.lift.release_all()

    on_rig(check, PLAIN, log=log)
    assert log.lines == [
        "press hold_door.front",
        "refresh hold_door.front failed",
        "refresh hold_door.front",
        "release hold_door.front",
    ]
    assert "exception 04" in log.told[1].failure
    assert log.told[1].frames == log.told[0].frames == ("01050008ff00",)


def test_a_write_without_an_answer_is_told_with_its_frames_because_it_may_have_arrived() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        made.device.fail_next(silence(executes=True), on=lambda request: request.is_write)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(3.0)

    on_rig(check, PLAIN, log=log)
    assert log.lines[0] == "press hold_door.front failed"
    assert log.told[0].frames == ("01050008ff00",)
    assert "no answer within" in log.told[0].failure
    assert log.lines[1] == "release hold_door.front"


def test_what_did_not_leave_is_not_told() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        refused = made.lift.press(GO2, lambda: "fire")
        await elapse(1.0)
        assert refused.done()
        made.device.disconnect()
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.05)

    on_rig(check, PLAIN, log=log)
    # the reset asks nobody: it says what stands there anyhow
    assert log.lines == ["reset go_to"]


@pytest.mark.parametrize("code", [1, 4, 6, 0x0A, 0x0B])
def test_a_write_that_the_controller_answers_with_an_exception_has_reached_the_wire(code: int) -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        made.device.fail_next(exception(code), on=lambda request: request.is_write)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.1)

    on_rig(check, PLAIN, log=log)
    assert log.lines[0] == "press hold_door.front failed"
    assert f"exception {code:02X}" in log.told[0].failure


@pytest.mark.parametrize("shared", ["accepted", "mask_write"])
def test_a_shared_word_is_told_as_it_was_written_and_planned_without_reading(shared: str) -> None:
    log = LogByHand()
    text = f'{SIGNALS}commands: {{hold_door.front: {{at: "holding:9.2", shared_word: {shared}, {HOLD}}}}}\n'

    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING][9] = 0xA001
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.5)

    on_rig(check, text, log=log)
    planned, told = log.rows[0][1], log.told[0].frames
    if shared == "mask_write":
        assert planned == told == ("01160009fffb0004",)
    else:
        assert (planned, told) == (("010600090004",), ("01060009a005",))


def test_a_cycle_is_told_once_and_again_only_when_it_fails_or_is_mended() -> None:
    log = LogByHand()
    text = (
        f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:1", {HOLDING}}}}}\n'
        'write_blocks: [{at: "coil:1", count: 2, function: 15, every_s: 0.5, gaps: 0}]\n'
    )

    async def check(made: Rig) -> None:
        await elapse(5.0)
        assert len(made.writes()) > 8
        assert log.lines == ["cycle"]
        made.device.fail_next(exception(4), times=2, on=lambda request: request.is_write)
        await elapse(5.0)
        assert log.lines == ["cycle", "cycle failed", "cycle"]
        await keep(made, 2.0)
        made.lift.let_go(HOLD_FRONT)
        await elapse(5.0)
        assert log.lines[3:] == ["press hold_door.front", "release hold_door.front"]

    on_rig(check, text, log=log)


def test_a_heartbeat_is_told_when_it_begins_fails_and_goes_on_and_not_at_every_count() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        await elapse(3.0)
        made.device.fail_next(exception(4), times=2, on=lambda request: request.is_write)
        await elapse(3.0)

    on_rig(check, f'{SIGNALS}commands: {{heartbeat: {{at: "holding:41", action: count, every_s: 0.5}}}}\n', log=log)
    assert log.lines == ["beat heartbeat", "beat heartbeat failed", "beat heartbeat"]
    assert log.told[0].frames == ("010600290001",)


def test_behind_the_fence_there_is_no_sign_of_life_either() -> None:
    async def check(made: Rig) -> None:
        await elapse(3.0)
        before = len(made.writes())
        assert before > 5
        made.lift.driver.fence(now())
        await elapse(5.0)
        assert len(made.writes()) == before
        made.lift.driver.fence(math.inf)
        await elapse(3.0)
        assert len(made.writes()) > before + 5

    on_rig(check, f'{SIGNALS}commands: {{heartbeat: {{at: "holding:41", action: count, every_s: 0.5}}}}\n')


def test_each_pulse_of_a_hold_made_of_pulses_is_told() -> None:
    log = LogByHand()
    text = (
        f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:8", action: hold, max_hold_s: 30, repeat_pulse_s: 2, width_s: 0.5,'
        " on_link_loss: latches, confirm: {any_of: [effect], within_s: 2}}}\n"
    )

    async def check(made: Rig) -> None:
        await keep(made, 5.0)

    on_rig(check, text, log=log)
    words = [line.split()[0] for line in log.lines]
    assert words[:5] == ["press", "pause", "refresh", "pause", "refresh"]


def test_a_write_that_was_cut_short_is_told_as_that() -> None:
    log = LogByHand()

    async def check(made: Rig) -> None:
        made.device.delay_s = 0.3
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.05)
        assert log.told == []

    on_rig(check, PLAIN, log=log)
    assert log.told == [Written("hold_door.front", "press", ("01050008ff00",), "its answer was not awaited")]


def test_a_heartbeat_in_a_block_that_is_written_in_a_cycle_does_not_make_each_cycle_news() -> None:
    log = LogByHand()
    text = (
        f'{SIGNALS}commands:\n  heartbeat: {{at: "holding:41", action: count, every_s: 2}}\n'
        f'  hold_door.front: {{at: "holding:42", {HOLDING}}}\n'
        'write_blocks: [{at: "holding:41", count: 2, function: 16, every_s: 0.5}]\n'
    )

    async def check(made: Rig) -> None:
        await elapse(20.2)
        assert len(made.writes()) > 38

    on_rig(check, text, log=log)
    assert log.lines == ["beat heartbeat", "cycle"]
