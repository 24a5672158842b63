"""Finding what a controller answers for: ranges, limits, tables that are not there, silence, gateways."""

import asyncio
from collections.abc import Mapping, Sequence
from itertools import pairwise

import pytest

from drivers.errors import ILLEGAL_ADDRESS, ConnectFailed, ConnectProblem
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply
from lift_manager.commissioning.learn.survey import Progress, Survey, SurveyFailed, survey
from lift_manager.commissioning.prober import Prober
from register_maps import frames
from register_maps.words import Table
from tests.support.rows import each_row
from tests.support.virtual_time import run_virtual

Ranges = Mapping[Table, Sequence[tuple[int, int]]]


def surveyed(
    served: Ranges | None, *, most: int = 125, first: int | None = None, last: int | None = None, unit: int = 1
) -> tuple[Survey, MemoryDevice, list[Progress]]:
    device = MemoryDevice(served=served)
    seen: list[Progress] = []

    def answer(frame: bytes) -> list[Reply]:
        request = frames.parse_request(frame)
        if request.count > most:
            return [(0.0, frames.exception_answer(frame, ILLEGAL_ADDRESS))]
        return device.answer(frame)

    async def main() -> Survey:
        prober = Prober(MemoryWire(answer), unit=unit)
        if first is None or last is None:
            return await survey(prober, seen.append)
        return await survey(prober, seen.append, first=first, last=last, likely=False)

    return run_virtual(main), device, seen


@each_row(
    ("served", "spans"),
    [
        ({Table.HOLDING: [(0, 7), (16, 19)]}, ["holding 0 to 7", "holding 16 to 19"]),
        ({Table.DISCRETE: [(1, 3)], Table.COIL: [(17, 19)]}, ["discrete 1 to 3", "coil 17 to 19"]),
        ({Table.HOLDING: [(0, 0), (384, 385)]}, ["holding 0", "holding 384 to 385"]),
        (
            {Table.HOLDING: [(39_990, 40_010)], Table.INPUT: [(30_001, 30_001)]},
            ["input 30001", "holding 39990 to 40010"],
        ),
        ({Table.INPUT: [(250, 700)]}, ["input 250 to 700"]),
    ],
)
def test_ranges_are_found_with_their_edges(served: Ranges, spans: list[str]) -> None:
    found, device, _ = surveyed(served)
    assert [str(span) for span in found.spans] == spans
    assert device.writes == []


def test_a_controller_that_answers_for_less_in_one_request_is_followed_to_its_edge() -> None:
    found, _, _ = surveyed({Table.HOLDING: [(0, 60)]}, most=20)
    assert ([str(span) for span in found.spans], found.most_registers) == (["holding 0 to 60"], 20)


def test_of_a_controller_that_answers_for_everything_the_first_thousand_are_taken_and_more_on_request() -> None:
    found, device, _ = surveyed(None)
    assert {str(span) for span in found.spans} == {f"{table} 0 to 1023" for table in Table}
    assert any("use --from and --to" in note for note in found.notes)
    assert len(device.received) < 200
    found, _, _ = surveyed(None, first=2000, last=2500)
    assert {str(span) for span in found.spans} == {f"{table} 2000 to 2500" for table in Table}


def test_progress_says_how_much_is_left() -> None:
    _, _, seen = surveyed({Table.HOLDING: [(0, 7)]})
    assert [step.share for step in seen] == sorted(step.share for step in seen)
    assert seen[-1].share == 1
    assert seen[-1].remaining_s == pytest.approx(0.0, abs=0.1)
    assert 10 < seen[len(seen) // 2].remaining_s < 120


def test_requests_are_paced() -> None:
    _, device, _ = surveyed({Table.HOLDING: [(0, 7)]})
    times = [one.at_s for one in device.received]
    assert min(b - a for a, b in pairwise(times)) >= 0.0499


def test_a_table_whose_function_is_refused_costs_one_request() -> None:
    sent = []

    def answer(frame: bytes) -> list[Reply]:
        request = frames.parse_request(frame)
        sent.append(request.table)
        return [(0.0, frames.exception_answer(frame, 1))]

    found = run_virtual(lambda: survey(Prober(MemoryWire(answer)), lambda _: None))
    assert (len(sent), found.spans) == (4, ())
    assert "no discrete table: it refuses function 02" in found.notes


def test_silence_ends_the_search_of_a_table_after_three_requests() -> None:
    found = run_virtual(lambda: survey(Prober(MemoryWire(lambda _frame: [])), lambda _: None))
    assert found.spans == ()
    assert sum("no answer to 3 requests in a row" in note for note in found.notes) == 4


def test_a_gateway_that_does_not_reach_the_unit_is_named() -> None:
    with pytest.raises(SurveyFailed, match=r"unit 7 does not answer: exception 0B .* --unit"):
        surveyed({Table.HOLDING: [(0, 7)]}, unit=7)


def test_a_controller_that_is_switched_off_meanwhile_is_waited_for_and_then_reported() -> None:
    device = MemoryDevice(served={Table.HOLDING: [(0, 7)]})

    async def main() -> float:
        began = asyncio.get_running_loop().time()
        device.connect_problem = ConnectProblem.REFUSED
        with pytest.raises(ConnectFailed):
            await survey(Prober(device.wire()), lambda _: None)
        return asyncio.get_running_loop().time() - began

    assert 10 < run_virtual(main) < 60
