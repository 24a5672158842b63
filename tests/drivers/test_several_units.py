"""Several lifts behind one connection: what becomes of the others when the unit of one of them is silent, or slow."""

import asyncio
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from drivers.errors import AnswerTimeout, DriverError, PressRefused
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings, LinkState
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply
from drivers.model import Command, CommandKind, Result
from register_maps import frames
from register_maps.words import Table
from tests.drivers.caller import Caller
from tests.drivers.linked import now, outcome, virtual
from tests.drivers.rig import HOLD_FRONT, SIGNALS, allowed, ended
from tests.support.virtual_time import elapse
from tests.support.written_maps import written_map

UNIT_AT = 6
"""Where the unit id is in a frame."""
TEXT = (
    f"{SIGNALS}commands:\n"
    '  hold_door.front: {at: "holding:17", action: hold, max_hold_s: 30, refresh_s: 2, on_link_loss: device_watchdog,'
    " confirm: {any_of: [readback], within_s: 2}}\n"
    '  go_to: {at: "holding:16", as: floor, action: pulse, width_s: 0.5, rest: 0,'
    " confirm: {any_of: [readback, effect], within_s: 2}}\n"
)


class Gateway:
    """Devices of their own behind one connection, by unit id."""

    def __init__(self, delays_s: Iterable[float]) -> None:
        self.units = {unit: MemoryDevice(unit=unit, delay_s=delay_s) for unit, delay_s in enumerate(delays_s, start=1)}
        self.wires: list[MemoryWire] = []

    def wire(self) -> MemoryWire:
        self.wires.append(MemoryWire(self._answer))
        return self.wires[-1]

    def _answer(self, frame: bytes) -> Iterable[Reply]:
        return self.units[frame[UNIT_AT]].answer(frame)

    def fall_silent(self, *units: int) -> None:
        for unit in units:
            self.units[unit].fall_silent(1e9)


@asynccontextmanager
async def gateway(*delays_s: float) -> AsyncIterator[tuple[Gateway, Link]]:
    made = Gateway(delays_s)
    link = Link(made.wire, LinkSettings(), name="gateway")
    running = asyncio.ensure_future(link.run())
    await link.wait_up()
    try:
        yield made, link
    finally:
        await ended([running])


@dataclass
class Lifts:
    """A lift at each unit, polled at `every_s`."""

    gateway: Gateway
    link: Link
    lifts: list[Caller]
    read_at: list[list[float]] = field(default_factory=list)
    failed: list[int] = field(default_factory=list)

    async def poll(self, place: int, every_s: float) -> None:
        while True:
            began = now()
            try:
                await self.lifts[place].read()
                self.read_at[place].append(now())
            except DriverError:
                self.failed[place] += 1
            await elapse(max(0.01, began + every_s - now()))


@asynccontextmanager
async def lifts_behind(*delays_s: float, every_s: float) -> AsyncIterator[Lifts]:
    codec = written_map(TEXT)
    async with gateway(*delays_s) as (box, link):
        for device in box.units.values():
            device.values[Table.INPUT][1] = 1
        floors = {"L1": 1, "L2": 2}
        made = Lifts(
            box,
            link,
            [
                Caller(
                    ModbusLift(
                        codec, link, LiftSettings(name=f"lift {unit}", floors=floors, control=True, unit_id=unit)
                    )
                )
                for unit in box.units
            ],
            [[] for _ in delays_s],
            [0 for _ in delays_s],
        )
        work = [lift.run() for lift in made.lifts]
        running = [
            asyncio.ensure_future(part)
            for part in (*work, *(made.poll(place, every_s) for place in range(len(delays_s))))
        ]
        await elapse(5)
        try:
            yield made
        finally:
            await ended(running)


@virtual
async def test_a_reading_is_as_old_as_its_request_and_not_as_its_wait_behind_other_lifts() -> None:
    async with gateway(0.1, 0.1) as (_, link):
        lift = ModbusLift(written_map(TEXT), link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, unit_id=1))
        await lift.read()
        others = [asyncio.ensure_future(link.read(frames.read(Table.INPUT, 1, 1, 2))) for _ in range(3)]
        began = now()
        await elapse(0)
        reading = await lift.read()
        assert reading.at == pytest.approx(began + 0.3)
        await asyncio.gather(*others)


@pytest.mark.parametrize("every_s", [0.1, 0.2, 0.5, 1.0])
@virtual
async def test_a_silent_unit_takes_neither_presses_nor_readings_from_its_neighbour(every_s: float) -> None:
    async with lifts_behind(0.02, 0.02, every_s=every_s) as made:
        made.gateway.fall_silent(2)
        await elapse(3)
        since = now()
        results: list[Result] = []
        for _ in range(20):
            results.append((await made.lifts[0].press(Command(CommandKind.GO_TO, "L2"), allowed)).result)
            await elapse(1.37)
        # one press may fall to the moment before anybody else has answered
        assert results.count(Result.CONFIRMED) >= 19
        pauses = [after - before for before, after in pairwise(at for at in made.read_at[0] if at >= since)]
        # a poll is two reads, and each may wait for a time-out of the silent unit; and one more for a look at its outputs
        assert max(pauses) <= every_s + 3 * 0.29
        assert made.link.epoch == 1


@pytest.mark.parametrize("every_s", [0.1, 0.2, 0.5])
@virtual
async def test_a_hold_is_refreshed_while_the_unit_beside_it_is_silent(every_s: float) -> None:
    async with lifts_behind(0.02, 0.02, every_s=every_s) as made:
        held: list[bool] = []
        until = now() + 60
        while now() < until:
            made.lifts[0].hold(HOLD_FRONT, allowed)
            await elapse(0.1)
            if now() > until - 50:
                made.gateway.fall_silent(2)
                held.append(made.lifts[0].held(HOLD_FRONT))
        writes = [heard.at_s for heard in made.gateway.units[1].received if heard.request.is_write]
        assert max(after - before for before, after in pairwise(writes)) < 3
        assert sum(held) > 0.95 * len(held)


@virtual
async def test_each_unit_has_a_time_out_of_its_own() -> None:
    async with lifts_behind(0.02, 0.4, every_s=0.5) as made:
        await elapse(120)
        # the first polls of all, before the link was up
        assert made.failed == [0, 0]
        assert made.link.stats.timeouts == 0


@virtual
async def test_a_unit_that_answers_later_than_the_others_is_waited_for_once_that_is_known() -> None:
    async with gateway(0.02, 0.9) as (_, link):
        good = 0
        for _ in range(20):
            await link.read(frames.read(Table.HOLDING, 0, 1, 1))
            answer = await outcome(link.read(frames.read(Table.HOLDING, 0, 1, 2)))
            good += not isinstance(answer, AnswerTimeout)
            await elapse(0.5)
        assert good >= 18
        assert link.epoch == 1


def doubts(link: Link) -> bool:
    return link.in_doubt


@virtual
async def test_after_the_first_silence_nothing_is_pressed_anywhere_until_somebody_answers() -> None:
    async with gateway(0.02, 0.02) as (made, link):
        press = frames.write_register(3, 1, 1)
        for unit in made.units:
            await link.read(frames.read(Table.HOLDING, 0, 1, unit))
        made.fall_silent(2)
        assert isinstance(await outcome(link.read(frames.read(Table.HOLDING, 0, 1, 2))), AnswerTimeout)
        assert doubts(link)
        assert isinstance(await outcome(link.write(press, allowed)), PressRefused)
        await link.read(frames.read(Table.HOLDING, 0, 1, 1))
        assert not doubts(link)
        await link.write(press, allowed)
        assert isinstance(await outcome(link.write(frames.write_register(3, 1, 2), allowed)), PressRefused)
        # silent as before: that says nothing of the others
        assert isinstance(await outcome(link.read(frames.read(Table.HOLDING, 0, 1, 2))), AnswerTimeout)
        await link.write(press, allowed)
        assert made.units[1].writes == [press, press]


@virtual
async def test_a_unit_that_answers_again_may_be_told_something_at_once() -> None:
    async with gateway(0.02, 0.02) as (made, link):
        made.units[2].fall_silent(2)
        while now() < 3:
            for unit in made.units:
                await outcome(link.read(frames.read(Table.HOLDING, 0, 1, unit)))
        await link.write(frames.write_register(3, 1, 2), allowed)
        assert len(made.units[2].writes) == 1


@virtual
async def test_two_silent_units_in_a_row_do_not_end_the_connection_of_a_third() -> None:
    async with lifts_behind(0.02, 0.02, 0.02, every_s=0.2) as made:
        made.gateway.fall_silent(3)
        await elapse(2)
        made.gateway.fall_silent(2)
        await elapse(2)
        epoch = made.link.epoch
        await elapse(60)
        assert made.link.epoch == epoch


@pytest.mark.parametrize("silent_before", [(), (2,)])
@virtual
async def test_a_dead_connection_is_still_noticed_when_a_unit_was_silent_before(silent_before: tuple[int, ...]) -> None:
    async with lifts_behind(0.02, 0.02, every_s=0.2) as made:
        made.gateway.fall_silent(*silent_before)
        await elapse(5)
        epoch = made.link.epoch
        made.gateway.wires[-1].go_half_open()
        lost = now()
        while made.link.epoch == epoch or made.link.state is not LinkState.UP:
            await elapse(0.01)
        assert now() - lost < 3.5
        await elapse(1)
        assert made.read_at[0][-1] > now() - 1


@virtual
async def test_a_dead_connection_is_noticed_even_if_only_a_unit_is_asked_that_was_silent_before() -> None:
    async with gateway(0.02, 0.02) as (made, link):
        made.fall_silent(2)
        for unit in (1, 2, 1):
            await outcome(link.read(frames.read(Table.HOLDING, 0, 1, unit)))
        made.wires[-1].go_half_open()
        for _ in range(5):
            assert link.epoch == 1
            await outcome(link.read(frames.read(Table.HOLDING, 0, 1, 2)))
            await elapse(0.1)
        await link.wait_up()
        assert link.epoch == 2
