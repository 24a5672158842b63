"""Describes signals and commands of a map in the terms of an electrician: address, coding and use."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from register_maps.codec import Codec, CommandCodec, Point, SignalCodec
from register_maps.command_codec import payload_counts
from register_maps.schema import Command, Kind, Signal
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")

FUNCTIONS = {
    1: "read coils",
    2: "read discrete inputs",
    3: "read holding registers",
    4: "read input registers",
    5: "write one coil",
    6: "write one register",
    15: "write coils",
    16: "write registers",
    22: "mask write register",
}
"""Function codes by their use (Modbus Application Protocol V1.1b3, 6)."""

TABLE_NAMES = {
    Table.COIL: "coils",
    Table.DISCRETE: "discrete inputs",
    Table.HOLDING: "holding registers",
    Table.INPUT: "input registers",
}

LINK_LOSS = {
    "device_watchdog": "the watchdog of the controller releases it",
    "timed_by_device": "the controller ends it by itself",
    "latches": "STAYS ON: nothing releases it",
}
"""What happens to an output when the manager is lost."""

SHARED_WORD = {
    "owned": "the whole register is ours; its spare bits are written as 0",
    "mask_write": "others use this register too; only our bits are changed, by function 22",
    "accepted": "others use this register too; it is read before each write, and a lost update is accepted",
}
"""Notes on a register of which a command has only some bits."""


def one_line(text: str) -> str:
    """Remove control characters and line ends from a foreign text."""
    return " ".join(_CONTROL.sub(" ", text).split())


def identity_text(texts: Mapping[str, str]) -> str:
    """Describe what a controller says that it is: `vendor ACME, product code X1, revision 2.4`."""
    return ", ".join(f"{name.replace('_', ' ')} {text}" for name, text in texts.items())


def wire(point: Point, count: int = 1) -> str:
    """Describe an address on the wire: `holding 5 bit 0`, or `count` adjacent ones: `discrete 0 to 7`."""
    where = f"{point.endpoint}/{point.table}" if point.endpoint else str(point.table)
    if point.table in BIT_TABLES or point.width == 16:
        last = f" to {point.address + count - 1}" if count > 1 else ""
        return f"{where} {point.address}{last}"
    last_bit = point.low + point.width * count - 1
    bits = f"bit {point.low}" if last_bit == point.low else f"bits {point.low} to {last_bit}"
    return f"{where} {point.address} {bits}"


def runs(points: Sequence[Point]) -> Iterator[tuple[int, int]]:
    """Yield (first index, count) of adjacent points, so that eight contacts need only one line."""
    start = 0
    for index in range(1, len(points) + 1):
        if index == len(points) or not _is_adjacent(points[index - 1], points[index]):
            yield start, index - start
            start = index


def in_word_order(signal: SignalCodec, spec: Signal) -> tuple[Point, ...]:
    """Return the points of a signal with the lower address of a 32-bit number first."""
    return tuple(sorted(signal.points)) if spec.is_wide else signal.points


def arbitration(codec: Codec) -> str:
    """Describe what each write carries where the controller decides whom it obeys; empty for every other."""
    if (found := codec.arbitration) is None:
        return ""
    owner, epoch = (wire(min(points), len(points)) for points in (found.owner, found.epoch))
    return f"{owner}: the number of the machine, and {epoch}: the epoch of its term; the controller obeys the highest epoch so far"


def functions(numbers: Sequence[int]) -> str:
    """List function codes: `FC05, FC15`."""
    return ", ".join(f"FC{number:02}" for number in dict.fromkeys(numbers))


def read_functions(points: Sequence[Point]) -> tuple[int, ...]:
    """Return the functions by which these points are read."""
    return tuple(dict.fromkeys(READ_FUNCTION[point.table] for point in points))


def signal_coding(signal: SignalCodec, spec: Signal) -> str:
    """Describe the coding of a signal."""
    inverted = "; inverted: 0 = made" if spec.active == "low" else ""
    if spec.open_limit is not None:
        return f"limit contacts fully open and fully closed; neither = moving, both = fault{inverted}"
    if spec.open_limits is not None:
        return f"one fully-open limit per floor, {_entries(spec)}; none = closed, several = fault{inverted}"
    if spec.up is not None:
        return f"two bits, up and down; neither = stopped, both = unknown{inverted}"
    if spec.one_of is not None:
        return f"one bit per floor, {_entries(spec)}; none = no floor known, several = unknown{inverted}"
    if spec.each_of is not None:
        return f"one bit per floor, {_entries(spec)}; any number of them{inverted}"
    parts = [*_size(signal, spec), _values(signal, spec)]
    if spec.unit and spec.positions is None:
        parts.append(f"in {spec.unit}")
    if spec.unit_s is not None:
        parts.append(f"one count is {spec.unit_s:g} s")
    if spec.known_while is not None:
        parts.append(f"counts only while motion says {spec.known_while}")
    if spec.must_change_within_s is not None:
        parts.append(f"must change within {spec.must_change_within_s:g} s")
    return "; ".join(filter(None, parts))


def command_coding(command: CommandCodec) -> str:
    """Describe the values that give and release a command."""
    spec = command.spec
    if spec.one_of is not None:
        each = "one relay pulse per floor" if command.is_timed_coil else "one output per floor"
        return f"{each}, {_entries(spec)}; {one_output(command)}"
    if spec.action == "count":
        return "counts up from 1, and never writes 0"
    if spec.action == "toggle":
        return "0 and 1 in turn"
    if spec.as_ is not None:
        number = "signed number" if spec.type == "int16" else "BCD number" if spec.code == "bcd" else "number"
        number += _byte_order(spec)
        rest = "" if command.spec.ends_itself else f"; {spec.rest} = no command"
        return f"{number}, the code of a floor{rest}"
    return one_output(command) + _byte_order(spec)


def action(spec: Command) -> str:
    """Describe how a command is given and how it ends."""
    if spec.is_heartbeat:
        return f"always written, every {spec.every_s or 0:g} s"
    parts = list(_action(spec))
    if spec.reset_first_s:
        parts.append(f"the rest value is written {spec.reset_first_s:g} s before each press")
    if spec.min_repeat_s:
        parts.append(f"at least {spec.min_repeat_s:g} s from press to press")
    return "; ".join(parts)


def confirmation(spec: Command) -> str:
    """Describe the evidence of a command; empty if the map has none."""
    if spec.confirm is None:
        return ""
    words = {"effect": "the lift does it", "readback": "the output reads back as written"}
    shown = " or ".join(words.get(name, f"{name} shows it") for name in spec.confirm.any_of)
    return f"{shown}, within {spec.confirm.within_s:g} s"


def conditions(spec: Command) -> str:
    """Describe the conditions of a press, what is released first, and what the controller grants."""
    parts = []
    if spec.requires:
        parts.append(f"only while {' and '.join(spec.requires)} {'reads' if len(spec.requires) == 1 else 'read'} yes")
    if spec.excludes:
        gap = f" {spec.gap_s:g} s before" if spec.gap_s else ""
        parts.append(
            f"{' and '.join(spec.excludes)} {'is' if len(spec.excludes) == 1 else 'are'} released{gap or ' first'}"
        )
    if spec.granted_by is not None:
        parts.append(f"granted by {spec.granted_by}, within {spec.granted_within_s:g} s")
    return "; ".join(parts)


def link_loss(spec: Command) -> str:
    """Describe what happens to a command when the manager is lost."""
    if spec.on_link_loss is not None:
        return LINK_LOSS[spec.on_link_loss]
    if spec.is_heartbeat:
        return "stops: that is how the controller notices"
    if spec.ends_itself:
        return LINK_LOSS["timed_by_device"]
    return "a press that is on STAYS ON until the manager is back"


def _is_adjacent(one: Point, other: Point) -> bool:
    if (one.endpoint, one.table, one.width) != (other.endpoint, other.table, other.width):
        return False
    if one.is_whole:
        return other.address == one.address + 1
    return other.address == one.address and other.low == one.low + one.width


def _entries(spec: Signal | Command) -> str:
    """Describe the order of a list with one entry per floor."""
    return "lowest first" if spec.codes is None else f"for the codes {', '.join(map(str, spec.codes))}"


def _byte_order(spec: Signal | Command) -> str:
    return ", low byte first" if spec.byte_order == "low_first" else ""


def _size(signal: SignalCodec, spec: Signal) -> Iterator[str]:
    if spec.code_of is not None:
        yield f"{len(signal.points)} bits, lowest first"
    elif spec.is_wide:
        order = "high word first" if spec.word_order == "high_first" else "low word first"
        yield f"two registers, 32 bits, {order}{_byte_order(spec)}"
    elif spec.byte_order == "low_first":
        yield "low byte first"
    elif spec.bits is not None and signal.points[0].width > 1:
        yield f"{signal.points[0].width} bits"
    if spec.type in ("int16", "int32"):
        yield "signed"
    if spec.code == "gray":
        yield "Gray code"
    if spec.code == "bcd":
        yield "BCD"
    if spec.active == "low" and signal.width > 1 and signal.kind is not Kind.FLAG:
        yield "every bit inverted"


def _values(signal: SignalCodec, spec: Signal) -> str:
    special = [f"{code} = not known" for code in spec.unknown] + [f"{code} = no floor" for code in spec.none]
    if spec.thresholds:
        return ", ".join([*_thresholds(spec), *special])
    if signal.kind is Kind.FLAG:
        yes = spec.means_yes if signal.width > 1 else 1
        return f"0 = yes, {yes} = no (inverted)" if spec.active == "low" else f"{yes} = yes, 0 = no"
    if signal.kind in (Kind.DOOR, Kind.MOTION, Kind.MODE):
        flip = 1 if spec.active == "low" and signal.width == 1 else 0
        table = spec.values or {0: "closed", 1: "open"}
        told = ", ".join([*(f"{code ^ flip} = {word}" for code, word in table.items()), *special])
        return f"{told} (inverted)" if flip else told
    if spec.positions is not None:
        unit = f" {spec.unit}" if spec.unit else ""
        floors = ", ".join(f"{position}{unit} = code {code}" for code, position in spec.positions.items())
        return ", ".join([f"the floor within {spec.tolerance}{unit} of its position: {floors}", *special])
    if signal.kind is Kind.FLOOR:
        return ", ".join(["the code of a floor", *special])
    return {Kind.COUNTER: "a number that changes"}.get(signal.kind, "a number")


def _thresholds(spec: Signal) -> Iterator[str]:
    """Describe what a number means that shows a flag or a door."""
    if spec.open_at is not None and spec.closed_at is not None:
        opens_up = spec.open_at > spec.closed_at
        yield f"{spec.open_at} or {'more' if opens_up else 'less'} = open"
        yield f"{spec.closed_at} or {'less' if opens_up else 'more'} = closed, between = moving"
    elif spec.yes_to is None:
        yield f"{spec.yes_from} or more = yes, less = no"
    elif spec.yes_from is None:
        yield f"{spec.yes_to} or less = yes, more = no"
    else:
        yield f"{spec.yes_from} to {spec.yes_to} = yes, everything else = no"
    if spec.range is not None:
        yield f"outside {spec.range[0]} to {spec.range[1]} = not known"


def one_output(command: CommandCodec) -> str:
    """Describe one output of a command."""
    spec = command.spec
    if spec.payload is not None:
        counts = f"{payload_counts(spec)} counts of {spec.payload.unit_s:g} s"
        if command.is_timed_coil:
            return f"the time in the request ({counts}) closes the relay"
        return f"the time it is to last ({counts}) is written; {spec.rest} releases it"
    on, rest = spec.on, spec.rest
    return f"{on} = on" if spec.ends_itself else f"{on} = on, {rest} = released"


def press_text(*, is_hold: bool, ends_itself: bool, width_s: float | None, max_hold_s: float | None, until: str) -> str:
    """Describe how long a command is on, and what ends it."""
    if ends_itself:
        return f"a press of {width_s or 0.0:g} s that the device ends; nothing is written back"
    if not is_hold:
        return f"pressed for {width_s or 0.0:g} s, then released"
    ends = {"arrived": "until the car is there", "closed": "until the door is closed"}
    ends |= {"robot_in_place": "until the robot is in place", "robot_left": "until the robot has left"}
    return f"held {ends.get(until, 'until released')}, at most {max_hold_s or 0.0:g} s unless renewed"


def _action(spec: Command) -> Iterator[str]:
    is_hold = spec.action != "pulse"
    yield press_text(
        is_hold=is_hold,
        ends_itself=spec.ends_itself,
        width_s=spec.width_s,
        max_hold_s=spec.max_hold_s,
        until=spec.until or "",
    )
    if is_hold and spec.repeat_pulse_s is not None:
        yield f"made of presses of {spec.width_s or 0.0:g} s, every {spec.repeat_pulse_s:g} s"
    if spec.refresh_s is not None:
        yield f"written again every {spec.refresh_s:g} s"
    if spec.self_clearing:
        yield "taken and cleared by the controller, so its point does not show whether it is on"
    if spec.cleared_after_s is not None:
        yield f"cleared by the controller after {spec.cleared_after_s:g} s, to see it written again"
    if spec.released_after_s is not None:
        yield f"released by the controller after {spec.released_after_s:g} s, however often it is written again"
    if spec.bounded_by == "session":
        yield "ends with the session"
