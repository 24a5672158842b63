"""Reports every mistake of one map, or the cautions about a correct one."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.commissioning.wording import one_line
from lift_manager.config.load import map_report
from register_maps.load import LoadedMap, load


def report(name_or_path: str) -> list[str]:
    """Check a shipped map by its name, or a file. Raises MapFileError with every finding."""
    loaded = load(name_or_path)
    missing = [f"a site must add: {name}: {one_line(why)}" for name, why in loaded.map.needs.items()]
    return [*unset_text(loaded), *missing, *map_report(loaded)]


def unset_text(loaded: LoadedMap) -> Iterator[str]:
    """Yield a line for every parameter that has no default, and whose example stands in here."""
    for name in loaded.unset:
        about = one_line(loaded.map.parameters[name].help)
        yield f"every site must set: {name}: {about}; taken here as {loaded.parameters[name]}, its example"
