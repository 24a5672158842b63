"""Which commands end by what the lift says, whoever asked for them. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from drivers.model import LiftValues
from register_maps.codec import CommandCodec
from register_maps.words import Door, Side


def ended(commands: Mapping[str, CommandCodec], values: LiftValues) -> Iterator[str]:
    """Yield the close commands to let go of: the door is shut, opens again, or has somebody or too much load in its way."""
    for side in Side:
        name = f"close_door.{side}"
        if name not in commands:
            continue
        door = values.doors.get(side)
        in_the_way = any(values.flags.get(flag, False) for flag in (f"obstruction.{side}", "overload", "nudging"))
        if in_the_way or door in (Door.CLOSED, Door.OPENING):
            yield name
