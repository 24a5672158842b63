"""The person who carries out the test: what is asked, and what may be answered."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Protocol

from lift_manager.commissioning.checkout.record import Outcome


@unique
class Prompt(StrEnum):
    """What a question is about, for a program that answers it."""

    MAY_MOVE = "may the car or a door move now?"
    MAKE = "make a signal show a value"
    DISCONNECT = "disconnect the wire of a signal"
    RECONNECT = "connect it again"
    SEND = "send the car to a floor with its own buttons"
    WHERE = "at which floor is the car?"
    DOOR = "is a door open?"
    HOLDS = "did a door open, and stay open?"
    CLOSED = "did a door close?"
    SHOWN = "does the lift do what a command is for?"
    CABLE = "pull or plug the network cable"
    POWER = "switch the controller off or on"
    FIRE = "give or take back the fire signal"
    LANDING = "press a landing button"
    STAYED = "did the car stay?"
    WITHDRAW = "take robot mode away, or give it back"
    SERVES = "does the lift serve its passengers?"
    RIDER = "does a robot ride, or nobody?"
    DRIVE = "let the robot drive in or out"
    ROBOT = "a question about the real robot"
    ACKNOWLEDGE = "is the lift checked after a test?"
    AGAIN = "do it once more?"
    PRECONDITION = "is a condition met?"
    CLOSING = "what is settled at the end"


@dataclass(frozen=True, slots=True)
class Question:
    """One question, or one thing to do."""

    text: str
    topic: Prompt
    subject: str = ""
    """The signal, command, floor, door or precondition."""
    value: str = ""
    """The value to make, or `on` and `off`."""
    choices: tuple[str, ...] = ()
    """What may be answered; empty: only that it is done."""
    is_text: bool = False
    """A line of text is the answer; it may be empty."""


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer: one of the choices, a text, or what settles the whole item."""

    word: str = ""
    outcome: Outcome | None = None
    """Fail, not applicable, proved by document or skipped: the item ends with it."""
    note: str = ""
    photos: tuple[str, ...] = ()
    confirmed_by: str = ""
    """A second person who saw it."""


YES, NO = "yes", "no"
YES_NO = (YES, NO)


class Person(Protocol):
    """Answers questions and reads messages."""

    async def answer(self, question: Question) -> Reply:
        """Return the answer, as soon as there is one."""
        ...

    def show(self, text: str) -> None:
        """Show a line."""
        ...
