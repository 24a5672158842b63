"""What `check` refuses in blocks that are written as a whole, and in registers of which a command writes one bit."""

from pathlib import Path

import pytest

from tests.support.good_map import GOOD, HANDSHAKE, Mistake, changed, expect_only, findings_of, loaded
from tests.support.rows import each_row

BLOCK = '{at: "holding:20", count: 4, function: 16, every_s: 0.5, gaps: 0}'
TIMED = "    timed_by: device\n    payload: {time: width_s, unit_s: 0.1}\n"
FRONT = '    at: "holding:30.0"\n    read_at: "input:10.0"\n'
REAR_WORD = "    gap_s: 0.5\n    shared_word: mask_write\n"
FRONT_WORD = "    on_link_loss: latches\n    shared_word: mask_write\n"
LATCHING = "    max_hold_s: 300\n    on_link_loss: device_watchdog\n"
OCCUPANCY = HANDSHAKE[HANDSHAKE.index("  robot_in_place:") : HANDSHAKE.index("  heartbeat:")]
BITS = """\
  robot_in_place:
    {at: "holding:24.0", shared_word: WORD, action: pulse, width_s: 5, confirm: {any_of: [readback], within_s: 3}}
  robot_left:
    {at: "holding:24.1", shared_word: WORD, action: pulse, width_s: 5, timed_by: device, confirm: {any_of: [may_enter], within_s: 3}}
"""

BLOCKS: list[Mistake] = [
    ("strangers without their value", BLOCK, BLOCK.replace(", gaps: 0", ""), "write_blocks[0]", "holding 22, 23 in it belong to no command, and are never written; shorten or split the block, or use `gaps: 0`"),
    ("a signal that would be overwritten", '"holding:10", means_yes', '"holding:22", means_yes', "write_blocks[0]", "holding 22 in it is read as overload, and 0 would be written over it"),
    ("a gap nobody serves", "[[0, 40]", "[[0, 22], [24, 40]", "write_blocks[0]", "holding 23 in it is not served"),
    ("a block over the edge of a range", "[[0, 40]", "[[0, 21], [22, 40]", "write_blocks[0]", "crosses the edge of a served range"),
    ("a block longer than the device takes", "link: {", "link: {max_registers_per_write: 3, ", "write_blocks[0].count", "4 are too many for one write; the limit is 3, from `link: max_registers_per_write`"),
    ("a block longer than the specification allows", BLOCK, BLOCK.replace("count: 4", "count: 124").replace("holding:20", "holding:100"), "write_blocks[0].count", "the limit is 123, from the specification for a holding"),
    ("a block beyond the wire", BLOCK, BLOCK.replace("holding:20", "holding:65534"), "write_blocks[0].count", "would end at 65537 on the wire"),
    ("a connection that is closed between two polls", "link: {", "link: {idle_timeout_s: 2, min_poll_s: 1.5, ", "link.idle_timeout_s", "2 s without a request cannot be avoided"),
    ("a cycle faster than the link", BLOCK, BLOCK.replace("0.5", "0.01"), "write_blocks[0]", "every_s of 0.01 s cannot be kept: the link leaves 0.05 s between requests"),
    ("a block at a device nobody declares", BLOCK, BLOCK.replace("holding:20", "sensr/holding:0"), "write_blocks[0].at", "the map has no endpoint sensr; did you mean `sensor`?"),
    ("a bit in a block", FRONT, '    at: "holding:22.0"\n    read_at: "input:10.0"\n', "commands.hold_door.front.shared_word", "take the register out of the block"),
    ("a timed coil in a block", BLOCK, '{at: "coil:20", count: 1, function: 15}', "write_blocks[0]", "close_door.front writes a time to a coil, which only function 5 can"),
]  # fmt: skip

WORDS: list[Mistake] = [
    ("a bit of a register of nobody", FRONT_WORD, "    on_link_loss: latches\n", "commands.hold_door.front", "holding:30.0 is a bit in a register; use `shared_word: owned` if nobody else writes"),
    ("a word that is shared in two ways", REAR_WORD, REAR_WORD.replace("mask_write", "accepted"), "commands.close_door.rear.shared_word", "hold_door.front lies in the same register and has `mask_write`; use the same"),
    ("a coil that is shared", "    timed_by: device\n", "    timed_by: device\n    shared_word: owned\n", "commands.close_door.front.shared_word", "belongs to a command in a bit of a register"),
    ("a register that is shared", LATCHING, LATCHING + "    shared_word: accepted\n", "commands.go.shared_word", "belongs to a command in a bit of a register"),
    ("a pulse of the device in a word of our own with another command", OCCUPANCY, BITS.replace("WORD", "owned"), "commands.robot_left.shared_word", "robot_left is a pulse that the device ends, and each write of robot_in_place would restart it; use `mask_write` in each of them"),
]  # fmt: skip


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in BLOCKS + WORDS],
)
def test_a_block_or_a_bit_that_cannot_be_written_is_refused(
    tmp_path: Path, old: str, new: str, key: str, words: str
) -> None:
    expect_only(tmp_path, changed(HANDSHAKE, old, new)[0], key, words)


def owned(signals: str = "") -> str:
    """The handshake map with both commands of register 30 read back there, and nobody else writing in it."""
    text = HANDSHAKE.replace("shared_word: mask_write", "shared_word: owned").replace('    read_at: "input:10.0"\n', "")
    return changed(text, "signals:\n", f"signals:\n{signals}")[0]


def test_a_word_of_our_own_has_no_signal_in_it(tmp_path: Path) -> None:
    text = owned('  fault: {at: "holding:30.9"}\n')
    found = findings_of(tmp_path, text)
    assert {finding.key for finding in found} == {"commands.hold_door.front.shared_word"}
    assert "fault is read from the same register, so it is not ours alone" in found[0].message
    assert loaded(tmp_path, text.replace("owned", "accepted")).warnings == ()
    assert loaded(tmp_path, owned()).warnings == ()


def test_what_is_read_where_a_word_is_only_written_may_be_a_signal(tmp_path: Path) -> None:
    text = owned('  fault: {at: "holding:30.9"}\n')
    text, _ = changed(text, '"holding:30.0"\n', '"holding:30.0"\n    read_at: "input:10.0"\n')
    assert loaded(tmp_path, text).warnings == ()


def test_a_pulse_of_the_device_is_not_in_a_block_that_is_written_again_and_again(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, TIMED, "    timed_by: device\n")
    block = '{at: "coil:20", count: 1, function: 15}'
    assert loaded(tmp_path, changed(text, BLOCK, block)[0]).warnings == ()
    expect_only(
        tmp_path,
        changed(text, BLOCK, block.replace("}", ", every_s: 1}"))[0],
        "write_blocks[0]",
        "close_door.front is a pulse that the device ends, and each cycle would restart it",
    )


def test_a_pulse_of_the_device_is_in_no_block_with_another_command(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, TIMED, "    timed_by: device\n")
    text, _ = changed(text, BLOCK, '{at: "coil:20", count: 2, function: 15, gaps: 0}')
    assert loaded(tmp_path, text).warnings == ()
    expect_only(
        tmp_path,
        changed(text, '"coil:9"', '"coil:21"')[0],
        "write_blocks[0]",
        "close_door.front is a pulse that the device ends, and each write of robot_left would restart it",
    )


def test_a_pulse_of_the_device_is_alone_in_its_word_or_written_by_its_mask(tmp_path: Path) -> None:
    assert loaded(tmp_path, changed(HANDSHAKE, OCCUPANCY, BITS.replace("WORD", "mask_write"))[0]).warnings == ()
    apart = BITS.replace("24.0", "25.0").replace("WORD", "owned")
    assert loaded(tmp_path, changed(HANDSHAKE, OCCUPANCY, apart)[0]).warnings == ()


def test_a_block_may_lie_at_a_second_device(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, BLOCK, '{at: "sensor/holding:0", count: 2, function: 16, gaps: 0}')
    assert loaded(tmp_path, text).warnings == ()
    expect_only(
        tmp_path,
        text.replace(", gaps: 0", ""),
        "write_blocks[0]",
        "sensor/holding 1 in it belong to no command",
    )


def test_a_device_that_lets_go_by_itself_must_hear_from_us(tmp_path: Path) -> None:
    silent, _ = changed(HANDSHAKE, '  heartbeat: {at: "holding:21", action: count, every_s: 0.5}\n', "")
    assert loaded(tmp_path, silent).warnings == ()  # the block is written again and again
    once = silent.replace(", every_s: 0.5, gaps: 0}", ", gaps: 0}")
    expect_only(tmp_path, once, "commands.go.on_link_loss", "declare a heartbeat at this device")
    assert loaded(tmp_path, once.replace(LATCHING, LATCHING + "    refresh_s: 2\n")).warnings == ()


def test_strangers_of_a_block_are_listed_as_the_map_prints_them(tmp_path: Path) -> None:
    text, _ = changed(GOOD, "count: 3", "count: 10")
    expect_only(tmp_path, text, "write_blocks[0]", "coil 4, 5, 6, 7, 8, ... in it belong to no command")
