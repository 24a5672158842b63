"""When faults of the wire strike, what they tell of it, and what becomes of connections."""

import dataclasses
import random

import pytest

from register_maps import frames
from register_maps.words import Table
from simulator.wire_faults import (
    WIRE_FAULTS,
    AcceptAndSayNothing,
    Access,
    AnswerWithException,
    Bandwidth,
    ConnectionLimit,
    ConnectOutcome,
    Delay,
    DropAnswer,
    DropRequest,
    DuplicateAnswer,
    Exchange,
    GarbageAnswer,
    GarbageBefore,
    HalfOpen,
    LateAnswer,
    LongTailedDelay,
    MergeAnswers,
    RefuseConnections,
    ReorderAnswers,
    Reply,
    ResetConnection,
    SplitAnswer,
    Target,
    TruncateAnswer,
    UniformDelay,
    WireFault,
    WireFaults,
    WrongCount,
    WrongEcho,
    WrongFunction,
    WrongTransactionId,
    WrongUnit,
    faulty,
)
from tests.simulator.far import READ, Far, answer_to, only, right
from tests.support.rows import each_row

# -- limits


def test_a_count_ends_a_fault() -> None:
    far = Far(DropRequest(times=2))
    assert [len(far.ask()) for _ in range(4)] == [0, 0, 1, 1]


def test_a_window_counts_from_the_start_of_the_engine() -> None:
    engine = WireFaults([DropRequest(from_s=1.0, until_s=2.0)])
    engine.begin(100.0)
    engine.begin(500.0)
    connection = engine.connection(100.0)
    passed = [connection.take(frames.frame(READ, 1), at).executed for at in (100.9, 101.0, 101.9, 102.0)]
    assert passed == [True, False, False, True]


def test_chance_is_the_seeds_and_each_fault_has_its_own() -> None:
    def pattern(*faults: WireFault, seed: int = 3) -> list[bool]:
        far = Far(*faults, seed=seed)
        return [bool(far.ask()) for _ in range(400)]

    fault = DropRequest(probability=0.25)
    alone = pattern(fault)
    assert 240 < sum(alone) < 360
    assert pattern(fault) == alone
    assert pattern(fault, seed=4) != alone
    assert pattern(DuplicateAnswer(probability=0.5), UniformDelay(0.0, 0.1), fault) == alone
    assert not any(pattern(DropRequest(), fault))
    assert all(pattern(DropRequest(probability=0.0)))


@each_row(
    ("target", "covered"),
    [
        (Target(), "rcwmu"),
        (Target(functions=(3,)), "r"),
        (Target(functions=(6, 0x2B)), "wu"),
        (Target(table=Table.HOLDING), "rwm"),
        (Target(table=Table.COIL), "c"),
        (Target(addresses=(0, 9)), "c"),
        (Target(addresses=(12, 12)), "rm"),
        (Target(addresses=(13, 19)), "m"),
        (Target(access=Access.READS), "r"),
        (Target(access=Access.WRITES), "cwm"),
        (Target(unit=2), "w"),
        (Target(unit=2, access=Access.READS), ""),
    ],
)
def test_a_target_covers_what_meets_all_its_conditions(target: Target, covered: str) -> None:
    asked = {
        "r": frames.frame(READ, 1),
        "c": frames.frame(frames.pulse_coil(3, 20), 1),
        "w": frames.frame(frames.write_register(20, 1, unit=2), 1),
        "m": frames.frame(frames.write_registers(12, [1, 2, 3]), 1),
        "u": bytes.fromhex("0001 0000 0005 01 2b 0e 01 00"),
    }
    assert "".join(name for name, frame in asked.items() if target.covers(frame)) == covered


def test_faults_come_and_go_while_it_runs() -> None:
    far = Far()
    far.faults.add(DropRequest())
    assert far.ask() == []
    assert far.faults.faults == (DropRequest(),)
    far.faults.remove(DropRequest())
    assert only(far.ask()) == answer_to(READ)
    with pytest.raises(ValueError, match="is not set"):
        far.faults.remove(DropRequest())
    far.faults.add(DropAnswer())
    far.faults.clear()
    assert only(far.ask()) == answer_to(READ)


# -- what it tells


def test_it_tells_what_struck_when_and_whom() -> None:
    far = Far(DropAnswer(times=1))
    far.faults.add(RefuseConnections(times=1))
    far.ask(at=1.5)
    far.faults.connection(2.0)
    assert [(struck.at, struck.fault, struck.about) for struck in far.faults.strikes] == [
        (1.5, DropAnswer(times=1), "read 3 holding registers from 10, unit 1"),
        (2.0, RefuseConnections(times=1), "an attempt to connect"),
    ]


HONEST = {Delay, UniformDelay, LongTailedDelay, LateAnswer, SplitAnswer, Bandwidth, ReorderAnswers, MergeAnswers}
ONE_OF_EACH: list[WireFault] = [
    DropRequest(), DropAnswer(), AnswerWithException(4), GarbageAnswer(), ResetConnection(), HalfOpen(),
    WrongTransactionId(), WrongUnit(), WrongFunction(), WrongCount(), WrongEcho(), TruncateAnswer(), GarbageBefore(),
    DuplicateAnswer(), SplitAnswer(), Delay(0.1), UniformDelay(0.1, 0.2), LongTailedDelay(0.1), LateAnswer(),
    Bandwidth(1000.0), ReorderAnswers(), MergeAnswers(),
]  # fmt: skip
CONNECTION_FAULTS = {RefuseConnections, AcceptAndSayNothing, ConnectionLimit}


def test_one_of_each_is_one_of_each() -> None:
    assert {type(fault) for fault in ONE_OF_EACH} | CONNECTION_FAULTS == set(WIRE_FAULTS)


@each_row("fault", ONE_OF_EACH)
def test_every_exchange_is_told_and_honest_only_if_the_bytes_are_the_devices(fault: WireFault) -> None:
    far = Far(fault)
    request = frames.write_register(1, 5) if isinstance(fault, WrongEcho) else READ
    came = [(at + delay_s, data) for at in (1.0, 2.0) for delay_s, data in far.ask(request, int(at), at=at)]
    far.connection.close(9.0)
    first, second = sorted(far.exchanges, key=lambda exchange: exchange.sent_at)
    assert [far.exchanges[0].request[1], far.exchanges[1].request[1]] in ([1, 2], [2, 1])
    assert (first.sent_at, second.sent_at) == (1.0, 2.0)
    assert first.faults == (fault,)
    assert first.honest == (type(fault) in HONEST)
    heard = {frames.tid_of(frame) for frame in far.heard}
    assert (first.executed, second.executed) == (1 in heard, 2 in heard)
    assert (first.right is not None) == first.executed
    told = b"".join(data for exchange in (first, second) for _, data in exchange.answers)
    assert sorted(told) == sorted(b"".join(data for _, data in came if data))
    assert {at for exchange in far.exchanges for at, _ in exchange.answers} == {at for at, data in came if data}


def test_an_exchange_whose_answer_never_came_is_told_at_the_end() -> None:
    far = Far()
    assert far.connection.take(frames.frame(READ, 1), 0.5).executed
    assert far.exchanges == []
    far.connection.close(3.0)
    far.connection.close(3.0)
    (exchange,) = far.exchanges
    assert (exchange.executed, exchange.right, exchange.answers, exchange.honest) == (True, None, (), False)


def test_a_device_in_memory_that_says_nothing_is_told_at_once() -> None:
    far = Far()
    assert far.connection.request(frames.frame(READ, 1), 0.0, lambda _: ()) == []
    assert [exchange.right for exchange in far.exchanges] == [None]


# -- answers and their requests


def test_answers_find_their_requests_by_transaction_id_in_whatever_order_they_come() -> None:
    far = Far(DropAnswer(on=Target(addresses=(50, 50))))
    ask, other = frames.frame(READ, 1), frames.frame(frames.read(Table.HOLDING, 50), 2)
    for frame in (other, ask):
        assert far.connection.take(frame, 0.0).executed
    assert only(far.connection.answered(right(ask), 0.1)) == right(ask)
    assert far.connection.answered(right(other), 0.2) == []


def test_the_answer_of_a_device_that_returns_no_transaction_id_belongs_to_the_oldest_that_it_fits() -> None:
    far = Far(DropAnswer(on=Target(functions=(6,))))
    press, ask = frames.write_register(1, 1), READ
    for tid, request in ((1, ask), (2, press)):
        far.connection.take(frames.frame(request, tid), 0.0)
    assert far.connection.answered(answer_to(press, 0), 0.1) == []
    assert only(far.connection.answered(answer_to(ask, 0), 0.2)) == answer_to(ask, 0)


def test_an_answer_nobody_asked_for_passes() -> None:
    assert only(Far(DropAnswer()).connection.answered(answer_to(READ, 77), 0.0)) == answer_to(READ, 77)


def test_a_device_that_never_answers_does_not_fill_the_memory() -> None:
    far = Far()
    for tid in range(1000):
        far.connection.take(frames.frame(READ, tid), float(tid))
    assert [exchange.sent_at for exchange in far.exchanges] == [float(tid) for tid in range(1000 - 256)]


def test_the_devices_own_delay_and_its_own_end_of_the_connection_pass() -> None:
    far = Far(Delay(0.1))
    replies = far.connection.request(frames.frame(READ, 1), 0.0, lambda frame: [(0.2, right(frame)), (0.5, None)])
    assert replies == [(pytest.approx(0.3), answer_to(READ)), (0.5, None)]
    assert far.ask(tid=2, at=0.6) == []


def test_a_request_of_an_unknown_function_passes_and_can_be_struck() -> None:
    identify = bytes.fromhex("0005 0000 0005 01 2b 0e 01 00")
    told = bytes.fromhex("0005 0000 0006 01 2b 0e 01 01 00")
    far = Far(WrongTransactionId(on=Target(functions=(0x2B,)), times=1))
    wrong = far.connection.request(identify, 0.0, lambda _: [(0.0, told)])
    assert only(wrong) == b"\x00\x06" + told[2:]
    assert only(far.connection.request(identify, 0.0, lambda _: [(0.0, told)])) == told


# -- connections


def test_connections_may_be_refused_or_accepted_in_silence() -> None:
    engine = WireFaults([RefuseConnections(times=1), AcceptAndSayNothing(times=1)])
    admissions = [engine.connection(0.0).admission for _ in range(3)]
    assert admissions == [ConnectOutcome.REFUSED, ConnectOutcome.SILENT, ConnectOutcome.ADMITTED]


def test_a_connection_accepted_in_silence_hears_nothing_even_when_the_fault_is_over() -> None:
    far = Far(AcceptAndSayNothing())
    far.faults.clear()
    assert far.ask() == []
    assert far.heard == []
    assert far.connection.dead


def test_a_limit_keeps_more_clients_out_until_one_has_gone() -> None:
    for silent, turned_away in ((False, ConnectOutcome.REFUSED), (True, ConnectOutcome.SILENT)):
        engine = WireFaults([ConnectionLimit(2, silent=silent)])
        one, _two, three = (engine.connection(0.0) for _ in range(3))
        assert three.admission is turned_away
        three.close(1.0)
        assert engine.connection(1.0).admission is turned_away
        one.close(2.0)
        one.close(2.0)
        assert engine.connection(2.0).admission is ConnectOutcome.ADMITTED
        assert engine.connection(2.0).admission is turned_away


# -- in memory


def test_in_memory_every_attempt_to_connect_is_a_connection_of_its_own() -> None:
    now = [0.0]
    far = Far(HalfOpen(times=1), ConnectionLimit(1))
    far.connection.close(0.0)
    end = faulty(far.answer, far.faults, lambda: now[0])
    assert end.admit() is ConnectOutcome.ADMITTED
    assert end(frames.frame(READ, 1)) == []
    assert end(frames.frame(READ, 2)) == []
    assert end.admit() is ConnectOutcome.ADMITTED
    assert end(frames.frame(READ, 3)) == [(0.0, answer_to(READ, 3))]
    other = faulty(far.answer, far.faults, lambda: now[0])
    assert other.admit() is ConnectOutcome.REFUSED
    assert other(frames.frame(READ, 4)) == []
    end.close()
    assert other.admit() is ConnectOutcome.ADMITTED


def test_in_memory_a_first_request_connects() -> None:
    far = Far()
    end = faulty(far.answer, far.faults, lambda: 0.0)
    assert end(frames.frame(READ, 1)) == [(0.0, answer_to(READ, 1))]


# -- any mixture


def test_whatever_is_mixed_nothing_comes_from_before_its_request_and_the_seed_repeats_it() -> None:
    def run(seed: int) -> tuple[list[tuple[float, list[Reply]]], list[Exchange]]:
        chance = random.Random(seed)
        far = Far(seed=seed)
        for fault in chance.sample(ONE_OF_EACH, 6):
            far.faults.add(dataclasses.replace(fault, probability=chance.random()))
        came: list[tuple[float, list[Reply]]] = []
        for tid in range(1, 60):
            request = chance.choice([READ, frames.write_register(1, tid), frames.read(Table.COIL, 0, 12)])
            came.append((tid / 10, far.ask(request, tid, at=tid / 10)))
        far.connection.close(10.0)
        return came, far.exchanges

    for seed in range(60):
        came, exchanges = run(seed)
        assert (came, exchanges) == run(seed)
        assert all(delay_s >= 0.0 for _, replies in came for delay_s, _ in replies)
        assert sorted(exchange.sent_at for exchange in exchanges) == [tid / 10 for tid in range(1, 60)]
        assert all(at >= exchange.sent_at for exchange in exchanges for at, _ in exchange.answers)


def test_a_steady_draw_depends_on_the_request_and_the_time_and_not_on_what_else_was_asked() -> None:
    read, other = frames.read(Table.HOLDING, 0), frames.read(Table.HOLDING, 9)

    def struck(*, more: bool) -> list[float]:
        faults = WireFaults(seed=4, start=0.0)
        faults.steady = True
        faults.add(DropRequest(probability=0.5))
        connection = faults.connection(0.0)
        for number in range(60):
            now = 0.2 * number + (0.01 if more else 0.0)
            if more and number % 7 == 0:
                connection.take(frames.frame(other, 1000 + number), now)
            connection.take(frames.frame(read, number + (500 if more else 0)), now)
        return [round(one.at - (0.01 if more else 0.0), 3) for one in faults.strikes if one.frame and one.frame[9] == 0]

    assert struck(more=False) == struck(more=True)
    assert 10 < len(struck(more=False)) < 50
