from collections.abc import Mapping
from typing import Any, ClassVar

from ros_messages import Message


class Time(Message):
    FIELDS: ClassVar[Mapping[str, Any]] = {"sec": "int32", "nanosec": "uint32"}
    sec: int
    nanosec: int
