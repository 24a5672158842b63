"""However often something happens, the journal has some of it one by one, and the number of the rest."""

from collections.abc import Callable
from itertools import count, cycle

from drivers.rate_limits import OF_MANY, SUMMARY_EVERY_S
from lift_manager.lift.audit import REQUEST_ROWS
from lift_manager.lift.inputs import LiftRequest
from lift_manager.lift.journal import FLOOR_LETTERS, Row, RowKind
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.requests import TURN_EVERY_S, TURNS
from lift_manager.lift.session import Holder
from lift_manager.lift.state import Quality
from lift_manager.runtime.errors import NotFound, RequestRefused
from lift_manager.runtime.journal import CHANGES, READ_WITHIN_S, LiftJournal
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.runtime.refusals import REFUSALS, FaceRefusal
from register_maps.words import Mode
from tests.support.refusals import refusal, reply
from tests.support.rows import each_row
from tests.support.spine import spine
from tests.support.virtual_time import elapse, run_virtual

ROBOT, OTHER = Holder("workshop", "workshop"), Holder("workshop", "r2")
NO = Refused(Refusal.HELD, "held by workshop:r3")


def on_journal(
    act: Callable[[LiftJournal, float], None], *, times: int, every_s: float, then_s: float = 0.0
) -> list[Row]:
    """Do something again and again, and return what the journal has of it."""
    recorder = MemoryRecorder(newest=100_000)
    journal = LiftJournal("east", "plc", recorder)
    for number in range(times):
        act(journal, number * every_s)
        if number % 10 == 0:
            journal.report((number + 1) * every_s)
    journal.report(times * every_s + then_s)
    return recorder.rows


def request(
    journal: LiftJournal, now: float, floor: str, refused: Refused | None, holder: Holder = ROBOT, *, known: bool = True
) -> None:
    journal.request(LiftRequest(holder, floor, hold_door=True), refused, now, known=known)


def counted(rows: list[Row]) -> int:
    return sum(int(str(row.data.get("times", 0))) for row in rows)


def test_a_caller_that_alternates_has_a_few_rows_a_minute_and_the_rest_by_code() -> None:
    floors = cycle(["L1", "L2", "L3"])
    answers = cycle([None, NO])
    rows = on_journal(
        lambda journal, now: request(journal, now, next(floors), next(answers)),
        times=6000,
        every_s=0.1,
        then_s=SUMMARY_EVERY_S,
    )
    one_by_one = [row for row in rows if row.text.startswith("requests L")]
    assert REQUEST_ROWS <= len(one_by_one) <= REQUEST_ROWS + 10 * (REQUEST_ROWS // OF_MANY)
    assert len(rows) < 2.1 * len(one_by_one) + 12
    assert counted(rows) + len(one_by_one) == 6000
    more = [row for row in rows if "more times" in row.text]
    assert more[0].data["answers"].keys() == {"accepted", "held"}  # type: ignore[union-attr]  # what it counts by
    assert (more[0].lift, more[0].caller) == ("east", "workshop")


def test_a_caller_that_alternates_makes_no_rows_of_what_another_repeats() -> None:
    floors = cycle(["L1", "L2"])

    def both(journal: LiftJournal, now: float) -> None:
        request(journal, now, next(floors), NO)
        request(journal, now, "L1", NO, OTHER)

    rows = on_journal(both, times=55, every_s=1.0)
    assert len([row for row in rows if row.caller == "workshop:r2"]) == 2


def test_floors_that_nobody_has_are_one_kind_and_their_names_are_cut() -> None:
    number = count()

    def made_up(journal: LiftJournal, now: float) -> None:
        floor = "x" * 190 + str(next(number))
        refused = Refused(Refusal.UNKNOWN_FLOOR, f"east has no floor {floor!r}; its floors are L1, L2")
        request(journal, now, floor, refused, known=False)

    rows = on_journal(made_up, times=500, every_s=0.1)
    assert len(rows) == 2
    assert all("x" * (FLOOR_LETTERS + 1) not in row.text + str(row.data) for row in rows)
    assert "its floors are L1, L2" in rows[1].text


def test_a_mode_that_flickers_is_counted_and_its_last_value_is_there() -> None:
    modes = cycle([Mode.NORMAL, Mode.UNKNOWN])
    rows = on_journal(
        lambda journal, now: journal.mode(next(modes), now), times=601, every_s=0.2, then_s=SUMMARY_EVERY_S
    )
    one_by_one = [row for row in rows if "times" not in row.data]
    assert len(rows) < CHANGES + 8
    assert counted(rows) + len(one_by_one) == 601
    assert "between normal and unknown" in rows[CHANGES].text
    assert rows[-1].data["mode"] == Mode.NORMAL


def test_a_link_that_flaps_is_counted_and_how_it_is_at_last_is_there() -> None:
    faults = cycle(["", "no answer"])
    rows = on_journal(
        lambda journal, now: journal.link(next(faults), now), times=300, every_s=1.0, then_s=SUMMARY_EVERY_S
    )
    assert len(rows) < CHANGES + 12
    assert counted(rows) + len([row for row in rows if "times" not in row.data]) == 300
    assert rows[-1].data["up"] is False
    assert "no answer" in rows[-1].text


def test_what_was_counted_is_told_a_minute_later_though_nobody_asks_any_more() -> None:
    def thrice(journal: LiftJournal, now: float) -> None:
        for _ in range(3):
            request(journal, now, "L1", NO)

    rows = on_journal(thrice, times=1, every_s=0.0, then_s=SUMMARY_EVERY_S)
    assert [row.data.get("times") for row in rows] == [None, None, 2]


def test_a_caller_that_was_quiet_for_a_while_has_its_whole_share_again() -> None:
    def many(journal: LiftJournal, now: float) -> None:
        for number in range(2 * REQUEST_ROWS):
            request(journal, now, f"L{number}", None)

    rows = on_journal(many, times=2, every_s=10 * SUMMARY_EVERY_S)
    assert len([row for row in rows if row.text.startswith("requests L")]) == 2 * REQUEST_ROWS


def test_a_lift_that_is_read_soon_after_the_start_was_never_lost_and_one_that_is_not_was() -> None:
    rows = on_journal(
        lambda journal, now: journal.link("waits for its alive counter", now), times=2, every_s=READ_WITHIN_S / 4
    )
    assert not rows
    rows = on_journal(lambda journal, now: journal.link("no answer", now), times=20, every_s=READ_WITHIN_S / 4)
    assert [row.text for row in rows] == ["no answer"]
    rows = on_journal(lambda journal, now: journal.link("", now), times=2, every_s=1.0)
    assert [row.text for row in rows] == ["reading plc"]


def test_a_lift_that_is_read_at_once_has_its_row_and_no_other() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            assert lift.state.quality is Quality.LIVE

    run_virtual(main)
    assert [row.data["up"] for row in journal.rows if row.kind is RowKind.LINK] == [True]


def test_a_robot_that_wants_another_floor_all_the_time_is_refused_and_writes_little() -> None:
    journal = MemoryRecorder(newest=100_000)

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            floors, refused = cycle(["L1", "L2", "L3"]), 0
            for _ in range(1500):
                answer = reply(lift.accept, next(floors))
                if isinstance(answer, RequestRefused):
                    refused += 1
                    assert answer.code is Refusal.TOO_OFTEN
                    assert "send another request in" in answer.message
                await elapse(0.01)
            # every third request is for the floor that it has, and changes nothing
            assert 1500 - refused <= 500 + TURNS + 15 / TURN_EVERY_S + 1
            assert len(journal.rows) < 200
            await elapse(TURN_EVERY_S)
            lift.accept("L1")

    run_virtual(main, limit_s=300)


def test_a_robot_that_takes_and_gives_back_all_the_time_is_refused_too_and_may_always_give_back() -> None:
    journal = MemoryRecorder(newest=100_000)

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            here = lift.state.floor
            assert here is not None
            for _ in range(750):
                reply(lift.accept, "L3")
                lift.accept(lift.state.floor or here, hold=False)
                await elapse(0.02)
            assert len(journal.rows) < 200
            assert len([row for row in journal.rows if row.kind is RowKind.SESSION]) <= 2 * (
                TURNS + 15 / TURN_EVERY_S + 1
            )

    run_virtual(main, limit_s=300)


def test_a_robot_that_asks_for_one_floor_is_never_told_that_it_asks_too_often() -> None:
    async def main() -> None:
        async with spine() as lift:
            for _ in range(10 * TURNS):
                lift.accept("L3")
                await elapse(0.02)

    run_virtual(main)


@each_row(("more", "times"), [(1, "once more"), (990, "990 more times")])
def test_whoever_is_turned_away_has_a_few_rows_and_the_rest_is_counted_and_told_at_the_end(
    more: int, times: str
) -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            journal.rows.clear()
            for n in range(REFUSALS + more):
                lift.site.turned_away(FaceRefusal("bad_key", "its key does not count", address=f"192.0.2.{n % 250}"))
            lift.site.turned_away(FaceRefusal("not_allowed", "may not do this", "lift", "workshop:r1", "192.0.2.7"))
            await lift.life.stop()

    run_virtual(main)
    refused = [row for row in journal.rows if row.kind is RowKind.REQUEST]
    assert len(refused) == REFUSALS + 2
    assert refused[0].text == "refused: its key does not count, from 192.0.2.0"
    assert refused[REFUSALS].caller == "workshop:r1"
    assert refused[-1].text == f"refused {times} within 0 s: {more} bad_key"
    assert refused[-1].data == {"times": more, "answers": {"bad_key": more}}


def test_logins_of_a_key_have_a_few_rows_and_the_rest_is_counted() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            journal.rows.clear()
            for _ in range(REFUSALS):
                lift.site.logged_in("desk", "192.0.2.7")
                lift.site.logged_in("desk", "192.0.2.7", ended=True)
            await lift.life.stop()

    run_virtual(main)
    begun, ended, *others, rest = [row for row in journal.rows if row.kind is RowKind.KEY]
    assert (begun.caller, begun.text) == ("desk", "a browser logged in, from 192.0.2.7")
    assert ended.data == {"done": "logged_out", "address": "192.0.2.7"}
    assert len(others) == REFUSALS - 2
    half = REFUSALS // 2
    assert rest.text == f"logged in or out {REFUSALS} more times within 0 s: {half} logged_in, {half} logged_out"


def test_a_person_who_is_refused_and_a_lift_that_nobody_has_are_written_down() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            journal.rows.clear()
            refusal(lift.site.end_lockout, "lift", "A. Novak")
            for named in (
                refusal(lift.site.acknowledge, "cellar", "A. Novak"),
                refusal(lift.site.request, "cellar", ROBOT, "L1", hold_door=True),
            ):
                assert isinstance(named, NotFound)

    run_virtual(main)
    assert [(row.kind, row.lift, row.caller, row.data["refused"]) for row in journal.rows] == [
        (RowKind.PERSON, "lift", "A. Novak", "not_locked_out"),
        (RowKind.PERSON, "cellar", "A. Novak", "unknown_lift"),
        (RowKind.REQUEST, "cellar", "workshop", "unknown_lift"),
    ]
    assert "lockout_end refused" in journal.rows[0].text


def test_a_running_manager_tells_what_was_counted_though_nobody_asks_any_more_and_at_its_end_the_rest() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal) as lift:
            for _ in range(3):
                lift.refuse("attic")
            await elapse(2 * SUMMARY_EVERY_S)
            assert counted(journal.rows) == 2
            lift.refuse("attic")
            await lift.life.stop()
            assert counted(journal.rows) == 3

    run_virtual(main)
