"""A press is sent in the call that gives it, where the line is free and nothing has to be read before."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

import pytest

from drivers.driver import Report
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.declared_writes import DeclaredWrites, UndeclaredWrite
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice, exception
from drivers.model import Command, CommandKind, DriverFailed, Hold, Outcome, PressId, Result, Written
from register_maps import frames
from register_maps.codec import Codec
from register_maps.words import Side, Table
from tests.drivers.linked import now, virtual
from tests.drivers.rig import HOLD, ended
from tests.support.virtual_time import elapse
from tests.support.written_maps import written_map

ANSWER_S = 0.01
GO, HOLD_FRONT = Command(CommandKind.GO_TO, "L2"), Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
GO_TO = "action: pulse, width_s: 0.5, confirm: {any_of: [readback], within_s: 2}"
ONE_BLOCK = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "input:2.0"}}\n'
PLAIN = ONE_BLOCK + (
    "commands:\n"
    f'  go_to: {{at: "holding:40", as: floor, rest: 0, {GO_TO}}}\n'
    f'  hold_door.front: {{at: "coil:8", refresh_s: 0.5, {HOLD}}}\n'
)
SHARED = f'{ONE_BLOCK}commands: {{go_to: {{one_of: ["holding:9.0", "holding:9.1", "holding:9.2"], shared_word: accepted, {GO_TO}}}}}\n'


@dataclass
class Owner:
    forbids: str | None = None
    asked: list[tuple[str, int]] = field(default_factory=list)
    """The command, and how many writes there had been."""
    reports: list[Report] = field(default_factory=list)
    device: MemoryDevice = field(default_factory=lambda: MemoryDevice(delay_s=ANSWER_S))

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        self.asked.append((command.name, len(self.device.writes)))
        return self.forbids

    def report(self, item: Report) -> None:
        self.reports.append(item)

    @property
    def written(self) -> list[tuple[str, str, str]]:
        return [(item.name, item.what, item.failure) for item in self.reports if isinstance(item, Written)]

    @property
    def outcomes(self) -> list[tuple[PressId | None, Result]]:
        return [(item.press, item.result) for item in self.reports if isinstance(item, Outcome)]


@dataclass
class Made:
    owner: Owner
    link: Link
    lift: ModbusLift
    running: list[asyncio.Task[None]]

    @property
    def writes(self) -> list[str]:
        return [str(request) for request in self.owner.device.writes]

    def press(self) -> None:
        self.lift.press(1, GO, now() + 10)

    def occupy(self) -> None:
        assert self.link.read_at_once(frames.read(Table.INPUT, 1, 1, 1), asyncio.get_running_loop().create_future())

    async def settle(self, for_s: float = 1.0) -> None:
        await elapse(for_s)
        await self.lift.read()


@asynccontextmanager
async def read_once(codec: Codec | None = None) -> AsyncIterator[Made]:
    owner = Owner()
    owner.device.values[Table.INPUT][1] = 1
    link = Link(owner.device.wire, name="plc")
    settings = LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=True)
    lift = ModbusLift(codec or written_map(PLAIN), link, settings)
    lift.attach(owner)
    running = [asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())]
    await link.wait_up()
    await lift.read()
    await elapse(1.0)
    owner.device.received.clear()
    owner.asked.clear()
    owner.reports.clear()
    try:
        yield Made(owner, link, lift, running)
    finally:
        with suppress(ExceptionGroup):
            await ended(running)


@virtual
async def test_a_press_is_sent_in_the_call_that_gives_it_and_permitted_immediately_before() -> None:
    async with read_once() as made:
        made.press()
        assert made.writes == ["write holding register 40 := 2, unit 1"]
        assert made.owner.asked == [("go_to", 0)]
        await made.settle()
        assert made.owner.outcomes == [(1, Result.CONFIRMED)]
        assert made.owner.written == [("go_to", "press", ""), ("go_to", "release", "")]


@virtual
async def test_a_press_that_is_forbidden_sends_nothing_and_is_rejected() -> None:
    async with read_once() as made:
        made.owner.forbids = "there is a fire"
        made.press()
        await made.settle()
        assert made.writes == []
        assert made.owner.outcomes == [(1, Result.REJECTED)]


@virtual
async def test_a_press_waits_for_the_answer_that_is_awaited_and_is_permitted_only_then() -> None:
    async with read_once() as made:
        made.occupy()
        made.press()
        assert (made.writes, made.owner.asked) == ([], [])
        made.owner.forbids = "there is a fire"
        await made.settle()
        assert made.writes == []


@pytest.mark.parametrize("begins", [True, False])
@virtual
async def test_a_press_is_judged_by_an_answer_that_is_here_already(begins: bool) -> None:
    async with read_once() as made:
        loop, polls = asyncio.get_running_loop(), list[asyncio.Task[None]]()

        async def poll() -> None:
            await made.lift.read()
            made.owner.forbids = "there is a fire"

        def receive(sent: bool, _: bytes) -> None:
            if not sent:
                loop.call_soon(made.press)  # before the task of the poll continues

        made.owner.device.values[Table.INPUT][1] = 2
        with made.link.tap(receive):
            if begins:
                assert made.lift.begin_read(lambda _: polls.append(asyncio.ensure_future(poll())))
            else:
                polls.append(asyncio.ensure_future(poll()))
            await elapse(1.0)
        assert (made.writes, made.owner.outcomes) == ([], [(1, Result.REJECTED)])
        await polls[0]


@virtual
async def test_a_release_that_is_due_goes_before_a_press() -> None:
    async with read_once() as made:
        made.lift.declare({HOLD_FRONT: Hold(1, now() + 10)})
        await elapse(0.2)
        made.lift.declare({})
        made.press()
        await elapse(0.1)
        assert made.writes[1:] == ["write coil 8 := off, unit 1", "write holding register 40 := 2, unit 1"]


@virtual
async def test_a_word_that_others_write_too_is_read_before_anything_is_sent() -> None:
    async with read_once(written_map(SHARED)) as made:
        made.owner.device.values[Table.HOLDING][9] = 8
        made.press()
        assert made.owner.device.received == []
        await elapse(0.1)
        assert made.writes == ["write holding register 9 := 12, unit 1"]


@virtual
async def test_a_driver_that_does_not_run_sends_nothing() -> None:
    async with read_once() as made:
        await ended(made.running[1:])
        made.press()
        await elapse(1.0)
        assert made.writes == []


@virtual
async def test_behind_the_fence_a_press_is_not_sent() -> None:
    async with read_once() as made:
        made.lift.fence(now())
        await elapse(0.1)
        made.press()
        await elapse(0.1)
        assert made.writes == []


@pytest.mark.parametrize("forbids", [None, "there is a fire"])
@virtual
async def test_a_driver_that_is_ended_at_once_reports_what_it_sent(forbids: str | None) -> None:
    async with read_once() as made:
        made.owner.forbids = forbids
        made.press()
        await ended(made.running[1:])
        cut_short = [("go_to", "press", "its answer was not awaited")]
        assert made.owner.written == (cut_short if forbids is None else [])


@virtual
async def test_a_controller_that_refuses_a_press_rejects_it() -> None:
    async with read_once() as made:
        made.owner.device.fail_next(exception(4))
        made.press()
        await made.settle()
        assert made.owner.outcomes == [(1, Result.REJECTED)]


@virtual
async def test_a_bug_before_the_bytes_leave_releases_everything_and_ends_the_driver() -> None:
    async with read_once() as made:
        made.link.declared = DeclaredWrites()
        made.press()
        await elapse(0.1)
        assert (made.writes, made.owner.outcomes) == ([], [(1, Result.UNCONFIRMED)])
        assert any(isinstance(item, DriverFailed) for item in made.owner.reports)
        await elapse(5.0)
        with pytest.raises(ExceptionGroup) as raised:
            await made.running[1]
        assert raised.group_contains(UndeclaredWrite)
