"""A replayed controller: what it answers to a manager, when, and what it does with what was not recorded."""

import asyncio
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import Answer, MemoryWire
from drivers.modbus.wire import Wire
from lift_manager.api.events import Frame
from lift_manager.commissioning.trace.record import Recorder
from lift_manager.commissioning.trace.recording import (
    Header,
    Item,
    Recording,
    TracedFrame,
    header_line,
    item_line,
    read_recording,
)
from lift_manager.lab.plant import simulated_lift
from lift_manager.lab.replay import NothingRecorded, Replay, replayed, serve_replay
from lift_manager.lab.world.device import MemoryController
from register_maps import frames
from register_maps.words import Table
from simulator.controller import Inputs
from tests.drivers.caller import Caller
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual

HEADER = Header("plc", datetime(2026, 11, 23, 12, tzinfo=UTC), "lift-manager 1")
FLOORS = {"L1": 1, "L2": 2, "L3": 3}
POLL_S = 0.2
POLLS = 60

Values = tuple[tuple[str, object], ...]


def polled(
    answer: Answer, pauses: Iterable[float], tap: Callable[[bool, bytes, float], None] | None = None
) -> list[Values]:
    """The values of all signals, poll by poll, that a driver reads of a controller; runs in virtual time."""
    found: list[Values] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def wire() -> Wire:
            made = MemoryWire(answer)
            if tap is not None:
                made.on_bytes = lambda sent, frame: tap(sent, frame, loop.time())
            return made

        link = Link(wire, LinkSettings(), name="plc")
        settings = LiftSettings(name="lift", floors=FLOORS, control=False)
        lift = Caller(ModbusLift(compiled("generic-registers"), link, settings))
        tasks = [asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())]
        await link.wait_up()
        for pause_s in pauses:
            await asyncio.gather(lift.read(), return_exceptions=True)
            signals = lift.driver.signals(loop.time())
            found.append(tuple((signal.name, signal.value) for signal in signals))
            await elapse(pause_s)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main)
    return found


def ride(folder: Path) -> tuple[list[Values], Path]:
    """A passenger's ride from L1 to L3, as a manager saw it, and its recording."""
    face = simulated_lift(compiled("generic-registers"), FLOORS, speed=4)
    controller = MemoryController({1: face}, lambda _: None)
    items: list[Item] = []
    recorder = Recorder(HEADER, items.append, now=lambda: HEADER.began)

    def answer(frame: bytes) -> list[tuple[float, bytes | None]]:
        now = asyncio.get_running_loop().time()
        face.people(now, Inputs(car_buttons=frozenset({2}) if 1 < now < 1.5 else frozenset()))
        return controller.answer(frame)

    def tap(sent: bool, frame: bytes, at_s: float) -> None:
        recorder.take(Frame(link="plc", sent=sent, hex=frame.hex(), text="", at_s=at_s))

    seen = polled(answer, [POLL_S] * POLLS, tap)
    file = folder / "ride.jsonl"
    file.write_text(header_line(HEADER) + "".join(item_line(HEADER, item) for item in items), "utf-8")
    return seen, file


def without_repetition(found: Sequence[Values], *, without: str = "") -> list[Values]:
    kept = [tuple(pair for pair in values if pair[0] != without) for values in found]
    return [values for values, _ in itertools.groupby(kept)]


def answers_of(replay: Replay) -> Answer:
    return lambda frame: replay.answer(frame, asyncio.get_running_loop().time())


# -- record and replay


def test_a_manager_that_reads_a_replay_sees_what_the_manager_of_the_recording_saw(tmp_path: Path) -> None:
    seen, file = ride(tmp_path)
    assert {dict(values)["car_floor"] for values in seen} >= {"L1", "L2", "L3"}
    assert {dict(values)["door.front"] for values in seen} >= {"closed", "opening", "open"}
    replay = Replay(read_recording(file))
    assert polled(answers_of(replay), [POLL_S] * POLLS) == seen


def test_polls_that_come_a_little_earlier_or_later_miss_no_state(tmp_path: Path) -> None:
    seen, file = ride(tmp_path)
    jitter = itertools.cycle([0.06, -0.05, 0.03, -0.08, 0.04])
    replay = Replay(read_recording(file))
    found = polled(answers_of(replay), [POLL_S + next(jitter) for _ in range(POLLS)])
    assert without_repetition(found) == without_repetition(seen)


def test_polls_at_another_pace_see_the_same_moments(tmp_path: Path) -> None:
    seen, file = ride(tmp_path)
    replay = Replay(read_recording(file))
    found = polled(answers_of(replay), [POLL_S / 4] * 4 * POLLS)
    # the values of the counter of the controller between two polls were not recorded
    assert without_repetition(found) == without_repetition(seen)


# -- time


def item(at_s: float, tid: int, request: frames.Request, values: Iterable[int] = ()) -> list[TracedFrame]:
    payload = b"".join(value.to_bytes(2, "big") for value in values)
    answer = frames.answer(request, tid, payload)
    return [TracedFrame(at_s, True, frames.frame(request, tid)), TracedFrame(at_s + 0.25, False, answer)]


READ = frames.read(Table.HOLDING, 4, 2)
PRESS = frames.write_register(16, 2)


def replay_of(items: Iterable[Item], *, loop: bool = False, said: list[str] | None = None) -> Replay:
    return Replay(Recording(HEADER, tuple(items)), loop=loop, report=None if said is None else said.append)


def ask(replay: Replay, request: frames.Request, now: float, tid: int = 900) -> tuple[float, bytes] | None:
    """Delay and answer after its transaction id; None for silence."""
    replies = replay.answer(frames.frame(request, tid), now)
    if not replies:
        return None
    ((delay_s, answer),) = replies
    assert answer is not None
    assert frames.tid_of(answer) == tid
    return round(delay_s, 6), answer


def words(found: tuple[float, bytes] | None, request: frames.Request = READ) -> tuple[int, ...]:
    assert found is not None
    return frames.values_of(request, frames.check(request, found[1]))


THREE = [*item(10, 1, READ, (0, 1)), *item(11, 2, READ, (0, 2)), *item(12, 3, READ, (0, 3))]


def test_time_begins_with_the_first_request_whenever_that_comes() -> None:
    replay = replay_of(THREE)
    assert [words(ask(replay, READ, 500 + s))[1] for s in (0, 0.4, 0.6, 1.4, 1.6)] == [1, 1, 2, 2, 3]


def test_answers_take_as_long_as_they_took() -> None:
    found = ask(replay_of(THREE), READ, 0)
    assert found is not None
    assert found[0] == 0.25


@each_row(("loop", "then"), [(False, [3, 3, 3]), (True, [1, 2, 3])])
def test_at_its_end_it_repeats_the_last_answer_or_begins_again(loop: bool, then: list[int]) -> None:
    replay = replay_of(THREE, loop=loop)
    assert words(ask(replay, READ, 0))[1] == 1
    assert [words(ask(replay, READ, s))[1] for s in (3.1, 4.1, 5.1)] == then


def test_a_request_from_the_middle_of_the_recording_does_not_skip_its_beginning() -> None:
    late = frames.read(Table.HOLDING, 16, 1)
    replay = replay_of([*THREE, *item(60, 4, late, (7,))])
    assert words(ask(replay, late, 100), late) == (7,)
    assert words(ask(replay, READ, 100.3)) == (0, 1)


# -- what was recorded


def test_exceptions_and_silence_are_replayed() -> None:
    request = TracedFrame(0, True, frames.frame(READ, 1))
    refused = TracedFrame(0.1, False, frames.exception_answer(request.frame, 2))
    replay = replay_of([request, refused, TracedFrame(5, True, frames.frame(READ, 2))])
    found = ask(replay, READ, 0)
    assert found is not None
    assert found[1][7:] == b"\x83\x02"
    assert ask(replay, READ, 5) is None


def test_a_controller_that_returned_no_transaction_ids_returns_none_here() -> None:
    request, answer = item(0, 5, READ, (0, 1))
    replay = replay_of([request, replace(answer, frame=b"\0\0" + answer.frame[2:])])
    ((_, found),) = replay.answer(frames.frame(READ, 9), 0)
    assert found is not None
    assert frames.tid_of(found) == 0


def test_a_recorded_write_is_answered_as_it_was() -> None:
    request = TracedFrame(1, True, frames.frame(PRESS, 4))
    refused = TracedFrame(1.1, False, frames.exception_answer(request.frame, 4))
    said: list[str] = []
    found = ask(replay_of([*item(0, 1, READ, (0, 1)), request, refused], said=said), PRESS, 0)
    assert found is not None
    assert found[1][7:] == b"\x86\x04"
    assert said == []


# -- what was not


def test_another_write_is_echoed_and_that_is_reported_once_for_each_place() -> None:
    said: list[str] = []
    replay = replay_of(THREE, said=said)
    for value in (2, 3):
        found = ask(replay, frames.write_register(16, value), 0)
        assert found is not None
        assert frames.check(frames.write_register(16, value), found[1]) == b""
    assert said == ["write holding register 16 := 2, unit 1: not in the recording; echoed, and nothing changes"]


def test_another_read_of_known_addresses_is_put_together_from_the_moment_of_the_recording() -> None:
    other = frames.read(Table.HOLDING, 6, 2)
    one = frames.read(Table.HOLDING, 5, 2)
    replay = replay_of([*item(0, 1, READ, (1, 2)), *item(0.3, 2, other, (3, 4)), *item(5, 3, READ, (1, 9))])
    assert words(ask(replay, one, 0), one) == (2, 3)
    assert words(ask(replay, one, 5), one) == (9, 3)


def test_a_read_of_bits_is_put_together_too() -> None:
    bits = frames.read(Table.DISCRETE, 0, 6)
    answer = TracedFrame(0.1, False, frames.answer(bits, 1, frames.pack_bits([1, 0, 1, 1, 0, 0])))
    replay = replay_of([TracedFrame(0, True, frames.frame(bits, 1)), answer])
    few = frames.read(Table.DISCRETE, 2, 3)
    assert words(ask(replay, few, 0), few) == (1, 1, 0)


def test_addresses_that_nobody_read_are_answered_with_exception_02_and_reported() -> None:
    said: list[str] = []
    found = ask(replay_of(THREE, said=said), frames.read(Table.HOLDING, 5, 2), 0)
    assert found is not None
    assert found[1][7:] == b"\x83\x02"
    (line,) = said
    assert line.endswith("holding 6 is not in the recording; answered with exception 02")


def test_a_recording_without_answers_cannot_be_replayed() -> None:
    with pytest.raises(NothingRecorded, match="no answers"):
        replay_of([TracedFrame(0, True, frames.frame(READ, 1))])


# -- over the network


def test_a_test_reads_a_replay_on_a_port_of_its_own(tmp_path: Path) -> None:
    _, file = ride(tmp_path)
    poll = frames.read(Table.HOLDING, 0, 8)

    async def main(port: int) -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        # two requests in one segment, the second one in two
        second = frames.frame(poll, 2)
        writer.write(frames.frame(poll, 1) + second[:5])
        await writer.drain()
        first = await reader.readexactly(poll.answer_length)
        writer.write(second[5:])
        found = first + await reader.readexactly(poll.answer_length)
        writer.close()
        return found

    with replayed(file) as port:
        found = asyncio.run(main(port))
    whole, rest = frames.split(found)
    assert [frames.tid_of(frame) for frame in whole] == [1, 2]
    assert rest == b""


def test_what_is_not_modbus_ends_the_connection_and_nothing_else() -> None:
    async def main() -> bytes:
        async with serve_replay(replay_of(THREE)) as port:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(b"GET / HTTP/1.1\r\n\r\n")
            ended = await reader.read()
            writer.close()
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(frames.frame(READ, 3))
            answer = await reader.readexactly(READ.answer_length)
            writer.close()
            return ended + answer

    assert frames.tid_of(asyncio.run(main())) == 3
