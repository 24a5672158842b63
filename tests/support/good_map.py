"""Two maps without mistakes, in which the tests of `check` make one mistake at a time."""

from pathlib import Path

import pytest

from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, load

Mistake = tuple[str, str, str, str, str]
"""Name, text of the good map, what stands there instead, key of the only finding, and words of its message."""

GOOD = """\
schema: 1
name: good
title: A map without mistakes
provenance: {trust: template, sources: [this test]}
addressing: {base: 1}
served:
  holding: [[1, 20], [30, 40]]
  coil: [[1, 16]]
  discrete: [[1, 16]]
  input: [[1, 9]]
signals:
  car_floor: {at: "holding:1", type: int16, as: floor, unknown: [0]}
  motion: {at: "holding:2", values: {1: stopped, 2: up, 3: down}}
  door.front: {at: "holding:3", bits: [4, 5], values: {0: closed, 1: opening, 2: open, 3: closing}}
  door.rear: {open_limit: "discrete:1", closed_limit: "discrete:2"}
  mode: {at: "holding:4", values: {1: normal, 2: independent}}
  fire: {at: "discrete:3", active: low}
  level: {at: "discrete:4"}
  robot_mode_on: {at: "holding:5.1"}
  alive: {at: "holding:6", type: counter, must_change_within_s: 3}
  load: {at: "input:1"}
  call_accepted: {one_of: ["coil:11", "coil:12"]}
commands:
  go_to:
    at: "holding:30"
    as: floor
    action: pulse
    width_s: 0.5
    requires: [robot_mode_on]
    confirm: {any_of: [call_accepted, effect], within_s: 2}
  hold_door.front:
    at: "coil:1"
    action: hold
    max_hold_s: 30
    refresh_s: 2
    on_link_loss: latches
    excludes: [close_door.front]
    confirm: {any_of: [readback], within_s: 2}
  close_door.front:
    at: "coil:2"
    action: pulse
    width_s: 1
    confirm: {any_of: [effect], within_s: 5}
  robot_mode:
    at: "coil:3"
    action: hold
    max_hold_s: 60
    on_link_loss: latches
    granted_by: robot_mode_on
    confirm: {any_of: [effect], within_s: 60}
write_blocks:
  - {at: "coil:1", count: 3, function: 15}
at_floor_evidence: {kind: level}
"""
"""Plain ways to say things; addresses count from 1."""

HANDSHAKE = """\
schema: 1
name: handshake
title: A map without mistakes, with everything that the plain one does without
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
link: {min_gap_s: 0.05}
served:
  holding: [[0, 40], [100, 110]]
  coil: [[0, 63]]
  discrete: [[0, 63]]
  input: [[0, 20]]
endpoints:
  sensor: {served: {discrete: [[0, 7]], holding: [[0, 3]]}}
signals:
  car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"]}
  door.front: {open_limits: ["discrete:0", "discrete:1", "discrete:2"]}
  door.rear: {at: "sensor/discrete:0", active: low}
  motion: {up: "discrete:8", down: "discrete:9"}
  destination: {code_of: ["input:0.0", "input:0.1"], code: gray, active: low, none: [3]}
  calls_registered: {each_of: ["coil:0", "coil:1", "coil:2"]}
  may_enter: {at: "discrete:10"}
  may_leave: {at: "discrete:11"}
  overload: {at: "holding:10", means_yes: 2}
  fire: {at: "holding:11.3", active: low}
  load: {at: "input:2", type: uint32, word_order: high_first, unit: kg}
  watchdog_time: {at: "holding:12", unit_s: 0.1}
commands:
  call:
    one_of: ["coil:0", "coil:1", "coil:2"]
    action: hold
    until: robot_in_place
    max_hold_s: 300
    on_link_loss: latches
    confirm: {any_of: [calls_registered], within_s: 2}
  go:
    at: "holding:20"
    as: floor
    action: hold
    until: robot_left
    max_hold_s: 300
    on_link_loss: device_watchdog
    confirm: {any_of: [destination, effect], within_s: 20}
  robot_in_place: {at: "coil:8", action: pulse, width_s: 5, confirm: {any_of: [readback], within_s: 3}}
  robot_left: {at: "coil:9", action: pulse, width_s: 5, reset_first_s: 0.2, confirm: {any_of: [readback], within_s: 3}}
  heartbeat: {at: "holding:21", action: count, every_s: 0.5}
  hold_door.front:
    at: "holding:30.0"
    read_at: "input:10.0"
    action: hold
    max_hold_s: 30
    refresh_s: 2
    on_link_loss: latches
    shared_word: mask_write
    confirm: {any_of: [readback], within_s: 2}
  close_door.front:
    at: "coil:20"
    action: pulse
    width_s: 0.5
    timed_by: device
    payload: {time: width_s, unit_s: 0.1}
    confirm: {any_of: [effect], within_s: 5}
  hold_door.rear:
    at: "sensor/holding:0"
    action: hold
    max_hold_s: 5
    refresh_s: 1
    on_link_loss: timed_by_device
    payload: {time: max_hold_s, unit_s: 1}
    confirm: {any_of: [effect, readback], within_s: 5}
  close_door.rear:
    at: "holding:30.1"
    action: hold
    until: closed
    max_hold_s: 10
    repeat_pulse_s: 2
    width_s: 0.5
    on_link_loss: latches
    excludes: [hold_door.rear]
    gap_s: 0.5
    shared_word: mask_write
    confirm: {any_of: [effect], within_s: 10}
write_blocks:
  - {at: "holding:20", count: 4, function: 16, every_s: 0.5, gaps: 0}
needs_occupancy: true
at_floor_evidence: {kind: door_limit}
at_same_floor: call
"""
"""A robot's handshake, a second device, and the rarer ways to say things; addresses count from 0."""


def loaded(folder: Path, text: str) -> LoadedMap:
    """Load a map of this text."""
    path = folder / "good.yaml"
    path.write_text(text)
    return load(path)


def changed(good: str, old: str, new: str) -> tuple[str, int]:
    """The good map with one change, and the line it begins in."""
    assert good.count(old) == 1, old
    return good.replace(old, new), good[: good.index(old)].count("\n") + 1


def findings_of(folder: Path, text: str) -> tuple[Finding, ...]:
    """Everything that is refused in a map of this text."""
    with pytest.raises(MapFileError) as caught:
        loaded(folder, text)
    return caught.value.findings


def expect_only(folder: Path, text: str, key: str, words: str) -> None:
    """Assert that a map of this text has one mistake, named by its key, with words that say how to mend it."""
    found = findings_of(folder, text)
    assert [finding.key for finding in found] == [key], "\n".join(map(str, found))
    assert words in found[0].message
    assert found[0].line is not None
