"""What a site remembers in its store, and what a restart makes of it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.session import Holder
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.store.committer import Committer
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.record import DURABLE, RecordDamaged
from lift_manager.store.retention import Limits
from lift_manager.store.site import opened
from lift_manager.store.sqlite import SqliteStore
from register_maps.words import Door
from tests.lift_manager.runtime.bench import PROVEN, ROBOT, Bench, on_lift
from tests.support.virtual_time import elapse

LIMITS = Limits(400, 500)


def kept(path: Path) -> Committer:
    """A store that carries everything out at once."""
    store = SqliteStore(path, "site", LIMITS, form=DURABLE)
    return Committer(store, str(path), {"lift": PROVEN, **store.load()}, jobs=None)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "var" / "site.db"


def full() -> DurableRecord:
    """A record with a session, its commands, and what people decided."""
    memory = MemoryRecorder({"lift": PROVEN})

    async def check(made: Bench) -> None:
        begun = made.site.open_session("lift", ROBOT, key="k", ttl_s=60.0)
        made.site.close_session("lift", begun.session.id, ROBOT, None)
        await made.called_to("L2")
        made.site.begin_drain("lift", "ann", "night")

    on_lift(check, recorder=memory)
    return memory.records["lift"]


def test_a_record_is_read_as_it_was_written() -> None:
    record = full()
    assert record.session is not None
    assert record.past_sessions
    assert DURABLE.decode(DURABLE.encode(record)) == record
    assert DURABLE.decode(DURABLE.encode(DurableRecord())) == DurableRecord()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda c: c.update(more=1), "more: Unexpected keyword argument"),
        (lambda c: c.pop("fire_since"), "fire_since: is missing"),
        (lambda c: c["session"].pop("key"), "session.key: is missing"),
        (lambda c: c["restrictions"][0].pop("by"), "restrictions.0.by: Field required"),
        (lambda c: c.update(fire_since="2026-03-02T21:30:00"), "fire_since: is a time without a zone"),
    ],
)
def test_a_record_that_is_not_whole_is_refused(spoil: Any, words: str) -> None:
    content = json.loads(DURABLE.encode(full()))
    spoil(content)
    with pytest.raises(RecordDamaged) as damaged:
        DURABLE.decode(json.dumps(content))
    assert str(damaged.value).startswith(words)


def test_a_session_and_a_lockout_outlive_the_manager(path: Path) -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L2")
        made.site.lock_out("lift", "ann", "new ropes")
        await elapse(1)

    async def after(made: Bench) -> None:
        await made.car("L2", Door.OPEN)
        assert "by ann" in made.state.restrictions.lockout
        assert made.site.durable("lift").restriction(RestrictionKind.LOCKOUT) is not None
        assert made.holder() == Holder("api", "fleet/robot1")  # until its door is released
        assert made.driver.on == {"hold_door.front"}
        await elapse(12)
        assert made.holder() is None
        assert made.driver.on == set()

    on_lift(before, recorder=kept(path))
    on_lift(after, recorder=kept(path), left_on=frozenset({"hold_door.front"}))


def test_a_press_has_its_row_and_its_session_in_one_store(path: Path) -> None:
    async def check(made: Bench) -> None:
        made.ask("L3")
        await elapse(0.5)
        assert made.driver.log == ["press go_to L3"]

    on_lift(check, recorder=kept(path))
    again = SqliteStore(path, "site", LIMITS, form=DURABLE)
    saved = again.load()["lift"].session
    assert (saved.holder, saved.floor) == (ROBOT, "L3")
    texts = [noted.row.text for noted in again.tail(20)]
    assert texts.index("api:fleet/robot1 holds the lift, to L3") < texts.index("go_to L3 is to be pressed")


def test_a_lift_that_is_locked_out_may_not_lose_its_name(path: Path) -> None:
    record = replace(full(), session=None)
    SqliteStore(path, "site", LIMITS, form=DURABLE).commit({"lift": record}, [])
    with pytest.raises(StoreUnusable, match="keeps robots off lift 'lift'"):
        opened(path, "site", ["east"], LIMITS, form=DURABLE)
