"""A press waits until it is written down, and nothing else does."""

import asyncio
import logging
from asyncio import Future
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from drivers.model import Command, CommandKind
from lift_manager.lift.commands import CommandState, CommandType
from lift_manager.lift.events import CommandEnded
from lift_manager.lift.journal import RowKind
from lift_manager.lift.observation import RobotDoor
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode, Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.rig import CLOSE_FRONT, HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.scripted import PLAIN, Bench, SlowRecorder, on_bench
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import elapse

HOLD_CELL, MODE_CELL = 17, 18
ROBOT_MODE = Command(CommandKind.ROBOT_MODE)


@pytest.mark.parametrize("map_name", ["generic-registers", "generic-coils", "adam-io", "seer-siemens-chengdu"])
def test_the_row_of_a_press_has_the_frames_that_leave(map_name: str) -> None:
    recorder = MemoryRecorder()

    async def check(made: Spine) -> None:
        floor = made.actor.config.floors[-1]
        made.accept(floor)
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == floor)

    on_spine(check, map_name, recorder=recorder)
    written = [row for row in recorder.rows if row.kind is RowKind.WRITE and row.data["what"] == "press"]
    planned = {row.data["command"]: row.data["frames"] for row in recorder.rows if row.kind is RowKind.PRESS}
    assert written
    for row in written:
        assert row.data["frames"] == planned[row.data["command"]]


def test_what_is_planned_leaves_out_what_will_be_released_for_it() -> None:
    log = LogByHand()
    text = (
        f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {HOLD}, excludes: [close_door.front], gap_s: 0.1}}\n'
        '  close_door.front: {at: "coil:9", action: hold, max_hold_s: 10, until: closed, on_link_loss: latches,'
        " confirm: {any_of: [readback], within_s: 2}}\n"
        f'  robot_mode: {{at: "coil:10", {HOLD}}}\nwrite_blocks: [{{at: "coil:8", count: 3, function: 15}}]\n'
    )

    async def check(made: Rig) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        await elapse(0.2)
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.hold(ROBOT_MODE, allowed)
        await elapse(0.3)
        _ = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(1.0)
        pressed = [each.frames for each in log.told if (each.what, each.name) == ("press", "close_door.front")]
        assert [log.rows[-1][1]] == pressed == [("010f000800030106",)]

    on_rig(check, text, log=log)


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (lambda answer: answer.set_result("the disk is full"), "not recorded: the disk is full"),
        (lambda answer: answer.cancel(), "not recorded: the journal has ended"),
        (lambda answer: answer.set_exception(OSError("no such device")), "not recorded: no such device"),
    ],
    ids=["full", "ended", "a bug"],
)
def test_a_journal_that_refuses_ends_or_breaks_refuses_the_press(
    end: Callable[[Future[str | None]], object], reason: str
) -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        end(disk.waiting.pop())
        await elapse(5)
        (ended,) = only(await heard(made.heard), CommandEnded)
        assert (str(ended.outcome.result), ended.outcome.reason) == ("rejected", reason)
        assert made.driver.log == []

    on_bench(check, PLAIN, recorder=disk)


def test_the_driver_has_a_press_in_the_turn_of_the_loop_in_which_the_store_answers() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        disk.waiting.pop().set_result(None)
        await asyncio.sleep(0)
        assert made.driver.on == {"go_to"}

    on_bench(check, PLAIN, recorder=disk)


def test_releases_and_refreshes_do_not_wait_while_a_row_is_awaited() -> None:
    disk = SlowRecorder()

    async def check(made: Spine) -> None:
        made.accept("L2")
        while made.state.robot_door is not RobotDoor.OPEN:
            await disk.commit()
        begun, now = len(made.device.writes), asyncio.get_running_loop().time()
        made.accept("L3")
        await elapse(3.0)
        written = [(request.address, request.values[0], at - now) for at, request in made.device.writes[begun:]]
        assert written[0][:2] == (HOLD_CELL, 0)
        assert written[0][2] < 0.1
        assert [(address, value) for address, value, _ in written[1:]] == [(MODE_CELL, 1)] * 3
        await disk.commit()
        assert made.presses()[-1][1] == 3

    on_spine(check, recorder=disk)


def test_stopping_drops_what_waits() -> None:
    disk = SlowRecorder()

    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.life.stop()
        await disk.commit()
        await elapse(2.0)
        assert made.device.writes == []

    on_spine(check, recorder=disk)


async def fire(made: Bench) -> None:
    await made.mode(Mode.FIRE)


async def inspection(made: Bench) -> None:
    await made.mode(Mode.INSPECTION)


async def lockout(made: Bench) -> None:
    made.site.lock_out("lift", "M. Weber", "new ropes")


async def closed(made: Bench) -> None:
    made.accept("L2", hold=False)


@pytest.mark.parametrize("happens", [fire, inspection, lockout, closed])
@pytest.mark.parametrize("floor", ["L2", "L3"])
def test_what_waited_is_judged_when_it_would_leave(happens: Callable[[Bench], Awaitable[None]], floor: str) -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept(floor)
        assert len(disk.waiting) == 1
        await happens(made)
        await disk.commit()
        await elapse(2)
        assert made.driver.log == []

    on_bench(check, PLAIN, recorder=disk)


def test_a_close_that_waits_for_its_row_is_not_pressed_once_the_door_is_to_be_held() -> None:
    disk = SlowRecorder()
    closing = replace(PLAIN, commands=PLAIN.commands | {"close_door.front"})

    async def check(made: Bench) -> None:
        session = made.opened()
        assert made.taken(session, CommandType.GO_TO, "L2", hold=False).state is CommandState.CONFIRMED
        await made.car("L2", Door.OPEN)
        close = made.taken(session, CommandType.CLOSE_DOOR)
        await elapse(0.5)
        assert made.press_rows == ["close_door.front is to be pressed"]
        made.taken(session, CommandType.HOLD_DOOR)
        await disk.commit()
        await elapse(1)
        assert made.now(session, close).reason == "another request took its place"
        assert made.driver.log == ["hold hold_door.front"]

    on_bench(check, closing, recorder=disk)


# -- holds


def test_a_hold_has_one_row_however_often_it_is_renewed_and_another_one_each_time_it_begins() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(20)
        assert made.driver.renewed["hold_door.front"] > 19
        assert made.press_rows == ["hold_door.front is to be pressed"]
        made.accept("L2", hold=False)
        made.accept("L2")
        await elapse(1)
        assert made.press_rows == ["hold_door.front is to be pressed"] * 2

    on_bench(check, replace(PLAIN, max_hold_s={"hold_door.front": 5.0}))


def test_a_hold_that_cannot_be_written_down_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L2")
        disk.trouble = "the disk is full"
        await disk.commit("the disk is full")
        await elapse(30)

    on_bench(check, PLAIN, recorder=disk)
    warnings = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert warnings == ["lift: hold_door.front is not asserted: the disk is full"]
