from collections.abc import Mapping
from typing import Any, ClassVar

from ros_messages import Message
from ros_world import world

if world.has("kilted"):

    class EmergencySignal(Message):
        FIELDS: ClassVar[Mapping[str, Any]] = {"fleet_names": "string[]", "is_emergency": "bool"}
        fleet_names: list[str]
        is_emergency: bool
