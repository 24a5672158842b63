"""What a site and the hub send each other about configuration updates, as JSON."""

from __future__ import annotations

from enum import StrEnum, unique
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

REQUEST_EVERY_S = 60.0
"""How often a site reports, and asks for an update. Chosen: 17 requests a second of a thousand sites."""
PART_BYTES = 256 * 1024
"""How much of a package one reply holds. Chosen: a quarter of what a message may have."""

RolloutId = Annotated[str, StringConstraints(max_length=32)]


class _Message(BaseModel):
    """Comes from another computer, of any version: strict in what it reads, and blind to what it does not know."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Failure(_Message):
    """An update that a site has refused, or has gone back from."""

    number: int = Field(ge=0, lt=2**31)
    rollout: RolloutId
    """The roll-out of the hub in which that was: the same update in another one is tried again."""
    what: Literal["refused", "rolled back"]
    why: str = Field(max_length=1000)


@unique
class Phase(StrEnum):
    """Where a site is with updates."""

    IDLE = "idle"
    """The newest update that it has taken has passed its trial, or it has taken none."""
    WAITING = "waiting"
    """It has checked an update, and waits for a moment in which nothing is under way."""
    TRIAL = "trial"


class Report(_Message):
    """What a site reports about its updates, with its request for another one."""

    installed: int = Field(ge=0, lt=2**31)
    """The number of the update by which it runs; 0 for none."""
    phase: Phase
    text: str = Field(max_length=1000)
    """What it waits for, or what it lacks."""
    healthy: bool
    """Every lift that could be read before the newest update can be read now."""
    failed: Failure | None = None
    """The newest update that came to nothing."""


class Offer(_Message):
    """The reply of the hub. Without a number there is none for this site now."""

    number: int | None = None
    rollout: RolloutId = ""
    size: int = 0
    sha256: str = ""


class PartRequest(_Message):
    """A request for a part of the package that is offered."""

    number: int = Field(ge=1, lt=2**31)
    at: int = Field(ge=0, lt=2**31)
    """Of its first byte."""
