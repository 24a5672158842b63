"""Lifts whose door signal was proven by a trip before the test begins: what the manager would have written down of it."""

from collections.abc import Iterable
from dataclasses import replace

from drivers.model import Capabilities
from lift_manager.core.memory import Memory, ShortMemory
from lift_manager.domain.contradictions import Trust


def proven(lifts: Iterable[str], able: Capabilities, memory: Memory | None = None) -> Memory:
    """Return a memory, a new one where none is given, in which each of these lifts has had its door proven with this map."""
    memory = memory or ShortMemory()
    for lift in lifts:
        memory.keep(lift, replace(memory.recall(lift), trust=Trust(able.map_hash, door_proven=True)))
    return memory
