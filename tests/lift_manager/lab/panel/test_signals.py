"""A person at the panel can make each signal of the shipped maps so, and not so, but for those that the page lists."""

import re
from collections.abc import Iterator

from lift_manager.lab.bench.controls import Button, InputChanges
from lift_manager.lab.panel.lift import PanelLift
from register_maps.schema import Kind
from simulator.modes import Key
from tests.lift_manager.lab.panel.paneled import paneled
from tests.support.programs import ROOT
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual

PAGE = ROOT / "docs" / "how-to" / "the-panel.md"
MAPS = sorted(path.stem for path in (ROOT / "register_maps" / "maps").glob("*.yaml"))
LOOKS, LOOK_S = 60, 0.5
"""Half a minute: a car that is called travels past some floors, and stands open."""


def changes(lift: PanelLift) -> Iterator[InputChanges]:
    """Everything that a person can hold or turn, one after the other."""
    for door in ("obstruction", "hold_door"):
        yield from (InputChanges.model_validate({door: [side]}) for side in lift.state().sides)
    for switch in ("overload", "fire", "emergency", "fault", "robot_mode_request"):
        yield InputChanges.model_validate({switch: True})
    yield InputChanges(robots_allowed=False)
    yield from (InputChanges(key=key) for key in Key)


async def observed(lift: PanelLift) -> dict[str, set[str | None]]:
    """Return the values of each signal while a person uses one control after the other."""
    found: dict[str, set[str | None]] = {}

    async def look(times: int) -> None:
        for _ in range(times):
            for register in lift.state().registers:
                if not register.is_command:
                    found.setdefault(register.name, set()).add(register.value)
            await elapse(LOOK_S)

    await look(1)
    for floor in (lift.floors[-1], lift.floors[0]):
        lift.controls.press(Button.CAR, floor)
        await look(LOOKS)
    for change in changes(lift):
        lift.controls.set_inputs(change)
        await look(4)
        lift.reset()
        await look(4)
    return found


def out_of_reach(name: str) -> set[str]:
    """Return the signals of a map that nobody at the panel can make so and not so."""
    found = run_virtual(lambda: observed(paneled(name)))
    flags = {signal for signal, codec in compiled(name).signals.items() if codec.kind is Kind.FLAG}
    return {
        signal
        for signal, values in found.items()
        if not values >= ({"yes", "no"} if signal in flags else set()) or len(values) < 2
    }


def test_the_page_lists_the_signals_that_nobody_can_make_so_at_the_panel() -> None:
    section = PAGE.read_text("utf-8").partition("## What it cannot do")[2]
    listed = {
        name for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE) for name in re.findall(r"`([a-z_.]+)`", row)
    }
    assert set().union(*map(out_of_reach, MAPS)) == listed
