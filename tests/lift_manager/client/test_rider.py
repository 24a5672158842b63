"""What `lift-manager ride` does with signals, and with a person at a terminal."""

import asyncio
import os
import pty
import select
import signal
from collections.abc import Iterator
from itertools import chain, repeat

import httpx
import pytest

from lift_manager.cli.keyboard import EnterResult, wait_for_enter
from lift_manager.cli.ride import SIGNALS, Rider
from lift_manager.client import LiftManagerClient, Step
from lift_manager.rides.ride import Guidance, Phase
from tests.lift_manager.client.manager import IDLE, LIFT, QUEUED, URL, Manager, said
from tests.support.virtual_time import elapse, run_virtual

CANCEL = "/api/v1/rides/r1/cancel"
LEFT = "/api/v1/rides/r1/left"


def client_of(manager: Manager) -> LiftManagerClient:
    return LiftManagerClient(URL, transport=manager)


async def rides(manager: Manager, rider: Rider) -> Step | None:
    async with client_of(manager) as client:
        return await rider.ride(client, LIFT, "L1", "L2", "amr-7")


def lets_out(manager: Manager, guidance: Guidance) -> Manager:
    """A robot that may be inside is let out before a cancelled ride ends."""

    def cancel(_: httpx.Request) -> httpx.Response:
        manager.tell(Phase.CLEARING, guidance)
        return answer()

    def left(_: httpx.Request) -> httpx.Response:
        manager.tell(Phase.CANCELLED, Guidance.DONE)
        return answer()

    def answer() -> httpx.Response:
        assert manager.ride is not None
        return said(200, manager.ride.model_dump_json(by_alias=True))

    manager.handlers |= {("POST", CANCEL): cancel, ("POST", LEFT): left}
    return manager


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: signal.Signals(number).name)
def test_a_signal_cancels_the_ride_and_its_end_is_seen(number: int) -> None:
    async def main() -> None:
        manager = lets_out(Manager(), Guidance.LEAVE)
        going = asyncio.create_task(rides(manager, Rider(None)))
        await elapse(5)
        signal.raise_signal(number)
        last = await going
        assert last is not None
        assert (last.over, last.ride.phase) == (True, Phase.CANCELLED)
        assert manager.asked.count(f"POST {CANCEL}") == manager.asked.count(f"POST {LEFT}") == 1

    before = signal.getsignal(number)
    run_virtual(main)
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("deaf", [False, True])
@pytest.mark.parametrize("second", [signal.SIGTERM, signal.SIGHUP])
def test_a_second_signal_ends_it_at_once_and_says_how_the_ride_is_cancelled(
    second: int, deaf: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    async def main() -> None:
        manager = lets_out(Manager(), Guidance.STAY)
        going = asyncio.create_task(rides(manager, Rider(None)))
        await elapse(5)
        manager.deaf = deaf
        signal.raise_signal(signal.SIGTERM)
        await elapse(1)
        assert not going.done()
        told_at = asyncio.get_running_loop().time()
        signal.raise_signal(second)
        last = await going
        assert asyncio.get_running_loop().time() == told_at
        assert last is not None
        assert not last.over

    run_virtual(main)
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith("cancelled (SIGTERM)")
    assert told[-1].startswith("ended at once; the manager goes on with ride r1: ")
    assert f"`curl -X POST {URL}{CANCEL}`" in told[-1]
    assert f"`curl -X POST {URL}{LEFT}`" in told[-1]


def test_a_ride_that_is_ended_before_the_manager_has_answered_may_have_begun(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def main() -> None:
        going = asyncio.create_task(rides(Manager(deaf=True), Rider(None)))
        for _ in range(2):
            await elapse(0.1)
            signal.raise_signal(signal.SIGINT)
        assert await going is None

    run_virtual(main)
    assert f"`curl {URL}/api/v1/rides`" in capsys.readouterr().err


def test_a_signal_that_whoever_started_it_wants_ignored_is_ignored() -> None:
    async def main() -> None:
        manager = Manager()
        going = asyncio.create_task(rides(manager, Rider(None)))
        await elapse(5)
        signal.raise_signal(signal.SIGHUP)
        await elapse(5)
        manager.tell(Phase.DONE, Guidance.DONE)
        last = await going
        assert last is not None
        assert f"POST {CANCEL}" not in manager.asked

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        run_virtual(main)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_ride_that_cannot_be_cancelled_is_cancelled_once_the_manager_is_heard() -> None:
    async def main() -> None:
        manager = lets_out(Manager(), Guidance.LEAVE)
        going = asyncio.create_task(rides(manager, Rider(None)))
        await elapse(5)
        manager.up = False
        signal.raise_signal(signal.SIGTERM)
        await elapse(20)
        assert not going.done()
        manager.up = True
        last = await going
        assert last is not None
        assert last.ride.phase is Phase.CANCELLED

    run_virtual(main)


def test_a_ride_whose_end_does_not_come_is_left_to_the_manager(capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        going = asyncio.create_task(rides(lets_out(Manager(), Guidance.STAY), Rider(None)))
        await elapse(5)
        signal.raise_signal(signal.SIGINT)
        last = await going
        assert last is not None
        assert not last.over

    run_virtual(main)
    assert "the ride has not ended within 120 s; the manager goes on with ride r1" in capsys.readouterr().err


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """The keyboard of a terminal, and what a program reads from it."""
    keyboard, read = pty.openpty()
    yield keyboard, read
    os.close(keyboard)
    os.close(read)


def typed(terminal: tuple[int, int], keys: bytes) -> None:
    """Type, and wait until it can be read."""
    keyboard, read = terminal
    os.write(keyboard, keys)
    select.select([read], [], [], 5)


@pytest.mark.parametrize(
    ("before", "keys", "answer"),
    [
        (b"", b"\n", EnterResult.PRESSED),
        (b"", b"inside\n", EnterResult.PRESSED),
        (b"", b"\x04", EnterResult.ENDED),
        (b"\n\n", b"", EnterResult.WITHDRAWN),
        (b"\n\n", b"\n", EnterResult.PRESSED),
        # Ctrl-D behind other keys sends them, and is no ENTER
        (b"", b"x\x04", EnterResult.WITHDRAWN),
        (b"", b"", EnterResult.WITHDRAWN),
    ],
)
def test_only_enter_after_the_question_is_an_answer(
    terminal: tuple[int, int], before: bytes, keys: bytes, answer: EnterResult
) -> None:
    looks = 0

    def stands() -> bool:
        nonlocal looks
        looks += 1
        if keys and looks == 1:
            typed(terminal, keys)
        return looks <= 2

    if before:
        typed(terminal, before)
    assert asyncio.run(wait_for_enter("press ENTER", stands, terminal[1])) is answer


def test_enter_that_comes_when_the_question_stands_no_more_is_not_taken(terminal: tuple[int, int]) -> None:
    looks = 0

    def stands() -> bool:
        nonlocal looks
        looks += 1
        if looks == 1:
            typed(terminal, b"\n")
        return looks == 1

    assert asyncio.run(wait_for_enter("press ENTER", stands, terminal[1])) is EnterResult.WITHDRAWN
    assert looks == 2


def test_a_terminal_that_was_closed_answers_nothing() -> None:
    keyboard, read = pty.openpty()
    os.close(keyboard)
    assert asyncio.run(wait_for_enter("press ENTER", lambda: True, read)) is EnterResult.ENDED
    os.close(read)


def test_a_question_that_stands_no_more_is_withdrawn_and_its_answer_is_not_taken(
    terminal: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    async def main() -> None:
        manager = Manager({LIFT: IDLE.model_copy(update={"max_age_s": 0.3})})
        script = chain(
            repeat((Phase.BOARDING, Guidance.ENTER), 4),
            repeat((Phase.BOARDING, Guidance.WAIT), 2),
            repeat((Phase.GAVE_UP, Guidance.GAVE_UP)),
        )
        before = Guidance.WAIT

        def ride(_: httpx.Request) -> httpx.Response:
            nonlocal before
            phase, guidance = next(script)
            if guidance is before is Guidance.WAIT:
                # the guidance has been this for a second
                typed(terminal, b"\n")
            before = guidance
            return said(
                200, QUEUED.model_copy(update={"phase": phase, "guidance": guidance}).model_dump_json(by_alias=True)
            )

        manager.handlers["GET", "/api/v1/rides/r1"] = ride
        last = await rides(manager, Rider(terminal[1]))
        assert last is not None
        assert last.guidance is Guidance.GAVE_UP
        assert not [asked for asked in manager.asked if asked.endswith("/entered")]

    asyncio.run(main())
    told = capsys.readouterr().err
    assert told.count("press ENTER once the robot is inside") == 1
    assert told.count("the robot is not to enter at the moment") == 1


@pytest.mark.parametrize(("then", "over"), [(b"\n", True), (b"\x04", False)])
def test_the_end_of_the_input_cancels_and_is_never_a_word(then: bytes, over: bool, terminal: tuple[int, int]) -> None:
    async def main() -> None:
        manager = lets_out(Manager({LIFT: IDLE.model_copy(update={"max_age_s": 0.3})}), Guidance.LEAVE)
        manager.ride = QUEUED.model_copy(update={"phase": Phase.BOARDING, "guidance": Guidance.ENTER})
        looks = dict.fromkeys((Phase.BOARDING, Phase.CLEARING, Phase.CANCELLED), 0)

        def ride(_: httpx.Request) -> httpx.Response:
            assert manager.ride is not None
            looks[manager.ride.phase] += 1
            if looks[manager.ride.phase] == 2:
                # it was asked for a while ago
                typed(terminal, b"\x04" if manager.ride.phase is Phase.BOARDING else then)
            return said(200, manager.ride.model_dump_json(by_alias=True))

        manager.handlers["GET", "/api/v1/rides/r1"] = ride
        last = await rides(manager, Rider(terminal[1]))
        assert last is not None
        assert last.over is over
        assert not [asked for asked in manager.asked if asked.endswith("/entered")]
        assert manager.asked.count(f"POST {LEFT}") == over

    asyncio.run(main())
