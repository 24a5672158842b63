"""How old the newest reading may be for its lift to be known."""

from __future__ import annotations

from drivers.model import Capabilities
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import Moment, Observation
from lift_manager.lift.record import LiftRecord


def fresh_until(capabilities: Capabilities, read_at: float) -> float:
    """Return the time until which a reading is young enough."""
    return read_at + capabilities.max_age_s


def is_fresh(capabilities: Capabilities, moment: Moment) -> bool:
    """Whether the newest reading is young enough to act on and to publish."""
    return moment.now <= fresh_until(capabilities, moment.read_at)


def fresh(config: LiftConfig, record: LiftRecord, moment: Moment) -> Observation | None:
    """Return what is known of the lift, unless it is too old to act on."""
    return record.observation if is_fresh(config.capabilities, moment) else None


def age_s(record: LiftRecord, moment: Moment) -> float | None:
    """Return the age of the newest whole reading; None if there never was one."""
    return None if record.observation is None else max(0.0, moment.now - moment.read_at)
