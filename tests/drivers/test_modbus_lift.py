"""ModbusLift over the in-memory wire: one round trip a poll, presses that are pressed once, releases that stick."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from drivers.errors import ControllerException, DriverError, HeartbeatStopped
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import Fault, MemoryDevice, exception, hang_up, silence
from drivers.model import Command, CommandKind, Outcome, Proof, Result
from register_maps.codec import compile_map
from register_maps.frames import Request, exception_answer
from register_maps.load import load
from register_maps.words import Door, Mode, Motion, Side, Table
from tests.drivers.caller import Caller
from tests.support.virtual_time import elapse, run_virtual

GO_L2 = Command(CommandKind.GO_TO, "L2")
HOLD = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
ROBOT = Command(CommandKind.ROBOT_MODE)
DOES_NOTHING = Fault(lambda _request, answer: ((0.0, answer),), executes=False)


def allowed() -> None:
    return None


@dataclass
class Rig:
    """A lift, its controller in memory, and a poll every 0.1 s."""

    device: MemoryDevice
    lift: Caller
    link: Link
    errors: list[DriverError]

    def set(self, **registers: int) -> None:
        """Move registers by hand: `holding_3=3`."""
        for name, value in registers.items():
            table, address = name.split("_")
            self.device.values[Table(table)][int(address)] = value

    def writes(self) -> list[str]:
        return [str(request) for request in self.device.writes]

    async def until(self, true: Callable[[], bool], within_s: float = 10.0) -> None:
        async with asyncio.timeout(within_s):
            while not true():
                await elapse(0.01)


@asynccontextmanager
async def rig(map_name: str, *, control: bool, beat: bool) -> AsyncIterator[Rig]:
    source = load(map_name).map
    device = MemoryDevice()
    link = Link(device.wire, LinkSettings(), name="plc")
    floors = {"L1": 1, "L2": 2} if map_name == "generic-registers" else {"L1": 0, "L2": 1}
    lift = Caller(ModbusLift(compile_map(source), link, LiftSettings(name="lift", floors=floors, control=control)))
    made = Rig(device, lift, link, [])
    if map_name == "generic-registers":
        made.set(holding_1=1, holding_2=1, holding_3=1, holding_4=2, holding_5=0b111)
    else:
        made.set(discrete_1=1, discrete_2=1, discrete_4=1)

    async def poll() -> None:
        while True:
            if beat and map_name == "generic-registers":
                made.set(holding_0=int(asyncio.get_running_loop().time() * 10) & 0xFFFF)
            try:
                await lift.read()
            except DriverError as error:
                made.errors.append(error)
            await elapse(0.1)

    tasks = [asyncio.ensure_future(work) for work in (link.run(), lift.run(), poll())]
    await link.wait_up()
    await elapse(0.35)
    try:
        yield made
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def on_rig(map_name: str, check: Callable[[Rig], Awaitable[None]], *, control: bool = True, beat: bool = True) -> None:
    async def main() -> None:
        async with rig(map_name, control=control, beat=beat) as made:
            await check(made)

    run_virtual(main)


def is_write(request: Request) -> bool:
    return request.is_write


def lets_go(request: Request) -> bool:
    return request.values == (0,)


@pytest.mark.parametrize("map_name", ["generic-registers", "two-stop-agv"])
def test_a_poll_costs_one_round_trip(map_name: str) -> None:
    async def check(made: Rig) -> None:
        made.device.received.clear()
        await made.lift.read()
        assert len(made.device.received) == 1

    on_rig(map_name, check)


def test_a_reading_says_what_the_registers_say() -> None:
    async def check(made: Rig) -> None:
        made.set(holding_1=2, holding_2=2, holding_3=4, holding_4=1, holding_5=0b10011, holding_6=1)
        values = (await made.lift.read()).values
        assert values.floor == "L2"
        assert values.motion is Motion.UP
        assert values.doors == {Side.FRONT: Door.CLOSING}
        assert values.mode is Mode.ROBOT
        assert values.destination == "L1"
        assert values.flags["overload"]
        assert not values.flags["level"]

    on_rig("generic-registers", check)


def test_a_value_outside_its_table_is_unknown_and_keeps_its_raw_value() -> None:
    async def check(made: Rig) -> None:
        made.set(holding_1=9, holding_3=77)
        values = (await made.lift.read()).values
        assert values.floor is None
        assert values.doors == {Side.FRONT: Door.UNKNOWN}
        assert values.unknown == {"car_floor": 9, "door.front": 77}

    on_rig("generic-registers", check)


def test_a_controller_full_of_zeros_is_on_fire_and_nowhere() -> None:
    async def check(made: Rig) -> None:
        made.device.values[Table.HOLDING].clear()
        values = (await made.lift.read()).values
        assert values.mode is Mode.FIRE
        assert values.floor is None
        assert values.doors == {Side.FRONT: Door.UNKNOWN}
        assert values.motion is Motion.UNKNOWN

    on_rig("generic-registers", check)


def test_unchanged_registers_give_the_same_values_object() -> None:
    async def check(made: Rig) -> None:
        first = await made.lift.read()
        made.set(holding_0=12345)
        second = await made.lift.read()
        assert second.values is first.values
        assert second.at >= first.at

    on_rig("generic-registers", check)


def test_a_heartbeat_that_stands_still_is_no_reading() -> None:
    async def check(made: Rig) -> None:
        await elapse(4)
        with pytest.raises(HeartbeatStopped, match="has not changed"):
            await made.lift.read()
        made.set(holding_0=999)
        assert (await made.lift.read()).values.floor == "L1"

    on_rig("generic-registers", check, beat=False)


def test_a_call_is_pressed_for_its_width_and_confirmed_by_its_lamp() -> None:
    async def check(made: Rig) -> None:
        future = made.lift.press(GO_L2, allowed)
        await made.until(lambda: bool(made.device.writes))
        pressed_at = next(heard.at_s for heard in made.device.received if heard.request.is_write)
        made.set(holding_7=2)
        outcome = await future
        assert (outcome.result, outcome.proof) == (Result.CONFIRMED, Proof.LAMP)
        await elapse(1)
        assert made.writes() == ["write holding register 16 := 2, unit 1", "write holding register 16 := 0, unit 1"]
        released = [heard for heard in made.device.received if heard.request.is_write][-1]
        assert released.at_s - pressed_at == pytest.approx(0.5, abs=0.02)
        assert outcome.frames == ("010600100002",)

    on_rig("generic-registers", check)


def test_a_call_that_nothing_shows_ends_unconfirmed_and_is_not_repeated() -> None:
    async def check(made: Rig) -> None:
        outcome = await made.lift.press(GO_L2, allowed)
        assert outcome.result is Result.UNCONFIRMED
        await elapse(30)
        assert made.writes().count("write holding register 16 := 2, unit 1") == 1

    on_rig("generic-registers", check)


@pytest.mark.parametrize(
    ("fault", "result"),
    [(silence(), Result.UNCONFIRMED), (hang_up(), Result.UNCONFIRMED), (exception(2), Result.REJECTED)],
)
def test_a_press_whose_answer_is_lost_is_let_go_but_never_pressed_again(fault: Fault, result: Result) -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(fault, on=is_write)
        outcome = await made.lift.press(GO_L2, allowed)
        assert outcome.result is result
        await elapse(5)
        assert made.device.values[Table.HOLDING].get(16, 0) == 0
        assert [heard.request.values for heard in made.device.received].count((2,)) == 1

    on_rig("generic-registers", check)


def test_a_release_is_repeated_until_the_register_reads_back_at_rest() -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(DOES_NOTHING, on=lets_go)
        made.device.fail_next(silence(executes=False), times=3, on=lets_go)
        outcome = made.lift.press(GO_L2, allowed)
        await elapse(10)
        assert made.device.values[Table.HOLDING][16] == 0
        assert [heard.request.values for heard in made.device.received].count((0,)) >= 4
        assert outcome.done()

    on_rig("generic-registers", check)


def test_a_write_that_is_answered_but_not_carried_out_is_not_taken_for_done() -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(DOES_NOTHING, times=100, on=is_write)
        for _ in range(10):
            made.lift.hold(HOLD, allowed)
            await elapse(0.1)
            assert not made.lift.held(HOLD)

    on_rig("generic-registers", check)


def test_a_hold_is_refreshed_verified_and_falls_when_nobody_renews_it() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD, allowed)
        await made.until(lambda: made.lift.held(HOLD))
        await elapse(10.5)
        assert made.lift.held(HOLD)
        assert made.writes().count("write holding register 17 := 1, unit 1") == 11
        await elapse(21)
        assert made.device.values[Table.HOLDING][17] == 0
        assert not made.lift.held(HOLD)

    on_rig("generic-registers", check)


def test_a_hold_that_is_renewed_stays_on() -> None:
    async def check(made: Rig) -> None:
        for _ in range(120):
            made.lift.hold(HOLD, allowed)
            await elapse(1)
        assert made.device.values[Table.HOLDING][17] == 1
        assert "write holding register 17 := 0, unit 1" not in made.writes()

    on_rig("generic-registers", check)


def test_a_hold_is_not_refreshed_without_permission_and_can_always_be_let_go() -> None:
    async def check(made: Rig) -> None:
        refusal: list[str] = []
        made.lift.hold(HOLD, lambda: refusal[0] if refusal else None)
        await made.until(lambda: made.lift.held(HOLD))
        refusal.append("no more")
        before = len(made.device.writes)
        await elapse(20)
        assert len(made.device.writes) == before
        assert not made.lift.held(HOLD)
        made.lift.let_go(HOLD)
        await elapse(1)
        assert made.device.values[Table.HOLDING][17] == 0

    on_rig("generic-registers", check)


def test_a_press_without_permission_sends_nothing() -> None:
    async def check(made: Rig) -> None:
        outcome = await made.lift.press(GO_L2, lambda: "held by somebody else")
        assert outcome.result is Result.REJECTED
        assert outcome.reason == "held by somebody else"
        assert made.device.writes == []

    on_rig("generic-registers", check)


def test_a_call_needs_the_robot_mode_that_its_map_requires() -> None:
    async def check(made: Rig) -> None:
        made.set(holding_4=1, holding_5=0b101)
        await elapse(0.3)
        outcome = await made.lift.press(GO_L2, allowed)
        assert outcome.result is Result.REJECTED
        assert "robot_mode_on" in outcome.reason
        assert made.device.writes == []

    on_rig("generic-registers", check)


def test_a_monitored_lift_is_never_written_to_not_even_to_clear_it() -> None:
    async def check(made: Rig) -> None:
        made.set(holding_16=2, holding_17=1)
        made.device.disconnect()
        await elapse(2)
        outcome = await made.lift.press(GO_L2, allowed)
        made.lift.hold(HOLD, allowed)
        await made.lift.release_all()
        await elapse(5)
        assert outcome.result is Result.REJECTED
        assert made.device.writes == []

    on_rig("generic-registers", check, control=False)


def test_outputs_left_on_by_somebody_before_us_are_cleared_on_connect() -> None:
    async def check(made: Rig) -> None:
        made.set(holding_16=2, holding_17=1, holding_18=1)
        made.device.disconnect()
        await elapse(2)
        image = made.device.values[Table.HOLDING]
        assert (image[16], image[17], image[18]) == (0, 0, 0)

    on_rig("generic-registers", check)


def test_a_hold_that_is_still_on_after_a_reconnect_is_adopted_not_toggled() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD, allowed)
        await made.until(lambda: made.lift.held(HOLD))
        made.device.disconnect()
        await elapse(2)
        assert made.lift.held(HOLD)
        assert "write holding register 17 := 0, unit 1" not in made.writes()

    on_rig("generic-registers", check)


def test_a_call_that_the_controller_forgot_during_an_outage_is_not_given_again() -> None:
    async def check(made: Rig) -> None:
        future = made.lift.press(GO_L2, allowed)
        await made.until(lambda: bool(made.device.writes))
        made.set(coil_0=0, coil_1=0)
        made.device.disconnect()
        await elapse(5)
        assert [request.values for request in made.device.writes].count((0, 1, 0, 0)) == 1
        future.cancel()

    on_rig("two-stop-agv", check)


def test_two_stop_commands_are_written_together_and_exclude_each_other() -> None:
    async def check(made: Rig) -> None:
        call = made.lift.press(GO_L2, allowed)
        await made.until(lambda: bool(made.device.writes))
        made.set(discrete_2=0)
        await elapse(1)
        made.set(discrete_3=1)
        assert (await call).result is Result.CONFIRMED
        made.lift.hold(HOLD, allowed)
        await made.until(lambda: made.lift.held(HOLD))
        made.lift.let_go(HOLD)
        await elapse(1)
        images = [request.values for request in made.device.writes]
        assert all(request.function == 15 and request.address == 0 for request in made.device.writes)
        assert list(dict.fromkeys(images)) == [(0, 1, 0, 0), (0, 0, 0, 0), (0, 0, 1, 0)]
        assert images[-1] == (0, 0, 0, 0)

    on_rig("two-stop-agv", check)


def test_everything_is_released_and_verified_on_request() -> None:
    async def check(made: Rig) -> None:
        made.lift.hold(HOLD, allowed)
        made.lift.hold(ROBOT, allowed)
        outcome = made.lift.press(GO_L2, allowed)
        await made.until(lambda: made.lift.held(HOLD))
        await made.lift.release_all()
        image = made.device.values[Table.HOLDING]
        assert (image[16], image[17], image[18]) == (0, 0, 0)
        assert outcome.done()

    on_rig("generic-registers", check)


def test_a_controller_that_serves_less_than_its_map_says_is_reported_as_that() -> None:
    async def check(made: Rig) -> None:
        made.device.fail_next(exception(2))
        with pytest.raises(ControllerException, match="illegal data address"):
            await made.lift.read()

    on_rig("generic-registers", check)


def test_a_controller_that_says_accepted_has_taken_the_press() -> None:
    async def check(made: Rig) -> None:
        accepted = Fault(lambda request, _answer: ((0.0, exception_answer(request, 5)),), executes=True)
        made.device.fail_next(accepted, on=is_write)
        future = made.lift.press(GO_L2, allowed)
        await made.until(lambda: bool(made.device.writes))
        made.set(holding_7=2)
        assert (await future).result is Result.CONFIRMED
        await elapse(1)
        assert [request.values for request in made.device.writes] == [(2,), (0,)]

    on_rig("generic-registers", check)


def test_a_new_call_replaces_one_that_is_still_pressed() -> None:
    async def check(made: Rig) -> None:
        first = made.lift.press(GO_L2, allowed)
        await made.until(lambda: bool(made.device.writes))
        second = made.lift.press(Command(CommandKind.GO_TO, "L1"), allowed)
        outcome: Outcome = await first
        assert outcome.reason == "replaced by a newer command"
        await second
        await elapse(1)
        assert [request.values for request in made.device.writes] == [(2,), (0,), (1,), (0,)]

    on_rig("generic-registers", check)
