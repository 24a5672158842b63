"""Our driver and the generated program together, on virtual time: what is wanted reaches the lift's buttons, and what
is not wanted any more leaves them. The Modbus server between them is written by hand, byte by byte.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from drivers.errors import HeartbeatAwaited
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from drivers.model import Command, CommandKind, Proof, Result
from register_maps.words import Door, Mode, Side
from tests.drivers.caller import Caller
from tests.lift_manager.commissioning.plc.rig import CYCLE_S, LAYOUTS, Layout, Rig
from tests.support.virtual_time import elapse, run_virtual

each_map = pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.map_name)
POLL_S = 0.1
ARRAYS = {
    1: "Coils",
    2: "DiscreteInputs",
    3: "HoldingRegisters",
    5: "Coils",
    6: "HoldingRegisters",
    15: "Coils",
    16: "HoldingRegisters",
}


class Bench:
    """A PLC with its Modbus server; `deaf` is a pulled network cable."""

    def __init__(self, layout: Layout) -> None:
        self.rig = Rig(layout)
        self.deaf = False

    def answer(self, frame: bytes) -> list[Reply]:
        if self.deaf:
            return []
        unit, function, first = frame[6], frame[7], int.from_bytes(frame[8:10], "big")
        array = self.rig.machine.values[ARRAYS[function]]
        count = int.from_bytes(frame[10:12], "big")
        body = bytes([function]) + frame[8:12]
        match function:
            case 1 | 2:
                bits = sum(bool(array[first + offset]) << offset for offset in range(count))
                data = bits.to_bytes((count + 7) // 8, "little")
                body = bytes([function, len(data)]) + data
            case 3:
                data = b"".join(array[first + offset].to_bytes(2, "big") for offset in range(count))
                body = bytes([function, len(data)]) + data
            case 5:
                array[first] = frame[10] == 0xFF
            case 6:
                array[first] = count
            case 16:
                array.update(
                    {
                        first + place: int.from_bytes(frame[13 + 2 * place : 15 + 2 * place], "big")
                        for place in range(count)
                    }
                )
            case _:
                assert function == 15
                bits = int.from_bytes(frame[13:], "little")
                array.update({first + offset: bool(bits >> offset & 1) for offset in range(count)})
        return [(0.01, frame[:4] + (len(body) + 1).to_bytes(2, "big") + bytes([unit]) + body)]

    async def run(self) -> None:
        while True:
            await elapse(CYCLE_S)
            self.rig.now = asyncio.get_running_loop().time()
            self.rig.cycle()


async def first_beat(lift: Caller) -> None:
    """Wait until the alive counter of the program, where it has one, was seen to change."""
    while True:
        try:
            await lift.read()
        except HeartbeatAwaited:
            await elapse(POLL_S)
        else:
            return


@asynccontextmanager
async def driven(bench: Bench) -> AsyncIterator[Caller]:
    link = Link(lambda: MemoryWire(bench.answer), LinkSettings(), name="plc")
    settings = LiftSettings(name="lift", floors=dict(bench.rig.layout.floors), control=True)
    lift = Caller(ModbusLift(bench.rig.codec, link, settings))
    tasks = [asyncio.ensure_future(job) for job in (bench.run(), link.run(), lift.run())]
    await link.wait_up()
    await first_beat(lift)
    try:
        yield lift
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def allowed() -> None:
    return None


ROBOT_MODE = Command(CommandKind.ROBOT_MODE)
HOLD_DOOR = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)


async def wanted(lift: Caller, seconds: float, *holds: Command) -> None:
    """Poll so long, and want these holds all the time, as a session does."""
    end = asyncio.get_running_loop().time() + seconds
    while asyncio.get_running_loop().time() < end - POLL_S / 2:
        for hold in holds:
            lift.hold(hold, allowed)
        await lift.read()
        await elapse(POLL_S)


@each_map
def test_a_session_holds_robot_mode_and_the_door_for_more_than_a_minute_without_a_gap(layout: Layout) -> None:
    bench = Bench(layout)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 5.0, ROBOT_MODE)
            assert (await lift.read()).values.mode is Mode.ROBOT
            await wanted(lift, 70.0, ROBOT_MODE, HOLD_DOOR)
            assert lift.held(ROBOT_MODE)
            assert lift.held(HOLD_DOOR)
            assert len(bench.rig.pressed["RobotMode"]) == 1
            assert len(bench.rig.pressed["DoorOpenButton"]) == 1
            assert bench.rig.released == {}

            lift.let_go(HOLD_DOOR)
            await wanted(lift, 0.3, ROBOT_MODE)
            assert not bench.rig.on("DoorOpenButton")
            lift.let_go(ROBOT_MODE)
            await wanted(lift, 3.5)
            assert bench.rig.outputs_on() == []
            assert (await lift.read()).values.mode is Mode.NORMAL

    run_virtual(main)


@each_map
def test_a_call_is_one_press_and_its_lamp_confirms_it(layout: Layout) -> None:
    bench = Bench(layout)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 2.0, ROBOT_MODE)
            outcome = lift.press(Command(CommandKind.GO_TO, "L2"), allowed)
            await wanted(lift, 0.3, ROBOT_MODE)
            assert bench.rig.on("CallButton3")
            bench.rig.contacts(CallLamp3=True)
            await wanted(lift, 3.0, ROBOT_MODE)
            done = await outcome
            assert (done.result, done.proof) == (Result.CONFIRMED, Proof.LAMP)
            assert len(bench.rig.pressed["CallButton3"]) == 1

    run_virtual(main)


@each_map
def test_the_close_button_is_pressed_once_and_the_door_confirms_it(layout: Layout) -> None:
    bench = Bench(layout)
    bench.rig.contacts(DoorOpenLimit=True)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 2.0, ROBOT_MODE)
            outcome = lift.press(Command(CommandKind.CLOSE_DOOR, side=Side.FRONT), allowed)
            await wanted(lift, 0.5, ROBOT_MODE)
            bench.rig.contacts(DoorOpenLimit=False)
            await wanted(lift, 2.0, ROBOT_MODE)
            bench.rig.contacts(DoorClosedLimit=True)
            await wanted(lift, 1.0, ROBOT_MODE)
            assert (await outcome).result is Result.CONFIRMED
            assert (await lift.read()).values.doors[Side.FRONT] is Door.CLOSED
            assert len(bench.rig.pressed["DoorCloseButton"]) == 1

    run_virtual(main)


@each_map
def test_when_the_cable_is_pulled_everything_falls_some_seconds_after_the_last_write(layout: Layout) -> None:
    bench = Bench(layout)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 10.0, ROBOT_MODE, HOLD_DOOR)
            assert bench.rig.outputs_on() == ["DoorOpenButton", "RobotMode"]
            bench.deaf = True
            pulled = asyncio.get_running_loop().time()
            await elapse(10.0)
            assert bench.rig.outputs_on() == []
            for fell in (*bench.rig.released["RobotMode"], *bench.rig.released["DoorOpenButton"]):
                assert layout.falls_s - 1.1 <= fell - pulled <= layout.falls_s + 0.2
            assert set(bench.rig.cells()) == {layout.rest}

    run_virtual(main)


@each_map
def test_a_fire_takes_the_hold_from_the_manager_and_is_told(layout: Layout) -> None:
    bench = Bench(layout)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 5.0, ROBOT_MODE, HOLD_DOOR)
            bench.rig.contacts(NoFire=False)
            await elapse(2 * CYCLE_S)
            assert bench.rig.outputs_on() == []
            await wanted(lift, 2.0, ROBOT_MODE, HOLD_DOOR)
            values = (await lift.read()).values
            assert values.mode is Mode.FIRE
            assert values.flags["fire"]
            assert bench.rig.outputs_on() == []

    run_virtual(main)


@each_map
def test_what_an_earlier_manager_left_standing_presses_nothing_when_the_next_one_comes(layout: Layout) -> None:
    bench = Bench(layout)
    bench.rig.call("L2")
    bench.rig.write(layout.hold, layout.on)

    async def main() -> None:
        async with driven(bench) as lift:
            await wanted(lift, 5.0, ROBOT_MODE)
            assert bench.rig.outputs_on() == ["RobotMode"]
            assert bench.rig.pressed.keys() == {"RobotMode"}

    run_virtual(main)
