"""What a site says about Open-RMF, and a lift as RMF's adapter is told of it. Values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.model import FloorName
from lift_manager.domain.description import LiftDescription
from lift_manager.domain.state import Holder, LiftState, Quality, Restrictions, RobotDoor
from register_maps.words import Mode, Motion

FACE = "rmf"
"""Of every holder that RMF has: its name there is RMF's session id."""

_OF = "@"
"""Stands between RMF's session id and the id of its adapter, which holds none."""
ADAPTER_ID = r"^[A-Za-z0-9._/-]*$"
"""What the id of an adapter is made of; empty for the only one."""
ADAPTER_ID_LIMIT = 300
"""Chosen: a domain and a namespace of ROS, which has 255 characters at most, fit."""

LONGEST_GRACE_S = 30.0
"""Chosen: people wait for a lift that nobody uses, and a supervisor that was restarted is heard within seconds."""


def rmf_holder(session: str, adapter: str) -> Holder:
    """Return who holds a lift for a session of the RMF of an adapter. Two of them may have robots of the same name."""
    return Holder(FACE, f"{session}{_OF}{adapter}" if adapter or _OF in session else session)


def rmf_session(holder: Holder) -> tuple[str, str]:
    """Return session and adapter of such a holder."""
    session, found, adapter = holder.name.rpartition(_OF)
    return (session, adapter) if found else (holder.name, "")


@dataclass(frozen=True, slots=True, kw_only=True)
class RmfRules:
    """What the site says about RMF as a whole."""

    end_grace_s: float = 3.0
    """How long door hold and robot mode stay after END_SESSION. Chosen: a supervisor that was restarted ends every session that it finds,
    and the robot asks again within a second (open-rmf 1.6)."""
    fire_alarm: bool = False
    """Tell RMF of a fire on `fire_alarm_trigger`."""
    emergency_signal: bool = False
    """And on `emergency_signal`, which kilted and later know."""
    emergency_fleets: tuple[str, ...] = ()
    """Whom that names."""
    clear_on_acknowledge: bool = False
    """Tell RMF once that it is over when a person has acknowledged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RmfLift:
    """One lift as an adapter sees it; the keys of `GET /api/v1/rmf`."""

    lift: str
    name: str
    """In RMF's building map."""
    floors: Mapping[FloorName, str]
    """The site's name to RMF's, lowest first."""
    live: bool
    reason: str
    """Why it is not live."""
    age_s: float | None
    max_age_s: float
    floor: FloorName | None
    standing: bool
    destination: FloorName | None
    door: RobotDoor
    motion: Motion
    mode: Mode
    robot_mode_on: bool | None
    """None where the lift does not tell."""
    holder: Holder | None
    ending: bool
    """The holder has ended its session, and the grace runs."""
    fire_latched: bool
    waiting_for: str
    keeps_off: str
    """Why robots are kept off, in words; empty where they are not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RmfSite:
    """Every lift, and what the site says about RMF."""

    boot: str
    event: int
    """The number of the newest event: nothing up to it is missing."""
    lifts: tuple[RmfLift, ...]
    rules: RmfRules


def rmf_lift(state: LiftState, about: LiftDescription) -> RmfLift:
    """Return a lift as it is published."""
    return RmfLift(
        lift=state.lift,
        name=about.rmf_name or state.lift,
        floors={floor: about.rmf_floors.get(floor, floor) for floor in state.floors},
        live=state.quality is Quality.LIVE,
        reason=state.reason,
        age_s=state.age_s,
        max_age_s=about.able.max_age_s,
        floor=state.floor,
        standing=state.standing,
        destination=state.destination,
        door=state.robot_door,
        motion=state.motion,
        mode=state.mode,
        robot_mode_on=state.permissions.get("robot_mode_on"),
        holder=state.holder,
        ending=state.ending,
        fire_latched=state.restrictions.fire_latched,
        waiting_for=state.restrictions.waiting_for,
        keeps_off=_keeps_off(state.restrictions),
    )


def _keeps_off(told: Restrictions) -> str:
    words = (
        f"locked out {told.lockout}" if told.lockout else "",
        f"no new session begins: drain {told.drain}" if told.drain else "",
        f"a robot of {told.maybe_aboard} may be in the car" if told.maybe_aboard is not None else "",
        f"its signals are distrusted: {told.distrusted}" if told.distrusted else "",
    )
    return "; ".join(word for word in words if word)
