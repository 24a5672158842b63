"""The implementation of the pytest fixtures `lift_simulator`, `modbus_faults` and `lift_site`; see docs/reference/pytest-fixtures.md."""

from lift_manager.lab.bench.bench import Bench
from lift_manager.lab.bench.errors import BenchBroken, BenchError, ConditionNotMet
from lift_manager.lab.bench.log import LogEntry
from lift_manager.lab.bench.simulator import LiftSimulator, Write
from lift_manager.lab.bench.site import LiftSite
from lift_manager.lab.bench.wire import ModbusFaults

__all__ = [
    "Bench",
    "BenchBroken",
    "BenchError",
    "ConditionNotMet",
    "LiftSimulator",
    "LiftSite",
    "LogEntry",
    "ModbusFaults",
    "Write",
]
