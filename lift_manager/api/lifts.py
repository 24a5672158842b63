"""Lifts: their published state, their capabilities, and their signals."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from enum import StrEnum, unique
from typing import Annotated

from pydantic import Field

from lift_manager.api.fields import Answer, Seconds
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftSignals, LiftState, Quality
from register_maps.words import Door, Mode, Motion, Side

Age = Annotated[
    Seconds | None, Field(description="Age of the reading in seconds; null before the first reading.", examples=[0.12])
]


AGE_HEADER = "lift-age-s"
"""The header with the age of a lift in seconds, in every answer about a lift, 304 included. All other values that change with time follow
from it."""


class Held(Answer):
    """The session that holds a lift."""

    face: str = Field(examples=["api"])
    name: str = Field(examples=["amr-7"])
    for_s: Seconds = Field(description="For how long it has held the lift, in seconds.")
    ending: bool = Field(
        default=False,
        description="The holder has ended its session, and may still resume it; door hold and robot mode stay on until it is over.",
    )


class Restricted(Answer):
    """What keeps robots off a lift or makes them wait, besides the signals of the lift itself."""

    fire_latched: bool = Field(description="Whether there was a fire that nobody has acknowledged.")
    lockout: str = Field(description="Who locked the lift out, since when and why; empty without a lockout.")
    drain: str = Field(
        default="",
        description="Who drains the lift, since when and why: sessions end, and no new one begins. Empty without a drain.",
    )
    maybe_occupied_by: str | None = Field(
        description="A robot that may be in the car without a session, as `face:name`."
    )
    distrusted: str = Field(
        default="",
        description="Which signals contradicted each other, and what restores trust in them. Meanwhile no door counts as open for robots."
        " Empty without a contradiction.",
    )
    waiting_for: str = Field(description="What the session is waiting for before anything is pressed.")


class Lift(Answer):
    """One lift at one moment."""

    name: str
    floors: tuple[str, ...] = Field(description="Lowest first.")
    quality: Quality = Field(
        description="`offline`: no reading newer than `max_age_s`; floor, doors and motion are unknown."
    )
    reason: str = Field(description="Why it is offline.")
    age_s: Age
    max_age_s: float = Field(
        description="An older state is offline. A client without a newer state must treat the lift as offline."
    )
    floor: str | None = Field(description="The floor at which the car stands or that it passes; null if unknown.")
    standing: bool = Field(description="Whether the car stands at `floor`, by the evidence of the map.")
    destination: str | None
    robot_door: RobotDoor = Field(description="Only `open` invites the robot to drive.")
    doors: Mapping[Side, Door] = Field(description="The state of each door, whether or not a robot may use it.")
    motion: Motion
    mode: Mode
    permissions: Mapping[str, bool] = Field(
        description="Those of `may_enter`, `may_leave`, `robot_mode_on`, `robots_allowed` and `ready` that this lift reports."
    )
    session: Held | None = Field(description="The session that holds it; null while it is free.")
    releases_in_s: Seconds | None = Field(
        default=None,
        description="Seconds until the manager releases the door by itself at the earliest: at the end of the lease, of the door hold, of"
        " the session, or of the wait after a lockout or a forced release. A renewal postpones it. During the last `clear_s` before that,"
        " `robot_door` is not `open`: a robot that has not started stays where it is, and one on the sill finishes crossing. A fire, a hold"
        " that drops out, or a mode without robots ends a hold without this notice. null while nobody holds the lift.",
        examples=[287.5],
    )
    waiting: int = Field(description="How many rides and faces are waiting for it.")
    restrictions: Restricted
    not_visible: Mapping[str, str] = Field(description="Safety signals that this lift does not report, and why.")

    @classmethod
    def of(cls, state: LiftState, *, max_age_s: float) -> Lift:
        """Return the published state of a lift."""
        restrictions, holder = state.restrictions, state.holder
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
                fire_latched=restrictions.fire_latched,
                lockout=restrictions.lockout,
                drain=restrictions.drain,
                maybe_occupied_by=None if restrictions.maybe_aboard is None else str(restrictions.maybe_aboard),
                distrusted=restrictions.distrusted,
                waiting_for=restrictions.waiting_for,
            ),
            not_visible=state.not_visible,
        )

    def unread(self, age_s: float | None, reason: str) -> Lift:
        """Return the answer for a lift that cannot be read: only what the manager itself knows of it."""
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
    """Every lift of the site, in the order of the site file."""

    lifts: tuple[Lift, ...]


@unique
class ClosedEvidence(StrEnum):
    """How a lift shows that a door is closed."""

    REPORTED = "reported"
    NOT_OPEN = "not_open"


class CheckoutRecord(Answer):
    """The record of an acceptance test."""

    sha256: str = Field(description="Hash of the record, as on each page of its report.")
    ended_at: datetime


class LiftCapabilities(Answer):
    """The signals and commands of a lift, and its time limits for robots."""

    name: str
    display_name: str = Field(default="", description="Its name for people; empty if `name` is used.")
    floors: tuple[str, ...]
    doors_at: Mapping[str, tuple[Side, ...]] = Field(description="Which doors serve each floor.")
    access: str = Field(
        description="`control`, or `monitor`: the manager never writes to the lift.", examples=["control"]
    )
    commands: tuple[str, ...] = Field(examples=[["go_to", "hold_door.front"]])
    signals: tuple[str, ...]
    evidence: str = Field(description="The signal that shows that the car stands at a floor.", examples=["level"])
    closed_evidence: Mapping[Side, ClosedEvidence] = Field(
        description="How each door is known to be closed. `not_open`: the lift reports only whether the door is open. A door that is not"
        " open then counts as `moving` for as long as it may take to close, and as `closed` after that.",
        examples=[{"front": "reported"}],
    )
    max_age_s: float
    poll_s: float
    lease_s: float = Field(description="The longest lease; a session is renewed before its lease ends.")
    max_session_s: float
    max_session_hold_s: float = Field(
        description="How long the door is held at most during one stop: the shorter of what the site and the controller allow."
    )
    clear_s: float = Field(
        default=10.0,
        description="How long before the manager releases a held door `robot_door` stops being `open`. Leases are at least three times as"
        " long.",
    )
    arrive_within_s: float
    robot_hours: str = Field(description="When robots may begin sessions; empty for always.")
    robot_words: bool = Field(
        description="Whether the lift needs to know when a robot is in place and when it has left."
    )
    not_visible: Mapping[str, str]
    map: str
    trust: str = Field(description="The source from which the map was made.", examples=["vendor-manual"])
    checkout: CheckoutRecord | None = Field(
        default=None,
        description="The record of the acceptance test (`lift-manager checkout`) that lets robots use this lift; null without one that"
        " fits its map.",
    )
    simulated: bool = Field(
        default=False,
        description="Whether the site file declares one of its controllers to be a simulator. An interface for people has to show that.",
    )

    @classmethod
    def of(cls, lift: LiftConfig, *, simulated: bool = False) -> LiftCapabilities:
        """Return the capabilities of a lift."""
        capabilities = lift.capabilities
        return cls(
            name=lift.name,
            display_name=lift.display_name,
            floors=lift.floors,
            doors_at=lift.doors_at,
            access="control" if lift.control else "monitor",
            commands=tuple(sorted(capabilities.commands)),
            signals=tuple(sorted(capabilities.signals)),
            evidence=capabilities.evidence,
            closed_evidence={
                side: ClosedEvidence.NOT_OPEN if side in capabilities.open_contacts else ClosedEvidence.REPORTED
                for side in capabilities.doors
            },
            max_age_s=capabilities.max_age_s,
            poll_s=lift.poll_s,
            lease_s=lift.lease_s,
            max_session_s=lift.max_session_s,
            max_session_hold_s=lift.hold_limit.seconds,
            clear_s=lift.clear_s,
            arrive_within_s=capabilities.arrive_within_s,
            robot_hours="" if lift.robot_hours is None else str(lift.robot_hours),
            robot_words=capabilities.needs_occupancy or bool({"robot_in_place", "robot_left"} & capabilities.commands),
            not_visible=capabilities.not_visible,
            map=capabilities.map_name,
            trust=capabilities.trust,
            checkout=None if lift.checkout is None else CheckoutRecord.model_validate(lift.checkout),
            simulated=simulated,
        )


class Signal(Answer):
    """The last reading of one signal."""

    name: str = Field(examples=["door.front"])
    value: str | bool | float | None = Field(
        description="The value as the map decodes it; null if the map has no value for it."
    )
    raw: int | None = Field(description="The raw value, before scale and value table.")
    addresses: tuple[str, ...] = Field(description="As the map prints them.", examples=[["holding:12"]])
    wire: tuple[str, ...] = Field(
        default=(),
        description="The same places on the wire, where the first one is 0, moved by the offset of the lift.",
        examples=[["holding 11"]],
    )
    age_s: Age


class Signals(Answer):
    """Every signal of a lift. Check the ages before acting on one: stale values are listed too."""

    name: str
    age_s: Age
    max_age_s: float
    signals: tuple[Signal, ...]

    @classmethod
    def of(cls, lift: LiftSignals) -> Signals:
        """Return the signals of a lift."""
        signals = tuple(Signal.model_validate(signal) for signal in lift.signals)
        return cls(name=lift.lift, age_s=lift.age_s, max_age_s=lift.max_age_s, signals=signals)


class LiftCommand(Answer):
    """One command of a lift's map."""

    name: str = Field(examples=["hold_door.front"])
    meaning: str
    takes_floor: bool
    addresses: tuple[str, ...] = Field(description="As the map prints them.", examples=[["coil:9"]])
    wire: tuple[str, ...] = Field(
        description="The same places on the wire, where the first one is 0.", examples=[["coil 8"]]
    )
    action: str = Field(description="`pulse`, `hold`, or `count` and `toggle` of a heartbeat.", examples=["hold"])
    ends_itself: bool = Field(description="Whether the controller ends the pulse, not the manager.")
    width_s: float | None = Field(description="How long a pulse lasts.")
    max_hold_s: float | None = Field(description="How long a hold lasts at most unless it is renewed.")
    refresh_s: float | None = Field(description="How often a hold is written again.")
    until: str = Field(
        description="What ends a hold by itself: `arrived`, `closed`, `robot_in_place` or `robot_left`; empty for nothing."
    )
    on_link_loss: str = Field(
        description="What becomes of a hold when its manager is lost: `device_watchdog`, `timed_by_device`, or `latches`: it stays on."
        " Empty for other commands.",
        examples=["device_watchdog"],
    )
    requires: tuple[str, ...] = Field(description="Flags that must read yes before it is pressed.")
    confirmed_within_s: float = Field(description="How long the lift may take to show that it has taken it.")
    state: str | None = Field(
        description="Of its output: `at rest` (off, and verified), `requested`, `on`, `held` (on, and verified), `lost` (found off), or"
        " `releasing`. null for a heartbeat, and on a lift that is only watched.",
        examples=["at rest"],
    )


class LiftCommands(Answer):
    """Every command of a lift's map, whether or not the site lets the manager write."""

    name: str
    same_floor_call: bool = Field(
        description="Whether a call to the floor where the car stands opens its door; otherwise the door hold does."
    )
    commands: tuple[LiftCommand, ...]


class PlannedWrite(Answer):
    """One write that a command would send."""

    name: str = Field(description="The command.", examples=["hold_door.front"])
    what: str = Field(
        description="`press`, `release`, or `reset`: the rest value, so that the press that follows is an edge."
    )
    addresses: tuple[str, ...] = Field(description="As the map prints them.", examples=[["coil:9"]])
    function: int = Field(description="The Modbus function code.", examples=[5])
    text: str = Field(description="In words, with the address on the wire.", examples=["write coil 8 := on, unit 1"])
    frame: str = Field(
        description="Unit, function and data as hex, as in the journal: the frame without its first six bytes.",
        examples=["01050008ff00"],
    )
    is_read_first: bool = Field(
        description="Whether others write bits of the same register: it is read first, and their bits, 0 here, are written as found."
    )


class PlannedWrites(Answer):
    """What steps would write, in order."""

    name: str
    writes: tuple[PlannedWrite, ...]
