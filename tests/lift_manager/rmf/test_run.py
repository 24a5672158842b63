"""How an adapter is run: both neighbours are told in time, a bug is a restart and not an end, and the end is clean. On virtual time."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from dataclasses import replace

import pytest

from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds import DdsListener
from lift_manager.rmf.messages import DOOR_OPEN, END_SESSION, MODE_OFFLINE, LiftState, Time
from lift_manager.rmf.port import Deliver, EndOfSession, SessionDemand
from lift_manager.rmf.run import RESTART_PAUSE_S, RunningAdapter
from tests.lift_manager.rmf.neighbours import REQUEST, FakeRmf, FakeWay, view


class Stage:
    """An adapter between fakes; each restart makes new ones."""

    def __init__(self, *, use_sim_time: bool = False) -> None:
        self.rmfs: list[FakeRmf] = []
        self.ways: list[FakeWay] = []
        self.running = RunningAdapter(self._rmf, self._way, use_sim_time=use_sim_time)

    def _rmf(self, listener: DdsListener, deliver: Deliver) -> FakeRmf:
        self.rmfs.append(FakeRmf(listener, deliver))
        return self.rmfs[-1]

    def _way(self) -> FakeWay:
        self.ways.append(FakeWay())
        return self.ways[-1]

    def last(self) -> LiftState:
        return self.rmfs[-1].states[-1][1]


def bug() -> None:
    raise IndexError("a bug")


def play(scene: Callable[[Stage], Coroutine[None, None, None]], *, use_sim_time: bool = False) -> Stage:
    """Run an adapter for as long as the scene takes, and cancel it then."""

    async def main() -> Stage:
        stage = Stage(use_sim_time=use_sim_time)
        stage.running.open()
        task = asyncio.create_task(stage.running.run())
        await scene(stage)
        task.cancel()
        await asyncio.wait([task])
        assert task.cancelled()
        return stage

    return run_virtual(main)


def test_a_lift_is_published_twice_a_second() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(10.25)

    stage = play(scene)
    assert 20 <= len(stage.rmfs[0].states) <= 23


def test_a_request_reaches_the_manager_and_its_session_the_wire_in_the_same_instant() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.1)  # nobody else says anything for a tenth of a second
        stage.rmfs[0].send(REQUEST)
        await elapse(0.05)
        assert stage.ways[0].asked == [SessionDemand("main", "fleet/robot1", "First", hold_door=True)]
        assert stage.last().session_id == "fleet/robot1"

    stage = play(scene)
    assert stage.running.counts.requests["Lift1", "begun"] == 1


def test_an_end_of_a_fleet_that_its_supervisor_drops_reaches_the_manager() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.1)
        stage.rmfs[0].send(REQUEST)
        await elapse(0.3)
        stage.rmfs[0].send_of_fleet(replace(REQUEST, request_type=END_SESSION))
        await elapse(1.9)
        assert stage.last().session_id == "fleet/robot1"
        await elapse(0.2)
        assert (stage.last().session_id, type(stage.ways[0].asked[-1])) == ("", EndOfSession)

    play(scene)


def test_a_manager_that_is_lost_shows_on_the_wire_in_the_same_instant() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.1)
        stage.ways[0].closed = True
        stage.ways[0].lose()
        await elapse(0.05)
        assert stage.last().current_mode == MODE_OFFLINE

    play(scene)


def test_a_burst_of_requests_is_one_look_and_not_one_message_each() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        before = len(stage.rmfs[0].states)
        for _ in range(200):
            stage.rmfs[0].send(REQUEST)
        await elapse(0.1)
        assert len(stage.rmfs[0].states) - before <= 5
        assert len(stage.ways[0].asked) == 1

    play(scene)


def test_at_its_end_it_says_that_the_lift_is_offline_and_leaves_both() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)

    stage = play(scene)
    assert stage.last().current_mode == MODE_OFFLINE
    assert stage.last().door_state != DOOR_OPEN
    assert stage.rmfs[0].closed
    assert stage.ways[0].closed


def test_going_offline_publishes_the_lift_as_offline_at_once_and_nothing_more() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        stage.running.go_offline()
        assert stage.last().current_mode == MODE_OFFLINE
        told = len(stage.rmfs[0].states)
        stage.rmfs[0].send(REQUEST)
        await elapse(30.0)
        assert len(stage.rmfs[0].states) == told
        assert stage.ways[0].asked == []
        assert not stage.rmfs[0].closed

    assert len(play(scene).rmfs) == 1


def test_going_offline_with_an_error_is_logged_and_raises_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        stage.rmfs[0].closed = True  # publishing fails from here on
        stage.running.go_offline()

    play(scene)
    assert "did not close properly" in caplog.text


def test_one_that_was_opened_and_never_run_leaves_rmf_too() -> None:
    async def main() -> None:
        stage = Stage()
        stage.running.open()
        stage.running.close()
        assert stage.rmfs[0].closed

    run_virtual(main)


def test_what_prevents_joining_rmf_is_raised_by_open() -> None:
    def refuse(listener: DdsListener, deliver: Deliver) -> FakeRmf:
        raise OSError("no network")

    async def main() -> None:
        with pytest.raises(OSError, match="no network"):
            RunningAdapter(refuse, FakeWay).open()

    run_virtual(main)


def test_a_bug_is_logged_and_everything_restarts(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        first = stage.rmfs[0]
        stage.rmfs[0].deliver(bug)
        stage.rmfs[0].deliver(bug)  # the first one ends it, and nothing is heard after that
        await elapse(1.0)
        assert first.closed
        assert stage.last().current_mode == MODE_OFFLINE
        told = len(first.states)
        first.send(REQUEST)
        await elapse(RESTART_PAUSE_S)
        assert len(first.states) == told
        assert stage.ways[0].asked == []
        assert stage.rmfs[1].states
        stage.rmfs[1].send(REQUEST)
        await elapse(0.5)
        assert stage.last().session_id == "fleet/robot1"

    stage = play(scene)
    assert (len(stage.rmfs), len(stage.ways)) == (2, 2)
    assert stage.ways[0].closed
    assert "IndexError" in caplog.text
    assert "it restarts in" in caplog.text


def test_an_end_in_the_pause_after_a_bug_is_an_end() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        stage.rmfs[0].deliver(bug)
        await elapse(1.0)

    assert len(play(scene).rmfs) == 1


def test_a_part_that_does_not_end_as_it_should_keeps_nobody_from_ending(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        stage.rmfs[0].closed = True  # publishing fails from here on
        stage.ways[0].view = view()

    stage = play(scene)
    assert stage.ways[0].closed
    assert "did not close properly" in caplog.text


def test_it_says_which_lift_is_which_once_and_again_when_that_changes(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def scene(stage: Stage) -> None:
        await elapse(3.0)
        stage.ways[0].view = view(name="Lift2")
        await elapse(3.0)

    play(scene)
    lines = [record.getMessage() for record in caplog.records if "for RMF: lift" in record.getMessage()]
    assert lines == [
        "for RMF: lift Lift1 (here main) with the floors L1 (here G), L2 (here First)",
        "for RMF: lift Lift2 (here main) with the floors L1 (here G), L2 (here First)",
    ]


@pytest.mark.parametrize("clears", [False, True])
def test_a_fire_is_told_again_while_it_lasts_and_its_end_once_at_the_most(*, clears: bool) -> None:
    alarms = Alarms(fire_alarm=True, clear_on_acknowledge=clears)

    async def scene(stage: Stage) -> None:
        stage.ways[0].alarms = alarms
        await elapse(1.0)
        assert stage.rmfs[0].alarm.said == []
        stage.ways[0].view = view(fire_latched=True)
        await elapse(9.0)
        assert stage.rmfs[0].alarm.said == [True] * 5
        stage.ways[0].view = view()
        await elapse(60.0)
        assert stage.rmfs[0].alarm.said[5:] == ([False] if clears else [])

    play(scene)


def test_time_is_what_clock_says_in_a_simulation_and_its_age_is_taken_off() -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        assert stage.last().lift_time == Time()
        stage.rmfs[0].deliver(lambda: stage.rmfs[0].listener.on_clock(100.0))
        await elapse(1.0)
        assert stage.last().lift_time.sec == 99

    play(scene, use_sim_time=True)


@pytest.mark.parametrize("heard", [False, True])
def test_a_simulation_without_clock_is_told_of_once_and_lifts_are_published_all_the_same(
    caplog: pytest.LogCaptureFixture, *, heard: bool
) -> None:
    async def scene(stage: Stage) -> None:
        await elapse(1.0)
        if heard:
            stage.rmfs[0].deliver(lambda: stage.rmfs[0].listener.on_clock(1.0))
        await elapse(60.0)

    stage = play(scene, use_sim_time=True)
    assert len(stage.rmfs[0].states) > 100
    assert len([record for record in caplog.records if "/clock" in record.getMessage()]) == (0 if heard else 1)
