"""A press waits until it is written down, and nothing else does."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import pytest

from drivers.modbus.memory import MemoryDevice, exception
from drivers.model import Command, CommandKind, Outcome, Result
from lift_manager.core.outputs import ROW_REFUSED_PAUSE_S, ROW_WITHIN_S, LiftOutputs
from register_maps.words import Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.linked import now
from tests.drivers.rig import CLOSE_FRONT, HOLD, HOLD_FRONT, SIGNALS, Rig, allowed, rig
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import written_map

GO1, GO2 = Command(CommandKind.GO_TO, "L1"), Command(CommandKind.GO_TO, "L2")
PULSE = "action: pulse, width_s: 0.5, confirm: {any_of: [readback], within_s: 2}"
HOLDING = HOLD.replace("max_hold_s: 30", "max_hold_s: 30, refresh_s: 0.5")
ALL = (
    f'{SIGNALS}commands:\n  go_to: {{at: "holding:40", as: floor, rest: 0, {PULSE}}}\n'
    f'  hold_door.front: {{at: "coil:8", {HOLDING}, excludes: [close_door.front], gap_s: 0.1}}\n'
    '  close_door.front: {at: "coil:10", action: hold, max_hold_s: 10, until: closed, on_link_loss: latches,'
    " confirm: {any_of: [readback], within_s: 2}}\n"
    f'  robot_mode: {{at: "coil:12", {HOLDING}}}\n'
)
MODE = Command(CommandKind.ROBOT_MODE)


@dataclass
class Bench:
    """The outputs of a lift as sessions use them, over a real driver."""

    lift: LiftOutputs
    rig: Rig

    @property
    def device(self) -> MemoryDevice:
        return self.rig.device

    def writes(self) -> list[str]:
        return self.rig.writes()

    def cells(self, table: Table, *addresses: int) -> list[int]:
        return self.rig.cells(table, *addresses)


def on_bench(check: Callable[[Bench], Awaitable[None]], text: str, log: LogByHand) -> None:
    async def main() -> None:
        async with rig(written_map(text)) as made:
            await check(Bench(LiftOutputs("lift", made.lift.driver, log), made))

    run_virtual(main, limit_s=600)


def result(press: asyncio.Future[Outcome]) -> tuple[Result, str]:
    return press.result().result, press.result().reason


def released_at(made: Bench, text: str) -> float:
    return next(heard.at_s for heard in made.device.heard if str(heard.request) == text)


def test_a_press_leaves_when_its_row_is_written_and_not_before() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        press = made.lift.press(GO2, allowed)
        assert log.rows == [("go_to L2", ("010600280002",))]
        await elapse(1.0)
        assert made.writes() == []
        assert made.lift.given(GO2)
        log.answer()
        await elapse(0.4)
        assert made.cells(Table.HOLDING, 40) == [2]
        await elapse(2.0)
        assert result(press) == (Result.CONFIRMED, "")
        assert press.result().frames == log.rows[0][1]

    on_bench(check, ALL, log)


def test_a_press_that_cannot_be_written_down_is_rejected_with_that_reason_and_nothing_is_sent() -> None:
    for log in (LogByHand(trouble="the disk is full"), LogByHand(answers=False)):

        async def check(made: Bench, log: LogByHand = log) -> None:
            press = made.lift.press(GO2, allowed)
            await elapse(0.5)
            if log.waiting:
                log.answer("the disk is full")
            await elapse(5.0)
            assert result(press) == (Result.REJECTED, "the disk is full")
            assert press.result().frames == ()
            assert made.writes() == []
            assert not made.lift.given(GO2)

        on_bench(check, ALL, log)


def test_a_press_whose_row_never_comes_is_given_up_and_a_late_row_presses_nothing() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        press = made.lift.press(GO2, allowed)
        await elapse(ROW_WITHIN_S - 0.01)
        assert not press.done()
        await elapse(0.02)
        assert result(press)[0] is Result.REJECTED
        assert "could not be written down within 3 s" in result(press)[1]
        log.answer()
        await elapse(1.0)
        assert made.writes() == []
        assert not made.lift.given(GO2)

    on_bench(check, ALL, log)


def test_a_journal_that_ends_or_breaks_refuses_the_press() -> None:
    for end, said in (
        (lambda row: row.cancel(), "because the journal has ended"),
        (lambda row: row.set_exception(OSError("no such device")), "it was not written down: no such device"),
    ):
        log = LogByHand(answers=False)

        async def check(
            made: Bench,
            log: LogByHand = log,
            end: Callable[[asyncio.Future[str | None]], object] = end,
            said: str = said,
        ) -> None:
            press = made.lift.press(GO2, allowed)
            end(log.waiting.pop())
            await elapse(1.0)
            assert result(press)[0] is Result.REJECTED
            assert said in result(press)[1]
            assert made.writes() == []

        on_bench(check, ALL, log)


def test_releases_refreshes_and_other_commands_do_not_wait_while_a_row_is_awaited() -> None:
    log = LogByHand()

    async def check(made: Bench) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.hold(MODE, allowed)
        await elapse(0.2)
        assert made.cells(Table.COIL, 8, 12) == [1, 1]
        log.answers = False
        press = made.lift.press(GO2, allowed)
        await elapse(1.0)
        refreshed = [request for request in made.writes()[2:] if request == "write coil 12 := on, unit 1"]
        assert len(refreshed) == 2
        asked = now()
        made.lift.let_go(HOLD_FRONT)
        await elapse(1.0)
        assert released_at(made, "write coil 8 := off, unit 1") == asked
        assert not press.done()
        log.answer()
        await elapse(0.1)
        assert made.cells(Table.HOLDING, 40) == [2]

    on_bench(check, ALL, log)


def test_what_is_on_stays_until_the_row_of_its_successor_is_there() -> None:
    log = LogByHand()
    text = f'{SIGNALS}commands: {{go_to: {{at: "holding:40", as: floor, rest: 0, {HOLD}, until: arrived}}}}\n'

    async def check(made: Bench) -> None:
        first = made.lift.press(GO1, allowed)
        await elapse(0.5)
        assert made.cells(Table.HOLDING, 40) == [1]
        log.answers = False
        second = made.lift.press(GO2, allowed)
        await elapse(0.5)
        assert made.cells(Table.HOLDING, 40) == [1]
        log.answer("the disk is full")
        await elapse(0.5)
        assert made.cells(Table.HOLDING, 40) == [1]
        assert result(first)[0] is Result.CONFIRMED
        assert result(second) == (Result.REJECTED, "the disk is full")
        third = made.lift.press(GO2, allowed)
        log.answer()
        await elapse(0.5)
        assert made.cells(Table.HOLDING, 40) == [2]
        assert result(third)[0] is Result.CONFIRMED

    on_bench(check, text, log)


def test_a_wish_that_is_let_go_replaced_or_excluded_never_enters_however_late_its_row_is() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        let_go = made.lift.press(CLOSE_FRONT, allowed)
        made.lift.let_go(CLOSE_FRONT)
        assert result(let_go) == (Result.UNCONFIRMED, "let go before it was confirmed")
        assert not made.lift.given(CLOSE_FRONT)
        older = made.lift.press(GO1, allowed)
        newer = made.lift.press(GO2, allowed)
        assert result(older) == (Result.UNCONFIRMED, "replaced by a newer command")
        excluded = made.lift.press(CLOSE_FRONT, allowed)
        made.lift.hold(HOLD_FRONT, allowed)
        assert result(excluded)[0] is Result.REJECTED
        assert "something else was wanted instead" in result(excluded)[1]
        while log.waiting:
            log.answer()
        await elapse(0.3)
        assert made.cells(Table.HOLDING, 40) == [2]
        assert made.cells(Table.COIL, 8, 10) == [1, 0]
        assert "write coil 10 := on, unit 1" not in made.writes()
        assert newer.done() or made.lift.given(GO2)

    on_bench(check, ALL, log)


def test_rows_that_come_out_of_order_press_what_was_asked_for_last() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        await elapse(0.2)
        made.lift.hold(HOLD_FRONT, allowed)
        press = made.lift.press(CLOSE_FRONT, allowed)
        log.waiting.reverse()
        log.answer()
        log.answer()
        await elapse(0.5)
        assert made.cells(Table.COIL, 8, 10) == [0, 1]
        assert result(press)[0] is Result.CONFIRMED
        assert "write coil 8 := on, unit 1" not in made.writes()

    on_bench(check, ALL, log)


def test_letting_everything_go_drops_every_wish() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        press = made.lift.press(GO2, allowed)
        made.lift.hold(HOLD_FRONT, allowed)
        await made.lift.release_all()
        assert result(press) == (Result.UNCONFIRMED, "everything was let go")
        assert not made.lift.given(GO2)
        assert not made.lift.given(HOLD_FRONT)
        while log.waiting:
            log.answer()
        await elapse(2.0)
        assert made.writes() == []

    on_bench(check, ALL, log)


def test_what_waited_is_judged_when_its_bytes_leave() -> None:
    log = LogByHand(answers=False)
    refusal: list[str] = []

    async def check(made: Bench) -> None:
        press = made.lift.press(GO2, lambda: refusal[0] if refusal else None)
        await elapse(0.5)
        refusal.append("fire")
        log.answer()
        await elapse(0.5)
        assert result(press) == (Result.REJECTED, "fire")
        assert made.writes() == []

    on_bench(check, ALL, log)


def test_a_hold_from_rest_waits_for_a_row_and_its_renewals_do_not() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        for _ in range(5):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert log.rows == [("hold_door.front", ("01050008ff00",))]
        assert made.lift.given(HOLD_FRONT)
        assert made.writes() == []
        log.answer()
        await elapse(0.2)
        for _ in range(20):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)
        assert len(log.rows) == 1
        made.lift.let_go(HOLD_FRONT)
        made.lift.hold(HOLD_FRONT, allowed)
        assert len(log.rows) == 2, "each time it is asserted anew it is written down"
        await elapse(0.5)
        assert made.cells(Table.COIL, 8) == [0]
        log.answer()
        await elapse(0.5)
        assert made.cells(Table.COIL, 8) == [1]

    on_bench(check, ALL, log)


def test_a_hold_that_cannot_be_written_down_asks_again_later_and_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    log = LogByHand(trouble="the disk is full")

    async def check(made: Bench) -> None:
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert not made.lift.given(HOLD_FRONT)
        assert made.writes() == []
        assert len(log.rows) == 1 + int(5.0 / ROW_REFUSED_PAUSE_S)
        log.trouble = None
        await elapse(ROW_REFUSED_PAUSE_S)
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.1)
        assert made.lift.held(HOLD_FRONT)

    with caplog.at_level(logging.WARNING, logger="lift_manager.core.outputs"):
        on_bench(check, ALL, log)
    assert [record.getMessage() for record in caplog.records] == [
        "lift: hold_door.front is not asserted: the disk is full"
    ]


def test_a_hold_whose_press_could_not_leave_needs_no_second_row() -> None:
    log = LogByHand()
    refusal = ["the lift is in doubt"]

    async def check(made: Bench) -> None:
        for _ in range(20):
            made.lift.hold(HOLD_FRONT, lambda: refusal[0] if refusal else None)
            await elapse(0.1)
        assert made.writes() == []
        refusal.clear()
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(0.3)
        assert made.cells(Table.COIL, 8) == [1]
        assert len(log.rows) == 1
        # but one that was refused by the controller was sent
        made.lift.let_go(HOLD_FRONT)
        await elapse(0.3)
        made.device.fail_next(exception(4), on=lambda request: request.is_write)
        for _ in range(50):
            made.lift.hold(HOLD_FRONT, allowed)
            await elapse(0.1)
        assert made.cells(Table.COIL, 8) == [1]
        assert len(log.rows) == 3

    on_bench(check, ALL, log)


def test_a_hold_that_waited_falls_by_the_time_it_was_asked_for_last() -> None:
    log = LogByHand(answers=False)
    text = f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:8", {HOLD.replace("30", "2")}}}}}\n'

    async def check(made: Bench) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.5)
        log.answer()
        await elapse(0.2)
        assert made.cells(Table.COIL, 8) == [1]
        await elapse(0.5)
        assert made.cells(Table.COIL, 8) == [0]

    on_bench(check, text, log)


def test_a_hold_that_waits_is_renewed_and_judged_as_it_was_asked_for_last() -> None:
    text = f'{SIGNALS}commands: {{hold_door.front: {{at: "coil:8", {HOLD.replace("30", "2")}}}}}\n'
    for last, pressed in (("fire", 0), (None, 1)):
        log = LogByHand(answers=False)

        async def check(made: Bench, log: LogByHand = log, last: str | None = last, pressed: int = pressed) -> None:
            made.lift.hold(HOLD_FRONT, lambda: "overtaken" if last is None else None)
            await elapse(1.0)
            made.lift.hold(HOLD_FRONT, lambda: last)
            await elapse(0.5)
            log.answer()
            await elapse(1.3)
            assert made.cells(Table.COIL, 8) == [pressed], "2 s after it was asked for last it is still on"
            await elapse(0.4)
            assert made.cells(Table.COIL, 8) == [0]

        on_bench(check, text, log)


def test_what_is_planned_leaves_out_what_will_be_let_go_for_it() -> None:
    log = LogByHand()
    text = (
        f'{SIGNALS}commands:\n  hold_door.front: {{at: "coil:8", {HOLD}, excludes: [close_door.front], gap_s: 0.1}}\n'
        '  close_door.front: {at: "coil:9", action: hold, max_hold_s: 10, until: closed, on_link_loss: latches,'
        " confirm: {any_of: [readback], within_s: 2}}\n"
        f'  robot_mode: {{at: "coil:10", {HOLD}}}\nwrite_blocks: [{{at: "coil:8", count: 3, function: 15}}]\n'
    )

    async def check(made: Bench) -> None:
        made.device.values[Table.DISCRETE][1] = 1
        await elapse(0.2)
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.hold(MODE, allowed)
        await elapse(0.3)
        _ = made.lift.press(CLOSE_FRONT, allowed)
        await elapse(1.0)
        pressed = [each.frames for each in log.told if (each.what, each.name) == ("press", "close_door.front")]
        assert [log.rows[-1][1]] == pressed == [("010f000800030106",)]

    on_bench(check, text, log)


def test_what_waits_for_its_row_is_not_put_on_once_it_is_only_kept() -> None:
    log = LogByHand(answers=False)

    async def check(made: Bench) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        made.lift.keep(HOLD_FRONT)
        assert made.lift.at_rest(HOLD_FRONT)
        log.answer()
        for _ in range(30):
            made.lift.hold(HOLD_FRONT, allowed, begin=False)
            await elapse(0.1)
        assert made.writes() == []

    on_bench(check, ALL, log)


def test_a_hold_that_is_found_off_is_put_on_again_once_that_is_written_down() -> None:
    log = LogByHand()

    async def check(made: Bench) -> None:
        made.lift.hold(HOLD_FRONT, allowed)
        await elapse(1.2)
        log.answers = False
        made.device.values[Table.COIL][8] = 0
        await elapse(1.5)
        assert [row for row, _ in log.rows] == ["hold_door.front", "hold_door.front again"]
        assert made.cells(Table.COIL, 8) == [0]
        assert made.lift.given(HOLD_FRONT)
        assert not made.lift.held(HOLD_FRONT)
        log.answer()
        await elapse(2.0)
        assert made.cells(Table.COIL, 8) == [1]
        assert made.lift.held(HOLD_FRONT)
        assert len(log.rows) == 2

    on_bench(check, ALL, log)


def test_a_bug_drops_what_waits() -> None:
    log = LogByHand(answers=False)

    def bug() -> str | None:
        raise ZeroDivisionError("a bug of the caller's")

    async def check(made: Bench) -> None:
        press = made.lift.press(GO2, allowed)
        made.lift.hold(HOLD_FRONT, bug)
        log.waiting.pop().set_result(None)
        await elapse(0.5)
        assert result(press)[0] is Result.UNCONFIRMED
        assert result(press)[1] == "everything was let go because of a bug"
        log.answer()
        await elapse(1.0)
        assert not made.lift.given(GO2)
        assert made.writes() == ["write coil 8 := off, unit 1"]

    on_bench(check, ALL, log)
