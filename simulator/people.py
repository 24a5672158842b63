"""Passengers: they come, press, walk in and out, hold doors and press the wrong button, as a seed has it. Pure.

Nobody here reads a clock. `act` is handed the time and what the lift shows, and returns what people press and block from then
on. Who comes, when, and with which habits follows from the seed alone; what becomes of them depends on the lift.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum, unique
from math import inf
from random import Random

from register_maps.words import Door, Mode, Side
from simulator.state import Inputs, ShownState


@dataclass(frozen=True, slots=True)
class Traffic:
    """How many people come, and how they behave. Shares lie between 0 and 1; seconds are real."""

    per_minute: float = 3.0
    """People who come to any floor. Chosen: a small office house in the morning, so that a minute has some of them."""
    from_lowest: float = 0.5
    """Share who come in at the lowest floor. Chosen: half of all trips begin at the entrance."""
    to_lowest: float = 0.6
    """Share of all others who leave by the lowest floor. Chosen: most go home or to lunch, some to a meeting upstairs."""
    load: int = 8
    """People for whom the car has room. Chosen: a car of 630 kg."""
    patience_s: float = 120.0
    """Who has waited so long takes the stairs, and who has ridden so long gets out wherever a door opens. Chosen."""
    reacts_s: float = 0.8
    """From the open door to the first step. Chosen: below any dwell time at normal speed."""
    walks_s: float = 1.2
    """In the doorway, in the light curtain. Chosen: a step and a bag."""
    press_s: float = 0.5
    """A finger on a button. Chosen: some scans of any controller."""
    again_s: float = 6.0
    """A button whose lamp is not lit is pressed again after so long. Chosen."""
    holders: float = 0.08
    """Share who hold the door for somebody once they are in. Chosen: often enough to meet robots."""
    hold_s: float = 10.0
    """How long they do. Chosen: three dwell times."""
    wrong_button: float = 0.05
    """Share who press another floor first. Chosen."""
    all_buttons: float = 0.02
    """Share who press every floor: children. Chosen."""
    bold: float = 0.1
    """Share who get into a car that is in robot mode. Chosen: signs are read by most."""
    heavy: float = 0.02
    """Share whose load is too much for the car: they notice the overload signal and take the stairs. Chosen."""
    overload_s: float = 3.0
    """How long too much load stands in the doorway: the load of the heavy, or one more than there is room for. Chosen."""
    looks_s: float = 0.25
    """How often people look at the lift. Chosen: as fast as anybody reacts."""

    def __post_init__(self) -> None:
        if self.per_minute <= 0 or self.load < 1 or self.looks_s <= 0:
            raise ValueError(
                "traffic needs somebody who comes, room for one in the car, and a look at the lift now and then"
            )


@dataclass(frozen=True, slots=True)
class Counts:
    """Where everybody is who has come so far."""

    waiting: int
    riding: int
    delivered: int
    """Got out at their floor."""
    given_up: int
    """Took the stairs: after waiting too long, after getting out elsewhere, or with too much to carry."""

    @property
    def come(self) -> int:
        return self.waiting + self.riding + self.delivered + self.given_up


@unique
class _Walk(StrEnum):
    IN = "in"
    OUT = "out"
    OVERLOADS = "overloads"
    """Stands in the doorway with too much load, and steps back."""


@dataclass(slots=True)
class _Person:
    comes_at: float
    at: int
    to: int
    first: frozenset[int]
    """Buttons pressed by mistake, or for fun, before the right one."""
    holds: bool
    pushes: bool
    """Holds the door by its button rather than by standing in it."""
    bold: bool
    heavy: bool
    rides: bool = False
    rides_since: float = 0.0
    walks: _Walk | None = None
    walks_until: float = 0.0
    side: Side = Side.FRONT
    presses: frozenset[int] = frozenset()
    presses_until: float = 0.0
    presses_next: float = 0.0
    holds_until: float = 0.0


@dataclass(slots=True)
class People:
    """All the people who use one lift. Stateful: hand in every `act` in the order of time.

    The first `act` is when they begin to come. Raises ValueError for a lift with fewer than two floors.
    """

    seed: int
    floors: int
    traffic: Traffic = field(default_factory=Traffic)
    next_at: float = field(default=0.0, init=False)
    """When `act` is due again; a later call does no harm."""
    _random: Random = field(init=False, repr=False)
    _next: _Person | None = field(default=None, init=False, repr=False)
    _here: list[_Person] = field(default_factory=list, init=False, repr=False)
    _delivered: int = field(default=0, init=False, repr=False)
    _given_up: int = field(default=0, init=False, repr=False)
    _opened: tuple[int | None, float] = field(default=(None, 0.0), init=False, repr=False)
    """Floor at which the car stands open, and since when."""
    _complained_at: float = field(default=-1.0, init=False, repr=False)
    """When the doors opened before one too many tried to get in: nobody tries again before the next time."""
    _own_inputs: Inputs = field(default_factory=Inputs, init=False, repr=False)
    """What people press and block by now."""

    def __post_init__(self) -> None:
        if self.floors < 2:
            raise ValueError(f"nobody rides between {self.floors} floors: a lift has two or more")
        self._random = Random(self.seed)

    @property
    def counts(self) -> Counts:
        riding = sum(person.rides for person in self._here)
        return Counts(len(self._here) - riding, riding, self._delivered, self._given_up)

    def act(self, now: float, picture: ShownState, inputs: Inputs) -> Inputs:
        """Return the inputs with what people do from `now` on; what others do at them stays."""
        self._come(now)
        if picture.door_open_floor != self._opened[0]:
            self._opened = (picture.door_open_floor, now)
        for person in tuple(self._here):
            self._finish_walk(person, now, picture)
        for person in tuple(self._here):
            if not person.rides and person.walks is None and now >= person.comes_at + self.traffic.patience_s:
                self._give_up(person)
        self._start_walk(now, picture)
        for person in self._here:
            self._press(person, now, picture)
        own_inputs = self._doing(now)
        inputs, self._own_inputs = _exchanged(inputs, self._own_inputs, own_inputs), own_inputs
        self.next_at = now + self.traffic.looks_s if self._here else self._next_comes_at
        return inputs

    # -- coming and going

    @property
    def _next_comes_at(self) -> float:
        return inf if self._next is None else self._next.comes_at

    def _come(self, now: float) -> None:
        if self._next is None:
            self._next = self._draw(now)
        while self._next.comes_at <= now:
            self._here.append(self._next)
            self._next = self._draw(self._next.comes_at)

    def _draw(self, after: float) -> _Person:
        """Draw the next person; every draw is made for everybody, so that one habit never changes who comes next."""
        random, traffic = self._random, self.traffic
        comes_at = after + random.expovariate(traffic.per_minute / 60)
        upper, other = random.randrange(1, self.floors), random.randrange(self.floors - 1)
        at = 0 if random.random() < traffic.from_lowest else upper
        leaves = random.random() < traffic.to_lowest
        to = 0 if at and leaves else other + (other >= at)
        wrong, every = random.random() < traffic.wrong_button, random.random() < traffic.all_buttons
        first = frozenset(range(self.floors)) if every else frozenset({random.randrange(self.floors)})
        return _Person(
            comes_at=comes_at,
            at=at,
            to=to,
            first=first if wrong or every else frozenset(),
            holds=random.random() < traffic.holders,
            pushes=random.random() < 0.5,
            bold=random.random() < traffic.bold,
            heavy=random.random() < traffic.heavy,
        )

    def _give_up(self, person: _Person) -> None:
        self._here.remove(person)
        self._given_up += 1

    # -- walking

    @property
    def _is_full(self) -> bool:
        return sum(person.rides for person in self._here) >= self.traffic.load

    def _start_walk(self, now: float, picture: ShownState) -> None:
        """One person at a time goes through the doors, those who get out first."""
        floor, since = self._opened
        if floor is None or now < since + self.traffic.reacts_s or any(person.walks for person in self._here):
            return
        in_service = picture.mode in (Mode.NORMAL, Mode.ROBOT)
        for person in self._here:
            tired = now >= person.rides_since + self.traffic.patience_s
            if person.rides and (person.to == floor or tired or not in_service):
                self._set_out(person, _Walk.OUT, now, picture)
                return
        full = self._is_full
        for person in self._here:
            may_enter = picture.mode is Mode.NORMAL or (picture.mode is Mode.ROBOT and person.bold)
            if person.rides or person.at != floor or not may_enter or (full and self._complained_at == since):
                continue
            if full:
                self._complained_at = since
            self._set_out(person, _Walk.OVERLOADS if full or person.heavy else _Walk.IN, now, picture)
            return

    def _set_out(self, person: _Person, walk: _Walk, now: float, picture: ShownState) -> None:
        person.walks = walk
        person.walks_until = now + (self.traffic.overload_s if walk is _Walk.OVERLOADS else self.traffic.walks_s)
        person.side = next((side for side in Side if picture.doors.get(side) is Door.OPEN), Side.FRONT)
        person.presses = frozenset()

    def _finish_walk(self, person: _Person, now: float, picture: ShownState) -> None:
        if person.walks is None or now < person.walks_until:
            return
        walk, person.walks = person.walks, None
        if walk is _Walk.OVERLOADS:
            if person.heavy:
                self._give_up(person)
        elif picture.doors.get(person.side, Door.CLOSED) is Door.CLOSED:
            return  # the door has shut in front of them
        elif walk is _Walk.IN:
            person.rides, person.rides_since, person.presses_next = True, now, now
            person.holds_until = now + self.traffic.hold_s if person.holds else 0.0
        elif picture.floor == person.to:
            self._here.remove(person)
            self._delivered += 1
        else:
            self._give_up(person)

    # -- buttons

    def _press(self, person: _Person, now: float, picture: ShownState) -> None:
        """Press what is not lit; a finger stays on a button for a while, and comes back if the lamp stays dark."""
        if person.presses:
            if now < person.presses_until:
                return
            person.presses = frozenset()
            if person.rides:
                person.first = frozenset()
        floor = person.to if person.rides else person.at
        lit = floor in (picture.car_calls if person.rides else picture.landing_calls)
        # nobody calls a full car back
        there = floor == picture.door_open_floor or (floor == picture.level_floor and self._is_full)
        mistaken = person.first if person.rides else frozenset()
        if person.walks or now < person.presses_next or not (mistaken or not (lit or there)):
            return
        person.presses = mistaken or frozenset({floor})
        person.presses_until = now + self.traffic.press_s
        person.presses_next = person.presses_until if mistaken else now + self.traffic.again_s

    def _doing(self, now: float) -> Inputs:
        """What everybody does together."""
        in_car, at_landing, pushed, blocked = set[int](), set[int](), set[Side](), set[Side]()
        for person in self._here:
            (in_car if person.rides else at_landing).update(person.presses)
            if person.walks:
                blocked.add(person.side)
            elif person.rides and now < person.holds_until and self._opened[0] == person.at:
                (pushed if person.pushes else blocked).add(person.side)
        return Inputs(
            car_buttons=frozenset(in_car),
            landing_buttons=frozenset(at_landing),
            hold_door=frozenset(pushed),
            obstruction=frozenset(blocked),
            overload=any(person.walks is _Walk.OVERLOADS for person in self._here),
        )


def _exchanged(inputs: Inputs, before: Inputs, after: Inputs) -> Inputs:
    """Take back what people did before, and put what they do."""
    return replace(
        inputs,
        car_buttons=inputs.car_buttons - before.car_buttons | after.car_buttons,
        landing_buttons=inputs.landing_buttons - before.landing_buttons | after.landing_buttons,
        hold_door=inputs.hold_door - before.hold_door | after.hold_door,
        obstruction=inputs.obstruction - before.obstruction | after.obstruction,
        overload=(inputs.overload and not before.overload) or after.overload,
    )
