"""Compares the names of a site with RMF's building map and navigation graphs. RMF compares names exactly, letter by letter.

A mistake makes a robot wait without end or sends it the wrong way; names that RMF merely never uses are notes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import hypot

from lift_manager.rmf.building_file import BuildingMap, LiftVertex, MapLift, NavGraph
from register_maps.error_texts import closest
from register_maps.errors import Finding

ALIGNED_M = 0.1
"""rmf_fleet_adapter refuses a graph in which the vertices of one lift lie further apart (`agv/parse_graph.cpp`)."""


@dataclass(frozen=True)
class SiteLift:
    """One lift of the site file."""

    lift: str
    """Its name in the site file."""
    name: str
    """Its name in RMF."""
    floors: Mapping[str, str]
    """Site's floor name to RMF's, lowest first."""
    doors: Mapping[str, tuple[str, ...]]
    """The sides that open, by the site's floor name."""


@dataclass
class Comparison:
    """The result of comparing a site with RMF's files."""

    mistakes: list[Finding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    suggestions: dict[str, Suggestion] = field(default_factory=dict)
    """By the site's lift name."""
    pairs: dict[str, str] = field(default_factory=dict)
    """The site's lift by the map's lift, if they are certainly or probably the same."""

    def site_file_lines(self) -> Iterator[str]:
        """Yield the lines to write in the site file; none if there is nothing to suggest."""
        if self.suggestions:
            yield "lifts:"
        for lift, suggestion in self.suggestions.items():
            yield f"  {_yaml(lift)}:"
            lines = [f"      {line}" for line in suggestion.lines()]
            yield "    rmf:" if lines else "    rmf: {}"
            yield from lines


@dataclass
class Suggestion:
    """The whole `rmf:` part of one lift, including what is already right in it."""

    name: str | None = None
    floors: dict[str, str] = field(default_factory=dict)
    is_guessed: bool = False
    """The floors are paired by order and not by name."""

    def lines(self) -> Iterator[str]:
        """Yield the part, line by line."""
        if self.name is not None:
            yield f"name: {_yaml(self.name)}"
        if self.floors:
            if self.is_guessed:
                yield "# paired from the lowest floor upwards, because the names are not alike: check whether that is right"
            yield f"floors: {{{', '.join(f'{_yaml(site)}: {_yaml(rmf)}' for site, rmf in self.floors.items())}}}"


def compare(site: Sequence[SiteLift], building: BuildingMap, graphs: Sequence[NavGraph] = ()) -> Comparison:
    """Compare a site with a building map and navigation graphs."""
    found = Comparison()
    _pair_lifts(found, site, building)
    by_lift = {lift.lift: lift for lift in site}
    for name, lift in found.pairs.items():
        _compare_floors(found, by_lift[lift], name, building)
        _compare_doors(found, by_lift[lift], name, building)
    for name, spec in building.lifts.items():
        found.mistakes += _check_lift(building, name, spec)
    found.mistakes += _check_cabins(building)
    for graph in graphs:
        found.mistakes += _check_graph_names(building, graph)
        found.mistakes += _check_alignment(graph)
        found.notes += _report_missing_vertices(building, graph)
    return found


def _pair_lifts(found: Comparison, site: Sequence[SiteLift], building: BuildingMap) -> None:
    """Pair the lifts by name, then the others by similar names, then the last two."""
    by_name = {lift.name: lift for lift in site}
    found.pairs.update({name: by_name[name].lift for name in building.lifts if name in by_name})
    free = [name for name in building.lifts if name not in by_name]
    unmatched = {lift.lift: lift for lift in site if lift.name not in building.lifts}
    similar = _pair_similar({lift.lift: lift.name for lift in unmatched.values()}, free)
    if not similar and len(free) == len(unmatched) == 1:
        similar = {next(iter(unmatched)): free[0]}
    for lift, name in similar.items():
        found.pairs[name] = lift
        found.suggestions[lift] = replace(_current_names(unmatched[lift]), name=name)
        text = (
            f"is called {unmatched[lift].name!r} by the site, and RMF compares exactly; write `rmf: {{name: {_yaml(name)}}}`"
            f" for lift {lift}"
        )
        found.mistakes.append(Finding(building.file, building.lifts[name].line, f"lifts.{name}", text))
    unpaired = [lift for name, lift in unmatched.items() if name not in similar]
    _report_unpaired(found, [name for name in free if name not in similar.values()], unpaired, building)


def _report_unpaired(found: Comparison, names: Sequence[str], lifts: Sequence[SiteLift], building: BuildingMap) -> None:
    """Report lifts without a partner; a lift of the map is a mistake if one of the site's may be meant."""
    for name in names:
        spec = building.lifts[name]
        if not any(at.doors for at in spec.levels.values()):
            continue  # RMF's tools leave it out, too
        if lifts:
            text = (
                f"no lift of the site is called {name!r}; should {' or '.join(lift.lift for lift in lifts)} be that lift, write"
                f" `rmf: {{name: {_yaml(name)}}}` for it"
            )
            found.mistakes.append(Finding(building.file, spec.line, f"lifts.{name}", text))
        else:
            found.notes.append(
                f"{name}: is on the map and not on this site; a robot that requests it waits for another adapter"
            )
    for lift in lifts:
        near = closest(lift.name, building.lifts)
        found.notes.append(
            f"{lift.lift}: no robot of RMF will request it, because the map has no lift {lift.name!r}{near}"
        )


def _current_names(lift: SiteLift) -> Suggestion:
    floors = {floor: rmf for floor, rmf in lift.floors.items() if rmf != floor}
    return Suggestion(None if lift.name == lift.lift else lift.name, floors)


def _compare_floors(found: Comparison, lift: SiteLift, name: str, building: BuildingMap) -> None:
    """Compare the floors of one lift with the levels at which the map gives it a door."""
    spec = building.lifts[name]
    served = [level for level, at in spec.levels.items() if at.doors]
    known = set(lift.floors.values())
    missing = [level for level in served if level not in known]
    unused = {floor: rmf for floor, rmf in lift.floors.items() if rmf not in served}
    similar, is_guessed = _pair_similar(unused, missing), False
    if missing and not similar:
        similar = _pair_by_height(unused, missing, building)
        is_guessed = bool(similar)
    by_level = {level: floor for floor, level in similar.items()}
    for level in missing:
        key, line = f"lifts.{name}.level_doors.{level}", spec.levels[level].line
        if level in by_level:
            floor = by_level[level]
            perhaps = "is perhaps" if is_guessed else "is called"
            text = (
                f"{perhaps} {unused[floor]!r} by the site, and RMF compares exactly; write"
                f" `rmf: {{floors: {{{_yaml(floor)}: {_yaml(level)}}}}}` for lift {lift.lift}"
            )
        else:
            text = (
                f"no floor of lift {lift.lift} is called {level!r}; it has {', '.join(map(repr, lift.floors.values()))}:"
                " a robot that has to go there waits without end"
            )
        found.mistakes.append(Finding(building.file, line, key, text))
    if similar:
        suggestion = found.suggestions.setdefault(lift.lift, _current_names(lift))
        suggestion.floors = {
            floor: similar.get(floor, rmf) for floor, rmf in lift.floors.items() if similar.get(floor, rmf) != floor
        }
        suggestion.is_guessed = is_guessed
    for floor, rmf in unused.items():
        if floor not in similar:
            where = "without a door there" if rmf in spec.levels else f"that does not serve {rmf!r}"
            found.notes.append(
                f"{lift.lift}: in the map this is lift {name}, {where}, so no robot of RMF will request floor {floor}"
            )


def _pair_by_height(unused: Mapping[str, str], missing: Sequence[str], building: BuildingMap) -> dict[str, str]:
    """Pair the floors with as many levels from the lowest upwards, if the map has the height of each."""
    heights = {building.levels[level].elevation: level for level in missing if level in building.levels}
    if len(heights) != len(missing) or len(missing) != len(unused):
        return {}
    return dict(zip(unused, (heights[height] for height in sorted(heights)), strict=True))


def _compare_doors(found: Comparison, lift: SiteLift, name: str, building: BuildingMap) -> None:
    """Compare how many doors open at each floor."""
    spec = building.lifts[name]
    suggestion = found.suggestions.get(lift.lift, Suggestion())
    for floor, rmf in lift.floors.items():
        level = suggestion.floors.get(floor, rmf)
        at = spec.levels.get(level)
        if at is None or not at.doors or len(at.doors) == len(lift.doors[floor]):
            continue
        text = (
            f"the map opens {_count(at.doors)} here, and lift {lift.lift} {_count(lift.doors[floor])} at floor {floor}: the door counts as"
            " open for robots only once all of the site's doors are; make the map and the `doors` of that floor agree"
        )
        found.mistakes.append(Finding(building.file, at.line, f"lifts.{name}.level_doors.{level}", text))


def _check_lift(building: BuildingMap, name: str, spec: MapLift) -> Iterator[Finding]:
    """Yield mistakes within one lift of the map."""
    for key, level, line in spec.mentions:
        if level not in building.levels:
            yield Finding(building.file, line, f"lifts.{name}.{key}", _no_level(level, building.levels))
    for level, at in spec.levels.items():
        key = f"lifts.{name}.level_doors.{level}"
        if level not in building.levels:
            yield Finding(building.file, at.line, key, _no_level(level, building.levels))
        for door in at.doors:
            if door not in spec.doors:
                text = f"the lift has no door {door!r}{closest(door, spec.doors)}"
                yield Finding(building.file, at.line, key, text)


def _check_cabins(building: BuildingMap) -> Iterator[Finding]:
    """Yield vertices in a lift that the map does not have."""
    for vertex in building.vertices:
        if vertex.lift not in building.lifts:
            text = (
                f"this vertex is in lift {vertex.lift!r}, which the map has not{closest(vertex.lift, building.lifts)}"
            )
            yield Finding(building.file, vertex.line, f"levels.{vertex.level}.vertices", text)
        elif not _serves(building.lifts[vertex.lift], vertex.level):
            text = f"this vertex is in lift {vertex.lift}, which has no door at {vertex.level}; give it one in `level_doors`, or move the vertex"
            yield Finding(building.file, vertex.line, f"levels.{vertex.level}.vertices", text)


def _check_graph_names(building: BuildingMap, graph: NavGraph) -> Iterator[Finding]:
    """Yield levels and lifts of the graph that the map does not have: it was made from another map, or by hand."""
    for level, line in graph.levels.items():
        if level not in building.levels:
            yield Finding(graph.file, line, f"levels.{level}", _no_level(level, building.levels))
    for name, line in (graph.lifts or {}).items():
        if name not in building.lifts:
            text = f"the map has no lift {name!r}{closest(name, building.lifts)}; make the graph from the map again"
            yield Finding(graph.file, line, f"lifts.{name}", text)
    for vertex in graph.vertices:
        key = f"levels.{vertex.level}.vertices"
        if vertex.lift not in building.lifts:
            text = (
                f"this vertex is in lift {vertex.lift!r}, which the map has not{closest(vertex.lift, building.lifts)}"
            )
            yield Finding(graph.file, vertex.line, key, text)
        elif vertex.level in building.levels and not _serves(building.lifts[vertex.lift], vertex.level):
            text = f"this vertex is in lift {vertex.lift}, which by the map has no door at {vertex.level}: no robot can leave it there"
            yield Finding(graph.file, vertex.line, key, text)
        if graph.lifts is not None and vertex.lift not in graph.lifts:
            text = f"the graph's `lifts` has no {vertex.lift!r}, so the fleet adapter refuses it; make the graph from the map again"
            yield Finding(graph.file, vertex.line, key, text)


def _check_alignment(graph: NavGraph) -> Iterator[Finding]:
    """Yield lifts whose vertices are not above each other."""
    by_lift: dict[str, list[LiftVertex]] = {}
    for vertex in graph.vertices:
        by_lift.setdefault(vertex.lift, []).append(vertex)
    for name, vertices in by_lift.items():
        apart = max(combinations(vertices, 2), key=_distance, default=None)
        if apart is None or _distance(apart) <= ALIGNED_M:
            continue
        one, other = apart
        text = (
            f"the vertices of lift {name} lie {_distance(apart):.2f} m apart ({one.level} {one.x:.2f}, {one.y:.2f} in line {one.line}, and"
            f" {other.level} {other.x:.2f}, {other.y:.2f}); the fleet adapter refuses more than {ALIGNED_M:g} m:"
            " put them above each other in the traffic editor (`Add lift waypoints`)"
        )
        yield Finding(graph.file, other.line, f"levels.{other.level}.vertices", text)


def _report_missing_vertices(building: BuildingMap, graph: NavGraph) -> Iterator[str]:
    """Yield levels at which a lift has a door, but the graph has no vertex in it: robots of this graph do not ride there."""
    if graph.lifts is None:
        yield f"{graph.file}: has no `lifts`, which rmf_traffic_editor writes since 1.8.2 and newer fleet adapters require; make it again"
    reached = {(vertex.lift, vertex.level) for vertex in graph.vertices}
    for name, spec in building.lifts.items():
        without = [level for level, at in spec.levels.items() if at.doors and (name, level) not in reached]
        if without:
            yield f"{graph.file}: has no vertex in lift {name} at {', '.join(without)}, so the robots of this graph do not ride there"


def _distance(pair: tuple[LiftVertex, LiftVertex]) -> float:
    return hypot(pair[0].x - pair[1].x, pair[0].y - pair[1].y)


def _serves(lift: MapLift, level: str) -> bool:
    return level in lift.levels and bool(lift.levels[level].doors)


def _no_level(level: str, levels: Iterable[str]) -> str:
    known = tuple(levels)
    return f"the map has no level {level!r}{closest(level, known)}; it has {', '.join(map(repr, known))}"


def _pair_similar(names: Mapping[str, str], free: Iterable[str]) -> dict[str, str]:
    """Pair names that differ only in case, spaces, `_` and `-`, by the key of `names`. A name similar to two others stays alone."""
    folded: dict[str, list[str]] = {}
    for name in free:
        folded.setdefault(_folded(name), []).append(name)
    by_fold: dict[str, list[str]] = {}
    for key, name in names.items():
        by_fold.setdefault(_folded(name), []).append(key)
    return {
        keys[0]: folded[fold][0] for fold, keys in by_fold.items() if len(keys) == 1 and len(folded.get(fold, ())) == 1
    }


def _folded(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter not in " _-\t")


def _count(doors: Sequence[str]) -> str:
    return f"{len(doors)} door{'' if len(doors) == 1 else 's'} ({', '.join(doors)})"


def _yaml(text: str) -> str:
    """Quote a name for YAML if necessary."""
    plain = text.replace(" ", "").replace("_", "").replace("-", "").isalnum() and text[:1].isalpha()
    words = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}
    if plain and text == text.strip() and text.lower() not in words:
        return text
    return "'" + text.replace("'", "''") + "'"
