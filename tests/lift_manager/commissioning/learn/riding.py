"""A scripted person who rides a simulated lift and says what it does, on virtual time, over a wire in memory."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

from drivers.modbus.memory import MemoryWire
from lift_manager.commissioning.learn import samples
from lift_manager.commissioning.learn.ride import record
from lift_manager.commissioning.learn.samples import MarkKind, Recording
from lift_manager.commissioning.learn.survey import LAST, survey
from lift_manager.commissioning.prober import Prober
from lift_manager.lab.plant import default_floors, simulated_lift
from lift_manager.lab.world.device import MemoryController, Reply
from register_maps.codec import Codec
from register_maps.frames import parse_request
from register_maps.words import Door, Motion, Side, Table
from simulator.registers import RegisterFace
from simulator.state import ShownState
from tests.support.virtual_time import run_virtual

REACTS_S = 0.6
"""From what a person sees to ENTER."""
LOOKS_S = 0.1
"""Every so often the person looks, at most so much after it happened."""
SHOWN_EVERY_S = 0.2
GAP_S = 0.1
"""Between two reads: twice as long as usual, as at a slow controller, which leaves less to learn from."""


Extra = Mapping[tuple[Table, int], Callable[[int, float], int]]
"""What some registers show instead, by table and address: made of what they would show, and of the time."""


@dataclass
class Disturbed:
    """A lift of whose controller some registers show other things."""

    face: RegisterFace
    extra: Extra

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        cells = self.face.read(table, address, count, now)
        return [
            self.extra[table, at](cell, now) if (table, at) in self.extra else cell
            for at, cell in enumerate(cells, start=address)
        ]


@dataclass
class Ridden:
    """A recording, and the lift it is of."""

    recording: Recording
    codec: Codec
    face: RegisterFace
    floors: Mapping[str, int]
    said: list[str]
    writes: int
    ended_at: float

    def with_marks(self, *kinds: MarkKind) -> Recording:
        """Return the recording of a person who typed only marks of these kinds: to type one takes no time."""
        return replace(self.recording, marks=[mark for mark in self.recording.marks if mark.kind in kinds])

    @cached_property
    def shown_again(self) -> list[dict[str, list[int]]]:
        """Every register image that a further ride shows, to every floor and back; one that stays is here once."""
        plan = [*reversed(usual_plan(list(self.floors))), next(iter(self.floors))]
        images: list[dict[str, list[int]]] = []

        async def main() -> None:
            loop = asyncio.get_running_loop()
            await asyncio.sleep(self.ended_at + 1)
            riding = asyncio.ensure_future(_ride(Person(self.face, list(self.floors), plan, marks="")))
            while not riding.done():
                await asyncio.sleep(SHOWN_EVERY_S)
                image = _image(self.face, self.codec, loop.time())
                if not images or image != images[-1]:
                    images.append(image)
            riding.result()

        run_virtual(main)
        return images


class Person:
    """Presses car buttons and types lines."""

    def __init__(self, face: RegisterFace, floors: Sequence[str], plan: Sequence[str], *, marks: str) -> None:
        self._face = face
        self._floors = list(floors)
        self._marks = marks
        self._lines = self._ride(plan)

    async def next_line(self) -> str | None:
        async for line in self._lines:
            return line
        return None

    async def _ride(self, plan: Sequence[str]) -> AsyncIterator[str]:
        for number, floor in enumerate(plan):
            moves = floor != self._floors[self._face.picture.floor]
            await self._press(self._floors.index(floor))
            if moves:
                await self._until(lambda p: p.motion is not Motion.STOPPED)
                await asyncio.sleep(REACTS_S)
                yield ""
            await self._until(lambda p: p.doors[Side.FRONT] is Door.OPENING)
            await asyncio.sleep(REACTS_S)
            if "/" in self._marks and number % 2:
                yield "/"
            await self._until(lambda p: p.doors[Side.FRONT] is Door.OPEN)
            await asyncio.sleep(REACTS_S)
            yield floor
            await self._until(lambda p: p.doors[Side.FRONT] is Door.CLOSING)
            await asyncio.sleep(REACTS_S)
            if "/" in self._marks and not number % 2:
                yield "/"
            await self._until(lambda p: p.doors[Side.FRONT] is Door.CLOSED)
            await asyncio.sleep(REACTS_S)
            if "-" in self._marks:
                yield "-"
            await asyncio.sleep(1.0)

    async def _press(self, index: int) -> None:
        now = asyncio.get_running_loop().time
        pressed = replace(self._face.inputs, car_buttons=frozenset({index}))
        self._face.people(now(), pressed)
        await asyncio.sleep(0.5)
        self._face.people(now(), replace(pressed, car_buttons=frozenset()))

    async def _until(self, true: Callable[[ShownState], bool]) -> None:
        loop = asyncio.get_running_loop()
        for _ in range(int(120 / LOOKS_S)):
            self._face.advance(loop.time())
            if true(self._face.picture):
                return
            await asyncio.sleep(LOOKS_S)
        raise AssertionError(f"the lift does not do it: {self._face.picture}")


async def _ride(person: Person) -> None:
    while await person.next_line() is not None:
        pass


def _image(face: RegisterFace, codec: Codec, now: float) -> dict[str, list[int]]:
    image = codec.empty_image()
    for table in {*Table} & image.keys():
        for span in codec.served[table]:
            image[table][span.start : span.stop] = face.read(Table(table), span.start, len(span), now)
    return image


def usual_plan(floors: Sequence[str]) -> list[str]:
    """Every floor twice, up and down, and past floors without a stop."""
    names = list(floors)
    return [
        names[0],
        *names[1:],
        names[0],
        names[-1],
        *names[-2::-1],
        *([names[-1], names[0]] if len(names) == 2 else []),
    ]


def ridden(
    codec: Codec,
    *,
    plan: Sequence[str] | None = None,
    marks: str = "/-",
    floors: Mapping[str, int] | None = None,
    extra: Extra | None = None,
    last: int | None = None,
) -> Ridden:
    """Survey and ride a lift of this map, as a person with `learn` does. `marks` are those that the person types besides floors.

    With `last` only the addresses 0 to `last` are looked at, which saves most of the time of a test.
    """
    named = dict(floors or default_floors(codec.map))
    face = simulated_lift(codec, named)
    controller = MemoryController(
        {codec.map.unit_of(""): cast("RegisterFace", Disturbed(face, extra)) if extra else face}, lambda _: None
    )
    writes = 0

    def answer(frame: bytes) -> list[Reply]:
        nonlocal writes
        writes += parse_request(frame).is_write
        return controller.answer(frame)

    async def main() -> Ridden:
        prober = Prober(MemoryWire(answer), unit=codec.map.unit_of(""), gap_s=GAP_S)
        likely = last is None
        found = await survey(prober, lambda _progress: None, last=LAST if last is None else last, likely=likely)
        recording = samples.begin(found, peer="memory", unit=prober.unit, began="2026-11-23T20:00:00")
        person = Person(face, list(named), plan or usual_plan(list(named)), marks=marks)
        said: list[str] = []
        await record(prober, recording, person.next_line, said.append)
        recording.floors = tuple(named)
        prober.close()
        return Ridden(recording, codec, face, named, said, writes, asyncio.get_running_loop().time())

    return run_virtual(main)
