"""Modes of service: which one holds, what it serves, and when robot mode is granted. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum, unique
from types import MappingProxyType

from register_maps.words import Mode
from simulator.shaft import NEGLIGIBLE_S


@unique
class Key(StrEnum):
    """Position of the key switch."""

    NORMAL = "normal"
    INDEPENDENT = "independent"
    INSPECTION = "inspection"
    OUT_OF_SERVICE = "out_of_service"
    ROBOT = "robot"
    """Robot mode is requested for as long as the key is there."""


KEYS_BY_RANK = (Key.NORMAL, Key.ROBOT, Key.INDEPENDENT, Key.OUT_OF_SERVICE, Key.INSPECTION)
"""Of several key switches the last one that is turned sets the mode."""


@dataclass(frozen=True, slots=True)
class Service:
    """What a mode serves."""

    car_calls: bool = False
    landing_calls: bool = False
    door_buttons: bool = False
    """Whether the open and close buttons (and so a door hold) work."""


SERVICE: Mapping[Mode, Service] = MappingProxyType(
    {
        Mode.NORMAL: Service(car_calls=True, landing_calls=True, door_buttons=True),
        Mode.ROBOT: Service(car_calls=True, door_buttons=True),
        Mode.INDEPENDENT: Service(car_calls=True, door_buttons=True),
        # the open button still lets out people who were in the car when it was taken out of service
        Mode.OUT_OF_SERVICE: Service(door_buttons=True),
        Mode.EMERGENCY: Service(),
        Mode.FIRE: Service(),
        Mode.INSPECTION: Service(),
    }
)
"""The modes this controller has; it has no attendant mode."""


def overriding_mode(key: Key, *, fire: bool, emergency: bool, fault: bool) -> Mode | None:
    """The mode that goes before robot and normal, if one does; highest first."""
    if key is Key.INSPECTION:
        return Mode.INSPECTION
    if fire:
        return Mode.FIRE
    if emergency:
        return Mode.EMERGENCY
    if fault or key is Key.OUT_OF_SERVICE:
        return Mode.OUT_OF_SERVICE
    if key is Key.INDEPENDENT:
        return Mode.INDEPENDENT
    return None


@dataclass(frozen=True, slots=True)
class RobotGrant:
    """How far a request for robot mode has come."""

    granted: bool = False
    awaited: frozenset[int] | None = None
    """Calls that were there when robot mode was requested and are not served yet; None: not requested."""
    ready_s: float | None = None
    """Real seconds since nothing stood against the grant; None: something still does."""


NO_GRANT = RobotGrant()


def next_grant(
    grant: RobotGrant,
    *,
    standing: bool,
    car_calls: frozenset[int],
    landing_calls: frozenset[int],
    since_s: float,
    delay_s: float,
) -> RobotGrant:
    """One scan further with the request present; `since_s` after the last.

    People who called before the robot's request are served first, and so is everybody in the car: a car call made while
    waiting is waited for too. Landing calls made after the request are not, or a busy lobby would keep robots out.
    """
    if grant.granted:
        return grant
    calls = car_calls | landing_calls
    awaited = calls if grant.awaited is None else grant.awaited & calls
    if awaited or car_calls or not standing:
        return RobotGrant(awaited=awaited)
    ready_s = 0.0 if grant.ready_s is None else min(grant.ready_s + since_s, delay_s)
    if ready_s >= delay_s - NEGLIGIBLE_S:
        return RobotGrant(granted=True)
    return RobotGrant(awaited=awaited, ready_s=ready_s)


def after_request(grant: RobotGrant, *, standing: bool) -> RobotGrant:
    """One scan further without the request: a trip under way is finished in robot mode."""
    return grant if grant.granted and not standing else NO_GRANT
