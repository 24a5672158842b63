"""Every reason why a lift may not be commanded now.

The same few inhibits are checked three times: when a request is admitted, when a step decides to press, and by `blocked_by`
immediately before the bytes of a press or a refresh leave. A release is never checked: nothing may forbid it.
"""

from __future__ import annotations

from datetime import datetime

from drivers.model import Capabilities, Command, CommandKind, FloorName, LiftValues, PressId
from lift_manager.lift.call import call_command
from lift_manager.lift.config import ROBOT_IN_PLACE, LiftConfig
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.freshness import age_s, fresh
from lift_manager.lift.modes import is_on_fire, robots_forbidden, unreadable_fire_signal
from lift_manager.lift.observation import Moment, doubt_at
from lift_manager.lift.occupancy import Occupancy, occupancy_matters
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.refusals import (
    Blocking,
    Refusal,
    Refused,
    how_to_acknowledge,
    how_to_end_drain,
    how_to_end_lockout,
)
from lift_manager.lift.session import Holder, Session
from register_maps.vocabulary import CALLS

_CALLS_OF_EMPTY_CAR = frozenset(CALLS) - {CommandKind.GO}
_TOO_OLD = "the last reading is too old"
_DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")


_DECIDING_FLAGS = (
    ("robots_allowed", True, "its key switch does not allow robots"),
    ("ready", True, "it is not ready"),
    ("watchdog_tripped", False, "its module watchdog has tripped, so its outputs are not ours"),
)
"""Flags that decide whether robots may command the lift: the value that permits them, and the reason given for the other one."""


# -- immediately before the bytes leave


def blocked_by(
    config: LiftConfig, record: LiftRecord, command: Command, press_id: PressId | None, moment: Moment
) -> str | None:
    """Return what forbids the bytes of this press now; of a hold or its refresh if `press_id` is None.

    It is called for every output that a write asserts, with nothing awaited between the reply and the write.
    """
    session = record.session
    pending = next((one for one in record.presses if one.id == press_id), None)
    if press_id is not None and pending is None:
        return "nobody requests it any more"
    if command.kind is CommandKind.ROBOT_LEFT:
        return why_no_robot_left(config, record, moment)
    if pending is not None and session is not None:
        if pending.session != session.number:
            return "the session that requested it has ended"
        if (end := session.end) is not None:
            return f"the session is over: {end.text}" if end.is_announced else f"{session.holder} has ended its session"
    if command.kind is CommandKind.ROBOT_MODE:
        return why_no_robot_mode(config, record, moment)
    if session is None:
        # what stays on after a session until the lift knows that the robot left
        owed = record.robot_left.is_pending and pending is None
        return why_no_robot_left(config, record, moment) if owed else "the session has ended"
    why_not = why_no_press(config, record, moment)
    if command.kind is CommandKind.CLOSE_DOOR and why_not is None:
        return why_no_close(config, record, moment, hold_door=session.hold_door)
    return why_not


# -- what forbids a press, a hold and a report, whoever wants them


def why_no_press(config: LiftConfig, record: LiftRecord, moment: Moment) -> str | None:
    """Return why nothing may be pressed or held now.

    A lockout releases what is held for a session only at the end that was announced with it.
    """
    observation = fresh(config, record, moment)
    if observation is None:
        return _TOO_OLD
    if record.durable.fire_since is not None:
        return "there was a fire"
    lockout = record.restriction(RestrictionKind.LOCKOUT)
    if lockout is not None and not (record.session is not None and record.session.end_is_announced):
        return f"it is locked out {restriction_text(record, RestrictionKind.LOCKOUT, moment)}"
    return barred_by(observation.values, config.capabilities)


def barred_by(values: LiftValues, capabilities: Capabilities) -> str | None:
    """Return why no robot may command the lift now, by its own signals; None when one may."""
    if robots_forbidden(values.mode):
        return f"its mode is {values.mode}"
    for flag, lets, otherwise in _DECIDING_FLAGS:
        value = values.flags.get(flag)
        if value is not None and value is not lets:
            return otherwise
        if value is None and flag in capabilities.signals:
            raw = f" reads {values.unknown[flag]}, which its map does not list" if flag in values.unknown else ""
            return f"its signal {flag}{raw or ' cannot be read'}; check its wiring and its entry in the map"
    if capabilities.watched and values.watchdog_s == 0:
        return "the module watchdog is switched off: nothing would release the door if this manager were lost"
    return None


def why_no_robot_mode(config: LiftConfig, record: LiftRecord, moment: Moment) -> str | None:
    """Return why robot mode may not be pressed or renewed; a lockout does not drop it while the car is under way."""
    session = record.session
    if session is not None and not session.end_is_announced and record.robot_mode.kept_until is None:
        return why_no_press(config, record, moment)
    observation = fresh(config, record, moment)
    if observation is None:
        return _TOO_OLD
    if record.durable.fire_since is not None:
        return "there was a fire"
    return barred_by(observation.values, config.capabilities)


def why_no_robot_left(config: LiftConfig, record: LiftRecord, moment: Moment) -> str | None:
    """Return why a report that a robot left may not be pressed; that its session is over is no reason."""
    return "the manager is stopping" if record.is_stopping else why_no_press(config, record, moment)


def why_no_close(config: LiftConfig, record: LiftRecord, moment: Moment, *, hold_door: bool) -> str | None:
    """Return why the close button may not be pressed now."""
    session, observation = record.session, fresh(config, record, moment)
    if session is None or session.floor is None or observation is None:
        return "nobody knows where the car stands"
    floor = session.floor
    if not (record.call_has_arrived and observation.floor == floor and observation.is_standing):
        return f"the car does not stand at {floor} for this session"
    if record.boarding.reported is Occupancy.MAY_BOARD:
        return "the robot may be in the doorway; send robot_in_place or robot_left first"
    return "the door is to be held" if hold_door else None


def people_have_their_turn(record: LiftRecord, moment: Moment) -> bool:
    """Whether it is the turn of people, between two robots."""
    return moment.now < record.people_until


def waits_for(config: LiftConfig, record: LiftRecord, moment: Moment) -> str:
    """Return what the session waits for before anything is pressed; empty when it does not."""
    session = record.session
    if session is None:
        return ""
    if record.disk_trouble and not (record.call is not None and record.call.was_pressed):
        return f"the disk: {record.disk_trouble}"
    if people_have_their_turn(record, moment):
        return f"people, whose turn it is for {config.between_sessions_s:g} s after each robot"
    if record.waiting_for:
        return record.waiting_for
    if record.repeats_robot_left and record.robot_left.is_late:
        return f"the lift to take robot_left for the robot before; {repeated_text(config.name)}"
    return doubt_at(record.observation, session.floor)


# -- what refuses a request


def command_refusal(config: LiftConfig, record: LiftRecord, moment: Moment, *, goes_on: bool) -> Refused | None:
    """Return why a request may not command the lift now.

    `goes_on` means that its robot has begun already: it has to get out at any hour.
    """
    name, observation = config.name, fresh(config, record, moment)
    refused = locked_out(config, record, moment) or never_called(config)
    if refused is not None:
        return refused
    if observation is None:
        return Refused(Refusal.OFFLINE, offline_text(config, record, moment))
    if record.durable.fire_since is not None:
        return _after_fire(config, record, record.durable.fire_since, moment)
    if (why_not := barred_by(observation.values, config.capabilities)) is not None:
        return Refused(Refusal.MODE, f"{name} takes no robots now: {why_not}")
    return None if goes_on else draining(config, record, moment) or _outside_hours(config, moment)


def never_called(config: LiftConfig) -> Refused | None:
    """Refuse a lift that is never called, by its site or by its map."""
    name = config.name
    if not config.control:
        return Refused(Refusal.MONITOR_ONLY, f"{name} is only watched: its site file does not say `access: control`")
    if not config.capabilities.commands.intersection(_CALLS_OF_EMPTY_CAR):
        text = f"{name} cannot be called: its map {config.capabilities.map_name} has neither go_to nor call"
        return Refused(Refusal.NOT_POSSIBLE, text)
    return None


def unknown_floor(config: LiftConfig, floor: FloorName) -> Refused | None:
    """Refuse a floor that the lift does not have."""
    if floor in config.floors:
        return None
    text = f"{config.name} has no floor {floor!r}; its floors are {', '.join(config.floors)}"
    return Refused(Refusal.UNKNOWN_FLOOR, text)


def unreachable_floor(config: LiftConfig, floor: FloorName, *, aboard: bool) -> Refused | None:
    """Refuse a floor to which no command of the map brings the car; `aboard` means that it is the occupied one."""
    if call_command(config, floor, aboard=aboard) is not None or (aboard and config.has(ROBOT_IN_PLACE)):
        return None
    car = "the occupied car" if aboard else "the car"
    text = f"{config.name}: its map {config.capabilities.map_name} has no command that brings {car} to {floor}"
    return Refused(Refusal.NOT_POSSIBLE, text)


def locked_out(config: LiftConfig, record: LiftRecord, moment: Moment) -> Refused | None:
    """Refuse a request while a person keeps robots off."""
    shown = restriction_text(record, RestrictionKind.LOCKOUT, moment)
    if not shown:
        return None
    text = f"{config.name} is locked out {shown}; a person ends it with {how_to_end_lockout(config.name)}"
    return Refused(Refusal.LOCKED_OUT, text)


def draining(config: LiftConfig, record: LiftRecord, moment: Moment) -> Refused | None:
    """Refuse a new session during a drain."""
    shown = restriction_text(record, RestrictionKind.DRAIN, moment)
    if not shown:
        return None
    name = config.name
    text = f"no new session begins on {name}: drain {shown}; a person ends it with {how_to_end_drain(name)}"
    return Refused(Refusal.DRAINING, text)


def not_recorded(config: LiftConfig, record: LiftRecord, moment: Moment) -> Refused | None:
    """Refuse to begin while nothing can be recorded. A session under way keeps the lift: its robot may be in the car."""
    if not record.disk_trouble or record.session is not None:
        return None
    text = f"{config.name} takes no robots now: {record.disk_trouble}"
    return locked_out(config, record, moment) or Refused(Refusal.NOT_RECORDED, text)


def over_soon(session: Session | None, moment: Moment) -> Refused | None:
    """Refuse the requests of a holder whose session is about to end; a release is none of them."""
    if session is None or session.end is None or not session.end.is_announced:
        return None
    text = f"the session ends in {max(0.0, session.end.at - moment.now):.0f} s: {session.end.text}"
    return Refused(Refusal.SESSION_OVER, text)


def held_by_another(session: Session, moment: Moment) -> Refused:
    """Refuse everybody but the holder."""
    since_s = moment.now - session.opened_at
    blocking = Blocking(holder=session.holder, since_s=since_s)
    return Refused(Refusal.HELD, f"held by {session.holder} since {since_s:.0f} s", blocking)


def robot_of_another(config: LiftConfig, record: LiftRecord, caller: Holder) -> Refused | None:
    """Refuse the lift to a caller while a robot of another one may be in its car without a session."""
    if (holder := record.abandoned_by) in (None, caller):
        return None
    person = person_looks_text(config.name)
    text = f"a robot of {holder} may still be aboard; {holder} must send another request, or {person}"
    return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{config.name}: {text}", Blocking(holder=holder))


def robot_words_needed(config: LiftConfig) -> Refused | None:
    """Refuse a caller that cannot report its robot where the lift needs that: its robot would ride in, and be taken nowhere."""
    if not occupancy_matters(config.capabilities) or config.infer_occupancy:
        return None
    why = "has to learn when a robot is in place, and this caller cannot report that; set `infer_occupancy: true`"
    return Refused(Refusal.NOT_POSSIBLE, f"{config.name} {why} in the site file, if its requests may count as a report")


def too_early_to_acknowledge(config: LiftConfig, record: LiftRecord, moment: Moment) -> Refused | None:
    """Refuse an acknowledgement while an alarm may go on: nobody can have checked the lift yet."""
    name, observation = config.name, fresh(config, record, moment)
    unsure = "the alarm may still be on, so nothing is acknowledged until its signal is read again"
    if observation is None:
        return Refused(Refusal.OFFLINE, f"{offline_text(config, record, moment)}; {unsure}")
    values = observation.values
    if is_on_fire(values) or record.fire_release_at is not None:
        text = f"{name} still reports a fire; acknowledge it once the alarm is over and the lift has been checked"
        return Refused(Refusal.FIRE_ACTIVE, text)
    signal = unreadable_fire_signal(values, config.capabilities)
    if signal is None or record.durable.fire_since is None:
        return None
    listed = signal not in values.unknown
    raw = " cannot be read" if listed else f" reads {values.unknown[signal]}, which its map does not list"
    return Refused(Refusal.FIRE_ACTIVE, f"the signal {signal} of {name}{raw}; {unsure}")


def blocking_values(config: LiftConfig, record: LiftRecord, refused: Refused, moment: Moment) -> Refused:
    """Add what stands in the way, as values, to a refusal that does not contain it yet."""
    if refused.blocking is not None:
        return refused
    if refused.code is Refusal.OFFLINE:
        return Refused(refused.code, refused.message, Blocking(age_s=age_s(record, moment)))
    observation = fresh(config, record, moment)
    if refused.code not in (Refusal.MODE, Refusal.FIRE_LATCHED, Refusal.FIRE_ACTIVE) or observation is None:
        return refused
    since_s = max(0.0, moment.now - observation.mode_since)
    fire_since = record.durable.fire_since
    if refused.code is Refusal.FIRE_LATCHED and fire_since is not None:
        since_s = max(0.0, (moment.clock - fire_since).total_seconds())
    return Refused(refused.code, refused.message, Blocking(mode=observation.values.mode, since_s=since_s))


# -- in words


def offline_reason(config: LiftConfig, record: LiftRecord) -> str:
    """Return why the lift is offline, if it is."""
    why = record.fault or f"{config.source} has not answered since"
    return f"nothing newer within {config.capabilities.max_age_s:g} s: {why}"


def offline_text(config: LiftConfig, record: LiftRecord, moment: Moment) -> str:
    """Return why the lift is offline and since when."""
    age = age_s(record, moment)
    since = "never read yet" if age is None else f"last reading {age:.1f} s ago"
    return f"{config.name} is offline, {since}: {offline_reason(config, record)}"


def restriction_text(record: LiftRecord, kind: RestrictionKind, moment: Moment) -> str:
    """Return who keeps robots off, since when and why; empty when nobody does."""
    one = record.restriction(kind)
    return "" if one is None else f"by {one.by} since {clock_text(one.since, moment)}: {one.reason}"


def clock_text(at: datetime, moment: Moment) -> str:
    """Return a time as the clock of the building shows it."""
    return f"{at.astimezone(moment.clock.tzinfo):%Y-%m-%d %H:%M}"


def person_looks_text(lift: str) -> str:
    """Return what ends a doubt about a robot in the car."""
    return f"a person must look into the car and acknowledge that: {how_to_acknowledge(lift)}"


def repeated_text(lift: str) -> str:
    """Return what happens with a report that the lift has not taken."""
    return f"it is given again until it is taken, or until a person has seen to the lift: {how_to_acknowledge(lift)}"


def _after_fire(config: LiftConfig, record: LiftRecord, since: datetime, moment: Moment) -> Refused:
    occupied, name = record.durable.occupied, config.name
    robot = "" if occupied is None else f" look for a robot of {occupied.holder} in its car, and"
    text = (
        f"{name} was in fire service ({clock_text(since, moment)}); a person must check it, and{robot} acknowledge that once the"
        f" alarm is over: {how_to_acknowledge(name)}"
    )
    return Refused(Refusal.FIRE_LATCHED, text)


def _outside_hours(config: LiftConfig, moment: Moment) -> Refused | None:
    hours, clock = config.robot_hours, moment.clock
    if hours is None or hours.now_open(clock):
        return None
    text = (
        f"{config.name} takes robots {hours}, and here it is {_DAYS[clock.weekday()]} {clock:%H:%M};"
        f" robots may begin again {hours.next_begin(clock)}"
    )
    return Refused(Refusal.OUTSIDE_HOURS, text)
