"""Before anything is pressed for a session, what a restart must know of it is handed to the disk."""

from asyncio import Future

import pytest

from lift_manager.lift.journal import Row
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.record import SavedSession
from lift_manager.runtime.recorder import MemoryRecorder
from tests.support.session_calls import saved
from tests.support.spine import WORKSHOP, Spine, spine
from tests.support.virtual_time import elapse, run_virtual


class Witness(MemoryRecorder):
    """Looks at what is kept whenever something is about to be pressed."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, str, SavedSession | None]] = []

    def commit_now(self, row: Row) -> Future[str | None]:
        command = str(row.data["command"])
        self.seen.append((command, row.caller, saved(self).session))
        return super().commit_now(row)


MAPS = ("generic-registers", "generic-coils", "two-stop-agv", "adam-io", "seer-siemens-chengdu")


async def ride(lift: Spine) -> None:
    second, first, *_ = lift.actor.config.floors
    for floor in (first, second):
        await elapse(6.0)  # a robot boards
        lift.accept(floor)
        for _ in range(120):
            await elapse(0.5)
            if lift.state.robot_door is RobotDoor.OPEN and lift.state.floor == floor:
                break
            lift.accept(floor)
        else:
            pytest.fail(f"never open at {floor}: {lift.state}")


@pytest.mark.parametrize("map_name", MAPS)
def test_a_session_is_kept_with_its_holder_floor_and_call_before_anything_is_pressed_for_it(map_name: str) -> None:
    witness = Witness()

    async def main() -> None:
        async with spine(map_name, recorder=witness, infer_occupancy=True) as lift:
            await ride(lift)

    run_virtual(main)
    assert witness.seen
    for command, caller, kept in witness.seen:
        assert kept is not None, command
        assert kept.holder == WORKSHOP
        assert caller == "workshop", command
        if command.partition(".")[0] in ("go_to", "call", "go"):
            assert kept.pressed, command
        if command.startswith("hold_door"):
            assert kept.holding_since is not None, command


def test_the_lift_is_told_of_a_robot_in_place_only_once_that_is_kept() -> None:
    witness = Witness()

    async def main() -> None:
        async with spine("seer-siemens-chengdu", recorder=witness) as lift:
            floor = lift.actor.config.floors[1]
            lift.accept(floor)
            await lift.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == floor)
            lift.accept(lift.actor.config.floors[0], RobotWord.IN_PLACE)
            await elapse(5.0)

    run_virtual(main)
    told = [kept for command, _, kept in witness.seen if command == "robot_in_place"]
    assert told
    assert all(kept is not None and kept.boarding.occupancy == "aboard" for kept in told)
