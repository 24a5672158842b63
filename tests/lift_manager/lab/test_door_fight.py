"""A second writer lets go of a door that the manager holds: the alarm and the published door, on whole managers."""

import asyncio
import contextlib

import pytest

from drivers.model import FloorName
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, Witness
from lift_manager.lab.world.world import World
from lift_manager.lift.events import Alarm
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from simulator.faults import ForeignWriter
from simulator.state import Parameters
from simulator.wire_faults import Exchange
from tests.campaigns.playing import LIFT, loaded_site

HOLD = "hold_door.front"
ROBOT = Holder("workshop", "workshop")
FIGHTS_S = 18.0
ALARM_WITHIN_S = 6.0
SEEN_WITHIN_S = 1.0
"""From one look at a held output to the next on a quick link, and a poll."""


class Watcher(Witness):
    """Notes presses of the hold, alarms, and states that say OPEN although the hold has been off for longer than a look takes."""

    def __init__(self) -> None:
        self.pressed_at: list[float] = []
        self.alarms: list[tuple[float, str]] = []
        self.opens = 0
        self.door = RobotDoor.MOVING
        self.lies: list[float] = []
        self.dropped_at: list[float] = []
        self._held_at = 0.0
        self._is_on = False

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        is_on = HOLD in truth.commands
        if self._is_on and not is_on:
            self.dropped_at.append(at)
        if is_on:
            self._held_at = at
        self._is_on = is_on

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        self.pressed_at += [at] * (HOLD in commands)

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        self.door = state.robot_door
        if state.robot_door is RobotDoor.OPEN and state.holder is not None:
            self.opens += 1
            if not self._is_on and at - self._held_at > SEEN_WITHIN_S:
                self.lies.append(at)

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        pass

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        pass

    def on_fault(self, at: float, change: FaultChange) -> None:
        pass

    def on_event(self, at: float, event: Event) -> None:
        if isinstance(event, Alarm):
            self.alarms.append((at, event.text))


async def asks(world: World, floor: FloorName) -> None:
    """Want the door held at a floor, as the workshop's adapter does."""
    while True:
        world.request(FloorRequest(LIFT, ROBOT, floor, hold_door=True))
        await asyncio.sleep(1)


@pytest.mark.parametrize(
    ("map_name", "every_s", "phase_s"),
    [
        *(("generic-registers", *times) for times in ((0.5, 0.3), (1.0, 0.6), (1.0, 0.9), (2.0, 0.9), (3.0, 0.6))),
        *((name, 1.0, 0.6) for name in ("generic-coils", "wago-750", "two-stop-agv", "moxa-e1212")),
        ("generic-coils", 0.5, 0.3),
        ("moxa-e1212", 3.0, 0.6),
    ],
)
def test_a_door_fight_is_an_alarm_ends_after_four_drops_and_never_says_open_for_long(
    map_name: str, every_s: float, phase_s: float
) -> None:
    seen = Watcher()

    async def main() -> None:
        world = World(loaded_site(map_name, 900.0, 300.0, 0.0), (seen,), settings={LIFT: Parameters(speed=4.0)})
        async with world.running():
            await elapse(4)
            asking = asyncio.ensure_future(asks(world, world.lifts[LIFT].floors[1]))
            await elapse(8 + phase_s)
            assert seen.opens
            seen.dropped_at.clear()
            seen.alarms.clear()
            before = len(seen.pressed_at)
            world.begin(LIFT, ForeignWriter(HOLD, pressed=False, every_s=every_s))
            await elapse(FIGHTS_S)
            world.end(LIFT, ForeignWriter(HOLD, pressed=False, every_s=every_s))
            asking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asking
            assert len(seen.pressed_at) - before == 3
            assert seen.door is not RobotDoor.OPEN

    run_virtual(main)
    assert seen.alarms[0][0] <= seen.dropped_at[0] + ALARM_WITHIN_S
    assert "was released by the controller or by somebody else" in seen.alarms[0][1]
    assert any("was released 4 times within 60 s" in text for _, text in seen.alarms)
    assert seen.lies == []
