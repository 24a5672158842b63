"""The end of an acceptance test: open points, as-built changes, backup, hand-back and signatures."""

from __future__ import annotations

from collections.abc import AsyncIterator

from lift_manager.commissioning.checkout.person import YES, YES_NO, Person, Prompt, Question, Reply
from lift_manager.commissioning.checkout.record import (
    AsBuiltChange,
    HandBack,
    Precondition,
    Record,
    Role,
    Severity,
    Signature,
    Stage,
    Topic,
    now,
    verdict,
)


class Closing:
    """Asks what is left to settle; every answer is a new state of the record."""

    def __init__(self, person: Person, by: str) -> None:
        self._person = person
        self._by = by

    async def settle(self, record: Record) -> AsyncIterator[Record]:
        """Yield the record after every answer; what was answered before is not asked again."""
        for entry in record.punch:
            if entry.is_open and not entry.is_accepted:
                reply = await self._answer(
                    f"Open point {entry.number}, {entry.item}: {entry.text.rstrip('.')}. How bad is it: A no robots before it is mended, B may be used"
                    " under a condition, C a remark?",
                    str(entry.number),
                    choices=tuple(severity.value for severity in Severity),
                )
                severity = Severity(reply.word) if reply.word else Severity.A
                accepted: dict[str, object] = {"severity": severity}
                if severity is Severity.B:
                    accepted["condition"] = await self._text(
                        "Under which condition may robots use the lift?", "condition"
                    )
                    accepted["accepted_by"] = await self._text("Who accepts that?", "accepted_by")
                    accepted["due"] = await self._text("By when is it mended?", "due")
                record = record.model_copy(
                    update={"punch_list": (*record.punch_list, entry.model_copy(update=accepted))}
                )
                yield record
        while record.ended_at is None and (change := await self._as_built()):
            record = record.model_copy(update={"as_built": (*record.as_built, change)})
            yield record
        if record.stage is not Stage.FAT and record.hand_back is None:
            record = await self._backup(record)
            yield record
            record = await self._hand_back(record)
            yield record
        if not verdict(record).remaining and record.ended_at is None:
            record = record.model_copy(update={"ended_at": now()})
            yield record
        hashed = record.sha256
        for role, name in _signers(record):
            question = f"{name} ({role}): do you sign this record, {verdict(record).text}?"
            if (await self._answer(question, role, choices=YES_NO)).word == YES:
                signature = Signature(
                    role=role, name=name, at=now(), statement=verdict(record).text, record_sha256=hashed
                )
                record = record.model_copy(update={"signatures": (*record.signatures, signature)})
                yield record

    async def _as_built(self) -> AsBuiltChange | None:
        """Return one difference to the approved I/O list; None if there is no other."""
        question = "Anything built differently from the approved I/O list? Name the point, or press ENTER for none."
        while (subject := await self._text(question, "as_built")).casefold() in ("y", "yes"):
            question = "Which point is built differently?"
        if subject.casefold() in ("", "n", "no", "none"):
            return None
        return AsBuiltChange(
            subject=subject,
            approved=await self._text("What does the approved list say?", "approved"),
            as_built=await self._text("What is built?", "built"),
            reason=await self._text("Why?", "reason"),
            by=self._by,
            at=now(),
        )

    async def _backup(self, record: Record) -> Record:
        text = "Where is the backup of the PLC program as it is now, after the test?"
        reply = await self._answer(text, Topic.BACKUP_AFTER.value, is_text=True)
        entry = Precondition(
            topic=Topic.BACKUP_AFTER,
            text=text,
            is_met=bool(reply.word),
            value=reply.word,
            reason=reply.note if reply.outcome is not None else "" if reply.word else "no answer",
            by=self._by,
            at=now(),
        )
        return record.model_copy(update={"preconditions": (*record.preconditions, entry)})

    async def _hand_back(self, record: Record) -> Record:
        reply = await self._answer(
            "Is the lift in normal service: all bridges and simulations removed, barricades gone, fire panel restored?",
            "hand_back",
            choices=YES_NO,
        )
        taken_by = await self._text("Who takes the lift back?", "taken_back_by") if reply.word == YES else ""
        back = HandBack(
            in_normal_service=reply.word == YES,
            handed_over_by=self._by,
            taken_back_by=taken_by,
            at=now(),
            note=reply.note,
        )
        return record.model_copy(update={"hand_back": back})

    async def _text(self, text: str, subject: str) -> str:
        return (await self._answer(text, subject, is_text=True)).word

    async def _answer(self, text: str, subject: str, *, choices: tuple[str, ...] = (), is_text: bool = False) -> Reply:
        return await self._person.answer(Question(text, Prompt.CLOSING, subject, "", choices, is_text))


def _signers(record: Record) -> list[tuple[Role, str]]:
    """Return who has not signed the record as it is now, by role."""
    hashed = record.sha256
    signed = {one.role for one in record.signatures if one.record_sha256 == hashed}
    people = record.people
    found = [(Role.RUN_BY, people.run_by), (Role.TECHNICIAN, people.technician), (Role.WITNESS, people.witness)]
    return [(role, person.name) for role, person in found if person is not None and role not in signed]
