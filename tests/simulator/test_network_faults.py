"""Devices that leave their network: in memory, and behind a server over real sockets."""

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest
import uvloop
from pymodbus.client import AsyncModbusTcpClient

from register_maps.words import Motion, Table
from simulator.controller import Inputs, Parameters
from simulator.faults import (
    Fault,
    ForeignWriter,
    FrozenRegisters,
    Homing,
    IgnoredWrites,
    LostPress,
    PowerLoss,
    Reboot,
    SlotKept,
    Stopped,
)
from simulator.modes import Key
from simulator.registers import NoReply
from simulator.server import ClientLimits, Device, SimulatedController
from tests.simulator.faces import Faced, faced, is_closed, is_open, stands_open_at
from tests.support.rows import each_row
from tests.support.written_maps import HEAD, written_map

COIL, DISCRETE, HOLDING = Table.COIL, Table.DISCRETE, Table.HOLDING
HOST = "127.0.0.1"
WITHIN_S = 60.0
READ = "01 03 00 01 00 01"
IDLE_S = 1.0
"""The floor of generic-registers."""
ALIVE, FLOOR = 0, 1
GO_TO, HOLD, ROBOT = 16, 17, 18
SENSOR = """\
signals:
  car_floor: {one_of: ["sensor/discrete:0", "sensor/discrete:1"]}
  door.front: {at: "sensor/discrete:2"}
commands:
  go_to: {one_of: ["coil:0", "coil:1"], action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}
"""
SENSOR_HEAD = HEAD.replace(
    "at_floor_evidence", "endpoints: {sensor: {unit_id: 9, served: {discrete: [[0, 3]]}}}\nat_floor_evidence"
)


def generic(*, start: int = 0, key: Key = Key.ROBOT, like: Parameters | None = None) -> Faced:
    return faced("generic-registers", (1, 2, 3, 4), start=start, key=key, like=like)


def begun(lift: Faced, fault: Fault) -> Faced:
    lift.face.begin(fault, lift.now)
    return lift


def ended(lift: Faced, fault: Fault) -> Faced:
    lift.face.end(fault, lift.now)
    return lift


def moving(lift: Faced) -> Faced:
    """The highest floor is called, and the car is at full speed."""
    lift.write(HOLDING, GO_TO, 4)
    lift.until(lambda picture: picture.speed_m_s == 1.0)
    lift.write(HOLDING, GO_TO, 0)
    return lift


# -- in memory


@pytest.mark.parametrize("fault", [Reboot(), PowerLoss(), PowerLoss(outputs_held=True)])
def test_a_device_that_is_off_answers_to_nothing_and_admits_nobody(fault: Fault) -> None:
    lift = faced(written_map(SENSOR, SENSOR_HEAD), (0, 1))
    assert lift.face.on_network
    assert lift.face.admits(lift.now)
    begun(lift, fault)
    asked: list[Callable[[], object]] = [
        lambda: lift.read(COIL, 0),
        lambda: lift.write(COIL, 0, 1),
        lambda: lift.pulse(0, 5),
        lambda: lift.face.stored(COIL, 0, lift.now),
        lambda: lift.mask(0, 0xFFFF, 0),
        lambda: lift.read(DISCRETE, 0, of="sensor"),
    ]
    for ask in asked:
        with pytest.raises(NoReply):
            ask()
    for device in (lift.face, lift.face.endpoint("sensor")):
        assert not device.on_network
        assert not device.admits(lift.now)
    ended(lift, fault)
    assert lift.read(DISCRETE, 0, 3, of="sensor") == [1, 0, 0]
    assert lift.face.admits(lift.now)


def test_whoever_watches_a_lift_hears_of_the_faults_of_its_network_only() -> None:
    lift = generic()
    heard: list[bool] = []
    lift.face.watch(lambda: heard.append(lift.face.on_network))
    for fault in (FrozenRegisters(), PowerLoss(), SlotKept()):
        ended(begun(lift, fault), fault)
    assert heard == [False, True, True, True]


def test_a_lift_goes_on_while_its_communication_module_is_without_power() -> None:
    lift = begun(moving(generic()), PowerLoss())
    assert lift.until(stands_open_at(3)).level_floor == 3


@pytest.mark.parametrize("held", [True, False])
def test_outputs_are_held_or_at_rest_while_a_module_has_no_power_and_after(*, held: bool) -> None:
    lift = faced("seer-generic", (1, 2))
    lift.write(HOLDING, 1, 5)  # the door, which nothing watches
    lift.after(5)
    begun(lift, PowerLoss(outputs_held=held))
    assert is_open(lift.after(30)) is held
    ended(lift, PowerLoss(outputs_held=held))
    assert lift.read(HOLDING, 1) == [5 if held else 0]
    assert is_open(lift.after(30)) is held


def test_the_watchdog_of_the_lift_lets_go_of_held_outputs_while_nobody_can_write() -> None:
    lift = generic()
    lift.write(HOLDING, HOLD, 1)
    begun(lift, PowerLoss(outputs_held=True))
    assert is_closed(lift.after(12))


def test_a_timed_relay_without_power_falls_and_stays_so() -> None:
    lift = faced("waveshare-relay", (0, 1))
    lift.pulse(0x201, 100)
    lift.after(1)
    ended(begun(lift, PowerLoss()), PowerLoss())
    assert lift.read(COIL, 0x201) == [0]


def test_a_car_brakes_and_stands_while_its_controller_restarts() -> None:
    lift = begun(moving(generic()), Reboot())
    stood = lift.after(1.25)
    assert stood.motion is Motion.STOPPED
    assert stood.level_floor is None
    assert lift.after(20) == stood


def test_doors_stay_as_they_are_while_a_controller_restarts_and_close_afterwards() -> None:
    lift = generic()
    lift.write(HOLDING, HOLD, 1)
    lift.after(1)
    before = lift.face.picture.doors
    begun(lift, Reboot())
    assert lift.after(20).doors == before
    ended(lift, Reboot())
    assert lift.read(HOLDING, HOLD) == [0], "outputs are forgotten"
    assert is_closed(lift.after(2))


def test_a_restarted_controller_has_forgotten_its_calls_and_counts_from_zero() -> None:
    lift = generic()
    lift.write(HOLDING, GO_TO, 4)
    assert lift.after(1).car_calls == {3}
    begun(lift, Reboot(homes=False))
    lift.after(10)
    ended(lift, Reboot(homes=False))
    assert lift.read(HOLDING, ALIVE) == [0]
    assert lift.read(HOLDING, GO_TO) == [0]
    assert lift.face.picture.car_calls == frozenset()
    lift.after(3)
    assert lift.read(HOLDING, ALIVE) == [6]


def test_a_restarted_car_drives_home_and_takes_no_call_before() -> None:
    lift = begun(moving(generic()), Reboot())
    lift.after(10)
    ended(lift, Reboot())
    lift.write(HOLDING, GO_TO, 4)
    assert lift.after(0.5).motion is Motion.DOWN
    assert lift.face.picture.car_calls == frozenset()
    assert lift.until(lambda picture: picture.level_floor is not None).level_floor == 0
    lift.write(HOLDING, GO_TO, 0)
    lift.write(HOLDING, GO_TO, 4, after_s=1)
    assert lift.after(0.5).destination == 3


def test_a_car_that_has_come_home_after_a_restart_can_be_sent_home_again() -> None:
    lift = ended(begun(generic(start=3), Reboot()), Reboot())
    lift.after(60)
    lift.write(HOLDING, GO_TO, 3)
    assert lift.until(stands_open_at(2)).floor_known
    begun(lift, Homing())
    assert not lift.until(lambda picture: picture.motion is Motion.DOWN).floor_known
    assert lift.until(lambda picture: picture.level_floor is not None).level_floor == 0


def test_a_car_that_stands_at_its_lowest_floor_is_home() -> None:
    lift = ended(begun(generic(), Reboot()), Reboot())
    lift.write(HOLDING, GO_TO, 4)
    assert lift.after(0.5).destination == 3


def test_a_controller_may_know_its_floor_after_a_restart() -> None:
    lift = ended(begun(generic(start=2), Reboot(homes=False)), Reboot(homes=False))
    lift.write(HOLDING, GO_TO, 4)
    assert lift.after(0.5).destination == 3


def test_a_run_home_is_the_same_however_time_is_cut() -> None:
    def run(step_s: float) -> list[object]:
        lift = begun(faced("seer-generic", (1, 2), start=1), Reboot())
        lift.after(2.02)
        ended(lift, Reboot())
        lift.write(HOLDING, 1, 5)  # the door is held from the moment it is home
        pictures: list[object] = []
        for _ in range(round(32 / step_s)):
            picture = lift.after(step_s)
            pictures += [picture] if round(lift.now - 2.02, 3) in (4.0, 8.0, 32.0) else []
        return pictures

    assert run(0.1) == run(1.0) == run(4.0)


def test_what_others_write_while_a_device_is_off_is_gone() -> None:
    lift = begun(begun(generic(), Reboot()), ForeignWriter("hold_door.front", every_s=3.0))
    lift.after(4)
    ended(lift, Reboot())
    assert lift.read(HOLDING, HOLD) == [0]
    lift.after(2.1)
    assert lift.read(HOLDING, HOLD) == [1]


def test_people_are_heard_by_a_controller_that_has_restarted() -> None:
    lift = begun(generic(start=2), Reboot())
    lift.people(Inputs(key=Key.INSPECTION))
    ended(lift, Reboot())
    assert lift.after(30).level_floor == 2, "an inspector holds it where it is"
    lift.people(Inputs())
    assert lift.until(lambda picture: picture.level_floor == 0).level_floor == 0


def test_a_press_that_was_lost_before_a_restart_is_none_after_it() -> None:
    lift = begun(generic(), LostPress())
    lift.write(HOLDING, HOLD, 1)
    ended(begun(lift, Reboot()), Reboot())
    lift.write(HOLDING, HOLD, 1)
    assert is_open(lift.after(2.5))


def test_a_kept_slot_keeps_others_out_and_lets_those_inside_work() -> None:
    lift = begun(generic(), SlotKept())
    assert not lift.face.admits(lift.now)
    assert lift.read(HOLDING, FLOOR) == [1]
    assert ended(lift, SlotKept()).face.admits(lift.now)


# -- behind a server


@dataclass
class Line:
    """One bare connection."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    async def says(self, frame: str) -> str:
        """Send a frame and return the answer, both without transaction id, protocol id and length."""
        body = bytes.fromhex(frame)
        self.writer.write(b"\0\1\0\0" + len(body).to_bytes(2, "big") + body)
        async with asyncio.timeout(WITHIN_S):
            head = await self.reader.readexactly(6)
            return (await self.reader.readexactly(head[5])).hex(" ").upper()

    async def was_reset(self) -> bool:
        """Whether the other side resets the connection: a RST, not an end."""
        async with asyncio.timeout(WITHIN_S):
            try:
                await self.reader.read(1)
            except ConnectionResetError:
                return True
            return False

    async def close(self, *, reset: bool = False) -> None:
        if reset:
            linger = struct.pack("ii", 1, 0)
            self.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        self.writer.close()
        await asyncio.gather(self.writer.wait_closed(), return_exceptions=True)


@dataclass
class Plant:
    """A server with lifts behind it, and everybody who connected."""

    server: SimulatedController
    lifts: Sequence[Faced]
    lines: list[Line] = field(default_factory=list)

    async def line(self) -> Line:
        line = Line(*await asyncio.open_connection(HOST, self.server.port))
        self.lines.append(line)
        return line

    async def inside(self) -> Line:
        """A connection that was let in: it gets answers."""
        line = await self.line()
        assert await line.says(READ) == "01 03 02 00 01"
        return line

    async def until_let_in(self) -> Line:
        """Connect until one is let in; a server hears of an end a moment later."""
        async with asyncio.timeout(WITHIN_S):
            while True:
                line = await self.line()
                line.writer.write(bytes.fromhex("00 01 00 00 00 06" + READ))
                try:
                    await line.reader.readexactly(11)
                except (ConnectionError, asyncio.IncompleteReadError):
                    continue
                return line


def with_plant(
    check: Callable[[Plant], Awaitable[None]],
    *lifts: Faced,
    limits: ClientLimits | None = None,
    run: Callable[[Coroutine[None, None, None]], None] = asyncio.run,
) -> None:
    """Run a check against a server in front of these lifts, which are its units 1, 2 and so on."""

    @asynccontextmanager
    async def served() -> AsyncIterator[Plant]:
        devices: dict[int, Device] = {number: lift.face for number, lift in enumerate(lifts, start=1)}
        server = SimulatedController(devices, clock=lambda: lifts[0].now, limits=limits)
        await server.start()
        plant = Plant(server, lifts)
        try:
            yield plant
        finally:
            for line in plant.lines:
                await line.close()
            await server.stop()

    async def main() -> None:
        async with served() as plant:
            await check(plant)

    run(main())


@each_row("run", [asyncio.run, uvloop.run])
@each_row("fault", [Reboot(), PowerLoss()])
def test_every_connection_is_reset_when_a_device_leaves_its_network_and_new_ones_too(
    fault: Fault, run: Callable[[Coroutine[None, None, None]], None]
) -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        first, second = await plant.inside(), await plant.inside()
        begun(lift, fault)
        assert await first.was_reset()
        assert await second.was_reset()
        assert await (await plant.line()).was_reset()
        ended(lift, fault)
        await plant.inside()

    with_plant(check, generic(), run=run)


def test_a_request_that_waits_as_the_power_goes_is_not_carried_out() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        line = await plant.inside()
        line.writer.write(bytes.fromhex("00 01 00 00 00 06 01 06 00 10 00 04"))
        begun(lift, PowerLoss(outputs_held=True))
        assert await line.was_reset()
        ended(lift, PowerLoss(outputs_held=True))
        assert await (await plant.inside()).says("01 03 00 10 00 01") == "01 03 02 00 00"

    with_plant(check, generic())


def test_further_devices_of_a_lift_leave_the_network_with_it() -> None:
    lift = faced(written_map(SENSOR, SENSOR_HEAD), (0, 1))

    async def main() -> None:
        server = SimulatedController({9: lift.face.endpoint("sensor")}, clock=lambda: lift.now)
        await server.start()
        line = Line(*await asyncio.open_connection(HOST, server.port))
        assert await line.says("09 02 00 00 00 03") == "09 02 01 01"
        begun(lift, Reboot())
        assert await line.was_reset()
        await line.close()
        await server.stop()

    asyncio.run(main())


def test_of_two_lifts_behind_a_gateway_one_may_be_off() -> None:
    async def check(plant: Plant) -> None:
        first, second = plant.lifts
        line = await plant.inside()
        begun(second, PowerLoss())
        assert await line.says(READ) == "01 03 02 00 01"
        for to_the_other in ("02 03 00 01 00 01", "02 06 00 10 00 01", "02 05 00 00 00 07"):
            answer = await line.says(to_the_other)
            assert answer == f"02 {int(to_the_other[3:5], 16) | 0x80:02X} 0B"
        begun(first, Reboot())
        assert await line.was_reset()

    with_plant(check, generic(), generic())


def test_a_device_has_so_many_slots_and_a_connection_more_is_reset() -> None:
    async def check(plant: Plant) -> None:
        first, _ = await plant.inside(), await plant.inside()
        assert await (await plant.line()).was_reset()
        assert await first.says(READ) == "01 03 02 00 01"
        await first.close()
        await plant.until_let_in()

    with_plant(check, generic(), limits=ClientLimits(most=2))


def test_a_request_that_comes_too_soon_after_an_answer_is_lost_and_each_client_has_a_pace_of_its_own() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        line = await plant.inside()
        lift.now += 0.09
        line.writer.write(bytes.fromhex("00 02 00 00 00 06" + READ))
        await plant.inside()
        lift.now += 0.02
        line.writer.write(bytes.fromhex("00 03 00 00 00 06" + READ))
        async with asyncio.timeout(WITHIN_S):
            answer = await line.reader.readexactly(11)
        assert answer[:2] == bytes.fromhex("00 03"), "the request before it has no answer"

    with_plant(check, generic(), limits=ClientLimits(min_gap_s=0.1))


def test_a_connection_without_a_request_is_closed_and_each_request_keeps_it_open() -> None:
    async def check(plant: Plant) -> None:
        now = asyncio.get_running_loop().time
        line = await plant.inside()
        asked_at = now()
        until = asked_at + 1.3 * IDLE_S
        while now() < until and not line.reader.at_eof():
            asked_at = now()
            assert await line.says(READ) == "01 03 02 00 01"
        assert not await line.was_reset()
        assert now() - asked_at >= 0.9 * IDLE_S

    with_plant(check, generic(), limits=ClientLimits(idle_timeout_s=IDLE_S))


def test_a_client_that_is_sent_away_because_it_speaks_no_modbus_frees_its_slot() -> None:
    async def check(plant: Plant) -> None:
        for _ in range(3):
            line = await plant.until_let_in()
            line.writer.write(b"GET / HTTP/1.0\r\n\r\n")
            assert not await line.was_reset()
        begun(plant.lifts[0], PowerLoss())

    with_plant(check, generic(), limits=ClientLimits(most=1))


@pytest.mark.parametrize("by_reset", [True, False])
def test_a_connection_that_ends_keeps_its_slot_while_the_fault_lasts(*, by_reset: bool) -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        begun(lift, SlotKept())
        for _ in range(2):
            await (await plant.inside()).close(reset=by_reset)
        assert await (await plant.line()).was_reset()
        ended(lift, SlotKept())
        await plant.inside()

    with_plant(check, generic(), limits=ClientLimits(most=2))


def test_without_a_number_of_slots_nobody_new_is_let_in_while_one_is_kept() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        inside = await plant.inside()
        begun(lift, SlotKept())
        assert await (await plant.line()).was_reset()
        assert await inside.says(READ) == "01 03 02 00 01"
        await inside.close(reset=True)
        assert await (await plant.line()).was_reset()
        ended(lift, SlotKept())
        await plant.inside()

    with_plant(check, generic())


def test_a_restart_frees_the_slots() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        begun(lift, SlotKept())
        await (await plant.inside()).close()
        assert await (await plant.line()).was_reset()
        ended(begun(lift, Reboot()), Reboot())
        await plant.inside()

    with_plant(check, generic(), limits=ClientLimits(most=1))


def test_a_controller_in_stop_answers_and_does_nothing() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        line = await plant.inside()
        begun(lift, Stopped())
        assert await line.says("01 06 00 10 00 04") == "01 06 00 10 00 04"
        lift.now += 60
        assert await line.says("01 03 00 00 00 02") == "01 03 04 00 00 00 01"
        assert await line.says("01 03 00 10 00 01") == "01 03 02 00 04"
        assert lift.face.picture.level_floor == 0

    with_plant(check, generic())


@pytest.mark.parametrize(
    ("map_name", "codes", "write", "read", "says"),
    [
        ("generic-registers", (1, 2), "01 06 00 10 00 02", "01 03 00 10 00 01", "01 03 02 00 00"),
        ("generic-registers", (1, 2), "01 16 00 10 FF F0 00 02", "01 03 00 10 00 01", "01 03 02 00 00"),
        ("generic-coils", (0, 1), "01 05 00 01 FF 00", "01 01 00 01 00 01", "01 01 01 00"),
    ],
)
def test_a_write_that_is_ignored_is_answered_like_any_other(
    map_name: str, codes: tuple[int, ...], write: str, read: str, says: str
) -> None:
    async def check(plant: Plant) -> None:
        line = await plant.line()
        begun(plant.lifts[0], IgnoredWrites())
        assert await line.says(write) == write
        assert await line.says(read) == says

    with_plant(check, faced(map_name, codes))


def test_an_ordinary_client_finds_its_way_back_after_a_power_loss() -> None:
    async def check(plant: Plant) -> None:
        (lift,) = plant.lifts
        modbus = AsyncModbusTcpClient(HOST, port=plant.server.port, retries=0, reconnect_delay=0)
        assert await modbus.connect()
        assert (await modbus.read_holding_registers(FLOOR, count=1)).registers == [1]
        begun(lift, PowerLoss())
        ended(lift, PowerLoss())
        modbus.close()
        assert await modbus.connect()
        assert (await modbus.read_holding_registers(FLOOR, count=1)).registers == [1]
        modbus.close()

    with_plant(check, generic())
