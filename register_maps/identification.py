"""Builds and parses the frames by which a device says what it is: function 43, MEI type 14. Pure.

Layout and limits are those of the Modbus Application Protocol V1.1b3, section 6.21. Nothing here can write.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from register_maps.errors import ExceptionAnswer, Mismatch

FUNCTION = 0x2B
MEI_TYPE = 0x0E
BASIC, REGULAR = 1, 2
"""How much is asked for: the three objects that every such device has, or those of the specification that it has beside them."""
OBJECTS = ("vendor", "product_code", "revision", "vendor_url", "product", "model", "application")
"""Names of the objects 0 to 6."""

_HEAD = struct.Struct(">HHBBBBBBBB")
"""Protocol id, length, unit id, function, MEI type, category, conformity, more follows, next object, number of objects."""
_MORE = 0xFF
_LEVEL = 0x7F
"""The part of the conformity level that names a category; the highest bit says that single objects can be read too."""


@dataclass(frozen=True, slots=True)
class Page:
    """One answer: objects by their number, and whether there are more."""

    objects: Mapping[int, bytes]
    has_regular: bool
    """Whether the device has regular objects beside the basic ones."""
    next_object: int | None
    """Where the next answer begins; None if this was the last one."""


def request_body(unit: int, category: int, first: int) -> bytes:
    """Return a request without its transaction id; it asks for the objects of a category from `first` on."""
    return struct.pack(">HHBBBBB", 0, 5, unit, FUNCTION, MEI_TYPE, category, first)


def parse_answer(unit: int, category: int, frame: bytes) -> Page:
    """Read an answer. Raises ExceptionAnswer, which is the usual answer of a device without an identity, and Mismatch."""
    if len(frame) == 9 and frame[6:8] == bytes((unit, FUNCTION | 0x80)):
        raise ExceptionAnswer(FUNCTION, frame[8])
    asked = f"read device identification, unit {unit}"
    if len(frame) < 2 + _HEAD.size:
        raise Mismatch(asked, f"{2 + _HEAD.size} bytes or more", frame.hex(" "))
    _, _, *echo, conformity, more, following, count = _HEAD.unpack_from(frame, 2)
    if echo != [unit, FUNCTION, MEI_TYPE, category]:
        raise Mismatch(asked, f"unit {unit} and {FUNCTION:02x} {MEI_TYPE:02x} {category:02x}", frame[6:].hex(" "))
    objects: dict[int, bytes] = {}
    rest = frame[2 + _HEAD.size :]
    for _ in range(count):
        if len(rest) < 2 or len(rest) < 2 + rest[1]:
            raise Mismatch(asked, f"{count} objects", frame[6:].hex(" "))
        objects[rest[0]] = rest[2 : 2 + rest[1]]
        rest = rest[2 + rest[1] :]
    return Page(objects, conformity & _LEVEL >= REGULAR, following if more == _MORE else None)


def texts(objects: Mapping[int, bytes]) -> dict[str, str]:
    """Return objects by name, for people: what cannot be printed is a question mark, and empty ones are left out."""
    found = {OBJECTS[number]: _text(value) for number, value in sorted(objects.items()) if number < len(OBJECTS)}
    return {name: text for name, text in found.items() if text}


def _text(value: bytes) -> str:
    """The specification has ASCII; devices pad it with zeros and spaces."""
    text = value.strip(b"\0 \t\r\n").decode("ascii", "replace")
    return "".join(one if one.isprintable() and one.isascii() else "?" for one in text)
