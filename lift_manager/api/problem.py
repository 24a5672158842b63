"""The answer no of /api/v1: problem+json (RFC 9457)."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

MEDIA_TYPE = "application/problem+json"


class Problem(BaseModel):
    """Why a request was not carried out."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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

    @classmethod
    def of(cls, status: int, code: str, title: str, detail: str, field: str | None = None) -> Problem:
        """Make one; its type follows from its code."""
        kind = f"urn:lift-manager:problem:{code}"
        return cls(type=kind, title=title, status=status, detail=detail, code=code, field=field)
