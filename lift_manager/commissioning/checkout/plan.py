"""What has to be tested on one lift: a list of items, made from its map and its site. Pure.

Numbers follow the closed lists of what a map may name, so that an item keeps its number when the map changes, and has the same number in
the factory and at the lift.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum, unique

from lift_manager.commissioning import wording
from lift_manager.commissioning.checkout.record import Item, ItemPoint, Stage
from lift_manager.config.load import LoadedSite
from register_maps.codec import Codec, CommandCodec, SignalCodec
from register_maps.meanings import COMMAND_MEANINGS, SIGNAL_MEANINGS
from register_maps.schema import COMMANDS, SIGNALS, Kind
from register_maps.words import Side

WATCHED_S = 60.0
"""How long outputs are watched for a second master. Chosen: a poll of another system is rarely slower."""
TRIPS = 5
"""Whole trips by default. Chosen: enough for a spread of times, and done in ten minutes."""


@unique
class ItemKind(StrEnum):
    """The procedure of an item."""

    SIGNAL = "signal"
    COMMAND = "command"
    FLOOR = "floor"
    QUIET = "second master"
    CABLE = "cable out"
    POWER = "power cycle"
    WATCHDOG = "watchdog"
    FIRE = "fire"
    ROBOT_MODE = "robot mode withdrawn"
    TRIPS = "trips"
    QUESTION = "question"


SIGNALS_GROUP, COMMANDS_GROUP, FLOORS_GROUP = "Signals", "Commands", "Floors and doors"
ABNORMAL_GROUP, TRIPS_GROUP, ROBOT_GROUP = "Abnormal cases", "Robot trips", "The real robot"

BY_THE_MANAGER = frozenset({"robot_mode_on", "may_enter", "may_leave", "call_accepted"})
"""Signals that answer commands: they are seen during a trip."""
BY_TRAVEL = frozenset({"level", "door_zone"})
"""Flags that change as the car leaves a floor and comes to the next one."""
BY_BUTTONS = frozenset({"destination", "calls_registered"})
"""Floors that show where the car is sent, and not where it is."""

PROOF_KINDS = frozenset({ItemKind.FIRE, ItemKind.WATCHDOG, ItemKind.TRIPS})
"""What the yearly proof test repeats."""

QUESTIONS: Mapping[str, tuple[str, str, str]] = {
    "R-01": (
        "light curtain sees the robot",
        "Push the robot, or a box of its height and width, into the closing door, with the robot switched off.",
        "The door reopens before it touches, at the height of every part of the robot that sticks out.",
    ),
    "R-02": (
        "sill gap",
        "Measure the gap and the step between landing sill and car sill at each floor.",
        "Both are smaller than the wheels and castors of the robot allow, at every floor.",
    ),
    "R-03": (
        "levelling accuracy",
        "Measure the height of the car floor over the landing at each floor, with the car empty and with the robot inside.",
        "The step stays within what the robot allows, also while it drives in and out.",
    ),
    "R-04": (
        "weight",
        "Compare the weight of robot and load with the rated load of the car and of the sill.",
        "The car takes it, no overload is shown, and nobody rides along beyond the rated load.",
    ),
}


def make_plan(loaded: LoadedSite, lift: str, stage: Stage, *, trips: int = TRIPS) -> tuple[Item, ...]:
    """Return the items of one lift for a stage, in the order in which they are done."""
    items = _Plan(loaded, lift, trips).items()
    if stage is Stage.PROOF:
        return tuple(item for item in items if ItemKind(item.kind) in PROOF_KINDS)
    return tuple(items)


def lift_digest(loaded: LoadedSite, lift: str) -> str:
    """Return the hash of what the site file adds to the map: floors, doors, offset, unit and further devices."""
    entry = loaded.site.lifts[lift]
    keys = {"controller", "floors", "offset", "unit_id", "endpoints"}
    return _digest(entry.model_dump(mode="json", include=keys))


class _Plan:
    """The items of one lift."""

    def __init__(self, loaded: LoadedSite, lift: str, trips: int) -> None:
        self._codec: Codec = loaded.codecs[lift]
        self._source = loaded.maps[lift].map
        self._lift = loaded.site.lifts[lift]
        self._floors = {name: floor.code for name, floor in self._lift.floors.items()}
        self._doors = tuple(side for side in Side if f"door.{side}" in self._codec.signals)
        self._all = f"{loaded.maps[lift].sha256} {lift_digest(loaded, lift)}"
        self._trips = trips

    def items(self) -> Iterator[Item]:
        """Yield every item."""
        yield from self._signals()
        yield from self._commands()
        yield from self._floor_items()
        yield from self._abnormal()
        yield self._item(
            "T-01",
            ItemKind.TRIPS,
            TRIPS_GROUP,
            f"{self._trips} whole trips",
            f"The manager takes the car from floor to floor as for a robot, {self._trips} times.",
            "Every trip ends at the right floor with the door open, and takes no longer than the robot can wait.",
            digest=_digest([self._all, self._trips]),
            subject=str(self._trips),
            estimate_s=90.0 * self._trips,
        )
        for number, (title, action, expected) in QUESTIONS.items():
            yield self._item(
                number,
                ItemKind.QUESTION,
                ROBOT_GROUP,
                title,
                action,
                expected,
                digest=_digest([title, action, expected]),
                estimate_s=300.0,
            )

    def _signals(self) -> Iterator[Item]:
        for number, name in enumerate(SIGNALS, start=1):
            signal = self._codec.signals.get(name)
            if signal is None or name in self._source.derived:
                continue
            coding = wording.signal_coding(signal, self._source.signals[name])
            yield self._item(
                f"S-{number:02}",
                ItemKind.SIGNAL,
                SIGNALS_GROUP,
                f"{name}: {SIGNAL_MEANINGS[name]}",
                _signal_action(signal),
                f"{_signal_expected(signal)} Coding: {coding}.",
                digest=self._digest_of([name]),
                subject=name,
                points=self._signal_points(signal),
                estimate_s=40.0 if signal.kind in (Kind.COUNTER, Kind.NUMBER) else 90.0,
            )

    def _commands(self) -> Iterator[Item]:
        for number, name in enumerate(COMMANDS, start=1):
            command = self._codec.commands.get(name)
            if command is None:
                continue
            yield self._item(
                f"C-{number:02}",
                ItemKind.COMMAND,
                COMMANDS_GROUP,
                f"{name}: {COMMAND_MEANINGS[name]}",
                "The manager writes its heartbeat by itself."
                if command.spec.is_heartbeat
                else "The manager presses it twice, each time after a yes.",
                _command_expected(command),
                digest=self._digest_of([], [name]),
                subject=name,
                points=self._command_points(command),
                estimate_s=20.0 if command.spec.is_heartbeat else 120.0,
            )

    def _floor_items(self) -> Iterator[Item]:
        calls = [name for name, command in self._codec.commands.items() if command.is_call]
        if not calls:
            return
        for number, (floor, entry) in enumerate(self._lift.floors.items(), start=1):
            sides = entry.doors or self._doors or (Side.FRONT,)
            doors = " and ".join(sides)
            points = [
                point
                for name in calls
                for point in self._command_points(self._codec.commands[name], only=self._floors[floor])
            ]
            yield self._item(
                f"F-{number:02}",
                ItemKind.FLOOR,
                FLOORS_GROUP,
                f"floor {floor}, door {doors}",
                f"The manager calls the car to {floor} after a yes, and holds the door.",
                f"The car comes to {floor}, the {doors} door opens there and no other, and the signals show the same.",
                digest=_digest(
                    [self._digest_of([*_PLACE, *(f"door.{side}" for side in sides)], calls), floor, self._floors[floor]]
                ),
                subject=floor,
                points=tuple(points),
            )

    def _abnormal(self) -> Iterator[Item]:
        """Yield the abnormal cases; what does not exist on this lift is asked for all the same, so that somebody decides."""
        codec = self._codec
        held = [name for name, command in codec.commands.items() if command.spec.action == "hold"]
        beats = [name for name, command in codec.commands.items() if command.spec.is_heartbeat]
        outputs = _digest([codec.map.served, self._digest_of([], list(codec.commands))])
        yield self._abnormal_item(
            "A-01",
            ItemKind.QUIET,
            "second master",
            f"Nobody touches the lift for {WATCHED_S:g} s, and the manager writes nothing.",
            "No output and no signal changes: no other system writes to this controller.",
            outputs,
        )
        yield self._abnormal_item(
            "A-02",
            ItemKind.CABLE,
            "network cable out and back",
            "Pull the network cable of the controller while the manager holds the lift, and plug it in again.",
            "The manager sees the loss at once and presses nothing; the lift serves passengers; afterwards all works again.",
            outputs,
        )
        yield self._abnormal_item(
            "A-03",
            ItemKind.POWER,
            "power cycle of the controller",
            "The lift technician switches the controller or its communication module off and on.",
            "Zeros on the wire while it starts are no healthy lift: no robot is invited, and nothing is pressed.",
            outputs,
        )
        yield self._abnormal_item(
            "A-04",
            ItemKind.WATCHDOG,
            "manager killed while it holds the door",
            "This program starts a second manager that holds the door, and kills it.",
            _watchdog_expected(codec, held),
            self._digest_of([f"door.{side}" for side in self._doors], [*held, *beats]),
            subject=" ".join(held),
        )
        yield self._abnormal_item(
            "A-05",
            ItemKind.FIRE,
            "fire",
            "Give the fire signal at the fire panel or at the input, while the manager holds the lift.",
            "The lift leaves robots alone and recalls; the manager releases everything and stays released after the signal is gone.",
            self._digest_of(["fire", "fireman", "mode"], held),
            subject="fire",
        )
        yield self._abnormal_item(
            "A-06",
            ItemKind.ROBOT_MODE,
            "robot mode and its withdrawal",
            "With robot mode on, press a landing button; then take robot mode away with its key or at the panel.",
            "In robot mode the car serves nobody else; once it is withdrawn that shows, and the manager presses no call.",
            self._digest_of(["robot_mode_on", "robots_allowed", "mode"], ["robot_mode"]),
            subject="robot_mode" if "robot_mode" in codec.commands else "",
        )

    def _abnormal_item(
        self, number: str, kind: ItemKind, title: str, action: str, expected: str, digest: str, subject: str = ""
    ) -> Item:
        item = self._item(
            number, kind, ABNORMAL_GROUP, title, action, expected, digest=digest, subject=subject, estimate_s=240.0
        )
        return item.model_copy(update={"is_abnormal": True})

    def _item(  # noqa: PLR0913  the columns of a row
        self,
        number: str,
        kind: ItemKind,
        group: str,
        title: str,
        action: str,
        expected: str,
        *,
        digest: str,
        subject: str = "",
        points: tuple[ItemPoint, ...] = (),
        estimate_s: float = 120.0,
    ) -> Item:
        return Item(
            id=number,
            group=group,
            title=title,
            points=points,
            action=action,
            expected=expected,
            kind=kind.value,
            subject=subject,
            estimate_s=estimate_s,
            digest=digest,
        )

    def _signal_points(self, signal: SignalCodec) -> tuple[ItemPoint, ...]:
        spec = self._source.signals[signal.name]
        points = wording.in_word_order(signal, spec)
        if spec.is_wide:
            points = points[:1]
        printed = spec.addresses
        return tuple(
            ItemPoint(name=signal.name, printed=text, wire=wording.wire(point))
            for point, text in zip(points, printed, strict=True)
        )

    def _command_points(self, command: CommandCodec, only: int | None = None) -> tuple[ItemPoint, ...]:
        spec = command.spec
        codes: Iterable[int | None] = spec.floor_codes if spec.one_of is not None else (None,) * len(command.points)
        return tuple(
            ItemPoint(name=command.name, printed=text, wire=wording.wire(point))
            for point, text, code in zip(command.points, spec.addresses, codes, strict=True)
            if code is None or (code in self._floors.values() and only in (None, code))
        )

    def _digest_of(self, signals: Iterable[str], commands: Iterable[str] = ()) -> str:
        """Hash the parts of the map that these signals and commands consist of, with the floors where they carry one."""
        codec = self._codec
        found: list[object] = []
        named = [name for name in signals if name in codec.signals]
        for name in [one for one in commands if one in codec.commands]:
            command = codec.commands[name]
            found.append([name, command.spec.model_dump(mode="json", exclude={"note"}), list(map(str, command.points))])
            flags = (*command.spec.requires, command.spec.granted_by or "")
            named += [flag for flag in flags if flag in codec.signals]
            if command.is_call:
                found.append(self._floors)
        for name in dict.fromkeys(named):
            signal = codec.signals[name]
            spec = self._source.signals[name].model_dump(mode="json", exclude={"note"})
            found.append([name, spec, list(map(str, signal.points))])
            if signal.kind in (Kind.FLOOR, Kind.FLOORS):
                found.append(self._floors)
        return _digest(found)


_PLACE = ("car_floor", "car_position", "level", "motion")


_ELSEWHERE = "Send the car to another floor with its own buttons."
_TWO_FLOORS = "Send the car to two floors with its own buttons, and say where it is."
_READ = "Read it for some seconds."
_ACTION_OF: Mapping[str, str] = {
    **dict.fromkeys(BY_THE_MANAGER, "The manager takes the empty car to another floor as for a robot, after a yes."),
    **dict.fromkeys(BY_TRAVEL, f"{_ELSEWHERE} Then the lift technician disconnects and reconnects its wire."),
    **dict.fromkeys((*BY_BUTTONS, "car_position"), _ELSEWHERE),
    "load": "Step into the car, or put a known weight into it.",
}
_ACTION_BY_KIND: Mapping[Kind, str] = {
    Kind.FLOOR: _TWO_FLOORS,
    Kind.FLOORS: _TWO_FLOORS,
    Kind.DOOR: "Open and close the door with its own buttons.",
    Kind.MOTION: "Send the car up and down with its own buttons.",
    Kind.MODE: "Put the lift into another service with its key, and back into normal service.",
    Kind.COUNTER: _READ,
    Kind.NUMBER: _READ,
    Kind.FLAG: "Make it true, then false again; then the lift technician disconnects and reconnects its wire.",
}


def _signal_action(signal: SignalCodec) -> str:
    return _ACTION_OF.get(signal.name) or _ACTION_BY_KIND[signal.kind]


def _signal_expected(signal: SignalCodec) -> str:
    match signal.kind:
        case Kind.COUNTER:
            return "It changes by itself."
        case Kind.NUMBER if signal.name not in ("car_position", "load"):
            return "The value is right."
        case Kind.FLAG | Kind.DOOR | Kind.MODE if signal.name not in BY_THE_MANAGER | BY_TRAVEL:
            return "It follows, and nothing else changes."
        case _:
            return "It follows."


def _command_expected(command: CommandCodec) -> str:
    confirmed = wording.confirmation(command.spec)
    rest = wording.link_loss(command.spec)
    return f"Exactly this output changes, and the lift does it{f' ({confirmed})' if confirmed else ''}. Without the manager: {rest}."


def _watchdog_expected(codec: Codec, held: Iterable[str]) -> str:
    parts = []
    for name in held:
        loss = codec.commands[name].spec.on_link_loss
        parts.append(f"{name}: {wording.LINK_LOSS[loss]}" if loss is not None else name)
    return "; ".join(parts) or "Nothing is held on this lift."


def _digest(data: object) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()
