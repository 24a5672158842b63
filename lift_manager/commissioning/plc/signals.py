"""Writes the half of the program that reports signals: from the contacts of the lift to the cells that the manager reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lift_manager.commissioning.plc import cells
from lift_manager.commissioning.plc.errors import ProgramError
from lift_manager.commissioning.plc.terminals import shows_lamps
from register_maps.codec import UNLISTED, Codec, Point, SignalCodec, Value
from register_maps.schema import Kind
from register_maps.words import BIT_TABLES, Door, Mode, Motion

_FLAGS = {
    "fire": ("NoFire", False),
    "inspection": ("NoInspection", False),
    "independent": ("NoIndependent", False),
    "out_of_service": ("InService", False),
    "emergency_power": ("MainsOn", False),
    "robots_allowed": ("RobotsAllowed", True),
    "robot_mode_on": ("RobotModeOn", True),
    "level": ("LevelSwitch", True),
    "obstruction.front": ("DoorwayClear", False),
    "overload": ("LoadOk", False),
}
"""The variable behind each flag, and its value while the flag is set."""

_MODES = (
    (Mode.INSPECTION, "NOT NoInspection"),
    (Mode.FIRE, "NOT NoFire"),
    (Mode.EMERGENCY, "NOT MainsOn"),
    (Mode.OUT_OF_SERVICE, "NOT InService"),
    (Mode.INDEPENDENT, "NOT NoIndependent"),
    (Mode.ROBOT, "RobotModeOn"),
    (Mode.NORMAL, "TRUE"),
)
"""The condition of each mode; highest precedence first, by the table in register_maps/GRAMMAR.md."""

_MOTIONS = (
    (Motion.UP, "MovesUp AND NOT MovesDown"),
    (Motion.DOWN, "MovesDown AND NOT MovesUp"),
    (Motion.STOPPED, "NOT MovesUp AND NOT MovesDown"),
)

_PAIRS: Mapping[Kind, tuple[Door | Motion, str, str]] = {
    Kind.DOOR: (Door.OPEN, "DoorOpenLimit", "DoorClosedLimit"),
    Kind.MOTION: (Motion.UP, "MovesUp", "MovesDown"),
}
"""For signals of two bits: the word that sets only the first bit, and the contacts behind both."""

_BEAT_S = 0.5
"""The period of the alive counter. Chosen: several counts within any `must_change_within_s` that a map may require."""

OBEYED: Mapping[str, Sequence[str]] = {
    "epoch": ("ObeyedEpochLow", "ObeyedEpochHigh"),
    "owner": ("ObeyedOwner",),
}
"""The words that say whom the program obeys, the lowest first; the caller retains them without power."""

Cases = Sequence[tuple[str, int]]
"""Conditions with the raw integers to report; the first condition that holds counts."""


@dataclass(frozen=True, slots=True)
class Part:
    """A piece of the program."""

    declarations: tuple[str, ...] = ()
    statements: tuple[str, ...] = ()


def signal_part(codec: Codec, floor_codes: Sequence[int]) -> Iterator[Part]:
    """Yield the parts that report every signal of the map."""
    numbers = range(1, len(floor_codes) + 1)
    if "car_floor" in codec.signals:
        yield _where(numbers)
    if shows_lamps(codec):
        yield _accepted(numbers)
    yield from _words(codec)
    for signal in codec.signals.values():
        yield _signal(signal, floor_codes)
    for register in _shared(codec):
        yield Part((), (f"{cells.cell(register)} := {_word(register)};",))


def _where(numbers: range) -> Part:
    found = [f"IF AtFloor{n} THEN FloorHere := {n}; Switches := Switches + 1; END_IF;" for n in numbers]
    return Part(
        (
            "FloorHere : INT;  (* the floor whose switch is made; 0 = none, or several *)",
            "FloorLast : INT;  (* the floor passed last; 0 = not known *)",
            "Switches : INT;",
        ),
        (
            "FloorHere := 0;",
            "Switches := 0;",
            *found,
            "IF Switches > 1 THEN",
            "  FloorHere := 0;",
            "  FloorLast := 0;  (* two switches at once: one of them lies *)",
            "ELSIF Switches = 1 THEN",
            "  FloorLast := FloorHere;",
            "END_IF;",
        ),
    )


def _accepted(numbers: range) -> Part:
    """Return the part for the call that the lift has not served yet: from our press until its lamp goes out."""
    lamps = " OR ".join(f"(CalledLast = {n} AND CallLamp{n})" for n in numbers)
    return Part(
        ("CallAccepted : INT;  (* the last call, while its lamp is lit; 0 = none *)", "LampLit : BOOL;"),
        (
            f"LampLit := {lamps};",
            "IF LampLit THEN",
            "  CallAccepted := CalledLast;",
            "ELSIF CallAccepted = CalledLast THEN",
            "  CallAccepted := 0;",
            "  CalledLast := 0;  (* served; the same lamp may light for a passenger later *)",
            "ELSE",
            "  CallAccepted := 0;",
            "END_IF;",
        ),
    )


def _words(codec: Codec) -> Iterator[Part]:
    """Yield what the signals need besides the contacts: the last limit of the door, and cleared shared registers."""
    door = codec.signals.get("door.front")
    if door is not None and len(door.points) == 1:
        yield Part(
            ("LeftOpen : BOOL;  (* the limit the door was at last *)", "LeftClosed : BOOL;"),
            (
                "IF DoorOpenLimit OR DoorClosedLimit THEN",
                "  LeftOpen := DoorOpenLimit;",
                "  LeftClosed := DoorClosedLimit;",
                "END_IF;",
            ),
        )
    shared = _shared(codec)
    if shared:
        yield Part(
            tuple(f"{_word(register)} : WORD;" for register in shared),
            tuple(f"{_word(register)} := 16#0000;" for register in shared),
        )


def _signal(signal: SignalCodec, floor_codes: Sequence[int]) -> Part:
    match signal.kind:
        case Kind.COUNTER:
            return _alive(signal)
        case Kind.FLAG:
            variable, when = _FLAGS[signal.name]
            return Part((), tuple(_flag(signal, variable, when=when)))
        case Kind.NUMBER:
            return Part((), tuple(_obeyed(signal)))
        case Kind.FLOOR:
            variable = {"car_floor": "FloorHere" if len(signal.points) > 1 else "FloorLast"}.get(
                signal.name, "CallAccepted"
            )
            cases = [(f"{variable} = {n}", signal.encode(code)) for n, code in enumerate(floor_codes, start=1)]
            return Part((), tuple(_spread(signal, cases) if len(signal.points) > 1 else _chain(signal, cases)))
        case Kind.DOOR | Kind.MOTION if len(signal.points) == 2:
            return Part((), tuple(_pair(signal)))
        case Kind.DOOR:
            return Part((), tuple(_chain(signal, _listed(signal, _doors(signal)))))
        case _:
            words = _MOTIONS if signal.kind is Kind.MOTION else _MODES
            return Part((), tuple(_chain(signal, _listed(signal, words))))


def _obeyed(signal: SignalCodec) -> Iterator[str]:
    words = OBEYED[signal.name]
    if signal.points[0].table not in BIT_TABLES:
        yield from (f"{cells.cell(point)} := {word};" for point, word in zip(signal.points, words, strict=True))
        return
    for position, point in enumerate(signal.points):
        mask = f"16#{1 << position % 16:04X}"
        yield f"{cells.cell(point)} := (({words[position // 16]} AND {mask}) = {mask});"


def _doors(signal: SignalCodec) -> Sequence[tuple[Door, str]]:
    between = [(Door.MOVING, "TRUE")] if _has(signal, Door.MOVING) else []
    return (
        (Door.FAULT, "DoorOpenLimit AND DoorClosedLimit"),
        (Door.OPEN, "DoorOpenLimit"),
        (Door.CLOSED, "DoorClosedLimit"),
        *(between or [(Door.CLOSING, "LeftOpen AND NOT LeftClosed"), (Door.OPENING, "LeftClosed AND NOT LeftOpen")]),
    )


def _listed(signal: SignalCodec, words: Sequence[tuple[Door | Motion | Mode, str]]) -> Cases:
    """Return the code for each word. A word without a code in the map is reported as unknown, never as one of lower precedence."""
    return [(when, signal.encode(word) if _has(signal, word) else _blank(signal)) for word, when in words]


def _flag(signal: SignalCodec, variable: str, *, when: bool) -> Iterator[str]:
    point, yes = signal.points[0], signal.encode(True)
    if point.width == 1 or point.table in BIT_TABLES:
        yield from _bit(point, variable if when is bool(yes) else f"NOT {variable}")
        return
    yield from _chain(signal, [(variable if when else f"NOT {variable}", yes), ("TRUE", signal.encode(False))])


def _pair(signal: SignalCodec) -> Iterator[str]:
    """Yield the statements for two contacts, which are reported as they are: the manager interprets them together."""
    first, *contacts = _PAIRS[signal.kind]
    active_high = signal.encode(first) & 1
    for point, contact in zip(signal.points, contacts, strict=True):
        yield from _bit(point, contact if active_high else f"NOT {contact}")


def _spread(signal: SignalCodec, cases: Cases) -> Iterator[str]:
    """Yield the statements for several bits. Each floor sets the bits of its code; without a floor, none is set."""
    for position, point in enumerate(signal.points):
        setting = [f"({when})" for when, raw in cases if raw >> position & 1]
        yield from _bit(point, " OR ".join(setting) or "FALSE")


def _bit(point: Point, condition: str) -> Iterator[str]:
    if point.table in BIT_TABLES:
        yield f"{cells.cell(point)} := {condition};"
    else:
        yield f"IF {condition} THEN {_word(point)} := {_word(point)} OR {cells.literal(point, 1 << point.low)}; END_IF;"


def _chain(signal: SignalCodec, cases: Cases) -> Iterator[str]:
    """Yield the statements for one point: the value of the first condition that holds, or unknown."""
    word = "IF"
    for when, raw in cases:
        if when == "TRUE":
            break
        yield f"{word} {when} THEN"
        yield f"  {_put(signal.points[0], raw)}"
        word = "ELSIF"
    else:
        raw = _blank(signal)
    yield "ELSE"
    yield f"  {_put(signal.points[0], raw)}"
    yield "END_IF;"


def _put(point: Point, raw: int) -> str:
    if point.is_whole:
        return f"{cells.cell(point)} := {cells.literal(point, raw)};"
    return f"{_word(point)} := {_word(point)} OR {cells.literal(point, raw << point.low)};"


def _alive(signal: SignalCodec) -> Part:
    point = signal.points[0]
    return Part(
        ("Beat : TON;", "Beats : UINT;"),
        (
            f"Beat(IN := NOT Beat.Q, PT := {cells.seconds(_BEAT_S)});",
            "IF Beat.Q THEN",
            "  IF Beats = 65535 THEN Beats := 0; ELSE Beats := Beats + 1; END_IF;",
            "END_IF;",
            f"{cells.cell(point)} := UINT_TO_WORD(Beats);",
        ),
    )


def _shared(codec: Codec) -> tuple[Point, ...]:
    """Return the registers that several signals share, each as one of its points."""
    parts = [point for point in codec.signal_points if not point.is_whole]
    return tuple({(point.table, point.address): point for point in parts}.values())


def _word(point: Point) -> str:
    return f"{point.table.capitalize()}{point.address}"


def _has(signal: SignalCodec, word: Value) -> bool:
    try:
        signal.encode(word)
    except ValueError:
        return False
    return True


def _blank(signal: SignalCodec) -> int:
    """Return the raw integer for unknown. Raises ProgramError if the map has none."""
    if _has(signal, None):
        return signal.encode(None)
    if signal.decode(0) in (UNLISTED, None):
        return 0
    raise ProgramError(
        f"{signal.name} has no code for unknown, and 0 means {signal.decode(0)}; "
        "let its codes start at 1, so that zeros are never believed"
    )
