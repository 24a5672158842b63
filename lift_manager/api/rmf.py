"""Open-RMF: the site as an adapter sees it, and the requests of RMF's sessions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, Field, StringConstraints
from pydantic_core import PydanticCustomError

from lift_manager.api.fields import ON_ONE_LINE, Answer, RequestModel, ShortName
from lift_manager.api.lifts import Age
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.rmf_view import ADAPTER_ID, ADAPTER_ID_LIMIT, LONGEST_GRACE_S
from register_maps.words import Mode, Motion


def _printable(text: str) -> str:
    # ids are compared and never changed, so an id that cannot be shown as it is must be refused
    if not text.isprintable():
        raise PydanticCustomError("printable", "must be text on one line, without control characters")
    return text


SessionId = Annotated[
    str,
    StringConstraints(min_length=1, max_length=256),
    AfterValidator(_printable),
    ON_ONE_LINE,
    Field(description="RMF's session id; the lift is then held by `rmf:<session_id>`.", examples=["fleet/amr-7"]),
]


AdapterId = Annotated[
    str,
    StringConstraints(max_length=ADAPTER_ID_LIMIT, pattern=ADAPTER_ID),
    Field(
        description="The id of the adapter, the same after each of its restarts. Sessions of different adapters differ even with the same"
        " id; the lift is then held by `rmf:<session_id>@<adapter>`.",
        examples=["", "5/building1"],
    ),
]


class RmfHolder(Answer):
    """The holder of a lift."""

    face: str = Field(description="`rmf` for a session of RMF.", examples=["rmf"])
    name: str = Field(description="With the face `rmf`: RMF's session id.", examples=["fleet/amr-7"])
    adapter: str = Field(
        default="", description="With the face `rmf`: the id of its adapter.", examples=["", "5/building1"]
    )


class RmfLiftAnswer(Answer):
    """One lift at one moment."""

    lift: str = Field(description="Its name in the site file.")
    name: str = Field(description="Its name in RMF's building map.")
    floors: Mapping[str, str] = Field(description="The site's floor name to RMF's, lowest first.")
    live: bool = Field(description="False while nobody may act on its state.")
    reason: str = Field(description="Why it is not live.")
    age_s: Age
    max_age_s: float
    floor: str | None = Field(description="The floor by its name in the site file; null if unknown.")
    standing: bool = Field(description="Whether the car stands at `floor`, by the evidence of the map.")
    destination: str | None
    door: RobotDoor = Field(description="`open` invites the holder's robot to drive.")
    motion: Motion
    mode: Mode
    robot_mode_on: bool | None = Field(description="null if the lift has no such signal.")
    holder: RmfHolder | None = Field(description="null while it is free.")
    ending: bool = Field(description="The holder has ended its session; door hold and robot mode stay on for a moment.")
    fire_latched: bool = Field(description="Whether there was a fire that nobody has acknowledged.")
    waiting_for: str = Field(description="What the session is waiting for before anything is pressed.")
    keeps_off: str = Field(description="Why robots are kept off; empty if they are not.")


class RmfAlarms(Answer):
    """How the site reports a fire to RMF."""

    fire_alarm: bool = Field(description="Whether to publish it on `fire_alarm_trigger`.")
    emergency_signal: bool = Field(description="Whether to publish it on `emergency_signal`.")
    emergency_fleets: tuple[str, ...] = Field(description="The fleets that `emergency_signal` names.")
    clear_on_acknowledge: bool = Field(
        description="Whether to publish the end of the fire once a person has acknowledged it."
    )


class RmfSiteAnswer(Answer):
    """Every lift, and the settings of the site for RMF."""

    boot: str = Field(description="An id that changes with each start of the manager.")
    event: int = Field(description="All events up to this number are included; numbers are comparable within one boot.")
    lifts: tuple[RmfLiftAnswer, ...]
    end_grace_s: float = Field(description="How long door hold and robot mode stay on after END_SESSION.")
    alarms: RmfAlarms


class RmfWantedRequest(RequestModel):
    """A session of RMF requests the lift at a floor. The first request opens the session; each further one changes or repeats the request."""

    session_id: SessionId
    floor: ShortName = Field(description="The floor by its name in the site file.", examples=["L2"])
    hold_door: bool = Field(
        description="Hold the door open there until another floor is requested or the session ends."
    )
    adapter: AdapterId = ""


class RmfEndedRequest(RequestModel):
    """A session of RMF has ended."""

    session_id: SessionId
    grace_s: float = Field(
        ge=0.0,
        le=LONGEST_GRACE_S,
        description="How long door hold and robot mode stay on, unless the same session requests the lift again.",
        examples=[3.0],
    )
    adapter: AdapterId = ""


class RmfAccepted(Answer):
    """The request is accepted. Its effect shows from this event on."""

    boot: str
    event: int = Field(
        description="An answer to `GET /api/v1/rmf` with this boot and a lower number does not show the effect yet."
    )
