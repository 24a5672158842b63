"""What any memory of the manager does: in the process, on the disk, or on the disk of a simulated world."""

import asyncio
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import pytest

from lift_manager.core.journal import Journal, ShortJournal
from lift_manager.core.memory import Memory, ShortMemory
from lift_manager.domain.boarding import KeptBoarding, Who
from lift_manager.domain.contradictions import Contradiction, Distrust, Trust
from lift_manager.domain.service import Acknowledged, Cause, Lockout, Occupied, Remembered
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import Holder
from lift_manager.lab.world.disk import DiskJournal, Pace, SimulatedDisk
from lift_manager.store.adapter import RecordMemory
from tests.lift_manager.store.journal_disk import LIFTS, journal, written
from tests.support.virtual_time import run_virtual

Main = Callable[[], Coroutine[None, None, None]]

AT = datetime(2026, 3, 2, 21, 30, 5, 250_000, tzinfo=UTC)
SINGAPORE = timezone(timedelta(hours=8))
EVERYTHING = Remembered(
    fire_since=AT,
    lockout=Lockout("Jürgen O'Neill", 'door "front" is being replaced', AT.astimezone(SINGAPORE)),
    occupied=Occupied(Holder("rmf", "fleet/robot1"), True, AT),
    left_untold=AT,
    robot_mode_until=AT + timedelta(seconds=120),
    acknowledged=Acknowledged("王", AT, (Cause.FIRE, Cause.OCCUPIED)),
    session=KeptSession(
        holder=Holder("rmf", "fleet/robot1"),
        floor="Étage 3",
        hold_door=True,
        opened_at=AT,
        lease_from=AT + timedelta(seconds=1),
        holding_since=AT + timedelta(seconds=2),
        kept_at=(AT + timedelta(seconds=3)).astimezone(SINGAPORE),
        stood_open=True,
        hold_spent=False,
        pressed=True,
        boarding=KeptBoarding(Who.ABOARD, sent_on=True, may_leave_at="G", in_place_told=True),
    ),
    trust=Trust(
        "1f", door_proven=True, distrust=(Distrust(Contradiction.CALL, "floor codes shifted by one?", AT, trips=2),)
    ),
)
VALUES = [
    Remembered(),
    EVERYTHING,
    Remembered(fire_since=AT),
    Remembered(lockout=EVERYTHING.lockout),
    Remembered(occupied=Occupied(Holder("workshop", "workshop"), False, AT)),
    Remembered(acknowledged=EVERYTHING.acknowledged),
    Remembered(left_untold=AT),
    Remembered(robot_mode_until=AT.astimezone(SINGAPORE)),
    Remembered(session=EVERYTHING.session),
    Remembered(trust=EVERYTHING.trust),
]


class Opened(NamedTuple):
    """A memory and the journal that writes for it."""

    memory: Memory
    journal: Journal


Again = Callable[[], Opened]
"""Makes the memory, or makes it again, as a restart of the manager does."""


@pytest.fixture(params=["short", "store", "simulated disk", "instant disk"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def again(kind: str, tmp_path: Path) -> Again:
    if kind == "short":
        short = Opened(ShortMemory(), ShortJournal())
        return lambda: short
    disk = SimulatedDisk(None if kind == "instant disk" else Pace(0.01, 2.0), seed=1)

    def on_disk() -> Opened:
        committer = journal(tmp_path / "site.db")
        return Opened(RecordMemory(committer), committer)

    def on_simulated_disk() -> Opened:
        simulated = DiskJournal(disk)
        return Opened(simulated.memory, simulated)

    return on_disk if kind == "store" else on_simulated_disk


@pytest.fixture
def run(kind: str) -> Callable[[Main], None]:
    """Run a coroutine on the clock that the memory lives on."""
    return run_virtual if kind == "simulated disk" else lambda main: asyncio.run(main())


def test_a_lift_that_nothing_was_kept_of_is_free(again: Again) -> None:
    assert again().memory.recall("east") == Remembered()
    assert again().memory.recall("of no site") == Remembered()


@pytest.mark.parametrize("value", VALUES)
def test_what_is_kept_is_recalled_at_once_and_after_a_restart(
    again: Again, run: Callable[[Main], None], value: Remembered
) -> None:
    async def main() -> None:
        memory, journal = again()
        memory.keep("east", Remembered(fire_since=AT))
        memory.keep("east", value)
        assert memory.recall("east") == value
        await written(journal)
        assert again().memory.recall("east") == value

    run(main)


def test_each_lift_has_its_own(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        memory, journal = again()
        for lift, value in zip(LIFTS, VALUES[1:], strict=False):
            memory.keep(lift, value)
        await written(journal)
        assert [again().memory.recall(lift) for lift in LIFTS] == VALUES[1:3]
        memory.keep(LIFTS[0], Remembered())
        await written(journal)
        assert [again().memory.recall(lift) for lift in LIFTS] == [Remembered(), VALUES[2]]

    run(main)


def test_a_press_waits_for_nothing_once_everything_is_written(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        memory, journal = again()
        assert memory.written("east") is None
        memory.keep("east", EVERYTHING)
        waiting = memory.written("east")
        await written(journal)
        assert waiting is None or waiting.done()
        assert memory.written("east") is None
        assert memory.trouble == ""

    run(main)


def test_a_press_that_gave_up_waiting_is_forgotten(again: Again, run: Callable[[Main], None]) -> None:
    async def main() -> None:
        memory, journal = again()
        memory.keep("east", EVERYTHING)
        if (given_up := memory.written("east")) is not None:
            given_up.cancel()
        await written(journal)
        assert memory.written("east") is None

    run(main)
