"""Open-RMF: the site as an adapter is told of it, and what RMF's sessions want."""

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
    # an id is compared and never changed: what cannot be shown as it is, is refused
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
        description="The id of the adapter, the same after each of its starts. Sessions of two adapters are two, whatever their ids;"
        " the lift is then held by `rmf:<session_id>@<adapter>`.",
        examples=["", "5/building1"],
    ),
]


class RmfHolder(Answer):
    """Who holds a lift."""

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
    live: bool = Field(description="False while its state may not be acted on.")
    reason: str = Field(description="Why it is not live.")
    age_s: Age
    max_age_s: float
    floor: str | None = Field(description="In the site's words; null when nobody reports it.")
    standing: bool = Field(description="By the map's evidence the car stands at `floor`.")
    destination: str | None
    door: RobotDoor = Field(description="`open` is the invitation to drive, to whoever holds the lift.")
    motion: Motion
    mode: Mode
    robot_mode_on: bool | None = Field(description="null where the lift has no such signal.")
    holder: RmfHolder | None = Field(description="null while it is free.")
    ending: bool = Field(description="The holder has ended its session; door and robot mode stay for a moment.")
    fire_latched: bool = Field(description="There was a fire, and no person has acknowledged it.")
    waiting_for: str = Field(description="What the session waits for before anything is pressed.")
    keeps_off: str = Field(description="Why robots are kept off, in words; empty where they are not.")


class RmfAlarms(Answer):
    """What of a fire is told to RMF."""

    fire_alarm: bool = Field(description="On `fire_alarm_trigger`.")
    emergency_signal: bool = Field(description="And on `emergency_signal`.")
    emergency_fleets: tuple[str, ...] = Field(description="Whom that names.")
    clear_on_acknowledge: bool = Field(description="Once that it is over, when a person has acknowledged.")


class RmfSiteAnswer(Answer):
    """Every lift, and what the site says about RMF."""

    boot: str = Field(description="Another one after each start of the manager.")
    event: int = Field(description="All events up to this number are in it; numbers compare within one boot.")
    lifts: tuple[RmfLiftAnswer, ...]
    end_grace_s: float = Field(description="How long door hold and robot mode stay after END_SESSION.")
    alarms: RmfAlarms


class RmfWantedRequest(RequestModel):
    """A session of RMF wants the lift at a floor: the first one opens it, each further one changes or repeats what is wanted."""

    session_id: SessionId
    floor: ShortName = Field(description="In the site's words.", examples=["L2"])
    hold_door: bool = Field(description="Hold the door open there until another floor is wanted or the session ends.")
    adapter: AdapterId = ""


class RmfEndedRequest(RequestModel):
    """A session of RMF is over."""

    session_id: SessionId
    grace_s: float = Field(
        ge=0.0,
        le=LONGEST_GRACE_S,
        description="So long door hold and robot mode stay as they are, unless the same session wants the lift again.",
        examples=[3.0],
    )
    adapter: AdapterId = ""


class RmfAccepted(Answer):
    """It is decided so; what was decided shows from this event on."""

    boot: str
    event: int = Field(
        description="An answer of `GET /api/v1/rmf` of this boot with a lower number does not show it yet."
    )
