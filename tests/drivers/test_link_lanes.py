"""Who goes first, who waits for whom, and what a cancelled caller leaves behind."""

import asyncio
from itertools import pairwise

import pytest

from drivers.errors import AnswerTimeout, Delivery, PressRefused
from drivers.modbus.link import LinkSettings
from drivers.modbus.memory import MemoryDevice, late, silence
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.support.virtual_time import elapse

READ = frames.read(Table.HOLDING, 0)
PRESS = frames.write_coil(9, True)


@virtual
async def test_a_command_waits_for_the_transaction_in_flight_and_overtakes_every_queued_read() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link, asyncio.TaskGroup() as group:
        for address in range(50):
            group.create_task(link.read(frames.read(Table.HOLDING, address)))
        await elapse(0.01)
        began = now()
        await link.write(PRESS)
        assert now() - began == pytest.approx(0.01 + 0.02)
        assert [heard.request for heard in device.received[:2]] == [frames.read(Table.HOLDING, 0), PRESS]
    assert len(device.received) == 51


@virtual
async def test_each_lane_keeps_its_order() -> None:
    device = MemoryDevice(delay_s=0.01)
    reads = [frames.read(Table.HOLDING, address) for address in range(3)]
    writes = [frames.write_register(address, 1) for address in range(3)]
    async with linked(device) as link, asyncio.TaskGroup() as group:
        for read in reads:
            group.create_task(link.read(read))
        for write in writes:
            group.create_task(link.write(write))
    assert device.executed == [reads[0], *writes, *reads[1:]]


@virtual
async def test_an_urgent_read_goes_in_the_command_lane_behind_the_command_before_it() -> None:
    device = MemoryDevice(delay_s=0.01)
    look = frames.read(Table.COIL, 9)
    async with linked(device) as link, asyncio.TaskGroup() as group:
        group.create_task(link.read(READ))
        group.create_task(link.read(READ))
        group.create_task(link.write(PRESS))
        seen = group.create_task(link.read_urgent(look))
    assert device.executed == [READ, PRESS, look, READ]
    assert seen.result() == b"\x01"


@virtual
async def test_one_transaction_is_in_flight_at_a_time() -> None:
    device = MemoryDevice(delay_s=0.03)
    async with linked(device) as link, asyncio.TaskGroup() as group:
        for _ in range(4):
            group.create_task(link.read(READ))
    times = [heard.at_s for heard in device.received]
    assert [after - before for before, after in pairwise(times)] == pytest.approx([0.03] * 3)


@virtual
async def test_the_pause_between_transactions_counts_from_the_end_of_the_last_one() -> None:
    device = MemoryDevice(delay_s=0.03)
    async with linked(device, LinkSettings(min_gap_s=0.02)) as link:
        await link.read(READ)
        ended = now()
        await link.write(PRESS)
        assert device.received[-1].at_s - ended == pytest.approx(0.02)
        await elapse(5)
        began = now()
        await link.read(READ)
        assert device.received[-1].at_s == began


@virtual
async def test_the_pause_is_kept_after_a_time_out_too() -> None:
    device = MemoryDevice()
    device.fail_next(silence())
    async with linked(device, LinkSettings(min_gap_s=0.02)) as link:
        with pytest.raises(AnswerTimeout):
            await link.read(READ)
        ended = now()
        await link.read(READ)
        assert device.received[-1].at_s - ended == pytest.approx(0.02)


@virtual
async def test_the_permit_is_asked_at_the_moment_of_sending_and_not_before() -> None:
    device = MemoryDevice(delay_s=0.1)
    asked_at: list[float] = []

    def permit() -> None:
        asked_at.append(now())
        assert PRESS not in device.executed

    async with linked(device) as link, asyncio.TaskGroup() as group:
        began = now()
        group.create_task(link.read(READ))
        await asyncio.sleep(0)
        group.create_task(link.write(PRESS, permit))
    assert asked_at == [pytest.approx(began + 0.1)]
    assert device.received[-1].at_s == asked_at[0]


@virtual
async def test_a_press_that_is_no_longer_permitted_when_its_turn_comes_is_not_sent() -> None:
    device = MemoryDevice(delay_s=0.1)
    fire: list[str] = []
    async with linked(device) as link, asyncio.TaskGroup() as group:
        group.create_task(link.read(READ))
        await elapse(0.05)
        press = group.create_task(outcome(link.write(PRESS, lambda: fire[0] if fire else None)))
        behind = group.create_task(link.read(READ))
        fire.append("fire service")
    error = press.result()
    assert isinstance(error, PressRefused)
    assert (error.sent, error.reason) == (Delivery.NO, "fire service")
    assert "write coil 9 := on" in str(error)
    assert device.writes == []
    assert behind.result() == b"\x00\x00"


@virtual
async def test_a_bug_in_a_permit_reaches_its_caller_and_nobody_else() -> None:
    device = MemoryDevice(delay_s=0.1)

    def bug() -> str | None:
        raise KeyError("session")

    async with linked(device) as link, asyncio.TaskGroup() as group:
        first = group.create_task(link.read(READ))
        await asyncio.sleep(0)
        press = group.create_task(outcome(link.write(PRESS, bug)))
        behind = group.create_task(link.read(READ))
    assert isinstance(press.result(), KeyError)
    assert device.writes == []
    assert first.result() == behind.result() == b"\x00\x00"
    assert link.stats.recycles == 0


@virtual
async def test_a_caller_cancelled_while_it_queues_never_reaches_the_device() -> None:
    device = MemoryDevice(delay_s=0.1)
    async with linked(device) as link, asyncio.TaskGroup() as group:
        group.create_task(link.read(READ))
        await asyncio.sleep(0)
        press = group.create_task(link.write(PRESS))
        behind = group.create_task(link.read(READ))
        await elapse(0.05)
        press.cancel()
        await asyncio.wait([press])
        assert press.cancelled()
    assert device.writes == []
    assert behind.result() == b"\x00\x00"


@virtual
async def test_a_caller_cancelled_in_flight_keeps_the_lane_taken_until_its_answer_and_the_next_gets_its_own() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING] = {1: 111, 2: 222}
    device.fail_next(late(0.3))
    async with linked(device) as link, asyncio.TaskGroup() as group:
        began = now()
        first = group.create_task(link.read(frames.read(Table.HOLDING, 1)))
        await elapse(0.1)
        first.cancel()
        second = group.create_task(link.read(frames.read(Table.HOLDING, 2)))
    assert first.cancelled()
    assert second.result() == (222).to_bytes(2, "big")
    assert device.received[1].at_s - began == pytest.approx(0.3)
    assert (link.stats.late, link.stats.timeouts) == (0, 0)


@virtual
async def test_a_cancelled_transaction_that_is_never_answered_frees_the_lane_at_its_time_out() -> None:
    device = MemoryDevice()
    device.fail_next(silence())
    async with linked(device) as link, asyncio.TaskGroup() as group:
        began = now()
        first = group.create_task(link.read(READ))
        await elapse(0.1)
        first.cancel()
        await link.read(READ)
        assert now() - began == pytest.approx(0.5)
    assert link.stats.timeouts == 1


@virtual
async def test_a_time_out_of_the_caller_is_the_callers_own_and_not_converted() -> None:
    device = MemoryDevice(delay_s=0.3)
    async with linked(device) as link:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await link.read(READ)
        assert await link.read(READ) == b"\x00\x00"


@virtual
async def test_reads_and_writes_cannot_be_mixed_up() -> None:
    async with linked(MemoryDevice()) as link:
        with pytest.raises(ValueError, match="not a read"):
            await link.read(PRESS)
        with pytest.raises(ValueError, match="not a read"):
            await link.read_urgent(PRESS)
        with pytest.raises(ValueError, match="not a write"):
            await link.write(READ)
