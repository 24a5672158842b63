"""The models of a scenario file. Faults, people and matches have readers of their own: `faults` and `matching`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from lift_manager.config.site import AnyFloor, Clear, Given, Seconds, Text, Wait
from lift_manager.lab.scenario.vocabulary import RequestedDoor
from lift_manager.lift.occupancy import RobotWord
from register_maps.words import Side
from simulator.state import SameFloorCall

Sentence = Annotated[
    str,
    StringConstraints(min_length=1, max_length=300, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="text on one line, without control characters"),
]
Holder = Annotated[
    str,
    StringConstraints(min_length=1, max_length=64, pattern=r"^[^:\x00-\x1f\x7f]+(:[^\x00-\x1f\x7f]+)?$"),
    Field(description="the face and the name of the caller, such as fleet:r1, or one word"),
]
Moment = Annotated[float, Field(ge=0, le=86400)]
Count = Annotated[int, Field(strict=True, ge=0)]
Floors = tuple[Text, ...]
Sides = tuple[Side, ...]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Options(_Part):
    """Keys that a site file would set for the lift; see docs/reference/site-file.md."""

    lease_s: Seconds | None = None
    max_session_hold_s: Seconds | None = None
    clear_s: Clear | None = None
    between_sessions_s: Annotated[float, Field(ge=0, le=600)] | None = None
    board_min_s: Annotated[float, Field(ge=0, le=600)] | None = None
    fire_release_delay_s: Annotated[float, Field(ge=0, le=10)] | None = None
    infer_occupancy: bool | None = None
    poll_s: Annotated[float, Field(ge=0.02, le=60)] | None = None
    max_age_s: Wait | None = None


class Simulated(_Part):
    """Parameters of the simulated controller; see `simulator.state.Parameters`."""

    speed: Annotated[float, Field(ge=0.1, le=100)] = 1.0
    dwell_s: Seconds | None = None
    robot_mode_delay_s: Annotated[float, Field(ge=0, le=600)] | None = None
    drops_stuck_button_s: Seconds | None = None
    needs_edge_s: Seconds | None = None
    same_floor_call: SameFloorCall | None = None


class Request(_Part):
    """One request, as a face passes it to the manager."""

    floor: Text
    door: RequestedDoor = RequestedDoor.OPEN
    """`closed` releases the lift."""
    holder: Holder = "workshop"
    robot: RobotWord | None = None


class Robot(_Part):
    """A robot that calls, enters, rides and leaves. It repeats its request every second, as clients do."""

    from_: Text = Field(alias="from")
    to: Text
    holder: Holder = "workshop"
    in_words: bool = False
    """Whether it reports when it is in place and when it has left."""
    boards_s: Annotated[float, Field(ge=0, le=600)] = 3.0
    """How long it takes to drive through the door."""
    gives_up_after_s: Seconds = 600.0
    releases: bool = True
    """Whether it releases the lift at the end, or just stops sending requests."""


class Inputs(_Part):
    """What people press and block while the step lasts."""

    car_buttons: Floors = ()
    landing_buttons: Floors = ()
    hold_door: Sides = ()
    """The open button."""
    close_door: Sides = ()
    obstruction: Sides = ()
    """The light curtain."""


class PersonAction(_Part):
    """An operator action."""

    by: Text


class ReasonedAction(PersonAction):
    """An operator action with a reason."""

    reason: Text


class Step(_Part):
    """One step of the timeline: a time, and exactly one thing to do."""

    at: Moment | None = None
    when: Any = None
    within_s: Seconds | None = None
    wait_s: Seconds | None = None
    lift: Text | None = None
    request: Request | None = None
    robot: Robot | None = None
    fault: Any = None
    wire: Any = None
    people: Any = None
    inputs: Inputs | None = None
    acknowledge: PersonAction | None = None
    lock_out: ReasonedAction | None = None
    end_lockout: PersonAction | None = None
    drain: ReasonedAction | None = None
    end_drain: PersonAction | None = None
    for_s: Seconds | None = None
    every_s: Seconds | None = None
    until: Any = None


class Expectation(_Part):
    """One condition that the whole trace must meet."""

    never: Any = None
    eventually: Any = None
    ordered: tuple[Any, ...] | None = None
    count: Any = None
    while_: Any = Field(default=None, alias="while")
    settled_s: Seconds | None = None
    after: Any = None
    within_s: Seconds | None = None
    at_least: Count | None = None
    at_most: Count | None = None
    exactly: Count | None = None
    after_s: Moment | None = None
    before_s: Seconds | None = None
    lift: Text | None = None
    because: Sentence | None = None


class Scenario(_Part):
    """One scenario file."""

    schema_: Literal[1] = Field(alias="schema")
    title: Sentence
    map: Text | None = None
    floors: Annotated[dict[Text, AnyFloor], Field(min_length=2)] | None = None
    parameters: dict[Text, Given] = Field(default_factory=dict)
    override: dict[Text, Any] = Field(default_factory=dict)
    options: Options = Options()
    site: Text | None = None
    simulator: Simulated = Simulated()
    lasts_s: Seconds
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    # no minimum length: pydantic would call a list with one invalid entry too short; the readers check that a list is not empty
    do: tuple[Step, ...]
    expect: tuple[Expectation, ...]


ACTIONS = (
    "request",
    "robot",
    "fault",
    "wire",
    "people",
    "inputs",
    "acknowledge",
    "lock_out",
    "end_lockout",
    "drain",
    "end_drain",
)
"""What a step can do: exactly one of these."""
DEMANDS = ("never", "eventually", "ordered", "count")
"""What an expectation can demand: exactly one of these."""
STEP_KEY_NEEDS = {
    "within_s": ("when",),
    "wait_s": ("when",),
    "for_s": ("every_s", "fault", "wire", "inputs"),
    "every_s": ("request",),
    "until": ("every_s",),
}
"""Keys of a step that need one of certain other keys."""
EXPECTATION_KEY_NEEDS = {
    "within_s": ("eventually",),
    "while": ("never", "count"),
    "settled_s": ("while",),
    "after": ("eventually",),
    "at_least": ("count",),
    "at_most": ("count",),
    "exactly": ("count",),
}
"""Keys of an expectation that need one of certain other keys."""
