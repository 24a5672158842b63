"""The fault matrix: every fault in every phase of a ride on every map; what the robot was told, and what was wrong meanwhile.

    python -m tests.campaigns.matrix --write     (writes tests/campaigns/MATRIX.md)

It measures without excuses: a pair that `lift_manager.commissioning.detection` calls detected must be so within its time.
"""

import argparse
import asyncio
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from enum import StrEnum, unique
from pathlib import Path

from lift_manager.commissioning.detection import Detection, FaultEffect, detections
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.fault_names import every_device_fault, fault_name
from lift_manager.lab.world.lift_under_test import Finding, LiftUnderTest, SuspectValues
from lift_manager.lab.world.oracle import FROZEN_FAULTS, Oracle
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from register_maps.codec import compile_map
from register_maps.words import Mode
from simulator import faults as device
from simulator import wire_faults as wire
from simulator.faults import Fault, InMode
from simulator.wire_faults import WireFault
from tests.campaigns.playing import LIFT, applies, loaded_site
from tests.campaigns.truth import maps, quiet
from tests.support.trip_sites import NO_TRIP

LASTS_S = 20.0
"""How long a fault is there. Longer than any time within which one is detected."""
AFTER_S = 8.0
STARTS_S = 2.0
"""For the first readings, and the first beat of a heartbeat."""
WAITS_S = 40.0
"""How long a phase may take to come about."""
UPSET_AFTER_S = 5.0
"""When people set the lift on fire under registers that stand still, so that what is frozen is no longer so."""
ROBOT = Holder("fleet", "r1")
WRITTEN = Path(__file__).with_name("MATRIX.md")

WIRE: tuple[WireFault, ...] = (
    wire.Delay(0.3),
    wire.LongTailedDelay(0.1),
    wire.DropRequest(),
    wire.DropAnswer(),
    wire.DuplicateAnswer(0.1),
    wire.ReorderAnswers(),
    wire.LateAnswer(0.9),
    wire.TruncateAnswer(),
    wire.SplitAnswer(),
    wire.MergeAnswers(),
    wire.WrongTransactionId(),
    wire.WrongUnit(),
    wire.WrongFunction(),
    wire.WrongCount(),
    wire.WrongEcho(),
    wire.AnswerWithException(4),
    wire.AnswerWithException(6),
    wire.GarbageAnswer(),
    wire.GarbageBefore(),
    wire.ResetConnection(),
    wire.HalfOpen(),
    wire.AcceptAndSayNothing(),
    wire.ConnectionLimit(0),
    wire.RefuseConnections(),
    wire.Bandwidth(200),
)
"""One of every kind of fault on the wire."""


@unique
class Phase(StrEnum):
    """Where a ride is when the fault begins."""

    IDLE = "idle"
    TRAVELLING = "travelling"
    DOOR_HELD = "door held"


@dataclass(frozen=True)
class Cell:
    """One fault in one phase on one map."""

    map: str
    fault: str
    phase: Phase
    told: str
    """What the robot was told, from the beginning of the fault to its end."""
    lies: tuple[tuple[FaultEffect, float], ...]
    """What was wrong, and for how long after the beginning it last was."""
    findings: tuple[str, ...]
    """What no detection speaks of: never allowed."""


def device_faults() -> tuple[Fault, ...]:
    """Return one of every fault of a device, somebody else's writes included."""
    foreign = device.ForeignWriter("hold_door.front"), device.ForeignWriter("hold_door.front", pressed=False)
    return (*every_device_fault(), *foreign)


def cell(name: str, fault: Fault | WireFault, phase: Phase) -> Cell:
    """Play one cell; where the lift has nothing that could fail like this, or never comes to this phase, it says so."""
    loaded = loaded_site(name, 900.0, 300.0, 0.0)
    judges = oracle_of(loaded).lifts
    oracle = Oracle({lift: replace(judged, excuses={}) for lift, judged in judges.items()})
    watch = _Watch()

    async def main() -> str:
        world = World(loaded, (oracle,))
        async with world.running():
            if not await _reach(world, phase):
                return f"not tried: the ride never came to {phase}"
            if isinstance(fault, Fault) and not applies(world, LIFT, fault):
                return "not tried: the map has no such command"
            watch.began = asyncio.get_running_loop().time()
            watch.look(world)
            _set(world, fault, on=True)
            await _watched(world, watch, fault)
            _set(world, fault, on=False)
            await elapse(AFTER_S)
        return ""

    if why_not := run_virtual(main, limit_s=600):
        return Cell(name, _name(fault), phase, why_not, (), ())
    lies: dict[FaultEffect, float] = {}
    others: list[Finding] = []
    for finding in oracle.findings:
        if finding.wrong in BESIDE and _misreads(judges[LIFT], fault):
            continue
        if finding.wrong is None or finding.wrong in BESIDE or finding.at < watch.began:
            others.append(finding)
        else:
            lies[FaultEffect(finding.wrong)] = finding.at - watch.began
    return Cell(name, _name(fault), phase, watch.told, tuple(sorted(lies.items())), tuple(map(str, others)))


BESIDE = frozenset({SuspectValues.FLOOR, SuspectValues.SHOWN})
"""What is said beside the open door: detection does not speak of it, and the judge knows which faults misread it."""


def _misreads(judged: LiftUnderTest, fault: Fault | WireFault) -> bool:
    name = fault_name(fault)
    excuse = judged.excuses.get(name)
    return name in FROZEN_FAULTS or (excuse is not None and not BESIDE.isdisjoint(excuse.kinds))


class _Watch:
    """Writes down what a robot is told."""

    def __init__(self) -> None:
        self.began = 0.0
        self._said: list[str] = []
        self._heard: set[str] = set()

    @property
    def told(self) -> str:
        return "; ".join(self._said)

    def look(self, world: World) -> None:
        self._add(_words(world.site.state(LIFT)))

    def request(self, world: World, floor: str) -> None:
        refused = world.request(FloorRequest(LIFT, ROBOT, floor, hold_door=True))
        if refused is not None:
            self._add(f"refused: {refused.code}")

    def _add(self, words: str) -> None:
        if words in self._heard:
            return
        self._heard.add(words)
        after_s = asyncio.get_running_loop().time() - self.began
        self._said.append(f"{words} after {after_s:.1f} s" if self._said else words)


async def _watched(world: World, watch: _Watch, fault: Fault | WireFault) -> None:
    floor = world.lifts[LIFT].floors[-1]
    for tick in range(round(LASTS_S / 0.1)):
        await elapse(0.1)
        watch.look(world)
        if tick % 20 == 0:
            watch.request(world, floor)
        if tick == round(UPSET_AFTER_S / 0.1) and isinstance(fault, device.FrozenRegisters | device.Stopped):
            world.begin(LIFT, InMode(Mode.FIRE))
    if isinstance(fault, device.FrozenRegisters | device.Stopped):
        world.end(LIFT, InMode(Mode.FIRE))


def _words(state: LiftState) -> str:
    if state.quality is not Quality.LIVE:
        return "offline"
    door = {RobotDoor.OPEN: "open", RobotDoor.MOVING: "not open", RobotDoor.CLOSED: "closed"}[state.robot_door]
    mode = "" if state.mode in (Mode.NORMAL, Mode.ROBOT, Mode.UNKNOWN) else f", {state.mode}"
    return f"{door}{mode}"


async def _reach(world: World, phase: Phase) -> bool:
    floors = world.lifts[LIFT].floors
    target = floors[-1]
    await elapse(STARTS_S)
    if phase is Phase.IDLE:
        return True
    world.request(FloorRequest(LIFT, ROBOT, target, hold_door=True))
    for tick in range(round(WAITS_S / 0.1)):
        await elapse(0.1)
        if tick % 10 == 0:
            world.request(FloorRequest(LIFT, ROBOT, target, hold_door=True))
        state = world.site.state(LIFT)
        if phase is Phase.TRAVELLING and world.lifts[LIFT].face.picture.motion != "stopped":
            return True
        if (state.robot_door, state.floor) == (RobotDoor.OPEN, target):
            return phase is Phase.DOOR_HELD
    return False


def _set(world: World, fault: Fault | WireFault, *, on: bool) -> None:
    if isinstance(fault, Fault):
        (world.begin if on else world.end)(LIFT, fault)
        return
    for controller in world.lifts[LIFT].controllers:
        (world.begin_wire_fault if on else world.end_wire_fault)(controller, fault)


def _name(fault: Fault | WireFault) -> str:
    name = fault_name(fault)
    return f"{name}.{fault.code}" if isinstance(fault, wire.AnswerWithException) else name


def row(name: str) -> list[Cell]:
    """Play every fault in every phase on one map."""
    every: Sequence[Fault | WireFault] = (*device_faults(), *WIRE)
    with quiet():
        return [cell(name, fault, phase) for fault in every for phase in Phase]


def broken_promises(cells: Sequence[Cell]) -> Iterator[str]:
    """Yield every cell in which something was wrong that should have been detected, or for longer than it may."""
    known = {name: _detections(name) for name in {one.map for one in cells}}
    for one in cells:
        yield from (f"{one.map}, {one.fault}, {one.phase}: {text}" for text in one.findings)
        detection = known[one.map].get(one.fault)
        for lie, lasted_s in one.lies:
            within_s = _within_s(detection, lie)
            if within_s is not None and lasted_s > within_s:
                yield f"{one.map}, {one.fault}, {one.phase}: {lie} was wrong for {lasted_s:.1f} s, and not {within_s:g} s"


def _within_s(detection: Detection | None, lie: FaultEffect) -> float | None:
    """Return for how long this may be wrong; None: for ever."""
    if detection is None or lie not in detection.lies:
        return 0.0
    return None if detection.goes_on else detection.within_s


def table(cells: Sequence[Cell]) -> str:
    """Return everything as Markdown, map by map."""
    lines = ["# What the robot is told while something is wrong", ""]
    lines += ["Written by `python -m tests.campaigns.matrix --write`. Each fault lasts 20 s on virtual time.", ""]
    for name in dict.fromkeys(one.map for one in cells):
        known = _detections(name)
        lines += [f"## {name}", "", "| fault | class | phase | told | wrong meanwhile |", "|---|---|---|---|---|"]
        for one in (one for one in cells if one.map == name):
            wrong = ", ".join(f"{lie} until {lasted:.1f} s" for lie, lasted in one.lies) or "nothing"
            lines.append(f"| {one.fault} | {_class(known.get(one.fault))} | {one.phase} | {one.told} | {wrong} |")
        lines.append("")
    for name, why in NO_TRIP.items():
        lines += [f"## {name}", "", f"Not tried: {why}.", ""]
    return "\n".join(lines)


def _class(detection: Detection | None) -> str:
    if detection is None:
        return "no lie"
    if detection.within_s is None:
        return "undetectable"
    return f"within {detection.within_s:g} s" if detection.lies else "no lie"


def _detections(name: str) -> dict[str, Detection]:
    loaded = loaded_site(name, 900.0, 300.0, 0.0)
    codec = compile_map(loaded.maps[LIFT].map)
    return {one.fault: one for one in detections(codec, max_age_s=codec.map.link.max_age_s)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", nargs="*", default=[one for one in maps() if one not in NO_TRIP])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":
        command = [sys.executable, "-m", "tests.campaigns.matrix", *sys.argv[1:]]
        return subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "0"}, check=False).returncode
    with ProcessPoolExecutor(given.processes) as pool:
        cells = [one for played in pool.map(row, given.maps) for one in played]
    if given.write:
        WRITTEN.write_text(table(cells))
    broken = list(broken_promises(cells))
    sys.stdout.write("\n".join([*broken, f"{len(cells)} cells, {len(broken)} broken promises", ""]))
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(main())
