"""Which commands end by what the lift says, whoever asked for them. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from drivers.model import LiftValues
from register_maps.codec import CommandCodec
from register_maps.words import Door, Side


def ended(commands: Mapping[str, CommandCodec], values: LiftValues, signals: Collection[str]) -> Iterator[str]:
    """Yield the close commands to let go of: the door is shut, opens again, or has somebody or too much load in its way.

    `signals` are those that the map declares; one of them that cannot be read counts as in the way.
    """
    for side in Side:
        name = f"close_door.{side}"
        if name not in commands:
            continue
        door = values.doors.get(side)
        flags = (f"obstruction.{side}", "overload", "nudging")
        in_the_way = any(flag in signals and values.flags.get(flag, True) for flag in flags)
        if in_the_way or door in (Door.CLOSED, Door.OPENING):
            yield name
