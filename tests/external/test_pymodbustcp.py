"""pyModbusTCP's server, which nobody here wrote, plays the controller for the real driver over real sockets.

The test is the lift: it moves the registers by hand and looks at what the driver wrote into them.
"""

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from pyModbusTCP.server import DataBank, ModbusServer

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.wire import PymodbusWire
from drivers.model import Command, CommandKind, LiftValues, Outcome, Proof, Result
from register_maps.words import Door, Mode, Motion, Side
from tests.drivers.caller import Caller
from tests.support.programs import free_port
from tests.support.shipped_maps import compiled

POLL_S = 0.03
LOOK_S = 0.01

HOLD = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
CLOSE = Command(CommandKind.CLOSE_DOOR, side=Side.FRONT)
ROBOT = Command(CommandKind.ROBOT_MODE)


def go_to(floor: str) -> Command:
    return Command(CommandKind.GO_TO, floor)


def allowed() -> None:
    return None


async def until(true: Callable[[], bool], within_s: float = 60.0) -> float:
    """Wait for a condition; returns how long that took."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    async with asyncio.timeout(within_s):
        while not true():  # noqa: ASYNC110 - the server runs in threads of its own and sets no event
            await asyncio.sleep(LOOK_S)
    return loop.time() - began


@dataclass
class Bench:
    """The driver, and the controller whose registers are moved by hand."""

    bank: DataBank
    server: ModbusServer
    lift: Caller
    link: Link
    beats: bool
    """Whether holding register 0 counts."""
    values: LiftValues = field(default_factory=LiftValues)
    """What the last reading said."""
    errors: list[DriverError] = field(default_factory=list)
    """Of polls since the last good one."""

    def holding(self, first: int, count: int = 1) -> list[int]:
        return list(self.bank.get_holding_registers(first, count))

    def coils(self) -> list[bool]:
        return list(self.bank.get_coils(0, 4))

    def says(self, *words: int) -> None:
        """Set the registers from 1 on: floor, motion, door, mode, flags, destination, call accepted."""
        self.bank.set_holding_registers(1, words)

    def inputs(self, number: int) -> None:
        """Set the six discrete inputs from one number, as the value table of the source has it."""
        self.bank.set_discrete_inputs(0, [bool(number >> place & 1) for place in range(6)])

    async def reads(self, **expected: object) -> None:
        """Wait for a reading in which these fields have these values."""

        def as_expected() -> bool:
            return not self.errors and all(getattr(self.values, name) == value for name, value in expected.items())

        await until(as_expected)

    async def poll(self) -> None:
        for beat in itertools.count():
            if self.beats:
                self.bank.set_holding_registers(0, [beat & 0xFFFF])
            try:
                reading = await self.lift.read()
            except DriverError as error:
                self.errors.append(error)
            else:
                self.values = reading.values
                self.errors.clear()
            await asyncio.sleep(POLL_S)

    async def stop(self) -> None:
        await asyncio.to_thread(self.server.stop)

    async def start(self) -> None:
        self.server.start()
        await until(lambda: bool(self.server.is_run))


@asynccontextmanager
async def bench(map_name: str, floors: Mapping[str, int]) -> AsyncIterator[Bench]:
    bank = DataBank()
    server = ModbusServer("127.0.0.1", free_port(), no_block=True, data_bank=bank)
    link = Link(lambda: PymodbusWire("127.0.0.1", server.port), LinkSettings(), name="plc")
    codec = compiled(map_name)
    lift = Caller(ModbusLift(codec, link, LiftSettings(name="lift", floors=floors, control=True)))
    made = Bench(bank, server, lift, link, beats="alive" in codec.signals)
    await made.start()
    tasks = [asyncio.ensure_future(work) for work in (link.run(), lift.run(), made.poll())]
    try:
        yield made
    finally:
        await link.close()
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks, return_exceptions=True)
        await made.stop()


def on_bench(map_name: str, floors: Mapping[str, int], check: Callable[[Bench], Awaitable[None]]) -> None:
    async def main() -> None:
        async with bench(map_name, floors) as made:
            await check(made)

    asyncio.run(main())


def on_generic_registers(check: Callable[[Bench], Awaitable[None]]) -> None:
    async def settled(made: Bench) -> None:
        # floor -1, stopped, closed, normal, level and no fire
        made.says(0xFFFF, 1, 1, 1, 0b101, 0, 0)
        await made.reads(floor="B1")
        await check(made)

    on_bench("generic-registers", {"B1": -1, "L1": 1, "L2": 2}, settled)


def on_two_stop_agv(check: Callable[[Bench], Awaitable[None]]) -> None:
    async def settled(made: Bench) -> None:
        made.inputs(22)
        await made.reads(floor="4F", mode=Mode.ROBOT)
        await check(made)

    on_bench("two-stop-agv", {"4F": 0, "5F": 1}, settled)


async def confirmed(waiting: asyncio.Future[Outcome]) -> Proof:
    async with asyncio.timeout(60):
        outcome = await waiting
    assert outcome.result is Result.CONFIRMED, outcome.reason
    return outcome.proof


# -- whole rides


def test_a_whole_ride_on_generic_registers() -> None:
    async def check(made: Bench) -> None:
        lift = made.lift
        # robot mode: asked for, granted
        lift.hold(ROBOT, allowed)
        await until(lambda: made.holding(16, 4) == [0, 0, 1, 0])
        assert not lift.held(ROBOT)
        made.says(0xFFFF, 1, 1, 2, 0b111, 0, 0)
        await until(lambda: lift.held(ROBOT))

        # the call: pressed, shown as accepted, let go
        call = lift.press(go_to("L2"), allowed)
        await until(lambda: made.holding(16, 4) == [2, 0, 1, 0])
        made.says(0xFFFF, 2, 1, 2, 0b011, 2, 2)
        assert await confirmed(call) is Proof.LAMP
        await made.reads(floor="B1", motion=Motion.UP, destination="L2", call_accepted="L2")
        await until(lambda: made.holding(16, 4) == [0, 0, 1, 0])

        # under way, there, open
        made.says(1, 2, 1, 2, 0b011, 2, 2)
        await made.reads(floor="L1", motion=Motion.UP)
        made.says(2, 1, 2, 2, 0b111, 0, 0)
        await made.reads(floor="L2", motion=Motion.STOPPED, doors={Side.FRONT: Door.OPENING}, destination=None)
        made.says(2, 1, 3, 2, 0b111, 0, 0)
        await made.reads(doors={Side.FRONT: Door.OPEN})

        # the door is held, let go, closed
        lift.hold(HOLD, allowed)
        await until(lambda: lift.held(HOLD))
        assert made.holding(16, 4) == [0, 1, 1, 0]
        lift.let_go(HOLD)
        await until(lambda: made.holding(16, 4) == [0, 0, 1, 0])
        close = lift.press(CLOSE, allowed)
        await until(lambda: made.holding(16, 4) == [0, 0, 1, 1])
        made.says(2, 1, 4, 2, 0b111, 0, 0)
        assert await confirmed(close) is Proof.EFFECT

        # back to people; nothing of ours is left on
        async with asyncio.timeout(60):
            await lift.release_all()
        assert made.holding(16, 4) == [0, 0, 0, 0]
        assert made.holding(1, 7) == [2, 1, 4, 2, 0b111, 0, 0]

    on_generic_registers(check)


def test_a_whole_ride_on_two_stop_agv() -> None:
    async def check(made: Bench) -> None:
        lift = made.lift
        made.inputs(21)
        await made.reads(floor="4F", doors={Side.FRONT: Door.OPEN})
        # the call is a level: the coil stays on while the car travels
        call = lift.press(go_to("5F"), allowed)
        await until(lambda: made.coils() == [False, True, False, False])
        made.inputs(18)
        assert await confirmed(call) is Proof.EFFECT
        await made.reads(floor=None, doors={Side.FRONT: Door.CLOSED})
        assert made.coils() == [False, True, False, False]
        made.inputs(24)
        await made.reads(floor="5F", doors={Side.FRONT: Door.MOVING})
        made.inputs(25)
        await made.reads(floor="5F", doors={Side.FRONT: Door.OPEN})

        # holding the door takes the call's place: never two of the four coils
        lift.hold(HOLD, allowed)
        await until(lambda: lift.held(HOLD))
        assert made.coils() == [False, False, True, False]
        lift.let_go(HOLD)
        await until(lambda: not any(made.coils()))

        close = lift.press(CLOSE, allowed)
        await until(lambda: made.coils() == [False, False, False, True])
        made.inputs(26)
        assert await confirmed(close) is Proof.EFFECT

        # and back, which lets the close button go first
        call = lift.press(go_to("4F"), allowed)
        await until(lambda: made.coils() == [True, False, False, False])
        made.inputs(22)
        assert await confirmed(call) is Proof.EFFECT
        async with asyncio.timeout(60):
            await lift.release_all()
        assert not any(made.coils())

    on_two_stop_agv(check)


# -- what the controller does not allow, or does not do


def test_without_agv_mode_no_coil_is_touched() -> None:
    async def check(made: Bench) -> None:
        made.inputs(22 - 16)
        await made.reads(mode=Mode.NORMAL)
        outcome = await made.lift.press(go_to("5F"), allowed)
        assert outcome.result is Result.REJECTED
        assert "robot_mode_on" in outcome.reason
        assert not any(made.coils())

    on_two_stop_agv(check)


def test_outputs_that_somebody_left_on_are_cleared_before_anything_else() -> None:
    async def check(made: Bench) -> None:
        await made.stop()
        await until(lambda: bool(made.errors))
        made.bank.set_holding_registers(16, [2, 1, 1, 1])
        await made.start()
        await until(lambda: made.holding(16, 4) == [0, 0, 0, 0])
        await made.reads(floor="B1")

    on_generic_registers(check)


# -- the controller goes away and comes back


def test_a_server_that_stops_and_starts_again_is_read_without_help() -> None:
    async def check(made: Bench) -> None:
        before = made.link.epoch
        await made.stop()
        await until(lambda: len(made.errors) > 3)
        made.says(1, 1, 3, 1, 0b101, 0, 0)
        await made.start()
        await until(lambda: not made.errors)
        await made.reads(floor="L1", doors={Side.FRONT: Door.OPEN})
        assert made.link.epoch > before

    on_generic_registers(check)


def test_a_hold_survives_the_outage_and_the_coils_still_say_so() -> None:
    async def check(made: Bench) -> None:
        made.inputs(21)
        await made.reads(doors={Side.FRONT: Door.OPEN})
        made.lift.hold(HOLD, allowed)
        await until(lambda: made.lift.held(HOLD))
        await made.stop()
        await until(lambda: bool(made.errors))
        await made.start()
        await until(lambda: not made.errors and made.lift.held(HOLD))
        assert made.coils() == [False, False, True, False]
        made.lift.let_go(HOLD)
        await until(lambda: not any(made.coils()))

    on_two_stop_agv(check)
