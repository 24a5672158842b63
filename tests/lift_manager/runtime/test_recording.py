"""What one lift has in the journal, and in which order."""

from dataclasses import replace

from drivers.model import Command, CommandKind, Written
from lift_manager.lift.inputs import LiftRequest
from lift_manager.lift.journal import RowKind
from lift_manager.lift.session import Holder
from lift_manager.runtime.journal import LiftJournal
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Mode
from tests.lift_manager.runtime.scripted import OTHER as NEXT
from tests.lift_manager.runtime.scripted import PLAIN, Bench, SlowRecorder, on_bench
from tests.support.virtual_time import elapse

WORKSHOP, OTHER = Holder("workshop", "workshop"), Holder("rmf", "fleet/r1")


def test_what_a_holder_repeated_is_told_before_something_is_pressed_for_it_and_what_others_did_is_not() -> None:
    recorder = MemoryRecorder()
    journal = LiftJournal("east", "plc", recorder)
    for holder, floor in ((WORKSHOP, "L2"), (WORKSHOP, "L2"), (OTHER, "L3"), (OTHER, "L3")):
        journal.request(LiftRequest(holder, floor, hold_door=True), None, 0.0, known=True)
    press = journal.press(WORKSHOP, Command(CommandKind.GO_TO, "L2"), ("0106",), 0.0)
    assert [row.caller for row in recorder.rows] == ["workshop", "rmf:fleet/r1", "workshop"]
    assert "again, once within" in recorder.rows[-1].text
    assert (press.kind, press.caller, press.text) == (RowKind.PRESS, "workshop", "go_to L2 is to be pressed")
    assert press.data["frames"] == ["0106"]


def test_writes_mode_and_link_have_rows_and_only_changes_do() -> None:
    recorder = MemoryRecorder()
    journal = LiftJournal("east", "plc (192.0.2.10:502)", recorder)
    journal.wrote(None, Written("go_to", "press", ("0106001000020000",)))
    journal.wrote(None, Written("go_to", "release", (), "no answer within 0.5 s"))
    for mode in (Mode.NORMAL, Mode.NORMAL, Mode.FIRE):
        journal.mode(mode, 0.0)
    for fault in ("waits for its alive counter", "", "", "no answer", "another reason", ""):
        journal.link(fault, 0.0)
    assert [row.text for row in recorder.rows] == [
        "press of go_to was answered",
        "release of go_to failed: no answer within 0.5 s",
        "the mode is normal",
        "the mode was normal and is fire",
        "reading plc (192.0.2.10:502)",
        "no answer",
        "reading plc (192.0.2.10:502)",
    ]
    assert recorder.rows[0].data["frames"] == ["0106001000020000"]


def test_an_event_has_its_row_before_anybody_hears_of_it() -> None:
    async def check(made: Bench) -> None:
        rows: list[str] = []
        with made.bus.tap(lambda event_id, _: rows.append(made.rows[-1].event if made.rows else event_id)):
            made.accept("L3")
        assert rows[0] == f"{made.bus.boot}-{made.bus.newest - len(rows) + 1}"

    on_bench(check, PLAIN)


def test_rows_are_in_the_order_of_cause_and_effect() -> None:
    disk = SlowRecorder()

    async def check(made: Bench) -> None:
        made.accept("L3")
        await disk.commit()
        made.refuse("L1", holder=NEXT)
        made.driver.values = replace(made.driver.values, mode=Mode.FIRE)
        await elapse(0.5)
        made.driver.silent = True
        await elapse(5)

    on_bench(check, PLAIN, recorder=disk)
    assert [row.text.partition(": ")[0] for row in disk.rows] == [
        "reading by hand",
        "the mode is normal",
        "requests L3, hold the door there",
        "api:fleet/robot1 holds the lift, to L3",
        "go_to L3 is to be pressed",
        "press of go_to was answered",
        "go_to L3 confirmed",
        "requests L1, hold the door there",
        "refused",
        "the mode was normal and is fire",
        "api:fleet/robot1 is advised clear_doorway",
        "fire",
        "the session of api:fleet/robot1 is over",
        "no answer",
    ]
