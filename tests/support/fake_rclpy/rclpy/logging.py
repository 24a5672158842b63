from __future__ import annotations

import sys

from ros_world import world


class RcutilsLogger:
    def __init__(self) -> None:
        self._levels: dict[tuple[str, int], str] = {}

    def debug(self, message: str) -> bool:
        return self._take("debug", message)

    def info(self, message: str) -> bool:
        return self._take("info", message)

    def warning(self, message: str) -> bool:
        return self._take("warning", message)

    def error(self, message: str) -> bool:
        return self._take("error", message)

    def fatal(self, message: str) -> bool:
        return self._take("fatal", message)

    def _take(self, level: str, message: str) -> bool:
        if not isinstance(message, str):
            raise TypeError("a log message is a text")
        caller = sys._getframe(2)  # noqa: SLF001  rclpy knows its callers by their place in the code
        place = (caller.f_code.co_filename, caller.f_lineno)
        if self._levels.setdefault(place, level) != level:
            raise ValueError("Logger severity cannot be changed between calls.")
        world.logged(level, message)
        return True
