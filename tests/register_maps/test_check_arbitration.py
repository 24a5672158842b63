"""What `check` refuses where a controller decides which of two managers it obeys."""

from pathlib import Path

from tests.support.good_map import Mistake, changed, findings_of, loaded
from tests.support.rows import each_row

ARBITRATED = """\
schema: 1
name: arbitrated
title: A map without mistakes whose controller obeys one of two managers
provenance: {trust: template, sources: [this test]}
addressing: {base: 1}
served:
  holding: [[1, 20], [30, 40]]
signals:
  car_floor: {at: "holding:1", as: floor, unknown: [0]}
  door.front: {at: "holding:3", values: {1: closed, 2: open}, unknown: [0]}
  fire: {at: "holding:4.0", active: low}
  epoch: {at: "holding:5", type: uint32, word_order: low_first}
  owner: {at: "holding:7"}
commands:
  go_to: {at: "holding:33", as: floor, action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 9}}
  hold_door.front:
    {at: "holding:34", action: hold, max_hold_s: 30, refresh_s: 2, on_link_loss: device_watchdog, confirm: {any_of: [readback], within_s: 2}}
watchdog_s: 8
arbitration: {owner: "holding:30", epoch: "holding:31"}
write_blocks:
  - {at: "holding:30", count: 5, function: 16}
at_floor_evidence: {kind: position_stable, for_s: 1.0}
"""
OURS = 'arbitration: {owner: "holding:30", epoch: "holding:31"}\n'
BLOCK = '{at: "holding:30", count: 5, function: 16}'
EPOCH = '  epoch: {at: "holding:5", type: uint32, word_order: low_first}\n'

MISTAKES: list[Mistake] = [
    ("an owner that cannot be written", OURS, OURS.replace("holding:30", "input:3"), "arbitration.owner", "input:3 cannot carry it; give a coil or a whole holding register"),
    ("an epoch in a bit", OURS, OURS.replace("holding:31", "holding:31.0"), "arbitration.epoch", "holding:31.0 cannot carry it"),
    ("an epoch that is no address", OURS, OURS.replace("holding:31", "somewhere:31"), "arbitration.epoch", "somewhere"),
    ("no signal that shows the epoch", EPOCH, "", "arbitration", "the map has no signal epoch, which shows whom the controller obeys"),
    ("a signal that shows half of the epoch", EPOCH, '  epoch: {at: "holding:5"}\n', "signals.epoch", "has 32 bits; give `type: uint32`"),
    ("an epoch over a command", OURS, OURS.replace("holding:31", "holding:32"), "arbitration", "overlaps the command go_to"),
    ("an epoch over the owner", OURS, OURS.replace("holding:30", "holding:32"), "arbitration", "epoch and owner overlap"),
    ("a signal at what is written", '{at: "holding:7"}', '{at: "holding:30"}', "signals.owner", "give the place where the controller shows whom it obeys"),
    ("a write without the owner", BLOCK, BLOCK.replace("30", "31").replace("5", "4"), "arbitration", "needs one entry in `write_blocks`, with epoch, owner and every command"),
    ("a block that nobody serves", "[30, 40]", "[32, 40]", "write_blocks[0]", "holding 30, 31 in it is not served"),
    ("a watchdog between two refreshes", "watchdog_s: 8", "watchdog_s: 2", "watchdog_s", "hold_door.front is written every 2 s, and would fall in between"),
    ("a watchdog of nothing", "device_watchdog", "latches", "watchdog_s", "no command has `on_link_loss: device_watchdog`"),
    ("an epoch that is shown and never written", OURS, "", "signals.epoch", "shows whom the controller obeys, which needs `arbitration`"),
]  # fmt: skip
UNWRITTEN = "write_blocks[0]"
FOLLOWS = {
    "an epoch that is shown and never written": ["signals.owner", UNWRITTEN],
    "an epoch over a command": [UNWRITTEN],
    "an epoch over the owner": [UNWRITTEN],
    "an owner that cannot be written": [UNWRITTEN],
}
"""What else is refused because of the same mistake: the block then writes what belongs to nothing."""


def test_the_map_in_which_the_mistakes_are_made_has_none(tmp_path: Path) -> None:
    assert loaded(tmp_path, ARBITRATED).warnings == ()


@each_row(("name", "old", "new", "key", "words"), MISTAKES)
def test_a_write_that_does_not_say_whose_it_is_is_refused(
    tmp_path: Path, name: str, old: str, new: str, key: str, words: str
) -> None:
    found = findings_of(tmp_path, changed(ARBITRATED, old, new)[0])
    assert [finding.key for finding in found] == [key, *FOLLOWS.get(name, [])], "\n".join(map(str, found))
    assert words in found[0].message
    assert found[0].line is not None
