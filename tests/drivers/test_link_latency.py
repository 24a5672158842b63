"""How long the link waits for an answer: it follows what answers take, within bounds; and what it refuses in doubt."""

import asyncio
import random

import pytest

from drivers.errors import AnswerTimeout, Delivery, PressRefused
from drivers.modbus.latency import SPARE_S
from drivers.modbus.link import Link, LinkSettings, LinkState
from drivers.modbus.memory import Fault, MemoryDevice, exception, late, silence
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.support.rows import each_row
from tests.support.virtual_time import elapse

READ = frames.read(Table.HOLDING, 0)
PRESS = frames.write_register(3, 1)
RELEASE = frames.write_register(3, 0)


def allowed() -> None:
    return None


def waits(settings: LinkSettings, *took_s: float) -> float:
    """The time-out after answers that took so long."""
    latency = settings.new_latency()
    for each_s in took_s:
        latency.add_late_answer(each_s)
    return latency.timeout_s


@each_row(
    ("took_s", "timeout_s"),
    [
        ((), 0.5),
        # RFC 6298, 2.2: SRTT = R, RTTVAR = R/2, RTO = SRTT + 4 RTTVAR
        ((0.1,), 0.1 + max(4 * 0.05, SPARE_S)),
        ((0.2,), 0.2 + 4 * 0.1),
        # 2.3: RTTVAR = 3/4 * 0.1 + 1/4 * 0.2, SRTT = 7/8 * 0.2 + 1/8 * 0.4
        ((0.2, 0.4), 0.225 + 4 * 0.125),
        ((0.005,) * 100, 0.005 + SPARE_S),
        # not the 1.02 s of the variation: the slowest of late and the spare
        ((0.005, 0.9), 0.9 + SPARE_S),
        ((0.9, *[0.005] * 140), 0.9 * 0.995**140 + SPARE_S),
        ((5.0,), 2.0),
    ],
)
def test_the_time_out_is_that_of_rfc_6298_within_its_bounds(took_s: tuple[float, ...], timeout_s: float) -> None:
    assert waits(LinkSettings(), *took_s) == pytest.approx(timeout_s)


@each_row(("timeout_s", "most_s"), [(0.1, 0.4), (0.5, 2.0), (1.0, 2.0), (3.0, 3.0)])
def test_however_slow_answers_are_the_time_out_stays_below_four_times_what_the_map_says_and_two_seconds(
    timeout_s: float, most_s: float
) -> None:
    settings = LinkSettings(timeout_s=timeout_s)
    assert waits(settings, 60.0) == most_s
    latency = settings.new_latency()
    for _ in range(20):
        latency.add_timeout()
    assert latency.timeout_s == most_s


def test_a_bound_that_is_said_is_kept_and_cannot_be_below_the_time_out() -> None:
    assert waits(LinkSettings(timeout_max_s=0.6), 5.0) == 0.6
    with pytest.raises(ValueError, match="timeout_max_s"):
        LinkSettings(timeout_max_s=0.4)


def test_without_transaction_ids_it_never_waits_less_than_the_map_says() -> None:
    assert waits(LinkSettings(tid_echo=False), *[0.001] * 100) == pytest.approx(0.501)


def test_a_short_time_out_of_the_map_is_not_stretched_by_the_spare() -> None:
    assert waits(LinkSettings(timeout_s=0.1), *[0.0] * 10) == pytest.approx(0.1)


@virtual
async def test_a_quick_controller_that_falls_silent_is_waited_for_less_than_at_the_start() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link:
        for _ in range(30):
            await link.read(READ)
        device.fail_next(silence(), times=2)
        began = now()
        with pytest.raises(AnswerTimeout, match=r"no answer within 0\.27 s"):
            await link.read(READ)
        assert now() - began == pytest.approx(0.27, abs=0.005)
        # backed off: the second is waited for twice as long
        with pytest.raises(AnswerTimeout):
            await link.read(READ)
        assert now() - began == pytest.approx(3 * 0.27, abs=0.02)
        assert link.state is LinkState.DOWN


@virtual
async def test_an_answer_ends_the_backing_off() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link:
        for _ in range(30):
            await link.read(READ)
        for fault in (silence(), late(0.0), silence()):
            device.fail_next(fault)
        for _ in range(2):
            await outcome(link.read(READ))
        began = now()
        await outcome(link.read(READ))
        assert now() - began == pytest.approx(0.27, abs=0.01)


@pytest.mark.parametrize("tid_echo", [True, False])
@pytest.mark.parametrize("delay_s", [0.6, 0.9, 1.2, 1.8])
@virtual
async def test_a_gateway_slower_than_its_map_says_is_waited_for_instead_of_being_recycled_for_ever(
    delay_s: float, tid_echo: bool
) -> None:
    device = MemoryDevice(delay_s=delay_s)
    good = 0
    async with linked(device, LinkSettings(tid_echo=tid_echo)) as link:
        while now() < 60:
            try:
                await link.wait_up()
                await link.read(READ)
                good += 1
            except AnswerTimeout:
                await elapse(0.2)
        epoch, recycles = link.epoch, link.stats.recycles
        assert recycles <= 2
        assert good > 0.8 * (60 - 6) / delay_s
        for _ in range(20):
            await link.read(READ)
        assert (link.epoch, link.stats.recycles) == (epoch, recycles)


@virtual
async def test_a_late_answer_is_a_measurement_too_and_an_answer_given_twice_is_none() -> None:
    device = MemoryDevice()
    device.fail_next(late(0.7))
    async with linked(device) as link:
        assert isinstance(await outcome(link.read(READ)), AnswerTimeout)
        await elapse(0.3)
        assert link.stats.round_trip_s == pytest.approx(0.7)
        before = link.stats.round_trip_s
        device.send_unrequested(frames.answer(READ, 1, b"\x00\x00"))
        assert link.stats.round_trip_s == before
        assert link.stats.late == 2


@virtual
async def test_what_was_measured_outlives_the_connection() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link:
        for _ in range(30):
            await link.read(READ)
        device.disconnect()
        await link.wait_up()
        device.fail_next(silence())
        began = now()
        await outcome(link.read(READ))
        assert now() - began == pytest.approx(0.27, abs=0.01)


@virtual
async def test_a_time_out_that_shrinks_while_an_older_timer_runs_is_still_kept() -> None:
    device = MemoryDevice()
    async with linked(device, LinkSettings(timeout_s=2.0)) as link:
        await link.read(READ)  # its timer stands at 2 s
        device.fail_next(silence())
        began = now()
        await outcome(link.read(READ))
        assert now() - began == pytest.approx(SPARE_S)


# -- in doubt


async def in_doubt(link: Link, device: MemoryDevice) -> None:
    device.fail_next(silence())
    assert isinstance(await outcome(link.read(READ)), AnswerTimeout)


@virtual
async def test_after_a_time_out_nothing_is_pressed_and_the_reason_says_so() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        assert not link.in_doubt
        await in_doubt(link, device)
        assert (link.state, link.in_doubt) == (LinkState.UP, True)
        assert link.reason == "the controller did not answer the last request"
        with pytest.raises(PressRefused, match="the controller did not answer the last request") as caught:
            await link.write(PRESS, allowed)
        assert caught.value.sent is Delivery.NO
        assert device.writes == []


@pytest.mark.parametrize("answer", [late(0.0), exception(2)])
@virtual
async def test_the_first_answer_ends_the_doubt(answer: Fault) -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        await in_doubt(link, device)
        device.fail_next(answer)
        await outcome(link.read(READ))
        assert (link.in_doubt, link.reason) == (False, "")
        await link.write(PRESS, allowed)
        assert device.writes == [PRESS]


@virtual
async def test_a_release_leaves_in_doubt_too() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        await in_doubt(link, device)
        await link.write(RELEASE)
        assert device.writes == [RELEASE]


@virtual
async def test_a_press_that_waits_behind_the_request_that_is_not_answered_does_not_leave() -> None:
    device = MemoryDevice()
    device.fail_next(silence())
    async with linked(device) as link, asyncio.TaskGroup() as group:
        group.create_task(outcome(link.read(READ)))
        await elapse(0.1)
        press = group.create_task(outcome(link.write(PRESS, allowed)))
        release = group.create_task(outcome(link.write(RELEASE)))
    assert isinstance(press.result(), PressRefused)
    assert release.result() is None
    assert device.writes == [RELEASE]


@virtual
async def test_a_late_answer_to_a_press_never_vouches_for_a_later_one() -> None:
    device = MemoryDevice()
    device.fail_next(late(0.6), on=lambda request: request.is_write)
    device.fail_next(silence(), on=lambda request: request.is_write)
    async with linked(device) as link:
        assert isinstance(await outcome(link.write(PRESS, allowed)), AnswerTimeout)
        await link.read(READ)
        # the same bytes again: only the transaction id tells their answers apart
        second = await outcome(link.write(PRESS, allowed))
        assert isinstance(second, AnswerTimeout)
        assert link.stats.late == 1


# -- writes


@virtual
async def test_a_write_is_never_waited_for_less_than_the_map_says_however_quick_reads_are() -> None:
    device = MemoryDevice(delay_s=0.005)
    device.fail_next(late(0.4), times=100, on=lambda request: request.is_write)
    async with linked(device) as link:
        for _ in range(5):
            for _ in range(50):
                await link.read(READ)
            await link.write(PRESS, allowed)
        assert link.stats.timeouts == 0
        device.fall_silent(10)
        began = now()
        assert isinstance(await outcome(link.write(RELEASE)), AnswerTimeout)
        assert now() - began >= 0.5 - 0.001


@virtual
async def test_a_read_behind_a_write_is_still_waited_for_as_long_as_reads_take() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link:
        for _ in range(30):
            await link.read(READ)
        await link.write(RELEASE)
        device.fall_silent(10)
        began = now()
        assert isinstance(await outcome(link.read(READ)), AnswerTimeout)
        assert now() - began == pytest.approx(0.27, abs=0.005)


@pytest.mark.parametrize("reads", [2, 3, 4, 6])
@virtual
async def test_of_a_poll_of_several_reads_the_slow_one_is_measured_too(reads: int) -> None:
    device = MemoryDevice()
    device.fail_next(late(0.4), times=10**6, on=lambda request: request.address == 7)
    async with linked(device) as link:
        for _ in range(100):
            for place in range(reads):
                await outcome(link.read(frames.read(Table.HOLDING, 7 if place == 0 else place)))
        assert link.stats.timeouts <= 3


@pytest.mark.parametrize("one_in", [5, 20, 200])
@virtual
async def test_a_controller_with_a_slow_cycle_now_and_then_misses_next_to_none_of_them(one_in: int) -> None:
    device, chance = MemoryDevice(), random.Random(one_in)
    slow_now_and_then = Fault(lambda _, answer: ((0.45 if chance.random() < 1 / one_in else 0.005, answer),))
    device.fail_next(slow_now_and_then, times=10**6)
    async with linked(device) as link:
        for _ in range(5000):
            await outcome(link.read(READ))
            await elapse(0.05)
        assert link.stats.timeouts <= 8
