"""The controller in memory answers as a controller does."""

import pytest

from drivers.errors import ControllerException, UnitOffline
from drivers.modbus.memory import MemoryDevice, exception
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, virtual


@virtual
async def test_what_is_written_is_read_back() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        await link.write(frames.write_coil(1, True))
        await link.write(frames.write_coils(3, [True, False, True]))
        await link.write(frames.write_register(1, 0x1234))
        await link.write(frames.write_registers(3, [1, 0xFFFF]))
        assert await link.read(frames.read(Table.COIL, 0, 8)) == b"\x2a"
        assert await link.read(frames.read(Table.HOLDING, 0, 5)) == bytes.fromhex("0000 1234 0000 0001 FFFF")
        assert await link.read(frames.read(Table.DISCRETE, 0, 9)) == b"\x00\x00"
        assert await link.read(frames.read(Table.INPUT, 0, 1)) == b"\x00\x00"
    assert len(device.writes) == 4
    assert device.values[Table.COIL] == {1: 1, 3: 1, 4: 0, 5: 1}


@virtual
async def test_what_is_not_served_is_refused_with_exception_2_and_not_carried_out() -> None:
    device = MemoryDevice(served={Table.HOLDING: [(10, 19)]})
    async with linked(device) as link:
        await link.read(frames.read(Table.HOLDING, 10, 10))
        for asking in (
            link.read(frames.read(Table.HOLDING, 10, 11)),
            link.read(frames.read(Table.INPUT, 10, 1)),
            link.write(frames.write_register(9, 1)),
        ):
            with pytest.raises(ControllerException) as caught:
                await asking
            assert caught.value.code == 2
    assert device.writes == []


@virtual
async def test_another_unit_cannot_be_reached() -> None:
    async with linked(MemoryDevice(unit=5)) as link:
        await link.read(frames.read(Table.HOLDING, 0, unit=5))
        with pytest.raises(UnitOffline):
            await link.read(frames.read(Table.HOLDING, 0, unit=1))


@virtual
async def test_a_fault_can_be_kept_for_the_requests_it_is_meant_for() -> None:
    device = MemoryDevice()
    device.fail_next(exception(4), on=lambda request: request.is_write)
    async with linked(device) as link:
        await link.read(frames.read(Table.HOLDING, 0))
        with pytest.raises(ControllerException):
            await link.write(frames.write_register(0, 1))
        await link.write(frames.write_register(0, 2))
    assert [request.values for request in device.writes] == [(2,)]


@virtual
async def test_a_request_the_specification_does_not_allow_gets_its_exception() -> None:
    device = MemoryDevice()
    assert device.answer(bytes.fromhex("0001 0000 0005 01 2B 0E 01 00")) == [
        (0.0, bytes.fromhex("0001 0000 0003 01 AB 01"))
    ]
    assert device.answer(bytes.fromhex("0001 0000 0006 01 03 0000 007E")) == [
        (0.0, bytes.fromhex("0001 0000 0003 01 83 03"))
    ]
    assert device.received == []
