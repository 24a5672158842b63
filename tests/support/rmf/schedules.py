"""What happens around one lift in a minute or two: drawn from a seed, and made smaller one event at a time. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from random import Random

from tests.support.rmf import events as happens
from tests.support.rmf.events import Event, Ride
from tests.support.rmf.supervisors import SUPERVISORS
from tests.support.rmf.world import Setting

MAPS = ("generic-registers", "generic-registers", "generic-coils", "seer-generic", "wago-750")
"""One with everything in words, one in coils, one of a vendor, and one whose inputs are all there is."""
FLOORS = 3
"""That every map above has."""
WITHIN_S = 15.0
"""In which everything begins."""
UNKNOWN_FLOOR = "the moon"


@dataclass(frozen=True)
class Schedule:
    """Everything that one seed stands for."""

    seed: int
    map: str
    setting: Setting
    events: tuple[Event, ...]

    def __str__(self) -> str:
        told = "\n    ".join(str(event) for event in self.events)
        return f"seed {self.seed}, {self.map}, {self.setting}\n    {told}"


def draw(seed: int) -> Schedule:
    """Return the schedule of a seed."""
    dice = Random(seed)  # a seed must replay, and nobody is to be kept from guessing
    setting = Setting(
        distribution=dice.choice(tuple(SUPERVISORS)),
        seed=seed,
        message_s=dice.choice((0.001, 0.005, 0.02)),
        way_s=dice.choice((0.0, 0.0, 0.005, 0.02)),
        speed=dice.choice((4.0, 6.0, 10.0)),
    )
    rides = _rides(dice, setting.distribution)
    # old requests come again only after such a restart, and what becomes of them is half of the contract
    kinds = [*TROUBLES, "supervisor", "supervisor"]
    dice.shuffle(kinds)
    kinds = [kind for kind in kinds[: dice.choice((0, 1, 1, 2, 2, 3))] if kind not in ALONE or len(rides) == 1]
    if "manager" in kinds and "way" in kinds:
        kinds.remove("way")  # one of them is over before the other
    troubles = [TROUBLES[kind](dice, rides) for kind in kinds]
    map_name = dice.choice(MAPS)
    # drawn last: what a seed stood for before these were there stays as it was
    more = dice.choice((*MORE_TROUBLES, *(None for _ in MORE_TROUBLES)))
    if more is not None and not NOT_WITH[more] & set(kinds) and (more not in ALONE or len(rides) == 1):
        troubles.append(MORE_TROUBLES[more](dice, rides))
    if dice.random() < 0.25 and not NOT_WITH_TAKEOVER & {*kinds, more}:
        troubles.append(happens.Takeover(_at(dice), dice.choice((2.6, 4.0))))
    return Schedule(seed, map_name, setting, (*rides, *troubles))


def shrink(schedule: Schedule, fails: Callable[[Schedule], bool]) -> Schedule:
    """Leave out one event after the other for as long as it still fails."""
    smaller = True
    while smaller:
        smaller = False
        for index in range(len(schedule.events)):
            less = replace(schedule, events=(*schedule.events[:index], *schedule.events[index + 1 :]))
            if less.events and fails(less):
                schedule, smaller = less, True
                break
    return schedule


def _rides(dice: Random, distribution: str) -> list[Ride]:
    count = dice.choice((1, 1, 1, 2, 2, 3))
    # the short cuts of iron and jazzy let a robot through though another one has the car, and no adapter can help it
    may_replan = count == 1 or distribution in ("humble", "kilted")
    rides = []
    for number in range(1, count + 1):
        pickup = dice.randrange(FLOORS)
        destination = (pickup + dice.randrange(1, FLOORS)) % FLOORS
        way = dice.random()
        rides.append(
            Ride(
                # both at once, or one when the other one ends
                at=dice.choice((0.0, dice.uniform(0.0, 2.0), dice.uniform(0.0, WITHIN_S))),
                session=f"fleet_{dice.choice((1, 2))}/robot_{number}",
                pickup=pickup,
                destination=destination,
                drives_s=dice.choice((0.5, 2.0, 5.0)),
                trips=dice.choice((1, 1, 2, 3)) if count == 1 else 1,
                crowded=dice.choice((0, 0, 0, 0, 1)),
                replans_after_s=dice.uniform(0.1, 3.0) if way < 0.2 else None,
                replans_outside=may_replan and 0.2 <= way < 0.4,
                gives_up_after_s=dice.uniform(0.5, 12.0) if 0.4 <= way < 0.5 else None,
            )
        )
    return rides


def _at(dice: Random) -> float:
    return dice.uniform(0.0, WITHIN_S)


def _ends(dice: Random, rides: list[Ride]) -> Event:
    session = dice.choice(("", "", "nobody", "api:amr", *(ride.session for ride in rides if len(rides) == 1)))
    floor = dice.choice(("", UNKNOWN_FLOOR, "level 1", "level 2", "level 3"))
    return happens.Ends(_at(dice), session, floor, dice.choice((1, 3, 50)), dice.choice((0.001, 0.1, 1.0)))


TROUBLES: Mapping[str, Callable[[Random, list[Ride]], Event]] = {
    "supervisor": lambda dice, _: happens.SupervisorRestarts(_at(dice), dice.choice((0.0, 0.3, 3.0))),
    "adapter": lambda dice, _: happens.AdapterRestarts(_at(dice), dice.choice((0.0, 0.3, 3.0))),
    "manager": lambda dice, _: happens.ManagerRestarts(_at(dice), dice.choice((0.0, 0.5, 5.0))),
    "way": lambda dice, _: happens.WayCut(_at(dice), dice.choice((0.1, 1.0, 8.0))),
    "unplugged": lambda dice, _: happens.Unplugged(_at(dice), dice.choice((0.5, 2.0, 8.0))),
    "fire": lambda dice, _: happens.Fire(_at(dice), dice.choice((2.0, 8.0)), dice.choice((0.5, 4.0))),
    "lockout": lambda dice, _: happens.LockedOut(_at(dice), dice.choice((1.0, 10.0))),
    "rest": lambda dice, _: happens.OtherFace(_at(dice), dice.randrange(FLOORS), dice.choice((2.0, 10.0))),
    "web": lambda dice, _: happens.WebRequest(_at(dice), dice.randrange(FLOORS), dice.choice((0.5, 8.0))),
    "web end": lambda dice, rides: happens.WebEnd(_at(dice), dice.choice(rides).session, dice.randrange(FLOORS)),
    "script": lambda dice, _: happens.Script(_at(dice), dice.randrange(FLOORS)),
    "panel": lambda dice, _: happens.Panel(_at(dice), dice.randrange(FLOORS), dice.choice((0.5, 8.0))),
    "ends": _ends,
    "repeats": lambda dice, _: happens.Repeats(_at(dice), 200, 0.02),
}
MORE_TROUBLES: Mapping[str, Callable[[Random, list[Ride]], Event]] = {
    "outage": lambda dice, _: happens.Outage(_at(dice), dice.choice((2.0, 8.0))),
    "unheard end": lambda dice, rides: happens.UnheardEnd(
        _at(dice), dice.choice(rides).session, dice.choice((1.0, 6.0))
    ),
    "other rmf": lambda dice, rides: happens.OtherRmf(
        _at(dice), dice.choice(rides).session, dice.randrange(FLOORS), dice.choice((2.0, 10.0))
    ),
}
NOT_WITH: Mapping[str, frozenset[str]] = {
    "outage": frozenset({"manager", "way", "adapter"}),
    "unheard end": frozenset({"supervisor", "web end"}),
    "other rmf": frozenset({"rest"}),
}
"""One of two of a kind would be over before the other."""
NOT_WITH_TAKEOVER = frozenset({"manager", "adapter", "way", "outage"})
"""For the same reason."""
ALONE = frozenset({"web end", "unheard end"})
"""Of several robots, another one may get the lift while the ended one is in the car: RMF itself does not get out of that."""
