"""Every fault of the wire against a read, a press and a release: nothing stale is believed, nothing is pressed twice, everything is let go."""

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from drivers.errors import ConnectProblem, DriverError
from drivers.modbus.link import LinkSettings
from drivers.modbus.memory import (
    Fault,
    MemoryDevice,
    after,
    edited,
    exception,
    hang_up,
    in_pieces,
    late,
    merged,
    reordered,
    silence,
    twice,
)
from drivers.model import Command, CommandKind, Result
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table
from tests.drivers.linked import linked, now, virtual
from tests.drivers.rig import HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, on_rig
from tests.support.rows import each_row
from tests.support.virtual_time import elapse

FOREIGN = frames.answer(frames.read(Table.INPUT, 0), 7777, b"\x12\x34")
MAP = (
    f'{SIGNALS}commands:\n  hold_door.front: {{at: "holding:17", {HOLD}}}\n  go_to: {{at: "holding:16", as: floor, action: pulse,'
    " width_s: 0.5, rest: 0, confirm: {any_of: [effect], within_s: 2}}\n"
)
HEALS_WITHIN_S = 12.0
"""The longest fault here, two time-outs backed off to their bound, and a new connection."""


@dataclass(frozen=True)
class Case:
    """What is done to the next request that matters."""

    arrange: Callable[[MemoryDevice, Callable[[Request], bool]], None]
    ends: bool
    """Whether the connection has to be made anew."""
    needs_ids: bool = False
    """Whether only transaction ids can tell what is stale."""


def once(fault: Fault, *, ends: bool = False, times: int = 1, needs_ids: bool = False) -> Case:
    return Case(lambda device, on: device.fail_next(fault, times=times, on=on), ends, needs_ids)


def with_the_next(make: Callable[[], tuple[Fault, Fault]]) -> Case:
    def arrange(device: MemoryDevice, on: Callable[[Request], bool]) -> None:
        first, second = make()
        device.fail_next(first, on=on)
        device.fail_next(second)

    return Case(arrange, ends=False, needs_ids=True)


def turned_away(device: MemoryDevice, _: object) -> None:
    device.connect_problem = ConnectProblem.REFUSED
    device.disconnect()
    asyncio.get_running_loop().call_later(2.0, setattr, device, "connect_problem", None)


def byte(at: int, change: int) -> Fault:
    return edited(lambda answer: answer[:at] + bytes([answer[at] ^ change]) + answer[at + 1 :])


CASES = {
    "no answer": once(silence()),
    "no answer, and nothing done": once(silence(executes=False)),
    "no answer twice": once(silence(), times=2, ends=True),
    "silent for three seconds": Case(lambda device, _: device.fall_silent(3.0), ends=True),
    "half-open": Case(lambda device, _: device.go_half_open(), ends=True),
    "late": once(late(0.7)),
    "very late": once(late(3.0)),
    "twice at once": once(twice(), needs_ids=True),
    "twice, a moment apart": once(twice(0.13), needs_ids=True),
    "in the wrong order": with_the_next(reordered),
    "two answers in one segment": with_the_next(merged),
    "byte by byte": once(in_pieces(*range(1, 9), every_s=0.01)),
    "torn by the next answer": once(in_pieces(5, every_s=0.7), ends=True),
    "one byte missing": once(edited(lambda answer: answer[:-1]), ends=True),
    "one byte too many": once(edited(lambda answer: answer + b"\x00"), ends=True),
    "another transaction id": once(byte(0, 0x40), ends=True, needs_ids=True),
    "transaction id 0": once(edited(lambda answer: b"\x00\x00" + answer[2:]), ends=True, needs_ids=True),
    "another unit": once(byte(6, 1), ends=True),
    "another function": once(byte(7, 1), ends=True),
    "another count or address": once(byte(8, 2), ends=True),
    "an answer nobody asked for before it": once(after(FOREIGN), ends=True),
    "garbage before it": once(after(b"\xde\xad\xbe\xef\x00\x01\x02\x03"), ends=True),
    "garbage instead": once(edited(lambda _: b"HTTP/1.1 400 Bad Request"), ends=True),
    "hung up": once(hang_up(), ends=True),
    "hung up, and nothing done": once(hang_up(executes=False), ends=True),
    "reset and turned away": Case(turned_away, ends=True),
    **{f"exception {code:02X}": once(exception(code)) for code in (1, 2, 3, 4, 5, 6, 0x0A, 0x0B)},
}
REPEATED = [
    pytest.param(case, tid_echo, id=f"{name}, {'with' if tid_echo else 'without'} ids")
    for name, case in CASES.items()
    for tid_echo in (True, False)
    if tid_echo or not case.needs_ids
]


@each_row(("case", "tid_echo"), REPEATED)
@virtual
async def test_a_read_gets_its_own_answer_or_none_and_the_link_works_afterwards(case: Case, tid_echo: bool) -> None:
    device = MemoryDevice(delay_s=0.005)
    device.values[Table.HOLDING] = {address: 0x4000 + address for address in range(2000)}
    bad: list[DriverError] = []
    async with linked(device, LinkSettings(tid_echo=tid_echo)) as link:

        async def read(address: int) -> bool:
            try:
                payload = await link.read(frames.read(Table.HOLDING, address))
            except DriverError as error:
                bad.append(error)
                return False
            assert int.from_bytes(payload, "big") == 0x4000 + address
            return True

        for address in range(10):
            assert await read(address)
        case.arrange(device, lambda request: request.address >= 10)
        began, address = now(), 10
        while now() - began < HEALS_WITHIN_S:
            await read(address)
            address += 1
            await elapse(0.05)
        assert (link.epoch > 1) == (case.ends or (not tid_echo and link.stats.timeouts > 0))
        assert all([await read(address + more) for more in range(50)])


def presses(made: Rig) -> Counter[int]:
    """How often the controller was asked for each floor."""
    heard = [each.request for each in made.device.received if each.request.is_write and each.request.address == 16]
    return Counter(request.values[0] for request in heard if any(request.values))


def is_press(request: Request) -> bool:
    return request.is_write and request.address == 16 and any(request.values)


def is_release(request: Request) -> bool:
    return request.is_write and request.address == 17 and not any(request.values)


@each_row("case", CASES.values())
def test_a_press_is_carried_out_once_at_the_most_and_let_go(case: Case) -> None:
    async def check(made: Rig) -> None:
        await elapse(2)
        case.arrange(made.device, is_press)
        outcome = await made.lift.press(Command(CommandKind.GO_TO, "L2"), allowed)
        assert outcome.result in (Result.UNCONFIRMED, Result.REJECTED)
        await elapse(HEALS_WITHIN_S)
        assert presses(made)[2] <= 1
        assert made.cells(Table.HOLDING, 16) == [0]
        # and the next one arrives
        made.device.clear_faults()
        press = made.lift.press(Command(CommandKind.GO_TO, "L1"), allowed)
        await elapse(1.0)
        assert presses(made)[1] == 1
        press.cancel()

    on_rig(check, MAP)


@each_row("case", CASES.values())
def test_a_release_is_repeated_until_it_is_confirmed(case: Case) -> None:
    async def check(made: Rig) -> None:
        for _ in range(20):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)
        case.arrange(made.device, is_release)
        async with asyncio.timeout(HEALS_WITHIN_S):
            await made.lift.release_all()
        assert made.cells(Table.HOLDING, 17) == [0]
        seen = [each for each in made.device.received if each.executed and is_release(each.request)]
        looked = made.device.received[-1].at_s
        assert seen
        assert seen[-1].at_s <= looked
        await elapse(HEALS_WITHIN_S)
        for _ in range(20):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)

    on_rig(check, MAP)


@virtual
async def test_a_half_open_connection_swallows_what_is_sent_and_brings_nothing_while_a_new_one_works() -> None:
    device = MemoryDevice()
    heard: list[bytes] = []
    old = device.wire()
    await old.open(heard.append, pytest.fail, timeout_s=1)
    device.go_half_open()
    request = frames.frame(frames.read(Table.HOLDING, 0), 1)
    old.send(request)
    await elapse(60)
    assert (old.is_open, heard, device.received) == (True, [], [])
    new = device.wire()
    await new.open(heard.append, pytest.fail, timeout_s=1)
    new.send(request)
    await elapse(0.1)
    assert len(heard) == 1


@virtual
async def test_a_silent_device_takes_connections_and_hears_nothing_until_its_time_is_over() -> None:
    device = MemoryDevice()
    heard: list[bytes] = []
    device.fall_silent(2.0)
    wire = device.wire()
    await wire.open(heard.append, pytest.fail, timeout_s=1)
    request = frames.frame(frames.read(Table.HOLDING, 0), 1)
    for _ in range(25):
        wire.send(request)
        await elapse(0.1)
    assert len(heard) == len(device.received) == 5


@virtual
async def test_without_transaction_ids_an_answer_given_twice_makes_few_others_stale() -> None:
    device, stale = MemoryDevice(delay_s=0.02), 0
    async with linked(device, LinkSettings(tid_echo=False)) as link:
        for number in range(200):
            if number == 50:
                device.fail_next(twice(0.001))
            device.values[Table.HOLDING][0] = number
            try:
                await link.wait_up()
                stale += await link.read(frames.read(Table.HOLDING, 0)) != number.to_bytes(2, "big")
            except DriverError:
                await elapse(0.1)
    assert stale <= 9
    assert link.stats.desyncs == 1
