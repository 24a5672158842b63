"""Which versions of the state file are read, and when what was kept is known to be on the disk."""

import asyncio
import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.domain.boarding import KeptBoarding, Who
from lift_manager.domain.contradictions import Trust
from lift_manager.domain.service import Remembered
from lift_manager.domain.session import restored
from lift_manager.domain.state import Holder
from lift_manager.store.errors import StateUnusable
from lift_manager.store.form import VERSION
from lift_manager.store.place import replace_file
from lift_manager.store.state_file import opened
from tests.lift_manager.store.test_memory_contract import EVERYTHING, LIFTS, no_trouble, written
from tests.lift_manager.store.test_state_file import BadDisk

SITE = "Main hospital"
EAST, OTHER = LIFTS
VERSION_1_LIFT = {
    "fire_since": "2026-03-02T21:30:05.250000Z",
    "lockout": {"by": "M. Weber", "reason": "ropes", "since": "2026-03-02T21:30:05Z"},
    "occupied": {"face": "rmf", "name": "fleet/robot1", "aboard": True, "since": "2026-03-02T21:30:05Z"},
    "acknowledged": {"by": "M. Weber", "at": "2026-03-02T21:30:05Z", "what": ["fire", "occupied"]},
}
VERSION_1 = {
    "format": "lift-manager state",
    "version": 1,
    "site": SITE,
    "lifts": {"east": VERSION_1_LIFT},
}
"""A file as version 1 wrote it, before sessions were kept."""

VERSION_2 = {
    "format": "lift-manager state",
    "version": 2,
    "site": SITE,
    "lifts": {
        "east": {
            **VERSION_1_LIFT,
            "left_untold": None,
            "robot_mode_until": None,
            "session": {
                "face": "rmf",
                "name": "fleet/robot1",
                "floor": "L2",
                "hold_door": True,
                "opened_at": "2026-03-02T21:30:00Z",
                "lease_from": "2026-03-02T21:30:05Z",
                "holding_since": None,
                "kept_at": "2026-03-02T21:30:10Z",
                "stood_open": False,
                "hold_spent": False,
                "pressed": True,
                "who": "may_board",
                "sent_on": False,
                "may_leave_at": None,
                "in_place_told": False,
            },
        }
    },
}
"""A file as version 2 wrote it, before sessions had ids."""

VERSION_3 = {
    "format": "lift-manager state",
    "version": 3,
    "site": SITE,
    "lifts": {
        "east": {
            **VERSION_1_LIFT,
            "left_untold": None,
            "robot_mode_until": None,
            "session": None,
            "rides": [],
        }
    },
}
"""A file as version 3 wrote it, before anything was known of a lift's signals."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state.json"


def test_a_file_of_version_1_is_read_and_written_as_the_newest(path: Path) -> None:
    path.write_text(json.dumps(VERSION_1))
    memory = opened(path, SITE, LIFTS)
    kept = memory.recall(EAST)
    assert kept.session is None
    assert kept.lockout is not None
    assert (kept.lockout.by, kept.lockout.reason) == ("M. Weber", "ropes")
    assert kept.occupied is not None
    assert kept.occupied.aboard
    assert kept.fire_since is not None
    assert kept.acknowledged is not None
    asyncio.run(written(memory))
    content = json.loads(path.read_text())
    assert (content["version"], content["lifts"]["east"]["session"]) == (VERSION, None)
    assert content["lifts"]["east"]["lockout"]["by"] == "M. Weber"


def test_version_1_with_a_session_is_damage(path: Path) -> None:
    content = json.loads(json.dumps(VERSION_1))
    content["lifts"]["east"]["session"] = None
    path.write_text(json.dumps(content))
    with pytest.raises(StateUnusable, match=r"is damaged \(lifts\.east\.session"):
        opened(path, SITE, LIFTS)


def test_a_file_of_version_2_is_read_and_its_session_gets_an_id_when_it_is_taken_up(path: Path) -> None:
    path.write_text(json.dumps(VERSION_2))
    kept = opened(path, SITE, LIFTS).recall(EAST).session
    assert kept is not None
    assert (kept.holder, kept.floor, kept.pressed) == (Holder("rmf", "fleet/robot1"), "L2", True)
    assert (kept.id, kept.stays, kept.lease_s, kept.key) == ("", False, None, "")
    assert kept.boarding == KeptBoarding(Who.MAY_BOARD)
    session = restored(kept, number=1, at=kept.kept_at, now=100.0)
    assert len(session.id) > 16
    assert session.lease_from == 95.0


def test_version_2_with_an_id_is_damage(path: Path) -> None:
    content = json.loads(json.dumps(VERSION_2))
    content["lifts"]["east"]["session"]["id"] = "given"
    path.write_text(json.dumps(content))
    with pytest.raises(StateUnusable, match=r"is damaged \(lifts\.east\.session\.id"):
        opened(path, SITE, LIFTS)


def test_a_file_of_version_3_is_read_and_nothing_is_proven_of_its_door(path: Path) -> None:
    path.write_text(json.dumps(VERSION_3))
    memory = opened(path, SITE, LIFTS)
    assert memory.recall(EAST).trust == Trust()
    asyncio.run(written(memory))
    content = json.loads(path.read_text())
    assert (content["version"], content["lifts"]["east"]["trust"]["door_proven"]) == (VERSION, False)


def test_version_3_with_a_proven_door_is_damage(path: Path) -> None:
    content = json.loads(json.dumps(VERSION_3))
    content["lifts"]["east"]["trust"] = {"map_hash": "1f", "door_proven": True, "distrust": []}
    path.write_text(json.dumps(content))
    with pytest.raises(StateUnusable, match=r"is damaged \(lifts\.east\.trust"):
        opened(path, SITE, LIFTS)


def test_the_session_of_a_holder_of_its_own_is_kept_whole(path: Path) -> None:
    memory = opened(path, SITE, LIFTS)
    session = EVERYTHING.session
    assert session is not None
    whole = replace(session, floor=None, id="unguessed", stays=True, lease_s=12.5, key="one")
    memory.keep(EAST, replace(EVERYTHING, session=whole))
    asyncio.run(written(memory))
    assert opened_again(path).session == whole
    assert "unguessed" not in str(whole)


@pytest.mark.parametrize("version", [0, VERSION + 1, 99])
def test_a_version_that_nobody_knows_is_refused_in_words(path: Path, version: int) -> None:
    path.write_text(json.dumps(VERSION_1 | {"version": version}))
    with pytest.raises(StateUnusable, match=f"is version {version} of that file.*versions up to {VERSION}"):
        opened(path, SITE, LIFTS)


def test_a_file_of_version_1_beside_a_renamed_site_is_not_overlooked(path: Path) -> None:
    path.with_name("former.json").write_text(json.dumps(VERSION_1 | {"site": "Former name"}))
    with pytest.raises(StateUnusable, match="keeps robots off lift 'east' of the site 'Former name'"):
        opened(path, SITE, LIFTS)


def test_what_was_kept_during_a_write_is_waited_for_until_the_next_one(path: Path) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(place: Path, data: bytes) -> None:
        begun.set()
        go_on.wait(5)
        replace_file(place, data)

    async def main() -> None:
        memory = opened(path, SITE, LIFTS, slow)
        memory.keep(EAST, replace(EVERYTHING, session=None))
        first = memory.written(EAST)
        running = asyncio.ensure_future(memory.run(no_trouble))
        await asyncio.to_thread(begun.wait)
        memory.keep(EAST, EVERYTHING)
        second = memory.written(EAST)
        assert first is not None
        assert second is not None
        assert memory.written(OTHER) is None
        begun.clear()
        go_on.set()
        async with asyncio.timeout(10):
            await first
            await asyncio.to_thread(begun.wait)
            await second
        assert opened_again(path) == EVERYTHING
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def opened_again(path: Path) -> Remembered:
    """Read the file as it is, beside the manager that has it."""
    copy = path.with_name("copy.json")
    copy.write_bytes(path.read_bytes())
    return opened(copy, SITE, LIFTS).recall(EAST)


def test_a_disk_that_takes_nothing_says_why_and_a_press_goes_on_waiting(path: Path) -> None:
    async def main() -> None:
        disk = BadDisk()
        memory = opened(path, SITE, LIFTS, disk)
        running = asyncio.ensure_future(memory.run(lambda *_: None))
        memory.keep(EAST, EVERYTHING)
        waiting = memory.written(EAST)
        assert waiting is not None
        async with asyncio.timeout(20):
            await asyncio.to_thread(disk.tried_again.wait)
            assert "(No space left on device)" in memory.trouble
            assert "see to it that this folder can be written" in memory.trouble
            assert not waiting.done()
            disk.mended = True
            memory.keep(OTHER, EVERYTHING)
            await waiting
            assert memory.trouble == ""
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_a_press_that_gave_up_waiting_is_forgotten(path: Path) -> None:
    async def main() -> None:
        memory = opened(path, SITE, LIFTS)
        memory.keep(EAST, EVERYTHING)
        given_up = memory.written(EAST)
        assert given_up is not None
        given_up.cancel()
        await written(memory)
        assert memory.written(EAST) is None

    asyncio.run(main())
