"""The procedures of a checkout on a lift that is wired as its map says, with a person who tells the truth."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from lift_manager.commissioning.checkout.person import Prompt, Reply
from lift_manager.commissioning.checkout.record import Outcome, verdict
from tests.support.checkout_rig import LIFT, Rig, TruthfulPerson, check_out, site_of
from tests.support.virtual_time import run_virtual

REGISTERS = {"L1": 1, "L2": 2, "L3": 3}


def test_a_lift_that_is_wired_as_its_map_says_passes_every_item(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        record = await check_out(Rig(loaded))
        assert {result.note for result in record.results if result.outcome is Outcome.FAILED} == set()
        assert verdict(record).text == "passed"
        assert len(record.trips) == 3
        assert {"total_s", "called_s", "travel_s", "door_opens_s", "door_closes_s"} <= record.trips[0].figures.keys()
        assert 3.0 < record.newest["A-04"].figures["let_go_s"] < 15.0

    run_virtual(main, limit_s=30000.0)


@pytest.mark.parametrize("item", ["S-02", "S-03", "S-06", "S-07", "S-13", "C-06", "C-12", "A-03"])
def test_values_in_registers_are_checked_as_well(tmp_path: Path, item: str) -> None:
    loaded = site_of(tmp_path, "generic-registers", REGISTERS)

    async def main() -> None:
        record = await check_out(Rig(loaded), [item])
        assert [(one.item, one.outcome, one.note) for one in record.results] == [(item, Outcome.PASSED, "")]

    run_virtual(main, limit_s=30000.0)


def test_a_fingerprint_has_the_served_ranges_the_constant_words_and_the_latency(tmp_path: Path) -> None:
    loaded = site_of(tmp_path, "generic-registers", REGISTERS, override={"signals": {"destination": None}})

    async def main() -> None:
        rig = Rig(loaded, wired=site_of(tmp_path, "generic-registers", REGISTERS).codecs[LIFT])
        async with rig.registers() as registers:
            first = await registers.fingerprint()
        async with rig.registers() as registers:
            second = await registers.fingerprint()
        assert [(one.table, one.first, one.last) for one in first.served] == [("holding", 0, 7), ("holding", 16, 19)]
        assert [(one.address, one.value) for one in first.constants] == [(6, 0)]
        assert first.latency is not None
        assert first.latency.p50_ms == pytest.approx(4.0, abs=4.0)
        assert first.sha256 == second.sha256

    run_virtual(main, limit_s=30000.0)


def test_a_robot_is_driven_in_and_out_by_a_person(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig, {(Prompt.RIDER, ""): Reply("robot")})
        record = await check_out(rig, ["T-01"], person=person)
        assert [result.outcome for result in record.results] == [Outcome.PASSED]
        driven = [question.value for question in person.questions if question.topic is Prompt.DRIVE]
        assert driven == ["in", "out"] * 3

    run_virtual(main, limit_s=30000.0)


def test_a_heartbeat_is_seen_on_the_wire(tmp_path: Path) -> None:
    beat = {"at": "holding:20", "action": "count", "every_s": 1.0}
    changes = {"served": {"holding": [[0, 7], [16, 20]]}, "commands": {"heartbeat": beat}}
    loaded = site_of(tmp_path, "generic-registers", REGISTERS, override=changes)

    async def main() -> None:
        record = await check_out(Rig(loaded), ["C-09"])
        assert [(one.item, one.outcome, one.note) for one in record.results] == [("C-09", Outcome.PASSED, "")]

    run_virtual(main, limit_s=30000.0)


@pytest.mark.parametrize(
    ("item", "shown"),
    [
        ("A-01", ["watching all inputs and outputs while nothing is written: 60 s", "40 s left", "20 s left"]),
        ("A-03", ["waiting until the manager notices: at most 15 s", "waiting until the controller answers again"]),
        ("A-06", ["watching whether the car stays: 20 s"]),
        ("C-10", ["the door is held: 15 s"]),
    ],
)
def test_a_person_is_shown_what_is_waited_for_and_how_long(tmp_path: Path, item: str, shown: list[str]) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        rig = Rig(loaded)
        person = TruthfulPerson(rig)
        await check_out(rig, [item], person=person)
        lines = iter(person.told)
        assert all(any(line.startswith(text) for line in lines) for text in shown), person.told

    run_virtual(main, limit_s=30000.0)


def test_the_evidence_of_a_signal_has_what_was_done_and_shown_and_no_rules(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        record = await check_out(Rig(loaded), ["S-27"])
        assert list(record.newest["S-27"].evidence) == [
            "Make it so: a person has the car by key (independent service). - done",
            "independent shows yes (raw 0)",
            "Make it no longer so: a person has the car by key (independent service). - done",
            "independent shows no (raw 1)",
            "Disconnect the wire of independent (discrete:27). - done",
            "disconnected: yes (raw 0)",
            "Connect independent (discrete:27) again. - done",
        ]

    run_virtual(main, limit_s=30000.0)


class OneSlot(Rig):
    """A controller that counts the connection of a killed manager as open for some seconds."""

    async def kill(self) -> None:
        await super().kill()
        self.controller.keeps_slot = True
        asyncio.get_running_loop().call_later(4.0, setattr, self.controller, "keeps_slot", False)


def test_a_slot_that_stays_taken_after_the_kill_is_waited_for(tmp_path: Path) -> None:
    loaded = site_of(tmp_path)

    async def main() -> None:
        record = await check_out(OneSlot(loaded), ["A-04"])
        (result,) = record.results
        assert (result.outcome, result.note) == (Outcome.PASSED, "")
        assert 4.0 < result.figures["let_go_s"] < 20.0

    run_virtual(main, limit_s=30000.0)
