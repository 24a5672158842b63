"""Virtual time for tests; see `lift_manager.lab.virtual_time`."""

from lift_manager.lab.virtual_time import (
    DeadlockError,
    LeftoverTaskError,
    TimeLimitError,
    UnhandledError,
    VirtualTimeError,
    VirtualTimeLoop,
    elapse,
    run_virtual,
)

__all__ = [
    "DeadlockError",
    "LeftoverTaskError",
    "TimeLimitError",
    "UnhandledError",
    "VirtualTimeError",
    "VirtualTimeLoop",
    "elapse",
    "run_virtual",
]
