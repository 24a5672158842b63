"""What the manager reports to an Open-RMF adapter (`GET /api/v1/rmf`), as plain values: the same over HTTP and in its own process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar


@dataclass(frozen=True)
class HeldBy:
    """The holder of a lift."""

    face: str
    name: str
    """With the face `rmf`: the session id of RMF."""
    adapter: str = ""
    """With the face `rmf`: the id of the adapter that opened it."""

    def __str__(self) -> str:
        return f"{self.face}:{self.name}@{self.adapter}" if self.adapter else f"{self.face}:{self.name}"


@dataclass(frozen=True)
class LiftView:
    """One lift of the manager at the moment of the answer."""

    lift: str
    """Its name in the site file."""
    name: str
    """Its name in RMF's building map."""
    floors: Mapping[str, str]
    """Site's floor name to RMF's, lowest first."""
    live: bool
    """False while its state may not be acted on."""
    reason: str
    """Why it is not live."""
    age_s: float | None
    """Age of its last reading at that moment; None before the first reading."""
    max_age_s: float
    floor: str | None
    """By the site's name, like `destination`."""
    standing: bool
    destination: str | None
    door: str
    """The door state for robots: `open`, `moving` or `closed`."""
    motion: str
    """A word of `register_maps.words.Motion`."""
    mode: str
    """A word of `register_maps.words.Mode`."""
    robot_mode_on: bool | None
    """None where the lift has no such signal."""
    holder: HeldBy | None
    ending: bool
    """The holder has ended its session; door hold and robot mode stay on for the grace period."""
    fire_latched: bool
    """There was a fire, and nobody has acknowledged it."""
    waiting_for: str
    """What the session waits for before a button is pressed."""
    keeps_off: str
    """Why robots are kept off (lockout, a robot that may be in the car); empty if they are not."""


@dataclass(frozen=True)
class Alarms:
    """How a fire is announced to RMF: not at all unless the site file says so."""

    fire_alarm: bool = False
    """Publish `fire_alarm_trigger`."""
    emergency_signal: bool = False
    """Publish `emergency_signal` as well (kilted and later)."""
    emergency_fleets: tuple[str, ...] = ()
    """The fleets that the signal names."""
    clear_on_acknowledge: bool = False
    """Publish `false` once after a person has acknowledged the fire."""


@dataclass(frozen=True)
class SiteView:
    """The manager's complete answer: every lift, and the rules of the site for RMF."""

    boot: str
    """Changes with each start of the manager."""
    event: int
    """The answer includes all events up to this number; numbers compare within one boot."""
    lifts: tuple[LiftView, ...]
    end_grace_s: float
    """How long door hold and robot mode stay on after END_SESSION."""
    alarms: Alarms = field(default_factory=Alarms)


@dataclass(frozen=True)
class PartialSiteView(SiteView):
    """An answer without the lifts that are as they were, so that news of one costs the same among a hundred. Never over HTTP."""

    def completed(self, before: SiteView) -> SiteView:
        """Return the complete answer that it makes of the one before."""
        news = {view.name: view for view in self.lifts}
        return replace(before, event=self.event, lifts=tuple(news.get(view.name, view) for view in before.lifts))


class BadAnswer(ValueError):
    """The input is not an answer of a manager; the message says what is wrong with it."""


def parse_site(data: object) -> SiteView:
    """Convert the JSON of an answer; unknown keys are ignored. Raises BadAnswer."""
    site = _JsonObject.of(data, "the answer")
    alarms = site.child("alarms")
    return SiteView(
        boot=site.text("boot"),
        event=site.count("event"),
        lifts=tuple(_lift(_JsonObject.of(item, f"lifts[{number}]")) for number, item in enumerate(site.items("lifts"))),
        end_grace_s=site.seconds("end_grace_s"),
        alarms=Alarms(
            fire_alarm=alarms.flag("fire_alarm"),
            emergency_signal=alarms.flag("emergency_signal"),
            emergency_fleets=tuple(
                _text(fleet, f"{alarms.at}.emergency_fleets") for fleet in alarms.items("emergency_fleets")
            ),
            clear_on_acknowledge=alarms.flag("clear_on_acknowledge"),
        ),
    )


def parse_decision(data: object) -> tuple[str, int]:
    """Return `boot` and `event` of the manager's answer to a request that it has accepted. Raises BadAnswer."""
    decision = _JsonObject.of(data, "the answer")
    return decision.text("boot"), decision.count("event")


def _lift(data: _JsonObject) -> LiftView:
    return LiftView(
        lift=data.text("lift"),
        name=data.text("name"),
        floors=data.texts("floors"),
        live=data.flag("live"),
        reason=data.text("reason"),
        age_s=data.optional("age_s", _seconds),
        max_age_s=data.seconds("max_age_s"),
        floor=data.optional("floor", _text),
        standing=data.flag("standing"),
        destination=data.optional("destination", _text),
        door=data.text("door"),
        motion=data.text("motion"),
        mode=data.text("mode"),
        robot_mode_on=data.optional("robot_mode_on", _flag),
        holder=data.optional("holder", _holder),
        ending=data.flag("ending"),
        fire_latched=data.flag("fire_latched"),
        waiting_for=data.text("waiting_for"),
        keeps_off=data.text("keeps_off"),
    )


def _holder(value: object, at: str) -> HeldBy:
    data = _JsonObject.of(value, at)
    # managers older than adapter ids leave it out
    return HeldBy(data.text("face"), data.text("name"), data.text("adapter") if "adapter" in data.values else "")


Value = TypeVar("Value")


@dataclass(frozen=True)
class _JsonObject:
    """An object of the answer, and its place there."""

    values: Mapping[str, object]
    at: str

    @classmethod
    def of(cls, value: object, at: str) -> _JsonObject:
        if not isinstance(value, dict):
            raise BadAnswer(f"{at} is {_describe(value)} and no object")
        return cls(value, at)

    def child(self, key: str) -> _JsonObject:
        return _JsonObject.of(self._value(key), f"{self.at}.{key}")

    def items(self, key: str) -> list[object]:
        value = self._value(key)
        if not isinstance(value, list):
            raise BadAnswer(f"{self.at}.{key} is {_describe(value)} and no list")
        return value

    def texts(self, key: str) -> dict[str, str]:
        child = self.child(key)
        return {name: _text(value, f"{child.at}.{name}") for name, value in child.values.items()}

    def text(self, key: str) -> str:
        return self._read(key, _text)

    def flag(self, key: str) -> bool:
        return self._read(key, _flag)

    def seconds(self, key: str) -> float:
        return self._read(key, _seconds)

    def count(self, key: str) -> int:
        return self._read(key, _count)

    def optional(self, key: str, read: Callable[[object, str], Value]) -> Value | None:
        return None if self._value(key) is None else self._read(key, read)

    def _read(self, key: str, read: Callable[[object, str], Value]) -> Value:
        return read(self._value(key), f"{self.at}.{key}")

    def _value(self, key: str) -> object:
        if key not in self.values:
            raise BadAnswer(f"{self.at} lacks `{key}`")
        return self.values[key]


def _text(value: object, at: str) -> str:
    if not isinstance(value, str):
        raise BadAnswer(f"{at} is {_describe(value)} and no text")
    return value


def _flag(value: object, at: str) -> bool:
    if not isinstance(value, bool):
        raise BadAnswer(f"{at} is {_describe(value)}, neither true nor false")
    return value


def _seconds(value: object, at: str) -> float:
    # Python's JSON parser accepts NaN and Infinity, which are not JSON; and a reading of a negative age would stay fresh for too long
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < _LONGEST_S:
        raise BadAnswer(f"{at} is {_describe(value)} and no number of seconds")
    return float(value)


def _count(value: object, at: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < _COUNTS:
        raise BadAnswer(f"{at} is {_describe(value)} and no whole number")
    return value


_COUNTS = 2**63
_LONGEST_S = 1e12
"""Chosen: longer than any meaningful duration."""


_JSON_TYPES: tuple[tuple[type, str], ...] = ((str, "text"), (list, "a list"), (dict, "an object"), (type(None), "null"))


def _describe(value: object) -> str:
    """Name the type of a wrong value, without its text: that may be a key that was sent back."""
    return next((word for kind, word in _JSON_TYPES if isinstance(value, kind)), f"{value!r:.40}")
