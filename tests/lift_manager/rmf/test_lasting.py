"""RMF and two machines, of which one is active: the standby is there and silent, and what it received counts once it takes over."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace

import pytest

from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.plain.rmf import Alarms, HeldBy
from lift_manager.rmf.dds import DdsFailed, DdsListener
from lift_manager.rmf.lasting import KEEP_ENDS_S, LastingRmf, TermRmf
from lift_manager.rmf.lift_sessions import REPLAY_S
from lift_manager.rmf.messages import END_SESSION, LiftRequest
from lift_manager.rmf.port import Deliver, EndOfSession, SessionDemand
from lift_manager.rmf.run import RESTART_PAUSE_S, RunningAdapter
from tests.lift_manager.rmf.neighbours import REQUEST, FakeRmf, FakeWay, view

END = replace(REQUEST, request_type=END_SESSION, destination_floor="")
FIRE = Alarms(fire_alarm=True)
HELD = view(HeldBy("rmf", REQUEST.session_id))


class Machine:
    """A machine of a cluster, as far as RMF is concerned. `way` is the manager of its newest term."""

    def __init__(self, alarms: Alarms = FIRE) -> None:
        self.rmfs: list[FakeRmf] = []
        self.is_unreachable = False
        self.may_publish = False
        self.way = FakeWay()
        self.lasting = LastingRmf(self._join, alarms, asyncio.get_running_loop().time)
        self._adapter: asyncio.Task[None] | None = None

    def _join(self, listener: DdsListener, deliver: Deliver) -> FakeRmf:
        if self.is_unreachable:
            raise DdsFailed("there is no network")
        self.rmfs.append(FakeRmf(listener, deliver))
        return self.rmfs[-1]

    async def begin_term(self, way: FakeWay | None = None) -> None:
        """Take over, with a manager that continues with its lift as it is."""
        self.way, self.may_publish = way or FakeWay(), True
        running = RunningAdapter(self._attach, self._manager)
        self._adapter = asyncio.create_task(running.run())
        await elapse(0.01)

    def _attach(self, listener: DdsListener, deliver: Deliver) -> TermRmf:
        return self.lasting.attach(lambda: self.may_publish, listener, deliver)

    def _manager(self) -> FakeWay:
        if self.way.closed:
            self.way = FakeWay()
        self.way.alarms = FIRE
        return self.way

    async def end_term(self) -> None:
        assert self._adapter is not None
        self.may_publish = False
        self._adapter.cancel()
        await asyncio.wait([self._adapter])

    def fail(self) -> None:
        """The thread that receives from RMF ends with an error."""
        self.rmfs[-1].deliver(_fail)

    @property
    def sessions(self) -> list[str]:
        """The sessions that were published, each once."""
        shown = [state.session_id for _, state in self.rmfs[-1].states]
        return [one for number, one in enumerate(shown) if not number or one != shown[number - 1]]


def _fail() -> None:
    raise IndexError("a bug")


def send(request: LiftRequest, *machines: Machine) -> None:
    """RMF sends this to every machine that it has discovered."""
    for machine in machines:
        machine.rmfs[-1].send(request)


def play(scene: Callable[[Machine, Machine], Coroutine[None, None, None]]) -> None:
    async def main() -> None:
        north, south = Machine(), Machine()
        await scene(north, south)
        for machine in (north, south):
            machine.lasting.close()
            assert machine.rmfs[-1].closed

    run_virtual(main)


def test_a_standby_is_in_rmf_with_all_its_topics_and_publishes_nothing() -> None:
    async def scene(north: Machine, south: Machine) -> None:
        await north.begin_term()
        send(REQUEST, north, south)
        await elapse(5.0)
        assert len(north.rmfs[0].states) >= 10
        assert south.rmfs[0].states == []
        assert south.rmfs[0].alarm.offered == [FIRE]
        await north.end_term()

    play(scene)


def test_one_connection_serves_every_term() -> None:
    async def scene(north: Machine, south: Machine) -> None:
        for _ in range(3):
            before = len(north.rmfs[0].states)
            await north.begin_term()
            send(REQUEST, north)
            await elapse(1.0)
            assert len(north.rmfs[0].states) > before
            assert north.sessions[-1] == REQUEST.session_id
            await north.end_term()
        assert len(north.rmfs) == 1
        assert not north.rmfs[0].closed

    play(scene)


def test_nothing_is_published_once_the_term_is_over_not_even_that_the_lift_is_offline() -> None:
    async def scene(north: Machine, _: Machine) -> None:
        await north.begin_term()
        north.way.view = view(fire_latched=True)
        await elapse(1.0)
        north.may_publish = False
        before = len(north.rmfs[0].states), list(north.rmfs[0].alarm.said)
        north.way.view = view(fire_latched=True, floor="First")
        await elapse(10.0)
        await north.end_term()
        assert (len(north.rmfs[0].states), north.rmfs[0].alarm.said) == before

    play(scene)


def test_an_end_between_two_terms_ends_the_session_that_the_next_manager_continues() -> None:
    async def scene(north: Machine, south: Machine) -> None:
        await north.begin_term()
        send(REQUEST, north, south)
        await elapse(1.0)
        assert north.sessions == ["", REQUEST.session_id]
        await north.end_term()
        send(END, south)
        await elapse(4.0)
        way = FakeWay()
        way.view = HELD
        await south.begin_term(way)
        await elapse(1.0)
        assert south.way.asked == [EndOfSession("main", REQUEST.session_id, 3.0)]
        assert south.sessions == [""]
        await south.end_term()

    play(scene)


def test_an_end_that_the_manager_of_the_same_machine_could_not_record_counts_in_its_next_term() -> None:
    async def scene(north: Machine, _: Machine) -> None:
        await north.begin_term()
        send(REQUEST, north)
        await elapse(1.0)
        north.may_publish = False
        send(END, north)
        await elapse(1.0)
        await north.end_term()
        way = FakeWay()
        way.view = HELD
        await north.begin_term(way)
        await elapse(1.0)
        assert [type(asked) for asked in way.asked] == [EndOfSession]
        await north.end_term()

    play(scene)


def test_the_end_of_a_fleet_that_its_supervisor_drops_between_two_terms_counts_as_late_as_ever() -> None:
    async def scene(north: Machine, south: Machine) -> None:
        south.rmfs[0].send_of_fleet(END)
        await elapse(4.0)
        way = FakeWay()
        way.view = HELD
        await south.begin_term(way)
        await elapse(1.8)
        assert way.asked == []
        await elapse(0.4)
        assert [type(asked) for asked in way.asked] == [EndOfSession]
        await south.end_term()

    play(scene)


@pytest.mark.parametrize(("then", "later_s"), [(REQUEST, 1.0), (None, KEEP_ENDS_S + 0.1)], ids=["goes on", "too old"])
def test_an_end_does_not_count_for_the_next_ride_of_its_robot(then: LiftRequest | None, later_s: float) -> None:
    async def scene(_: Machine, south: Machine) -> None:
        send(END, south)
        await elapse(0.1)
        if then is not None:
            send(then, south)
        await elapse(later_s)
        way = FakeWay()
        way.view = HELD
        await south.begin_term(way)
        await elapse(1.0)
        assert not [asked for asked in way.asked if isinstance(asked, EndOfSession)]
        assert south.sessions == [REQUEST.session_id]
        await south.end_term()

    play(scene)


def test_of_a_replay_that_a_takeover_falls_into_only_the_last_floor_is_called() -> None:
    async def scene(_: Machine, south: Machine) -> None:
        south.rmfs[0].deliver(south.rmfs[0].listener.on_request_writer)
        await elapse(REPLAY_S / 2)
        await south.begin_term()
        for floor in ("L1", "L2"):
            send(replace(REQUEST, destination_floor=floor), south)
            await elapse(0.01)
        await elapse(1.0)
        assert south.way.asked == [SessionDemand("main", REQUEST.session_id, "First", hold_door=True)]
        await south.end_term()

    play(scene)


def test_a_machine_that_was_active_keeps_no_alarm_for_later_readers() -> None:
    async def scene(north: Machine, _: Machine) -> None:
        await north.begin_term()
        await elapse(1.0)
        await north.end_term()
        alarm = north.rmfs[0].alarm
        assert (alarm.said, alarm.forgotten_after) == ([], [])
        await north.begin_term()
        north.way.view = view(fire_latched=True)
        await elapse(1.0)
        await north.end_term()
        assert (alarm.said, alarm.forgotten_after) == ([True], [1])

    play(scene)


def test_only_in_its_term_a_machine_has_rivals(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(north: Machine, _: Machine) -> None:
        def publish_of_another() -> None:
            north.rmfs[0].deliver(lambda: north.rmfs[0].listener.on_rival("Lift1"))

        publish_of_another()
        await north.begin_term()
        await elapse(1.0)
        north.may_publish = False  # it was stopped for longer than its term
        publish_of_another()
        await elapse(1.0)
        assert "another program" not in caplog.text
        await north.end_term()
        await north.begin_term()
        publish_of_another()
        await elapse(1.0)
        assert "another program publishes the state of Lift1 too" in caplog.text
        await north.end_term()

    play(scene)


def test_a_standby_whose_connection_fails_joins_again(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(_: Machine, south: Machine) -> None:
        south.fail()
        await elapse(0.1)
        assert south.rmfs[0].closed
        south.is_unreachable = True
        await elapse(RESTART_PAUSE_S)
        south.is_unreachable = False
        assert len(south.rmfs) == 1
        await elapse(RESTART_PAUSE_S)
        assert [rmf.closed for rmf in south.rmfs] == [True, False]
        assert south.rmfs[1].alarm.offered == [FIRE]
        send(END, south)
        way = FakeWay()
        way.view = HELD
        await south.begin_term(way)
        await elapse(1.0)
        assert [type(asked) for asked in way.asked] == [EndOfSession]
        await south.end_term()

    play(scene)
    assert "the connection to Open-RMF failed" in caplog.text
    assert "cannot be joined again, next attempt in 5 s: there is no network" in caplog.text


@pytest.mark.parametrize("how", ["while receiving", "while publishing"])
def test_an_adapter_whose_connection_fails_starts_again_on_a_new_one(
    how: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def scene(north: Machine, _: Machine) -> None:
        await north.begin_term()
        await elapse(1.0)
        if how == "while receiving":
            north.fail()
        else:
            north.rmfs[0].closed = True  # publishing fails from here on
        await elapse(RESTART_PAUSE_S + 1.0)
        assert [rmf.closed for rmf in north.rmfs] == [True, False]
        send(REQUEST, north)
        await elapse(1.0)
        assert north.sessions[-1] == REQUEST.session_id
        await north.end_term()

    play(scene)
    assert "the Open-RMF adapter ended because of a bug" in caplog.text


def test_a_machine_that_cannot_join_rmf_fails_at_its_start_and_not_when_it_takes_over() -> None:
    def refuse(listener: DdsListener, deliver: Deliver) -> FakeRmf:
        raise DdsFailed("there is no network")

    async def main() -> None:
        with pytest.raises(DdsFailed, match="there is no network"):
            LastingRmf(refuse, FIRE, asyncio.get_running_loop().time)

    run_virtual(main)
