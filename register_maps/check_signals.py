"""Whether each signal of a map is said in a way that fits its kind."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.errors import Problem
from register_maps.plain import closest
from register_maps.schema import SIGNALS, WORDS, Kind, RegisterMap, Signal, parse_address
from register_maps.words import BIT_TABLES

_DOOR_WORDS = {0: "closed", 1: "open"}
"""What a single bit of a door means where the map does not say."""


def check_signals(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of every signal by itself."""
    for name, signal in source.signals.items():
        path = ("signals", name)
        kind = SIGNALS.get(name)
        if kind is None:
            hint = closest(name, SIGNALS) or f"; signals are {', '.join(SIGNALS)}"
            yield Problem(path, f"there is no signal of this name{hint}")
            continue
        for key, message in _signal(kind, signal):
            yield Problem((*path, *key), message)


def word_table(name: str, signal: Signal) -> dict[int, str]:
    """Code to word of a door, motion or mode, as raw values; with the meaning of a bare bit where the map has none."""
    default = _DOOR_WORDS if name.startswith("door.") else {}
    table = signal.values if signal.values is not None else default
    if signal.active == "low" and width_of(signal) == 1:
        return {code ^ 1: word for code, word in table.items()}
    return dict(table)


def width_of(signal: Signal) -> int:
    """How many bits the raw value has, at one point."""
    table, _, bit = parse_address(signal.addresses[0])
    if table in BIT_TABLES or bit is not None:
        return 1
    return 16 if signal.bits is None else signal.bits[1] - signal.bits[0] + 1


Said = Iterator[tuple[tuple[str | int, ...], str]]


def _signal(kind: Kind, signal: Signal) -> Said:
    yield from _form(kind, signal)
    yield from _point(kind, signal)
    if signal.at is not None:
        yield from _coding(kind, signal)
        yield from _codes(signal)


def _form(kind: Kind, signal: Signal) -> Said:
    """One point, one bit per floor, or two limits: each for its kind."""
    if signal.one_of is not None and kind is not Kind.FLOOR:
        yield ("one_of",), f"one bit per floor is for floors, and this is a {kind}; say `at`"
    if signal.open_limit is not None and kind is not Kind.DOOR:
        yield ("open_limit",), f"limits are for doors, and this is a {kind}; say `at`"
    if signal.at is None:
        for key in ("values", "unknown", "none", "bits", "must_change_within_s"):
            if key in signal.model_fields_set:
                yield (key,), "belongs to a signal with `at`; remove it"
    if kind is not Kind.FLOOR and signal.as_ is not None:
        yield ("as",), f"`as: floor` is for floors, and this is a {kind}; remove it"
    if kind is Kind.FLOOR and signal.at is not None and signal.as_ is None:
        yield (), "a floor that is a number needs `as: floor`"


def _point(kind: Kind, signal: Signal) -> Said:
    table, _, bit = parse_address(signal.addresses[0])
    if signal.bits is not None and signal.at is not None:
        if table in BIT_TABLES:
            yield ("bits",), f"a {table} is a single bit; remove `bits`, or give a register"
        elif bit is not None:
            yield ("bits",), f"`at` names bit {bit} already; say either `bits` or the bit"
    width = width_of(signal)
    if signal.type == "int16" and width < 16:
        yield ("type",), f"int16 needs a whole register, and this is {_bits(width)}; use uint16"
    if (signal.type == "counter") is not (kind is Kind.COUNTER):
        yield ("type",), "a counter needs `type: counter`" if kind is Kind.COUNTER else f"a {kind} is not a counter"
    one_bit = kind in (Kind.FLAG, Kind.DOOR) and (width == 1 or kind is Kind.FLAG or signal.at is None)
    if signal.active == "low" and not one_bit:
        yield ("active",), "`active: low` is for a flag, a door's limits or a door's single bit; change the `values`"


def _coding(kind: Kind, signal: Signal) -> Said:
    words = WORDS.get(kind)
    if words is None and signal.values is not None:
        cures = {Kind.FLAG: "to invert it say `active: low`", Kind.FLOOR: "the site file names the floor codes"}
        yield ("values",), f"a {kind} has no table of words; {cures.get(kind, 'remove `values`')}"
    if words is not None and signal.values is None and (kind is not Kind.DOOR or width_of(signal) > 1):
        yield (), f"a {kind} needs `values`, a table of codes and words: {', '.join(set_words(kind))}"
    if words is not None:
        for code, word in (signal.values or {}).items():
            if word not in set_words(kind):
                cure = f"; say `unknown: [{code}]`" if word == "unknown" else closest(word, set_words(kind))
                yield ("values", code), f"{word!r} is no {kind} word{cure or '; use ' + ', '.join(set_words(kind))}"
    elif kind is not Kind.FLOOR and signal.unknown:
        yield ("unknown",), f"a {kind} has no codes; remove `unknown`"
    if kind is not Kind.FLOOR and signal.none:
        yield ("none",), "`none` is for floors; remove it" + (", or say `unknown`" if words is not None else "")
    if kind is Kind.COUNTER and signal.must_change_within_s is None:
        yield (), "a counter needs `must_change_within_s`: how old it may get before the lift counts as lost"
    if kind is not Kind.COUNTER and signal.must_change_within_s is not None:
        yield ("must_change_within_s",), "belongs to a counter; remove it"


def _codes(signal: Signal) -> Said:
    """Codes that the bits cannot hold, and codes with two meanings."""
    width = width_of(signal)
    low, high = (-0x8000, 0x7FFF) if signal.type == "int16" else (0, (1 << width) - 1)
    meanings: dict[int, str] = {}
    places = [
        *((("values", code), code, word) for code, word in (signal.values or {}).items()),
        *((("unknown", index), code, "unknown") for index, code in enumerate(signal.unknown)),
        *((("none", index), code, "none") for index, code in enumerate(signal.none)),
    ]
    for path, code, meaning in places:
        if not low <= code <= high:
            hint = f"; as int16 it is {code - 0x10000}" if signal.type == "int16" and high < code else ""
            hint = hint or ("; a negative code needs `type: int16`" if code < 0 and width == 16 else "")
            yield path, f"code {code} does not fit: {_bits(width)} of {signal.type} hold {low} to {high}{hint}"
        if code in meanings:
            yield path, f"code {code} means {meanings[code]} already; a code has one meaning"
        meanings.setdefault(code, meaning)


def set_words(kind: Kind) -> list[str]:
    """Return the words a table may use; `unknown` has a key of its own."""
    return [word for word in WORDS[kind] if word != "unknown"]


def _bits(width: int) -> str:
    return "1 bit" if width == 1 else f"{width} bits"
