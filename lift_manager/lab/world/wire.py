"""An in-memory wire with faults."""

from __future__ import annotations

import asyncio

from drivers.errors import ConnectProblem
from drivers.modbus.memory import MemoryWire
from lift_manager.lab.world.device import MemoryController
from simulator.wire_faults import ConnectOutcome, WireFaults, faulty


class FaultyWire(MemoryWire):
    """The wire to one simulated controller. A controller that is off the network accepts no connection."""

    def __init__(self, controller: MemoryController, faults: WireFaults, *, peer: str) -> None:
        self._controller = controller
        self._far = faulty(controller.answer, faults, asyncio.get_running_loop().time)
        super().__init__(self._far, admit=self._admitted, peer=peer)

    def close(self) -> None:
        super().close()
        self._far.close()
        if self in self._controller.wires:
            self._controller.wires.remove(self)

    def _admitted(self) -> ConnectProblem | None:
        if not self._controller.on_network:
            return ConnectProblem.TIMED_OUT
        if self._controller.keeps_slot or self._far.admit() is ConnectOutcome.REFUSED:
            return ConnectProblem.REFUSED
        self._controller.wires.append(self)
        return None
