"""What every part of the file that keeps what outlives the manager is made of."""

from __future__ import annotations

from datetime import MAXYEAR, MINYEAR, datetime
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict


def _in_any_zone(at: datetime) -> datetime:
    if not MINYEAR < at.year < MAXYEAR:
        raise ValueError(f"the year {at.year} cannot be")
    return at


Moment = Annotated[AwareDatetime, AfterValidator(_in_any_zone)]
"""A time that can be shown in every zone."""


class Part(BaseModel):
    """A part of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
