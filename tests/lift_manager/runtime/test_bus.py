"""The event bus and the snapshot that comes before the news."""

import asyncio
from datetime import UTC, datetime, timedelta

from lift_manager.lift.events import CommandEnded, SessionEnded, SessionOpened
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.runtime.bus import Bus, Event, Occurrence, StateChanged, boot_of
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import run_virtual


def test_a_slow_listener_loses_its_own_oldest_events_and_is_told_how_many() -> None:
    async def main() -> None:
        bus: Bus[int] = Bus()
        with bus.listen(3) as slow, bus.listen(10) as quick:
            for number in range(5):
                bus.publish(number)
            assert [await slow.next() for _ in range(3)] == [2, 3, 4]
            assert slow.lost == 2
            assert [await quick.next() for _ in range(5)] == [0, 1, 2, 3, 4]
            assert quick.lost == 0

    run_virtual(main)


def test_nobody_hears_anything_after_the_end_of_listening() -> None:
    bus: Bus[int] = Bus()

    async def main() -> None:
        with bus.listen():
            assert bus.received
        assert not bus.received

    run_virtual(main)


def test_a_listener_gets_the_state_of_every_lift_first_and_then_what_happens() -> None:
    async def check(made: Spine) -> None:
        with made.site.listen() as events:
            first = await events.next()
            assert isinstance(first, StateChanged)
            assert first.state.floor == "L1"
            made.accept("L2")
            seen: list[Event] = [first]
            async with asyncio.timeout(60):
                while not (isinstance(seen[-1], StateChanged) and seen[-1].state.robot_door is RobotDoor.OPEN):
                    seen.append(await events.next())
        assert [type(event) for event in seen if not isinstance(event, StateChanged)] == [SessionOpened, CommandEnded]

    on_spine(check)


def test_a_lift_that_goes_away_is_published_as_offline_without_anybody_asking() -> None:
    async def check(made: Spine) -> None:
        with made.bus.listen() as events:
            made.device.silent = True
            async with asyncio.timeout(3):
                event = await events.next()
                while not (isinstance(event, StateChanged) and event.state.quality is Quality.OFFLINE):
                    event = await events.next()
        assert event.state.robot_door is RobotDoor.MOVING

    on_spine(check)


def test_the_end_of_a_session_says_why() -> None:
    async def check(made: Spine) -> None:
        with made.bus.listen() as events:
            made.accept("L1")
            made.accept("L1", hold=False)
            told = [await events.next() for _ in range(4)]
        assert any(isinstance(event, SessionEnded) and event.reason == "released" for event in told)

    on_spine(check)


def test_every_event_has_an_id_of_this_process_and_its_number_heard_or_not() -> None:
    bus: Bus[str] = Bus("b0")
    received: list[tuple[str, str]] = []
    assert bus.newest == 0
    assert bus.publish("one") == "b0-1"
    with bus.tap(lambda event, item: received.append((event, item))):
        ears = [bus.received]
        assert bus.publish("two") == "b0-2"
        assert bus.publish("three", lambda event: received.append((event, "noted"))) == "b0-3"
    assert [*ears, bus.received] == [True, False]
    assert bus.publish("four") == "b0-4"
    assert received == [("b0-2", "two"), ("b0-3", "noted"), ("b0-3", "three")]
    assert bus.newest == 4


def test_a_later_start_has_another_boot_that_sorts_behind() -> None:
    begin = datetime(2026, 11, 21, 12, tzinfo=UTC)
    starts = [begin + timedelta(milliseconds=ms) for ms in (0, 1, 36, 1_000, 86_400_000, 300_000_000_000)]
    boots = [boot_of(at) for at in starts]
    assert boots == sorted(set(boots))
    assert {len(boot) for boot in boots} == {8}
    assert len(Bus[int]().boot) == 8


def test_a_state_that_changed_while_nobody_listened_is_told_before_the_next_snapshot() -> None:
    async def check(made: Spine) -> None:
        received: list[Occurrence] = []
        with made.site.tap(received.append):
            made.site.freshen()
        received.clear()
        made.accept("L2")
        await made.until(lambda state: state.floor == "L2" and state.standing)
        with made.site.tap(received.append):
            made.site.freshen()
            made.site.freshen()
        states = [event.state for occurrence in received if isinstance(event := occurrence.event, StateChanged)]
        assert [state.floor for state in states] == ["L2"]
        assert received[-1].id == f"{made.site.boot}-{made.site.newest}"

    on_spine(check)
