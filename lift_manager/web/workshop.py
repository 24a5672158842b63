"""The workshop API: what clients of roscon_lift_adapter expect, byte for byte.

A number equal to 0 or 2 is taken for `door_state` (JSON has one kind of number, so 2.0 is 2); a string never is.
"""

from __future__ import annotations

from collections.abc import Mapping

from fastapi import APIRouter, Request
from starlette.responses import Response

from lift_manager.core.facade import LiftFacade
from lift_manager.domain.asking import Ask
from lift_manager.domain.state import Holder, LiftState, Quality, RobotDoor
from lift_manager.web import workshop_docs as docs
from lift_manager.web.access import LIFT_NAME, caller, turned_away
from lift_manager.web.answers import granted, succeeded
from lift_manager.web.body import decode_object, read_body, shown
from lift_manager.web.errors import RequestError
from lift_manager.web.origin import from_another_site
from lift_manager.web.query import TOO_LONG, read_query
from register_maps.words import Motion

WORKSHOP = Holder(face="workshop", name="workshop")
"""The API has no caller identity: all callers without a key are this one holder."""

# The numbers of rmf_lift_msgs/msg/LiftState
DOOR_STATE = {RobotDoor.CLOSED: 0, RobotDoor.MOVING: 1, RobotDoor.OPEN: 2}
MOTION_STATE = {Motion.STOPPED: 0, Motion.UP: 1, Motion.DOWN: 2, Motion.MOVING: 3, Motion.UNKNOWN: 3}

# rmf_lift_msgs/msg/LiftRequest has no 1: a caller cannot ask for a moving door
DOOR_CLOSED = 0
DOOR_OPEN = 2

NAME_LIMIT = 200


def workshop_router(facade: LiftFacade) -> APIRouter:
    """The three routes, answering from the facade's memory."""
    names = facade.lift_names()
    router = APIRouter(prefix="/open-rmf/demo-lift", tags=[docs.TAG])

    async def lift_names() -> Response:
        return succeeded({"lift_names": facade.lift_names()})

    async def lift_state(request: Request) -> Response:
        return _state_answer(_named_lift(facade, request))

    async def lift_request(request: Request) -> Response:
        return _request_answer(facade, request, await read_body(request))

    router.add_api_route("/lift_names", lift_names, methods=["GET"], **docs.lift_names(names))
    router.add_api_route("/lift_state", lift_state, methods=["GET"], **docs.lift_state(names))
    router.add_api_route("/lift_request", lift_request, methods=["POST"], **docs.lift_request(names))
    return router


def _named_lift(facade: LiftFacade, request: Request) -> LiftState:
    lifts = ", ".join(facade.lift_names())
    query = read_query(request.scope["query_string"])
    if query.too_long:
        raise RequestError("malformed", f"{TOO_LONG}; lift_name must be one of: {lifts}")
    names = query.all(LIFT_NAME)
    if not names:
        raise RequestError("malformed", f"lift_name is missing; it must be one of: {lifts}")
    if len(names) > 1:
        raise RequestError("malformed", f"lift_name is given {len(names)} times; give it once, as one of: {lifts}")
    state = facade.state(names[0])
    if state is None:
        raise RequestError("unknown_lift", f"unknown lift {shown(names[0])}; lift_name must be one of: {lifts}")
    return state


def _state_answer(state: LiftState) -> Response:
    if state.quality is Quality.OFFLINE:
        age = "no reading yet" if state.age_s is None else f"last reading {state.age_s:.1f} s ago"
        raise RequestError(
            "offline", f"lift {shown(state.lift)} is offline, {age}: {state.reason or 'no reason known'}"
        )
    return succeeded(state_data(state))


def state_data(state: LiftState) -> dict[str, object]:
    """Return what a live lift looks like to clients of the workshop."""
    return {
        "available_floors": state.floors,
        "current_floor": state.floor or "",
        "destination_floor": state.destination or "",
        "door_state": DOOR_STATE[state.robot_door],
        "motion_state": MOTION_STATE[state.motion],
    }


def _request_answer(facade: LiftFacade, request: Request, body: bytes) -> Response:
    try:
        state = _named_lift(facade, request)
    except RequestError:
        names = read_query(request.scope["query_string"]).all(LIFT_NAME)
        facade.turned_away(turned_away(request, "unknown_lift", "it names no lift of this site", "".join(names[:1])))
        raise
    if from_another_site(request):
        facade.turned_away(turned_away(request, "another_site", "a web page of another site asked", state.lift))
        raise RequestError(
            "another_site", "a web page of another site asked; only programs and this manager's own pages may"
        )
    granted(facade.request(_ask(state, _holder(request), body)))
    return succeeded({})


def _holder(request: Request) -> Holder:
    key = caller(request)
    return WORKSHOP if key is None else Holder(WORKSHOP.face, key.name)


def _ask(state: LiftState, holder: Holder, body: bytes) -> Ask:
    floors = ", ".join(state.floors)
    try:
        wish = decode_object(body)
    except RequestError as error:
        raise RequestError(
            "malformed", f'{error.message}; expected {{"floor": one of {floors}, "door_state": 0 or 2}}'
        ) from error
    return Ask(state.lift, holder, _floor(wish, floors), _hold_door(wish))


def _floor(wish: Mapping[str, object], floors: str) -> str:
    if "floor" not in wish:
        raise RequestError("malformed", f"floor is missing; it must be one of: {floors}")
    floor = wish["floor"]
    if not isinstance(floor, str) or len(floor) > NAME_LIMIT or not _is_text(floor):
        raise RequestError("malformed", f"floor must be one of: {floors}; not {shown(floor)}")
    return floor


def _is_text(value: str) -> bool:
    """Whether it can be written down: JSON can spell halves of characters that no journal or log could store."""
    return not any("\ud800" <= char <= "\udfff" for char in value)


def _hold_door(wish: Mapping[str, object]) -> bool:
    allowed = f"{DOOR_CLOSED} (no hold; for the current floor a release) or {DOOR_OPEN} (open and hold)"
    if "door_state" not in wish:
        raise RequestError("malformed", f"door_state is missing; it must be {allowed}")
    wanted = wish["door_state"]
    # True == 1 in Python, and a client that sends a boolean means something else
    if isinstance(wanted, bool) or not isinstance(wanted, int | float) or wanted not in {DOOR_CLOSED, DOOR_OPEN}:
        raise RequestError("malformed", f"door_state must be {allowed}, not {shown(wanted)}")
    return wanted == DOOR_OPEN
