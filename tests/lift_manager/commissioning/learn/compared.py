"""Whether a draft reads a lift as its true map does, at every moment of a further ride."""

from pathlib import Path
from typing import cast

from lift_manager.commissioning.learn.analyse import Findings
from lift_manager.commissioning.learn.draft import draft
from lift_manager.commissioning.learn.samples import Recording
from lift_manager.commissioning.learn.tracks import Confidence
from register_maps.codec import Codec, compile_map
from register_maps.load import LoadedMap, load
from register_maps.words import Door
from tests.lift_manager.commissioning.learn.riding import Ridden


def loaded_draft(found: Findings, recording: Recording, folder: Path) -> LoadedMap:
    """Return the draft as a map; raises MapFileError if it is none."""
    path = folder / "draft.yaml"
    path.write_text(draft(found, recording, name="draft"), "utf-8")
    return load(path)


def disagreements(got: Ridden, found: Findings, truth: Codec, folder: Path) -> set[str]:
    """Return what the draft says otherwise than the true map, in a second ride of the same lift; empty: it is right."""
    codec = compile_map(loaded_draft(found, got.recording, folder).map)
    compared = [
        name for name in codec.signals if name in truth.signals and name not in ("alive", "level", "car_position")
    ]
    wrong = {f"{name} is not there" for name in codec.signals if name not in {*truth.signals, "car_position"}}
    for image in got.shown_again:
        for name in compared:
            mine, true = (one.signals[name].decode(one.signals[name].extract(image)) for one in (codec, truth))
            if not _alike(name, mine, true, got, found):
                wrong.add(f"{name}: {mine} for {true}")
    return wrong


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
