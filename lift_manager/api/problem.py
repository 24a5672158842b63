"""Refusals of /api/v1 as problem+json (RFC 9457)."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, ValidatorFunctionWrapHandler, WrapValidator

from lift_manager.api.fields import to_ms
from lift_manager.lift.refusals import Blocking
from register_maps.words import Mode

MEDIA_TYPE = "application/problem+json"


def _known_mode(value: object, validate: ValidatorFunctionWrapHandler) -> object:
    try:
        return validate(value)
    except ValueError:  # a mode that only a newer manager knows
        return None


class Problem(BaseModel):
    """Why a request was not carried out."""

    model_config = ConfigDict(frozen=True, extra="ignore")  # a newer manager may send more fields

    type: str
    """A URN for the kind of problem, made of its code; it cannot be looked up."""
    title: str
    status: int
    detail: str
    """What is wrong with this request, and what to do."""
    code: str
    """Stable, for programs."""
    field: str | None = None
    """The invalid field of the body."""
    holder: str | None = None
    """The holder of the lift."""
    mode: Annotated[Mode | None, WrapValidator(_known_mode)] = None
    """The mode of the lift that keeps robots off."""
    since_s: float | None = None
    """For how long the holder has held the lift, or the mode has lasted."""
    age_s: float | None = None
    """The age of the last complete reading of the lift."""
    ahead: int | None = None
    """How many callers are ahead in the queue."""

    @classmethod
    def of(
        cls, status: int, code: str, title: str, detail: str, field: str | None = None, blocking: Blocking | None = None
    ) -> Problem:
        """Return a problem; its type follows from its code."""
        kind = f"urn:lift-manager:problem:{code}"
        problem = cls(type=kind, title=title, status=status, detail=detail, code=code, field=field)
        if blocking is None:
            return problem
        details = {
            "holder": None if blocking.holder is None else str(blocking.holder),
            "mode": blocking.mode,
            "since_s": None if blocking.since_s is None else to_ms(blocking.since_s),
            "age_s": None if blocking.age_s is None else to_ms(blocking.age_s),
            "ahead": blocking.ahead,
        }
        return problem.model_copy(update=details)
