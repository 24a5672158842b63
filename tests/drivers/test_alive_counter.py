"""A controller counts as live while its alive counter is seen to change, on this very connection."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest

from drivers.errors import DriverError, HeartbeatAwaited, HeartbeatStopped
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice
from drivers.modbus.units import Unit
from drivers.model import Command, CommandKind, LiftReading, Result
from register_maps.codec import Codec
from register_maps.words import Table
from tests.drivers.caller import Caller
from tests.drivers.linked import now, virtual
from tests.drivers.rig import SIGNALS, allowed
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse
from tests.support.written_maps import HEAD, written_map

POLL_S = 0.1
ON_TWO_DEVICES = """\
endpoints: {sensor: {served: {discrete: [[0, 9]]}}}
signals:
  alive: {at: "holding:0", type: counter, must_change_within_s: 3}
  car_floor: {at: "input:1", as: floor, unknown: [0]}
  door.front: {at: "sensor/discrete:1"}
"""


@dataclass
class Watched:
    """A lift that is read every 0.1 s while its counter counts twice a second, or stands still."""

    devices: dict[str, MemoryDevice]
    lift: Caller
    counts: bool = True
    readings: list[tuple[float, LiftReading]] = field(default_factory=list)
    errors: list[tuple[float, DriverError]] = field(default_factory=list)
    count: Callable[[], int] = lambda: int(now() * 2)

    def since(self, at: float) -> tuple[list[float], list[type[DriverError]]]:
        """Times of the readings and kinds of the errors from then on."""
        return (
            [when for when, _ in self.readings if when >= at],
            [type(error) for when, error in self.errors if when >= at],
        )


@asynccontextmanager
async def watched(codec: Codec | None = None, *, control: bool = False) -> AsyncIterator[Watched]:
    codec = codec or compiled("generic-registers")
    devices = {name: MemoryDevice() for name in ("", *codec.map.endpoints)}
    devices[""].values[Table.HOLDING].update({1: 1, 2: 1, 3: 1, 4: 1, 5: 0b101})
    devices[""].values[Table.INPUT][1] = 1
    links = {name: Link(device.wire, name=name or "plc") for name, device in devices.items()}
    settings = LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=control)
    lift = Caller(ModbusLift(codec, links[""], settings, {name: Unit(link, 1) for name, link in links.items() if name}))
    made = Watched(devices, lift)

    async def poll() -> None:
        while True:
            if made.counts:
                devices[""].values[Table.HOLDING][0] = made.count()
            try:
                made.readings.append((now(), await lift.read()))
            except DriverError as error:
                made.errors.append((now(), error))
            await elapse(POLL_S)

    tasks = [asyncio.ensure_future(part) for part in (*(link.run() for link in links.values()), lift.run(), poll())]
    try:
        yield made
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@virtual
async def test_what_is_read_first_counts_once_the_counter_was_seen_to_change() -> None:
    async with watched() as made:
        await elapse(2)
        good, bad = made.since(0.05)
        assert good[0] == pytest.approx(0.5, abs=POLL_S)
        assert set(bad) == {HeartbeatAwaited}
        assert "plc: waits for the first change of its alive counter, 0." in str(made.errors[-1][1])


@virtual
async def test_a_program_that_never_runs_is_never_live_and_after_its_time_that_is_said() -> None:
    async with watched() as made:
        made.counts = False
        await elapse(10)
        assert made.readings == []
        assert set(made.since(0.05)[1]) == {HeartbeatAwaited, HeartbeatStopped}
        assert set(made.since(3.3)[1]) == {HeartbeatStopped}


@virtual
async def test_a_normal_reconnect_costs_one_beat_at_the_most() -> None:
    async with watched() as made:
        await elapse(2)
        made.devices[""].disconnect()
        lost = now()
        await elapse(3)
        good, bad = made.since(lost)
        # 0.2 s for the connection, half a second for the beat, and the polls that see them
        assert good[0] - lost <= 0.2 + 0.5 + 2 * POLL_S
        assert HeartbeatStopped not in bad


@virtual
async def test_a_controller_that_comes_back_with_another_count_and_a_program_that_stands_still_is_not_live() -> None:
    async with watched() as made:
        await elapse(2)
        made.devices[""].disconnect()
        made.counts = False
        made.devices[""].values[Table.HOLDING][0] = 0
        lost = now()
        await elapse(10)
        assert made.since(lost)[0] == []
        made.counts, began = True, now()
        await elapse(2)
        assert made.since(began)[0][0] - began <= 2 * POLL_S


@virtual
async def test_a_counter_that_stops_later_is_told_after_its_time() -> None:
    async with watched() as made:
        await elapse(2)
        made.counts, stopped = False, now()
        await elapse(6)
        good, bad = made.since(stopped)
        assert 2.4 <= good[-1] - stopped <= 3.1
        assert set(bad) == {HeartbeatStopped}


@virtual
async def test_a_new_connection_to_another_device_of_the_lift_asks_for_no_beat() -> None:
    codec = written_map(ON_TWO_DEVICES, HEAD.replace("discrete: [[0, 99]], ", ""))
    async with watched(codec) as made:
        await elapse(2)
        made.devices["sensor"].disconnect()
        lost = now()
        await elapse(2)
        good, bad = made.since(lost)
        assert HeartbeatAwaited not in bad
        assert good[0] - lost <= 0.2 + 2 * POLL_S


@virtual
async def test_a_map_without_a_counter_waits_for_none() -> None:
    async with watched(compiled("two-stop-agv")) as made:
        await elapse(1)
        assert made.since(0.05)[0][0] <= 2 * POLL_S


@virtual
async def test_nothing_is_pressed_over_a_new_connection_before_the_counter_was_seen_to_change() -> None:
    async with watched(control=True) as made:
        await elapse(2)
        device = made.devices[""]
        made.counts = False
        device.disconnect()
        await elapse(0.5)
        refused = await made.lift.press(Command(CommandKind.ROBOT_MODE), allowed)
        assert (refused.result, refused.reason) == (
            Result.REJECTED,
            "its alive counter has not changed on this connection yet",
        )
        assert not any(request.values[0] for request in device.writes)
        made.counts = True
        await elapse(1)
        pressed = made.lift.press(Command(CommandKind.ROBOT_MODE), allowed)
        await elapse(1)
        assert any(request.values[0] for request in device.writes)
        pressed.cancel()


@virtual
async def test_of_an_alive_bit_the_error_says_that_it_may_be_in_step_with_the_polls() -> None:
    text = SIGNALS.replace(
        "signals: {", 'signals: {alive: {at: "discrete:7", type: counter, must_change_within_s: 2}, '
    )
    async with watched(written_map(text)) as made:
        await elapse(1)
        assert "a bit that changes in step with the polls always reads the same" in str(made.errors[-1][1])
