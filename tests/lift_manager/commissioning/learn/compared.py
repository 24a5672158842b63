"""Whether a draft reads a lift as its true map does, at every moment of a further ride."""

import asyncio
from pathlib import Path
from typing import cast

from lift_manager.commissioning.learn.analyse import Findings
from lift_manager.commissioning.learn.draft import draft
from lift_manager.commissioning.learn.samples import Recording
from lift_manager.commissioning.learn.tracks import Confidence
from register_maps.codec import Codec, SignalCodec, compile_map
from register_maps.load import LoadedMap, load
from register_maps.words import Door
from simulator.registers import RegisterFace
from tests.lift_manager.commissioning.learn.riding import Person, Ridden, usual_plan
from tests.support.virtual_time import run_virtual

LOOKS_S = 0.2


def loaded_draft(found: Findings, recording: Recording, folder: Path) -> LoadedMap:
    """Return the draft as a map; raises MapFileError if it is none."""
    path = folder / "draft.yaml"
    path.write_text(draft(found, recording, name="draft"), "utf-8")
    return load(path)


def value_of(signal: SignalCodec, face: RegisterFace, now: float) -> object:
    raw = to = 0
    for point in signal.points:
        raw |= point.within(face.read(point.table, point.address, 1, now)[0]) << to
        to += point.width
    return signal.decode(raw)


def disagreements(got: Ridden, found: Findings, truth: Codec, folder: Path) -> set[str]:
    """Return what the draft says otherwise than the true map, in a second ride of the same lift; empty: it is right."""
    codec = compile_map(loaded_draft(found, got.recording, folder).map)
    compared = [
        name for name in codec.signals if name in truth.signals and name not in ("alive", "level", "car_position")
    ]
    wrong = {f"{name} is not there" for name in codec.signals if name not in {*truth.signals, "car_position"}}

    async def main() -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(got.ended_at + 1)
        plan = [*reversed(usual_plan(list(got.floors))), next(iter(got.floors))]
        riding = asyncio.ensure_future(_ride(Person(got.face, list(got.floors), plan, marks="")))
        while not riding.done():
            await asyncio.sleep(LOOKS_S)
            for name in compared:
                mine = value_of(codec.signals[name], got.face, loop.time())
                true = value_of(truth.signals[name], got.face, loop.time())
                if not _alike(name, mine, true, got, found):
                    wrong.add(f"{name}: {mine} for {true}")
        riding.result()

    run_virtual(main)
    return wrong


async def _ride(person: Person) -> None:
    while await person.next_line() is not None:
        pass


def _alike(signal: str, mine: object, true: object, got: Ridden, found: Findings) -> bool:
    if signal == "car_floor":
        by_draft = {code: name for name, code in found.codes.items()}
        names = {code: name for name, code in got.floors.items()}
        mine_named, true_name = by_draft.get(cast("int", mine)), names.get(cast("int", true))
        # of a floor that was never named the draft may say nothing, but not that it is another one
        return mine_named == true_name if true_name in {*by_draft.values(), None} else mine_named is None
    if signal.startswith("door."):
        return mine == true or (mine is Door.MOVING and true in (Door.OPENING, Door.CLOSING))
    return mine == true


def confident(found: Findings) -> dict[str, Confidence]:
    """Return what is found, without what is not sure."""
    return {one.signal: one.confidence for one in found.usable()}
