"""The REST interface of the panel. Nothing here goes over Modbus."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path
from fastapi.exceptions import HTTPException
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request

from drivers.model import FloorName
from lift_manager.lab.bench.controls import Button, InputChanges
from lift_manager.lab.panel.faults import FaultKind, FaultWithValues, fault_kinds, read_fault
from lift_manager.lab.panel.lift import PanelLift, SimulatedLift

_UNKNOWN: dict[int | str, dict[str, Any]] = {404: {"description": "no such lift"}}
_REFUSED: dict[int | str, dict[str, Any]] = {**_UNKNOWN, 400: {"description": "it cannot be done; `detail` is why"}}

router = APIRouter()


class Overview(BaseModel):
    """What the panel works."""

    model_config = ConfigDict(frozen=True)

    lifts: tuple[str, ...]
    manager: str | None = Field(description="address of the manager that runs beside it; null if there is none")


class Press(BaseModel):
    """A button that is pressed for a moment."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    button: Button = Field(description="`landing`: at the door of the floor; `car`: in the car")
    floor: FloorName


async def _lift(request: Request, name: Annotated[str, Path(description="name of the lift")]) -> PanelLift:
    lifts: dict[str, PanelLift] = request.app.state.lifts
    if name not in lifts:
        raise HTTPException(HTTPStatus.NOT_FOUND, f"no lift {name!r}; there is {', '.join(lifts)}")
    return lifts[name]


Lift = Annotated[PanelLift, Depends(_lift)]


@router.get("/lifts", tags=["lifts"])
async def list_lifts(request: Request) -> Overview:
    """List the lifts."""
    return Overview(lifts=tuple(request.app.state.lifts), manager=request.app.state.manager)


@router.get("/lifts/{name}", tags=["lifts"], responses=_UNKNOWN)
async def read_lift(lift: Lift) -> SimulatedLift:
    """Return a lift with its inputs, faults and registers, as of now."""
    return lift.state()


@router.post("/lifts/{name}/press", tags=["people"], responses=_REFUSED)
async def press(lift: Lift, given: Press) -> SimulatedLift:
    """Press a button for three scans of the controller, and release it."""
    lift.controls.press(given.button, given.floor)
    return lift.state()


@router.post("/lifts/{name}/inputs", tags=["people"], responses=_REFUSED)
async def set_inputs(lift: Lift, given: InputChanges) -> SimulatedLift:
    """Change what people press, hold and turn; what is not given stays."""
    lift.controls.set_inputs(given)
    return lift.state()


@router.get("/faults", tags=["faults"])
async def list_faults() -> list[FaultKind]:
    """List every kind of fault with its values."""
    return fault_kinds()


@router.post("/lifts/{name}/faults/begin", tags=["faults"], responses=_REFUSED)
async def begin(lift: Lift, given: FaultWithValues) -> SimulatedLift:
    """Begin a fault; one that is present stays as it is."""
    lift.begin(read_fault(given, lift.floors))
    return lift.state()


@router.post("/lifts/{name}/faults/end", tags=["faults"], responses=_REFUSED)
async def end(lift: Lift, given: FaultWithValues) -> SimulatedLift:
    """End a fault, named as it was begun."""
    lift.end(read_fault(given, lift.floors))
    return lift.state()


@router.post("/lifts/{name}/reset", tags=["lifts"], responses=_UNKNOWN)
async def reset(lift: Lift) -> SimulatedLift:
    """End every fault and release everything; the key returns to where it was at the start."""
    lift.reset()
    return lift.state()
