"""What any recorder recalls: in the process, on the disk, or on the disk of a simulated world."""

import asyncio
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from lift_manager.lab.world.disk import DiskRecorder, Pace, SimulatedDisk
from lift_manager.lift.events import Acknowledged, Cause, Restriction, RestrictionKind
from lift_manager.lift.occupancy import Occupancy, SavedBoarding
from lift_manager.lift.record import DurableRecord, Occupied, SavedSession
from lift_manager.lift.session import Holder
from lift_manager.lift.trust import Contradiction, Distrust, Trust
from lift_manager.rides.record import save
from lift_manager.rides.ride import Phase
from lift_manager.runtime.recorder import MemoryRecorder, Recorder, SavedLift
from tests.lift_manager.rides.by_hand import at, ride
from tests.lift_manager.store.journal_disk import LIFTS, journal, written
from tests.support.virtual_time import run_virtual

Main = Callable[[], Coroutine[None, None, None]]

AT = datetime(2026, 3, 2, 21, 30, 5, 250_000, tzinfo=UTC)
SINGAPORE = timezone(timedelta(hours=8))
HOLDER = Holder("rmf", "fleet/robot1")
LOCKOUT = Restriction(
    RestrictionKind.LOCKOUT, "Jürgen O'Neill", 'door "front" is being replaced', AT.astimezone(SINGAPORE)
)
ACKNOWLEDGED = Acknowledged("east", "王", AT, (Cause.FIRE, Cause.OCCUPIED))
SESSION = SavedSession(
    holder=HOLDER,
    floor="Étage 3",
    hold_door=True,
    opened_at=AT,
    lease_from=AT + timedelta(seconds=1),
    holding_since=AT + timedelta(seconds=2),
    saved_at=(AT + timedelta(seconds=3)).astimezone(SINGAPORE),
    opened_at_target=True,
    hold_spent=False,
    pressed=True,
    boarding=SavedBoarding(Occupancy.ABOARD, sent_on=True, may_leave_at="G", in_place_taken=True),
)
TRUST = Trust(
    "1f", door_proven=True, distrust=(Distrust(Contradiction.CALL, "floor codes shifted by one?", AT, trips=2),)
)
RECORD = DurableRecord(
    fire_since=AT,
    restrictions=(LOCKOUT,),
    occupied=Occupied(HOLDER, True, AT),
    robot_left_pending_since=AT,
    robot_mode_until=AT + timedelta(seconds=120),
    acknowledged=ACKNOWLEDGED,
    session=SESSION,
    trust=TRUST,
)
EVERYTHING = SavedLift(RECORD, (save(ride(Phase.RIDING), at(5.0)),))
VALUES = [
    EVERYTHING,
    *(
        SavedLift(record)
        for record in (
            DurableRecord(),
            DurableRecord(fire_since=AT),
            DurableRecord(restrictions=(LOCKOUT,)),
            DurableRecord(occupied=Occupied(Holder("workshop", "workshop"), False, AT)),
            DurableRecord(acknowledged=ACKNOWLEDGED),
            DurableRecord(robot_left_pending_since=AT),
            DurableRecord(robot_mode_until=AT.astimezone(SINGAPORE)),
            DurableRecord(session=SESSION),
            DurableRecord(trust=TRUST),
        )
    ),
]


Again = Callable[[], Recorder]
"""Makes the recorder, or makes it again, as a restart of the manager does."""


@pytest.fixture(params=["short", "store", "simulated disk", "instant disk"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def again(kind: str, tmp_path: Path) -> Again:
    if kind == "short":
        short = MemoryRecorder()
        return lambda: short
    disk = SimulatedDisk(None if kind == "instant disk" else Pace(0.01, 2.0), seed=1)

    if kind == "store":
        return lambda: journal(tmp_path / "site.db")
    return lambda: DiskRecorder(disk)


@pytest.fixture
def run(kind: str) -> Callable[[Main], None]:
    """Run a coroutine on the clock that the recorder lives on."""
    return run_virtual if kind == "simulated disk" else lambda main: asyncio.run(main())


def test_nothing_is_recalled_of_a_lift_that_nothing_was_kept_of(again: Again) -> None:
    assert again().recall("east") is None
    assert again().recall("of no site") is None


@pytest.mark.parametrize("value", VALUES)
def test_what_is_kept_is_recalled_at_once_and_after_a_restart(
    again: Again, run: Callable[[Main], None], value: SavedLift
) -> None:
    async def main() -> None:
        recorder = again()
        recorder.keep("east", EVERYTHING)
        recorder.keep("east", value)
        assert recorder.recall("east") == value
        await written(recorder)
        assert again().recall("east") == value

    run(main)


def test_each_lift_has_its_own(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        recorder = again()
        for lift, value in zip(LIFTS, VALUES, strict=False):
            recorder.keep(lift, value)
        await written(recorder)
        assert [again().recall(lift) for lift in LIFTS] == VALUES[:2]
        recorder.keep(LIFTS[0], SavedLift())
        await written(recorder)
        assert [again().recall(lift) for lift in LIFTS] == [SavedLift(), VALUES[1]]

    run(main)


def test_a_press_waits_for_nothing_once_everything_is_written(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        recorder = again()
        assert recorder.written("east") is None
        recorder.keep("east", EVERYTHING)
        waiting = recorder.written("east")
        await written(recorder)
        assert waiting is None or waiting.done()
        assert recorder.written("east") is None
        assert recorder.trouble == ""

    run(main)


def test_a_press_that_gave_up_waiting_is_forgotten(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        recorder = again()
        recorder.keep("east", EVERYTHING)
        if (given_up := recorder.written("east")) is not None:
            given_up.cancel()
        await written(recorder)
        assert recorder.written("east") is None

    run(main)
