"""The judge of the disk finds a hold that is pressed without its row, and nothing else."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from lift_manager.lab.world.disk import SimulatedDisk
from lift_manager.lab.world.lift_under_test import Excuse, SuspectValues
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.press_rows import PressRows
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import RESTART, FaultChange
from lift_manager.lift.journal import Row, RowKind
from simulator.faults import FrozenRegisters
from tests.lift_manager.lab.test_oracle import STANDS_OPEN, judge

HOLD = "hold_door.front"
ON = replace(STANDS_OPEN, given=((HOLD, 1),))
FROZEN = FaultChange("lift", FrozenRegisters(), began=True)
KILLED = FaultChange("manager", RESTART, began=True)
RELEASED = Row(RowKind.WRITE, f"release of {HOLD} was answered", "lift", data={"command": HOLD, "what": "release"})


def found(happens: Sequence[Truth | FaultChange]) -> list[str]:
    """Return what is found when a hold is pressed after its release, and these things have happened, one each second."""
    oracle: Oracle = judge(excuses={"frozen_registers": Excuse(frozenset({SuspectValues.OUTPUT}), None)})
    disk = SimulatedDisk()
    witnesses = (oracle, PressRows(oracle, disk))
    for at, one in enumerate(happens):
        for witness in witnesses:
            if isinstance(one, Truth):
                witness.on_truth(float(at), "lift", one)
            else:
                witness.on_fault(float(at), one)
    for callback in disk.on_recorded:
        callback(RELEASED)
    witnesses[1].on_press(float(len(happens)), "lift", frozenset({HOLD}))
    return [finding.rule for finding in oracle.findings]


def test_a_release_that_frozen_registers_hide_is_unknown_to_a_manager_started_since() -> None:
    assert found([ON, FROZEN, STANDS_OPEN, KILLED]) == []


@pytest.mark.parametrize(
    "happens",
    [
        (ON, STANDS_OPEN, FROZEN, KILLED),
        (ON, FROZEN, STANDS_OPEN),
        (ON, KILLED, FROZEN, STANDS_OPEN),
        (ON, STANDS_OPEN, KILLED),
    ],
    ids=["seen before they froze", "the same manager", "released by the same manager", "not frozen"],
)
def test_a_hold_pressed_again_without_a_row_is_found(happens: Sequence[Truth | FaultChange]) -> None:
    assert found(happens) == ["pressed before its row"]
