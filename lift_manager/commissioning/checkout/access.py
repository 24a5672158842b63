"""How a test reaches its lift: through a manager of its own, or by reading alone while no manager runs."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from typing import Protocol

from lift_manager.client.client import LiftManagerClient
from lift_manager.commissioning.checkout.registers import Registers


class HoldFailed(Exception):
    """The second manager does not hold the door; the text says why."""


class Holder(Protocol):
    """A second manager, in a process of its own, that holds the door."""

    async def kill(self) -> None:
        """End it as `kill -9` does: it releases nothing."""
        ...


class Access(Protocol):
    """One controller serves one client: only one of these contexts is open at a time."""

    def manager(self) -> AbstractAsyncContextManager[LiftManagerClient]:
        """Run a manager that may command the lift; it releases everything at the end of the context."""
        ...

    def registers(self) -> AbstractAsyncContextManager[Registers]:
        """Read the registers of the lift; nothing is written. Raises ConnectFailed."""
        ...

    def holder(self, floor: str) -> AbstractAsyncContextManager[Holder]:
        """Start a second manager that takes the car to a floor and holds its door. Raises HoldFailed unless it holds it.

        At the end of the context it is ended in order, if it was not killed.
        """
        ...
