"""The configuration of one lift for tests that join a driver and an actor by hand."""

from collections.abc import Iterable

from drivers.modbus.lift import ModbusLift
from lift_manager.lift.config import LiftConfig
from register_maps.words import Side


def front_door_config(
    driver: ModbusLift, floors: Iterable[str], *, poll_s: float, control: bool = True, name: str = "lift"
) -> LiftConfig:
    """Return that of a lift with a front door at each floor."""
    names = tuple(floors)
    return LiftConfig(
        name=name,
        source=driver.source,
        floors=names,
        doors_at=dict.fromkeys(names, (Side.FRONT,)),
        control=control,
        capabilities=driver.capabilities,
        poll_s=poll_s,
    )
