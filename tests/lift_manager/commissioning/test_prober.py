"""The prober: one read at a time, nothing repeated, nothing hidden, and nothing written."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

import pytest

from drivers.errors import ConnectFailed, ConnectProblem, ControllerTaken
from drivers.modbus.controller_lock import controller_lock
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply, edited, exception, hang_up, late, silence
from drivers.modbus.wire import Wire
from lift_manager.commissioning.prober import GAP_S, TIMEOUT_S, Identity, Prober, open_prober
from register_maps.errors import BadRequest
from register_maps.words import Table
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual


def probed(device: MemoryDevice, work: Callable[[Prober], Awaitable[None]], *, unit: int = 1) -> None:
    """Run `work` with a prober of a controller in memory, on virtual time."""

    async def main() -> None:
        prober = Prober(device.wire(), unit=unit)
        await work(prober)
        prober.close()

    run_virtual(main)


def now() -> float:
    return asyncio.get_running_loop().time()


def test_registers_come_as_numbers_and_bits_as_0_and_1() -> None:
    device = MemoryDevice(delay_s=0.02)
    device.values[Table.HOLDING] |= {5: 7, 6: 0xFFFF}
    device.values[Table.DISCRETE] |= {9: 1}

    async def work(prober: Prober) -> None:
        registers = await prober.read(Table.HOLDING, 5, 2)
        assert registers.values == (7, 0xFFFF)
        assert registers.took_s == pytest.approx(0.02)
        assert registers.echoes_tid
        assert not registers.trouble
        assert (await prober.read(Table.DISCRETE, 8, 3)).values == (0, 1, 0)
        assert (prober.connects, prober.requests, prober.peer) == (1, 2, "memory")

    probed(device, work)
    assert device.writes == []


def test_an_exception_is_an_answer_and_keeps_the_connection() -> None:
    device = MemoryDevice(served={Table.HOLDING: [(0, 3)]})

    async def work(prober: Prober) -> None:
        refused = await prober.read(Table.HOLDING, 4)
        assert (refused.values, refused.exception, refused.trouble) == (None, 2, "")
        assert (await prober.read(Table.HOLDING, 3)).values == (0,)
        assert (await prober.read(Table.HOLDING, 3, unit=9)).exception == 0x0B
        assert prober.connects == 1

    probed(device, work)


def test_silence_costs_the_time_limit_and_the_next_read_connects_again() -> None:
    device = MemoryDevice()
    device.fail_next(silence())

    async def work(prober: Prober) -> None:
        unanswered = await prober.read(Table.HOLDING, 0)
        assert (unanswered.values, unanswered.exception) == (None, None)
        assert unanswered.trouble == "no answer within 2 s"
        assert unanswered.took_s == TIMEOUT_S
        assert (await prober.read(Table.HOLDING, 0)).values == (0,)
        assert prober.connects == 2

    probed(device, work)


def test_an_answer_that_comes_too_late_is_not_taken_for_that_to_the_next_read() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING] |= {0: 111, 1: 222}
    device.fail_next(late(TIMEOUT_S + 2 * GAP_S))
    device.fail_next(late(0.5))

    async def work(prober: Prober) -> None:
        assert (await prober.read(Table.HOLDING, 0)).trouble
        assert (await prober.read(Table.HOLDING, 1)).values == (222,)

    probed(device, work)


def test_a_read_that_was_cancelled_leaves_its_answer_to_nobody() -> None:
    device = MemoryDevice()
    device.values[Table.HOLDING] |= {0: 111, 1: 222}
    device.fail_next(late(0.3))
    device.fail_next(late(0.5))

    async def work(prober: Prober) -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await prober.read(Table.HOLDING, 0)
        assert (await prober.read(Table.HOLDING, 1)).values == (222,)

    probed(device, work)


def other_function(answer: bytes) -> bytes:
    return answer[:7] + bytes([4]) + answer[8:]


def one_register_less(answer: bytes) -> bytes:
    return answer[:5] + bytes([answer[5] - 2, *answer[6:8], answer[8] - 2]) + answer[9:-2]


@each_row("edit, expected", [(other_function, "function 4"), (one_register_less, "03 02 00 00")])
def test_an_answer_that_does_not_fit_is_trouble_and_ends_the_connection(
    edit: Callable[[bytes], bytes], expected: str
) -> None:
    device = MemoryDevice()
    device.fail_next(edited(edit))

    async def work(prober: Prober) -> None:
        wrong = await prober.read(Table.HOLDING, 0, 2)
        assert wrong.values is None
        assert expected in wrong.trouble
        assert (await prober.read(Table.HOLDING, 0, 2)).values == (0, 0)
        assert prober.connects == 2

    probed(device, work)


def test_an_answer_under_another_transaction_id_counts_and_is_marked() -> None:
    device = MemoryDevice()
    device.fail_next(edited(lambda answer: bytes(2) + answer[2:]), times=2)
    device.fail_next(exception(6), times=1)

    async def work(prober: Prober) -> None:
        answer = await prober.read(Table.HOLDING, 0)
        assert (answer.values, answer.echoes_tid) == ((0,), False)
        assert not (await prober.read(Table.HOLDING, 0)).echoes_tid
        busy = await prober.read(Table.HOLDING, 0)
        assert (busy.exception, busy.echoes_tid) == (6, True)

    probed(device, work)


def test_a_connection_that_breaks_is_trouble_in_a_read_and_nothing_between_two() -> None:
    device = MemoryDevice()
    device.fail_next(hang_up())

    async def work(prober: Prober) -> None:
        assert (await prober.read(Table.HOLDING, 0)).trouble == "the controller closed the connection"
        assert (await prober.read(Table.HOLDING, 0)).values == (0,)
        device.disconnect()
        assert (await prober.read(Table.HOLDING, 0)).values == (0,)
        assert prober.connects == 3

    probed(device, work)


def test_there_is_a_pause_after_every_answer_and_after_a_failed_connection() -> None:
    device = MemoryDevice(delay_s=0.01)

    async def work(prober: Prober) -> None:
        began = now()
        for _ in range(5):
            await prober.read(Table.HOLDING, 0)
        assert now() - began == pytest.approx(5 * 0.01 + 4 * GAP_S)
        prober.close()
        device.connect_problem = ConnectProblem.REFUSED
        began = now()
        for _ in range(5):
            with pytest.raises(ConnectFailed):
                await prober.read(Table.HOLDING, 0)
        assert now() - began == pytest.approx(5 * GAP_S)

    probed(device, work)


def test_reads_of_two_callers_take_turns() -> None:
    device = MemoryDevice(delay_s=0.1)
    device.values[Table.HOLDING] |= {0: 111, 1: 222}

    async def work(prober: Prober) -> None:
        one, other = await asyncio.gather(prober.read(Table.HOLDING, 0), prober.read(Table.HOLDING, 1))
        assert (one.values, other.values) == ((111,), (222,))

    probed(device, work)


def test_unrequested_bytes_between_two_reads_are_no_answer() -> None:
    device = MemoryDevice(delay_s=0.01)
    device.values[Table.HOLDING] |= {0: 1}

    async def work(prober: Prober) -> None:
        await prober.read(Table.HOLDING, 0)
        device.send_unrequested(bytes.fromhex("0002 0000 0005 01 03 02 0009"))
        assert (await prober.read(Table.HOLDING, 0)).values == (1,)

    probed(device, work)


def test_a_tap_sees_every_frame_while_it_lasts() -> None:
    device = MemoryDevice()
    frames: list[tuple[bool, str]] = []

    async def work(prober: Prober) -> None:
        with prober.tap(lambda sent, frame: frames.append((sent, frame.hex(" ")))):
            await prober.read(Table.HOLDING, 5)
        await prober.read(Table.HOLDING, 6)

    probed(device, work)
    assert frames == [(True, "00 01 00 00 00 06 01 03 00 05 00 01"), (False, "00 01 00 00 00 05 01 03 02 00 00")]


IDENTIFICATION = {
    "01 00": "01 02 FF 02 02 00 02 41 42 01 01 43",  # "AB" and "C", the next one is 2
    "01 02": "01 02 00 00 01 02 02 56 31",  # "V1"
    "02 00": "02 02 00 00 02 00 02 41 42 06 01 78",  # "AB", and "x" as the application
}


def identified(answers: Mapping[str, str | None], *, unit: int = 1) -> tuple[Identity, list[str]]:
    """Return what a prober makes of these answers by request, and the requests; None hangs up, a missing one is silence."""
    requests: list[str] = []

    def answer(frame: bytes) -> list[Reply]:
        requests.append(frame[9:].hex(" ").upper())
        if requests[-1] not in answers:
            return []
        given = answers[requests[-1]]
        if given is None:
            return [(0.0, None)]
        if given.startswith("AB"):
            return [(0.0, frame[:5] + bytes((3, frame[6])) + bytes.fromhex(given))]
        body = bytes((frame[6], 0x2B, 0x0E)) + bytes.fromhex(given)
        return [(0.0, frame[:5] + bytes((len(body),)) + body)]

    async def main() -> Identity:
        prober = Prober(MemoryWire(answer))
        found = await prober.identify(unit=unit)
        prober.close()
        return found

    return run_virtual(main), requests


def test_an_identity_is_read_in_as_many_parts_as_it_comes_and_regular_objects_where_there_are_some() -> None:
    found, requests = identified(IDENTIFICATION)
    assert found == Identity({"vendor": "AB", "product_code": "C", "revision": "V1", "application": "x"})
    assert requests == ["01 00", "01 02", "02 00"]


@each_row(
    ("answers", "expected"),
    [
        ({"01 00": "AB 01"}, Identity(exception=1)),
        ({"01 00": "01 01 00 00 00"}, Identity()),
        ({"01 00": "01 01 00 00 01 00 01 41"}, Identity({"vendor": "A"})),
        ({}, Identity(trouble="no answer within 2 s")),
        ({"01 00": None}, Identity(trouble="the controller closed the connection")),
        # what the first answer had is kept when the rest fails, or when the next one is said to begin before it
        ({"01 00": "01 02 00 00 01 00 01 41", "02 00": "AB 03"}, Identity({"vendor": "A"}, exception=3)),
        ({"01 00": "01 01 FF 00 01 00 01 41"}, Identity({"vendor": "A"})),
    ],
)
def test_a_controller_may_have_no_identity_or_only_a_part_of_one(
    answers: Mapping[str, str | None], expected: Identity
) -> None:
    assert identified(answers)[0] == expected


def test_an_identity_that_does_not_fit_is_trouble() -> None:
    found, _ = identified({"01 00": "02 01 00 00 00"})
    assert found.texts == {}
    assert "read device identification, unit 1: expected unit 1 and 2b 0e 01" in found.trouble


def test_what_the_specification_does_not_allow_is_not_sent() -> None:
    device = MemoryDevice()

    async def work(prober: Prober) -> None:
        with pytest.raises(BadRequest):
            await prober.read(Table.HOLDING, 0, 126)

    probed(device, work)
    assert device.received == []


def opened(device: MemoryDevice, folder: Path, host: str = "plc") -> None:
    def wire(_host: str, _port: int) -> Wire:
        return device.wire()

    async def main() -> None:
        async with open_prober(host, 502, unit=3, make_wire=wire, temporary=folder) as prober:
            assert (await prober.read(Table.HOLDING, 0)).values == (0,)
            await elapse(1.0)
        assert not any(frame.request.is_write for frame in device.received)

    run_virtual(main)


def test_it_holds_the_lock_of_the_controller_while_it_is_open_and_no_longer(tmp_path: Path) -> None:
    device = MemoryDevice(unit=3)
    opened(device, tmp_path)
    with controller_lock("plc", 502, temporary=tmp_path), pytest.raises(ControllerTaken):
        opened(device, tmp_path)
    opened(device, tmp_path)
    assert device.connects == 2


def test_a_controller_of_this_computer_is_the_same_by_name_and_by_address(tmp_path: Path) -> None:
    with controller_lock("127.0.0.1", 502, temporary=tmp_path), pytest.raises(ControllerTaken):
        opened(MemoryDevice(unit=3), tmp_path, "localhost")


def test_a_controller_that_refuses_leaves_no_lock_behind(tmp_path: Path) -> None:
    device = MemoryDevice(unit=3)
    device.connect_problem = ConnectProblem.REFUSED
    with pytest.raises(ConnectFailed):
        opened(device, tmp_path)
    device.connect_problem = None
    opened(device, tmp_path)
