"""The generated program for two managers obeys the one of the highest epoch, over a loss of power too."""

from __future__ import annotations

import pytest

from register_maps.arbitration import Claim
from tests.lift_manager.commissioning.plc.rig import CLUSTER, CYCLE_S, Layout, Rig

each_map = pytest.mark.parametrize("layout", CLUSTER, ids=lambda layout: layout.map_name)
RETAINED = ("ObeyedEpochHigh", "ObeyedEpochLow", "ObeyedOwner")


def write(rig: Rig, claim: Claim, *pressed: int) -> None:
    """Write the whole block as the manager does, with these cells pressed, and run one cycle."""
    layout, arbitration = rig.layout, rig.codec.arbitration
    assert arbitration is not None
    block = {cell: layout.on if cell in pressed else layout.rest for cell in layout.commands}
    block |= {point.address: bool(raw) if layout.in_bits else raw for point, raw in arbitration.encode(claim).items()}
    rig.machine.values[layout.array].update(block)
    rig.run(CYCLE_S)


def obeyed(rig: Rig) -> tuple[object, object]:
    return rig.says("epoch"), rig.says("owner")


def held(layout: Layout, claim: Claim) -> Rig:
    """A lift whose door is held in robot mode for this claim."""
    rig = Rig(layout)
    write(rig, claim, layout.mode, layout.hold)
    assert set(rig.outputs_on()) == {"RobotMode", "DoorOpenButton"}
    return rig


@each_map
@pytest.mark.parametrize("late", [Claim(4, 1), Claim(5, 1), Claim(0, 2), Claim(0, 0)])
def test_a_write_of_an_earlier_epoch_or_of_another_machine_in_the_same_one_changes_nothing(
    layout: Layout, late: Claim
) -> None:
    rig = held(layout, Claim(5, 2))
    before = rig.cells()
    write(rig, late, layout.calls["L2"][0])
    assert set(rig.outputs_on()) == {"RobotMode", "DoorOpenButton"}
    assert rig.cells() == before
    assert obeyed(rig) == (5, 2)
    rig.run(1.0)
    assert rig.pressed.keys() == {"RobotMode", "DoorOpenButton"}


@each_map
def test_it_does_not_renew_the_watchdog_either(layout: Layout) -> None:
    rig = held(layout, Claim(5, 2))
    for _ in range(9):
        write(rig, Claim(4, 1), layout.mode, layout.hold)
        rig.run(1.0)
    assert rig.outputs_on() == []


@each_map
def test_a_single_cell_that_somebody_writes_is_put_back(layout: Layout) -> None:
    rig = held(layout, Claim(5, 2))
    rig.machine.values[layout.array][layout.hold] = layout.rest
    rig.run(CYCLE_S)
    assert rig.on("DoorOpenButton")


@each_map
@pytest.mark.parametrize(("before", "after"), [(5, 6), (0xFFFF, 0x10000), (0x1FFFF, 0x20000), (1, 0xFFFFFFFF)])
def test_a_later_epoch_counts_at_once_and_takes_over_without_a_gap(layout: Layout, before: int, after: int) -> None:
    rig = held(layout, Claim(before, 1))
    write(rig, Claim(after, 2), layout.mode, layout.hold)
    assert obeyed(rig) == (after, 2)
    write(rig, Claim(before, 1))
    assert rig.released == {}
    write(rig, Claim(after, 2), layout.mode)
    assert rig.outputs_on() == ["RobotMode"]


@each_map
def test_what_the_later_one_does_not_want_falls_with_its_first_write(layout: Layout) -> None:
    rig = held(layout, Claim(5, 1))
    write(rig, Claim(6, 2), layout.mode)
    assert rig.outputs_on() == ["RobotMode"]


@each_map
def test_a_loss_of_power_makes_no_earlier_epoch_count(layout: Layout) -> None:
    before = held(layout, Claim(0x30002, 2))
    rig = Rig(layout)
    for word in RETAINED:
        rig.machine.values[word] = before.machine.values[word]
    write(rig, Claim(0x30001, 1), layout.mode, layout.hold)
    assert rig.outputs_on() == []
    assert obeyed(rig) == (0x30002, 2)
    write(rig, Claim(0x30002, 2), layout.mode)
    assert rig.outputs_on() == ["RobotMode"]


@each_map
def test_owner_and_epoch_are_taken_out_so_that_each_write_is_seen(layout: Layout) -> None:
    rig = held(layout, Claim(5, 2))
    arbitration = rig.codec.arbitration
    assert arbitration is not None
    array = rig.machine.values[layout.array]
    assert not any(array[address] for _, _, address in arbitration.cells)
