"""Lifts: what they publish, what they can do, what each of their signals says."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum, unique
from typing import Annotated

from pydantic import Field

from lift_manager.api.fields import Answer, Seconds
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftSignals, LiftState, Quality
from register_maps.words import Door, Mode, Motion, Side

Age = Annotated[Seconds | None, Field(description="Seconds; null when there never was a reading.", examples=[0.12])]


AGE_HEADER = "lift-age-s"
"""With an answer about a lift, 304 included: its age in seconds. All else that changes by itself follows from it."""


class Held(Answer):
    """Who holds a lift."""

    face: str = Field(examples=["api"])
    name: str = Field(examples=["amr-7"])
    for_s: Seconds = Field(description="Since when, in seconds.")
    ending: bool = Field(
        default=False,
        description="The holder has ended its session and may still go on; door and robot mode stay until it is over.",
    )


class Restricted(Answer):
    """What keeps robots off a lift, or lets them wait, beside what the lift itself says."""

    fire_latched: bool = Field(description="There was a fire, and no person has acknowledged it.")
    lockout: str = Field(description="Who locked it out, since when and why; empty when nobody did.")
    drain: str = Field(
        default="",
        description="Who lets sessions end and no new one begin, since when and why; empty when nobody does.",
    )
    maybe_occupied_by: str | None = Field(
        description="`face:name` of a robot that may be in the car without a session."
    )
    distrusted: str = Field(
        default="",
        description="Which of its signals contradicted each other, and what ends that; no door counts as open for robots meanwhile."
        " Empty where none did.",
    )
    waiting_for: str = Field(description="What the session waits for before anything is pressed.")


class Lift(Answer):
    """One lift at one moment."""

    name: str
    floors: tuple[str, ...] = Field(description="Lowest first.")
    quality: Quality = Field(
        description="`offline`: nothing newer than `max_age_s`; floor, doors and motion are not known."
    )
    reason: str = Field(description="Why it is offline.")
    age_s: Age
    max_age_s: float = Field(
        description="An older state is offline. Whoever has heard nothing for so long knows nothing."
    )
    floor: str | None = Field(description="Where the car stands or passes; null when nobody reports it.")
    standing: bool = Field(description="By the map's evidence the car stands at `floor`.")
    destination: str | None
    robot_door: RobotDoor = Field(description="`open` is the invitation to drive; everything else is none.")
    doors: Mapping[Side, Door] = Field(description="The doors themselves, whoever may use them.")
    motion: Motion
    mode: Mode
    permissions: Mapping[str, bool] = Field(
        description="Of `may_enter`, `may_leave`, `robot_mode_on`, `robots_allowed`, `ready` those that this lift tells."
    )
    session: Held | None = Field(description="Who holds it; null while it is free.")
    releases_in_s: Seconds | None = Field(
        default=None,
        description="Seconds until the manager releases the door by itself at the earliest: the end of the lease, of the door hold, of the"
        " session, or of the wait after a lockout or a forced release. A renewal moves it. From `clear_s` before that end on, `robot_door` is"
        " not `open`: a robot that has not set out stays where it is, one on the sill finishes crossing. Fire, a hold that drops out and"
        " a mode without robots end a hold without this notice. null while nobody holds the lift.",
        examples=[287.5],
    )
    waiting: int = Field(description="Rides and faces that wait for it.")
    restrictions: Restricted
    not_visible: Mapping[str, str] = Field(description="Safety signals that this lift does not show, and why.")

    @classmethod
    def of(cls, state: LiftState, *, max_age_s: float) -> Lift:
        """Return it as published."""
        told, holder = state.restrictions, state.holder
        return cls(
            name=state.lift,
            floors=state.floors,
            quality=state.quality,
            reason=state.reason,
            age_s=state.age_s,
            max_age_s=max_age_s,
            floor=state.floor,
            standing=state.standing,
            destination=state.destination,
            robot_door=state.robot_door,
            doors=state.doors,
            motion=state.motion,
            mode=state.mode,
            permissions=state.permissions,
            session=None
            if holder is None
            else Held(face=holder.face, name=holder.name, for_s=state.held_since_s or 0.0, ending=state.ending),
            releases_in_s=state.releases_in_s,
            waiting=state.waiting,
            restrictions=Restricted(
                fire_latched=told.fire_latched,
                lockout=told.lockout,
                drain=told.drain,
                maybe_occupied_by=None if told.maybe_aboard is None else str(told.maybe_aboard),
                distrusted=told.distrusted,
                waiting_for=told.waiting_for,
            ),
            not_visible=state.not_visible,
        )

    def unread(self, age_s: float | None, reason: str) -> Lift:
        """Return it as one of which nothing is known but what the manager itself knows: the answer about a lift that cannot be read."""
        nothing: dict[str, object] = {
            "quality": Quality.OFFLINE,
            "floor": None,
            "standing": False,
            "robot_door": RobotDoor.MOVING,
            "doors": {},
            "motion": Motion.UNKNOWN,
            "mode": Mode.UNKNOWN,
            "permissions": {},
        }
        destination = None if self.session is None else self.destination
        return self.model_copy(update={**nothing, "reason": reason, "age_s": age_s, "destination": destination})


class Lifts(Answer):
    """Every lift of the site, in the site's order."""

    lifts: tuple[Lift, ...]


@unique
class ClosedEvidence(StrEnum):
    """How a lift shows that a door is closed."""

    REPORTED = "reported"
    NOT_OPEN = "not_open"


class LiftCapabilities(Answer):
    """What a lift can say and be told, and how long the site lets robots have it."""

    name: str
    display_name: str = Field(default="", description="What people call it; empty where its name will do.")
    floors: tuple[str, ...]
    doors_at: Mapping[str, tuple[Side, ...]] = Field(description="Which doors serve each floor.")
    access: str = Field(description="`control`, or `monitor`: then nothing is ever written.", examples=["control"])
    commands: tuple[str, ...] = Field(examples=[["go_to", "hold_door.front"]])
    signals: tuple[str, ...]
    evidence: str = Field(description="What shows that the car stands at a floor.", examples=["level"])
    closed_evidence: Mapping[Side, ClosedEvidence] = Field(
        description="What `closed` of each door rests on. `not_open`: the lift tells no more than whether the door is open; it counts"
        " as `moving` for as long as it may take to close, and as `closed` after that.",
        examples=[{"front": "reported"}],
    )
    max_age_s: float
    poll_s: float
    lease_s: float = Field(description="The longest lease; a session asks again before it ends.")
    max_session_s: float
    max_session_hold_s: float = Field(description="How long the door is held at most in one stop.")
    clear_s: float = Field(
        default=10.0,
        description="So long before the manager releases a held door, `robot_door` is no longer `open`; leases are at least three times"
        " as long.",
    )
    arrive_within_s: float
    robot_hours: str = Field(description="When robots may begin; empty for always.")
    robot_words: bool = Field(description="The lift wants to hear when a robot is in place and when it has left.")
    not_visible: Mapping[str, str]
    map: str
    trust: str = Field(description="What the map was made from.", examples=["vendor-manual"])

    @classmethod
    def of(cls, lift: LiftConfig) -> LiftCapabilities:
        """Return it as described."""
        able = lift.capabilities
        return cls(
            name=lift.name,
            display_name=lift.display_name,
            floors=lift.floors,
            doors_at=lift.doors_at,
            access="control" if lift.control else "monitor",
            commands=tuple(sorted(able.commands)),
            signals=tuple(sorted(able.signals)),
            evidence=able.evidence,
            closed_evidence={
                side: ClosedEvidence.NOT_OPEN if side in able.open_contacts else ClosedEvidence.REPORTED
                for side in able.doors
            },
            max_age_s=able.max_age_s,
            poll_s=lift.poll_s,
            lease_s=lift.lease_s,
            max_session_s=lift.max_session_s,
            max_session_hold_s=lift.max_session_hold_s,
            clear_s=lift.clear_s,
            arrive_within_s=able.arrive_within_s,
            robot_hours="" if lift.robot_hours is None else str(lift.robot_hours),
            robot_words=able.needs_occupancy or bool({"robot_in_place", "robot_left"} & able.commands),
            not_visible=able.not_visible,
            map=able.map_name,
            trust=able.trust,
        )


class Signal(Answer):
    """One signal as it was read last."""

    name: str = Field(examples=["door.front"])
    value: str | bool | float | None = Field(
        description="As the map decodes it; null where its table has no such value."
    )
    raw: int | None = Field(description="As read, before scale and table.")
    addresses: tuple[str, ...] = Field(examples=[["holding:12"]])
    age_s: Age


class Signals(Answer):
    """Every signal of a lift, whether or not it may be acted on: look at the ages."""

    name: str
    age_s: Age
    max_age_s: float
    signals: tuple[Signal, ...]

    @classmethod
    def of(cls, lift: LiftSignals) -> Signals:
        """Return them as read."""
        signals = tuple(Signal.model_validate(signal) for signal in lift.signals)
        return cls(name=lift.lift, age_s=lift.age_s, max_age_s=lift.max_age_s, signals=signals)
