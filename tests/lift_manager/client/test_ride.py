"""A ride in a robot's hand. A robot drives on it: what it says is true now, or it says that nothing is known."""

import asyncio
from collections.abc import Callable
from random import Random

import httpx
import pytest

from lift_manager.client import ActiveRide, LiftManagerClient, NotFound, Refused, Step, Unreachable
from lift_manager.rides.ride import Guidance, Phase
from tests.lift_manager.client.manager import LIFT, URL, Manager, no, said
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

ENTER = (Phase.BOARDING, Guidance.ENTER)
STAY = (Phase.RIDING, Guidance.STAY)
LEAVE = (Phase.ALIGHTING, Guidance.LEAVE)


def client_of(manager: Manager) -> LiftManagerClient:
    return LiftManagerClient(URL, transport=manager, chance=Random(1))


def now() -> float:
    return asyncio.get_running_loop().time()


async def until(ride: ActiveRide, wanted: Callable[[Step], bool]) -> Step:
    async for step in ride:
        if wanted(step):
            return step
    raise AssertionError("the ride ended")


def test_a_ride_yields_each_step_and_ends_with_it() -> None:
    async def main() -> list[Guidance]:
        manager, seen = Manager(), []
        async with client_of(manager) as client, client.ride("any", "L1", "L2", robot="amr-7") as ride:
            async for step in ride:
                seen.append(step.guidance)
                match step.guidance:
                    case Guidance.WAIT:
                        manager.tell(*ENTER)
                    case Guidance.ENTER:
                        assert (await ride.entered()).guidance is Guidance.STAY
                    case Guidance.STAY:
                        manager.tell(*LEAVE)
                    case Guidance.LEAVE:
                        await ride.left()
                    case _:
                        assert step.over
        assert "POST /api/v1/rides/r1/cancel" not in manager.asked
        return seen

    order = [Guidance.WAIT, Guidance.ENTER, Guidance.STAY, Guidance.LEAVE, Guidance.DONE]
    assert run_virtual(main) == order


def test_a_ride_that_the_program_leaves_is_cancelled() -> None:
    async def main(how: str) -> None:
        manager = Manager()
        async with client_of(manager) as client:
            try:
                async with client.ride(LIFT, "L1", "L2", robot="amr-7"):
                    assert how == "ends"
            except AssertionError:
                assert how == "raises"
        assert manager.asked[-1] == "POST /api/v1/rides/r1/cancel"

    run_virtual(lambda: main("ends"))
    run_virtual(lambda: main("raises"))


def test_a_ride_whose_program_is_cancelled_is_cancelled() -> None:
    async def main() -> None:
        manager = Manager()

        async def robot() -> None:
            async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7"):
                await elapse(100)

        task = asyncio.create_task(robot())
        await elapse(5)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert manager.asked[-1] == "POST /api/v1/rides/r1/cancel"

    run_virtual(main)


def test_a_ride_that_makes_no_sense_is_refused_in_the_words_of_the_manager() -> None:
    async def main() -> None:
        words = "to must be another floor than from"
        manager = Manager(handlers={("POST", "/api/v1/rides"): lambda _: no(422, "malformed", words, field="to")})
        async with client_of(manager) as client:
            with pytest.raises(Refused, match=words) as caught:
                async with client.ride("any", "L1", "L1", robot="amr-7"):
                    raise AssertionError("there is no ride")
        assert caught.value.problem.field == "to"

    run_virtual(main)


def test_a_ride_that_cannot_be_cancelled_is_told() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client:
            with pytest.raises(Unreachable):
                async with client.ride(LIFT, "L1", "L2", robot="amr-7"):
                    manager.up = False

    run_virtual(main)


@each_row("fails", ["up", "deaf"])
@each_row(("stands", "kept"), [(ENTER, Guidance.WAIT), (LEAVE, Guidance.STAY)])
def test_an_invitation_falls_once_the_manager_was_not_heard_for_max_age(
    fails: str, stands: tuple[Phase, Guidance], kept: Guidance
) -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*stands)
            await until(ride, lambda step: step.guidance is stands[1])
            await elapse(5)
            assert ride.now.guidance is stands[1]
            setattr(manager, fails, fails == "deaf")
            gone_at = now()
            step = await until(ride, lambda step: not step.is_current)
            assert now() - gone_at <= 1.01
            assert step.guidance is kept
            assert "has not replied for" in step.reason
            assert ride.now.guidance is kept
            setattr(manager, fails, fails == "up")
            await until(ride, lambda step: step.is_current and step.guidance is stands[1])
            assert "POST /api/v1/rides/r1/here" in manager.asked
            manager.tell(Phase.DONE, Guidance.DONE)
            await until(ride, lambda step: step.over)

    run_virtual(main)


def test_an_invitation_that_was_long_on_its_way_is_never_shown() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            await until(ride, lambda step: step.guidance is Guidance.WAIT)
            manager.late_s = 0.9
            manager.tell(*ENTER)
            for _ in range(10):
                # the answer was given 0.9 s ago: it is good for 0.1 s more
                await until(ride, lambda step: step.guidance is Guidance.ENTER)
                shown_at = now()
                await until(ride, lambda step: step.guidance is not Guidance.ENTER)
                assert now() - shown_at <= 0.11
            manager.late_s = 1.1
            await elapse(3)
            for _ in range(300):
                assert ride.now.guidance is Guidance.WAIT
                await elapse(0.1)
            manager.late_s = 0.0

    run_virtual(main)


def test_an_older_question_that_is_answered_later_changes_nothing() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*ENTER)
            await until(ride, lambda step: step.guidance is Guidance.ENTER)
            manager.late_s = 0.6
            asked = len(manager.asked)
            while len(manager.asked) == asked:
                await elapse(0.01)
            # the answer to this question says `enter`, and is on its way
            manager.late_s = 0.0
            assert (await ride.cancel()).over
            for _ in range(100):
                await elapse(0.01)
                assert (ride.now.guidance, ride.now.over) == (Guidance.DONE, True)

    run_virtual(main)


@each_row("seed", range(30))
def test_whatever_fails_an_invitation_is_only_shown_while_the_manager_said_so_within_max_age(seed: int) -> None:
    chance = Random(seed)

    async def main() -> int:
        manager, invited = Manager(cuts=chance), 0
        said_at = -9.0
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            for _ in range(300):
                if chance.random() < 0.1:
                    manager.up = chance.random() < 0.7
                    manager.deaf = chance.random() < 0.2
                    manager.late_s = chance.choice([0.0, 0.0, 0.3, 0.8, 2.0])
                    manager.tell(*chance.choice([ENTER, ENTER, (Phase.BOARDING, Guidance.WAIT)]))
                if manager.ride is not None and manager.ride.guidance is Guidance.ENTER:
                    said_at = now()
                if ride.now.guidance is Guidance.ENTER:
                    invited += 1
                    assert now() - said_at <= 1.000001
                await elapse(0.1)
            manager.up, manager.deaf, manager.late_s = True, False, 0.0
        return invited

    assert run_virtual(main) > 0


def test_a_robot_that_is_inside_is_told_to_stay_although_the_manager_has_not_heard_it() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*ENTER)
            await until(ride, lambda step: step.guidance is Guidance.ENTER)
            manager.up = False
            async with asyncio.TaskGroup() as tasks:
                saying = tasks.create_task(ride.entered())
                await elapse(0.1)
                assert (ride.now.guidance, ride.now.is_current) == (Guidance.STAY, True)
                await elapse(30)
                assert (ride.now.guidance, ride.now.is_current) == (Guidance.STAY, False)
                manager.up = True
            assert saying.result().ride.phase is Phase.RIDING

    run_virtual(main)


def test_a_word_whose_answer_was_lost_is_not_refused_to_the_robot() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*ENTER)
            await until(ride, lambda step: step.guidance is Guidance.ENTER)
            manager.loses = 1
            assert (await ride.entered()).ride.phase is Phase.RIDING
            manager.tell(*LEAVE)
            await until(ride, lambda step: step.guidance is Guidance.LEAVE)
            manager.loses = 1
            assert (await ride.left()).over

    run_virtual(main)


def test_a_word_that_the_manager_took_and_forgot_is_said_again() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*ENTER)
            await until(ride, lambda step: step.guidance is Guidance.ENTER)
            await ride.entered()
            manager.restart()
            manager.tell(*ENTER)
            for _ in range(40):
                assert ride.now.guidance is Guidance.STAY
                await elapse(0.05)
            assert ride.now.ride.phase is Phase.RIDING
            assert manager.asked.count("POST /api/v1/rides/r1/entered") == 2

    run_virtual(main)


def test_the_word_that_ends_a_ride_is_said_again_until_it_is_recorded() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*LEAVE)
            await until(ride, lambda step: step.guidance is Guidance.LEAVE)

            def left(_: httpx.Request) -> httpx.Response:
                manager.tell(Phase.DONE, Guidance.DONE)
                assert manager.ride is not None
                times = manager.asked.count("POST /api/v1/rides/r1/left")
                return said(
                    200, manager.ride.model_copy(update={"recorded": times == 3}).model_dump_json(by_alias=True)
                )

            manager.handlers["POST", "/api/v1/rides/r1/left"] = left
            assert (await ride.left()).over
            assert manager.asked.count("POST /api/v1/rides/r1/left") == 3

    run_virtual(main)


def test_a_word_that_makes_no_sense_is_refused_and_forgotten() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            with pytest.raises(Refused, match="the ride is queued"):
                await ride.entered()
            manager.tell(*ENTER)
            assert (await until(ride, lambda step: step.guidance is Guidance.ENTER)).is_current

    run_virtual(main)


def test_after_a_restart_the_robot_is_heard_without_the_program_doing_anything() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*STAY)
            await until(ride, lambda step: step.guidance is Guidance.STAY)
            assert "POST /api/v1/rides/r1/here" not in manager.asked
            manager.restart()
            await elapse(3)
            is_current = [asked for asked in manager.asked if asked.endswith(("/here", "/events"))]
            assert is_current.index("GET /api/v1/events", 1) < len(is_current) - 1, (
                "it is said to the manager that is there after the cut"
            )
            assert is_current[-1] == "POST /api/v1/rides/r1/here"

    run_virtual(main)


def test_a_ride_that_the_manager_has_forgotten_is_given_up() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*STAY)
            await until(ride, lambda step: step.guidance is Guidance.STAY)
            manager.handlers["GET", "/api/v1/rides/r1"] = lambda _: no(404, "unknown_ride", "no ride 'r1'")
            step = await until(ride, lambda step: step.over)
            assert (step.guidance, step.reason, step.advice) == (Guidance.GAVE_UP, "no ride 'r1'", "clear_doorway")
            with pytest.raises(StopAsyncIteration):
                await anext(ride)
            manager.ride = None
            with pytest.raises(NotFound):
                await ride.left()

    run_virtual(main)


def test_a_key_that_is_revoked_on_the_way_is_silence_with_its_reason() -> None:
    async def main() -> None:
        manager = Manager()
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            manager.tell(*LEAVE)
            await until(ride, lambda step: step.guidance is Guidance.LEAVE)
            for asked in (("GET", "/api/v1/rides/r1"), ("POST", "/api/v1/rides/r1/here")):
                manager.handlers[asked] = lambda _: no(401, "bad_key", "this key does not count here")
            step = await until(ride, lambda step: not step.is_current)
            assert step.guidance is Guidance.STAY
            assert "this key does not count here" in step.reason

    run_virtual(main)


def test_without_an_event_stream_a_ride_goes_on_by_the_clock() -> None:
    async def main() -> None:
        manager = Manager(handlers={("GET", "/api/v1/events"): lambda _: no(403, "not_allowed")})
        async with client_of(manager) as client, client.ride(LIFT, "L1", "L2", robot="amr-7") as ride:
            await until(ride, lambda step: step.guidance is Guidance.WAIT)
            manager.tell(*ENTER)
            told_at = now()
            await until(ride, lambda step: step.guidance is Guidance.ENTER)
            assert now() - told_at <= 1.1

    run_virtual(main)
