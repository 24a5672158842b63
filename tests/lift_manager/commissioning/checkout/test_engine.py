"""A checkout from its preconditions to its signatures: what is kept, what is asked again, and what is done again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lift_manager.commissioning.checkout.engine import Checkout, NotConfirmed
from lift_manager.commissioning.checkout.person import Prompt, Question, Reply
from lift_manager.commissioning.checkout.plan import ItemKind, make_plan
from lift_manager.commissioning.checkout.record import Outcome, Record, Severity, Stage, Topic, load, save, verdict
from lift_manager.commissioning.checkout.report.words import current
from tests.support.checkout_rig import LIFT, Rig, TruthfulPerson, check_out, new_record, site_of
from tests.support.virtual_time import run_virtual

SKIP = Reply("", Outcome.SKIPPED, "no key at hand")


class OnlyAnswers(TruthfulPerson):
    """Answers the first questions, then nobody is there any more."""

    def __init__(self, rig: Rig, questions: int) -> None:
        super().__init__(rig)
        self._left = questions

    async def answer(self, question: Question) -> Reply:
        self._left -= 1
        if self._left < 0:
            await asyncio.get_running_loop().create_future()
        return await super().answer(question)


def test_every_result_is_saved_and_an_interruption_loses_only_the_item_under_test(tmp_path: Path) -> None:
    loaded, path = site_of(tmp_path), tmp_path / "record.json"

    async def main() -> None:
        rig = Rig(loaded)
        person = OnlyAnswers(rig, 14)
        running = asyncio.create_task(
            check_out(rig, ["C-10", "C-12"], person=person, save=lambda record: save(path, record))
        )
        await asyncio.sleep(120.0)
        running.cancel()
        await asyncio.wait((running,))
        rig.face.advance(rig.now)
        assert not rig.face.commands, "an output is still on"

    run_virtual(main, limit_s=30000.0)
    record = load(path)
    assert record is not None
    assert [result.item for result in record.results] == ["C-10"]
    assert len(record.preconditions) == 7


def test_preconditions_are_asked_once_and_again_before_each_abnormal_case(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig, {(Prompt.PRECONDITION, Topic.FIRE_PANEL): Reply("", Outcome.SKIPPED, "no panel")})
        record = await check_out(rig, ["A-01", "R-01"], person=person)
        asked = [(entry.topic, entry.item) for entry in record.preconditions]
        assert asked[-3:] == [(Topic.CAR_EMPTY, "A-01"), (Topic.LANDINGS, "A-01"), (Topic.FIRE_PANEL, "A-01")]
        assert [entry.item for entry in record.preconditions].count("") == 7
        assert [entry.reason for entry in record.preconditions if not entry.is_met] == ["no panel", "no panel"]
        again = Checkout(record, lambda _: None, person, rig, rig.codec, ["plc"])
        await again.run([item for item in record.items if item.id == "R-02"])
        assert len(again.record.preconditions) == 10

    run_virtual(main, limit_s=30000.0)


def test_preconditions_are_asked_again_on_request_and_the_last_answer_counts(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        record = await check_out(rig, ["R-01"])
        person = TruthfulPerson(rig, {(Prompt.PRECONDITION, Topic.PERMIT): Reply("P-882")})
        again = Checkout(record, lambda _: None, person, rig, rig.codec, ["plc"])
        await again.renew_conditions()
        permits = [one.value for one in again.record.preconditions if one.topic is Topic.PERMIT]
        assert permits == ["the permit", "P-882"]
        assert [one.value for one in current(again.record.preconditions) if one.topic is Topic.PERMIT] == ["P-882"]

    run_virtual(main, limit_s=30000.0)


def test_what_is_skipped_or_failed_is_an_open_point_until_it_passes(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig, {(Prompt.ROBOT, "R-01"): SKIP, (Prompt.ROBOT, "R-02"): Reply("no")})
        record = await check_out(rig, ["R-01", "R-02"], person=person)
        assert [(entry.item, entry.severity) for entry in record.punch] == [("R-01", Severity.B), ("R-02", Severity.A)]
        again = Checkout(record, lambda _: None, TruthfulPerson(rig), rig, rig.codec, ["plc"])
        await again.run([item for item in record.items if item.id in ("R-01", "R-02")])
        assert [entry.is_open for entry in again.record.punch] == [False, False]
        assert [result.outcome for result in again.record.results] == [
            Outcome.SKIPPED,
            Outcome.FAILED,
            Outcome.PASSED,
            Outcome.PASSED,
        ]

    run_virtual(main, limit_s=30000.0)


def test_a_document_and_what_does_not_apply_settle_an_item(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        replies = {
            (Prompt.ROBOT, "R-03"): Reply(
                "", Outcome.DOCUMENT, "measured by the lift company, report 12", ("p.jpg",), "Cy"
            ),
            (Prompt.MAKE, "overload"): Reply("", Outcome.NOT_APPLICABLE, "no load sensor"),
        }
        record = await check_out(rig, ["S-29", "R-03"], person=TruthfulPerson(rig, replies))
        found = {one.item: one for one in record.results}
        assert (found["S-29"].outcome, found["S-29"].note) == (Outcome.NOT_APPLICABLE, "no load sensor")
        assert (found["R-03"].outcome, found["R-03"].photos, found["R-03"].confirmed_by) == (
            Outcome.DOCUMENT,
            ("p.jpg",),
            "Cy",
        )

    run_virtual(main, limit_s=30000.0)


class TwoPeople(TruthfulPerson):
    """Lets a second person do something on a phone whenever one of these questions waits."""

    def __init__(self, rig: Rig, replies: dict[Any, Any], on_phone: dict[str, Callable[[], None]]) -> None:
        super().__init__(rig, replies)
        self._on_phone = on_phone

    async def answer(self, question: Question) -> Reply:
        if question.subject in self._on_phone:
            self._on_phone[question.subject]()
        return await super().answer(question)


def test_a_second_person_confirms_the_newest_result_once_while_the_test_goes_on(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)
    saved: list[Record] = []
    refused: list[str] = []

    async def main() -> None:
        rig = Rig(loaded)
        items = tuple(item for item in make_plan(loaded, LIFT, Stage.SAT) if item.kind == ItemKind.QUESTION)
        assert [item.id for item in items] == ["R-01", "R-02", "R-03", "R-04"]

        def confirm(number: int) -> None:
            try:
                test.confirm(number, "Cy")
            except NotConfirmed as error:
                refused.append(str(error))

        def during_second() -> None:
            assert (test.item, test.confirmable) == (items[1], test.record.results[0])
            confirm(1)
            confirm(1)

        on_phone: dict[str, Callable[[], None]] = {
            "R-01": lambda: confirm(0),
            "R-02": during_second,
            "R-03": lambda: confirm(1),
            "R-04": lambda: confirm(3),
        }
        person = TwoPeople(rig, {(Prompt.ROBOT, "R-03"): SKIP}, on_phone)
        test = Checkout(new_record(loaded, items), saved.append, person, rig, rig.codec, ["plc"])
        await test.run(items)
        assert (test.item, test.confirmable) == (None, test.record.results[3])
        test.confirm(4, "Cy")

    run_virtual(main, limit_s=30000.0)
    record = saved[-1]
    assert [(one.item, one.name, one.by) for one in record.confirmations] == [
        ("R-01", "Cy", "phone"),
        ("R-04", "Cy", "phone"),
    ]
    assert [len(record.confirmations_of(result)) for result in record.results] == [1, 0, 0, 1]
    meanwhile = "Another item was done meanwhile, so this was not recorded. Look at what is shown now."
    assert refused == [meanwhile, "R-01 is confirmed already.", meanwhile, meanwhile]


def test_a_result_that_was_there_before_is_not_confirmed_and_one_that_is_done_again_anew(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        record = await check_out(rig, ["R-01"])
        again = Checkout(record, lambda _: None, TruthfulPerson(rig), rig, rig.codec, ["plc"])
        assert again.confirmable is None
        with pytest.raises(NotConfirmed):
            again.confirm(1, "Cy")
        item = next(one for one in record.items if one.id == "R-01")
        await again.run([item])
        again.confirm(2, "Cy")
        await again.run([item])
        again.confirm(3, "Cy")
        assert [len(again.record.confirmations_of(result)) for result in again.record.results] == [0, 1, 1]

    run_virtual(main, limit_s=30000.0)


def test_at_the_end_points_are_settled_the_lift_is_handed_back_and_the_record_signed(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)
    saved: list[Record] = []

    async def main() -> None:
        rig = Rig(loaded)
        items = tuple(item for item in make_plan(loaded, LIFT, Stage.SAT) if item.kind == ItemKind.QUESTION)
        person = TruthfulPerson(rig, {(Prompt.ROBOT, "R-01"): SKIP})
        test = Checkout(new_record(loaded, items), saved.append, person, rig, rig.codec, ["plc"])
        await test.run(items)
        await test.close()
        found = verdict(test.record)
        assert (found.text, found.is_handed_back, found.is_signed) == ("passed under conditions", True, True)
        assert test.record.hand_back is not None
        assert test.record.hand_back.taken_back_by == "the taken_back_by"
        assert saved[-1] == test.record
        await test.close()
        assert len(test.record.signatures) == 2

    run_virtual(main, limit_s=30000.0)


class Says(TruthfulPerson):
    """Answers questions of the end with these lines, the others with the truth."""

    def __init__(self, rig: Rig, lines: dict[str, list[str]]) -> None:
        super().__init__(rig)
        self._lines = lines

    async def answer(self, question: Question) -> Reply:
        if question.topic is Prompt.CLOSING and self._lines.get(question.subject):
            self.questions.append(question)
            return Reply(self._lines[question.subject].pop(0))
        return await super().answer(question)


@pytest.mark.parametrize(
    ("lines", "changes"), [(["none"], []), (["No"], []), (["yes", "fire", ""], ["fire"]), (["y", ""], [])]
)
def test_a_yes_or_no_to_as_built_changes_is_no_name_of_a_point(
    tmp_path: Path, lines: list[str], changes: list[str]
) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        record = await check_out(rig, ["R-01"])
        test = Checkout(record, lambda _: None, Says(rig, {"as_built": lines}), rig, rig.codec, ["plc"])
        await test.close()
        assert [one.subject for one in test.record.as_built] == changes

    run_virtual(main, limit_s=30000.0)


def test_in_the_factory_nobody_is_asked_about_passengers(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig)
        record = await check_out(rig, ["R-01"], person=person, stage=Stage.FAT)
        asked = {question.subject for question in person.questions if question.topic is Prompt.PRECONDITION}
        assert Topic.CAR_EMPTY not in asked
        assert person.told.count("without the real lift and robot: `na` with the reason; it is done at the lift") == 1
        assert {entry.reason for entry in record.preconditions if not entry.is_met} == {
            "factory acceptance test: no passengers"
        }

    run_virtual(main, limit_s=30000.0)


LATCHES = {
    "override": {"commands": {"hold_door.front": {"on_link_loss": "latches", "cleared_after_s": None}}},
    "accept_latching": "the panel has a relay",
}


@pytest.mark.parametrize(("keys", "is_told"), [(LATCHES, True), ({}, False)])
def test_outputs_that_latch_need_the_technician_at_the_panel(
    tmp_path: Path, keys: dict[str, Any], is_told: bool
) -> None:
    loaded = site_of(tmp_path, **keys)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig)
        record = await check_out(rig, ["R-01"], person=person)
        assert (Topic.LATCHING in {entry.topic for entry in record.preconditions}) is is_told
        assert (
            any("hold_door.front (coil:8) stays on if this computer stops" in text for text in person.told) is is_told
        )

    run_virtual(main, limit_s=30000.0)
