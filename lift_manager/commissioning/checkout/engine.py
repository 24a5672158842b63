"""Runs the items of an acceptance test one after the other, and keeps the record after every result."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from itertools import groupby

from drivers.errors import ConnectFailed
from lift_manager.client.errors import ClientError
from lift_manager.commissioning.checkout.access import Access, HoldFailed
from lift_manager.commissioning.checkout.closing import Closing
from lift_manager.commissioning.checkout.lift import WatchedLift
from lift_manager.commissioning.checkout.person import YES, YES_NO, Person, Prompt, Question
from lift_manager.commissioning.checkout.plan import ItemKind
from lift_manager.commissioning.checkout.record import (
    Confirmation,
    Fingerprint,
    Item,
    Outcome,
    Precondition,
    PunchEntry,
    Record,
    Result,
    Severity,
    Stage,
    Topic,
    now,
)
from lift_manager.commissioning.checkout.registers import ReadFailed
from lift_manager.commissioning.checkout.steps.abnormal import (
    check_cable,
    check_fire,
    check_power,
    check_quiet,
    check_robot_mode,
    check_watchdog,
)
from lift_manager.commissioning.checkout.steps.commands import check_command, check_floor
from lift_manager.commissioning.checkout.steps.signals import check_signal
from lift_manager.commissioning.checkout.steps.step import Settled, Step
from lift_manager.commissioning.checkout.steps.trips import check_trips
from register_maps.codec import Codec

WITHOUT_MANAGER = frozenset({ItemKind.QUIET, ItemKind.WATCHDOG, ItemKind.QUESTION})
"""Items for which no manager of this program may run, or none is needed."""
Save = Callable[[Record], None]
_PROCEDURES: Mapping[ItemKind, Callable[[Step, WatchedLift], Awaitable[None]]] = {
    ItemKind.SIGNAL: check_signal,
    ItemKind.COMMAND: check_command,
    ItemKind.FLOOR: check_floor,
    ItemKind.CABLE: check_cable,
    ItemKind.POWER: check_power,
    ItemKind.FIRE: check_fire,
    ItemKind.ROBOT_MODE: check_robot_mode,
    ItemKind.TRIPS: check_trips,
}

PRECONDITIONS: tuple[tuple[Topic, str, bool], ...] = (
    (Topic.IO_LIST, "Which revision of the I/O list is approved?", True),
    (Topic.PERMIT, "What is the number of the permit to work?", True),
    (Topic.INSTRUMENTS, "Which instruments are used, and until when are they calibrated?", True),
    (Topic.BACKUP_BEFORE, "Where is the backup of the PLC program that was made before the test?", True),
    (Topic.CAR_EMPTY, "Is the car empty?", False),
    (Topic.LANDINGS, "Are the landings barricaded?", False),
    (Topic.FIRE_PANEL, "Is the fire panel isolated, so that a test alarms nobody?", False),
)
BEFORE_ABNORMAL = frozenset({Topic.CAR_EMPTY, Topic.LANDINGS, Topic.FIRE_PANEL})
ON_THE_DESK = "factory acceptance test: no passengers"


class NotConfirmed(Exception):
    """A confirmation does not count; the sentence says why, for the second person."""


class Checkout:
    """One acceptance test while it runs. `record` is the newest state, which has been saved."""

    def __init__(
        self, record: Record, save: Save, person: Person, access: Access, codec: Codec, links: Sequence[str]
    ) -> None:
        """`links` are the controllers of the lift by their names in the site file."""
        self.record = record
        self._save_record = save
        self._person = person
        self._access = access
        self._codec = codec
        self._links = tuple(links)
        self._by = record.people.run_by.name
        self._earlier_results = len(record.results)
        self.item: Item | None = None
        """The item under test."""

    @property
    def confirmable(self) -> Result | None:
        """The newest result of this run, if it was there to be seen: the one that a second person may confirm."""
        results = self.record.results
        is_new = len(results) > self._earlier_results
        return results[-1] if is_new and results[-1].outcome in (Outcome.PASSED, Outcome.FAILED) else None

    def confirm(self, number: int, name: str) -> Confirmation:
        """Keep that a second person saw how the newest result came about, which is number `len(record.results)`.

        Raises NotConfirmed, and what saving raises.
        """
        result = self.confirmable
        if result is None or number != len(self.record.results):
            raise NotConfirmed("Another item was done meanwhile, so this was not recorded. Look at what is shown now.")
        if self.record.confirmations_of(result):
            raise NotConfirmed(f"{result.item} is confirmed already.")
        found = Confirmation(item=result.item, result=number, name=name, at=now())
        self._keep(self.record.model_copy(update={"confirmations": (*self.record.confirmations, found)}))
        return found

    def keep_fingerprint(self, found: Fingerprint) -> None:
        """Keep what was found out about the controller before the first item."""
        controller = self.record.controller.model_copy(update={"fingerprint": found})
        self._keep(self.record.model_copy(update={"controller": controller}))

    async def renew_conditions(self) -> None:
        """Ask again for what has to be so before the test; the earlier answers stay in the record."""
        for topic, text, is_text in PRECONDITIONS:
            await self._check_precondition(topic, text, is_text=is_text)

    async def run(self, items: Sequence[Item]) -> None:
        """Carry out items in their order. May be cancelled at any time: the item under test then has no result, and all outputs are off."""
        await self._prepare()
        remaining = list(items)
        for alone, group in groupby(items, lambda item: ItemKind(item.kind) in WITHOUT_MANAGER):
            if alone:
                for item in group:
                    await self._carry_out(item, None, remaining)
            else:
                async with self._access.manager() as client:
                    lift = WatchedLift(client, self.record.lift, self._codec, self._links)
                    for item in group:
                        await self._carry_out(item, lift, remaining)

    async def close(self) -> None:
        """Settle what is left at the end: open points, backup, hand-back, signatures."""
        closing = Closing(self._person, self._by)
        async for record in closing.settle(self.record):
            self._keep(record)

    def _keep(self, record: Record) -> None:
        self._save_record(record)
        self.record = record

    async def _prepare(self) -> None:
        known = {entry.topic for entry in self.record.preconditions if not entry.item}
        for topic, text, is_text in PRECONDITIONS:
            if topic not in known:
                await self._check_precondition(topic, text, is_text=is_text)
        latching = list(latching_outputs(self._codec))
        for text in latching:
            self._person.show(text)
        if latching and self.record.stage is not Stage.FAT and Topic.LATCHING not in known:
            text = "Does the lift technician stand at the panel, to release these outputs if this computer stops?"
            await self._check_precondition(Topic.LATCHING, text, is_text=False)

    async def _check_precondition(self, topic: Topic, text: str, *, is_text: bool, item: str = "") -> None:
        met, value, reason = False, "", ON_THE_DESK
        if is_text or self.record.stage is not Stage.FAT:
            met, value, reason = await self._precondition_reply(topic, text, is_text=is_text)
        entry = Precondition(
            topic=topic, text=text, is_met=met, value=value, reason=reason, item=item, by=self._by, at=now()
        )
        self._keep(self.record.model_copy(update={"preconditions": (*self.record.preconditions, entry)}))

    async def _precondition_reply(self, topic: Topic, text: str, *, is_text: bool) -> tuple[bool, str, str]:
        """Return whether a precondition is met, its value, and the reason if it is skipped."""
        while True:
            question = Question(text, Prompt.PRECONDITION, topic.value, "", () if is_text else YES_NO, is_text)
            reply = await self._person.answer(question)
            if reply.outcome is not None:
                return False, "", reply.note
            if is_text and reply.word:
                return True, reply.word, ""
            if reply.word == YES:
                return True, "", ""
            self._person.show("make it so first, or skip it with a reason")

    async def _carry_out(self, item: Item, lift: WatchedLift | None, remaining: list[Item]) -> None:
        """Carry out one item until it has a result that the person leaves as it is."""
        self._announce(item, remaining)
        if item.is_abnormal:
            for topic, text, is_text in PRECONDITIONS:
                if topic in BEFORE_ABNORMAL:
                    await self._check_precondition(topic, text, is_text=is_text, item=item.id)
        while True:
            await self._acknowledge(lift)
            result = await self._once(item, lift)
            await self._acknowledge(lift)
            self._person.show(f"{item.id}: {result.outcome}{f', {result.note}' if result.note else ''}")
            if result.outcome is not Outcome.FAILED:
                break
            question = Question(f"{item.id} failed. Do it once more now?", Prompt.AGAIN, item.id, "", YES_NO)
            if (await self._person.answer(question)).word != YES:
                break
        remaining.remove(item)

    async def _acknowledge(self, lift: WatchedLift | None) -> None:
        """Let the person acknowledge what keeps robots off since a test: a fire, or a robot that may be in the car."""
        if lift is None:
            return
        try:
            restrictions = (await lift.look()).lift.restrictions
            if not restrictions.fire_latched and restrictions.maybe_occupied_by is None:
                return
            text = (
                "Robots are kept off since that test. Is the fire over, the lift checked, and its car empty? Yes acknowledges it, and"
                " robots may use the lift again."
            )
            if (await self._person.answer(Question(text, Prompt.ACKNOWLEDGE, choices=YES_NO))).word == YES:
                await lift.client.acknowledge(lift.name, self._by)
        except ClientError as error:
            self._person.show(str(error))

    async def _once(self, item: Item, lift: WatchedLift | None) -> Result:
        step = Step(item, self._person, self._codec, self.record.floors, self._by)
        began_at = now()
        self.item = item
        try:
            await self._procedure(step, lift)
        except Settled as settled:
            outcome, note = settled.outcome, settled.note
            if step.problems and outcome is not Outcome.FAILED:
                note = f"{note}; before that: {'; '.join(step.problems)}"
        except (ClientError, ReadFailed, ConnectFailed, HoldFailed) as error:
            step.problem(str(error))
            outcome, note = Outcome.FAILED, "; ".join(step.problems)
        else:
            outcome = Outcome.FAILED if step.problems else Outcome.PASSED
            note = "; ".join([*step.problems, *step.notes])
        result = Result(
            item=item.id,
            digest=item.digest,
            outcome=outcome,
            by=self._by,
            confirmed_by=step.confirmed_by,
            began_at=began_at,
            at=now(),
            note=note,
            photos=tuple(step.photos),
            evidence=tuple(step.evidence),
            figures=dict(step.figures),
        )
        self.item = None
        record = self.record
        self._keep(
            record.model_copy(
                update={
                    "results": (*record.results, result),
                    "trips": (*record.trips, *step.trips),
                    "punch_list": (*record.punch_list, *_punch(record, result)),
                }
            )
        )
        return result

    async def _procedure(self, step: Step, lift: WatchedLift | None) -> None:
        kind = ItemKind(step.item.kind)
        if lift is None:
            match kind:
                case ItemKind.QUIET:
                    async with self._access.registers() as registers:
                        await check_quiet(step, registers)
                case ItemKind.WATCHDOG:
                    await check_watchdog(step, self._access, step.floors[0])
                case _:
                    if self.record.stage is Stage.FAT:
                        self._person.show(
                            "without the real lift and robot: `na` with the reason; it is done at the lift"
                        )
                    if not await step.yes("Is it as expected?", Prompt.ROBOT, subject=step.item.id):
                        step.problem(f"not as expected: {step.item.expected}")
            return
        await _PROCEDURES[kind](step, lift)

    def _announce(self, item: Item, remaining: Sequence[Item]) -> None:
        left_min = sum(one.estimate_s for one in remaining) / 60
        self._person.show("")
        self._person.show(f"{item.id}  {item.title}  ({len(remaining)} left, about {left_min:.0f} min)")
        for point in item.points[:8]:
            self._person.show(f"      {point.printed} in the vendor's table, {point.wire} on the wire")
        self._person.show(f"      {item.action}")
        self._person.show(f"      Expected: {item.expected}")


def latching_outputs(codec: Codec) -> Iterator[str]:
    """Yield what would stay on if this computer stopped, a line each."""
    for name, command in codec.commands.items():
        if command.spec.on_link_loss == "latches":
            yield f"{name} ({', '.join(command.spec.addresses)}) stays on if this computer stops, until somebody releases it at the panel"


def _punch(record: Record, result: Result) -> Iterator[PunchEntry]:
    """Yield the entries of the punch list that a result opens or closes."""
    entry = next((one for one in record.punch if one.item == result.item and one.is_open), None)
    if result.outcome in (Outcome.FAILED, Outcome.SKIPPED):
        yield PunchEntry(
            number=entry.number if entry is not None else len(record.punch) + 1,
            item=result.item,
            text=result.note,
            severity=Severity.A if result.outcome is Outcome.FAILED else Severity.B,
            raised_at=entry.raised_at if entry is not None else result.at,
        )
    elif entry is not None:
        yield entry.model_copy(update={"closed_at": result.at, "closed_by": result.by})
