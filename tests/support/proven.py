"""Lifts whose door signal was proven by a trip before the test begins: what the manager would have saved of it."""

from collections.abc import Iterable
from dataclasses import replace

from drivers.model import Capabilities
from lift_manager.lift.trust import Trust
from lift_manager.runtime.recorder import MemoryRecorder, Recorder, SavedLift


def proven(lifts: Iterable[str], able: Capabilities, recorder: Recorder | None = None) -> Recorder:
    """Return a recorder, a new one where none is given, in which each of these lifts has had its door proven with this map."""
    recorder = recorder or MemoryRecorder()
    trust = Trust(able.map_hash, door_proven=True)
    for lift in lifts:
        saved = recorder.recall(lift) or SavedLift()
        recorder.keep(lift, replace(saved, record=replace(saved.record, trust=trust)))
    return recorder
