"""Maps the point names of PLCs, a letter and a number, to table and address; one YAML file per family.

A preset maps names to addresses and knows nothing about lifts.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from register_maps.words import BIT_TABLES, Table

FOLDER = Path(__file__).parent
PRESETS: tuple[str, ...] = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
"""Names of the presets that come with the program."""

_NAME = re.compile(
    r"(?P<letter>%?[A-Za-z_]+(?:\.[A-Za-z_]+)*)\[?(?P<number>[0-9]+[A-F]?|[A-F])\]?(?:\.(?P<suffix>[0-9]+))?"
)


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Area(_Part):
    """Names with one letter that lie side by side."""

    letter: str = Field(min_length=1)
    """What stands before the number, such as `X` or `%QX`."""
    table: Table
    start: int = Field(ge=0, le=0xFFFF)
    """Address on the wire of the first one."""
    first: int = Field(default=0, ge=0)
    """Number of the first one, counted in its own way and taken as decimal."""
    count: int = Field(ge=1, le=0x10000)
    numbers: Literal["decimal", "octal", "octal_last_digit", "hex_last_digit", "byte_and_bit", "even"] = "decimal"
    """How they are counted: octal as a whole; tens and an octal or hexadecimal last digit; byte.bit; or in bytes, two to a
    register."""
    trust: Literal["vendor-manual", "web-page"] = "vendor-manual"
    """`web-page`: read at somebody other than the vendor."""
    note: str = ""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.start + self.count > 0x10000:
            raise ValueError(f"{self.letter}: {self.count} from {self.start} go beyond address 65535")
        if self.numbers == "byte_and_bit" and self.table not in BIT_TABLES:
            raise ValueError(f"{self.letter}: byte.bit counts bits, and a {self.table} is a register")
        return self

    def place(self, number: str, suffix: str | None) -> tuple[int, int | None]:
        """Give the position in this area and the bit. Raises ValueError for a number that this area cannot count."""
        bit = None if suffix is None else int(suffix)
        match self.numbers:
            case "decimal":
                return _decimal(number) - self.first, bit
            case "octal":
                return _octal(number) - self.first, bit
            case "octal_last_digit":
                return int(number[:-1] or "0") * 8 + _octal(number[-1]) - self.first, bit
            case "hex_last_digit":
                return int(number[:-1] or "0") * 16 + int(number[-1], 16) - self.first, bit
            case "byte_and_bit":
                if bit is None or bit > 7:
                    raise ValueError("write the byte and its bit 0 to 7, such as 0.3")
                return _decimal(number) * 8 + bit - self.first, None
            case "even":
                if _decimal(number) % 2:
                    raise ValueError("bytes are counted here, two to a register; the number must be even")
                return _decimal(number) // 2 - self.first, bit


class Source(_Part):
    """Where the facts were read."""

    trust: Literal["vendor-manual", "integration-code", "template"]
    sources: tuple[str, ...] = Field(min_length=1)
    notes: str = ""


class Preset(_Part):
    """The names of one family of PLCs."""

    preset: Literal[1]
    name: str
    title: str
    provenance: Source
    areas: tuple[Area, ...] = Field(min_length=1)
    limits: dict[str, str] = Field(default_factory=dict)
    """What its Modbus server allows, as text: connections, unit ids, registers per request."""

    def find(self, text: str) -> tuple[Table, int, int | None]:
        """Table, address on the wire and bit of a name such as `X17`, `%QX0.3` or `D10.4`. Raises ValueError."""
        match = _NAME.fullmatch(text)
        letters = list(dict.fromkeys(area.letter for area in self.areas))
        if match is None or match["letter"] not in letters:
            raise ValueError(f"{text!r} is no name that {self.title} knows; names begin with {', '.join(letters)}")
        areas = [area for area in self.areas if area.letter == match["letter"]]
        for area in areas:
            try:
                position, bit = area.place(match["number"], match["suffix"])
            except ValueError as error:
                raise ValueError(f"{text!r}: {error}") from error
            if 0 <= position < area.count:
                return area.table, area.start + position, bit
        spans = ", ".join(f"{area.count} from {area.first}" for area in areas)
        raise ValueError(f"{text!r} is outside what {self.title} has of {match['letter']} ({spans})")


@cache
def load_preset(name: str) -> Preset:
    """Read a shipped preset by its name. Raises ValueError for another name."""
    if name not in PRESETS:
        raise ValueError(f"there is no preset {name!r}; there are {', '.join(PRESETS)}")
    return Preset.model_validate(yaml.safe_load((FOLDER / f"{name}.yaml").read_text("utf-8")))


def _decimal(number: str) -> int:
    if not number.isdecimal():
        raise ValueError("this is counted in tens, with the digits 0 to 9")
    return int(number)


def _octal(number: str) -> int:
    if set(number) - set("01234567"):
        raise ValueError("this is counted in octal, with the digits 0 to 7")
    return int(number, 8)
