"""The file that outlives the manager: whole or not at all, never ignored, and a bad disk stops nobody."""

import asyncio
import errno
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from lift_manager.domain.contradictions import Trust
from lift_manager.domain.service import Remembered
from lift_manager.store.errors import StateUnusable
from lift_manager.store.place import replace_file, state_path
from lift_manager.store.state_file import SLOW_S, StateFile, Write, opened
from tests.lift_manager.store.test_memory_contract import EVERYTHING, LIFTS, no_trouble, written

SITE = "Main hospital"
FIRE = replace(EVERYTHING, lockout=None, occupied=None, acknowledged=None, trust=Trust())


def state(path: Path, write: Write = replace_file) -> StateFile:
    return opened(path, SITE, LIFTS, write)


def write_down(path: Path, value: Remembered, lift: str = "east") -> None:
    async def main() -> None:
        memory = state(path)
        memory.keep(lift, value)
        await written(memory)

    asyncio.run(main())


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file in a folder that is not there yet."""
    return tmp_path / "var" / "lib" / "state.json"


def unusable(path: Path) -> str:
    with pytest.raises(StateUnusable) as refused:
        state(path)
    assert str(path) in str(refused.value)
    assert "nothing starts without it" in str(refused.value)
    return str(refused.value)


def test_the_file_is_for_its_user_alone_and_can_be_read_by_people(path: Path) -> None:
    write_down(path, EVERYTHING)
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    content = json.loads(path.read_text("utf-8"))
    assert (content["format"], content["version"], content["site"]) == ("lift-manager state", 4, SITE)
    assert list(content["lifts"]) == ["east"]
    assert content["lifts"]["east"]["lockout"] == {
        "by": "Jürgen O'Neill",
        "reason": 'door "front" is being replaced',
        "since": "2026-03-03T05:30:05.250000+08:00",
    }
    assert sorted(path.parent.iterdir()) == [path, path.with_name("state.json.lock")]


def test_a_file_torn_at_any_place_is_refused_in_words(path: Path) -> None:
    write_down(path, EVERYTHING)
    whole = path.read_bytes()
    for length in range(0, len(whole.rstrip()), 7):
        path.write_bytes(whole[:length])
        assert "is no state of a lift manager, or is damaged" in unusable(path)


def test_a_write_that_was_cut_off_leaves_the_last_whole_state(path: Path) -> None:
    write_down(path, FIRE)
    path.with_name("state.json.new").write_bytes(b'{"format": "lift-man')
    assert state(path).recall("east") == FIRE
    write_down(path, EVERYTHING)
    assert state(path).recall("east") == EVERYTHING


def spoilt(path: Path, spoil: Callable[[dict[str, Any]], object]) -> str:
    write_down(path, EVERYTHING)
    content = json.loads(path.read_text("utf-8"))
    spoil(content)
    path.write_text(json.dumps(content), "utf-8")
    return unusable(path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda c: c.update(format="another program"), "is no state of a lift manager"),
        (lambda c: c.update(version=5), "is version 5 of that file"),
        (lambda c: c.update(site="Villa"), "belongs to the site 'Villa'"),
        (lambda c: c.update(more=1), "is damaged (more:"),
        (lambda c: c["lifts"]["east"].update(more=1), "is damaged (lifts.east.more:"),
        (lambda c: c["lifts"]["east"].pop("lockout"), "is damaged (lifts.east.lockout:"),
        (lambda c: c["lifts"]["east"].update(fire_since="2026-03-02T21:30:00"), "is damaged (lifts.east.fire_since:"),
        (lambda c: c["lifts"]["east"]["occupied"].update(aboard="yes"), "is damaged (lifts.east.occupied.aboard:"),
        (lambda c: c["lifts"]["east"]["session"].update(who="gone"), "is damaged (lifts.east.session.who:"),
        (lambda c: c["lifts"]["east"].pop("session"), "is damaged (lifts.east.session:"),
        (lambda c: c["lifts"].update(west=c["lifts"].pop("east")), "keeps robots off lift 'west'"),
    ],
)
def test_a_foreign_or_spoilt_file_is_refused_and_never_taken_for_an_empty_one(
    path: Path, spoil: Callable[[dict[str, Any]], object], words: str
) -> None:
    assert words in spoilt(path, spoil)


def test_a_lift_that_is_gone_and_kept_nobody_out_is_carried_along(path: Path) -> None:
    said = replace(FIRE, fire_since=None, acknowledged=EVERYTHING.acknowledged)

    async def main() -> None:
        memory = opened(path, SITE, (*LIFTS, "gone"))
        memory.keep("gone", said)
        await written(memory)

    asyncio.run(main())
    write_down(path, FIRE)
    assert opened(path, SITE, (*LIFTS, "gone")).recall("gone") == said


def test_a_site_with_a_corrected_name_does_not_forget_what_keeps_robots_out(path: Path) -> None:
    write_down(path.with_name("other.json"), EVERYTHING)
    with pytest.raises(StateUnusable) as refused:
        opened(path, "Main hospitals", LIFTS)
    said = str(refused.value)
    assert "other.json beside it keeps robots off lift 'east' of the site 'Main hospital'" in said
    assert "write 'Main hospitals' into that file as its `site` and rename it to state.json" in said


def test_states_of_other_buildings_and_other_files_in_the_folder_are_let_be(path: Path) -> None:
    write_down(
        path.with_name("calm.json"), replace(EVERYTHING, fire_since=None, lockout=None, occupied=None, trust=Trust())
    )
    write_down(path, FIRE)
    path.rename(path.with_name("old.json"))
    path.with_name("notes.json").write_bytes(b"{")
    path.with_name("folder.json").mkdir()
    assert opened(path, "Harbour office", ["north"]).recall("north") == Remembered()
    path.with_name("old.json").rename(path)
    assert state(path).recall("east") == FIRE


HOLDS = """
import sys
from pathlib import Path
from lift_manager.store.state_file import opened
kept = opened(Path(sys.argv[1]), "Main hospital", ["east"])
sys.stdout.write("open\\n")
sys.stdout.flush()
sys.stdin.read()
"""


def test_two_managers_do_not_share_a_file(path: Path) -> None:
    command = [sys.executable, "-c", HOLDS, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        with pytest.raises(
            StateUnusable, match="another manager that runs on this computer serves a site of this name"
        ):
            state(path)
        other.communicate("", timeout=10)
    assert state(path).recall("east") == Remembered()


@pytest.mark.parametrize("at", ["9999-12-31T23:59:59-12:00", "0001-01-01T00:00:00+12:00"])
def test_a_time_that_no_zone_can_show_is_damage(path: Path, at: str) -> None:
    write_down(path, FIRE)
    content = json.loads(path.read_text("utf-8"))
    content["lifts"]["east"]["fire_since"] = at
    path.write_text(json.dumps(content), "utf-8")
    assert "is damaged (lifts.east.fire_since" in unusable(path)


def test_a_folder_where_the_file_should_be_is_refused(path: Path) -> None:
    path.mkdir(parents=True)
    assert "cannot be read (Is a directory)" in unusable(path)


@dataclass
class BadDisk:
    """Refuses to write until it is mended."""

    mended: bool = False
    tries: int = 0
    tried_again: threading.Event = field(default_factory=threading.Event)
    error: OSError = field(default_factory=lambda: OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    def __call__(self, path: Path, data: bytes) -> None:
        self.tries += 1
        if self.tries > 1:
            self.tried_again.set()
        if not self.mended:
            raise self.error
        replace_file(path, data)


def test_a_full_disk_is_an_alarm_once_and_is_tried_until_it_takes_the_state(path: Path) -> None:
    async def main() -> None:
        disk, told = BadDisk(), list[tuple[str, str]]()
        memory = state(path, disk)
        async with asyncio.timeout(20):
            running = asyncio.ensure_future(memory.run(lambda lift, text: told.append((lift, text))))
            memory.keep("east", FIRE)
            await asyncio.to_thread(disk.tried_again.wait)
            assert memory.recall("east") == FIRE
            assert sorted(lift for lift, _ in told) == sorted(LIFTS)
            assert "No space left on device" in told[0][1]
            assert str(path) in told[0][1]
            assert not os.access(path, os.F_OK)
            disk.mended = True
            memory.keep("east", EVERYTHING)  # news is written without waiting for the next try
            await memory.settled()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
        assert len(told) == len(LIFTS)
        assert state(path).recall("east") == EVERYTHING

    asyncio.run(main())


def test_a_folder_that_refuses_is_known_at_the_start_before_anything_has_to_be_kept(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")

    async def main() -> None:
        told = asyncio.Event()
        memory = StateFile(tmp_path / "file" / "state.json", SITE, LIFTS, {}, replace_file)
        async with asyncio.timeout(10):
            running = asyncio.ensure_future(memory.run(lambda *_: told.set()))
            await told.wait()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_the_last_of_many_words_is_what_stays_however_slow_the_disk(path: Path) -> None:
    seen: list[bytes] = []

    def slow(place: Path, data: bytes) -> None:
        seen.append(data)
        threading.Event().wait(0.02)
        replace_file(place, data)

    async def main() -> None:
        memory = state(path, slow)
        async with asyncio.timeout(10):
            running = asyncio.ensure_future(memory.run(no_trouble))
            for count in range(50):
                memory.keep("east", replace(FIRE, acknowledged=EVERYTHING.acknowledged if count % 2 else None))
                await asyncio.sleep(0)
            memory.keep("east", EVERYTHING)
            await memory.settled()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())
    assert state(path).recall("east") == EVERYTHING
    assert path.read_bytes() == seen[-1]


def test_a_disk_that_hangs_holds_up_neither_the_loop_nor_the_end(path: Path) -> None:
    hung, mended = threading.Event(), threading.Event()

    def hang(place: Path, data: bytes) -> None:
        hung.set()
        mended.wait()

    async def main() -> None:
        memory = state(path, hang)
        running = asyncio.ensure_future(memory.run(no_trouble))
        await asyncio.to_thread(hung.wait)
        memory.keep("east", FIRE)
        assert memory.recall("east") == FIRE
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await memory.settled()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    start = time.monotonic()
    asyncio.run(main())
    assert time.monotonic() - start < 5
    mended.set()


def test_a_disk_that_hangs_is_told_like_one_that_fails() -> None:
    hang = threading.Event()

    async def main() -> None:
        told = asyncio.Queue[tuple[str, str]]()
        memory = StateFile(Path("state.json"), SITE, ["east"], {}, lambda *_: only_wait(hang))
        running = asyncio.ensure_future(memory.run(lambda lift, text: told.put_nowait((lift, text))))
        async with asyncio.timeout(SLOW_S + 5):
            lift, text = await told.get()
        assert lift == "east"
        assert "(the disk does not answer); it is in force, but a restart would forget it" in text
        hang.set()
        async with asyncio.timeout(5):
            await memory.settled()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def only_wait(event: threading.Event) -> None:
    event.wait()


def test_a_computer_without_a_thread_to_spare_is_taken_for_a_bad_disk(path: Path) -> None:
    async def main() -> None:
        told = asyncio.Queue[str]()
        memory = state(path)
        usual = threading.stack_size(1 << 46)  # no computer has that much, so no thread starts
        try:
            running = asyncio.ensure_future(memory.run(lambda *words: told.put_nowait(words[1])))
            async with asyncio.timeout(5):
                assert "this computer is too busy" in await told.get()
        finally:
            threading.stack_size(usual)
        async with asyncio.timeout(5):
            await memory.settled()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_a_bug_in_writing_is_not_taken_for_a_bad_disk(path: Path) -> None:
    def wrong(place: Path, data: bytes) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        asyncio.run(state(path, wrong).run(no_trouble))


@pytest.mark.parametrize(
    ("environ", "said", "folder"),
    [
        (
            {"STATE_DIRECTORY": "/var/lib/lift-manager:/var/lib/other", "XDG_STATE_HOME": "/x"},
            "kept",
            "/var/lib/lift-manager",
        ),
        ({"XDG_STATE_HOME": "/x"}, "kept", "/etc/lifts/kept"),
        ({"XDG_STATE_HOME": "/x"}, "/srv/kept", "/srv/kept"),
        ({"XDG_STATE_HOME": "/x"}, None, "/x/lift-manager"),
        ({}, None, "~/.local/state/lift-manager"),
    ],
)
def test_the_place_is_that_of_systemd_or_of_the_site_or_of_the_user(
    environ: dict[str, str], said: str | None, folder: str
) -> None:
    place = state_path(SITE, said, Path("/etc/lifts/site.yaml"), environ)
    assert place.parent == Path(folder).expanduser()


def test_sites_whose_names_look_alike_have_files_of_their_own() -> None:
    names = [
        state_path(name, None, Path("site.yaml"), {}).name for name in ("A/B", "A B", "a b", "病院", "...", "../..")
    ]
    assert len(set(names)) == len(names)
    assert all("/" not in name and not name.startswith(".") for name in names)
    assert names[0].startswith("a-b-")
    assert names[3].startswith("site-")


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_can_write_to_is_refused(path: Path, mode: int) -> None:
    path.parent.mkdir(parents=True)
    path.parent.chmod(mode)
    assert f"`chmod go-w {path.parent}`" in unusable(path)
    assert list(path.parent.iterdir()) == []


def test_no_link_is_followed(path: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.write_text("precious")
    write_down(path, FIRE)
    path.with_name(f"{path.name}.new").symlink_to(theirs)
    write_down(path, FIRE, "west")
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    assert "it is a symbolic link" in unusable(path)
    assert theirs.read_text() == "precious"
