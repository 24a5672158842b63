"""Which answers count, which are thrown away, and which end the connection."""

import asyncio
from collections.abc import Callable

import pytest

from drivers.errors import (
    AnswerMismatch,
    AnswerTimeout,
    ConnectionLost,
    ControllerException,
    Delivery,
    LinkDown,
    UnitOffline,
)
from drivers.modbus.link import LinkSettings, LinkState, LinkStats
from drivers.modbus.memory import Fault, MemoryDevice, MemoryWire, Reply, edited, exception, late, silence, twice
from drivers.modbus.transactions import Transactions
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.support.virtual_time import elapse

READ = frames.read(Table.HOLDING, 0)
PRESS = frames.write_register(3, 1)


def pair() -> MemoryDevice:
    device = MemoryDevice()
    device.values[Table.HOLDING] = {1: 111, 2: 222}
    return device


READ_111 = frames.read(Table.HOLDING, 1)
READ_222 = frames.read(Table.HOLDING, 2)
IS_222 = (222).to_bytes(2, "big")


@virtual
async def test_a_late_answer_never_satisfies_a_later_request() -> None:
    device = pair()
    device.fail_next(late(0.6))
    device.fail_next(late(0.2))
    async with linked(device) as link:
        with pytest.raises(AnswerTimeout):
            await link.read(READ_111)
        assert await link.read(READ_222) == IS_222
        assert (link.stats.late, link.stats.desyncs, link.epoch) == (1, 0, 1)


@virtual
async def test_a_late_answer_without_transaction_ids_is_cut_off_with_its_connection() -> None:
    device = pair()
    device.fail_next(late(0.6))
    async with linked(device, LinkSettings(tid_echo=False)) as link:
        with pytest.raises(AnswerTimeout):
            await link.read(READ_111)
        assert link.state is LinkState.DOWN
        assert await link.wait_up() == 2
        assert await link.read(READ_222) == IS_222
        assert (link.stats.recycles, link.stats.late) == (1, 0)


@virtual
async def test_an_answer_given_twice_is_taken_once() -> None:
    device = pair()
    device.fail_next(twice(0.01))
    async with linked(device) as link:
        await link.read(READ_111)
        device.fail_next(late(0.05))
        assert await link.read(READ_222) == IS_222
        assert (link.stats.late, link.stats.desyncs, link.epoch) == (1, 0, 1)


@virtual
async def test_one_time_out_is_forgiven_and_says_that_nobody_knows() -> None:
    device = MemoryDevice()
    device.fail_next(silence())
    async with linked(device) as link:
        began = now()
        with pytest.raises(AnswerTimeout, match=r"lobby: write holding register 3 := 1, unit 1: no answer") as caught:
            await link.write(PRESS)
        assert now() - began == pytest.approx(0.5)
        assert caught.value.sent is Delivery.UNKNOWN
        await link.read(READ)
        assert (link.epoch, link.stats.timeouts, link.stats.recycles) == (1, 1, 0)


@virtual
async def test_two_time_outs_in_a_row_make_a_new_connection() -> None:
    device = MemoryDevice()
    device.fail_next(silence(), times=2)
    async with linked(device) as link:
        assert isinstance(await outcome(link.read(READ)), AnswerTimeout)
        assert isinstance(await outcome(link.read(READ)), AnswerTimeout)
        assert link.state is LinkState.DOWN
        assert "no answer within 1 s, twice in a row" in link.reason
        recycled = now()
        assert await link.wait_up() == 2
        assert now() - recycled == pytest.approx(0.2)
        assert link.stats.recycles == 1


@pytest.mark.parametrize("between", [late(0.0), exception(2)])
@virtual
async def test_an_answer_between_two_time_outs_keeps_the_connection(between: Fault) -> None:
    device = MemoryDevice()
    for fault in (silence(), between, silence()):
        device.fail_next(fault)
    async with linked(device) as link:
        for _ in range(3):
            await outcome(link.read(READ))
        await link.read(READ)
        assert (link.epoch, link.stats.timeouts) == (1, 2)


@virtual
async def test_a_recycle_tells_everyone_who_waits_and_sends_nothing_of_it_later() -> None:
    device = MemoryDevice()
    device.fail_next(silence(executes=False), times=2)
    async with linked(device) as link, asyncio.TaskGroup() as group:
        reads = [group.create_task(outcome(link.read(READ))) for _ in range(3)]
        await elapse(0.6)
        press = group.create_task(outcome(link.write(PRESS)))
        await asyncio.wait([*reads, press])
        assert [type(read.result()) for read in reads] == [AnswerTimeout, AnswerTimeout, LinkDown]
        error = press.result()
        assert isinstance(error, LinkDown)
        assert error.sent is Delivery.NO
        await link.wait_up()
        await elapse(10)
        assert device.executed == []
        assert len(device.received) == 2


@virtual
async def test_a_write_without_an_answer_is_never_sent_again() -> None:
    device = MemoryDevice()
    device.fail_next(silence(), times=2)
    async with linked(device) as link:
        for _ in range(2):
            with pytest.raises(AnswerTimeout):
                await link.write(PRESS)
        await link.wait_up()
        await elapse(10)
        assert device.writes == [PRESS, PRESS]


def swap_tid(tid: int) -> Callable[[bytes], bytes]:
    return lambda answer: tid.to_bytes(2, "big") + answer[2:]


@pytest.mark.parametrize("tid", [0, 7777])
@virtual
async def test_a_transaction_id_that_was_never_given_out_ends_the_connection(tid: int) -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        await link.read(READ)
        device.fail_next(edited(swap_tid(tid)))
        with pytest.raises(AnswerMismatch, match=f"transaction id {tid}") as caught:
            await link.write(PRESS)
        assert caught.value.sent is Delivery.UNKNOWN
        assert ("tid_echo: false" in str(caught.value)) == (tid == 0)
        assert (link.state, link.stats.desyncs, link.stats.recycles) == (LinkState.DOWN, 1, 1)
        assert await link.wait_up() == 2


@virtual
async def test_a_device_that_does_not_return_transaction_ids_is_served_when_this_is_said() -> None:
    device = MemoryDevice()
    device.fail_next(edited(swap_tid(0)), times=2)
    async with linked(device, LinkSettings(tid_echo=False)) as link:
        await link.read(READ)
        await link.write(PRESS)
        assert link.stats.desyncs == 0


@pytest.mark.parametrize("tid_echo", [True, False])
@virtual
async def test_an_answer_that_nobody_asked_for_ends_the_connection(tid_echo: bool) -> None:
    device = MemoryDevice()
    async with linked(device, LinkSettings(tid_echo=tid_echo)) as link:
        device.send_unrequested(frames.answer(READ, 9, b"\x00\x07"))
        assert link.state is LinkState.DOWN
        assert "an unrequested answer, transaction id 9" in link.reason


@pytest.mark.parametrize(
    "spoil",
    [
        lambda answer: answer[:9] + b"\x09" + answer[10:],
        lambda answer: answer[:-1] + b"\x09",
        lambda answer: answer[:7] + b"\x05" + answer[8:],
        lambda answer: answer[:6] + b"\xff" + answer[7:],
        lambda answer: answer[:5] + b"\x05" + answer[6:-1],
    ],
    ids=["another address", "another value", "another function", "another unit", "one byte short"],
)
@virtual
async def test_a_wrong_echo_of_a_write_ends_the_connection(spoil: Callable[[bytes], bytes]) -> None:
    device = MemoryDevice()
    device.fail_next(edited(spoil))
    async with linked(device) as link:
        with pytest.raises(AnswerMismatch, match="write holding register 3 := 1") as caught:
            await link.write(PRESS)
        assert caught.value.sent is Delivery.UNKNOWN
        assert link.stats.desyncs == 1
        assert await link.wait_up() == 2
        assert device.writes == [PRESS]


@virtual
async def test_bytes_that_are_not_modbus_end_the_connection() -> None:
    device = MemoryDevice()
    device.fail_next(edited(lambda _: b"HTTP/1.1 400 Bad Request"))
    async with linked(device) as link:
        with pytest.raises(ConnectionLost, match="not Modbus/TCP: protocol id") as caught:
            await link.read(READ)
        assert caught.value.sent is Delivery.UNKNOWN
        assert await link.wait_up() == 2


@virtual
async def test_half_an_answer_is_waited_for_and_its_other_half_completes_it() -> None:
    device = pair()
    device.fail_next(Fault(lambda _, answer: ((0.0, answer[:5]), (0.1, answer[5:9]), (0.2, answer[9:]))))
    async with linked(device) as link:
        assert await link.read(READ_222) == IS_222


@virtual
async def test_the_second_half_of_a_late_answer_does_not_disturb_the_next_one() -> None:
    device = pair()
    device.fail_next(Fault(lambda _, answer: ((0.4, answer[:5]), (0.6, answer[5:]))))
    device.fail_next(late(0.3))
    async with linked(device) as link:
        assert isinstance(await outcome(link.read(READ_111)), AnswerTimeout)
        assert await link.read(READ_222) == IS_222
        # what began before a request was sent is thrown away by the wire, before anybody counts it
        assert (link.stats.late, link.stats.desyncs, link.epoch) == (0, 0, 1)


@virtual
async def test_a_late_answer_and_the_right_one_in_one_segment_are_told_apart() -> None:
    device = pair()
    held: list[bytes] = []

    def hold_back(_: bytes, answer: bytes) -> tuple[()]:
        held.append(answer)
        return ()

    device.fail_next(Fault(hold_back))
    device.fail_next(Fault(lambda _, answer: ((0.1, held[0] + answer),)))
    async with linked(device) as link:
        assert isinstance(await outcome(link.read(READ_111)), AnswerTimeout)
        assert await link.read(READ_222) == IS_222


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5])
@virtual
async def test_an_exception_answer_is_told_with_its_code_and_name_and_the_connection_stays(code: int) -> None:
    device = MemoryDevice()
    device.fail_next(exception(code), times=2)
    async with linked(device) as link:
        for asking in (link.read(READ), link.write(PRESS)):
            with pytest.raises(ControllerException, match=rf"lobby: .*exception 0{code} \(") as caught:
                await asking
            assert (caught.value.code, caught.value.sent) == (code, Delivery.YES)
        assert len(device.received) == 2
        assert (link.epoch, link.stats.exceptions) == (1, 2)


@virtual
async def test_a_busy_answer_to_a_write_is_reported_as_not_sent_and_not_repeated() -> None:
    device = MemoryDevice()
    device.fail_next(exception(6))
    async with linked(device) as link:
        with pytest.raises(ControllerException) as caught:
            await link.write(PRESS)
        assert (caught.value.code, caught.value.sent) == (6, Delivery.NO)
        await elapse(10)
        assert len(device.received) == 1


@virtual
async def test_a_busy_answer_to_a_read_is_asked_again_after_a_pause() -> None:
    device = pair()
    device.fail_next(exception(6), times=3)
    async with linked(device) as link:
        began = now()
        assert await link.read(READ_222) == IS_222
        assert [heard.at_s - began for heard in device.received] == pytest.approx([0.0, 0.05, 0.1, 0.15])


@virtual
async def test_a_read_is_asked_again_only_so_often() -> None:
    device = MemoryDevice()
    device.fail_next(exception(6), times=9)
    async with linked(device, LinkSettings(busy_retries=2)) as link:
        with pytest.raises(ControllerException, match="busy"):
            await link.read(READ)
        assert len(device.received) == 3


@virtual
async def test_a_command_does_not_wait_while_reads_pause_for_a_busy_device() -> None:
    device = MemoryDevice()
    device.fail_next(exception(6), on=lambda request: not request.is_write)
    async with linked(device, LinkSettings(busy_pause_s=0.4)) as link, asyncio.TaskGroup() as group:
        began = now()
        first = group.create_task(link.read(READ_111))
        second = group.create_task(link.read(READ_222))
        await elapse(0.1)
        await link.write(PRESS)
        assert now() - began == pytest.approx(0.1)
        assert not second.done()
    assert first.done()
    assert [heard.request for heard in device.received] == [READ_111, PRESS, READ_111, READ_222]


@pytest.mark.parametrize(("code", "sent"), [(0x0A, Delivery.NO), (0x0B, Delivery.UNKNOWN)])
@virtual
async def test_a_gateway_that_cannot_reach_a_unit_keeps_the_connection(code: int, sent: Delivery) -> None:
    device = MemoryDevice()
    device.fail_next(exception(code), times=3)
    async with linked(device) as link:
        for _ in range(3):
            with pytest.raises(UnitOffline, match="gateway") as caught:
                await link.write(PRESS)
            assert caught.value.sent is sent
        await link.read(READ)
        assert (link.epoch, link.stats.recycles) == (1, 0)


@virtual
async def test_transaction_ids_run_from_1_to_65535_and_never_through_0() -> None:
    tids: list[int] = []

    def answer(frame: bytes) -> list[tuple[float, bytes | None]]:
        tids.append(frames.tid_of(frame))
        return [(0.0, frames.answer(READ, tids[-1], b"\x00\x00"))]

    wire = MemoryWire(answer)
    transactions = Transactions(
        "lobby", LinkSettings(), LinkStats(), wire, last_tid=65533, on_broken=pytest.fail, on_proved=lambda: None
    )
    await wire.open(transactions.on_frame, pytest.fail, timeout_s=1)
    for _ in range(4):
        await transactions.read(READ)
    assert tids == [65534, 65535, 1, 2]


@pytest.mark.parametrize(
    ("last_tid", "asked_before", "tid", "late"),
    [
        (0, 300, 299, True),
        (0, 300, 45, True),
        (0, 300, 44, False),  # 256 requests back
        (100, 1, 101, True),
        (100, 1, 100, False),  # of the connection before
        (65533, 4, 65534, True),
        (65533, 4, 0, False),
        (65533, 4, 65533, False),
    ],
)
@virtual
async def test_only_an_answer_to_a_recent_request_of_this_connection_is_late(
    last_tid: int, asked_before: int, tid: int, late: bool
) -> None:
    broken: list[str] = []
    stats = LinkStats()
    wire = MemoryWire(lambda frame: [(0.0, frames.answer(READ, frames.tid_of(frame), b"\x00\x00"))])
    transactions = Transactions(
        "lobby", LinkSettings(), stats, wire, last_tid=last_tid, on_broken=broken.append, on_proved=lambda: None
    )
    await wire.open(transactions.on_frame, pytest.fail, timeout_s=1)
    for _ in range(asked_before):
        await transactions.read(READ)
    wire.deliver(frames.answer(READ, tid, b"\x00\x00"))
    assert (stats.late, stats.desyncs, len(broken)) == ((1, 0, 0) if late else (0, 1, 1))


@virtual
async def test_a_new_connection_goes_on_with_the_transaction_ids_of_the_last() -> None:
    device = MemoryDevice()
    tids: list[int] = []

    def note_tid(request: bytes, answer: bytes) -> list[Reply]:
        tids.append(frames.tid_of(request))
        return [(0.0, answer)]

    device.fail_next(Fault(note_tid), times=3)
    async with linked(device) as link:
        await link.read(READ)
        await link.read(READ)
        device.disconnect()
        await link.wait_up()
        await link.read(READ)
    assert tids == [1, 2, 3]
