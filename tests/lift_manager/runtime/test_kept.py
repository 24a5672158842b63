"""What a lift has in the store of its site, and what a restart makes of it."""

from pathlib import Path

import pytest

from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.occupancy import RobotWord
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.store.committer import Committer
from lift_manager.store.record import decode, encode
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from register_maps.words import Door
from tests.lift_manager.runtime.scripted import PLAIN, ROBOT, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import held_by
from tests.support.virtual_time import elapse

LIMITS = Limits(400, 500)


def at_once(path: Path) -> Committer:
    """A store that carries everything out at once."""
    store = SqliteStore(path, "site", LIMITS)
    return Committer(store, str(path), store.load(), jobs=None)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "var" / "site.db"


def test_what_a_lift_saves_is_read_as_it_was_written() -> None:
    memory = MemoryRecorder()

    async def check(made: Bench) -> None:
        begun = made.opened(key="k", ttl_s=60.0)
        made.closed(begun, RobotWord.LEFT)
        await made.called_to("L2")
        made.site.begin_drain("lift", "ann", "night")

    on_bench(check, PLAIN, recorder=memory)
    saved = memory.records["lift"]
    assert saved.record.session is not None
    assert saved.record.past_sessions
    assert decode(encode(saved)) == saved


def test_a_session_and_a_lockout_outlive_the_manager(path: Path) -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L2")
        made.site.lock_out("lift", "ann", "new ropes")
        await elapse(1)

    async def after(made: Bench) -> None:
        await made.car("L2", Door.OPEN)
        assert "by ann" in made.state.restrictions.lockout
        assert made.site.durable("lift").restriction(RestrictionKind.LOCKOUT) is not None
        assert held_by(made) == ROBOT  # until its door is released
        assert made.driver.on == {"hold_door.front"}
        await elapse(12)
        assert held_by(made) is None
        assert made.driver.on == set()

    on_bench(before, PLAIN, recorder=at_once(path))
    on_bench(after, PLAIN, recorder=at_once(path), left_on=frozenset({"hold_door.front"}))


def test_a_press_has_its_row_and_its_session_in_one_store(path: Path) -> None:
    async def check(made: Bench) -> None:
        made.accept("L3")
        await elapse(0.5)
        assert made.driver.log == ["press go_to L3"]

    on_bench(check, PLAIN, recorder=at_once(path))
    again = SqliteStore(path, "site", LIMITS)
    saved = again.load()["lift"].record.session
    assert saved is not None
    assert (saved.holder, saved.floor) == (ROBOT, "L3")
    texts = [noted.row.text for noted in again.tail(20)]
    assert texts.index("api:fleet/robot1 holds the lift, to L3") < texts.index("go_to L3 is to be pressed")
