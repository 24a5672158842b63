"""Each fault of the wire as a value, and what it makes of one answer."""

import math

import pytest

from register_maps import frames
from register_maps.errors import ExceptionAnswer, FrameError, Mismatch
from register_maps.frames import Request
from register_maps.words import Table
from simulator.wire_faults import (
    AnswerWithException,
    Bandwidth,
    ConnectionLimit,
    Delay,
    DropAnswer,
    DropRequest,
    DuplicateAnswer,
    EchoPart,
    GarbageAnswer,
    GarbageBefore,
    HalfOpen,
    LateAnswer,
    LongTailedDelay,
    MergeAnswers,
    ReorderAnswers,
    ResetConnection,
    SplitAnswer,
    Target,
    TruncateAnswer,
    UniformDelay,
    WireFault,
    WrongCount,
    WrongEcho,
    WrongFunction,
    WrongTransactionId,
    WrongUnit,
)
from tests.simulator.far import READ, WORDS, Far, answer_to, only, right
from tests.support.rows import each_row

# -- values


def test_a_fault_is_a_value() -> None:
    fault = Delay(0.2, times=3, on=Target(functions=(3,)))
    assert fault == Delay(0.2, times=3, on=Target(functions=(3,)))
    assert len({fault, Delay(0.2, times=3, on=Target(functions=(3,))), Delay(0.2)}) == 2
    assert repr(Delay(0.2)).startswith("Delay(times=None, probability=1.0, from_s=0.0, until_s=inf, on=Target(")


@each_row(
    ("make", "says"),
    [
        (lambda: DropRequest(times=0), "times 0"),
        (lambda: DropRequest(probability=1.1), "probability 1.1"),
        (lambda: DropRequest(from_s=2.0, until_s=2.0), "the window has no inside"),
        (lambda: Delay(-0.1), "seconds -0.1"),
        (lambda: Delay(math.inf), "seconds inf"),
        (lambda: Delay(math.nan), "seconds nan"),
        (lambda: UniformDelay(0.2, 0.1), "most_s less least_s"),
        (lambda: LongTailedDelay(0.0), "median_s 0.0"),
        (lambda: LateAnswer(-1.0), "seconds -1.0"),
        (lambda: DuplicateAnswer(-1.0), "after_s -1.0"),
        (lambda: AnswerWithException(0), "code 0"),
        (lambda: GarbageAnswer(0), "length 0"),
        (lambda: GarbageBefore(0), "length 0"),
        (lambda: TruncateAnswer(0), "cut 0"),
        (lambda: SplitAnswer(1), "pieces 1"),
        (lambda: WrongTransactionId(fixed=65536), "fixed 65536"),
        (lambda: Bandwidth(0.0), "bytes_per_s 0.0"),
        (lambda: ConnectionLimit(-1), "clients -1"),
        (lambda: Target(functions=(0,)), "function 0"),
        (lambda: Target(unit=256), "unit 256"),
        (lambda: Target(addresses=(5, 4)), "addresses 5 to 4"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(make: object, says: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=says):
        make()


# -- instead of the answer


def test_without_faults_the_answer_passes() -> None:
    far = Far()
    assert only(far.ask()) == answer_to(READ)
    assert far.struck == []


def test_a_dropped_request_is_not_heard_by_the_device_and_a_dropped_answer_is() -> None:
    far = Far(DropRequest(times=1), DropAnswer(times=1))
    assert (far.ask(), len(far.heard)) == ([], 0)
    assert (far.ask(), len(far.heard)) == ([], 1)
    assert only(far.ask()) == answer_to(READ)


@each_row("code", [1, 2, 3, 4, 5, 6, 8, 0x0A, 0x0B, 0xFF])
@each_row("executed", [False, True])
def test_an_exception_of_any_code_answers_in_the_place_of_the_device(code: int, *, executed: bool) -> None:
    far = Far(AnswerWithException(code, executed=executed))
    with pytest.raises(ExceptionAnswer) as caught:
        frames.check(READ, only(far.ask(tid=7)), tid=7)
    assert (caught.value.code, len(far.heard)) == (code, int(executed))


def test_garbage_is_never_taken_for_a_frame() -> None:
    for seed in range(50):
        far = Far(GarbageAnswer(), seed=seed)
        data = only(far.ask())
        assert len(data) == 16
        with pytest.raises(FrameError, match="protocol id"):
            frames.split(data)


def test_a_reset_ends_the_connection_and_nothing_after_it_is_heard() -> None:
    far = Far(ResetConnection(times=1))
    assert far.ask() == [(0.0, None)]
    assert far.ask(tid=2) == []
    assert far.heard == []


def test_a_reset_may_come_after_the_request_was_executed() -> None:
    far = Far(ResetConnection(executed=True))
    assert far.ask() == [(0.0, None)]
    assert len(far.heard) == 1


def test_a_half_open_connection_stays_dead_when_the_fault_is_over_and_another_lives() -> None:
    far = Far(HalfOpen(from_s=1.0, until_s=2.0))
    assert far.ask(at=0.5)
    assert far.ask(at=1.5) == []
    assert far.connection.dead
    assert far.ask(at=3.0) == []
    assert len(far.heard) == 1
    later = far.faults.connection(3.0)
    assert later.request(frames.frame(READ, 5), 3.0, far.answer)


def test_an_answer_that_comes_after_the_connection_died_does_not_pass() -> None:
    far = Far(HalfOpen(on=Target(functions=(6,))))
    ask, press = frames.frame(READ, 1), frames.frame(frames.write_register(1, 1), 2)
    assert far.connection.take(ask, 0.0).executed
    assert not far.connection.take(press, 0.1).executed
    assert far.connection.answered(right(ask), 0.2) == []


# -- the contents of the answer


@each_row(("offset", "fixed", "expected"), [(1, None, 0), (-1, None, 65534), (5, 0, 0), (1, 77, 77)])
def test_a_wrong_transaction_id_is_the_only_difference(offset: int, fixed: int | None, expected: int) -> None:
    data = only(Far(WrongTransactionId(offset, fixed)).ask(tid=65535))
    assert frames.tid_of(data) == expected
    assert data[2:] == answer_to(READ)[2:]


def mismatch(fault: WireFault, request: Request) -> str:
    """What the client's check says."""
    with pytest.raises(Mismatch) as caught:
        frames.check(request, only(Far(fault).ask(request)))
    return f"{caught.value.expected} / {caught.value.received}"


def test_a_wrong_unit_and_a_wrong_function_are_seen() -> None:
    assert mismatch(WrongUnit(), READ) == "unit 1 / unit 2"
    assert mismatch(WrongFunction(), READ) == "function 3 / function 4"


def test_the_wrong_function_of_an_exception_is_an_exception() -> None:
    far = Far(AnswerWithException(2), WrongFunction())
    assert only(far.ask())[7:] == b"\x84\x02"


@each_row(
    ("fault", "pdu"),
    [
        (WrongCount(-1), b"\x03\x04" + WORDS[:4]),
        (WrongCount(-9), b"\x03\x00"),
        (WrongCount(2), b"\x03\x0a" + WORDS + WORDS[-2:] * 2),
        (WrongCount(1, field_only=True), b"\x03\x08" + WORDS),
    ],
)
def test_a_list_of_registers_may_be_short_or_long_and_is_a_whole_frame(fault: WireFault, pdu: bytes) -> None:
    data = only(Far(fault).ask())
    assert frames.split(data) == ([data], b"")
    assert data[7:] == pdu


@pytest.mark.parametrize(("by", "pdu"), [(-1, b"\x01\x01\x00"), (1, b"\x01\x03\x00\x01\x01")])
def test_a_list_of_bits_is_short_or_long_by_bytes(by: int, pdu: bytes) -> None:
    assert only(Far(WrongCount(by)).ask(frames.read(Table.COIL, 0, 12)))[7:] == pdu


def test_a_write_of_many_tells_another_quantity() -> None:
    request = frames.write_registers(4, [1, 2, 3])
    assert only(Far(WrongCount(-1)).ask(request))[8:] == b"\x00\x04\x00\x02"


def test_where_there_is_nothing_to_change_the_fault_has_not_struck() -> None:
    far = Far(WrongCount(times=1), WrongEcho(times=1), AnswerWithException(2, times=1))
    longest = frames.read(Table.HOLDING, 0, 125)
    assert only(far.ask())[7:] == b"\x83\x02"
    assert far.struck == [AnswerWithException(2, times=1)]
    far.faults.add(WrongCount(1, times=1, on=Target(addresses=(0, 0))))
    far.faults.remove(WrongCount(times=1))
    assert only(far.ask(longest)) == answer_to(longest)
    assert only(far.ask(frames.read(Table.HOLDING, 0, 1)))[8] == 4
    assert only(far.ask(frames.write_register(1, 1))) != answer_to(frames.write_register(1, 1))


@each_row(
    ("request_", "part", "data"),
    [
        (frames.write_coil(3, True), EchoPart.VALUE, b"\x00\x03\x00\x00"),
        (frames.write_coil(3, False), EchoPart.VALUE, b"\x00\x03\xff\x00"),
        (frames.write_coil(3, True), EchoPart.ADDRESS, b"\x00\x04\xff\x00"),
        (frames.write_register(3, 7), EchoPart.VALUE, b"\x00\x03\x00\x08"),
        (frames.write_register(3, 7), EchoPart.ADDRESS, b"\x00\x04\x00\x07"),
        (frames.write_registers(3, [7, 8]), EchoPart.ADDRESS, b"\x00\x04\x00\x02"),
        (frames.mask_write(3, 1, 2), EchoPart.VALUE, b"\x00\x03\x00\x02\x00\x02"),
    ],
)
def test_a_write_echoes_another_address_or_value(request_: Request, part: EchoPart, data: bytes) -> None:
    assert only(Far(WrongEcho(part)).ask(request_))[8:] == data


def test_a_write_of_many_has_no_value_to_echo() -> None:
    far = Far(WrongEcho(EchoPart.VALUE))
    assert only(far.ask(frames.write_registers(3, [7, 8])))[8:] == b"\x00\x03\x00\x02"
    assert far.struck == []


def test_the_end_of_an_answer_may_be_missing() -> None:
    assert only(Far(TruncateAnswer(4)).ask()) == answer_to(READ)[:-4]
    far = Far(TruncateAnswer(200))
    assert far.ask() == []
    assert len(far.heard) == 1


def test_garbage_before_an_answer_is_in_one_segment_with_it() -> None:
    data = only(Far(GarbageBefore(5)).ask())
    assert data[5:] == answer_to(READ)
    with pytest.raises(FrameError, match="protocol id"):
        frames.split(data)


# -- the way of the answer


def test_an_answer_may_come_twice() -> None:
    assert Far(DuplicateAnswer(0.3)).ask() == [(0.0, answer_to(READ)), (0.3, answer_to(READ))]


def test_an_answer_may_come_in_pieces() -> None:
    replies = Far(SplitAnswer(4, 0.01)).ask()
    assert [len(data or b"") for _, data in replies] == [4, 4, 4, 3]
    assert [delay_s for delay_s, _ in replies] == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert b"".join(data or b"" for _, data in replies) == answer_to(READ)
    assert len(Far(SplitAnswer(200)).ask()) == len(answer_to(READ))


def test_later_answers_wait_behind_a_delayed_one() -> None:
    far = Far(Delay(0.5, times=1))
    ((first_s, _),) = far.ask(tid=1, at=0.0)
    ((second_s, _),) = far.ask(tid=2, at=0.1)
    assert first_s == 0.5
    assert 0.4 < second_s < 0.401
    assert far.ask(tid=3, at=1.0) == [(0.0, answer_to(READ, 3))]


def test_later_answers_overtake_a_late_one() -> None:
    far = Far(LateAnswer(5.0, times=1))
    assert far.ask(tid=1) == [(5.0, answer_to(READ, 1))]
    assert far.ask(tid=2, at=0.1) == [(0.0, answer_to(READ, 2))]


def test_segments_of_one_moment_are_a_hair_apart() -> None:
    replies = Far(DuplicateAnswer(), SplitAnswer(3, 0.0), Delay(0.1)).ask()
    times = [delay_s for delay_s, _ in replies]
    assert len(set(times)) == 6
    assert times == sorted(times)
    assert times[-1] < 0.1001


def delays(fault: WireFault, count: int, seed: int = 1) -> list[float]:
    far = Far(fault, seed=seed)
    return [far.ask(at=100.0 * nth)[0][0] for nth in range(count)]


def test_delays_follow_their_distribution_and_their_seed() -> None:
    uniform = delays(UniformDelay(0.1, 0.3), 2000)
    assert min(uniform) > 0.0999
    assert max(uniform) < 0.3001
    assert sum(uniform) / 2000 == pytest.approx(0.2, abs=0.01)
    tailed = sorted(delays(LongTailedDelay(0.1, 1.0, most_s=2.0), 2000))
    assert tailed[1000] == pytest.approx(0.1, rel=0.1)
    assert sum(delay_s > 0.2718 for delay_s in tailed) / 2000 == pytest.approx(1 / 6, abs=0.03)
    assert tailed[-1] == pytest.approx(2.0)
    assert delays(UniformDelay(0.1, 0.3), 5) == delays(UniformDelay(0.1, 0.3), 5)
    assert delays(UniformDelay(0.1, 0.3), 5) != delays(UniformDelay(0.1, 0.3), 5, seed=2)


def test_a_narrow_line_takes_its_time_for_request_and_answer() -> None:
    far = Far(Bandwidth(100.0))
    ((first_s, _),) = far.ask(tid=1)
    ((second_s, _),) = far.ask(tid=2)
    assert first_s == pytest.approx((12 + 15) / 100.0)
    assert second_s == pytest.approx((12 + 15 + 15) / 100.0)


def test_a_kept_answer_comes_after_the_next_one() -> None:
    far = Far(ReorderAnswers(times=1))
    assert far.ask(tid=1) == []
    assert far.ask(tid=2, at=0.5) == [(0.0, answer_to(READ, 2)), (0.0, answer_to(READ, 1))]
    assert far.ask(tid=3, at=0.6) == [(0.0, answer_to(READ, 3))]


def test_answers_change_places_in_pairs() -> None:
    far = Far(ReorderAnswers())
    ids = [[frames.tid_of(data or b"") for _, data in far.ask(tid=tid)] for tid in range(1, 7)]
    assert ids == [[], [2, 1], [], [4, 3], [], [6, 5]]


def test_a_merged_answer_comes_in_front_of_the_next_one_in_one_segment() -> None:
    far = Far(MergeAnswers(times=1))
    assert far.ask(tid=1) == []
    assert far.ask(tid=2, at=0.5) == [(0.0, answer_to(READ, 1) + answer_to(READ, 2))]


def test_a_kept_answer_waits_for_one_that_really_comes() -> None:
    far = Far(ReorderAnswers(times=1, on=Target(unit=1)), DropAnswer(on=Target(functions=(6,))))
    far.ask(tid=1)
    assert far.ask(frames.write_register(0, 1), tid=2) == []
    assert [frames.tid_of(data or b"") for _, data in far.ask(tid=3)] == [3, 1]


def test_a_reset_takes_the_kept_answer_with_it() -> None:
    far = Far(MergeAnswers(times=1), ResetConnection(on=Target(functions=(6,))))
    far.ask(tid=1)
    assert far.ask(frames.write_register(0, 1), tid=2) == [(0.0, None)]
    assert [exchange.answers for exchange in far.exchanges] == [(), ()]


def test_faults_shape_one_answer_in_a_fixed_order() -> None:
    faults: list[WireFault] = [Delay(0.2), SplitAnswer(2, 0.1), TruncateAnswer(1), WrongTransactionId(fixed=9)]
    forward, backward = Far(*faults).ask(), Far(*reversed(faults)).ask()
    expected = b"\x00\x09" + answer_to(READ)[2:-1]
    assert forward == backward == [(0.2, expected[:7]), (pytest.approx(0.3), expected[7:])]


def test_of_two_faults_in_the_place_of_an_answer_the_first_strikes_and_the_other_waits() -> None:
    far = Far(AnswerWithException(4, times=1), AnswerWithException(6, times=1))
    assert [only(far.ask())[8] for _ in range(3)] == [4, 6, 6]
