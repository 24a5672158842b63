"""Before anything is pressed for a session, what a restart must know of it is handed to the disk."""

from asyncio import Future

import pytest

from lift_manager.core.journal import ShortJournal
from lift_manager.core.memory import ShortMemory
from lift_manager.domain.asking import Accepted, Ask, RobotWord
from lift_manager.domain.journal import Row
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import RobotDoor
from tests.support.spine import WORKSHOP, Spine, spine
from tests.support.virtual_time import elapse, run_virtual


class Witness(ShortJournal):
    """Looks at what is kept whenever something is about to be pressed."""

    def __init__(self, memory: ShortMemory) -> None:
        super().__init__()
        self.seen: list[tuple[str, str, KeptSession | None]] = []
        self._memory = memory

    def before(self, row: Row) -> Future[str | None]:
        command = str(row.data["command"])
        self.seen.append((command, row.caller, self._memory.recall("lift").session))
        return super().before(row)


MAPS = ("generic-registers", "generic-coils", "two-stop-agv", "adam-io", "seer-siemens-chengdu")


async def ride(lift: Spine) -> None:
    first, second = lift.task.options.floors[-1], lift.task.options.floors[0]
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
    memory = ShortMemory()
    witness = Witness(memory)

    async def main() -> None:
        async with spine(map_name, memory=memory, journal=witness, infer_occupancy=True) as lift:
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
    memory = ShortMemory()
    witness = Witness(memory)

    async def main() -> None:
        async with spine("seer-siemens-chengdu", memory=memory, journal=witness) as lift:
            floor = lift.task.options.floors[-1]
            lift.accept(floor)
            await lift.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == floor)
            ask = Ask("lift", WORKSHOP, lift.task.options.floors[0], hold_door=True, robot=RobotWord.IN_PLACE)
            assert lift.task.request(ask) == Accepted()
            await elapse(5.0)

    run_virtual(main)
    told = [kept for command, _, kept in witness.seen if command == "robot_in_place"]
    assert told
    assert all(kept is not None and kept.boarding.who == "aboard" for kept in told)
