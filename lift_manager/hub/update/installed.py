"""What of updates is installed at a site, as one value, and its transitions. Pure.

current ----apply----> on trial ----prove----> current
   ^                      |
   +------roll back-------+   its health fell, it did not come up, or a person decided
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from lift_manager.hub.update.messages import Failure

MOST_STARTS = 3
"""How often a version on trial may be started. Chosen: a power failure and a restart by a person are not its fault; a loop is."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Hold(_Part):
    """A lift that is only watched, because an update has changed it and nobody has tested it since."""

    why: str
    """What was changed, such as `its map`."""
    number: int
    """The update that changed it."""
    tested: str
    """The test that counted at that time; another one is needed. Empty for none."""


class Version(_Part):
    """A configuration in its folder."""

    number: int = Field(ge=0)
    """0 for the one with which a person began."""
    signed_by: str = ""
    made_by: str = ""
    held: Mapping[str, Hold] = {}
    """By lift."""


class Installed(_Part):
    """Everything that a site remembers about updates."""

    format: Literal["lift-manager updates"] = "lift-manager updates"
    version: Literal[1] = 1
    current: Version = Version(number=0)
    before: Version | None = None
    """What `roll_back` goes back to."""
    on_trial: bool = False
    starts: int = 0
    """Starts of the version on trial."""
    live: tuple[str, ...] = ()
    """The lifts that could be read when it was applied."""
    highest: int = 0
    """The highest number that was ever applied: that number and those below it are never applied again."""
    rollout: str = ""
    """In which roll-out of the hub the newest update came."""
    failed: Failure | None = None
    """The update that was rolled back last, if none was applied since."""
    notes: tuple[str, ...] = ()
    """What the next manager that starts writes into its journal."""


def apply(installed: Installed, staged: Version, live: tuple[str, ...], rollout: str) -> Installed:
    """Put a version on trial."""
    held = "; ".join(f"{lift} is only watched until it is tested: {hold.why}" for lift, hold in staged.held.items())
    note = (
        f"configuration update {staged.number}, made by {staged.made_by} and signed with {staged.signed_by}, is applied in place of"
        f" {_name(installed.current)}, on trial{f'; {held}' if held else ''}"
    )
    return Installed(
        current=staged,
        before=installed.current,
        on_trial=True,
        live=live,
        highest=max(staged.number, installed.highest),
        rollout=rollout,
        notes=(*installed.notes, note),
    )


def start(installed: Installed) -> Installed:
    """Count the start of a version on trial; one that was started too often is rolled back."""
    if not installed.on_trial:
        return installed
    if installed.starts >= MOST_STARTS:
        return roll_back(installed, f"it was started {MOST_STARTS} times within its trial, and did not stay up")
    return installed.model_copy(update={"starts": installed.starts + 1})


def prove(installed: Installed) -> Installed:
    """End a trial well. The version before stays, for a person who wants it back."""
    note = f"configuration update {installed.current.number} has passed its trial"
    return installed.model_copy(update={"on_trial": False, "starts": 0, "notes": (*installed.notes, note)})


def roll_back(installed: Installed, why: str) -> Installed:
    """Go back to the version before. There is one on trial, and until another one was applied after it."""
    if installed.before is None:
        raise ValueError("there is no version to go back to")
    number = installed.current.number
    note = f"configuration update {number} is rolled back, and {_name(installed.before)} is in its place: {why}"
    return Installed(
        current=installed.before,
        highest=installed.highest,
        rollout=installed.rollout,
        failed=Failure(number=number, rollout=installed.rollout, what="rolled back", why=why[:1000]),
        notes=(*installed.notes, note),
    )


def without_notes(installed: Installed) -> Installed:
    """Forget the notes: they are in the journal."""
    return installed.model_copy(update={"notes": ()})


def _name(version: Version) -> str:
    return f"update {version.number}" if version.number else "the configuration before all updates"
