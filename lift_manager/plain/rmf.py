"""What the manager says to an adapter (`GET /api/v1/rmf`), as plain values. The same whether it is asked over HTTP or in its own process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar


@dataclass(frozen=True)
class HeldBy:
    """Who holds a lift."""

    face: str
    name: str
    """With the face `rmf`: the session id of RMF."""
    adapter: str = ""
    """With the face `rmf`: the id of the adapter that opened it."""

    def __str__(self) -> str:
        return f"{self.face}:{self.name}@{self.adapter}" if self.adapter else f"{self.face}:{self.name}"


@dataclass(frozen=True)
class LiftView:
    """One lift of the manager at the moment it was asked."""

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
    """Of its last reading at that moment; None when there never was one."""
    max_age_s: float
    floor: str | None
    """In the site's words, like `destination`."""
    standing: bool
    destination: str | None
    door: str
    """The one word for robots: `open`, `moving` or `closed`."""
    motion: str
    """A word of `register_maps.words.Motion`."""
    mode: str
    """A word of `register_maps.words.Mode`."""
    robot_mode_on: bool | None
    """None where the lift has no such signal."""
    holder: HeldBy | None
    ending: bool
    """The holder has ended its session: it is over, and door and robot mode stay for the grace."""
    fire_latched: bool
    """There was a fire, and no person has acknowledged it."""
    waiting_for: str
    """What the session waits for before anything is pressed."""
    keeps_off: str
    """Why robots are kept off (lockout, a robot that may be in the car); empty when they are not."""


@dataclass(frozen=True)
class Alarms:
    """What of a fire is told to RMF: nothing where the site does not say so."""

    fire_alarm: bool = False
    """Publish `fire_alarm_trigger`."""
    emergency_signal: bool = False
    """Publish `emergency_signal` as well (kilted and later)."""
    emergency_fleets: tuple[str, ...] = ()
    """The fleets that the signal names."""
    clear_on_acknowledge: bool = False
    """Publish one `false` once a person has acknowledged."""


@dataclass(frozen=True)
class Site:
    """The manager's whole answer."""

    boot: str
    """Another one after each start of the manager."""
    event: int
    """All events up to this number are in it; numbers compare within one boot."""
    lifts: tuple[LiftView, ...]
    end_grace_s: float
    """How long door hold and robot mode stay after END_SESSION."""
    alarms: Alarms = field(default_factory=Alarms)


class BadAnswer(ValueError):
    """What was read is no answer of a manager; the message says what is wrong with it."""


def site_of(said: object) -> Site:
    """Read what JSON made of an answer; what it says beyond a Site is passed over. Raises BadAnswer."""
    site = _Said.of(said, "the answer")
    alarms = site.part("alarms")
    return Site(
        boot=site.text("boot"),
        event=site.count("event"),
        lifts=tuple(_lift(_Said.of(each, f"lifts[{number}]")) for number, each in enumerate(site.each("lifts"))),
        end_grace_s=site.seconds("end_grace_s"),
        alarms=Alarms(
            fire_alarm=alarms.flag("fire_alarm"),
            emergency_signal=alarms.flag("emergency_signal"),
            emergency_fleets=tuple(
                _text(fleet, f"{alarms.at}.emergency_fleets") for fleet in alarms.each("emergency_fleets")
            ),
            clear_on_acknowledge=alarms.flag("clear_on_acknowledge"),
        ),
    )


def decision_of(said: object) -> tuple[str, int]:
    """Read `boot` and `event` of the answer yes to what an adapter asks. Raises BadAnswer."""
    decision = _Said.of(said, "the answer")
    return decision.text("boot"), decision.count("event")


def _lift(said: _Said) -> LiftView:
    return LiftView(
        lift=said.text("lift"),
        name=said.text("name"),
        floors=said.texts("floors"),
        live=said.flag("live"),
        reason=said.text("reason"),
        age_s=said.maybe("age_s", _seconds),
        max_age_s=said.seconds("max_age_s"),
        floor=said.maybe("floor", _text),
        standing=said.flag("standing"),
        destination=said.maybe("destination", _text),
        door=said.text("door"),
        motion=said.text("motion"),
        mode=said.text("mode"),
        robot_mode_on=said.maybe("robot_mode_on", _flag),
        holder=said.maybe("holder", _holder),
        ending=said.flag("ending"),
        fire_latched=said.flag("fire_latched"),
        waiting_for=said.text("waiting_for"),
        keeps_off=said.text("keeps_off"),
    )


def _holder(value: object, at: str) -> HeldBy:
    said = _Said.of(value, at)
    # a manager from before adapters had ids does not have it
    return HeldBy(said.text("face"), said.text("name"), said.text("adapter") if "adapter" in said.values else "")


Value = TypeVar("Value")


@dataclass(frozen=True)
class _Said:
    """An object of the answer, and where in it."""

    values: Mapping[str, object]
    at: str

    @classmethod
    def of(cls, value: object, at: str) -> _Said:
        if not isinstance(value, dict):
            raise BadAnswer(f"{at} is {_shown(value)} and no object")
        return cls(value, at)

    def part(self, key: str) -> _Said:
        return _Said.of(self._value(key), f"{self.at}.{key}")

    def each(self, key: str) -> list[object]:
        value = self._value(key)
        if not isinstance(value, list):
            raise BadAnswer(f"{self.at}.{key} is {_shown(value)} and no list")
        return value

    def texts(self, key: str) -> dict[str, str]:
        part = self.part(key)
        return {name: _text(value, f"{part.at}.{name}") for name, value in part.values.items()}

    def text(self, key: str) -> str:
        return self._read(key, _text)

    def flag(self, key: str) -> bool:
        return self._read(key, _flag)

    def seconds(self, key: str) -> float:
        return self._read(key, _seconds)

    def count(self, key: str) -> int:
        return self._read(key, _count)

    def maybe(self, key: str, read: Callable[[object, str], Value]) -> Value | None:
        return None if self._value(key) is None else self._read(key, read)

    def _read(self, key: str, read: Callable[[object, str], Value]) -> Value:
        return read(self._value(key), f"{self.at}.{key}")

    def _value(self, key: str) -> object:
        if key not in self.values:
            raise BadAnswer(f"{self.at} lacks `{key}`")
        return self.values[key]


def _text(value: object, at: str) -> str:
    if not isinstance(value, str):
        raise BadAnswer(f"{at} is {_shown(value)} and no text")
    return value


def _flag(value: object, at: str) -> bool:
    if not isinstance(value, bool):
        raise BadAnswer(f"{at} is {_shown(value)}, neither true nor false")
    return value


def _seconds(value: object, at: str) -> float:
    # Python's JSON reads NaN and Infinity, which are no JSON; and a reading of a negative age would be fresh for too long
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < _LONGEST_S:
        raise BadAnswer(f"{at} is {_shown(value)} and no number of seconds")
    return float(value)


def _count(value: object, at: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < _COUNTS:
        raise BadAnswer(f"{at} is {_shown(value)} and no whole number")
    return value


_COUNTS = 2**63
_LONGEST_S = 1e12
"""Chosen: no time that means anything is longer."""


_KINDS: tuple[tuple[type, str], ...] = ((str, "text"), (list, "a list"), (dict, "an object"), (type(None), "null"))


def _shown(value: object) -> str:
    """What stands there instead; its text may be anything, a key that was sent back included."""
    return next((word for kind, word in _KINDS if isinstance(value, kind)), f"{value!r:.40}")
