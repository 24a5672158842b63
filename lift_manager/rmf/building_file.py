"""Reads the lifts from RMF's own files: the building map of the traffic editor, and the navigation graphs made from it.

Formats as rmf_traffic_editor reads and writes them (rmf_building_map_tools, `building_map/{building,level,lift,vertex}.py`) and as
rmf_fleet_adapter reads the graphs (`agv/parse_graph.cpp`). Every name is the literal text in the file, as with yaml-cpp.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from register_maps.errors import Finding, MapFileError

MAX_BYTES = 20_000_000
"""Larger files are refused unread. Chosen: fifty times the largest map of rmf_demos."""
MAX_DEPTH = 40
"""Chosen: four times what these files need, and far below the recursion limit."""

_Loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader


@dataclass(frozen=True)
class MapLevel:
    """A level of the building."""

    line: int
    elevation: float
    """In metres, from the map; 0 if it has none, as in RMF's tools."""


@dataclass(frozen=True)
class LevelDoors:
    """The doors of a lift at one level."""

    line: int
    doors: tuple[str, ...]


@dataclass(frozen=True)
class MapLift:
    """A lift of the building map."""

    line: int
    levels: Mapping[str, LevelDoors]
    """`level_doors`, by level."""
    doors: frozenset[str]
    """Its doors, by name."""
    mentions: tuple[tuple[str, str, int], ...]
    """Key, level and line of other keys that name a level, such as `lowest_floor`."""


@dataclass(frozen=True)
class LiftVertex:
    """A vertex inside a lift."""

    line: int
    level: str
    lift: str
    x: float
    y: float
    """Metres in a navigation graph, units of the drawing in a building map."""


@dataclass(frozen=True)
class BuildingMap:
    """The lifts of a building map."""

    file: str
    levels: Mapping[str, MapLevel]
    lifts: Mapping[str, MapLift]
    vertices: tuple[LiftVertex, ...]
    """Those with `lift_cabin`."""


@dataclass(frozen=True)
class NavGraph:
    """The lifts of a navigation graph."""

    file: str
    levels: Mapping[str, int]
    """Lines by name."""
    lifts: Mapping[str, int] | None
    """Lines by name; None if the graph has no such part (rmf_traffic_editor before 1.8.2)."""
    vertices: tuple[LiftVertex, ...]


def read_building(path: Path) -> BuildingMap:
    """Read a `.building.yaml`. Raises MapFileError if it is not one."""
    file = str(path)
    root = _table(_root(path))
    levels = dict(_entries(root.get("levels")))
    if not levels:
        raise MapFileError(
            [Finding(file, None, "levels", "no levels: is this the .building.yaml of the traffic editor?")]
        )
    lifts = {name: _lift(line, node) for name, (line, node) in dict(_entries(root.get("lifts"))).items()}
    return BuildingMap(
        file,
        {name: MapLevel(line, _elevation(node)) for name, (line, node) in levels.items()},
        lifts,
        tuple(vertex for name, (_, node) in levels.items() for vertex in _cabin_vertices(name, node)),
    )


def read_graph(path: Path) -> NavGraph:
    """Read a navigation graph, such as `0.yaml`. Raises MapFileError if it is not one."""
    file = str(path)
    root = _table(_root(path))
    levels = dict(_entries(root.get("levels")))
    if not levels:
        raise MapFileError([Finding(file, None, "levels", "no levels: is this a navigation graph of RMF?")])
    lifts = {name: line for name, (line, _) in _entries(root["lifts"])} if "lifts" in root else None
    vertices = tuple(vertex for name, (_, node) in levels.items() for vertex in _lift_vertices(name, node))
    return NavGraph(file, {name: line for name, (line, _) in levels.items()}, lifts, vertices)


def _lift(line: int, node: yaml.Node) -> MapLift:
    table = _table(node)
    levels = {name: LevelDoors(at, tuple(_texts(doors))) for name, (at, doors) in _entries(table.get("level_doors"))}
    mentions = []
    for key in ("reference_floor_name", "lowest_floor", "highest_floor", "initial_floor_name"):
        level = table.get(key)
        if isinstance(level, yaml.ScalarNode) and level.value:
            mentions.append((key, str(level.value), _line(level)))
    return MapLift(line, levels, frozenset(name for name, _ in _entries(table.get("doors"))), tuple(mentions))


def _elevation(node: yaml.Node) -> float:
    table = _number(_table(node).get("elevation"))
    return 0.0 if table is None else table


def _cabin_vertices(level: str, node: yaml.Node) -> Iterator[LiftVertex]:
    """Yield the vertices `[x, y, z, name, {lift_cabin: [1, NAME]}]`."""
    for vertex in _items(_table(node).get("vertices")):
        parts = _items(vertex)
        if len(parts) < 5:
            continue
        table = _items(_table(parts[4]).get("lift_cabin"))
        if len(table) == 2 and (name := _text(table[1])):
            yield LiftVertex(_line(vertex), level, name, _number(parts[0]) or 0.0, _number(parts[1]) or 0.0)


def _lift_vertices(level: str, node: yaml.Node) -> Iterator[LiftVertex]:
    """Yield the vertices `[x, y, {lift: NAME}]`."""
    for vertex in _items(_table(node).get("vertices")):
        parts = _items(vertex)
        if len(parts) < 3 or not (name := _text(_table(parts[2]).get("lift"))):
            continue
        x, y = _number(parts[0]), _number(parts[1])
        if x is not None and y is not None:
            yield LiftVertex(_line(vertex), level, name, x, y)


def _root(path: Path) -> yaml.Node:
    """Return the only document of a file, with aliases resolved. Raises MapFileError."""
    file, text = str(path), _read_text(path)
    try:
        _check_depth(file, text)
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = None if error.problem_mark is None else error.problem_mark.line + 1
        raise MapFileError([Finding(file, line, "", f"this is not YAML: {error.problem}")]) from error
    except yaml.YAMLError as error:
        raise MapFileError([Finding(file, None, "", f"this is not YAML: {error}")]) from error
    if not isinstance(root, yaml.MappingNode):
        raise MapFileError([Finding(file, None, "", "there is no table of keys in this file")])
    return root


def _check_depth(file: str, text: str) -> None:
    """Refuse deeply nested files: composing recurses as deep as the file."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            mark = event.start_mark
            line = None if mark is None else mark.line + 1
            raise MapFileError([Finding(file, line, "", f"nested more than {MAX_DEPTH} levels deep")])


def _read_text(path: Path) -> str:
    def refuse(message: str) -> MapFileError:
        return MapFileError([Finding(str(path), None, "", message)])

    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise refuse("is not an ordinary file")
        if status.st_size > MAX_BYTES:
            raise refuse(f"has {status.st_size} bytes and was not read; the limit is {MAX_BYTES}")
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise refuse("there is no such file") from error
    except UnicodeDecodeError as error:
        raise refuse("is not UTF-8 text") from error
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror or error}") from error


def _table(node: yaml.Node | None) -> dict[str, yaml.Node]:
    if not isinstance(node, yaml.MappingNode):
        return {}
    return {str(key.value): value for key, value in node.value if isinstance(key, yaml.ScalarNode)}


def _entries(node: yaml.Node | None) -> Iterator[tuple[str, tuple[int, yaml.Node]]]:
    """Yield the name, line and node of everything in a table."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if isinstance(key, yaml.ScalarNode):
                yield str(key.value), (_line(key), value)


def _items(node: yaml.Node | None) -> list[yaml.Node]:
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _texts(node: yaml.Node | None) -> Iterator[str]:
    return (text for item in _items(node) if (text := _text(item)))


def _text(node: yaml.Node | None) -> str:
    return str(node.value) if isinstance(node, yaml.ScalarNode) else ""


def _number(node: yaml.Node | None) -> float | None:
    try:
        value = float(_text(node))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1
