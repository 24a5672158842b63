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
)
from pydantic_core import CoreSchema, PydanticCustomError

from lift_manager.lift.session import Holder
from lift_manager.plain.text import is_printable
from register_maps.words import Side


def printable(text: str) -> str:
    """Return text as it may be shown and written down; raises PydanticCustomError for what is not one line of it."""
    if not is_printable(text):
        raise PydanticCustomError("printable", "must be text on one line, without control characters")
    return text.replace("\u00a0", " ")  # what a word processor puts between the parts of a name


@dataclass(frozen=True, slots=True)
class SchemaPattern:
    """A pattern for the schema of a text alone, where a validator looks closer than a pattern can."""

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
"""An idempotency key: printable ASCII without blanks."""


def to_ms(seconds: float) -> float:
    """Return seconds without what a clock of floats adds to them."""
    return round(seconds, 3)


Seconds = Annotated[float, AfterValidator(to_ms)]
"""A time that passes, to the millisecond."""
Door = Annotated[Side, Field(strict=False)]
"""A door by its name: a body that was decoded from JSON holds text, which strict would not take."""

Recorded = Annotated[
    bool,
    Field(
        description="Only in the answer to a request that changed something, and only as `false`: the change is in force, but was not on the"
        " disk within 0.5 s, so a crash of the manager could still lose it.",
        exclude_if=bool,
    ),
]


def _name_of(value: object) -> object:
    return str(value) if isinstance(value, Holder) else value


HolderName = Annotated[str, BeforeValidator(_name_of)]
"""A holder as `face:name`."""


class RequestModel(BaseModel):
    """An object that a caller sends: immutable, nothing unknown in it, nothing coerced."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Answer(BaseModel):
    """An object that the manager sends, made of a value of its own by `model_validate`.

    A client takes one with more in it: a newer manager may say more.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", from_attributes=True)
