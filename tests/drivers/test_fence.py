"""The fence of the devices of one lift, in time that goes on while the computer is suspended."""

import math

from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice
from drivers.modbus.units import Unit, Units
from tests.drivers.linked import now
from tests.support.virtual_time import elapse, run_virtual


def test_time_in_which_the_computer_was_suspended_counts_for_the_fence() -> None:
    slept_s = [100.0]

    async def check() -> None:
        units = Units(Unit(Link(MemoryDevice().wire, name="plc"), 1), {}, suspended_s=lambda: slept_s[-1])
        shown = [units.is_fenced]
        units.fence(now() + 2.0)
        await elapse(1.0)
        shown.append(units.is_fenced)
        slept_s.append(101.5)
        shown.append(units.is_fenced)
        units.fence(now() + 2.0)
        shown.append(units.is_fenced)
        await elapse(2.0)
        shown.append(units.is_fenced)
        units.fence(math.inf)
        shown.append(units.is_fenced)
        assert shown == [False, False, True, False, True, False]

    run_virtual(check)
