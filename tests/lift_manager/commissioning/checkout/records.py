"""A site acceptance test with everything in it, and the factory acceptance test before it."""

import random
from datetime import UTC, datetime, timedelta

from lift_manager.commissioning.checkout.record import (
    AsBuiltChange,
    ConstantWord,
    Controller,
    Fingerprint,
    HandBack,
    Instrument,
    Item,
    ItemPoint,
    Latency,
    MapIdentity,
    Outcome,
    People,
    Person,
    Precondition,
    PunchEntry,
    Record,
    Result,
    Role,
    ServedRange,
    Severity,
    Signature,
    Stage,
    Topic,
    Trip,
)

BEGUN = datetime(2026, 11, 23, 8, 0, tzinfo=UTC)
ANA = Person(name="Ana Keller", company="Robots Ltd")
BO = Person(name="Bo Lindqvist", company="North Lifts")
CY = Person(name="Cy Okafor", company="Main hospital")
FLOORS = {"B1": -1, "L1": 1, "L2": 2, "L3": 3}


def at(minutes: float) -> datetime:
    return BEGUN + timedelta(minutes=minutes)


def _item(number: str, group: str, kind: str, texts: tuple[str, str, str], **more: object) -> Item:
    title, action, expected = texts
    base = Item(
        id=number, group=group, title=title, action=action, expected=expected, kind=kind, digest=f"digest of {number}"
    )
    return base.model_copy(update=more)


_MAKE = "Make it true, then false again; then the lift technician disconnects and reconnects its wire."
_FOLLOWS = "It follows, and nothing else changes."


def _signal(number: str, name: str, meaning: str, printed: str, wire: str, action: str = _MAKE) -> Item:
    points = (ItemPoint(name=name, printed=printed, wire=wire),)
    return _item(number, "Signals", "signal", (f"{name}: {meaning}", action, _FOLLOWS), points=points, subject=name)


def _command(number: str, name: str, meaning: str, printed: str, wire: str) -> Item:
    points = (ItemPoint(name=name, printed=printed, wire=wire),)
    texts = (
        f"{name}: {meaning}",
        "The manager presses it twice, each time after a yes.",
        "Exactly this output changes, and the lift does it.",
    )
    return _item(number, "Commands", "command", texts, points=points, subject=name)


def _floor(number: int, floor: str) -> Item:
    texts = (
        f"floor {floor}, door front",
        f"The manager calls the car to {floor} after a yes, and holds the door.",
        f"The car comes to {floor}, the front door opens there, and the signals show the same.",
    )
    return _item(f"F-{number:02}", "Floors and doors", "floor", texts, subject=floor)


def _abnormal(number: str, kind: str, title: str, action: str, expected: str) -> Item:
    return _item(number, "Abnormal cases", kind, (title, action, expected), is_abnormal=True)


ITEMS = (
    _signal(
        "S-01",
        "car_floor",
        "the floor at which the car stands, or which it passed last",
        "holding:1",
        "holding 101",
        "Send the car to two floors with its own buttons, and say where it is.",
    ),
    _signal("S-04", "door.front", "the front door", "holding:2", "holding 102", "Open and close the door."),
    _signal("S-09", "fire", "the lift is in fire service", "holding:5 bit 0", "holding 105 bit 0"),
    _signal("S-11", "overload", "the car is overloaded", "holding:5 bit 3", "holding 105 bit 3"),
    _command("C-01", "go_to", "sends the car to a floor", "holding:16", "holding 116"),
    _command("C-03", "hold_door.front", "keeps the front door open", "holding:17", "holding 117"),
    _command("C-07", "robot_mode", "takes the car out of the group for a robot", "holding:18", "holding 118"),
    *(_floor(number, floor) for number, floor in enumerate(FLOORS, start=1)),
    _abnormal(
        "A-01",
        "second master",
        "second master",
        "Nobody touches the lift for 60 s, and the manager writes nothing.",
        "No output and no signal changes: no other system writes to this controller.",
    ),
    _abnormal(
        "A-02",
        "cable out",
        "network cable out and back",
        "Pull the network cable of the controller while the manager holds the lift, and plug it in again.",
        "The manager sees the loss at once and presses nothing; the lift serves passengers; afterwards all works again.",
    ),
    _abnormal(
        "A-04",
        "watchdog",
        "manager killed while it holds the door",
        "This program starts a second manager that holds the door, and kills it.",
        "hold_door.front: the watchdog of the controller releases it",
    ),
    _abnormal(
        "A-05",
        "fire",
        "fire",
        "Give the fire signal at the fire panel or at the input, while the manager holds the lift.",
        "The lift leaves robots alone and recalls; the manager releases everything and stays released.",
    ),
    _item(
        "T-01",
        "Robot trips",
        "trips",
        (
            "5 whole trips",
            "The manager takes the car from floor to floor as for a robot, 5 times.",
            "Every trip ends at the right floor with the door open, and takes no longer than the robot can wait.",
        ),
        subject="5",
    ),
    _item(
        "R-01",
        "The real robot",
        "question",
        (
            "light curtain sees the robot",
            "Push the robot, or a box of its height and width, into the closing door, with the robot switched off.",
            "The door reopens before it touches, at the height of every part of the robot that sticks out.",
        ),
    ),
    _item(
        "R-02",
        "The real robot",
        "question",
        (
            "sill gap",
            "Measure the gap and the step between landing sill and car sill at each floor.",
            "Both are smaller than the wheels and castors of the robot allow, at every floor.",
        ),
    ),
)


def result(number: str, outcome: Outcome, minutes: float, note: str = "", **more: object) -> Result:
    base = Result(
        item=number,
        digest=f"digest of {number}",
        outcome=outcome,
        by=ANA.name,
        began_at=at(minutes - 1.5),
        at=at(minutes),
        note=note,
    )
    return base.model_copy(update=more)


_NOTES: dict[str, tuple[Outcome, str]] = {
    "S-11": (Outcome.FAILED, "Stays 0 with 12 persons in the car: the contact is not wired to the controller."),
    "A-05": (Outcome.PASSED, "Given at the panel by Bo Lindqvist."),
    "R-02": (Outcome.DOCUMENT, "Measured by North Lifts, protocol NL-2231 of 2026-11-02."),
    "C-07": (Outcome.NOT_APPLICABLE, "The lift has no group."),
}
_EVIDENCE: dict[str, tuple[str, ...]] = {
    "S-01": ("holding 101: 1 → 2 → 3", "Ana Keller: the car stands at L3"),
    "S-04": ("holding 102: closed → moving → open → closed",),
    "C-03": ("wrote holding 117 = 1, read back 1", "door open 3.1 s after the press"),
    "A-04": ("child killed at 09:12:04.3", "holding 117: 1 → 0 after 3.0 s"),
    "S-09": ("holding 105 bit 0: 0 → 1 → 0", "wire disconnected: reads 1"),
}


def _results() -> tuple[Result, ...]:
    rng = random.Random(7)
    found = [result("S-04", Outcome.FAILED, 6, "Reads open with the door closed: contact inverted.")]
    for index, item in enumerate(ITEMS):
        outcome, note = _NOTES.get(item.id, (Outcome.PASSED, ""))
        figures: dict[str, float] = {}
        if item.kind == "floor":
            figures = {"door_opens_s": round(rng.uniform(2.7, 3.3), 1), "levelling_mm": float(rng.randint(1, 6))}
        if item.id == "A-04":
            figures = {"released_after_s": 3.0}
        found.append(
            result(
                item.id,
                outcome,
                8 + 4 * index,
                note,
                figures=figures,
                evidence=_EVIDENCE.get(item.id, ()),
                confirmed_by=BO.name if item.is_abnormal else "",
                photos=("photos/fire-panel.png",) if item.id == "A-05" else (),
            )
        )
    return tuple(found)


def _trips() -> tuple[Trip, ...]:
    rng, legs = random.Random(3), [("L1", "L3"), ("L3", "B1"), ("B1", "L2"), ("L2", "L1"), ("L1", "L3"), ("L3", "B1")]
    found = []
    for number, (start, end) in enumerate(legs, start=1):
        distance = abs(FLOORS[start] - FLOORS[end])
        figures = {
            "called_s": round(rng.uniform(0.3, 0.6), 1),
            "door_opens_s": round(rng.uniform(2.6, 3.4), 1),
            "travel_s": round(4 + 3.4 * distance + rng.uniform(-0.5, 0.9), 1),
            "door_closes_s": round(rng.uniform(3.4, 4.6), 1),
        }
        figures["total_s"] = round(sum(figures.values()) + 10, 1)
        complete = number != 4
        found.append(
            Trip(
                number=number,
                item="T-01",
                **{"from": start},
                to=end,
                at=at(80 + 2 * number),
                is_complete=complete,
                text="" if complete else "a passenger pressed the door-open button; the next trip was complete",
                figures=figures,
            )
        )
    return tuple(found)


def _samples() -> tuple[float, ...]:
    rng = random.Random(5)
    return tuple(round(rng.gammavariate(9, 1.3) + 3 + (40 if index % 97 == 0 else 0), 2) for index in range(400))


def _latency() -> Latency:
    samples = _samples()
    ordered = sorted(samples)
    return Latency(p50_ms=ordered[200], p99_ms=ordered[396], max_ms=ordered[-1], samples_ms=samples)


def _precondition(topic: Topic, text: str, value: str = "", **more: object) -> Precondition:
    base = Precondition(topic=topic, text=text, is_met=True, value=value, by=ANA.name, at=at(1))
    return base.model_copy(update=more)


PRECONDITIONS = (
    _precondition(Topic.IO_LIST, "Which revision of the I/O list is approved?", "Rev. C of 2026-11-12"),
    _precondition(Topic.PERMIT, "Which permit to work?", "PTW 4711"),
    _precondition(Topic.CAR_EMPTY, "Is the car empty?"),
    _precondition(Topic.LANDINGS, "Are all landings barricaded?"),
    _precondition(
        Topic.FIRE_PANEL,
        "Is the fire panel isolated?",
        item="A-05",
        by=BO.name,
        is_met=False,
        reason="tested with the fire brigade's line disconnected instead",
    ),
    _precondition(Topic.BACKUP_BEFORE, "Is the PLC program backed up?", "lift-main-20261123-a.zip"),
    _precondition(Topic.BACKUP_AFTER, "Is the PLC program backed up again?", "lift-main-20261123-b.zip", at=at(118)),
)

UNSIGNED = Record(
    stage=Stage.SAT,
    site="Main hospital",
    lift="bed-lift",
    floors=FLOORS,
    map=MapIdentity(
        name="generic-registers",
        title="Generic lift controller, everything in holding registers",
        sha256="3f" * 32,
        lift_sha256="a7" * 32,
    ),
    controller=Controller(
        name="plc",
        host="192.0.2.10",
        port=502,
        unit=1,
        identity="Thyra LC-3, serial 88-1203, program 2.14",
        fingerprint=Fingerprint(
            served=(
                ServedRange(table="holding", first=100, last=131),
                ServedRange(table="coil", first=0, last=15),
            ),
            constants=(
                ConstantWord(table="holding", address=130, value=8812),
                ConstantWord(table="holding", address=131, value=214),
            ),
            latency=_latency(),
            identity={"vendor": "Thyra", "product_code": "LC-3", "revision": "4.1"},
            taken_at=at(2),
        ),
    ),
    versions={"lift-manager": "1.0.0", "Python": "3.11.2"},
    people=People(run_by=ANA, technician=BO, witness=CY),
    instruments=(Instrument(name="stopwatch", serial="S-17", calibrated="2026-03-01"),),
    preconditions=PRECONDITIONS,
    items=ITEMS,
    results=_results(),
    trips=_trips(),
    punch_list=(
        PunchEntry(
            number=1,
            item="S-04",
            text="Door contact inverted in the map.",
            severity=Severity.A,
            raised_at=at(6),
            closed_at=at(12),
            closed_by=ANA.name,
        ),
        PunchEntry(
            number=2,
            item="S-11",
            text="Overload contact is not wired.",
            severity=Severity.B,
            condition="One robot of at most 300 kg, and nobody rides along.",
            accepted_by=CY.name,
            due="2026-12-15",
            raised_at=at(20),
        ),
    ),
    as_built=(
        AsBuiltChange(
            subject="door.front",
            approved="NO: closes (1) for open",
            as_built="NC: opens (0) for open",
            reason="The relay of the door operator has no free NO contact.",
            by=BO.name,
            at=at(12),
        ),
    ),
    hand_back=HandBack(
        in_normal_service=True,
        handed_over_by=ANA.name,
        taken_back_by=BO.name,
        at=at(121),
        note="Barriers removed, fire panel in service.",
    ),
    started_at=BEGUN,
    ended_at=at(122),
)


def signed(record: Record) -> Record:
    """Sign as the one who ran the test and the lift technician."""
    given = tuple(
        Signature(role=role, name=person.name, at=at(124), record_sha256=record.sha256)
        for role, person in ((Role.RUN_BY, ANA), (Role.TECHNICIAN, BO))
    )
    return record.model_copy(update={"signatures": given})


SAT = signed(UNSIGNED)


def _fat() -> Record:
    items = tuple(
        item.model_copy(
            update={
                "digest": f"earlier {item.digest}",
                "points": (ItemPoint(name="door.front", printed="holding:3", wire="holding 103"),),
            }
        )
        if item.id == "S-04"
        else item
        for item in ITEMS
        if item.id != "R-02"
    )
    digests = {item.id: item.digest for item in items}
    results = tuple(
        one.model_copy(update={"outcome": Outcome.PASSED, "digest": digests[one.item], "note": ""})
        for one in UNSIGNED.results
        if one.item in digests
    )
    trips = tuple(
        trip.model_copy(update={"figures": {name: round(value * 0.8, 1) for name, value in trip.figures.items()}})
        for trip in UNSIGNED.trips
    )
    return UNSIGNED.model_copy(
        update={
            "stage": Stage.FAT,
            "items": items,
            "results": results,
            "trips": trips,
            "map": UNSIGNED.map.model_copy(update={"sha256": "1b" * 32}),
            "controller": Controller(name="plc", host="127.0.0.1", port=5020, unit=1, identity="simulated"),
            "punch_list": (),
            "as_built": (),
            "hand_back": None,
            "started_at": BEGUN - timedelta(days=21),
            "ended_at": BEGUN - timedelta(days=21) + timedelta(hours=1),
        }
    )


FAT = _fat()
