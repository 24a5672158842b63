"""Field types shared by the parts of a map."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

Address = Annotated[
    str,
    StringConstraints(min_length=1, max_length=80),
    Field(description="an address such as holding:12, holding:12.4 or, with a notation, 40013 or X17"),
]
Name = Annotated[
    str,
    StringConstraints(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$"),
    Field(description="lower-case letters and digits in words joined by hyphens, such as acme-lc3"),
]
ParameterName = Annotated[
    str,
    StringConstraints(pattern=r"^[a-z][a-z0-9_]*$"),
    Field(description="lower-case letters, digits and underscores, such as first_input"),
]
Seconds = Annotated[float, Field(gt=0, le=3600)]
Pause = Annotated[float, Field(ge=0, le=60)]
Word = Annotated[int, Field(strict=True, ge=-32768, le=65535)]
Codes = Annotated[tuple[Word, ...], Field(min_length=2)]
Position = Annotated[int, Field(strict=True, ge=-0x8000_0000, le=0xFFFF_FFFF)]


class Part(BaseModel):
    """One part of a map: immutable, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
