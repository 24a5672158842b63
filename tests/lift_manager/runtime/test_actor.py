"""What an actor does with an input, in which order, and what never waits."""

import asyncio
from dataclasses import replace

import pytest

from drivers.model import LiftValues
from lift_manager.lift.events import Advised, CommandEnded, SessionEnded
from lift_manager.lift.inputs import Tick
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.runtime.bus import StateChanged
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.rmf_words import ends, wants
from tests.lift_manager.runtime.scripted import PLAIN, Bench, SlowRecorder, on_bench
from tests.support.virtual_time import elapse


async def outcomes(made: Bench) -> list[tuple[str, str, str]]:
    ended = [event.outcome for event in only(await heard(made.heard), CommandEnded)]
    return [(str(one.command), str(one.result), one.reason) for one in ended]


# -- presses


def test_a_press_leaves_once_its_row_and_its_session_are_on_the_disk() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        await elapse(1)
        assert made.driver.log == []
        assert made.press_rows == ["go_to L3 is to be pressed"]
        assert disk.records["lift"].record.session is not None
        await disk.commit()
        assert made.driver.log == ["press go_to L3"]

    on_bench(check, PLAIN, recorder=disk)


def test_a_press_that_is_not_recorded_ends_and_never_revives() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        disk.trouble = "the disk is full"
        await disk.commit("the disk is full")
        assert await outcomes(made) == [("go_to L3", "rejected", "not recorded: the disk is full")]
        disk.trouble = ""
        await disk.commit()
        await elapse(5)
        assert made.driver.log == []

    on_bench(check, PLAIN, recorder=disk)


def test_a_release_takes_a_press_back_that_waits_for_the_disk() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        made.accept("L2", hold=False)
        await disk.commit()
        assert made.driver.log == []
        assert await outcomes(made) == [("go_to L3", "rejected", "not sent: something else was requested instead")]
        assert made.state.holder is None

    on_bench(check, PLAIN, recorder=disk)


def test_another_floor_leaves_only_one_press() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        made.accept("L1")
        await disk.commit()
        assert made.driver.log == ["press go_to L1"]

    on_bench(check, PLAIN, recorder=disk)


# -- holds


def test_a_hold_begins_once_it_is_written_down_and_ends_at_once() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        await made.car("L2", Door.OPEN, enter=True, leave=True)
        made.accept("L2")
        await elapse(1)
        assert made.driver.log == []
        assert made.press_rows == ["hold_door.front is to be pressed"]
        assert made.robot_door() is RobotDoor.MOVING
        await disk.commit()
        await elapse(0.5)
        assert made.driver.log[-1] == "hold hold_door.front"
        assert made.robot_door() is RobotDoor.OPEN
        disk.trouble = "the disk is full"
        made.accept("L2", hold=False)
        assert made.driver.log[-1] == "let go hold_door.front"

    on_bench(check, PLAIN, recorder=disk)


def test_a_hold_that_is_wanted_no_more_when_it_is_written_down_does_not_begin() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L2")
        assert made.press_rows == ["hold_door.front is to be pressed"]
        made.accept("L2", hold=False)
        await disk.commit()
        await elapse(1)
        assert made.driver.log == []

    on_bench(check, PLAIN, recorder=disk)


def test_a_hold_that_was_found_off_is_written_down_again_before_it_is_put_on() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L2")
        before = made.driver.log.count("hold hold_door.front")
        made.driver.on.discard("hold_door.front")
        await elapse(0.5)
        assert made.driver.log.count("hold hold_door.front") == before + 1
        assert made.press_rows[-1] == "hold_door.front is to be pressed again: it was found off"

    on_bench(check, PLAIN)


def test_a_hold_that_cannot_be_written_down_begins_when_the_disk_is_back() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L2")
        disk.trouble = "the disk is full"
        await disk.commit("the disk is full")
        await elapse(5)
        assert made.press_rows.count("hold_door.front is to be pressed") == 1
        disk.trouble = ""
        await elapse(0.5)
        await disk.commit()
        assert made.driver.log[-1] == "hold hold_door.front"

    on_bench(check, PLAIN, recorder=disk)


def test_a_restart_keeps_what_is_on_and_writes_nothing_down_for_it() -> None:
    disk = SlowRecorder()

    async def before(made: Bench) -> None:
        made.accept("L2")
        await disk.commit()
        await made.car("L2", Door.OPEN, enter=True, leave=True)
        await disk.commit()

    async def after(made: Bench) -> None:
        rows = len(made.press_rows)
        await made.car("L2", Door.OPEN, enter=True, leave=True)
        assert made.driver.on == {"hold_door.front"}
        assert made.driver.log == []
        assert len(made.press_rows) == rows
        assert made.state.holder is not None

    on_bench(before, PLAIN, recorder=disk)
    on_bench(after, PLAIN, recorder=disk, left_on=frozenset({"hold_door.front"}))


def test_a_hold_that_was_only_kept_for_a_while_goes_on_without_another_row() -> None:
    async def check(made: Bench) -> None:
        wants(made, "L2")
        await made.car("L2", Door.OPEN, enter=True, leave=True)
        assert made.driver.begun == {"hold_door.front"}
        rows = len(made.press_rows)
        ends(made)
        await elapse(1)
        assert made.driver.begun == set()
        wants(made, "L2")
        await elapse(1)
        assert made.driver.begun == {"hold_door.front"}
        assert made.driver.log == ["hold hold_door.front"]
        assert len(made.press_rows) == rows

    on_bench(check, PLAIN)


# -- order


def test_a_robot_is_told_of_a_fire_before_its_door_is_released() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L2")
        on_then: dict[str, bool] = {}

        def hear(_: str, event: object) -> None:
            if isinstance(event, Advised | SessionEnded):
                on_then[type(event).__name__] = "hold_door.front" in made.driver.on
            if isinstance(event, StateChanged) and event.state.robot_door is not RobotDoor.OPEN:
                on_then.setdefault("no longer open", "hold_door.front" in made.driver.on)

        with made.bus.tap(hear):
            made.driver.values = replace(made.driver.values, mode=Mode.FIRE)
            await elapse(0.5)
        assert on_then == {"Advised": True, "SessionEnded": True, "no longer open": True}
        assert made.driver.on == set()

    on_bench(check, PLAIN)


def test_what_is_decided_has_a_later_number_than_every_state_before_it() -> None:
    async def check(made: Bench) -> None:
        await heard(made.heard)
        made.driver.values = replace(made.driver.values, floor="L1")
        made.accept("L3")
        kinds = [type(event).__name__ for event in await heard(made.heard)]
        assert kinds[0] == "SessionOpened"
        assert "StateChanged" in kinds[1:]

    on_bench(check, PLAIN)


def test_an_input_from_within_another_is_a_bug_that_ends_the_run() -> None:
    async def check(made: Bench) -> None:
        def hear(*_: object) -> None:
            made.actor.handle(Tick())

        with made.bus.tap(hear), pytest.raises(RuntimeError, match="within another"):
            made.accept("L3")

    on_bench(check, PLAIN)


def test_a_bug_in_a_callback_ends_the_run() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")

        def spoil(_: str, event: object) -> None:
            raise ZeroDivisionError

        with made.bus.tap(spoil):
            for answer in disk.waiting:
                answer.set_result("full")  # the outcome is an event
            disk.waiting.clear()
            await elapse(0.01)

    with pytest.raises(ExceptionGroup) as raised:
        on_bench(check, PLAIN, recorder=disk)
    assert raised.group_contains(ZeroDivisionError)


# -- time


def test_a_reading_without_news_changes_nothing() -> None:
    async def check(made: Bench) -> None:
        await elapse(2.05)
        before = made.actor.record
        await elapse(0.5)
        assert made.life.polls()["lift"] > 20
        assert made.actor.record is before

    on_bench(check, PLAIN, poll_s=0.1)


def test_a_lift_is_offline_once_its_reading_is_too_old_though_the_next_read_hangs() -> None:
    async def check(made: Bench) -> None:
        assert made.state.quality is Quality.LIVE
        made.driver.takes_s = 1000.0
        await heard(made.heard)
        await elapse(made.actor.config.capabilities.max_age_s + 0.2)
        (changed,) = only(await heard(made.heard), StateChanged)
        assert changed.state.quality is Quality.OFFLINE

    on_bench(check, PLAIN)


def test_a_lease_ends_between_two_polls() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3")
        await elapse(0.2)
        made.driver.takes_s = 0.9
        await elapse(31)
        assert [event.reason for event in only(await heard(made.heard), SessionEnded)] == ["lease"]

    on_bench(check, PLAIN, lease_s=30.0, poll_s=0.2)


# -- the end


def test_an_orderly_end_withdraws_open_and_releases_the_door_a_little_later() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L2")
        clearing = asyncio.ensure_future(made.life.clear_doors())
        await elapse(0.05)
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(2.5)
        assert made.driver.on == {"hold_door.front"}
        assert await clearing
        await made.life.stop()
        assert made.driver.on == set()
        assert made.site.durable("lift").session is not None
        assert any("stopping" in text for text in await made.alarms())

    on_bench(check, PLAIN)


def test_an_end_without_a_robot_in_a_door_waits_for_nothing() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3")
        await elapse(0.5)
        assert not await made.life.clear_doors()
        await made.life.stop()
        assert made.driver.on == set()

    on_bench(check, PLAIN)


def test_a_lift_that_is_never_read_takes_no_requests() -> None:
    async def check(made: Bench) -> None:
        made.driver.silent = True
        made.driver.values = LiftValues()
        await elapse(5)
        assert made.state.quality is Quality.OFFLINE
        assert "no answer" in made.state.reason

    on_bench(check, PLAIN)
