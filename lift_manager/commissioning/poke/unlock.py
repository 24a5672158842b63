"""Unlocks the commands of a draft map for a bounded time: the only way to write what the lift's own map does not name.

The rules stay: the draft takes the place of the lift's map, in a manager that runs for this trial alone, and a session presses its
commands. Only `writable_ranges` of the site file may be written, and never an address that another lift of the site writes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from lift_manager.commissioning.poke.trial import NotPossible
from lift_manager.config.check_devices import check_devices
from lift_manager.config.check_floors import check_floors
from lift_manager.config.check_outputs import check_outputs
from lift_manager.config.check_use import check_unset
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.lift.journal import Json, Row, RowKind
from register_maps.codec import compile_map
from register_maps.load import load

LONGEST_S = 1800.0
"""Chosen: a trial takes a minute, and a forgotten unlock must not last into the next shift."""


@dataclass(frozen=True, slots=True)
class Unlock:
    """A person's decision to write what a draft map names."""

    draft: str
    """A map file by its path."""
    by: str
    """The name of the person."""
    reason: str
    for_s: float

    def row(self, lift: str) -> Row:
        """Return the row of the journal."""
        text = f"unlocked the commands of the draft map {self.draft} for {self.for_s:g} s: {self.reason}"
        data: dict[str, Json] = {"said": "unlock", "draft": self.draft, "reason": self.reason, "for_s": self.for_s}
        return Row(RowKind.PERSON, text, lift, self.by, data)


def with_draft(loaded: LoadedSite, lift: str, draft: str) -> LoadedSite:
    """Return a site in which a draft takes the place of a lift's map. Raises MapFileError, and NotPossible for what the site forbids."""
    if lift not in loaded.site.lifts:
        raise NotPossible(f"no lift {lift!r}; the lifts are {', '.join(loaded.site.lifts)}")
    unlocked = replace(loaded, maps={**loaded.maps, lift: load(draft, near=Path.cwd())})
    if problem := next(_problems(unlocked, lift), None):
        raise NotPossible(f"the draft map {draft} cannot be unlocked for {lift}: {problem}")
    return unlocked


def _problems(loaded: LoadedSite, name: str) -> Iterator[str]:
    site, lift, draft = loaded.site, loaded.site.lifts[name], loaded.maps[name]
    codec = compile_map(draft.map, offset=lift.offset)
    key = ("lifts", name)
    for problem in (*check_unset(key, lift, draft), *check_devices(key, lift, codec), *check_floors(key, lift, codec)):
        yield problem.message
    yield from _outside_ranges(loaded, name)
    # whichever lifts the site file lets robots command: another lift of the building must not move
    commanded = {other: entry.model_copy(update={"access": "control"}) for other, entry in site.lifts.items()}
    for problem in check_outputs(site.model_copy(update={"lifts": commanded}), loaded.maps):
        yield problem.message


def _outside_ranges(loaded: LoadedSite, name: str) -> Iterator[str]:
    """Yield commands of the draft that write outside the ranges of their controller."""
    site, lift, draft = loaded.site, loaded.site.lifts[name], loaded.maps[name].map
    placed = devices(site, lift, draft)
    for command in compile_map(draft, offset=lift.offset).commands.values():
        for block in command.blocks:
            controller = placed[block.endpoint].controller
            ranges = site.controllers[controller].writable_ranges
            for _, table, address in block.cells:
                if not any(one.holds(table, address) for one in ranges):
                    where = f"{table} {address} on the wire"
                    yield (
                        f"{command.name} writes {where}, which is in none of `writable_ranges` of the controller {controller} in"
                        f" {loaded.path}; add it there if the owner of the lift agrees"
                    )
                    break
