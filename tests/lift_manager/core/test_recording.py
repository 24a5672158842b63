"""What is in the journal, and that nothing is pressed before it is."""

import asyncio
from asyncio import Future
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from typing import get_args

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result, Written
from drivers.sparing import CALLERS, TOLD_EVERY_S
from lift_manager.core.journal import ShortJournal
from lift_manager.core.memory import ShortMemory
from lift_manager.core.recording import LiftLog, RecordingBus
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.boarding import KeptBoarding
from lift_manager.domain.events import (
    Advised,
    Alarm,
    CommandEnded,
    DrainBegun,
    DrainOver,
    Event,
    HandedOver,
    LockedOut,
    LockoutOver,
    PersonAcknowledged,
    ReleasedByPerson,
    RequestFollowed,
    RideChanged,
    SessionEnded,
    SessionOpened,
    SessionRestored,
    StateChanged,
)
from lift_manager.domain.journal import Row, RowKind
from lift_manager.domain.journal_rows import row_of
from lift_manager.domain.service import (
    Acknowledged,
    Advice,
    Cause,
    Drain,
    DrainEnded,
    EndReason,
    ForceReleased,
    Lockout,
    LockoutEnded,
    Remembered,
)
from lift_manager.domain.session import KeptSession
from lift_manager.domain.session_requests import Do, Followed, Status
from lift_manager.domain.state import Holder
from register_maps.words import Mode
from tests.support.virtual_time import elapse, run_virtual

ROBOT, OTHER = Holder("workshop", "workshop"), Holder("rmf", "fleet/r1")
AT = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
GO = Command(CommandKind.GO_TO, "L2")
LOCKOUT = Lockout("M. Weber", "door operator is replaced", AT)
DRAIN = Drain("M. Weber", "door is serviced", AT)
FOLLOWED = Followed(
    id="unsaid",
    lift="east",
    holder=Holder("api", "amr-7"),
    do=Do.GO_TO,
    floor="L2",
    status=Status.UNCONFIRMED,
    reason="the lamp did not light",
    proof=Proof.NONE,
    asked_at=AT,
    ended_at=AT,
)
YES, NO = Accepted(), Refused(Refusal.HELD, "held by rmf:fleet/r1 since 3 s")


def ask(floor: str = "L2", *, holder: Holder = ROBOT, hold: bool = True) -> Ask:
    return Ask("east", holder, floor, hold)


EVENTS: dict[type, tuple[Event, RowKind, str, str]] = {
    SessionOpened: (SessionOpened("east", ROBOT, "L2"), RowKind.SESSION, "workshop", "holds the lift, to L2"),
    SessionEnded: (
        SessionEnded("east", ROBOT, EndReason.FIRE, "there is a fire", Advice.STAY_ABOARD),
        RowKind.SESSION,
        "workshop",
        "over: there is a fire",
    ),
    SessionRestored: (
        SessionRestored("east", ROBOT, "L2", "its door was held"),
        RowKind.SESSION,
        "workshop",
        "as before the restart, to L2",
    ),
    HandedOver: (HandedOver("east", OTHER, ROBOT), RowKind.SESSION, "rmf:fleet/r1", "hands the lift over to workshop"),
    ReleasedByPerson: (
        ReleasedByPerson("east", ForceReleased("A. Novak", AT, "robot is stuck", OTHER, maybe_aboard=True)),
        RowKind.PERSON,
        "A. Novak",
        "took the lift from rmf:fleet/r1: robot is stuck",
    ),
    Advised: (Advised("east", OTHER, Advice.CLEAR_DOORWAY, "there is a fire"), RowKind.SESSION, "rmf:fleet/r1", "told"),
    LockedOut: (LockedOut("east", LOCKOUT), RowKind.PERSON, "M. Weber", "door operator is replaced"),
    LockoutOver: (
        LockoutOver("east", LockoutEnded("A. Novak", AT, LOCKOUT)),
        RowKind.PERSON,
        "A. Novak",
        "by M. Weber is ended",
    ),
    DrainBegun: (DrainBegun("east", DRAIN), RowKind.PERSON, "M. Weber", "drain begun by M. Weber: door is serviced"),
    DrainOver: (
        DrainOver("east", DrainEnded("A. Novak", AT, DRAIN)),
        RowKind.PERSON,
        "A. Novak",
        "by M. Weber is ended",
    ),
    PersonAcknowledged: (
        PersonAcknowledged("east", Acknowledged("A. Novak", AT, (Cause.FIRE, Cause.OCCUPIED))),
        RowKind.PERSON,
        "A. Novak",
        "fire and occupied acknowledged",
    ),
    CommandEnded: (
        CommandEnded("east", Outcome(GO, Result.REJECTED, "exception 04"), OTHER),
        RowKind.OUTCOME,
        "rmf:fleet/r1",
        "go_to L2 rejected: exception 04",
    ),
    RequestFollowed: (
        RequestFollowed("east", FOLLOWED),
        RowKind.REQUEST,
        "api:amr-7",
        "go_to L2 unconfirmed: the lamp did not light",
    ),
    Alarm: (Alarm("east", "the door was held for 900 s", ROBOT), RowKind.ALARM, "workshop", "held for 900 s"),
}


def test_every_event_but_a_state_has_a_row_with_lift_caller_and_words() -> None:
    assert set(get_args(Event)) == {StateChanged, RideChanged, *EVENTS}
    for event, kind, caller, words in EVENTS.values():
        row = row_of(event)
        assert row is not None
        assert (row.kind, row.lift, row.caller) == (kind, "east", caller)
        assert words in row.text
        assert "unsaid" not in f"{row.text}{row.data}"
        assert "\n" not in row.text


def test_an_event_that_nobody_hears_is_in_the_journal_and_one_that_is_heard_is_there_first() -> None:
    journal = ShortJournal()
    bus = RecordingBus(journal)
    event = SessionOpened("east", ROBOT, "L2")
    bus.publish(event)
    assert [row.kind for row in journal.rows] == [RowKind.SESSION]
    with bus.listen() as heard:
        bus.publish(event)
        assert asyncio.run(heard.next()) == event
    assert len(journal.rows) == 2


@dataclass
class Desk:
    journal: ShortJournal
    memory: "SlowMemory"
    log: LiftLog

    def say(self, what: Ask, answer: Accepted | Refused = YES) -> None:
        self.log.asked(what)
        self.log.answered(what, answer)

    @property
    def texts(self) -> list[str]:
        return [row.text for row in self.journal.rows]


class SlowMemory(ShortMemory):
    """Takes its time to write."""

    def __init__(self) -> None:
        super().__init__()
        self.awaited: Future[None] | None = None

    def written(self, lift: str) -> Future[None] | None:
        return self.awaited


class SlowJournal(ShortJournal):
    """Answers when it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.awaited: list[Future[str | None]] = []

    def before(self, row: Row) -> Future[str | None]:
        self.note(row)
        self.awaited.append(asyncio.get_running_loop().create_future())
        return self.awaited[-1]


def desk(journal: ShortJournal | None = None) -> Desk:
    journal, memory = journal or ShortJournal(), SlowMemory()
    return Desk(journal, memory, LiftLog("east", journal, memory))


def test_a_request_has_a_row_before_it_is_decided_on_and_a_refusal_has_one_more() -> None:
    async def main() -> None:
        d = desk()
        d.log.asked(ask())
        assert d.texts == ["asks for L2, hold the door there"]
        d.log.answered(ask(), NO)
        assert d.texts[1:] == ["refused: held by rmf:fleet/r1 since 3 s"]
        assert {row.caller for row in d.journal.rows} == {"workshop"}

    run_virtual(main)


def test_repeats_are_counted_and_told_once_a_minute() -> None:
    async def main() -> None:
        d = desk()
        for _ in range(180):
            d.say(ask())
            await elapse(1.0)
        assert d.texts[0] == "asks for L2, hold the door there"
        assert all("again" in text for text in d.texts[1:])
        told = [row.data["times"] for row in d.journal.rows[1:]]
        assert 2 <= len(told) <= 180 / TOLD_EVERY_S
        assert sum(int(str(times)) for times in told) + 1 >= 180 - TOLD_EVERY_S

    run_virtual(main)


def test_what_two_robots_repeat_in_turn_is_counted_for_each() -> None:
    async def main() -> None:
        d = desk()
        for _ in range(30):
            d.say(ask())
            d.say(ask("L1", holder=OTHER), NO)
            await elapse(1.0)
        assert len(d.texts) == 3

    run_virtual(main)


def test_a_repeat_with_another_answer_is_a_row_of_its_own() -> None:
    async def main() -> None:
        d = desk()
        d.say(ask())
        d.say(ask())
        d.say(ask(), NO)
        assert [text.split(",")[0].split(":")[0] for text in d.texts] == [
            "asks for L2",
            "asks for L2 again",
            "asks for L2",
            "refused",
        ]

    run_virtual(main)


HELD = KeptSession(
    holder=ROBOT,
    floor="L2",
    hold_door=True,
    opened_at=AT,
    lease_from=AT,
    holding_since=None,
    kept_at=AT,
    stood_open=False,
    hold_spent=False,
    pressed=True,
    boarding=KeptBoarding(),
)


class HeldMemory(SlowMemory):
    """The lift is held."""

    def recall(self, lift: str) -> Remembered:
        return Remembered(session=HELD)


def test_what_a_holder_repeated_is_told_before_something_is_pressed_for_it_and_what_others_did_is_not() -> None:
    async def main() -> None:
        journal = ShortJournal()
        log = LiftLog("east", journal, HeldMemory())
        for what in (ask(), ask(), ask("L3", holder=OTHER), ask("L3", holder=OTHER)):
            log.asked(what)
            log.answered(what, YES)
        assert log.before(GO, ("0106",)).done()
        assert [(row.kind, row.caller) for row in journal.rows] == [
            (RowKind.REQUEST, "workshop"),
            (RowKind.REQUEST, "rmf:fleet/r1"),
            (RowKind.REQUEST, "workshop"),
            (RowKind.PRESS, "workshop"),
        ]
        assert "again, 1 times" in journal.rows[2].text

    run_virtual(main)


def test_the_callers_that_are_remembered_are_bounded() -> None:
    async def main() -> None:
        d = desk()
        for n in range(3 * CALLERS):
            d.say(ask(holder=Holder("workshop", f"r{n}")))
        assert len(d.texts) == 3 * CALLERS

    run_virtual(main)


@pytest.mark.parametrize("session_first", [True, False])
def test_a_row_that_is_refused_refuses_the_press_whatever_becomes_of_the_session(*, session_first: bool) -> None:
    async def main() -> None:
        journal = SlowJournal()
        d = desk(journal)
        d.memory.awaited = asyncio.get_running_loop().create_future()
        answer = d.log.before(GO, ())
        if session_first:
            d.memory.awaited.set_result(None)
        journal.awaited[0].set_result("the disk is full")
        await elapse(0.0)
        assert answer.result() == "the disk is full"

    run_virtual(main)


def test_a_press_is_refused_at_once_while_the_session_cannot_be_written() -> None:
    async def main() -> None:
        d = desk()
        d.memory.trouble = "state: cannot be written"
        assert d.log.before(GO, ()).result() == "state: cannot be written"
        assert d.log.trouble == "state: cannot be written"

    run_virtual(main)


def test_writes_mode_and_link_have_rows_and_only_changes_do() -> None:
    async def main() -> None:
        d = desk()
        d.log.wrote(Written("go_to", "press", ("0106001000020000",)))
        d.log.wrote(Written("go_to", "release", (), "no answer within 0.5 s"))
        for mode in (Mode.NORMAL, Mode.NORMAL, Mode.FIRE):
            d.log.mode(mode)
        for trouble in ("waits for its alive counter", "", "", "no answer", "another reason", ""):
            d.log.link("plc (192.0.2.10:502)", trouble)
        assert d.texts == [
            "press of go_to was answered",
            "release of go_to failed: no answer within 0.5 s",
            "the mode is normal",
            "the mode was normal and is fire",
            "reading plc (192.0.2.10:502)",
            "no answer",
            "reading plc (192.0.2.10:502)",
        ]
        assert d.journal.rows[0].data["frames"] == ["0106001000020000"]

    run_virtual(main)


def test_rows_are_plain_values() -> None:
    assert {field.name for field in fields(Row)} == {"kind", "text", "lift", "caller", "data", "event"}
