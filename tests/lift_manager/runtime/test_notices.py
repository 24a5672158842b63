"""What the driver notices reaches people, and whoever holds the lift."""

import asyncio

import pytest

from lift_manager.lift.events import Alarm
from register_maps.words import Table
from tests.support.spine import WORKSHOP, Spine, on_spine
from tests.support.virtual_time import elapse

CLOSE = 19
"""The close button of generic-registers."""
END = Alarm("lift", "that was all")
"""What the test puts behind everything that was told."""


async def alarms(made: Spine) -> list[Alarm]:
    """Let somebody else press the close button for half a minute; return what is told of it."""
    heard: list[Alarm] = []
    with made.bus.listen(10_000) as listener:
        for _ in range(60):
            made.face.write(Table.HOLDING, CLOSE, (1,), asyncio.get_running_loop().time())
            await elapse(0.5)
        listener.put(END)
        while (event := await listener.next()) != END:
            heard += [event] if isinstance(event, Alarm) else []
    return [alarm for alarm in heard if "close_door" in alarm.text]


TEXT = (
    "somebody else writes close_door.front at holding:19: it reads 1, we wrote 0; it is released, once in 60 s at most"
)


def test_a_foreign_writer_is_one_alarm() -> None:
    async def check(made: Spine) -> None:
        assert await alarms(made) == [Alarm("lift", TEXT, None)]

    on_spine(check)


def test_the_session_that_holds_the_lift_is_named_in_it() -> None:
    async def check(made: Spine) -> None:
        made.accept("L3")
        assert await alarms(made) == [Alarm("lift", TEXT, WORKSHOP)]

    on_spine(check)


async def stands_at(made: Spine, floor: str) -> None:
    await made.until(lambda state: state.standing and state.floor == floor)


@pytest.mark.parametrize(
    "name",
    [
        "generic-registers",
        "generic-coils",
        "two-stop-agv",
        "seer-generic",
        "seer-siemens-chengdu-block",
        "robotnik-il-eth",
    ],
)
def test_our_own_rides_raise_none(name: str) -> None:
    async def check(made: Spine) -> None:
        with made.bus.listen(10_000) as listener:
            for floor in reversed(made.actor.config.floors[:3]):
                made.accept(floor)
                await stands_at(made, floor)
                await elapse(9)  # its door opens where it can be seen, and the robot boards
            made.accept(floor, hold=False)
            await elapse(5)
            listener.put(END)
            while (event := await listener.next()) != END:
                assert not (isinstance(event, Alarm) and "somebody else" in event.text), event

    on_spine(check, name, infer_occupancy=True)
