"""One item while it is done: its questions, what was seen, and how it ends."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field

from lift_manager.commissioning.checkout.lift import Sample
from lift_manager.commissioning.checkout.person import NO, YES, YES_NO, Person, Prompt, Question
from lift_manager.commissioning.checkout.record import Item, Outcome, Trip
from register_maps.codec import Codec
from register_maps.schema import Command, Signal


class Settled(Exception):
    """A person ended the item: it failed, does not apply, is proved by document, or is skipped."""

    def __init__(self, outcome: Outcome, note: str) -> None:
        super().__init__(f"{outcome}: {note}")
        self.outcome = outcome
        self.note = note


@dataclass
class Step:
    """One item under test."""

    item: Item
    person: Person
    codec: Codec
    codes: Mapping[str, int]
    """The code of each floor, lowest first."""
    by: str
    """Who runs the test."""
    problems: list[str] = field(default_factory=list)
    """What was wrong, a sentence each; without any the item has passed."""
    notes: list[str] = field(default_factory=list)
    photos: list[str] = field(default_factory=list)
    evidence: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)
    trips: list[Trip] = field(default_factory=list)
    confirmed_by: str = ""

    @property
    def floors(self) -> tuple[str, ...]:
        """The floors, lowest first."""
        return tuple(self.codes)

    def problem(self, text: str) -> None:
        """Note what is wrong, for the record and for the person."""
        self.problems.append(text)
        self.person.show(text)

    def saw(self, text: str) -> None:
        """Note evidence."""
        self.evidence.append(text)

    async def wait(self, seconds: float, text: str) -> None:
        """Wait, and let the person know for what and how long."""
        self.person.show(f"{text}: {seconds:g} s")
        await asyncio.sleep(seconds)

    async def choose(
        self, text: str, topic: Prompt, *choices: str, subject: str = "", value: str = "", rule: str = ""
    ) -> str:
        """Return one of the choices; `rule` is a sentence for the person that is no evidence. Raises Settled."""
        reply = await self.person.answer(Question(f"{text} {rule}".strip(), topic, subject, value, choices))
        self.photos += reply.photos
        self.confirmed_by = reply.confirmed_by or self.confirmed_by
        if reply.outcome is not None:
            raise Settled(reply.outcome, reply.note)
        if reply.note:
            self.notes.append(reply.note)
        self.saw(f"{text} - {reply.word or 'done'}")
        return reply.word

    async def done(self, text: str, topic: Prompt, *, subject: str = "", value: str = "", rule: str = "") -> None:
        """Wait until something is done. Raises Settled."""
        await self.choose(text, topic, subject=subject, value=value, rule=rule)

    async def yes(self, text: str, topic: Prompt, *, subject: str = "", value: str = "") -> bool:
        """Return whether it is so. Raises Settled."""
        return await self.choose(text, topic, *YES_NO, subject=subject, value=value) == YES

    async def may_move(self, text: str) -> None:
        """Wait for a yes before something moves. Raises Settled if it may not."""
        if await self.choose(text, Prompt.MAY_MOVE, *YES_NO, subject=self.item.subject) == NO:
            raise Settled(Outcome.SKIPPED, "the person did not agree to the move")

    async def where(self) -> str:
        """Return the floor at which the car really is."""
        return await self.choose("At which floor is the car now? Look at the car itself.", Prompt.WHERE, *self.floors)


def at(step: Step, name: str, floor: str = "") -> str:
    """Return a signal or command with its addresses as printed in the vendor's table, for a message; of one floor where there is one for each."""
    spec: Signal | Command | None = step.codec.map.signals.get(name) or step.codec.map.commands.get(name)
    printed = () if spec is None else spec.addresses
    if floor and spec is not None and len(spec.floor_codes) == len(printed):
        printed = tuple(
            text for text, code in zip(printed, spec.floor_codes, strict=True) if code == step.codes.get(floor)
        )
    shown = ", ".join(printed[:4]) + (" ..." if len(printed) > 4 else "")
    return f"{name} ({shown})" if shown else name


def shown(value: object) -> str:
    """Return a value as people read it."""
    if isinstance(value, bool):
        return YES if value else NO
    if isinstance(value, float):
        return f"{value:.10g}"
    return "nothing" if value is None else str(value)


def raw_text(sample: Sample, name: str) -> str:
    """Return what a signal shows, with its raw value: `yes (raw 0)`."""
    signal = sample.signals.get(name)
    return "nothing" if signal is None else f"{shown(signal.value)} (raw {signal.raw})"
