"""Checks that each signal of a map is declared in a form that fits its kind."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from register_maps.error_texts import closest
from register_maps.errors import Problem
from register_maps.schema import SIGNALS, WORDS, Kind, RegisterMap, Signal
from register_maps.signal_codec import highest_bcd, number_range
from register_maps.signal_schema import PLACE_KEYS
from register_maps.words import BIT_TABLES

Messages = Iterator[tuple[tuple[str | int, ...], str]]

_SINGLE = frozenset(Kind) - {Kind.FLOORS}
_FORMS: dict[str, tuple[frozenset[Kind], str]] = {
    "at": (_SINGLE, "one point is not enough for one bit per floor"),
    "one_of": (frozenset({Kind.FLOOR}), "one bit per floor is for floors"),
    "each_of": (frozenset({Kind.FLOORS}), "any number of bits at once is for calls_registered"),
    "code_of": (frozenset({Kind.FLOOR, Kind.NUMBER}), "bits of a code are for floors and numbers"),
    "open_limit": (frozenset({Kind.DOOR}), "limits are for doors"),
    "open_limits": (frozenset({Kind.DOOR}), "limits are for doors"),
    "up": (frozenset({Kind.MOTION}), "two directions are for the motion"),
}
"""The kinds that each form is for, with the reason for the others."""

_BELONGS: dict[str, tuple[str, ...]] = {
    "values": ("at",),
    "bits": ("at",),
    "must_change_within_s": ("at",),
    "word_order": ("at",),
    "byte_order": ("at",),
    "positions": ("at",),
    "tolerance": ("at",),
    "codes": ("one_of", "each_of", "open_limits"),
    "means_yes": ("at",),
    "yes_from": ("at",),
    "yes_to": ("at",),
    "open_at": ("at",),
    "closed_at": ("at",),
    "range": ("at",),
    "unknown": ("at", "code_of"),
    "none": ("at", "code_of"),
    "code": ("at", "code_of"),
}
"""Keys that belong to some forms only."""


def check_signals(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of every signal by itself."""
    for name, signal in source.signals.items():
        if name in source.derived:
            continue
        path = ("signals", name)
        kind = SIGNALS.get(name)
        if kind is None:
            hint = closest(name, SIGNALS) or f"; signals are {', '.join(SIGNALS)}"
            yield Problem(path, f"there is no signal of this name{hint}")
            continue
        for key, message in _signal(source, name, kind, signal):
            yield Problem((*path, *key), message)


def _signal(source: RegisterMap, name: str, kind: Kind, signal: Signal) -> Messages:
    width = _width(source, signal)
    yield from _form(kind, signal)
    yield from _single_bits(source, signal)
    yield from _field(source, signal)
    yield from _type(kind, signal, width)
    yield from _level(kind, signal, width)
    yield from _units(name, kind, signal)
    yield from _counting(kind, signal)
    yield from check_codes(signal.codes, signal.one_of or signal.each_of or signal.open_limits, "bits")
    yield from _byte_order(signal, width)
    if signal.positions is not None:
        yield from _positions(source, name, signal, width)
    if signal.known_while is not None:
        if name != "car_floor":
            yield ("known_while",), "belongs to car_floor; remove it"
        elif "motion" not in source.signals:
            yield ("known_while",), "no signal shows when the car is stopped; declare `motion`, or remove it"
    if signal.at is not None:
        yield from _words(kind, signal, width)
        yield from _flag(kind, signal, width)
        yield from _thresholds(kind, signal, width)
    if signal.at is not None or signal.code_of is not None:
        yield from _reserved(kind, signal)
        yield from _codes(signal, width)


def check_codes(codes: tuple[int, ...] | None, entries: tuple[str, ...] | None, sort: str) -> Messages:
    """Yield mistakes in the floor codes of a list with one bit or output per floor."""
    if codes is None or entries is None:
        return
    if len(codes) != len(entries):
        yield (
            ("codes",),
            f"has {len(codes)} entries for {len(entries)} {sort}; give the floor code of each, in their order",
        )
    for index, code in enumerate(codes):
        if code in codes[:index]:
            yield ("codes", index), f"code {code} is given twice; every floor has a code of its own"


def _byte_order(signal: Signal, width: int) -> Messages:
    if signal.byte_order == "low_first" and signal.at is not None and (width < 16 or signal.bits is not None):
        message = "is for whole registers; name the bits as they are on the wire, and remove it"
        yield ("byte_order",), message


def _positions(source: RegisterMap, name: str, signal: Signal, width: int) -> Messages:
    positions, tolerance = signal.positions or {}, signal.tolerance or 0
    if name != "car_position":
        yield ("positions",), "belongs to car_position; remove it"
        return
    if "car_floor" not in source.derived:
        yield ("positions",), "the map has a car_floor of its own, and nothing would read this; remove one of the two"
    if len(positions) < 2:
        yield ("positions",), "a lift has at least two floors; give the position of each"
    for code, position in positions.items():
        if (message := _misfit(signal, position, width)) is not None:
            yield ("positions", code), message.replace("code", "position", 1)
    ordered = sorted(positions.items(), key=lambda item: item[1])
    is_between = bool(signal.unknown)
    for (low, low_at), (high, high_at) in itertools.pairwise(ordered):
        if high_at - low_at <= 2 * tolerance:
            cure = "give a smaller one" if tolerance else "give each a position of its own"
            message = f"with a tolerance of {tolerance} the car would be at floors {low} and {high} at once; {cure}"
            yield ("tolerance",), message
        is_between |= high_at - low_at > 2 * tolerance + 1
    if len(positions) > 1 and not is_between:
        message = "no value is left for a car that is at no floor; list one under `unknown`, such as what the controller shows at its start"
        yield ("positions",), message


def _width(source: RegisterMap, signal: Signal) -> int:
    """Return the bits of the raw value; of a 32-bit number, those of its first register."""
    if signal.code_of is not None:
        return len(signal.code_of)
    if signal.at is None:
        return 1
    place = source.place(signal.at)
    if place.table in BIT_TABLES or place.bit is not None:
        return 1
    return 16 if signal.bits is None else signal.bits[1] - signal.bits[0] + 1


def _form_of(signal: Signal) -> str:
    """Return the first key of the form in which a signal gives its place."""
    return next(keys[0] for keys in PLACE_KEYS if getattr(signal, keys[0]) is not None)


def _form(kind: Kind, signal: Signal) -> Messages:
    """Yield forms that do not fit the kind, and keys that do not fit the form."""
    form = _form_of(signal)
    kinds, purpose = _FORMS[form]
    if kind not in kinds:
        cures = [f"`{key}`" for key, (others, _) in _FORMS.items() if kind in others]
        yield (form,), f"{purpose}, and this is a {kind}; use {' or '.join(cures)}"
    for key, forms in _BELONGS.items():
        if key in signal.model_fields_set and form not in forms:
            yield (key,), f"belongs to a signal with {' or '.join(f'`{other}`' for other in forms)}; remove it"
    if kind is not Kind.FLOOR and signal.as_ is not None:
        yield ("as",), f"`as: floor` is for floors, and this is a {kind}; remove it"
    if kind is Kind.FLOOR and signal.at is not None and signal.as_ is None:
        yield (), "a floor that is a number needs `as: floor`"


def _single_bits(source: RegisterMap, signal: Signal) -> Messages:
    if signal.at is not None:
        return
    for key, text in signal.keyed_addresses:
        place = source.place(text)
        if place.table not in BIT_TABLES and place.bit is None:
            yield key, f"{text} is a whole register, and one bit is meant; name it, such as {text}.0"


def _field(source: RegisterMap, signal: Signal) -> Messages:
    if signal.bits is None or signal.at is None:
        return
    place = source.place(signal.at)
    if place.table in BIT_TABLES:
        yield ("bits",), f"a {place.table} is a single bit; remove `bits`, or give a register"
    elif place.bit is not None:
        yield ("bits",), f"`at` names bit {place.bit} already; give either `bits` or the bit"
    elif signal.is_wide:
        yield ("bits",), f"{signal.type} fills two registers; remove `bits`, or use uint16"


def _type(kind: Kind, signal: Signal, width: int) -> Messages:
    if (signal.type == "counter") is not (kind is Kind.COUNTER):
        yield ("type",), "a counter needs `type: counter`" if kind is Kind.COUNTER else f"a {kind} is not a counter"
    elif signal.is_wide and kind not in (Kind.NUMBER, Kind.FLOOR) and not signal.thresholds:
        yield ("type",), f"{signal.type} is for numbers and floors, and this is a {kind}; use uint16 or int16"
    elif signal.is_wide and (width == 1 or signal.at is None):
        yield (
            ("type",),
            f"{signal.type} needs two whole registers, and this is {_bits(width)}; give the first of the two",
        )
    elif signal.type == "int16" and (width < 16 or signal.at is None):
        yield ("type",), f"int16 needs a whole register, and this is {_bits(width)}; use uint16"
    if signal.is_wide and signal.word_order is None:
        message = "a number in two registers needs `word_order`: `high_first` if the high half has the lower address, else `low_first`"
        yield (), message
    if not signal.is_wide and signal.word_order is not None and signal.at is not None:
        yield ("word_order",), "belongs to a number in two registers; remove it, or use `type: uint32`"


def _level(kind: Kind, signal: Signal, width: int) -> Messages:
    """Yield what is wrong with inverted bits, and with codes other than binary."""
    coded = kind is Kind.FLOOR and signal.type == "uint16" and width > 1
    inverted = kind is Kind.FLAG or (kind is Kind.DOOR and width == 1) or (coded and signal.bits is not None)
    if signal.active == "low" and (signal.at is not None or kind is Kind.NUMBER) and not inverted:
        message = "`active: low` is for a flag, a door's single bit or limits, and the bits of a position code; change the `values`"
        yield ("active",), message
    if signal.code == "bcd":
        unsigned = signal.type in ("uint16", "uint32") and width > 1
        counts = kind in (Kind.FLOOR, Kind.NUMBER) or bool(signal.thresholds)
        if _form_of(signal) in _BELONGS["code"] and not (unsigned and counts):
            cure = "remove `code`"
            if counts and width > 1:
                cure = "use `type: uint16`, and for a floor with a sign `positions`"
            yield ("code",), f"BCD is for a floor or a number in several bits, without a sign; {cure}"
    elif "code" in signal.model_fields_set and _form_of(signal) in _BELONGS["code"] and not coded:
        cure = "use `type: uint16`" if kind is Kind.FLOOR and width > 1 else "remove `code`"
        yield ("code",), f"`code` is for a floor in several bits, without a sign; {cure}"


def _units(name: str, kind: Kind, signal: Signal) -> Messages:
    if signal.unit and kind is not Kind.NUMBER and not signal.thresholds:
        yield ("unit",), f"belongs to a number, and this is a {kind}; remove it"
    if name == "watchdog_time":
        if signal.unit_s is None:
            yield (), "watchdog_time needs `unit_s`: how many seconds one count of it is"
    elif signal.unit_s is not None:
        yield ("unit_s",), "belongs to watchdog_time; remove it, or give the unit of a number with `unit`"


def _counting(kind: Kind, signal: Signal) -> Messages:
    if kind is Kind.COUNTER and signal.must_change_within_s is None:
        yield (), "a counter needs `must_change_within_s`: how old it may get before the lift counts as lost"
    if kind is not Kind.COUNTER and signal.must_change_within_s is not None and signal.at is not None:
        yield ("must_change_within_s",), "belongs to a counter; remove it"


def _words(kind: Kind, signal: Signal, width: int) -> Messages:
    words = WORDS.get(kind)
    if words is None:
        if signal.values is not None:
            cures = {Kind.FLAG: "to invert it use `active: low`", Kind.FLOOR: "the site file names the floor codes"}
            yield ("values",), f"a {kind} has no table of words; {cures.get(kind, 'remove `values`')}"
        return
    # `unknown` has a key of its own
    allowed = [word for word in words if word != "unknown"]
    if signal.values is None and (kind is not Kind.DOOR or width > 1) and not signal.thresholds:
        yield (), f"a {kind} needs `values`, a table of codes and words: {', '.join(allowed)}"
    if kind is Kind.DOOR and signal.values is not None and len(set(signal.values.values())) < 2:
        only = ", ".join(sorted(set(signal.values.values()))) or "no word"
        message = (
            f"with {only} alone an open and a shut door read the same; give at least two words, one of them not `open`"
        )
        yield ("values",), message
    for code, word in (signal.values or {}).items():
        if word not in allowed:
            cure = f"; use `unknown: [{code}]`" if word == "unknown" else closest(word, allowed)
            yield ("values", code), f"{word!r} is no {kind} word{cure or '; use ' + ', '.join(allowed)}"


def _flag(kind: Kind, signal: Signal, width: int) -> Messages:
    if "means_yes" not in signal.model_fields_set:
        return
    code = signal.means_yes
    if kind is not Kind.FLAG:
        yield ("means_yes",), f"belongs to a flag, and this is a {kind}; remove it"
    elif width == 1:
        yield ("means_yes",), "a single bit means yes at 1, or with `active: low` at 0; remove `means_yes`"
    elif code == 0:
        yield ("means_yes",), "0 is no already; to invert the flag use `active: low`, else give the code for yes"
    elif (message := _misfit(signal, code, width)) is not None:
        yield ("means_yes",), message


def _thresholds(kind: Kind, signal: Signal, width: int) -> Messages:
    """Yield what is wrong with a flag or a door that a number shows."""
    thresholds = signal.thresholds
    own = ("yes_from", "yes_to") if kind is Kind.FLAG else ("open_at", "closed_at") if kind is Kind.DOOR else ()
    if misplaced := [key for key in thresholds if key not in own]:
        owner = Kind.FLAG if misplaced[0].startswith("yes") else Kind.DOOR
        yield (misplaced[0],), f"belongs to a {owner}, and this is a {kind}; remove it"
    elif not thresholds and signal.range is not None:
        message = "belongs to a flag with `yes_from` or `yes_to`, or a door with `open_at` and `closed_at`; remove it"
        yield ("range",), message
    elif thresholds and width == 1:
        yield (next(iter(thresholds)),), "is for a number, and this is a single bit; give the register of the number"
    elif thresholds:
        for other in ("means_yes", "active") if kind is Kind.FLAG else ("values",):
            if other in signal.model_fields_set:
                yield (other,), f"{' and '.join(f'`{key}`' for key in thresholds)} say what the number means; remove it"
        yield from _limits(kind, signal, width)
        for key, number in thresholds.items():
            if (problem := _off_limits(signal, number, width)) is not None:
                yield (key,), problem


def _off_limits(signal: Signal, number: int, width: int) -> str | None:
    """Return why a number cannot be a threshold; None if it can."""
    if (message := _misfit(signal, number, width)) is not None:
        return message.replace("code", "number", 1)
    if signal.range is not None and not signal.range[0] <= number <= signal.range[1]:
        return f"{number} is outside `range`, {signal.range[0]} to {signal.range[1]}; correct one of the two"
    return f"{number} is `unknown` already; a number has one meaning" if number in signal.unknown else None


def _limits(kind: Kind, signal: Signal, width: int) -> Messages:
    """Yield numbers between which the thresholds decide nothing."""
    if signal.range is None and kind is Kind.DOOR:
        yield (
            (),
            "a door that shows its position needs `range`, its lowest and highest one: nothing else may read as open",
        )
    for number in signal.range or ():
        if (message := _misfit(signal, number, width)) is not None:
            yield ("range",), message.replace("code", "number", 1)
    low, high = signal.range or number_range(signal, 32 if signal.is_wide else width)
    if low >= high:
        yield ("range",), f"[{low}, {high}] holds no two numbers; write the lowest first"
    elif kind is Kind.DOOR and abs((signal.open_at or 0) - (signal.closed_at or 0)) < 2:
        yield ("closed_at",), "leaves no position between open and closed, where the door moves; give another one"
    elif kind is Kind.FLAG:
        first, last = signal.yes_from, signal.yes_to
        if first is not None and last is not None and first > last:
            yield ("yes_to",), f"no number is at least {first} and at most {last}; exchange the two"
        elif (first is None or first <= low) and (last is None or last >= high):
            yield (
                (next(iter(signal.thresholds)),),
                f"every number from {low} to {high} would mean yes; give another one",
            )


def _reserved(kind: Kind, signal: Signal) -> Messages:
    has_codes = kind is Kind.FLOOR or kind in WORDS or signal.positions is not None or bool(signal.thresholds)
    if signal.unknown and not has_codes:
        yield ("unknown",), f"a {kind} has no codes; remove `unknown`"
    if kind is not Kind.FLOOR and signal.none:
        yield ("none",), "`none` is for floors; remove it" + (", or use `unknown`" if kind in WORDS else "")


def _codes(signal: Signal, width: int) -> Messages:
    """Yield codes that the bits cannot hold, and codes with two meanings."""
    meanings: dict[int, str] = {}
    places = [
        *((("values", code), code, word) for code, word in (signal.values or {}).items()),
        *((("unknown", index), code, "unknown") for index, code in enumerate(signal.unknown)),
        *((("none", index), code, "none") for index, code in enumerate(signal.none)),
    ]
    for path, code, meaning in places:
        if (message := _misfit(signal, code, width)) is not None:
            yield path, message
        if code in meanings:
            yield path, f"code {code} means {meanings[code]} already; a code has one meaning"
        meanings.setdefault(code, meaning)


def _misfit(signal: Signal, code: int, width: int) -> str | None:
    width = 32 if signal.is_wide else width
    low, high = {"int16": (-0x8000, 0x7FFF), "int32": (-0x8000_0000, 0x7FFF_FFFF)}.get(
        signal.type, (0, (1 << width) - 1)
    )
    if signal.code == "bcd":
        high = highest_bcd(width)
    if low <= code <= high:
        return None
    if signal.code == "bcd":
        return f"code {code} does not fit: {_bits(width)} of BCD hold 0 to {high}"
    hint = f"; as int16 it is {code - 0x10000}" if signal.type == "int16" and high < code else ""
    hint = hint or ("; a negative code needs `type: int16`" if code < 0 and width == 16 else "")
    return f"code {code} does not fit: {_bits(width)} of {signal.type} hold {low} to {high}{hint}"


def _bits(width: int) -> str:
    return "1 bit" if width == 1 else f"{width} bits"
