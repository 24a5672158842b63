"""What every driver promises to whoever commands it: ModbusLift over a wire in memory, and the fake that tests of the core use."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace

import pytest

from drivers.driver import LiftDriver, Report
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice
from drivers.model import (
    Command,
    CommandKind,
    Hold,
    LiftReading,
    Outcome,
    OutputChanged,
    OutputState,
    PressId,
    Result,
    Written,
)
from register_maps.words import Side, Table
from tests.drivers.linked import now
from tests.drivers.rig import ended
from tests.lift_manager.runtime.scripted import AT_L2, PLAIN, ScriptedDriver
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import written_map

HOLD = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
GO1, GO2 = Command(CommandKind.GO_TO, "L1"), Command(CommandKind.GO_TO, "L2")
COIL, CALL = 8, 40
MAP = (
    'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "discrete:1"}}\ncommands:\n'
    f'  go_to: {{at: "holding:{CALL}", as: floor, rest: 0, action: pulse, width_s: 0.5, confirm: {{any_of: [readback], within_s: 2}}}}\n'
    f'  hold_door.front: {{at: "coil:{COIL}", action: hold, max_hold_s: 10, refresh_s: 0.5, on_link_loss: latches,'
    " confirm: {any_of: [readback], within_s: 2}}\n"
)


@dataclass
class ByHand:
    """Above: forbids what a test says, and keeps what it is told."""

    forbids: str | None = None
    asked: list[tuple[Command, PressId | None]] = field(default_factory=list)
    heard: list[Report] = field(default_factory=list)

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        self.asked.append((command, press))
        return self.forbids

    def report(self, item: Report) -> None:
        self.heard.append(item)

    @property
    def outcomes(self) -> list[Outcome]:
        return [item for item in self.heard if isinstance(item, Outcome)]

    @property
    def pressed(self) -> list[str]:
        """What was written as pressed, without what was only written again."""
        return [item.name for item in self.heard if isinstance(item, Written) and item.what == "press"]

    def states(self, command: Command) -> list[OutputState]:
        return [item.state for item in self.heard if isinstance(item, OutputChanged) and item.name == command.name]


@dataclass
class Made:
    driver: LiftDriver
    above: ByHand
    is_on: Callable[[], bool]
    """Whether the lift holds the door for us."""
    take_away: Callable[[], None]
    """The controller lets go of the door hold by itself."""
    reading: LiftReading | None = None

    def state(self) -> OutputState:
        assert self.reading is not None
        return self.reading.outputs[HOLD.name]

    async def keep(self, begin: int, seconds: float) -> None:
        """Declare the door hold every 0.1 s, for five seconds each."""
        for _ in range(round(seconds * 10)):
            self.driver.declare({HOLD: Hold(begin, now() + 5)})
            await elapse(0.1)


Maker = Callable[[bool], tuple[Made, list[Awaitable[None]]]]


def modbus(left_on: bool) -> tuple[Made, list[Awaitable[None]]]:
    device = MemoryDevice()
    device.values[Table.INPUT][1] = 2
    device.values[Table.COIL][COIL] = int(left_on)
    link = Link(device.wire, LinkSettings(), name="plc")
    lift = ModbusLift(written_map(MAP), link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True))

    def take_away() -> None:
        device.values[Table.COIL][COIL] = 0

    is_on = lambda: bool(device.values[Table.COIL].get(COIL, 0))  # noqa: E731
    return Made(lift, ByHand(), is_on, take_away), [link.run(), lift.run()]


def scripted(left_on: bool) -> tuple[Made, list[Awaitable[None]]]:
    able = replace(PLAIN, max_hold_s={HOLD.name: 10.0})
    lift = ScriptedDriver(able, AT_L2, left_on=frozenset({HOLD.name} if left_on else ()))
    made = Made(lift, ByHand(), lambda: HOLD.name in lift.on, lambda: lift.on.discard(HOLD.name))
    return made, [lift.run()]


def on_driver(
    check: Callable[[Made], Awaitable[None]],
    make: Maker,
    *,
    first: Callable[[LiftDriver], None] | None = None,
    left_on: bool = False,
    attached: bool = True,
) -> None:
    """Run a check on a driver that is polled every 0.1 s; `first` happens before anything runs."""

    async def main() -> None:
        made, work = make(left_on)
        if attached:
            made.driver.attach(made.above)
        if first is not None:
            first(made.driver)

        async def poll() -> None:
            await elapse(0.05)
            while True:
                made.reading = await made.driver.read()
                await elapse(0.1)

        running = [asyncio.ensure_future(part) for part in (*work, poll())]
        await elapse(0.5)
        try:
            await check(made)
        finally:
            await ended(running)

    run_virtual(main)


on_every_driver = pytest.mark.parametrize("make", [modbus, scripted])


@on_every_driver
def test_a_hold_that_is_declared_is_put_on_once_and_absent_it_is_released(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(1, 2.0)
        assert made.is_on()
        assert made.state() is OutputState.HELD
        assert made.above.pressed == [HOLD.name]
        assert (HOLD, None) in made.above.asked
        made.driver.declare({})
        await elapse(0.5)
        assert not made.is_on()
        assert made.state() is OutputState.AT_REST
        assert made.above.states(HOLD)[-1] is OutputState.AT_REST

    on_driver(check, make)


@on_every_driver
def test_a_hold_without_a_beginning_is_never_put_on(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(0, 2.0)
        assert not made.is_on()
        assert made.above.pressed == []
        assert made.state() is OutputState.AT_REST

    on_driver(check, make)


@on_every_driver
def test_a_hold_falls_when_it_is_not_declared_for_longer(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.declare({HOLD: Hold(1, now() + 3)})
        await elapse(2.5)
        assert made.is_on()
        await elapse(1.0)
        assert not made.is_on()
        await made.keep(1, 1.0)
        assert not made.is_on(), "that beginning is used up"

    on_driver(check, make)


@on_every_driver
def test_a_hold_that_is_found_off_is_lost_until_a_higher_beginning_is_declared(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(1, 2.0)
        made.take_away()
        await made.keep(1, 4.0)
        assert not made.is_on()
        assert made.state() is OutputState.LOST
        assert made.above.pressed == [HOLD.name]
        await made.keep(2, 3.0)
        assert made.is_on()
        assert made.state() is OutputState.HELD
        assert made.above.pressed == 2 * [HOLD.name]

    on_driver(check, make)


@on_every_driver
def test_a_hold_that_is_only_kept_and_is_found_off_is_at_rest(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(1, 2.0)
        await made.keep(0, 2.0)
        assert made.is_on()
        made.take_away()
        await made.keep(0, 4.0)
        assert not made.is_on()
        assert made.state() is OutputState.AT_REST
        assert made.above.pressed == [HOLD.name]

    on_driver(check, make)


@on_every_driver
def test_a_hold_that_may_not_leave_leaves_once_it_may(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.above.forbids = "there is a fire"
        await made.keep(1, 1.0)
        assert not made.is_on()
        assert made.above.pressed == []
        made.above.forbids = None
        await made.keep(1, 1.0)
        assert made.is_on()

    on_driver(check, make)


@on_every_driver
@pytest.mark.parametrize("left_on", [True, False])
def test_what_is_declared_before_the_first_reading_is_kept_if_it_is_found_on(make: Maker, *, left_on: bool) -> None:
    async def check(made: Made) -> None:
        assert made.above.states(HOLD)[0] is OutputState.REQUESTED
        await made.keep(0, 1.0)
        assert made.is_on() is left_on
        assert made.state() is (OutputState.HELD if left_on else OutputState.AT_REST)
        assert made.above.pressed == []

    on_driver(check, make, first=lambda lift: lift.declare({HOLD: Hold(0, now() + 9)}), left_on=left_on)


@on_every_driver
def test_a_press_leaves_once_is_asked_for_by_its_id_and_ends_once(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO2, now() + 10)
        await elapse(4.0)
        assert made.above.pressed == [GO2.name]
        assert made.above.asked[-1] == (GO2, 7)
        assert [(each.press, each.command, each.result) for each in made.above.outcomes] == [(7, GO2, Result.CONFIRMED)]

    on_driver(check, make)


@on_every_driver
def test_a_press_that_is_forbidden_at_the_last_moment_is_rejected_with_the_reason(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO2, now() + 10)
        made.above.forbids = "there is a fire"
        await elapse(4.0)
        assert made.above.pressed == []
        assert [(each.press, each.result, each.reason) for each in made.above.outcomes] == [
            (7, Result.REJECTED, "there is a fire")
        ]

    on_driver(check, make)


@on_every_driver
def test_a_press_that_is_taken_back_before_it_left_never_leaves(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO2, now() + 10)
        made.driver.cancel(7)
        await elapse(4.0)
        made.driver.cancel(7)
        assert made.above.pressed == []
        assert [(each.press, each.result) for each in made.above.outcomes] == [(7, Result.UNCONFIRMED)]
        assert made.above.states(GO2)[-1] is OutputState.AT_REST

    on_driver(check, make)


@on_every_driver
def test_a_newer_press_ends_the_older_one_which_can_then_not_be_taken_back(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO1, now() + 10)
        made.driver.press(8, GO2, now() + 10)
        made.driver.cancel(7)
        await elapse(4.0)
        assert made.above.pressed == [GO2.name]
        ends = [(each.press, each.command, each.result) for each in made.above.outcomes]
        assert ends == [(7, GO1, Result.UNCONFIRMED), (8, GO2, Result.CONFIRMED)]

    on_driver(check, make)


@on_every_driver
def test_a_press_that_was_not_written_in_time_is_given_up(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO2, now() - 1)
        await elapse(4.0)
        assert made.above.pressed == []
        assert [(each.press, each.result) for each in made.above.outcomes] == [(7, Result.REJECTED)]

    on_driver(check, make)


@on_every_driver
def test_behind_the_fence_nothing_is_written_releases_included(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(1, 1.0)
        assert made.is_on()
        made.driver.fence(now())
        made.driver.declare({})
        made.driver.press(7, GO2, now() + 1)
        await elapse(3.0)
        assert made.is_on()
        assert made.above.pressed == [HOLD.name]
        made.driver.fence(now() + 3600)
        await elapse(0.5)
        assert not made.is_on()

    on_driver(check, make)


@on_every_driver
def test_nothing_is_pressed_while_nobody_is_attached(make: Maker) -> None:
    async def check(made: Made) -> None:
        made.driver.press(7, GO2, now() + 10)
        await made.keep(1, 2.0)
        assert not made.is_on()

    on_driver(check, make, attached=False)


@on_every_driver
def test_it_is_released_once_everything_is_at_rest(make: Maker) -> None:
    async def check(made: Made) -> None:
        await made.keep(1, 1.0)
        made.driver.press(7, GO2, now() + 10)
        await elapse(0.08)
        waiting = asyncio.ensure_future(made.driver.released())
        await elapse(2.0)
        assert not waiting.done()
        made.driver.declare({})
        async with asyncio.timeout(2):
            await waiting
        assert not made.is_on()

    on_driver(check, make)


@on_every_driver
def test_readings_carry_the_state_of_every_output_in_one_object_until_one_changes(make: Maker) -> None:
    async def check(made: Made) -> None:
        assert made.reading is not None
        before = made.reading.outputs
        assert before == {HOLD.name: OutputState.AT_REST, GO2.name: OutputState.AT_REST}
        await elapse(0.5)
        assert made.reading.outputs is before
        await made.keep(1, 1.0)
        assert made.reading.outputs[HOLD.name] is made.above.states(HOLD)[-1] is OutputState.HELD

    on_driver(check, make)
