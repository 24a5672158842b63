"""Every request of /api/v1 that changes something, and the form of its refusal: for what holds for all of them alike."""

from typing import Any

import httpx

from lift_manager.lift.refusals import Refused
from lift_manager.lift.session import Holder
from tests.lift_manager.web.fake import FakeSite, ask
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.fake_sessions import a_command, a_session

HERE = "http://127.0.0.1:5003"
LIFT = "/api/v1/lifts/lift"
BY = {"by": "M. Weber"}
WHY = {"by": "M. Weber", "reason": "new ropes"}
CHANGES: dict[str, dict[str, object] | None] = {
    f"{LIFT}/acknowledge": {**BY},
    f"{LIFT}/lockout": {**WHY},
    f"{LIFT}/lockout/end": {**BY},
    f"{LIFT}/drain": {**WHY},
    f"{LIFT}/drain/end": {**BY},
    f"{LIFT}/session/force-release": {**WHY},
    f"{LIFT}/sessions": {},
    f"{LIFT}/sessions/s1/renew": {},
    f"{LIFT}/sessions/s1/close": {},
    f"{LIFT}/sessions/s1/hand-over": {"to": "amr-8"},
    f"{LIFT}/sessions/s1/commands": {"do": "go_to", "floor": "L2"},
    f"{LIFT}/rmf/wanted": {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True},
    f"{LIFT}/rmf/ended": {"session_id": "fleet/amr-7", "grace_s": 3},
    "/api/v1/rides": {"lift": "lift", "from": "L1", "to": "L2"},
    "/api/v1/rides/r1/entered": None,
    "/api/v1/rides/r1/left": None,
    "/api/v1/rides/r1/here": None,
    "/api/v1/rides/r1/cancel": {},
}
"""Body by path. None: a body is not looked at."""
OF_THE_CALLER = frozenset({"/api/v1/login", "/api/v1/logout"})
"""Requests that change who the caller is, and nothing of a lift."""


def with_all(refuses: Refused | None = None) -> FakeSite:
    """A site with a session and a ride of a caller without a key."""
    site = FakeSite(refuses=refuses)
    session = a_session(Holder("api", "anonymous"))
    site.there(session)
    site.commands["s1", "1"] = a_command(session, "1")
    site.fake_rides.going_on(a_ride(Holder("ride", "anonymous")))
    return site


def change(site: FakeSite, path: str, **more: Any) -> httpx.Response:
    """Send one of the requests, from this computer; with the body of the table where `more` has none."""
    if "content" not in more and (body := CHANGES[path]) is not None:
        more = {"json": body, **more}
    return ask(site, "POST", f"{HERE}{path}", **more)


def refused(answer: httpx.Response, status: int, code: str) -> str:
    """Check the form of a refusal; returns its detail."""
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["cache-control"] == "no-store"
    said = answer.json()
    assert {"type", "title", "status", "detail", "code"} <= said.keys()
    assert (said["status"], said["code"], said["type"]) == (status, code, f"urn:lift-manager:problem:{code}")
    assert said["title"]
    return str(said["detail"])
