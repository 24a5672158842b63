"""The measured times of a record: of doors by floor, of travel from floor to floor. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import median

from lift_manager.commissioning.checkout.record import Record

OPENS, CLOSES, TRAVEL = "door_opens_s", "door_closes_s", "travel_s"


@dataclass(frozen=True, slots=True)
class Times:
    """One measured time, as often as it was measured."""

    label: str
    """A floor, or `L1 → L2`."""
    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """The median of all measurements."""
        return median(self.seconds)


def door_times(record: Record, figure: str) -> tuple[Times, ...]:
    """Return how long doors took at each floor, the highest floor first; `figure` is OPENS or CLOSES.

    The figures of another door than the front one begin with its side, such as `rear_door_opens_s`.
    """
    found: dict[str, dict[str, list[float]]] = {floor: {} for floor in reversed(record.floors)}
    for floor, figures in _at_floors(record):
        for name, seconds in figures.items():
            if name == figure or name.endswith(f"_{figure}"):
                side = name.removesuffix(figure).rstrip("_")
                found[floor].setdefault(f"{floor} {side}" if side else floor, []).append(seconds)
    return tuple(Times(label, tuple(seconds)) for doors in found.values() for label, seconds in doors.items())


def travel_times(record: Record) -> tuple[Times, ...]:
    """Return how long the car travelled between each two floors, in the order of the floors."""
    place = {floor: index for index, floor in enumerate(record.floors)}
    found: dict[tuple[str, str], list[float]] = {}
    for trip in record.trips:
        if TRAVEL in trip.figures and trip.from_ in place and trip.to in place:
            found.setdefault((trip.from_, trip.to), []).append(trip.figures[TRAVEL])
    legs = sorted(found, key=lambda leg: (place[leg[0]], place[leg[1]]))
    return tuple(Times(f"{start} → {end}", tuple(found[start, end])) for start, end in legs)


def _at_floors(record: Record) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield the floors at which something was measured, with the figures."""
    for trip in record.trips:
        if trip.to in record.floors:
            yield trip.to, trip.figures
    subjects = {item.id: item.subject for item in record.items}
    for number, result in record.newest.items():
        if subjects[number] in record.floors:
            yield subjects[number], result.figures


def figure_text(name: str, value: float) -> str:
    """Return a figure as text, such as `door opens 3.1 s`: the last word of its name is the unit."""
    words, _, unit = name.rpartition("_")
    return f"{words.replace('_', ' ')} {value:g} {unit}" if words else f"{name} {value:g}"
