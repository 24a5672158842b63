"""What presses and releases would write, for every shipped map: planned without a device, and without the right to write."""

import pytest

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice
from drivers.modbus.units import Unit
from drivers.model import Command, CommandKind, CommandStep, OutputState
from lift_manager.commissioning.maps_plan import example_floors
from register_maps.codec import Codec
from register_maps.load import shipped
from register_maps.words import Side
from tests.drivers.linked import virtual
from tests.drivers.rig import HOLD, HOLD_FRONT, SIGNALS
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.written_maps import written_map


def lift_of(codec: Codec, *, control: bool) -> ModbusLift:
    def link(name: str) -> Link:
        return Link(MemoryDevice().wire, LinkSettings(), name=name)

    settings = LiftSettings(name="lift", floors=example_floors(codec), control=control)
    endpoints = {name: Unit(link(name), 1) for name in codec.map.endpoints}
    return ModbusLift(codec, link("plc"), settings, endpoints)


def command_of(name: str, floor: str) -> Command:
    kind, _, side = name.partition(".")
    is_call = kind in (CommandKind.GO_TO, CommandKind.CALL, CommandKind.GO)
    return Command(CommandKind(kind), floor if is_call else None, Side(side) if side else None)


@each_row("map_name", sorted(shipped()))
@virtual
async def test_a_plan_presses_as_the_journal_says_and_ends_at_rest(map_name: str) -> None:
    codec = compiled(map_name)
    lift, watched = lift_of(codec, control=True), lift_of(codec, control=False)
    for info in lift.commands():
        if info.action not in ("pulse", "hold"):
            continue
        command = command_of(info.name, next(iter(example_floors(codec))))
        plan = lift.plan([CommandStep(command)])
        assert plan == watched.plan([CommandStep(command)])
        assert tuple(write.frame for write in plan if write.what == "press") == lift.frames(command)
        assert any(write.what == "release" for write in plan) is not info.ends_itself
        assert info.state is OutputState.AT_REST
    assert {info.state for info in watched.commands()} <= {None}


@virtual
async def test_an_edge_an_exclusion_and_a_shared_word_are_planned_as_they_are_written() -> None:
    codec = written_map(
        f"{SIGNALS}commands:\n"
        f'  hold_door.front: {{at: "coil:8", reset_first_s: 0.5, excludes: [close_door.front], {HOLD}}}\n'
        f'  close_door.front: {{at: "holding:9.2", shared_word: accepted, excludes: [hold_door.front], {HOLD}}}\n'
    )
    close = Command(CommandKind.CLOSE_DOOR, side=Side.FRONT)
    plan = lift_of(codec, control=True).plan([CommandStep(HOLD_FRONT), CommandStep(close)])
    assert [(write.what, write.text, write.is_read_first) for write in plan] == [
        ("reset", "write coil 8 := off, unit 1", False),
        ("press", "write coil 8 := on, unit 1", False),
        ("release", "write coil 8 := off, unit 1", False),
        ("press", "write holding register 9 := 4, unit 1", True),
        ("release", "write holding register 9 := 0, unit 1", True),
    ]


@virtual
async def test_what_the_map_or_the_site_does_not_have_is_no_plan() -> None:
    lift = lift_of(compiled("generic-registers"), control=True)
    with pytest.raises(ValueError, match="has no command robot_left"):
        lift.plan([CommandStep(Command(CommandKind.ROBOT_LEFT))])
    with pytest.raises(ValueError, match="go_to needs a floor of this lift"):
        lift.plan([CommandStep(Command(CommandKind.GO_TO, "L99"))])
