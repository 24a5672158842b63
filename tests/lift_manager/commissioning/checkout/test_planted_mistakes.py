"""Mistakes of wiring and programs, planted one at a time: the checkout names each in words that an electrician understands."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lift_manager.commissioning.checkout.record import Outcome
from register_maps.words import Table
from simulator.faults import ForeignWriter, SaysWrongFloor
from simulator.state import Parameters
from tests.support.checkout_rig import Change, Rig, check_out, site_of, wired_otherwise
from tests.support.programs import ROOT
from tests.support.virtual_time import run_virtual

MAP = "generic-coils"
FIRE, OVERLOAD, CURTAIN, LEVEL, ALLOWED, GRANTED = 25, 22, 21, 18, 24, 23


def swapped(section: str, one: str, other: str) -> Change:
    def change(data: dict[str, Any]) -> None:
        part = data[section]
        part[one]["at"], part[other]["at"] = part[other]["at"], part[one]["at"]

    return change


def crossed_calls(data: dict[str, Any]) -> None:
    calls = data["commands"]["go_to"]["one_of"]
    calls[1], calls[2] = calls[2], calls[1]


def shifted_floors(data: dict[str, Any]) -> None:
    for part in (data["commands"]["go_to"], data["signals"]["car_floor"], data["signals"]["call_accepted"]):
        part["one_of"] = [*part["one_of"][1:], part["one_of"][0]]


def exchanged_limits(data: dict[str, Any]) -> None:
    door = data["signals"]["door.front"]
    door["open_limit"], door["closed_limit"] = door["closed_limit"], door["open_limit"]


def exchanged_directions(data: dict[str, Any]) -> None:
    motion = data["signals"]["motion"]
    motion["up"], motion["down"] = motion["down"], motion["up"]


def level_for_door(data: dict[str, Any]) -> None:
    door, level = data["signals"]["door.front"], data["signals"]["level"]
    door["closed_limit"], level["at"] = level["at"], door["closed_limit"]


def normally_open_fire(data: dict[str, Any]) -> None:
    del data["signals"]["fire"]["active"]


def unwired_robot_mode(data: dict[str, Any]) -> None:
    data["served"]["coil"] = [[0, 11]]
    data["commands"]["robot_mode"]["at"] = "coil:11"
    del data["commands"]["go_to"]["requires"]


def force(address: int, value: int) -> Callable[[Rig], None]:
    def plant(rig: Rig) -> None:
        rig.wiring.forced[Table.DISCRETE, address] = value

    return plant


def drift(address: int) -> Callable[[Rig], None]:
    return lambda rig: rig.wiring.drifting.add((Table.DISCRETE, address))


def refuse_writes(address: int) -> Callable[[Rig], None]:
    return lambda rig: rig.wiring.refused.add((Table.COIL, address))


def begin(fault: Any) -> Callable[[Rig], None]:
    return lambda rig: rig.begin(fault)


SLOW_SCAN = Parameters(scan_s=2.0)
NO_WATCHDOG = Parameters(hold_watchdog_s=math.inf)
ROWS: list[tuple[str, Change | None, Callable[[Rig], None] | None, Parameters | None, str, str]] = [
    (
        "floors shown one too high",
        None,
        begin(SaysWrongFloor()),
        None,
        "S-01",
        "shows L2 .* while the car is at L1: the floors may be shifted by one",
    ),
    (
        "all floors shifted by one, seen at the calls",
        shifted_floors,
        None,
        None,
        "F-02",
        r"called to L2, all signals show L2, and it is at L1: .*all floors are shifted by one; compare the codes of the calls",
    ),
    (
        "two calls crossed",
        crossed_calls,
        None,
        None,
        "F-02",
        r"\(coil:1\), called to L2.*went to L3 instead: the outputs of L2 and L3 may be crossed",
    ),
    (
        "door hold wired to close",
        swapped("commands", "hold_door.front", "close_door.front"),
        None,
        None,
        "C-10",
        r"hold_door.front \(coil:8\).*hold and close.*may be exchanged",
    ),
    (
        "hold and robot mode crossed",
        swapped("commands", "hold_door.front", "robot_mode"),
        None,
        None,
        "C-06",
        r"robot_mode \(coil:10\) is on, and robot_mode_on \(discrete:23\) does not show it; .* and hold_door.front \(coil:8\) may be exchanged",
    ),
    (
        "fire contact not wired, seen at the input",
        None,
        force(FIRE, 1),
        None,
        "S-23",
        r"fire \(discrete:25\) shows no .* it stays the same; check contact, wire",
    ),
    (
        "fire contact not wired, seen in a fire",
        None,
        force(FIRE, 1),
        None,
        "A-05",
        r"not seen at fire \(discrete:25\): the contact is not wired",
    ),
    ("normally-open fire contact", normally_open_fire, None, None, "S-23", r"fire \(discrete:25\) shows yes"),
    (
        "robot mode ignored by the lift",
        unwired_robot_mode,
        force(GRANTED, 1),
        None,
        "A-06",
        r"left for a landing call although robot_mode \(coil:10\) is on: the lift ignores it",
    ),
    (
        "robot mode not wired",
        unwired_robot_mode,
        force(GRANTED, 1),
        None,
        "C-06",
        r"robot_mode \(coil:10\) is on, and the lift is not in robot mode",
    ),
    (
        "overload and light curtain crossed",
        swapped("signals", "overload", "obstruction.front"),
        None,
        None,
        "S-29",
        r"overload \(discrete:22\) shows no .*obstruction.front \(discrete:21\) .*changed instead: the two may be exchanged",
    ),
    (
        "door and level exchanged",
        level_for_door,
        None,
        None,
        "S-13",
        r"door.front \(discrete:16, discrete:17\) shows .*, not open; level \(discrete:18\) from yes to no changed instead",
    ),
    (
        "exception 02 on a write, of a call",
        None,
        refuse_writes(1),
        None,
        "F-02",
        r"go_to \(coil:0, coil:1.*the controller refuses to be written: write 8 coils from 0 .*: exception 02 \(illegal data address\)",
    ),
    (
        "exception 02 on a write, of a hold",
        None,
        refuse_writes(8),
        None,
        "C-10",
        r"^hold_door.front \(coil:8\): the controller refuses to be written: write coil 8 := on, unit 1: exception 02",
    ),
    (
        "exception 02 on a write, of the close button",
        None,
        refuse_writes(9),
        None,
        "C-12",
        r"^close_door.front \(coil:9\): the controller refuses to be written: write coil 9 := on, unit 1: exception 02",
    ),
    (
        "exception 02 on a write, of robot mode",
        None,
        refuse_writes(10),
        None,
        "C-06",
        r"^robot_mode \(coil:10\): the controller refuses to be written: write coil 10 := on, unit 1: exception 02",
    ),
    ("door limits exchanged", exchanged_limits, None, None, "S-13", r"door.front .* shows closed .*, not open"),
    (
        "up and down exchanged",
        exchanged_directions,
        None,
        None,
        "S-05",
        r"motion \(discrete:19, discrete:20\) did not show up while the car went up: it showed down.*may be exchanged",
    ),
    (
        "missing watchdog",
        None,
        None,
        NO_WATCHDOG,
        "A-04",
        r"hold_door.front \(coil:8\): the door was released only 2.* s after the manager was killed: the controller has no watchdog",
    ),
    (
        "pulse too short",
        None,
        None,
        SLOW_SCAN,
        "C-01",
        r"go_to \(coil:1\), called to L2: .*each press lasts 0.5 s, which must be longer than a scan",
    ),
    (
        "stuck input",
        None,
        force(OVERLOAD, 0),
        None,
        "S-29",
        r"overload \(discrete:22\) shows no .*stays the same; check contact, wire",
    ),
    (
        "input that drifts",
        None,
        drift(ALLOWED),
        None,
        "A-01",
        r"robots_allowed \(discrete:24\) changed to .* although nobody touched the lift: the input floats or drifts",
    ),
    (
        "second master on a call",
        None,
        begin(ForeignWriter("go_to", floor=2)),
        None,
        "A-01",
        r"go_to \(coil:.*although nothing was written: another master writes it",
    ),
    (
        "second master on a hold",
        None,
        begin(ForeignWriter("hold_door.front")),
        None,
        "A-01",
        r"hold_door.front \(coil:8\) reads on .*another master writes it",
    ),
]


SLOW_HEARTBEAT = "heartbeat of the manager too slow for the watchdog"
"""As the page names what the last test plants."""
SLOW_BEATS: dict[str, Any] = {
    "served": {"holding": [[0, 7], [16, 20]]},
    "commands": {
        "heartbeat": {"at": "holding:20", "action": "count", "every_s": 4.0},
        "hold_door.front": {"refresh_s": None, "cleared_after_s": None},
        "robot_mode": {"refresh_s": None},
    },
}


def test_every_mistake_that_a_page_leaves_to_the_checkout_is_planted() -> None:
    table = (ROOT / "docs" / "how-to" / "doctor.md").read_text("utf-8").partition("| mistake | found by | how |")[2]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line.startswith("| ")
    ]
    left = {mistake for mistake, by, _ in rows if by == "checkout"}
    names = [row[0] for row in ROWS]
    assert {one for one in left if not any(name.startswith(one) for name in names)} == {SLOW_HEARTBEAT}


def test_a_heartbeat_that_is_too_slow_for_the_watchdog_is_named_with_its_address(tmp_path: Path) -> None:
    loaded = site_of(tmp_path, "generic-registers", {"L1": 1, "L2": 2, "L3": 3}, override=SLOW_BEATS)

    async def main() -> None:
        record = await check_out(Rig(loaded, settings=Parameters(hold_watchdog_s=2.5)), ["C-06"])
        (result,) = record.results
        assert result.outcome is Outcome.FAILED
        words = r"robot_mode \(holding:18\) is on, and robot_mode_on \(holding:5.1\) went away .*heartbeat \(holding:20\) every 4 s"
        assert re.search(words, result.note), result.note
        good = await check_out(Rig(loaded, settings=Parameters(hold_watchdog_s=12.0)), ["C-06"])
        assert [one.note for one in good.results] == [""]

    run_virtual(main, limit_s=30000.0)


@pytest.mark.parametrize(
    ("change", "plant", "settings", "item", "words"), [row[1:] for row in ROWS], ids=[row[0] for row in ROWS]
)
def test_a_planted_mistake_fails_the_item_that_is_made_for_it(
    tmp_path: Path,
    change: Change | None,
    plant: Callable[[Rig], None] | None,
    settings: Parameters | None,
    item: str,
    words: str,
) -> None:
    loaded = site_of(tmp_path)
    wired = None if change is None else wired_otherwise(tmp_path, MAP, change)

    async def main() -> None:
        rig = Rig(loaded, wired=wired, settings=settings)
        if plant is not None:
            plant(rig)
        record = await check_out(rig, [item])
        (result,) = record.results
        assert result.outcome is Outcome.FAILED
        assert re.search(words, result.note), result.note

    run_virtual(main, limit_s=30000.0)
