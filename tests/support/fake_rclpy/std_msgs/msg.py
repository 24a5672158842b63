from collections.abc import Mapping
from typing import Any, ClassVar

from ros_messages import Message


class Bool(Message):
    FIELDS: ClassVar[Mapping[str, Any]] = {"data": "bool"}
    data: bool
