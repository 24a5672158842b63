"""Why commands ended as they did, in closed words: for metrics. Pure."""

from __future__ import annotations

from enum import StrEnum, unique

from drivers.model import Outcome, Proof, Result


@unique
class Reason(StrEnum):
    """Why a command ended as it did; the text of its outcome is for people."""

    NONE = "none"
    READBACK = "readback"
    LAMP = "lamp"
    EFFECT = "effect"
    """These three confirmed it."""
    NOT_GRANTED = "not_granted"
    """The lift did not grant what it needs, such as robot mode."""
    NOT_SENT = "not_sent"
    """Nothing of it left: refused at the last moment, replaced or released before its turn."""
    LIFT_REFUSED = "lift_refused"
    """It was sent, and the controller refused it."""
    NO_EVIDENCE = "no_evidence"
    """It was sent, or may have been, and nothing shows that it took effect."""


_CONFIRMED_BY = {
    Proof.NONE: Reason.NONE,
    Proof.READBACK: Reason.READBACK,
    Proof.LAMP: Reason.LAMP,
    Proof.EFFECT: Reason.EFFECT,
}
UNCONFIRMED = Result.UNCONFIRMED.value
"""The result that people have to look into."""


def reason_of(outcome: Outcome) -> Reason:
    """Return the class of an outcome's reason, whatever its text says."""
    if outcome.result is Result.CONFIRMED:
        return _CONFIRMED_BY[outcome.proof]
    if outcome.grant_missing:
        return Reason.NOT_GRANTED
    if not outcome.frames:
        return Reason.NOT_SENT
    return Reason.LIFT_REFUSED if outcome.result is Result.REJECTED else Reason.NO_EVIDENCE
