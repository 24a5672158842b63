"""What faces get of a site: replies, refusals as exceptions, and whether a change is on the disk."""

import asyncio

import pytest

from lift_manager.lift.commands import CommandRequest, CommandState, CommandType, SessionInfo
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.inputs import JoinQueue, LeaveQueue
from lift_manager.runtime.bus import StateChanged
from lift_manager.runtime.errors import Conflict, Invalid, LiftTaken, NotFound, RequestRefused, Unavailable
from lift_manager.runtime.refusals import FaceRefusal
from register_maps.words import Door
from tests.lift_manager.runtime.scripted import OTHER, PLAIN, ROBOT, Bench, SlowRecorder, on_bench
from tests.support.virtual_time import elapse


def go_to(session: SessionInfo, floor: str) -> CommandRequest:
    return CommandRequest(session=session.id, holder=session.holder, kind=CommandType.GO_TO, floor=floor)


def test_refusals_are_raised_by_what_helps_the_caller() -> None:
    async def check(made: Bench) -> None:
        site = made.site
        with pytest.raises(NotFound, match=r"no lift \"west\"; the lifts are lift"):
            site.state("west")
        with pytest.raises(Invalid, match="no floor 'L9'"):
            site.request("lift", ROBOT, "L9", hold_door=True)
        made.accept("L3")
        with pytest.raises(LiftTaken) as taken:
            site.request("lift", OTHER, "L1", hold_door=True)
        assert taken.value.code == "held"
        assert taken.value.blocking is not None
        assert taken.value.blocking.holder == ROBOT
        with pytest.raises(Conflict, match="nothing to acknowledge"):
            site.acknowledge("lift", "ann")
        with pytest.raises(NotFound):
            site.session("lift", "none", None)
        await made.life.clear_doors()
        with pytest.raises(Unavailable, match="stopping"):
            site.request("lift", ROBOT, "L1", hold_door=True)
        assert site.refusals.counts == {
            ("", "unknown_lift"): 1,
            ("lift", "unknown_floor"): 1,
            ("lift", "held"): 1,
            ("lift", "nothing_to_acknowledge"): 1,
            ("lift", "no_such_session"): 1,
            ("lift", "stopping"): 1,
        }

    on_bench(check, PLAIN)


def test_a_person_that_is_refused_has_a_row() -> None:
    async def check(made: Bench) -> None:
        with pytest.raises(RequestRefused):
            made.site.end_lockout("lift", "ann")
        row = made.rows[-1]
        assert (row.caller, row.text) == ("ann", "lockout_end refused: lift is not locked out")

    on_bench(check, PLAIN)


def test_a_request_that_a_face_refuses_by_itself_is_counted_and_written_down() -> None:
    async def check(made: Bench) -> None:
        made.site.turned_away(FaceRefusal("bad_key", "its key does not count here", "lift", "", "10.0.0.7"))
        assert made.rows[-1].text == "refused: its key does not count here, from 10.0.0.7"
        assert made.site.refusals.counts["lift", "bad_key"] == 1

    on_bench(check, PLAIN)


def test_a_reply_can_wait_for_the_disk_and_gives_up() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        restriction = made.site.lock_out("lift", "ann", "new ropes")
        assert restriction.kind is RestrictionKind.LOCKOUT
        assert made.state.restrictions.lockout.startswith("by ann")
        before = asyncio.get_running_loop().time()
        assert not await made.site.recorded("lift")
        assert asyncio.get_running_loop().time() - before == pytest.approx(0.5)
        waits = asyncio.ensure_future(made.site.recorded("lift"))
        await elapse(0.1)
        disk.unwritten[-1].set_result(None)
        assert await waits

    on_bench(check, PLAIN, recorder=disk, poll_s=0.2)


def test_a_command_is_awaited_until_it_has_its_end() -> None:
    async def check(made: Bench) -> None:
        session = made.site.open_session("lift", ROBOT).session
        status = made.site.command("lift", go_to(session, "L3"))
        assert status.state is CommandState.PENDING
        ended = await made.site.until_ended("lift", session.id, ROBOT, status.id, 10.0)
        assert ended.state is CommandState.CONFIRMED
        assert made.site.command_status("lift", session.id, ROBOT, status.id) == ended

    on_bench(check, PLAIN)


def test_a_command_that_does_not_end_is_returned_as_it_is() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        session = made.site.open_session("lift", ROBOT).session
        status = made.site.command("lift", go_to(session, "L3"))
        ended = await made.site.until_ended("lift", session.id, ROBOT, status.id, 2.0)
        assert ended.state is CommandState.PENDING

    on_bench(check, PLAIN, recorder=disk)


def test_an_idempotency_key_gives_the_same_session_and_no_other_row() -> None:
    async def check(made: Bench) -> None:
        begun = made.site.open_session("lift", ROBOT, key="k")
        rows = len(made.rows)
        again = made.site.open_session("lift", ROBOT, key="k")
        assert (begun.is_new, again.is_new) == (True, False)
        assert again.session.id == begun.session.id
        assert len(made.rows) == rows

    on_bench(check, PLAIN)


def test_a_caller_waits_in_the_queue_until_it_leaves_it() -> None:
    async def check(made: Bench) -> None:
        made.actor.handle(JoinQueue(OTHER))
        assert made.state.waiting == 1
        with pytest.raises(LiftTaken, match="comes first"):
            made.accept("L3")
        made.actor.handle(LeaveQueue(OTHER))
        made.actor.handle(LeaveQueue(ROBOT))
        made.accept("L3")

    on_bench(check, PLAIN)


def test_a_listener_begins_with_the_state_of_every_lift() -> None:
    async def check(made: Bench) -> None:
        with made.site.listen() as listener:
            first = await listener.next()
            made.site.freshen()
            await made.car("L1", Door.CLOSED)
            second = await listener.next()
        assert [one.state.floor for one in (first, second) if isinstance(one, StateChanged)] == ["L2", "L1"]

    on_bench(check, PLAIN)
