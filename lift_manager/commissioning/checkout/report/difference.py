"""Compares two records of one lift by the numbers of their items: a factory acceptance test with a site acceptance test. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lift_manager.commissioning.checkout.record import Item, Record
from lift_manager.commissioning.checkout.report.figures import CLOSES, OPENS, door_times, travel_times
from lift_manager.commissioning.wording import identity_text

NOT_DONE = "not done"
NOT_THERE = "no such item"


@dataclass(frozen=True, slots=True)
class ItemDifference:
    """One item that came out differently, or is not the same test."""

    item: str
    title: str
    before: str
    """Its outcome in the earlier record."""
    after: str
    changes: tuple[str, ...]
    """What differs besides the outcome, a line each."""


@dataclass(frozen=True, slots=True)
class FigureDifference:
    """One measured time in both records: medians in seconds."""

    what: str
    before_s: float
    after_s: float


@dataclass(frozen=True, slots=True)
class Difference:
    """What differs between two records."""

    before: Record
    after: Record
    general: tuple[tuple[str, str, str], ...]
    """What both are about: label, before, after."""
    items: tuple[ItemDifference, ...]
    same: int
    """How many items have the same outcome of the same test."""
    figures: tuple[FigureDifference, ...]


def compare(before: Record, after: Record) -> Difference:
    """Return what differs between an earlier record and a later one of the same lift."""
    numbers = dict.fromkeys([*(item.id for item in after.items), *(item.id for item in before.items)])
    old, new = ({item.id: item for item in record.items} for record in (before, after))
    items = tuple(
        found for number in numbers if (found := _item(before, after, old.get(number), new.get(number))) is not None
    )
    return Difference(
        before=before,
        after=after,
        general=tuple(row for row in _general(before, after) if row[1] != row[2]),
        items=items,
        same=len(numbers) - len(items),
        figures=tuple(_figures(before, after)),
    )


def _general(before: Record, after: Record) -> Iterator[tuple[str, str, str]]:
    def row(label: str, *texts: str) -> tuple[str, str, str]:
        return label, texts[0] or "none", texts[1] or "none"

    both = before, after
    yield row("Site", *(record.site for record in both))
    yield row("Lift", *(record.lift for record in both))
    yield row("Floors", *(", ".join(f"{name} = {code}" for name, code in record.floors.items()) for record in both))
    yield row("Map", *(record.map.name for record in both))
    yield row("Map (sha256)", *(record.map.sha256 for record in both))
    yield row("Settings of the lift (sha256)", *(record.map.lift_sha256 for record in both))
    yield row("Controller", *(address(record) for record in both))
    yield row("Identity of the controller", *(record.controller.identity for record in both))
    yield row("What the controller says that it is", *(own_identity(record) for record in both))
    yield row("Fingerprint of the controller", *(fingerprint(record) for record in both))
    programs = dict.fromkeys([*before.versions, *after.versions])
    yield from (row(f"Version of {name}", *(record.versions.get(name, "") for record in both)) for name in programs)


def address(record: Record) -> str:
    """Return where the controller of a record is."""
    controller = record.controller
    return f"{controller.name}: {controller.host}, port {controller.port}, unit id {controller.unit}"


def fingerprint(record: Record) -> str:
    """Return the hash of the controller's fingerprint; empty without one."""
    return "" if record.controller.fingerprint is None else record.controller.fingerprint.sha256


def own_identity(record: Record) -> str:
    """Return what the controller says that it is; empty if it says nothing, or was not asked."""
    taken = record.controller.fingerprint
    return "" if taken is None else identity_text(taken.identity)


def outcome(record: Record, number: str) -> str:
    """Return the outcome of an item that counts, in words."""
    result = record.newest.get(number)
    return NOT_DONE if result is None else result.outcome.value


def _item(before: Record, after: Record, old: Item | None, new: Item | None) -> ItemDifference | None:
    if old is None or new is None:
        there = old or new
        assert there is not None  # noqa: S101  every number comes from one of the records
        words = (
            (NOT_THERE if old is None else outcome(before, there.id)),
            (NOT_THERE if new is None else outcome(after, there.id)),
        )
        return ItemDifference(there.id, there.title, *words, ())
    was, came_to = outcome(before, old.id), outcome(after, new.id)
    changes = tuple(_changes(old, new))
    return None if was == came_to and not changes else ItemDifference(new.id, new.title, was, came_to, changes)


def _changes(old: Item, new: Item) -> Iterator[str]:
    points_were, points_are = _points(old), _points(new)
    for name in dict.fromkeys([*points_were, *points_are]):
        was, now = points_were.get(name, "none"), points_are.get(name, "none")
        if was != now:
            yield f"{name}: address {was}, now {now}"
    for label, was, now in (
        ("title", old.title, new.title),
        ("to do", old.action, new.action),
        ("expected", old.expected, new.expected),
    ):
        if was != now:
            yield f"{label}: {was!r}, now {now!r}"
    if old.digest != new.digest and old.subject == new.subject:  # another number of trips is no change of the map
        yield "the map or the site file has changed what this item depends on"


def _points(item: Item) -> Mapping[str, str]:
    return {point.name: f"{point.printed} ({point.wire})" for point in item.points}


def _figures(before: Record, after: Record) -> Iterator[FigureDifference]:
    measured = (
        ("door opens at", lambda record: door_times(record, OPENS)),
        ("door closes at", lambda record: door_times(record, CLOSES)),
        ("travel", travel_times),
    )
    for what, times in measured:
        old = {found.label: found.median for found in times(before)}
        for found in times(after):
            if found.label in old:
                yield FigureDifference(f"{what} {found.label}", old[found.label], found.median)
