"""The answer no of /api/v1: problem+json (RFC 9457)."""

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

    model_config = ConfigDict(frozen=True, extra="ignore")  # a newer manager may say more

    type: str
    """A name of the kind of problem, made of its code; nothing is to be found there."""
    title: str
    status: int
    detail: str
    """What was wrong this time, and what to do."""
    code: str
    """Stable, for programs."""
    field: str | None = None
    """The key of the body that is wrong."""
    holder: str | None = None
    """Who holds the lift."""
    mode: Annotated[Mode | None, WrapValidator(_known_mode)] = None
    """The mode in which the lift takes no robots."""
    since_s: float | None = None
    """For how long the holder has held it, or the mode has lasted."""
    age_s: float | None = None
    """How old the last whole reading of the lift is."""
    ahead: int | None = None
    """How many wait before."""

    @classmethod
    def of(
        cls, status: int, code: str, title: str, detail: str, field: str | None = None, blocking: Blocking | None = None
    ) -> Problem:
        """Make one; its type follows from its code."""
        kind = f"urn:lift-manager:problem:{code}"
        said = cls(type=kind, title=title, status=status, detail=detail, code=code, field=field)
        if blocking is None:
            return said
        told = {
            "holder": None if blocking.holder is None else str(blocking.holder),
            "mode": blocking.mode,
            "since_s": None if blocking.since_s is None else to_ms(blocking.since_s),
            "age_s": None if blocking.age_s is None else to_ms(blocking.age_s),
            "ahead": blocking.ahead,
        }
        return said.model_copy(update=told)
