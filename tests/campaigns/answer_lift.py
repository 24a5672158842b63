"""The fuzz one level higher: what a lift on a shipped map reads out of mutated answers, and what it makes of presses and holds.

The registers of generic-registers are decoded here by hand, from the text of the map, and not by the codec.
"""

from __future__ import annotations

import asyncio
import traceback
from dataclasses import dataclass, field
from random import Random

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.settings import LinkSettings
from drivers.model import Command, CommandKind, LiftReading, LiftValues, Outcome
from register_maps.words import Door, Mode, Motion, Side
from tests.campaigns.answer_memory import LIMIT_S
from tests.campaigns.answer_rig import Device, Finding, Report, history, together, unhandled_in_loop
from tests.campaigns.answers import data_length
from tests.campaigns.judge_answers import Payload, Question
from tests.drivers.caller import Caller, Permit
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import VirtualTimeError, elapse, run_virtual

LIFTS = 4
FLOORS = {"L1": 1, "L2": 2}
POLL = bytes.fromhex("0000 0006 01 03 0000 0008")
"""The one request of a poll: eight holding registers from 0, of unit 1."""
POLL_S = 0.05
HONEST = 0.6
"""Chosen: a lift believes nothing before it has read twice over one connection."""
_MOTION = {1: Motion.STOPPED, 2: Motion.UP, 3: Motion.DOWN}
_DOOR = {1: Door.CLOSED, 2: Door.OPENING, 3: Door.OPEN, 4: Door.CLOSING, 5: Door.FAULT}
_MODE = {
    1: Mode.NORMAL,
    2: Mode.ROBOT,
    3: Mode.INDEPENDENT,
    4: Mode.INSPECTION,
    5: Mode.FIRE,
    6: Mode.EMERGENCY,
    7: Mode.OUT_OF_SERVICE,
}
_FLAGS = {0: "fire", 1: "robot_mode_on", 2: "level", 3: "obstruction.front", 4: "overload"}
_LIKELY = (
    (1, 2, 0, 9, 0xFFFF),
    (1, 2, 3, 7),
    (1, 2, 3, 4, 5, 0),
    (1, 2, 2, 5, 7, 0),
    (7, 5, 3, 6, 0x1F),
    (0, 1, 2),
    (0, 1, 2),
)
"""What registers 1 to 7 hold at times."""
_COMMANDS = (
    Command(CommandKind.GO_TO, "L2"),
    Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
    Command(CommandKind.ROBOT_MODE),
    Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
)


def lift_batch(seed: int, batch: int, cases: int) -> Report:
    """Answer so many requests of lifts with mutated bytes, on virtual time."""
    report = Report()
    where = f"lifts:{seed}:{batch}:{cases}"
    try:
        run_virtual(lambda: _batch(seed, batch, cases, report, where), limit_s=LIMIT_S)
    except VirtualTimeError as error:
        report.find(Finding(where, f"{type(error).__name__}: {error}"))
    return report


def registers(request: bytes, rng: Random) -> bytes:
    """A controller's registers at this moment: plausible ones, with a counter that moves."""
    first, data = int.from_bytes(request[8:10], "big"), b""
    for address in range(first, first + data_length(request) // 2):
        value = rng.randrange(65536) if address == 0 else rng.choice(_LIKELY[address - 1] if address < 8 else (0, 0, 1))
        data += value.to_bytes(2, "big")
    return data


def falsehood(values: LiftValues, data: bytes) -> str | None:
    """What a reading says other than these sixteen bytes; None: nothing."""
    words = [int.from_bytes(data[place : place + 2], "big") for place in range(0, 16, 2)]
    flags = {name: bool(words[5] >> bit & 1) for bit, name in _FLAGS.items()}
    flags["fire"] = not flags["fire"]
    floors = {code: name for name, code in FLOORS.items()}
    expected = {
        "floor": floors.get(words[1]),
        "motion": _MOTION.get(words[2], Motion.UNKNOWN),
        "doors": {Side.FRONT: _DOOR.get(words[3], Door.UNKNOWN)},
        "destination": floors.get(words[6]),
        "call_accepted": floors.get(words[7]),
        "flags": flags,
    }
    if not flags["fire"]:
        mode = _MODE.get(words[4], Mode.UNKNOWN)
        expected["mode"] = Mode.ROBOT if mode is Mode.NORMAL and flags["robot_mode_on"] else mode
    for name, right in expected.items():
        said = getattr(values, name)
        if said != right:
            return f"{name} is {said!r}, and the registers {words} say {right!r}"
    if flags["fire"] and values.mode in (Mode.NORMAL, Mode.ROBOT, Mode.UNKNOWN):
        return f"mode is {values.mode!r}, and the registers {words} say fire"
    return None


def objection_to_reading(question: Question | None, reading: LiftReading) -> str | None:
    """What is wrong with a reading that was given out, after the newest poll and what came for it."""
    if question is None or not isinstance(question.answer, Payload):
        return f"a reading without an answer to its poll: {reading}"
    if reading.at > question.asked_at:
        return f"a reading that says to be younger than its request: {reading.at} s, asked at {question.asked_at} s"
    return falsehood(reading.values, question.answer.data)


@dataclass(slots=True)
class _Poller:
    where: str
    lift: Caller
    device: Device
    report: Report
    pressed: list[asyncio.Future[Outcome]] = field(default_factory=list)

    async def poll_until(self, cases: int) -> None:
        rng = self.device.rng
        while self.device.asked < cases:
            self.device.newest.pop(POLL, None)
            try:
                reading = await self.lift.read()
            except DriverError:
                pass  # the link's errors are judged where the link is fuzzed
            except Exception:  # noqa: BLE001 - an error that no caller expects is what is looked for
                self._find(f"raised\n{traceback.format_exc()}")
            else:
                self.report.taken += 1
                question, _ = self.device.newest.get(POLL, (None, None))
                if what := objection_to_reading(question, reading):
                    self._find(what)
            await elapse(POLL_S)
            if rng.random() < 0.2:
                self._command(rng.choice(_COMMANDS), rng)

    def _command(self, command: Command, rng: Random) -> None:
        permit: Permit = (lambda: None) if rng.random() < 0.9 else (lambda: "not allowed")
        if rng.random() < 0.2:
            self.lift.let_go(command)
        elif command.kind in (CommandKind.HOLD_DOOR, CommandKind.ROBOT_MODE):
            self.lift.hold(command, permit)
        else:
            self.pressed.append(self.lift.press(command, permit))

    def _find(self, what: str) -> None:
        _, hearing = self.device.newest.get(POLL, (None, None))
        self.report.find(Finding(self.where, what, history(hearing)))


async def _batch(seed: int, batch: int, cases: int, report: Report, where: str) -> None:
    unhandled_in_loop(report, where)
    codec = compiled("generic-registers")
    devices, links, asking, running = [], [], [], []
    for number in range(LIFTS):
        rng = Random(f"{seed}/{batch}/{number}")
        device = Device(rng, LinkSettings(tid_echo=number % 4 != 0), registers, HONEST)
        link = Link(device.wire, device.settings, name=f"link {number}")
        lift = Caller(ModbusLift(codec, link, LiftSettings(name="lift", floors=FLOORS, control=number % 2 == 1)))
        share = cases // LIFTS + (number < cases % LIFTS)
        devices.append(device)
        links.append(link)
        asking.append(asyncio.ensure_future(_Poller(where, lift, device, report).poll_until(share)))
        running += [asyncio.ensure_future(link.run()), asyncio.ensure_future(lift.run())]
    try:
        await together(asking, running, report, where)
    finally:
        for task in running:
            task.cancel()
        await asyncio.wait(running)
        report.cases = sum(device.asked for device in devices)
