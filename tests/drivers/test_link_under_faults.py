"""Whatever a device does to its answers: no read returns the value of another, and no write is carried out twice."""

import asyncio
import random
from collections import Counter

import pytest

from drivers.errors import Delivery, DriverError
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import Fault, MemoryDevice, edited, exception, hang_up, late, silence, twice
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, virtual
from tests.support.virtual_time import elapse

REGISTERS = 64


def any_fault(chance: random.Random, *, tid_echo: bool) -> Fault:
    delay_s = chance.choice([0.1, 0.49, 0.51, 0.7, 1.2, 3.0])
    faults = [
        late(delay_s),
        silence(executes=chance.random() < 0.5),
        exception(chance.choice([1, 2, 3, 4, 5, 6, 0x0A, 0x0B])),
        hang_up(executes=chance.random() < 0.5),
        edited(lambda answer: answer[:-1]),
        edited(lambda answer: answer[:7] + bytes([answer[7] ^ 1]) + answer[8:]),
        Fault(lambda _, answer: ((0.0, answer[:6]), (delay_s, answer[6:]))),
    ]
    # Without transaction ids an answer given twice cannot be told from the answer to the next question.
    if tid_echo:
        faults += [twice(), twice(delay_s), edited(lambda answer: b"\x00\x00" + answer[2:])]
    return chance.choice(faults)


async def keep_reading(link: Link, chance: random.Random, good: list[int]) -> None:
    while True:
        address = chance.randrange(REGISTERS)
        ask = link.read if chance.random() < 0.8 else link.read_urgent
        try:
            async with asyncio.timeout(chance.choice([0.05, 0.3, 10.0])):
                payload = await ask(frames.read(Table.INPUT, address))
        except TimeoutError:
            continue
        except DriverError:
            await elapse(0.05)
            continue
        assert int.from_bytes(payload, "big") == address
        good.append(address)
        await elapse(chance.choice([0.0, 0.01]))


async def keep_writing(link: Link, numbers: range, told: dict[int, Delivery]) -> None:
    for number in numbers:
        try:
            await link.write(frames.write_register(number, number))
        except DriverError as error:
            told[number] = error.sent
        else:
            told[number] = Delivery.YES
        await elapse(0.1)


@pytest.mark.parametrize("tid_echo", [True, False])
@pytest.mark.parametrize("seed", range(6))
@virtual
async def test_no_value_is_mixed_up_and_no_write_is_repeated(seed: int, tid_echo: bool) -> None:
    chance = random.Random(seed)
    device = MemoryDevice(delay_s=0.005)
    device.values[Table.INPUT] = {address: address for address in range(REGISTERS)}
    good: list[int] = []
    told: dict[int, Delivery] = {}
    numbers = range(1000, 1200)

    async def misbehave() -> None:
        while True:
            device.fail_next(any_fault(chance, tid_echo=tid_echo))
            await elapse(chance.choice([0.1, 1.0, 2.0]))

    async with linked(device, LinkSettings(tid_echo=tid_echo)) as link:
        others = [asyncio.create_task(keep_reading(link, chance, good)) for _ in range(4)]
        others.append(asyncio.create_task(misbehave()))
        await keep_writing(link, numbers, told)
        for task in others:
            task.cancel()
        ends = await asyncio.gather(*others, return_exceptions=True)
        assert {type(end) for end in ends} == {asyncio.CancelledError}
    carried_out = Counter(request.address for request in device.writes)
    heard = Counter(each.request.address for each in device.received if each.request.is_write)
    assert max(heard.values()) == 1
    assert all(told[number] is not Delivery.NO for number in carried_out)
    assert len(good) > 200
    assert link.stats.connects > 3
