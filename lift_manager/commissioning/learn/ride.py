"""Records a ride: reads everything again and again while a person rides and names the floors."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

from lift_manager.commissioning.learn.samples import BlockReads, Mark, MarkKind, Recording
from lift_manager.commissioning.learn.survey import read_again
from lift_manager.commissioning.prober import Prober

COLD_PER_SWEEP = 4
"""Blocks that have never changed are read in turn, so many of them in each sweep, so that those that change stay fresh."""
LONGEST_NAME = 64
"""As in a site file."""

HELP = (
    "Ride with the lift and say what it does at each moment, ENTER after each:",
    "  L2        the name of the floor, while the car stands there with its door FULLY open",
    "  (empty)   ENTER alone, while the car moves",
    "  /         while the door is opening or closing",
    "  -         while the car stands with its door closed: wait for that before you press a button",
    "  undo      takes the last line back;  ?  shows this again;  done  (or Ctrl-D) ends the ride",
    "Go to every floor, twice if you can, once past a floor without a stop, up and down.",
)
PROMPT = "floor name at this stop? ENTER while moving"

_KINDS = {"": MarkKind.MOVING, "-": MarkKind.CLOSED, "/": MarkKind.DOOR}

NextLine = Callable[[], Awaitable[str | None]]
"""Returns the next line that the person typed, without its end; None if there will be no more."""
PrintLine = Callable[[str], None]


@dataclass(slots=True)
class _Activity:
    """What changed since the last mark, for the answer to it."""

    sweeps: int = 0
    last_sweep: int | None = None
    """The sweep with which the recording ends; None while the person has more to say."""
    changed: int = 0
    failures: int = 0


async def record(prober: Prober, recording: Recording, next_line: NextLine, print_line: PrintLine) -> None:
    """Fill a recording until the person is done. Raises ConnectFailed if the controller takes no connection any more."""
    began = asyncio.get_running_loop().time()
    activity = _Activity()
    sweeping = asyncio.ensure_future(_sweep(prober, recording, activity, began))
    marking = asyncio.ensure_future(_take_marks(recording, next_line, print_line, activity, began))
    try:
        await asyncio.wait((sweeping, marking), return_when=asyncio.FIRST_COMPLETED)
        if sweeping.done():
            sweeping.result()
        marking.result()
        activity.last_sweep = activity.sweeps + 2  # what the last mark is about is read once more
        await sweeping
    finally:
        for task in (sweeping, marking):
            task.cancel()
        await asyncio.gather(sweeping, marking, return_exceptions=True)


async def _sweep(prober: Prober, recording: Recording, activity: _Activity, began: float) -> None:
    loop = asyncio.get_running_loop()
    last: dict[int, tuple[int, ...]] = {}
    hot: set[int] = set()
    cold = deque(range(len(recording.blocks)))
    while activity.last_sweep is None or activity.sweeps < activity.last_sweep:
        for index in [*sorted(hot), *_take(cold, COLD_PER_SWEEP)]:
            block = recording.blocks[index]
            answer = await read_again(prober, block.table, block.start, block.count)
            if answer.values is None:
                activity.failures += 1
            else:
                if _store(block, loop.time() - began, answer.values, last.get(index)):
                    activity.changed += 1
                    hot.add(index)
                last[index] = answer.values
            if index not in hot:
                cold.append(index)
        activity.sweeps += 1


def _take(queue: deque[int], count: int) -> Iterator[int]:
    for _ in range(min(count, len(queue))):
        yield queue.popleft()


def _store(block: BlockReads, at_s: float, values: tuple[int, ...], before: tuple[int, ...] | None) -> bool:
    """Add a read to a block; returns whether it shows a change."""
    block.add(at_s, values, is_new=values != before)
    return before is not None and values != before


async def _take_marks(
    recording: Recording, next_line: NextLine, print_line: PrintLine, activity: _Activity, began: float
) -> None:
    print_line(PROMPT)
    while (line := await next_line()) is not None:
        at_s = round(asyncio.get_running_loop().time() - began, 3)
        text = " ".join(line.split())
        if text.lower() == "done":
            return
        if text == "?":
            for help_line in HELP:
                print_line(help_line)
        elif text.lower() == "undo":
            print_line(
                f"taken back: {_text(recording.marks.pop())}" if recording.marks else "there is nothing to take back"
            )
        elif len(text) > LONGEST_NAME or not text.isprintable():
            print_line(f"a floor name has at most {LONGEST_NAME} printable characters; ? shows what to type")
        else:
            mark = Mark(at_s, _KINDS.get(text, MarkKind.OPEN), "" if text in _KINDS else text)
            recording.marks.append(mark)
            print_line(_answer(recording, mark, activity))
            activity.changed = activity.failures = 0


def _answer(recording: Recording, mark: Mark, activity: _Activity) -> str:
    changed = (
        f"{activity.changed} changes since the last line" if activity.changed else "nothing changed since the last line"
    )
    parts = [f"{clock(mark.at_s)} {_text(mark)}: {changed}"]
    if activity.failures:
        parts.append(f"{activity.failures} reads failed")
    if missing := missing_marks(recording):
        parts.append(f"still wanted: {missing[0]}")
    return "; ".join(parts)


def _text(mark: Mark) -> str:
    return {
        MarkKind.OPEN: f"at {mark.floor}, door open",
        MarkKind.CLOSED: "stands, door closed",
        MarkKind.DOOR: "door opens or closes",
        MarkKind.MOVING: "moves",
    }[mark.kind]


def clock(at_s: float) -> str:
    """Return minutes and seconds."""
    return f"{int(at_s) // 60:02}:{int(at_s) % 60:02}"


def missing_marks(recording: Recording) -> list[str]:
    """Return what a recording still lacks for an answer that is sure, in words, the most important first."""
    count = {kind: sum(mark.kind is kind for mark in recording.marks) for kind in MarkKind}
    floors = recording.named_floors
    once = [name for name in floors if sum(mark.floor == name for mark in recording.marks) < 2]
    wanted = [
        ("a second floor", len(floors) < 2),
        ("`-` where the car stands with its door closed, twice", count[MarkKind.CLOSED] < 2),
        ("ENTER while the car moves, three times or more, up and down", count[MarkKind.MOVING] < 4),
        ("`/` while the door moves, twice", count[MarkKind.DOOR] < 2),
        (f"another stop at {', '.join(once)}", bool(once)),
        ("one more stop anywhere, with its door open", count[MarkKind.OPEN] < 3),
    ]
    return [text for text, is_wanted in wanted if is_wanted]
