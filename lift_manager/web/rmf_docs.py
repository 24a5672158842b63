"""What /docs says about Open-RMF."""

from __future__ import annotations

from typing import Any

from lift_manager.api.rmf import (
    RmfAlarms,
    RmfEndedRequest,
    RmfHolder,
    RmfLiftAnswer,
    RmfSiteAnswer,
    RmfTaken,
    RmfWantedRequest,
)
from lift_manager.domain.state import RobotDoor
from lift_manager.web.operations import EVERY_BODY, EVERY_CHANGE, EVERY_LIFT, LIFT, Gives, Takes, operation
from register_maps.words import Mode, Motion

TAG = "rmf"

TAG_DESCRIPTION = """
What an adapter of Open-RMF needs, and nothing else does: with keys it is a key of the role `rmf` that may speak for RMF's sessions.

- A session of RMF ends by `ended` alone: neither arrival nor a request without `hold_door` ends it. It has no lease, for on some
  distributions RMF is silent once the lift is where it is wanted; the site's `max_session_s` bounds it.
- `ended` is taken at any floor, in any mode, of a lift that is offline, and as often as it is said. The car is not moved by it.
  Within `grace_s` the same session may go on as if nothing had been said; others are refused until then.
- Repeats of what is wanted already press nothing and cost no turn.
- Where several RMFs share a manager, each adapter says its id with every request: what one says of a session of another is refused (`held`).
"""

_LIFT = RmfLiftAnswer(
    lift="east",
    name="east_lift",
    floors={"L1": "L1", "L2": "L2", "L3": "level 3"},
    live=True,
    reason="",
    age_s=0.12,
    max_age_s=2.0,
    floor="L1",
    standing=True,
    destination="L1",
    door=RobotDoor.OPEN,
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    robot_mode_on=True,
    holder=RmfHolder(face="rmf", name="fleet/amr-7"),
    ending=False,
    fire_latched=False,
    waiting_for="",
    keeps_off="",
)
_ALARMS = RmfAlarms(fire_alarm=False, emergency_signal=False, emergency_fleets=(), clear_on_acknowledge=False)
_SITE = RmfSiteAnswer(boot="18c2f3a90b", event=412, lifts=(_LIFT,), end_grace_s=3.0, alarms=_ALARMS)
_TAKEN = RmfTaken(boot="18c2f3a90b", event=413)
_OF_A_WORD = (*EVERY_LIFT, *EVERY_CHANGE, *EVERY_BODY, "held", "stopping")


def site() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "Every lift, for RMF",
        "By RMF's names and the site's, from memory. `event` is the number of the newest event: `/api/v1/events` tells of the next.",
        {200: Gives("As it is.", RmfSiteAnswer, _SITE)},
        ("stopping",),
    )


def wanted() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "RMF's session wants the lift at a floor",
        "The first one opens the session. Taken is not arrived: the site tells what became of it.",
        {200: Gives("The session holds the lift.", RmfTaken, _TAKEN)},
        (
            *(*_OF_A_WORD, "unknown_floor", "queued", "offline", "mode", "fire_latched", "locked_out", "outside_hours"),
            *("monitor_only", "not_possible", "occupancy_unknown", "too_often", "not_recorded"),
        ),
        takes=Takes(
            RmfWantedRequest,
            {"AGV mode": {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True}},
        ),
        parameters=(LIFT,),
    )


def ended() -> dict[str, Any]:
    """What the route's registration wants to know, docs included."""
    return operation(
        "RMF's session is over",
        "Of a session that is over already the answer is yes.",
        {200: Gives("It is over once `grace_s` is.", RmfTaken, _TAKEN)},
        _OF_A_WORD,
        takes=Takes(RmfEndedRequest, {"END_SESSION": {"session_id": "fleet/amr-7", "grace_s": 3.0}}),
        parameters=(LIFT,),
    )
