"""Requests that reach the adapter in an order of their own, without a supervisor between: who has the lift, and what is pressed."""

from collections.abc import Awaitable, Callable

from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lift.session import Holder
from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_OPEN,
    END_SESSION,
    MODE_OFFLINE,
    LiftRequest,
    LiftState,
    Time,
)
from tests.support.rmf.playing import loaded_site
from tests.support.rmf.world import RmfWorld, Setting
from tests.support.virtual_time import elapse, run_virtual

A, B = "fleet_1/robot_1", "fleet_2/robot_2"
AMR = Holder("api", "amr")


class Wire:
    """Somebody at `lift_requests` and `lift_states`."""

    def __init__(self, world: RmfWorld) -> None:
        self.world = world

    def ask(self, session: str, level: int) -> None:
        self._send(session, AGV_MODE, f"level {level}", DOOR_OPEN)
        self.world.judge.wants(self.world.now, session, f"level {level}")

    def end(self, session: str, floor: str = "") -> None:
        self._send(session, END_SESSION, floor, DOOR_CLOSED)

    def _send(self, session: str, kind: int, floor: str, door: int) -> None:
        self.world.site.direct("test", LiftRequest(self.world.name, Time(), session, kind, floor, door))

    @property
    def state(self) -> LiftState:
        return self.world.states[-1][1]

    @property
    def session(self) -> str:
        return self.state.session_id

    @property
    def pressed(self) -> int:
        return self.world.judge.presses

    async def keep_asking(self, session: str, level: int, for_s: float) -> None:
        """Repeat it twice a second, as a supervisor does that reads a lift where it is not satisfied."""
        for _ in range(round(2 * for_s)):
            self.ask(session, level)
            await elapse(0.5)


def on_the_wire(play: Callable[[Wire], Awaitable[None]], *, way_s: float = 0.0) -> None:
    """Play on virtual time, and let the judge look on."""

    async def main() -> None:
        world = RmfWorld(loaded_site("generic-registers"), Setting(message_s=0.0, way_s=way_s, speed=5.0))
        async with world.running():
            world.site.stop_supervisor()
            await elapse(1.0)
            await play(Wire(world))
            assert [str(found) for found in world.judge.findings] == []

    run_virtual(main)


def test_the_end_of_one_and_the_request_of_another_a_millisecond_later_are_both_heard() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        assert (wire.session, wire.state.door_state) == (A, DOOR_OPEN)
        wire.end(A)
        await elapse(0.001)
        wire.ask(B, 2)
        await elapse(0.05)
        assert (wire.session, wire.state.door_state != DOOR_OPEN) == (B, True)
        await wire.keep_asking(B, 2, 8.0)
        assert (wire.session, wire.state.door_state) == (B, DOOR_OPEN)

    on_the_wire(play)
    on_the_wire(play, way_s=0.02)


def test_a_request_a_millisecond_before_the_end_of_the_holder_is_heard_when_it_is_repeated() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        wire.ask(B, 3)
        await elapse(0.001)
        wire.end(A)
        await elapse(0.05)
        assert wire.session == ""
        await wire.keep_asking(B, 3, 0.5)
        assert wire.session == B
        await wire.keep_asking(B, 3, 10.0)
        assert (wire.session, wire.state.current_floor, wire.state.door_state) == (B, "level 3", DOOR_OPEN)

    on_the_wire(play)
    on_the_wire(play, way_s=0.02)


def test_a_session_that_ends_and_asks_again_within_the_grace_keeps_the_door_and_presses_nothing() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        before = wire.pressed
        for _ in range(5):
            wire.end(A)
            await elapse(0.02)
            assert wire.session == ""
            await wire.keep_asking(A, 2, 1.0)
            assert wire.session == A
        assert wire.pressed == before
        last = wire.world.judge.truth.since
        assert wire.world.now - last > 5.0, "nothing about the lift changed meanwhile"

    on_the_wire(play)


def test_an_end_under_way_stops_nothing_and_calls_nothing() -> None:
    async def play(wire: Wire) -> None:
        wire.ask(A, 4)
        await elapse(2.0)
        assert not _stands(wire)
        pressed = wire.pressed
        for floor in ("", "level 1", "the moon", "level 4"):
            wire.end(A, floor)
            await elapse(0.05)
            assert wire.session == ""
        await elapse(20.0)
        assert wire.pressed == pressed
        assert wire.world.judge.holder.last is None
        truth = wire.world.judge.truth.last
        assert truth is not None
        assert (truth.at, truth.commands) == ("L4", frozenset())

    on_the_wire(play)


def test_ends_for_nobody_and_for_another_change_nothing() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        for _ in range(300):
            wire.end("")
            wire.end(B, "level 1")
            await elapse(0.01)
            assert wire.session == A
        assert wire.state.door_state == DOOR_OPEN

    on_the_wire(play)


def test_an_end_while_the_lift_is_offline_counts_and_without_one_the_session_stays() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        wire.world.judge.excuse(wire.world.now, "offline", on=True)
        wire.world.plant.plug(on=False)
        await wire.keep_asking(A, 2, 5.0)
        assert (wire.session, wire.state.current_mode, wire.state.door_state != DOOR_OPEN) == (A, MODE_OFFLINE, True)
        wire.end(A)
        await elapse(0.1)
        assert (wire.session, wire.state.current_mode) == ("", MODE_OFFLINE)
        wire.world.plant.plug(on=True)
        await elapse(15.0)
        assert wire.session == ""
        assert wire.world.judge.holder.last is None

    on_the_wire(play)


def test_an_end_while_the_manager_is_away_is_delivered_when_it_is_back_and_shown_then() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        wire.world.judge.excuse(wire.world.now, "down", on=True)
        wire.world.cut_way("the network is cut")
        await wire.keep_asking(A, 2, 2.0)
        assert (wire.session, wire.state.current_mode) == (A, MODE_OFFLINE)
        wire.end(A)
        await elapse(4.0)
        assert (wire.session, wire.state.current_mode) == (A, MODE_OFFLINE)
        assert wire.world.judge.holder.last == Holder("rmf", A)
        wire.world.judge.excuse(wire.world.now, "down", on=False, lasts_s=3.0)
        wire.world.mend_way()
        await elapse(0.2)
        assert wire.session == ""
        await elapse(4.8)
        assert wire.world.judge.holder.last is None

    on_the_wire(play)
    on_the_wire(play, way_s=0.02)


def test_the_session_of_another_face_is_shown_never_open_and_no_end_of_rmf_ends_it() -> None:
    async def play(wire: Wire) -> None:
        world = wire.world
        for _ in range(10):
            assert world.plant.request(FloorRequest(world.lift, AMR, "L2", hold_door=True)) is None
            wire.end("api:amr", "level 2")
            wire.ask(A, 3)
            await elapse(1.0)
            assert wire.session == "api:amr"
            assert wire.state.door_state != DOOR_OPEN
        truth = world.judge.truth.last
        assert truth is not None
        assert truth.open_at == "L2"
        assert world.judge.holder.last == AMR

    on_the_wire(play)


def test_a_request_that_is_repeated_costs_the_controller_nothing() -> None:
    written: list[int] = []

    async def seldom(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 20.0)
        written.append(wire.world.judge.writes)

    async def often(wire: Wire) -> None:
        for _ in range(1000):
            wire.ask(A, 2)
            await elapse(0.02)
        written.append(wire.world.judge.writes)

    on_the_wire(seldom)
    on_the_wire(often)
    assert written[0] == written[1]


def _stands(wire: Wire) -> bool:
    truth = wire.world.judge.truth.last
    return truth is not None and truth.standing


def test_an_adapter_that_restarts_in_the_grace_does_not_show_the_ended_session_again() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        wire.end(A)
        await elapse(0.5)
        wire.world.judge.excuse(wire.world.now, "adapter", on=True)
        wire.world.kill_adapter()
        wire.world.start_adapter()
        said = len(wire.world.states)
        await elapse(5.0)
        assert {state.session_id for _, state in wire.world.states[said:]} == {""}

    on_the_wire(play)


def test_a_session_whose_end_comes_before_the_other_machine_takes_over_is_over_with_its_first_state() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        await wire.world.kill_machine()
        wire.end(A)
        await elapse(3.0)
        published = len(wire.world.states)
        await wire.world.take_over()
        await wire.keep_asking(B, 3, 10.0)
        sessions = [state.session_id for _, state in wire.world.states[published:]]
        assert A not in sessions
        assert (wire.session, wire.state.current_floor, wire.state.door_state) == (B, "level 3", DOOR_OPEN)

    on_the_wire(play)


def test_a_session_that_goes_on_through_a_takeover_keeps_its_lift_and_presses_nothing() -> None:
    async def play(wire: Wire) -> None:
        await wire.keep_asking(A, 2, 6.0)
        wire.end(A)
        await wire.keep_asking(A, 2, 1.0)
        pressed = wire.pressed
        await wire.world.kill_machine()
        await wire.keep_asking(A, 2, 2.5)
        published = len(wire.world.states)
        await wire.world.take_over()
        await elapse(1.0)
        assert {state.session_id for _, state in wire.world.states[published:]} == {A}
        assert wire.pressed == pressed

    on_the_wire(play)
