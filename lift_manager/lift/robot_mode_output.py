"""When the lift's robot mode is requested and when it is dropped: never under way, except in fire."""

from __future__ import annotations

from dataclasses import replace

from lift_manager.lift.config import ROBOT_MODE, LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.inhibits import why_no_robot_left
from lift_manager.lift.observation import may_be_moving, robot_mode_granted
from lift_manager.lift.record import LiftRecord, RobotModeHold


def hold_robot_mode(draft: Draft, *, may_begin: bool) -> None:
    """Request robot mode, or keep it; only keep it where it may not begin."""
    if not draft.config.has(ROBOT_MODE):
        return
    mode, is_given = draft.record.robot_mode, draft.record.is_given(ROBOT_MODE)
    if not is_given:
        mode = replace(mode, was_pressed=False)
    if may_begin or is_given:
        mode = replace(mode, is_requested=True, may_begin=may_begin, renewed_at=draft.moment.read_at)
    draft.change(robot_mode=mode)


def drop_robot_mode(draft: Draft) -> None:
    """Release robot mode at once."""
    draft.change(robot_mode=RobotModeHold())


def keep_after_session(draft: Draft) -> None:
    """Keep robot mode from now on only for as long as a car may take to come to rest; drop it if it was not pressed yet."""
    until = kept_after(draft.config, draft.record, draft.now)
    if until is None:
        drop_robot_mode(draft)
    else:
        draft.change(robot_mode=replace(draft.record.robot_mode, kept_until=until, may_begin=False))


def kept_after(config: LiftConfig, record: LiftRecord, over_at: float) -> float | None:
    """Return until when robot mode would be kept at most if its session were over then; None if it would be dropped."""
    was_pressed = config.has(ROBOT_MODE) and record.robot_mode.was_pressed
    return over_at + config.capabilities.arrive_within_s if was_pressed else None


def settle(draft: Draft) -> None:
    """Drop robot mode after a session once the car stands still and the lift has taken every report.

    A car that never stands keeps it for a bounded time. While the lift cannot be read, its last reading decides; one that was
    never read may be under way.
    """
    config, record, last = draft.config, draft.record, draft.record.observation
    under_way = last is not None and may_be_moving(last) and robot_mode_granted(last, config.capabilities)
    until = record.robot_mode.kept_until
    if until is not None and draft.now < until and (last is None or under_way or _must_report(draft)):
        if draft.observation is not None:
            hold_robot_mode(draft, may_begin=False)
        return
    drop_robot_mode(draft)
    if until is not None and under_way:
        waited_s = config.capabilities.arrive_within_s
        draft.alarm(f"nobody has seen the car come to rest for {waited_s:g} s; robot mode is dropped")


def _must_report(draft: Draft) -> bool:
    """Whether the lift has still to learn that a robot left. It is not waited for where that may not be reported at all."""
    if not draft.record.robot_left.is_pending:
        return False
    # it may be reported later to a lift that cannot be read
    return draft.observation is None or why_no_robot_left(draft.config, draft.record, draft.moment) is None
