"""Maps made up at random, of every form the language has; a place is given out once."""

from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

from register_maps.check import check
from register_maps.check_places import find_unreadable
from register_maps.schema import RegisterMap

Data = dict[str, Any]
SERVED = {
    "coil": [[0, 39], [60, 99]],
    "discrete": [[0, 19], [30, 49]],
    "holding": [[0, 9], [10, 29], [100, 119]],
    "input": [[5, 24], [40, 44]],
}
LIMITS = st.fixed_dictionaries(
    {
        "max_registers_per_read": st.integers(1, 16),
        "max_bits_per_read": st.integers(1, 40),
        "unit_id": st.integers(0, 255),
    }
)
WORDS = {
    "motion": ("stopped", "up", "down", "moving"),
    "door": ("closed", "opening", "open", "closing", "moving", "fault"),
    "mode": ("normal", "robot", "independent", "fire", "emergency", "out_of_service"),
}
FLAGS = ("level", "door_zone", "ready", "fireman", "overload", "nudging", "may_enter", "robots_allowed", "attendant")


@dataclass
class Places:
    """Hands out addresses that no other signal or command has."""

    base: int
    free: dict[str, list[int]] = field(
        default_factory=lambda: {
            table: [number for first, last in spans for number in range(first, last + 1)]
            for table, spans in SERVED.items()
        }
    )

    def take(self, draw: st.DrawFn, *tables: str) -> str:
        table = draw(st.sampled_from(tables))
        number = draw(st.sampled_from(self.free[table]))
        self.free[table].remove(number)
        return f"{table}:{number + self.base}"

    def pair(self, draw: st.DrawFn, table: str) -> str:
        """A register whose neighbour is free and served in the same range as well."""
        free = self.free[table]
        ends = [last for _, last in SERVED[table]]
        number = draw(st.sampled_from([n for n in free if n + 1 in free and n not in ends]))
        self.free[table] = [n for n in free if n not in (number, number + 1)]
        return f"{table}:{number + self.base}"


FLOORS = 3
BITS = ("coil", "discrete")
REGISTERS = ("holding", "input")


BYTE_ORDER = st.sampled_from([{}, {"byte_order": "high_first"}, {"byte_order": "low_first"}])
BCD = st.sampled_from([{}, {"code": "bcd"}])


def given(codes: list[int] | None) -> Data:
    """The floor codes of one bit per floor, where the map gives them."""
    return {} if codes is None else {"codes": codes}


@st.composite
def bit(draw: st.DrawFn, places: Places) -> Data:
    """A flag: a bit, a bit of a register, or a whole register."""
    if draw(st.booleans()):
        return {"at": places.take(draw, *BITS), "active": draw(st.sampled_from(["high", "low"]))}
    at = places.take(draw, *REGISTERS)
    if draw(st.booleans()):
        return {"at": f"{at}.{draw(st.integers(0, 15))}"}
    if draw(st.booleans()):
        return {"at": at, draw(st.sampled_from(["yes_from", "yes_to"])): draw(st.integers(1, 65534))}
    return {"at": at, "means_yes": draw(st.sampled_from([1, 255, 65535]))}


@st.composite
def words(draw: st.DrawFn, places: Places, kind: str) -> Data:
    """A table of codes and words, in a field or a whole register."""
    low = draw(st.integers(0, 12))
    bits = [low, min(15, low + 3)] if draw(st.booleans()) else None
    most = 1000 if bits is None else (1 << bits[1] - bits[0] + 1) - 1
    codes = draw(st.lists(st.integers(0, most), min_size=2, max_size=4, unique=True))
    table = dict(zip(codes, draw(st.permutations(WORDS[kind])), strict=False))
    rest = [code for code in range(8) if code not in table and code <= most]
    entry: Data = {"at": places.take(draw, *REGISTERS), "values": table}
    if bits is not None:
        entry["bits"] = bits
    if rest and bool(draw(st.booleans())):
        entry["unknown"] = [rest[0]]
    return entry


@st.composite
def floor(draw: st.DrawFn, places: Places, codes: list[int] | None) -> Data:
    """A floor: a number of any sort, one bit per floor, or a position code; `codes` are those of the floors, where given."""
    low_codes = codes is None
    form = draw(st.sampled_from(["number", "signed", "one_of", *(["wide", "field", "code_of"] if low_codes else [])]))
    if form in ("one_of", "code_of"):
        many = [places.take(draw, *BITS) for _ in range(FLOORS if form == "one_of" else draw(st.integers(2, 5)))]
        entry: Data = {form: many, "active": draw(st.sampled_from(["high", "low"]))}
        if form == "code_of":
            entry |= {"code": draw(st.sampled_from(["binary", "gray", "bcd"])), "as": "floor"}
        elif codes is not None:
            entry["codes"] = codes
        return entry
    if form == "wide":
        order = draw(st.sampled_from(["high_first", "low_first"]))
        kind = draw(st.sampled_from(["uint32", "int32"]))
        entry = {"at": places.pair(draw, "input"), "type": kind, "word_order": order, "as": "floor", "unknown": [0]}
        return entry | draw(BYTE_ORDER) | (draw(BCD) if kind == "uint32" else {})
    at = places.take(draw, *REGISTERS)
    if form == "field":
        return {
            "at": at,
            "bits": [3, 7],
            "code": draw(st.sampled_from(["binary", "gray"])),
            "as": "floor",
            "unknown": [31],
        }
    entry = {"at": at, "type": "int16" if form == "signed" else "uint16", "as": "floor"}
    unknown = next(code for code in range(FLOORS + 1) if code not in (codes or ()))
    return entry | {"unknown": [unknown]} | draw(BYTE_ORDER) | (draw(BCD) if form == "number" else {})


@st.composite
def position(draw: st.DrawFn, places: Places, codes: list[int]) -> Data:
    """A car position with the place of each floor, in two registers."""
    kind = draw(st.sampled_from(["uint32", "int32"]))
    gaps = draw(st.lists(st.integers(50, 5000), min_size=len(codes), max_size=len(codes)))
    table = {code: sum(gaps[: index + 1]) for index, code in enumerate(codes)}
    at = {
        "at": places.pair(draw, "holding"),
        "type": kind,
        "word_order": draw(st.sampled_from(["high_first", "low_first"])),
    }
    return at | draw(BYTE_ORDER) | {"positions": table, "tolerance": draw(st.integers(0, 20)), "unit": "mm"}


@st.composite
def door(draw: st.DrawFn, places: Places) -> Data:
    """A door: limits, one bit, or words."""
    form = draw(st.sampled_from(["limits", "bit", "words"]))
    if form == "words":
        return draw(words(places, "door"))
    active = draw(st.sampled_from(["high", "low"]))
    if form == "bit":
        return {"at": places.take(draw, *BITS), "active": active}
    return {"open_limit": places.take(draw, *BITS), "closed_limit": places.take(draw, *BITS), "active": active}


@st.composite
def signals(draw: st.DrawFn, places: Places, codes: list[int] | None) -> Data:
    """Some signals, a floor and a door among them."""
    made: Data = {"door.front": draw(door(places))}
    if draw(st.booleans()):
        made["car_position"] = draw(position(places, codes or list(range(FLOORS))))
    else:
        made["car_floor"] = draw(floor(places, codes))
    if draw(st.booleans()):
        made["motion"] = (
            {"up": places.take(draw, *BITS), "down": places.take(draw, *BITS)}
            if draw(st.booleans())
            else draw(words(places, "motion"))
        )
    if draw(st.booleans()):
        made["mode"] = draw(words(places, "mode"))
    if draw(st.booleans()):
        made["calls_registered"] = {"each_of": [places.take(draw, *BITS) for _ in range(FLOORS)]} | given(codes)
    if draw(st.booleans()):
        made["load"] = {"at": places.pair(draw, "holding"), "type": "int32", "word_order": "low_first", "unit": "kg"}
    for flag in draw(st.sets(st.sampled_from(FLAGS), max_size=4)):
        made[flag] = draw(bit(places))
    made["fire"] = draw(bit(places))
    return made


@st.composite
def output(draw: st.DrawFn, places: Places) -> Data:
    """Where a command that is on or off is written."""
    form = draw(st.sampled_from(["coil", "register", "bit"]))
    if form == "coil":
        entry: Data = {"at": places.take(draw, "coil")}
        if draw(st.booleans()):
            entry["read_at"] = places.take(draw, "coil")
        return entry
    at = places.take(draw, "holding")
    if form == "bit":
        shared = draw(st.sampled_from(["owned", "accepted", "mask_write"]))
        return {"at": f"{at}.{draw(st.integers(0, 15))}", "shared_word": shared}
    return {"at": at, "press": draw(st.sampled_from([1, 5, 65535]))}


@st.composite
def commands(draw: st.DrawFn, places: Places, codes: list[int] | None) -> Data:
    """A call, a hold, and sometimes more."""
    confirm = {"any_of": ["effect"], "within_s": 1}
    hold = {
        "action": "hold",
        "max_hold_s": 5,
        "on_link_loss": "latches",
        "confirm": {"any_of": ["readback"], "within_s": 1},
    }
    pulse = {"action": "pulse", "width_s": 0.3, "confirm": confirm}
    where: Data = {"at": places.take(draw, "holding"), "as": "floor"} | draw(BYTE_ORDER) | draw(BCD)
    if draw(st.booleans()):
        where = {"one_of": [places.take(draw, "coil") for _ in range(FLOORS)]} | given(codes)
    made: Data = {"go_to": where | pulse}
    made["hold_door.front"] = draw(output(places)) | hold
    if draw(st.booleans()):
        made["hold_door.front"]["refresh_s"] = 1
    if draw(st.booleans()):
        made["close_door.front"] = draw(output(places)) | pulse | {"excludes": ["hold_door.front"], "gap_s": 0.2}
    if draw(st.booleans()):
        made["close_door.front"] = {
            "at": places.take(draw, "coil"),
            "action": "pulse",
            "width_s": 0.5,
            "timed_by": "device",
            "payload": {"time": "width_s", "unit_s": 0.1},
            "confirm": confirm,
        }
    if draw(st.booleans()):
        made["heartbeat"] = {"at": places.take(draw, "holding"), "action": "count", "every_s": 0.5}
    return made


@st.composite
def any_map(draw: st.DrawFn) -> RegisterMap:
    """A map that every check accepts."""
    base = draw(st.sampled_from([0, 1]))
    places = Places(base)
    codes = draw(st.none() | st.lists(st.integers(-5, 20), min_size=FLOORS, max_size=FLOORS, unique=True))
    data = {
        "schema": 1,
        "name": "any",
        "title": "Any map",
        "provenance": {"trust": "template", "sources": ["chance"]},
        "addressing": {"base": base},
        "link": draw(LIMITS),
        "served": {table: [[n + base for n in span] for span in spans] for table, spans in SERVED.items()},
        "signals": draw(signals(places, codes)),
        "commands": draw(commands(places, codes)),
        "at_floor_evidence": {"kind": "position_stable", "for_s": 1.0},
    }
    made = RegisterMap.model_validate(data)
    problems = [problem for problem in (*find_unreadable(made), *check(made)) if not problem.warning]
    assert not problems, problems
    return made
