"""While what is done cannot be written down nothing is pressed, and everything else goes on."""

import logging
from itertools import cycle

import pytest

from lift_manager.lift.journal import RowKind
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.state import Quality
from lift_manager.runtime.recorder import MemoryRecorder
from tests.support.spine import WORKSHOP, Spine, spine
from tests.support.virtual_time import elapse, run_virtual

FULL = "the journal has no space: the disk is full"


def opened(floor: str, lift: Spine) -> bool:
    return lift.state.robot_door is RobotDoor.OPEN and lift.state.floor == floor


def test_a_request_is_refused_with_the_reason_and_taken_again_when_there_is_room() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            journal.trouble = FULL
            refused = lift.refuse("L2")
            assert refused.code is Refusal.NOT_RECORDED
            assert FULL in refused.message
            assert lift.state.quality is Quality.LIVE
            await elapse(5.0)
            assert not lift.presses()
            journal.trouble = ""
            lift.accept("L2")
            await lift.until(lambda _: opened("L2", lift))

    run_virtual(main)


def test_a_held_door_is_let_go_and_its_session_ends_whatever_the_disk_does() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            lift.accept("L2")
            await lift.until(lambda _: opened("L2", lift))
            journal.trouble = FULL
            await elapse(30.0)
            assert opened("L2", lift), "a hold that is on is renewed"
            lift.accept("L2", hold=False)
            await elapse(1.0)
            assert lift.state.holder is None
            assert "hold_door.front" not in lift.face.commands

    run_virtual(main)


def test_a_robot_that_has_begun_keeps_its_session_and_its_next_press_is_told_as_rejected() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            lift.accept("L2")
            await lift.until(lambda _: opened("L2", lift))
            pressed = len(lift.presses())
            journal.trouble = FULL
            lift.accept("L3")
            await elapse(3.0)
            assert lift.state.holder == WORKSHOP
            assert len(lift.presses()) == pressed
            rejected = [row for row in journal.rows if row.kind is RowKind.OUTCOME and row.data["result"] == "rejected"]
            assert any(FULL in row.text for row in rejected)
            journal.trouble = ""
            for _ in range(60):
                lift.accept("L3")
                await elapse(1.0)
            assert opened("L3", lift), "its next request presses again"

    run_virtual(main)


def test_a_holder_that_asks_for_another_floor_sees_what_it_waits_for_and_the_log_says_it_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal, poll_s=0.2) as lift:
            lift.accept("L2")
            await lift.until(lambda _: opened("L2", lift))
            journal.trouble = FULL
            assert lift.state.restrictions.waiting_for == "", "it has what it asked for"
            caplog.clear()
            for floor in cycle(["L1", "L3"]):
                lift.accept(floor)
                await elapse(0.1)
                assert lift.state.restrictions.waiting_for == f"the disk: {FULL}"
                if len(journal.rows) > 20:
                    break
            rejected = [record for record in caplog.records if "rejected" in record.getMessage()]
            assert len([record for record in rejected if record.levelno >= logging.INFO]) == 1
            journal.trouble = ""
            await elapse(5.0)
            lift.accept("L3")
            await elapse(1.0)
            assert lift.state.restrictions.waiting_for == ""

    caplog.set_level(logging.INFO)
    run_virtual(main)
