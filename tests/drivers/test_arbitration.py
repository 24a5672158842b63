"""Two drivers at one controller that obeys the manager of the highest epoch, and one driver without a cluster."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire
from drivers.model import Command, CommandKind, CommandStep, LiftReading, Result
from lift_manager.lab.plant import simulated_lift
from register_maps import frames
from register_maps.arbitration import NO_CLAIM, Claim
from register_maps.words import Side, Table
from simulator.faults import Reboot
from simulator.registers import RegisterFace
from tests.drivers.caller import Caller
from tests.drivers.linked import now
from tests.drivers.rig import allowed, ended
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.spine import SimulatedDevice
from tests.support.virtual_time import elapse, run_virtual

MAPS = ("generic-registers-cluster", "generic-coils-cluster")
FLOORS = {"L1": 1, "L2": 2, "L3": 3}
HOLD = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
ROBOT_MODE = Command(CommandKind.ROBOT_MODE)
GO_L3 = Command(CommandKind.GO_TO, "L3")
NORTH, SOUTH = Claim(5, 1), Claim(6, 2)


@dataclass
class Controller:
    """The simulated lift, and every frame that came."""

    name: str
    face: RegisterFace = field(init=False)
    received: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.face = simulated_lift(compiled(self.name), FLOORS)
        self._device = SimulatedDevice(self.face)

    def wire(self) -> MemoryWire:
        return MemoryWire(self.answer)

    def answer(self, frame: bytes) -> list[tuple[float, bytes | None]]:
        self.received.append(frame)
        return self._device.answer(frame)

    @property
    def on(self) -> set[str]:
        """What the lift is commanded to do."""
        self.face.advance(now())
        return set(self.face.believed)

    @property
    def writes(self) -> list[frames.Request]:
        return [each for each in map(frames.parse_request, self.received) if each.is_write]


@dataclass
class Manager:
    """A driver with its caller, polled every 0.2 s."""

    lift: Caller
    claim: Claim | None
    reading: LiftReading | None = None
    notices: list[str] = field(default_factory=list)


@asynccontextmanager
async def manager(controller: Controller, claim: Claim | None, *, control: bool = True) -> AsyncIterator[Manager]:
    link = Link(controller.wire, LinkSettings(), name="plc")
    settings = LiftSettings(name="lift", floors=FLOORS, control=control)
    made = Manager(Caller(ModbusLift(compiled(controller.name), link, settings, claim=claim)), claim)

    async def poll() -> None:
        while True:
            try:
                made.reading = await made.lift.read()
            except DriverError:
                pass  # the counter was not seen to change yet
            else:
                made.notices += made.reading.notices
            await elapse(0.2)

    running: Sequence[asyncio.Future[None]] = [
        asyncio.ensure_future(job) for job in (link.run(), made.lift.run(), poll())
    ]
    await link.wait_up()
    await elapse(2.0)
    try:
        yield made
    finally:
        await ended(running)


async def holds(manager: Manager, *commands: Command, seconds: float = 2.0) -> None:
    """Want these for so long, as a session does."""
    for _ in range(round(seconds / 0.2)):
        for command in commands:
            manager.lift.hold(command, allowed)
        await elapse(0.2)


def on_each(check: Callable[[Controller], Coroutine[object, object, None]]) -> None:
    for name in MAPS:
        controller = Controller(name)
        run_virtual(lambda: check(controller))  # noqa: B023  it is called at once


def test_each_write_is_one_block_with_owner_and_epoch() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, SOUTH) as south:
            await holds(south, ROBOT_MODE, HOLD)
            south.lift.let_go(HOLD)
            await elapse(1.0)
        block, function, _ = compiled(controller.name).written[0]
        sent = {(each.function, each.address, each.count) for each in controller.writes}
        assert sent == {(function, block.start, block.count)}
        assert controller.face.read(block.table, block.start, block.count, now()).count(1) == 1  # robot mode
        assert shown(controller) == SOUTH

    on_each(check)


@each_row(
    ("name", "written"),
    [
        # owner 2, epoch high and low half, no call, no hold, robot mode, no close
        ("generic-registers-cluster", "10 0010 0007 0e 0002 0003 0005 0000 0000 0001 0000"),
        # coil 10 and owner bit 1, coil 12; epoch bits 0, 2, 16 and 17 at coils 19, 21, 35 and 36
        ("generic-coils-cluster", "0f 0000 0033 07 00 14 28 00 18 00 00"),
    ],
)
def test_owner_and_epoch_are_written_as_the_map_says(name: str, written: str) -> None:
    controller = Controller(name)

    async def check() -> None:
        async with manager(controller, Claim(0x30005, 2)) as south:
            await holds(south, ROBOT_MODE)

    run_virtual(check)
    assert controller.writes[0].body[5:] == bytes.fromhex(written)


def shown(controller: Controller) -> Claim:
    """Whom the controller says that it obeys."""
    codec = compiled(controller.name)
    image = {
        table: controller.face.read(Table(table), 0, spans[0].stop, now())
        for table, spans in codec.served.items()
        if spans[0].start == 0
    }
    epoch, owner = (codec.signals[name].extract(image) for name in ("epoch", "owner"))
    return Claim(epoch, owner)


def test_a_write_of_the_term_before_that_arrives_after_one_of_the_next_changes_nothing() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, NORTH) as north:
            await holds(north, ROBOT_MODE, HOLD)
            assert controller.on == {"robot_mode", "hold_door.front"}
            late = next(frame for frame in reversed(controller.received) if frames.parse_request(frame).is_write)
        async with manager(controller, SOUTH) as south:
            await holds(south, ROBOT_MODE)
            assert controller.on == {"robot_mode"}
            controller.answer(late)
            assert controller.on == {"robot_mode"}
            assert shown(controller) == SOUTH

    on_each(check)


def test_two_managers_at_once_are_never_both_obeyed_and_the_older_one_knows() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, NORTH) as north:
            await holds(north, ROBOT_MODE)
            async with manager(controller, SOUTH) as south:
                await holds(south, ROBOT_MODE, HOLD)
                outcome = north.lift.press(GO_L3, allowed)
                for _ in range(20):
                    await holds(south, ROBOT_MODE, HOLD, seconds=0.2)
                    north.lift.hold(ROBOT_MODE, allowed)
                    assert controller.on == {"robot_mode", "hold_door.front"}
                done = await outcome
                assert done.result is Result.REJECTED
                assert "obeys epoch 6 of machine 2, and ignores this manager" in done.reason
                assert len([text for text in north.notices if "cluster init --replace --epoch 6" in text]) == 1
                assert south.notices == []

    on_each(check)


def test_a_manager_that_only_watches_has_nothing_to_say_about_whom_the_controller_obeys() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, SOUTH) as south:
            await holds(south, ROBOT_MODE)
            async with manager(controller, NORTH, control=False) as watching:
                await holds(south, ROBOT_MODE)
                assert watching.notices == []
        assert shown(controller) == SOUTH

    on_each(check)


def test_a_hold_goes_on_without_a_gap_from_one_manager_to_the_next() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, NORTH) as north:
            await holds(north, ROBOT_MODE, HOLD, seconds=5.0)
        await elapse(3.0)  # a takeover
        async with manager(controller, SOUTH) as south:
            for _ in range(15):
                await holds(south, ROBOT_MODE, HOLD, seconds=0.2)
                assert controller.on == {"robot_mode", "hold_door.front"}
            assert shown(controller) == SOUTH

    on_each(check)


def test_the_controller_keeps_whom_it_obeys_over_a_restart() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, SOUTH) as south:
            await holds(south, ROBOT_MODE)
        controller.face.begin(Reboot(), now())
        await elapse(2.0)
        controller.face.end(Reboot(), now())
        async with manager(controller, NORTH) as north:
            await holds(north, ROBOT_MODE, HOLD)
            assert controller.on == set()
            assert shown(controller) == SOUTH

    on_each(check)


@each_row(("before", "claimed"), [(NO_CLAIM, Claim(1, 0)), (Claim(0x10002, 2), Claim(0x10002, 2))])
def test_a_manager_without_a_cluster_is_obeyed_whoever_was_before(before: Claim, claimed: Claim) -> None:
    async def check(controller: Controller) -> None:
        if before.epoch:
            async with manager(controller, before) as earlier:
                await holds(earlier, ROBOT_MODE)
        async with manager(controller, None) as alone:
            await holds(alone, ROBOT_MODE, HOLD)
            assert controller.on == {"robot_mode", "hold_door.front"}
            assert shown(controller) == claimed

    on_each(check)


def test_a_manager_without_a_cluster_is_ignored_as_soon_as_one_of_a_cluster_takes_the_lift() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, None) as alone:
            await holds(alone, ROBOT_MODE, HOLD)
            async with manager(controller, SOUTH) as south:
                await holds(south, ROBOT_MODE)
                for _ in range(10):
                    alone.lift.hold(HOLD, allowed)
                    await holds(south, ROBOT_MODE, seconds=0.2)
                    assert controller.on == {"robot_mode"}

    on_each(check)


def test_what_is_planned_and_written_down_has_the_claim_in_it() -> None:
    async def check(controller: Controller) -> None:
        async with manager(controller, SOUTH) as south:
            driver = south.lift.driver
            (press,) = driver.frames(HOLD)
            await holds(south, HOLD)
            first = controller.writes[0].body[4:].hex()
            assert press == first
            assert driver.plan([CommandStep(HOLD)])[0].frame == first

    on_each(check)
