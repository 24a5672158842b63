"""The workshop API: what clients of roscon_lift_adapter expect, byte for byte.

A number equal to 0 or 2 is taken for `door_state` (JSON has one kind of number, so 2.0 is 2); a string never is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from fastapi import APIRouter
from starlette.responses import Response

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.site import Site
from lift_manager.web import workshop_docs as docs
from lift_manager.web.authenticator import caller_key, face_refusal
from lift_manager.web.body import decode_object, quoted
from lift_manager.web.callers import FOREIGN_PAGE
from lift_manager.web.direct_routes import WholeRequest
from lift_manager.web.errors import RequestError
from lift_manager.web.origin import is_from_another_site
from lift_manager.web.query import LIMIT_BYTES, TOO_LONG, named_lifts
from lift_manager.web.replies import workshop_success
from register_maps.words import Motion

WORKSHOP = Holder(face="workshop", name="workshop")
"""The API has no caller identity: all callers without a key are this one holder."""

# The numbers of rmf_lift_msgs/msg/LiftState
DOOR_STATE = {RobotDoor.CLOSED: 0, RobotDoor.MOVING: 1, RobotDoor.OPEN: 2}
MOTION_STATE = {Motion.STOPPED: 0, Motion.UP: 1, Motion.DOWN: 2, Motion.MOVING: 3, Motion.UNKNOWN: 3}

# rmf_lift_msgs/msg/LiftRequest has no 1: a caller cannot ask for a moving door
DOOR_CLOSED = 0
DOOR_OPEN = 2

_DOOR_STATES = f"{DOOR_CLOSED} (no hold; for the current floor a release) or {DOOR_OPEN} (open and hold)"

_ACCEPTED = workshop_success({})

NAME_LIMIT = 200
_SURROGATE = re.compile("[\\ud800-\\udfff]")
"""JSON can spell halves of characters, which no journal or log could store."""


def workshop_router(site: Site) -> APIRouter:
    """The three routes, answering from the memory. `DirectRoutes` calls their endpoints."""
    names = site.lift_names()
    answers: dict[str, tuple[LiftState, Response]] = {}
    """The newest to each lift's state."""
    router = APIRouter(prefix="/open-rmf/demo-lift", tags=[docs.TAG])

    def lift_names(_: WholeRequest) -> Response:
        return workshop_success({"lift_names": site.lift_names()})

    def lift_state(request: WholeRequest) -> Response:
        lift = _named_lift(site, request)
        state = site.lasting_state(lift)
        known = answers.get(lift)
        if known is None or known[0] is not state:
            known = answers[lift] = state, _state_answer(state)
        return known[1]

    def lift_request(request: WholeRequest) -> Response:
        try:
            lift = _named_lift(site, request)
        except RequestError:
            named = "".join(named_lifts(request.scope)[:1])
            site.turned_away(face_refusal(request, "unknown_lift", "it names no lift of this site", named))
            raise
        if is_from_another_site(request):
            site.turned_away(face_refusal(request, "another_site", FOREIGN_PAGE, lift))
            raise RequestError("another_site", f"{FOREIGN_PAGE}; only programs and this manager's own pages may")
        floor, hold_door = _read_request(request.content, site.config(lift).floors)
        key = caller_key(request)
        holder = WORKSHOP if key is None else Holder(WORKSHOP.face, key.name)
        site.request(lift, holder, floor, hold_door=hold_door)
        return _ACCEPTED

    router.add_api_route("/lift_names", lift_names, methods=["GET"], **docs.lift_names(names))
    router.add_api_route("/lift_state", lift_state, methods=["GET"], **docs.lift_state(names))
    router.add_api_route("/lift_request", lift_request, methods=["POST"], **docs.lift_request(names))
    return router


def _named_lift(site: Site, request: WholeRequest) -> str:
    named, known = named_lifts(request.scope), site.lift_names()
    is_too_long = len(request.scope["query_string"]) > LIMIT_BYTES
    if not is_too_long and len(named) == 1 and named[0] in known:
        return named[0]
    lifts = ", ".join(known)
    if is_too_long:
        raise RequestError("malformed", f"{TOO_LONG}; lift_name must be one of: {lifts}")
    if not named:
        raise RequestError("malformed", f"lift_name is missing; it must be one of: {lifts}")
    if len(named) > 1:
        raise RequestError("malformed", f"lift_name is given {len(named)} times; give it once, as one of: {lifts}")
    raise RequestError("unknown_lift", f"unknown lift {quoted(named[0])}; lift_name must be one of: {lifts}")


def _state_answer(state: LiftState) -> Response:
    if state.quality is Quality.OFFLINE:
        age = "no reading yet" if state.age_s is None else f"last reading {state.age_s:.1f} s ago"
        raise RequestError(
            "offline", f"lift {quoted(state.lift)} is offline, {age}: {state.reason or 'no reason known'}"
        )
    return workshop_success(state_data(state))


def state_data(state: LiftState) -> dict[str, object]:
    """Return what a live lift looks like to clients of the workshop."""
    return {
        "available_floors": state.floors,
        "current_floor": state.floor or "",
        "destination_floor": state.destination or "",
        "door_state": DOOR_STATE[state.robot_door],
        "motion_state": MOTION_STATE[state.motion],
    }


def _read_request(body: bytes, floors: Sequence[str]) -> tuple[str, bool]:
    """Return the floor of a request, and whether to hold the door there."""
    floor_list = ", ".join(floors)
    try:
        fields = decode_object(body)
    except RequestError as error:
        expected = f'{{"floor": one of {floor_list}, "door_state": {DOOR_CLOSED} or {DOOR_OPEN}}}'
        raise RequestError("malformed", f"{error.message}; expected {expected}") from error
    if "floor" not in fields:
        raise RequestError("malformed", f"floor is missing; it must be one of: {floor_list}")
    floor = fields["floor"]
    if not isinstance(floor, str) or len(floor) > NAME_LIMIT or _SURROGATE.search(floor):
        raise RequestError("malformed", f"floor must be one of: {floor_list}; not {quoted(floor)}")
    if "door_state" not in fields:
        raise RequestError("malformed", f"door_state is missing; it must be {_DOOR_STATES}")
    door_state = fields["door_state"]
    # True == 1 in Python, and a client that sends a boolean means something else
    if (
        isinstance(door_state, bool)
        or not isinstance(door_state, int | float)
        or door_state not in {DOOR_CLOSED, DOOR_OPEN}
    ):
        raise RequestError("malformed", f"door_state must be {_DOOR_STATES}, not {quoted(door_state)}")
    return floor, door_state == DOOR_OPEN
