"""Base classes and types of fields that the models of /api/v1 share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    StringConstraints,
    ValidationError,
)
from pydantic_core import CoreSchema, PydanticCustomError

from lift_manager.lift.session import Holder
from lift_manager.plain.text import is_printable
from register_maps.words import Side


def printable(text: str) -> str:
    """Return text that is safe to show and record. Raises PydanticCustomError unless it is one line of printable characters."""
    if not is_printable(text):
        raise PydanticCustomError("printable", "must be text on one line, without control characters")
    return text.replace("\u00a0", " ")  # what a word processor puts between the parts of a name


def first_mistake(error: ValidationError) -> str:
    """Return where the first mistake is and what it is, without what was read there, which may be a secret."""
    found = error.errors(include_url=False, include_input=False)[0]
    return f"{'.'.join(str(part) for part in found['loc'])}: {found['msg']}"


@dataclass(frozen=True, slots=True)
class SchemaPattern:
    """A pattern for the schema only, for a text whose validator checks more than a pattern can."""

    pattern: str

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the schema with the pattern."""
        return handler(core_schema) | {"pattern": self.pattern}


_UNSEEN = r"\u0000-\u001f\u007f-\u009f\u2028\u2029"
ON_ONE_LINE = SchemaPattern(rf"^[^{_UNSEEN}]*$")
"""Text without line breaks and control characters."""
_SOMETHING_ON_ONE_LINE = SchemaPattern(rf"^[^{_UNSEEN}]*[^\s{_UNSEEN}][^{_UNSEEN}]*$")

Words = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=200),
    AfterValidator(printable),
    _SOMETHING_ON_ONE_LINE,
]
"""A line of text from a caller."""
ShortName = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=64),
    AfterValidator(printable),
    _SOMETHING_ON_ONE_LINE,
]
"""A name from a caller."""
Token = Annotated[str, StringConstraints(min_length=1, max_length=128, pattern=r"^[\x21-\x7e]+$")]
"""An idempotency key: printable ASCII without spaces."""


def to_ms(seconds: float) -> float:
    """Return seconds rounded to milliseconds, without floating-point noise."""
    return round(seconds, 3)


Seconds = Annotated[float, AfterValidator(to_ms)]
"""A duration, to the millisecond."""
Door = Annotated[Side, Field(strict=False)]
"""A door by its name. Not strict, because a body decoded from JSON has text here."""

Recorded = Annotated[
    bool,
    Field(
        description="Present only as `false`, in the answer to a request that changed something: the change is in force, but was not on the"
        " disk within 0.5 s, so a crash of the manager could still lose it.",
        exclude_if=bool,
    ),
]


def _name_of(value: object) -> object:
    return str(value) if isinstance(value, Holder) else value


HolderName = Annotated[str, BeforeValidator(_name_of)]
"""A holder as `face:name`."""


class RequestModel(BaseModel):
    """An object that a caller sends: immutable, without unknown fields, without coercion."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Answer(BaseModel):
    """An object that the manager sends, made from one of its own values by `model_validate`.

    Clients ignore unknown fields: a newer manager may send more.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", from_attributes=True)
