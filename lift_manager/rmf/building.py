"""Compare the names of a site with RMF's building map and navigation graph. RMF compares names exactly, letter by letter.

A mistake is what lets a robot wait for ever or sends it the wrong way; what is merely of no use to RMF is a note.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import hypot

from lift_manager.rmf.building_file import BuildingMap, LiftVertex, MapLift, NavGraph
from register_maps.errors import Finding
from register_maps.plain import closest

ALIGNED_M = 0.1
"""rmf_fleet_adapter refuses a graph in which the vertices of one lift lie further apart (`agv/parse_graph.cpp`)."""


@dataclass(frozen=True)
class SiteLift:
    """One lift as the site file has it."""

    lift: str
    """Its name in the site file."""
    name: str
    """What RMF is told it is called."""
    floors: Mapping[str, str]
    """Site's floor name to RMF's, lowest first."""
    doors: Mapping[str, tuple[str, ...]]
    """The sides that open, by the site's floor name."""


@dataclass
class Comparison:
    """What came of it."""

    mistakes: list[Finding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    suggestions: dict[str, Suggestion] = field(default_factory=dict)
    """By the site's lift name."""
    pairs: dict[str, str] = field(default_factory=dict)
    """The site's lift by the map's, where they are surely or probably the same."""

    def block(self) -> Iterator[str]:
        """Yield the lines to write in the site file; none where nothing is to be suggested."""
        if self.suggestions:
            yield "lifts:"
        for lift, said in self.suggestions.items():
            yield f"  {_yaml(lift)}:"
            lines = [f"      {line}" for line in said.lines()]
            yield "    rmf:" if lines else "    rmf: {}"
            yield from lines


@dataclass
class Suggestion:
    """The whole `rmf:` part of one lift, with what is right in it already."""

    name: str | None = None
    floors: dict[str, str] = field(default_factory=dict)
    guessed: bool = False
    """The floors are paired by their order and not by their names."""

    def lines(self) -> Iterator[str]:
        """Yield the part, line by line."""
        if self.name is not None:
            yield f"name: {_yaml(self.name)}"
        if self.floors:
            if self.guessed:
                yield "# paired from the lowest floor upwards, because the names are not alike: look whether that is right"
            yield f"floors: {{{', '.join(f'{_yaml(site)}: {_yaml(rmf)}' for site, rmf in self.floors.items())}}}"


def compare(site: Sequence[SiteLift], building: BuildingMap, graphs: Sequence[NavGraph] = ()) -> Comparison:
    """Find what does not match."""
    found = Comparison()
    _pair_lifts(found, site, building)
    by_lift = {lift.lift: lift for lift in site}
    for name, lift in found.pairs.items():
        _floors(found, by_lift[lift], name, building)
        _doors(found, by_lift[lift], name, building)
    for name, spec in building.lifts.items():
        found.mistakes += _within(building, name, spec)
    found.mistakes += _cabins(building)
    for graph in graphs:
        found.mistakes += _graph_names(building, graph)
        found.mistakes += _alignment(graph)
        found.notes += _not_in_graph(building, graph)
    return found


def _pair_lifts(found: Comparison, site: Sequence[SiteLift], building: BuildingMap) -> None:
    """Pair the lifts by name, then those left by names that are alike, then the only two left."""
    by_name = {lift.name: lift for lift in site}
    found.pairs.update({name: by_name[name].lift for name in building.lifts if name in by_name})
    free = [name for name in building.lifts if name not in by_name]
    left = {lift.lift: lift for lift in site if lift.name not in building.lifts}
    alike = _alike({lift.lift: lift.name for lift in left.values()}, free)
    if not alike and len(free) == len(left) == 1:
        alike = {next(iter(left)): free[0]}
    for lift, name in alike.items():
        found.pairs[name] = lift
        found.suggestions[lift] = replace(_as_it_is(left[lift]), name=name)
        text = (
            f"is called {left[lift].name!r} by the site, and RMF compares exactly; write `rmf: {{name: {_yaml(name)}}}`"
            f" for lift {lift}"
        )
        found.mistakes.append(Finding(building.file, building.lifts[name].line, f"lifts.{name}", text))
    unpaired = [lift for name, lift in left.items() if name not in alike]
    _unpaired(found, [name for name in free if name not in alike.values()], unpaired, building)


def _unpaired(found: Comparison, names: Sequence[str], lifts: Sequence[SiteLift], building: BuildingMap) -> None:
    """Say what has no partner; a lift of the map is a mistake where one of ours may be meant."""
    for name in names:
        spec = building.lifts[name]
        if not any(at.doors for at in spec.levels.values()):
            continue  # as the tools of RMF, which leave it out
        if lifts:
            text = (
                f"no lift of the site is called {name!r}; should {' or '.join(lift.lift for lift in lifts)} be that lift, write"
                f" `rmf: {{name: {_yaml(name)}}}` for it"
            )
            found.mistakes.append(Finding(building.file, spec.line, f"lifts.{name}", text))
        else:
            found.notes.append(
                f"{name}: is on the map and not on this site; a robot that asks for it waits for another adapter"
            )
    for lift in lifts:
        near = closest(lift.name, building.lifts)
        found.notes.append(
            f"{lift.lift}: no robot of RMF will ask for it, because the map has no lift {lift.name!r}{near}"
        )


def _as_it_is(lift: SiteLift) -> Suggestion:
    floors = {floor: rmf for floor, rmf in lift.floors.items() if rmf != floor}
    return Suggestion(None if lift.name == lift.lift else lift.name, floors)


def _floors(found: Comparison, lift: SiteLift, name: str, building: BuildingMap) -> None:
    """Compare the floors of one lift with the levels at which the map gives it a door."""
    spec = building.lifts[name]
    served = [level for level, at in spec.levels.items() if at.doors]
    told = set(lift.floors.values())
    missing = [level for level in served if level not in told]
    unused = {floor: rmf for floor, rmf in lift.floors.items() if rmf not in served}
    alike, guessed = _alike(unused, missing), False
    if missing and not alike:
        alike = _by_height(unused, missing, building)
        guessed = bool(alike)
    by_level = {level: floor for floor, level in alike.items()}
    for level in missing:
        key, line = f"lifts.{name}.level_doors.{level}", spec.levels[level].line
        if level in by_level:
            floor = by_level[level]
            perhaps = "is perhaps" if guessed else "is called"
            text = (
                f"{perhaps} {unused[floor]!r} by the site, and RMF compares exactly; write"
                f" `rmf: {{floors: {{{_yaml(floor)}: {_yaml(level)}}}}}` for lift {lift.lift}"
            )
        else:
            text = (
                f"no floor of lift {lift.lift} is called {level!r}; it has {', '.join(map(repr, lift.floors.values()))}:"
                " a robot that wants to go there waits for ever"
            )
        found.mistakes.append(Finding(building.file, line, key, text))
    if alike:
        said = found.suggestions.setdefault(lift.lift, _as_it_is(lift))
        said.floors = {
            floor: alike.get(floor, rmf) for floor, rmf in lift.floors.items() if alike.get(floor, rmf) != floor
        }
        said.guessed = guessed
    for floor, rmf in unused.items():
        if floor not in alike:
            where = "without a door there" if rmf in spec.levels else f"that does not serve {rmf!r}"
            found.notes.append(
                f"{lift.lift}: in the map this is lift {name}, {where}, so no robot of RMF will ask for floor {floor}"
            )


def _by_height(unused: Mapping[str, str], missing: Sequence[str], building: BuildingMap) -> dict[str, str]:
    """Pair the floors with as many levels from the lowest upwards, where the map says how high each one is."""
    heights = {building.levels[level].elevation: level for level in missing if level in building.levels}
    if len(heights) != len(missing) or len(missing) != len(unused):
        return {}
    return dict(zip(unused, (heights[height] for height in sorted(heights)), strict=True))


def _doors(found: Comparison, lift: SiteLift, name: str, building: BuildingMap) -> None:
    """Compare how many doors open at each floor."""
    spec = building.lifts[name]
    said = found.suggestions.get(lift.lift, Suggestion())
    for floor, rmf in lift.floors.items():
        level = said.floors.get(floor, rmf)
        at = spec.levels.get(level)
        if at is None or not at.doors or len(at.doors) == len(lift.doors[floor]):
            continue
        text = (
            f"the map opens {_count(at.doors)} here, and lift {lift.lift} {_count(lift.doors[floor])} at floor {floor}: a robot is told"
            " that the door is open only once all of the site's are; make the map and the `doors` of that floor agree"
        )
        found.mistakes.append(Finding(building.file, at.line, f"lifts.{name}.level_doors.{level}", text))


def _within(building: BuildingMap, name: str, spec: MapLift) -> Iterator[Finding]:
    """Yield what is wrong with a lift of the map by itself."""
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


def _cabins(building: BuildingMap) -> Iterator[Finding]:
    """Yield vertices that are in a lift which is not there."""
    for vertex in building.vertices:
        if vertex.lift not in building.lifts:
            text = (
                f"this vertex is in lift {vertex.lift!r}, which the map has not{closest(vertex.lift, building.lifts)}"
            )
            yield Finding(building.file, vertex.line, f"levels.{vertex.level}.vertices", text)
        elif not _serves(building.lifts[vertex.lift], vertex.level):
            text = f"this vertex is in lift {vertex.lift}, which has no door at {vertex.level}; give it one in `level_doors`, or move the vertex"
            yield Finding(building.file, vertex.line, f"levels.{vertex.level}.vertices", text)


def _graph_names(building: BuildingMap, graph: NavGraph) -> Iterator[Finding]:
    """Yield levels and lifts of the graph that are not those of the map: it was made of another one, or by hand."""
    for level, line in graph.levels.items():
        if level not in building.levels:
            yield Finding(graph.file, line, f"levels.{level}", _no_level(level, building.levels))
    for name, line in (graph.lifts or {}).items():
        if name not in building.lifts:
            text = f"the map has no lift {name!r}{closest(name, building.lifts)}; make the graph anew from the map"
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
            text = f"the graph's `lifts` has no {vertex.lift!r}, so the fleet adapter refuses it; make the graph anew from the map"
            yield Finding(graph.file, vertex.line, key, text)


def _alignment(graph: NavGraph) -> Iterator[Finding]:
    """Yield lifts whose vertices do not lie above each other."""
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


def _not_in_graph(building: BuildingMap, graph: NavGraph) -> Iterator[str]:
    """Yield where a lift has a door, and the graph no vertex in it: robots of this graph do not ride to there."""
    if graph.lifts is None:
        yield f"{graph.file}: has no `lifts`, which rmf_traffic_editor writes since 1.8.2 and newer fleet adapters ask for; make it anew"
    there = {(vertex.lift, vertex.level) for vertex in graph.vertices}
    for name, spec in building.lifts.items():
        without = [level for level, at in spec.levels.items() if at.doors and (name, level) not in there]
        if without:
            yield f"{graph.file}: has no vertex in lift {name} at {', '.join(without)}, so the robots of this graph do not ride to there"


def _distance(pair: tuple[LiftVertex, LiftVertex]) -> float:
    return hypot(pair[0].x - pair[1].x, pair[0].y - pair[1].y)


def _serves(lift: MapLift, level: str) -> bool:
    return level in lift.levels and bool(lift.levels[level].doors)


def _no_level(level: str, levels: Iterable[str]) -> str:
    known = tuple(levels)
    return f"the map has no level {level!r}{closest(level, known)}; it has {', '.join(map(repr, known))}"


def _alike(names: Mapping[str, str], free: Iterable[str]) -> dict[str, str]:
    """Pair what differs only in case, spaces, `_` and `-`; by the key of `names`. What is alike to two is paired with none."""
    folded: dict[str, list[str]] = {}
    for name in free:
        folded.setdefault(_fold(name), []).append(name)
    wanted: dict[str, list[str]] = {}
    for key, name in names.items():
        wanted.setdefault(_fold(name), []).append(key)
    return {
        keys[0]: folded[fold][0] for fold, keys in wanted.items() if len(keys) == 1 and len(folded.get(fold, ())) == 1
    }


def _fold(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter not in " _-\t")


def _count(doors: Sequence[str]) -> str:
    return f"{len(doors)} door{'' if len(doors) == 1 else 's'} ({', '.join(doors)})"


def _yaml(text: str) -> str:
    """Write a name so that YAML reads it as that text."""
    plain = text.replace(" ", "").replace("_", "").replace("-", "").isalnum() and text[:1].isalpha()
    words = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}
    if plain and text == text.strip() and text.lower() not in words:
        return text
    return "'" + text.replace("'", "''") + "'"
