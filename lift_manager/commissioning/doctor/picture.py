"""Decodes what was read into pictures of a lift, also under other assumptions than those of its map, and finds what cannot be. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum, unique

from lift_manager.commissioning.doctor.evidence import Evidence, Purpose
from lift_manager.commissioning.doctor.subjects import SIBLING, ExaminedLift
from register_maps.codec import UNLISTED, SignalCodec, Unlisted, Value
from register_maps.schema import Kind
from register_maps.signal_codec import swap_bytes
from register_maps.vocabulary import SAFETY_FLAGS
from register_maps.words import BIT_TABLES, Door, Mode, Motion, Table

HIGHEST_FLOOR = 99
LOWEST_FLOOR = -9
"""Floor codes beyond these are not believed where nobody has named the floors. Chosen: no building has them."""
FLOOR_S = 1.0
"""In less than this no car passes a floor between two others. Chosen."""
RESTLESS = 3
"""More changes of floor than this, without the car passing the floors in between, are no car. Chosen."""
DOOR_S = 6.0
"""Longer than a door takes to open or to shut. Chosen."""
LEVELLING_S = 3.0
"""Longer than a car moves with its door open: advance opening, and levelling. Chosen."""
MOVING = frozenset({Motion.UP, Motion.DOWN, Motion.MOVING})
NOT_SHUT = (Door.OPEN, Door.MOVING, Door.OPENING, Door.CLOSING)
MODES_WITHOUT_ROBOTS = frozenset(
    {Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.ATTENDANT, Mode.OUT_OF_SERVICE}
)

_Cell = tuple[str, int, Table, int]
"""Controller, unit id, table and address."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """How the registers are read, where that differs from the map."""

    offset: int = 0
    other_table: bool = False
    bytes_swapped: bool = False


AS_MAPPED = Assumption()


@dataclass(frozen=True, slots=True)
class Picture:
    """The signals of one lift at one time; a signal that was not read is absent."""

    at_s: float
    raw: Mapping[str, int]
    values: Mapping[str, Value | Unlisted]


@unique
class Oddity(StrEnum):
    """What cannot be, or should not be, in the pictures of a lift."""

    UNLISTED = "unlisted"
    """A value that the table of the signal does not list."""
    NO_SUCH_FLOOR = "no such floor"
    RESTLESS = "restless"
    """A floor that jumps about."""
    CONTRADICTION = "contradiction"
    """Contacts that exclude each other are made together."""
    UNDER_WAY = "under way"
    """A door that is not shut, or a car that is level, while the car moves."""
    BETWEEN = "between"
    """A door that is never open and never shut."""
    STILL = "still"
    """An alive counter that does not change."""
    ASSERTED = "asserted"
    """A flag or a mode that keeps robots away."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """One signal that makes no sense, with the value that shows it."""

    signal: str
    oddity: Oddity
    raw: int
    is_constant: bool
    """Whether it was so in every picture."""


def pictures(
    lift: ExaminedLift, evidence: Evidence, assumption: Assumption = AS_MAPPED, purposes: Iterable[Purpose] = ()
) -> tuple[Picture, ...]:
    """Decode each poll; with `purposes`, also what these probes have read."""
    cells: dict[_Cell, int] = {}
    found: list[Picture] = []
    answers = sorted(
        (
            (answer.at_s, name, answer)
            for name, controller in evidence.controllers.items()
            for answer in controller.of(Purpose.POLL, Purpose.POINT, *purposes)
            if answer.values is not None
        ),
        key=lambda item: item[:2],
    )
    for number, (at_s, name, answer) in enumerate(answers):
        for place, value in enumerate(answer.values or ()):
            cells[name, answer.unit, answer.table, answer.address + place] = value
        following = answers[number + 1][2] if number + 1 < len(answers) else None
        if following is None or (following.turn, following.purpose) != (answer.turn, answer.purpose):
            found.append(_picture(lift, at_s, cells, assumption))
    return tuple(picture for picture in found if picture.raw)


def _picture(lift: ExaminedLift, at_s: float, cells: Mapping[_Cell, int], assumption: Assumption) -> Picture:
    raw = {}
    for name, signal in lift.codec.signals.items():
        if (number := _raw(lift, signal, cells, assumption)) is not None:
            raw[name] = number
    return Picture(at_s, raw, {name: lift.codec.signals[name].decode(number) for name, number in raw.items()})


def _raw(lift: ExaminedLift, signal: SignalCodec, cells: Mapping[_Cell, int], assumption: Assumption) -> int | None:
    raw = shift = 0
    for point in signal.points:
        device = lift.device(point)
        table = SIBLING[point.table] if assumption.other_table else point.table
        cell = cells.get((device.controller, device.unit_id, table, point.address + assumption.offset))
        if cell is None:
            return None
        if assumption.bytes_swapped and table not in BIT_TABLES:
            cell = swap_bytes(cell)
        raw |= point.within(cell) << shift
        shift += point.width
    return raw


def is_all_zero(found: Sequence[Picture]) -> bool:
    """Whether every bit that was read is 0: a memory that no program fills looks like that."""
    return bool(found) and not any(number for picture in found for number in picture.raw.values())


def misfits(lift: ExaminedLift, found: Sequence[Picture]) -> tuple[Misfit, ...]:
    """Return every signal that makes no sense, with one reason each."""
    return tuple(
        misfit
        for name, signal in lift.codec.signals.items()
        if (misfit := _misfit(lift, signal, [p for p in found if name in p.raw])) is not None
    )


def _misfit(lift: ExaminedLift, signal: SignalCodec, found: Sequence[Picture]) -> Misfit | None:
    if not found:
        return None
    name = signal.name
    for oddity, odd in (
        (Oddity.CONTRADICTION, [p for p in found if _contradicts(signal, p)]),
        (Oddity.UNLISTED, [p for p in found if p.values[name] is UNLISTED]),
        (Oddity.NO_SUCH_FLOOR, [p for p in found if not is_floor(lift, signal, p.values[name])]),
        (Oddity.ASSERTED, [p for p in found if keeps_robots_away(signal, p.values[name])]),
    ):
        if odd:
            return Misfit(name, oddity, odd[-1].raw[name], is_constant=len(odd) == len(found))
    if signal.kind is Kind.DOOR and (door := _door_oddity(name, found)) is not None:
        return Misfit(name, door, found[-1].raw[name], is_constant=True)
    if name == "level" and _under_way_with(found, name, True):
        return Misfit(name, Oddity.UNDER_WAY, found[-1].raw[name], is_constant=True)
    if signal.kind is Kind.COUNTER and stands_still(lift, found):
        return Misfit(name, Oddity.STILL, found[-1].raw[name], is_constant=True)
    if name == "car_floor" and _is_restless(lift, found):
        return Misfit(name, Oddity.RESTLESS, found[-1].raw[name], is_constant=False)
    return None


def _door_oddity(name: str, found: Sequence[Picture]) -> Oddity | None:
    if _under_way_with(found, name, *NOT_SHUT):
        return Oddity.UNDER_WAY
    if found[-1].at_s - found[0].at_s > DOOR_S and always(found, name, Door.MOVING, Door.OPENING, Door.CLOSING):
        return Oddity.BETWEEN
    return None


def _under_way_with(found: Sequence[Picture], name: str, *values: Value) -> bool:
    """Whether a signal has one of these values while the car moves, for longer than it levels with its door open."""
    since = None
    for before, picture in itertools.pairwise(found):
        is_odd = picture.values.get(name) in values and picture.values.get("motion") in MOVING
        if not is_odd or picture.at_s - before.at_s > LEVELLING_S:
            since = None
        elif since is None:
            since = picture.at_s
        elif picture.at_s - since > LEVELLING_S:
            return True
    return False


def stands_still(lift: ExaminedLift, found: Sequence[Picture]) -> bool:
    """Whether the alive counter never changed, although it was read for longer than it may stand still."""
    limit_s = lift.codec.map.signals["alive"].must_change_within_s
    long_enough = limit_s is not None and found[-1].at_s - found[0].at_s > limit_s
    return long_enough and len({p.raw["alive"] for p in found if "alive" in p.raw}) == 1


def keeps_robots_away(signal: SignalCodec, value: Value | Unlisted) -> bool:
    """Whether a flag or the mode word reports a mode without robots."""
    if signal.kind is Kind.FLAG:
        return signal.name in SAFETY_FLAGS and value is True
    return signal.kind is Kind.MODE and value in MODES_WITHOUT_ROBOTS


def _contradicts(signal: SignalCodec, picture: Picture) -> bool:
    value = picture.values[signal.name]
    if signal.kind is Kind.DOOR and len(signal.points) > 1:
        return value is Door.FAULT
    many = len(signal.points) > 1 and signal.kind in (Kind.MOTION, Kind.FLOOR)
    return many and not _is_number(signal) and value is UNLISTED


def _is_number(signal: SignalCodec) -> bool:
    """Whether its points are the halves of one number."""
    return any(point.width > 1 for point in signal.points)


def is_floor(lift: ExaminedLift, signal: SignalCodec, value: Value | Unlisted) -> bool:
    """Whether a value is a floor of this lift, or none; any value of a signal that is no floor."""
    if signal.kind is not Kind.FLOOR or not isinstance(value, int):
        return True
    return value in lift.floors if lift.floors else LOWEST_FLOOR <= value <= HIGHEST_FLOOR


def _is_restless(lift: ExaminedLift, found: Sequence[Picture]) -> bool:
    """Whether the floor jumps about as no car does: over floors in no time, or at every poll."""
    order = {code: place for place, code in enumerate(lift.floors)}
    changed, jumps = 0, 0
    for before, after in itertools.pairwise(found):
        one, other = before.values["car_floor"], after.values["car_floor"]
        if isinstance(one, int) and isinstance(other, int) and one != other:
            changed += 1
            are_close = after.at_s - before.at_s < FLOOR_S
            jumps += are_close and one in order and other in order and abs(order[one] - order[other]) > 1
    return jumps > RESTLESS or changed > max(RESTLESS, found[-1].at_s - found[0].at_s)


def is_open_between_floors(found: Sequence[Picture], door: str) -> bool:
    """Whether a door reads open from one floor to another."""
    floor, last_s = None, found[0].at_s
    for picture in found:
        gap_s, last_s = picture.at_s - last_s, picture.at_s
        if picture.values.get(door) is not Door.OPEN or gap_s > LEVELLING_S:
            floor = None
            continue
        now = picture.values.get("car_floor")
        if isinstance(now, int):
            if floor not in (None, now):
                return True
            floor = now
    return False


def changes(found: Sequence[Picture], name: str) -> int:
    """How often a signal changed from one picture to the next."""
    raws = [picture.raw[name] for picture in found if name in picture.raw]
    return sum(a != b for a, b in itertools.pairwise(raws))


def trips(found: Sequence[Picture]) -> int:
    """How often the car went from one floor to another."""
    floors = [picture.values.get("car_floor") for picture in found]
    return sum(a != b for a, b in itertools.pairwise(floor for floor in floors if isinstance(floor, int)))


def always(found: Sequence[Picture], name: str, *values: Value) -> bool:
    """Whether a signal had one of these values in every picture."""
    read = [picture.values[name] for picture in found if name in picture.values]
    return bool(read) and all(value in values for value in read)
