"""What a site file sets for Open-RMF, and a lift as RMF's adapter sees it. Values."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.lift.config import LiftConfig
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.plain.rmf import Alarms, HeldBy, LiftView

FACE = "rmf"
"""The face of every holder that RMF has: its name there is RMF's session id."""

_OF = "@"
"""Separates RMF's session id from the id of its adapter, which does not contain it."""
ADAPTER_ID = r"^[A-Za-z0-9._/-]*$"
"""What the id of an adapter is made of; empty for the only one."""
ADAPTER_ID_LIMIT = 300
"""Chosen: a domain and a namespace of ROS, which has 255 characters at most, fit."""

LONGEST_GRACE_S = 30.0
"""Chosen: people wait for a lift that nobody uses, and a supervisor that was restarted sends its first message within seconds."""


def rmf_holder(session: str, adapter: str) -> Holder:
    """Return the holder for a session of the RMF of an adapter. Two of them may have robots of the same name."""
    return Holder(FACE, f"{session}{_OF}{adapter}" if adapter or _OF in session else session)


def rmf_session(holder: Holder) -> tuple[str, str]:
    """Return session and adapter of such a holder."""
    session, found, adapter = holder.name.rpartition(_OF)
    return (session, adapter) if found else (holder.name, "")


@dataclass(frozen=True, slots=True, kw_only=True)
class RmfRules:
    """What the site file sets for RMF as a whole."""

    end_grace_s: float = 3.0
    """How long door hold and robot mode stay after END_SESSION. Chosen: a supervisor that was restarted ends every session that it
    finds, and the robot repeats its request within a second (open-rmf 1.6)."""
    fire_alarm: bool = False
    """Report a fire on `fire_alarm_trigger`."""
    emergency_signal: bool = False
    """And on `emergency_signal`, which kilted and later know."""
    emergency_fleets: tuple[str, ...] = ()
    """The fleets that this names."""
    clear_on_acknowledge: bool = False
    """Report once that it is over when a person has acknowledged."""


def rmf_alarms(rules: RmfRules) -> Alarms:
    """Return how a fire is announced."""
    return Alarms(
        fire_alarm=rules.fire_alarm,
        emergency_signal=rules.emergency_signal,
        emergency_fleets=rules.emergency_fleets,
        clear_on_acknowledge=rules.clear_on_acknowledge,
    )


def rmf_lift(state: LiftState, config: LiftConfig) -> LiftView:
    """Return a lift as an adapter sees it."""
    holder = state.holder
    return LiftView(
        lift=state.lift,
        name=config.rmf_name or state.lift,
        floors={floor: config.rmf_floors.get(floor, floor) for floor in state.floors},
        live=state.quality is Quality.LIVE,
        reason=state.reason,
        age_s=state.age_s,
        max_age_s=config.capabilities.max_age_s,
        floor=state.floor,
        standing=state.standing,
        destination=state.destination,
        door=state.robot_door.value,
        motion=state.motion.value,
        mode=state.mode.value,
        robot_mode_on=state.permissions.get("robot_mode_on"),
        holder=None if holder is None else _held_by(holder),
        ending=state.ending,
        fire_latched=state.restrictions.fire_latched,
        waiting_for=state.restrictions.waiting_for,
        keeps_off=_keeps_off(state.restrictions),
    )


def _held_by(holder: Holder) -> HeldBy:
    return HeldBy(FACE, *rmf_session(holder)) if holder.face == FACE else HeldBy(holder.face, holder.name)


def _keeps_off(restrictions: Restrictions) -> str:
    words = (
        f"locked out {restrictions.lockout}" if restrictions.lockout else "",
        f"no new session begins: drain {restrictions.drain}" if restrictions.drain else "",
        f"a robot of {restrictions.maybe_aboard} may be in the car" if restrictions.maybe_aboard is not None else "",
        f"its signals are distrusted: {restrictions.distrusted}" if restrictions.distrusted else "",
    )
    return "; ".join(word for word in words if word)
