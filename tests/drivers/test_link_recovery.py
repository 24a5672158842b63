"""How a link comes up, goes down, says why, and comes back."""

import asyncio
import logging
from itertools import pairwise

import pytest

from drivers.errors import ConnectFailed, ConnectionLost, ConnectProblem, Delivery, LinkDown
from drivers.modbus.link import OUTAGES, Link, LinkSettings, LinkState
from drivers.modbus.memory import MemoryDevice, MemoryWire, hang_up, silence
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.support.virtual_time import elapse

READ = frames.read(Table.HOLDING, 0)
PRESS = frames.write_coil(9, True)
LINK_LOGGER = "drivers.modbus.link"


@virtual
async def test_a_link_that_was_never_started_says_so() -> None:
    link = Link(MemoryDevice().wire, name="lobby")
    with pytest.raises(LinkDown, match=r"lobby: no connection for 0\.0 s: not started"):
        await link.read(READ)
    assert (link.state, link.epoch, link.since) == (LinkState.DOWN, 0, None)


@virtual
async def test_while_it_is_down_everything_fails_at_once_with_the_reason_and_how_long() -> None:
    device = MemoryDevice(peer="127.0.0.1:5020")
    async with linked(device) as link:
        device.connect_problem = ConnectProblem.REFUSED
        device.disconnect()
        await elapse(3)
        began = now()
        for asking in (link.read(READ), link.read_urgent(READ), link.write(PRESS)):
            with pytest.raises(
                LinkDown, match=r"lobby: no connection for 3\.0 s: 127\.0\.0\.1:5020: refused"
            ) as caught:
                await asking
            assert caught.value.sent is Delivery.NO
        assert now() == began
        assert device.received == []


@virtual
async def test_every_connection_is_a_new_epoch() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        for epoch in range(1, 4):
            assert await link.wait_up() == epoch
            assert link.epoch == epoch
            assert (link.state, link.reason, link.since) == (LinkState.UP, "", now())
            await elapse(5)
            device.disconnect()
            assert (link.state, link.since) == (LinkState.DOWN, now())
            assert link.reason == "the controller closed the connection"


@virtual
async def test_a_loss_leaves_the_one_in_flight_unknown_and_the_queued_ones_not_sent() -> None:
    device = MemoryDevice()
    device.fail_next(hang_up())
    async with linked(device) as link, asyncio.TaskGroup() as group:
        press = group.create_task(outcome(link.write(PRESS)))
        queued = group.create_task(outcome(link.write(PRESS)))
        read = group.create_task(outcome(link.read(READ)))
    error = press.result()
    assert isinstance(error, ConnectionLost)
    assert error.sent is Delivery.UNKNOWN
    for waiting in (queued, read):
        error = waiting.result()
        assert isinstance(error, LinkDown)
        assert error.sent is Delivery.NO
    assert device.writes == [PRESS]


@virtual
async def test_attempts_back_off_to_one_a_second_and_no_further() -> None:
    device = MemoryDevice()
    attempts: list[float] = []

    def make_wire() -> MemoryWire:
        attempts.append(now())
        return device.wire()

    device.connect_problem = ConnectProblem.REFUSED
    link = Link(make_wire, name="lobby")
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        await elapse(5)
        await link.close()
    pauses = [after - before for before, after in pairwise(attempts)]
    assert pauses == pytest.approx([0.2, 0.4, 0.8, 1.0, 1.0, 1.0])
    assert link.stats.failed_connects == len(attempts)


@pytest.mark.parametrize("problem", [ConnectProblem.REFUSED, ConnectProblem.TIMED_OUT])
@pytest.mark.parametrize("away_s", [0.05, 1.0, 7.77, 60.0, 1800.0])
@virtual
async def test_it_is_up_again_within_two_seconds_of_the_controllers_return(
    problem: ConnectProblem, away_s: float
) -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        device.connect_problem = problem
        device.disconnect()
        await elapse(away_s)
        device.connect_problem = None
        returned = now()
        await link.wait_up()
        assert now() - returned <= 2.0


@virtual
async def test_a_controller_that_takes_connections_and_closes_them_is_not_hammered() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        began = now()
        while now() - began < 60:
            await link.wait_up()
            device.disconnect()
        assert device.connects <= 65


@virtual
async def test_a_connection_that_served_well_is_replaced_after_the_shortest_pause() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        for _ in range(5):
            await link.wait_up()
            await link.read(READ)
            device.disconnect()
            lost = now()
            await link.wait_up()
            assert now() - lost == pytest.approx(0.2)


@virtual
async def test_a_silent_controller_is_given_the_shortest_pause_at_least() -> None:
    device = MemoryDevice()
    device.fail_next(silence(), times=1000)
    async with linked(device) as link:
        for _ in range(10):
            await link.wait_up()
            for _ in range(2):
                await outcome(link.read(READ))
            assert link.state is LinkState.DOWN
            closed = now()
            await link.wait_up()
            assert 0.2 <= now() - closed + 1e-9 <= 1.0
        assert len(device.received) == 20


def messages(caplog: pytest.LogCaptureFixture, level: int) -> list[str]:
    return [record.getMessage() for record in caplog.records if (record.name, record.levelno) == (LINK_LOGGER, level)]


def test_an_outage_is_one_warning_and_its_end_one_line_more(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)

    @virtual
    async def outage() -> None:
        device = MemoryDevice(peer="127.0.0.1:5020")
        async with linked(device) as link:
            await link.read(READ)
            device.connect_problem = ConnectProblem.REFUSED
            device.disconnect()
            await elapse(60)
            device.connect_problem = None
            await link.wait_up()
            await link.read(READ)
            await link.read(READ)

    outage()
    assert messages(caplog, logging.WARNING) == ["lobby: no connection: the controller closed the connection"]
    connected, again = messages(caplog, logging.INFO)
    assert connected == "lobby: connected"
    assert again.startswith("lobby: answers again after 60.")
    assert len(messages(caplog, logging.DEBUG)) > 50


def test_a_link_that_flaps_has_a_few_lines_a_minute_and_the_rest_is_counted(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    @virtual
    async def outages() -> None:
        device = MemoryDevice()
        async with linked(device) as link:
            for _ in range(300):
                await link.wait_up()
                await link.read(READ)
                device.disconnect()
                await elapse(1.0)
            await link.wait_up()
            await link.read(READ)
            await elapse(120.0)

    outages()
    lines = [record.getMessage() for record in caplog.records if record.name == LINK_LOGGER]
    lost = [line for line in lines if line.startswith("lobby: no connection")]
    more = [line for line in lines if "more times within" in line]
    assert OUTAGES <= len(lost) <= OUTAGES + 10
    assert len(lines) < 2 * len(lost) + 12
    assert len(lost) + sum(int(line.split("lost ")[1].split()[0]) for line in more) == 300
    assert more[-1].endswith("now it answers")


def test_a_controller_that_connects_and_stays_silent_is_not_announced_as_back(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    @virtual
    async def outage() -> None:
        device = MemoryDevice()
        async with linked(device) as link:
            device.fail_next(silence(), times=1000)
            for _ in range(40):
                await link.wait_up()
                await outcome(link.read(READ))

    outage()
    assert len(messages(caplog, logging.WARNING)) == 1
    assert messages(caplog, logging.INFO) == []


@virtual
async def test_closing_tells_everyone_and_ends_the_run() -> None:
    device = MemoryDevice(delay_s=0.3)
    link = Link(device.wire, name="lobby")
    async with asyncio.TaskGroup() as group:
        running = group.create_task(link.run())
        await link.wait_up()
        press = group.create_task(outcome(link.write(PRESS)))
        queued = group.create_task(outcome(link.write(PRESS)))
        await elapse(0.1)
        await link.close()
    assert running.result() is None
    assert isinstance(press.result(), ConnectionLost)
    assert isinstance(queued.result(), LinkDown)
    with pytest.raises(LinkDown, match="closed"):
        await link.read(READ)
    with pytest.raises(LinkDown, match="closed"):
        await link.wait_up()
    await link.close()
    assert link.state is LinkState.DOWN


def test_closing_while_it_connects_is_no_outage(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    test_closing_while_it_connects_leaves_no_connection()
    assert caplog.records == []


@virtual
async def test_closing_while_it_connects_leaves_no_connection() -> None:
    device = MemoryDevice()
    device.connect_problem = ConnectProblem.TIMED_OUT
    link = Link(device.wire, name="lobby")
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        waiting = group.create_task(outcome(link.wait_up()))
        await elapse(0.5)
        assert link.state is LinkState.CONNECTING
        await link.close()
    assert now() <= 1.0
    assert isinstance(waiting.result(), LinkDown)
    assert (device.connects, link.reason) == (1, "closed")


@virtual
async def test_cancelling_the_run_ends_the_connection_and_tells_everyone() -> None:
    device = MemoryDevice(delay_s=0.3)
    link = Link(device.wire, name="lobby")
    async with asyncio.TaskGroup() as group:
        running = group.create_task(link.run())
        await link.wait_up()
        press = group.create_task(outcome(link.write(PRESS)))
        await elapse(0.1)
        running.cancel()
    assert running.cancelled()
    assert isinstance(press.result(), ConnectionLost)
    with pytest.raises(LinkDown, match="stopped"):
        await link.read(READ)


@virtual
async def test_a_link_cannot_be_run_twice_at_once() -> None:
    async with linked(MemoryDevice()) as link:
        with pytest.raises(RuntimeError, match="already running"):
            await link.run()
        await link.read(READ)


@virtual
async def test_bytes_that_come_before_the_first_question_are_no_connection() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        device.send_unrequested(b"login: please")
        assert link.state is LinkState.DOWN
        assert "not Modbus/TCP" in link.reason


@pytest.mark.parametrize(
    ("field", "value"),
    [("timeout_s", 0.0), ("reconnect_min_s", 0.0), ("min_gap_s", -1.0), ("reconnect_max_s", 0.1), ("busy_retries", -1)],
)
def test_settings_that_cannot_work_are_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        LinkSettings(**{field: value})  # type: ignore[arg-type]  # one name at a time


@virtual
async def test_a_device_with_few_slots_that_takes_no_connection_may_have_given_them_away() -> None:
    device = MemoryDevice(peer="127.0.0.1:5020")
    async with linked(device, LinkSettings(max_connections=1)) as link:
        device.connect_problem = ConnectProblem.TIMED_OUT
        device.disconnect()
        await elapse(3)
        assert link.reason.endswith("; it serves 1 client at once, and another one may hold the slot")


@virtual
async def test_what_is_to_be_done_before_a_connection_is_done_first_and_its_failure_is_the_reason() -> None:
    device = MemoryDevice(peer="plc:502")
    attempts = 0

    async def prepare() -> None:
        nonlocal attempts
        attempts += 1
        await elapse(0.5)
        if attempts < 4:
            raise ConnectFailed("plc", ConnectProblem.OTHER, "the way of the other machine is open")

    link = Link(device.wire, name="lobby", prepare=prepare)
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        await elapse(1.0)
        with pytest.raises(LinkDown, match=r"no connection for .*: plc: the way of the other machine is open"):
            await link.read(READ)
        assert device.received == []
        await link.wait_up()
        assert attempts == 4
        await link.close()


@virtual
async def test_a_link_that_is_closed_meanwhile_makes_no_connection() -> None:
    device = MemoryDevice()

    async def prepare() -> None:
        await elapse(1.0)

    link = Link(device.wire, name="lobby", prepare=prepare)
    async with asyncio.TaskGroup() as group:
        group.create_task(link.run())
        await elapse(0.5)
        await link.close()
    assert (link.state, link.stats.connects) == (LinkState.DOWN, 0)
