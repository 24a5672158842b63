"""Words on the wire that no map lists, and controllers that serve less than their map says: seen by a whole lift."""

from dataclasses import dataclass, field

import pytest

from drivers.modbus.memory import MemoryDevice
from lift_manager.lift.inputs import LiftRequest
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.state import Quality
from register_maps.words import Motion, Table
from tests.support.trip import ROBOT, Trip, Truth, on_trip
from tests.support.trip_sites import site_of
from tests.support.virtual_time import elapse

OPEN_AT_L2: dict[str, tuple[Table, dict[int, int]]] = {
    # floor, stopped, open, mode robot, no fire + robot mode + level
    "generic-registers": (Table.HOLDING, {1: 2, 2: 1, 3: 3, 4: 2, 5: 0b111}),
    # floor, open, stopped, no emergency
    "seer-generic": (Table.HOLDING, {20: 2, 21: 4, 22: 0, 23: 0}),
    # open, at the upper floor, AGV mode
    "two-stop-agv": (Table.DISCRETE, {0: 1, 3: 1, 4: 1}),
}
BAD = [
    ("generic-registers", "car_floor", {1: 77}, 77),
    ("generic-registers", "car_floor", {1: 0xFFFB}, -5),
    ("generic-registers", "motion", {2: 4}, 4),
    ("generic-registers", "door.front", {3: 6}, 6),
    ("generic-registers", "mode", {4: 0}, 0),
    ("seer-generic", "car_floor", {20: 77}, 77),
    ("seer-generic", "door.front", {21: 5}, 5),
    ("seer-generic", "motion", {22: 3}, 3),
    ("seer-generic", "emergency_power", {23: 2}, 2),
    ("two-stop-agv", "car_floor", {2: 1}, 3),
]
"""Map, signal, what is put on the wire, the raw value of the signal by that."""
ALL_OF_IT = [(0, 0xFFFF)]


@dataclass
class ImagePlant:
    """A lift that is nothing but contents of registers."""

    device: MemoryDevice
    truth_now: Truth = field(
        default_factory=lambda: Truth(1, 1, 1, may_enter=True, may_leave=True, asked=frozenset({"hold_door.front"}))
    )

    def answer(self, device: str, frame: bytes, now: float) -> bytes | None:
        self.device.values[Table.HOLDING][0] = int(now * 2)  # the alive counter of the generic registers
        return self.device.answer(frame)[0][1]

    def truth(self, now: float) -> Truth:
        return self.truth_now


@pytest.mark.parametrize("held", [False, True], ids=["nobody holds it", "a robot holds it"])
@pytest.mark.parametrize(("name", "signal", "words", "raw"), BAD)
def test_a_word_that_is_not_listed_is_unknown_with_its_raw_value_and_invites_nobody(
    name: str, signal: str, words: dict[int, int], raw: int, held: bool, caplog: pytest.LogCaptureFixture
) -> None:
    site = site_of(name)
    table, good = OPEN_AT_L2[name]
    device = MemoryDevice()
    device.values[table].update(good)

    async def check(made: Trip) -> None:
        if held:
            made.ask("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        for _ in range(2):
            device.values[table].update(words)
            await elapse(0.5)
            reading = await made.driver.read()
            assert reading.values.unknown == {signal: raw}
            for _ in range(20):
                assert made.state.quality is Quality.LIVE
                assert made.state.robot_door is not RobotDoor.OPEN
                await elapse(0.1)
            device.values[table].update({address: good.get(address, 0) for address in words})
            await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
            assert (await made.driver.read()).values.unknown == {}

    on_trip(check, site, ImagePlant(device), door_proven=True)
    told = [record.getMessage() for record in caplog.records if f" reads {raw}, which" in record.getMessage()]
    assert len(told) == 1
    assert signal in told[0]


@pytest.mark.parametrize(("name", "signal", "words", "raw"), BAD)
def test_what_is_unknown_is_never_published_as_something_older(
    name: str, signal: str, words: dict[int, int], raw: int
) -> None:
    site = site_of(name)
    table, good = OPEN_AT_L2[name]
    device = MemoryDevice()
    device.values[table].update(good)

    async def check(made: Trip) -> None:
        assert made.state.floor == "L2"
        device.values[table].update(words)
        await elapse(0.5)
        state = made.state
        said = {
            "car_floor": state.floor,
            "motion": state.motion,
            "door.front": next(iter(state.doors.values())),
            "mode": state.mode,
            "emergency_power": state.mode,
        }
        assert said[signal] is None or said[signal] == "unknown"
        assert state.motion is Motion.UNKNOWN or signal != "motion"

    on_trip(check, site, ImagePlant(device))


@pytest.mark.parametrize(
    ("name", "served", "refused"),
    [
        (
            "generic-registers",
            {Table.HOLDING: [(0, 5), (16, 19)]},
            "it refuses destination (holding:6), call_accepted (holding:7)",
        ),
        ("two-stop-agv", {Table.DISCRETE: [(0, 4)], Table.COIL: ALL_OF_IT}, "it refuses fault (discrete:5)"),
        ("seer-generic", {Table.HOLDING: [(10, 22)]}, "it refuses emergency_power (holding:23)"),
    ],
)
def test_a_controller_that_serves_less_than_its_map_says_is_offline_for_that_reason(
    name: str, served: dict[Table, list[tuple[int, int]]], refused: str
) -> None:
    site = site_of(name)
    device = MemoryDevice(served=served)

    async def check(made: Trip) -> None:
        for _ in range(20):
            state = made.state
            assert state.quality is Quality.OFFLINE
            assert f"the controller serves less than map {name} says: {refused}" in state.reason
            assert (state.robot_door, state.floor, state.motion) == (RobotDoor.MOVING, None, Motion.UNKNOWN)
            await elapse(1)
        answer = made.actor.handle(LiftRequest(ROBOT, "L1", hold_door=True))
        assert isinstance(answer, Refused)
        assert answer.code is Refusal.OFFLINE
        assert refused in answer.message
        assert device.writes == []

    on_trip(check, site, ImagePlant(device))
