"""The answer fuzzer in CI, the judge on cases made by hand, and clients with planted mistakes that it has to find."""

import asyncio
import struct
from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

import pytest

from drivers.errors import LinkDown
from drivers.model import LiftReading, LiftValues
from register_maps.words import Door, Mode, Motion, Side
from tests.campaigns import answers, fuzz_answers
from tests.campaigns.answer_lift import falsehood, lift_batch, objection_to_reading
from tests.campaigns.answer_memory import memory_batch
from tests.campaigns.answer_rig import Report, objection_to
from tests.campaigns.careless import CHECKS, RAISES, REFUSES, Careless, careless
from tests.campaigns.judge_answers import Hearing, Payload, Question, Refusal, fitting, whole_frames
from tests.support.rows import each_row

READ = bytes.fromhex("0007 0000 0006 01 03 006B 0003")
"""The example of the specification, 6.3: three holding registers from 107."""
RIGHT = bytes.fromhex("0007 0000 0009 01 03 06 022B 0000 0064")
DATA = bytes.fromhex("022B 0000 0064")
COILS = bytes.fromhex("0007 0000 0006 01 01 0013 0013")
"""The example of 6.1: nineteen coils from 19."""
OTHER = bytes.fromhex("0009 0000 0006 01 03 006B 0003")
"""The same request once more."""


def heard(*pieces: bytes, echoes_tid: bool = True, request: bytes = READ) -> Question:
    """What the judge makes of these bytes, each piece a hundredth of a second after the one before."""
    hearing = Hearing(echoes_tid=echoes_tid)
    question = hearing.asked(request, 0.0)
    for number, piece in enumerate(pieces, start=1):
        hearing.came(piece, number / 100)
    return question


def test_the_right_answer_must_be_taken() -> None:
    question = heard(RIGHT)
    assert question.answer == Payload(DATA)
    assert question.must_take(0.5)
    assert not question.must_take(0.005)


def test_the_right_answer_must_be_taken_in_segments_too() -> None:
    for place in range(1, len(RIGHT)):
        question = heard(RIGHT[:place], RIGHT[place:])
        assert question.answer == Payload(DATA)
        assert question.must_take(0.5)


def test_other_data_of_the_right_length_is_an_answer_for_there_is_no_checksum() -> None:
    assert heard(RIGHT[:-1] + b"\xff").answer == Payload(DATA[:-1] + b"\xff")


@each_row(
    "wrong",
    [
        "0008 0000 0009 01 03 06 022B 0000 0064",  # another transaction
        "0000 0000 0009 01 03 06 022B 0000 0064",
        "0007 0001 0009 01 03 06 022B 0000 0064",  # not Modbus
        "0007 0000 0009 02 03 06 022B 0000 0064",  # another unit
        "0007 0000 0009 01 04 06 022B 0000 0064",  # another function
        "0007 0000 0009 01 03 05 022B 0000 0064",  # the byte count is not that of what follows
        "0007 0000 0007 01 03 04 022B 0000",  # two registers
        "0007 0000 000B 01 03 08 022B 0000 0064 0001",  # four
        "0007 0000 0008 01 03 06 022B 0000 0064",  # the length field says one byte less
        "0007 0000 000A 01 03 06 022B 0000 0064",  # or one more
        "0007 0000 0000 01 03 06 022B 0000 0064",
        "0007 0000 00FF 01 03 06 022B 0000 0064",
        "0007 0000 0002 01 83",  # an exception without its code
        "0007 0000 0004 01 83 02 00",
        "0007 0000 0003 01 84 02",  # to another function
        "0007 0000 0003 01 03 02",
        "",
    ],
)
def test_nothing_may_be_taken_from_a_wrong_answer(wrong: str) -> None:
    question = heard(bytes.fromhex(wrong))
    assert question.answer is None
    assert not question.must_take(0.5)


@pytest.mark.parametrize("code", [0, 2, 255])
def test_an_exception_of_any_code_is_an_answer(code: int) -> None:
    assert heard(bytes.fromhex("0007 0000 0003 01 83") + bytes([code])).answer == Refusal(code)


def test_the_first_frame_of_a_transaction_decides_it() -> None:
    later = RIGHT[:-1] + b"\xff"
    assert heard(RIGHT, later).answer == Payload(DATA)
    assert heard(bytes.fromhex("0007 0000 0002 01 83"), RIGHT).answer is None


def test_answers_of_other_transactions_are_passed_over_but_excuse_a_client_that_gives_up() -> None:
    question = heard(b"\0\6" + RIGHT[2:], RIGHT)
    assert question.answer == Payload(DATA)
    assert not question.must_take(0.5)


def test_nothing_after_the_stream_broke_may_be_taken() -> None:
    assert heard(bytes.fromhex("0006 0101 0003 01 83 02"), RIGHT).answer is None
    assert heard(b"\0", RIGHT).answer is None


def test_a_frame_that_began_before_its_request_left_is_not_the_answer_to_it() -> None:
    hearing = Hearing()
    hearing.came(RIGHT[:4], 0.0)
    question = hearing.asked(READ, 0.1)
    hearing.came(RIGHT[4:], 0.2)
    early = question.answer
    hearing.came(RIGHT, 0.3)
    assert (early, question.answer) == (None, Payload(DATA))
    assert not question.must_take(0.5)


def test_a_late_answer_is_not_the_answer_to_the_next_request_like_it() -> None:
    hearing = Hearing()
    first, second = hearing.asked(READ, 0.0), hearing.asked(OTHER, 1.0)
    hearing.came(RIGHT, 1.1)
    hearing.came(OTHER[:2] + RIGHT[2:-1] + b"\1", 1.2)
    assert (first.answer, second.answer) == (None, Payload(DATA[:-1] + b"\1"))


def test_without_transaction_ids_the_next_frame_decides() -> None:
    assert heard(b"\0\0" + RIGHT[2:], echoes_tid=False).answer == Payload(DATA)
    assert heard(bytes.fromhex("0000 0000 0003 01 84 02"), RIGHT, echoes_tid=False).answer is None


def test_bits_come_in_whole_bytes() -> None:
    assert fitting(COILS, bytes.fromhex("0007 0000 0006 01 01 03 CD6B05")) == Payload(b"\xcd\x6b\x05")
    assert fitting(COILS, bytes.fromhex("0007 0000 0005 01 01 02 CD6B")) is None


@each_row(
    ("request_", "right"),
    [
        ("0007 0000 0006 01 05 00AC FF00", "0007 0000 0006 01 05 00AC FF00"),
        ("0007 0000 0006 01 06 0001 0003", "0007 0000 0006 01 06 0001 0003"),
        ("0007 0000 0009 01 0F 0013 000A 02 CD01", "0007 0000 0006 01 0F 0013 000A"),
        ("0007 0000 000B 01 10 0001 0002 04 000A 0102", "0007 0000 0006 01 10 0001 0002"),
        ("0007 0000 0008 01 16 0004 00F2 0025", "0007 0000 0008 01 16 0004 00F2 0025"),
    ],
)
def test_a_write_is_answered_by_its_echo_alone(request_: str, right: str) -> None:
    """The examples of the specification, 6.5, 6.6, 6.11, 6.12 and 6.16; one bit off is no answer."""
    asked, answer = bytes.fromhex(request_), bytes.fromhex(right)
    assert fitting(asked, answer) == Payload(b"")
    assert answers.right_answer(asked, b"") == answer
    for place in range(6, len(answer)):
        assert fitting(asked, answer[:place] + bytes([answer[place] ^ 1]) + answer[place + 1 :]) is None


def test_whole_frames_end_where_a_frame_is_not_whole_or_not_modbus() -> None:
    assert whole_frames(RIGHT + READ + RIGHT[:9]) == [RIGHT, READ]
    assert whole_frames(RIGHT + b"\0\1\0\1\0\2\1\3") == [RIGHT]
    assert whole_frames(b"") == []


def test_a_caller_who_is_told_that_nothing_was_sent_must_be_told_the_truth() -> None:
    down = LinkDown("plc", "cut", 1.0)
    assert objection_to(None, down, 0.5) is None
    assert objection_to(None, DATA, 0.5) is not None
    assert objection_to(heard(), down, 0.5) is not None


def test_every_mutation_can_be_drawn_and_most_are_wrong() -> None:
    rng = Random(1)
    drawn: dict[str, int] = {}
    right = 0
    for _ in range(4000):
        kind, pieces = answers.script(answers.Situation(READ, RIGHT, (RIGHT, COILS), 0.5, rng))
        drawn[kind] = drawn.get(kind, 0) + 1
        right += b"".join(data for _, data in pieces if data) == RIGHT
    assert set(drawn) == {mutation.__name__ for mutation in answers.MUTATIONS}
    assert 0.1 < right / 4000 < 0.4


def test_mutated_answers_find_nothing_in_the_link() -> None:
    report = fuzz_answers.run_batch("memory", 1, 0, 2000)
    assert not fuzz_answers.verdict("memory", report, 2000), report.findings[:3]
    assert report.owed > 400


def test_mutated_answers_to_whole_lifts_make_no_false_reading() -> None:
    report = fuzz_answers.run_batch("lifts", 1, 0, 1000)
    assert not fuzz_answers.verdict("lifts", report, 1000), report.findings[:3]


@pytest.mark.parametrize("batch", [0, 1])
def test_mutated_answers_over_sockets_find_nothing(batch: int) -> None:
    """On asyncio's own loop, and on uvloop."""
    report = fuzz_answers.run_batch("sockets", 1, batch, 150)
    assert not fuzz_answers.verdict("sockets", report, 150), report.findings[:3]


@pytest.mark.parametrize("run", [memory_batch, lift_batch])
def test_a_seed_gives_the_same_run_again(run: Callable[[int, int, int], Report]) -> None:
    once = run(5, 2, 200)
    assert run(5, 2, 200) == once
    assert run(6, 2, 200) != once


def test_a_finding_is_told_with_what_replays_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert fuzz_answers.main(["--replay", "memory:3:0:200"]) == 0
    assert "memory: 200 mutated answers" in capsys.readouterr().out
    report = memory_batch(1, 0, 400, careless("echo"))
    assert "memory:1:0:400" in str(report.findings[0])
    assert "asked" in str(report.findings[0])
    assert fuzz_answers.verdict("memory", report, 400) == f"{len(report.findings)} finding(s)"


def test_the_command_runs_what_it_is_asked_for_in_processes_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert fuzz_answers.main(["--memory", "0", "--lifts", "200", "--sockets", "0", "--workers", "1"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["lifts"]


def test_a_run_that_tests_too_little_fails() -> None:
    assert "only 5 of 10 cases" in fuzz_answers.verdict("memory", Report(cases=5, taken=5), 10)
    assert "only 0 of 10 answers" in fuzz_answers.verdict("memory", Report(cases=10, taken=0), 10)
    assert not fuzz_answers.verdict("memory", Report(cases=10, taken=3), 10)
    assert fuzz_answers.main(["--replay", "memory:3:0:1"]) == 1


def test_a_small_client_without_a_mistake_passes() -> None:
    report = memory_batch(1, 0, 2000, careless())
    assert not fuzz_answers.verdict("memory", report, 2000), report.findings[:3]


@each_row("mistake", [*CHECKS, RAISES, REFUSES])
def test_a_client_with_one_mistake_is_found_within_five_hundred_answers(mistake: str) -> None:
    assert memory_batch(1, 0, 500, careless(mistake)).findings


def test_a_client_that_never_ends_waiting_is_found() -> None:
    class Forgetful(Careless):
        async def wait_up(self) -> int:
            await asyncio.Event().wait()
            return 1

    report = memory_batch(1, 0, 100, lambda make_wire, settings, _: Forgetful(make_wire, settings, ""))
    assert "DeadlockError" in report.findings[0].what


def test_a_reading_that_says_other_than_its_registers_is_found() -> None:
    data = struct.pack(">8H", 1, 2, 1, 3, 2, 0b111, 0, 2)
    true = LiftValues(
        floor="L2",
        call_accepted="L2",
        motion=Motion.STOPPED,
        mode=Mode.ROBOT,
        doors={Side.FRONT: Door.OPEN},
        flags={"fire": False, "robot_mode_on": True, "level": True, "obstruction.front": False, "overload": False},
    )
    assert falsehood(true, data) is None
    others: list[dict[str, Any]] = [
        {"floor": "L1"}, {"motion": Motion.UP}, {"doors": {Side.FRONT: Door.CLOSED}}, {"mode": Mode.NORMAL}, {"destination": "L1"},
        {"call_accepted": None}, {"flags": {**true.flags, "level": False}},
    ]  # fmt: skip
    for other in others:
        assert falsehood(replace(true, **other), data), other
    assert falsehood(replace(true, flags={**true.flags, "fire": True}), data[:10] + b"\0\6" + data[12:])


def test_a_reading_without_its_answer_or_with_an_earlier_one_is_found() -> None:
    poll = bytes.fromhex("0007 0000 0006 01 03 0000 0008")
    right = poll[:4] + b"\0\x13\1\3\x10" + bytes(16)
    on_fire = LiftValues(motion=Motion.UNKNOWN, mode=Mode.FIRE, doors={Side.FRONT: Door.UNKNOWN}, flags={
        "fire": True, "robot_mode_on": False, "level": False, "obstruction.front": False, "overload": False
    })  # fmt: skip
    assert objection_to_reading(heard(right, request=poll), LiftReading(0.0, 1, on_fire)) is None
    assert objection_to_reading(heard(right[:-1] + b"\1", request=poll), LiftReading(0.0, 1, on_fire))
    assert objection_to_reading(heard(right, request=poll), LiftReading(0.5, 1, on_fire))
    assert objection_to_reading(heard(request=poll), LiftReading(0.0, 1, on_fire))
    assert objection_to_reading(None, LiftReading(0.0, 1, on_fire))
