"""A draft map in the place of a lift's map: what of it may be written at all."""

from pathlib import Path

import pytest

from lift_manager.commissioning.poke.trial import NotPossible
from lift_manager.commissioning.poke.unlock import with_draft
from tests.lift_manager.config.site_files import GENERIC, SECOND_LIFT, load, my_map
from tests.support.rows import each_row

EVERYTHING = ("map: generic-registers", "map: generic-registers, writable_ranges: [coil 0 to 99, holding 0 to 199]")
OFFSET = SECOND_LIFT.replace("controller: plc", "controller: plc\n    offset: {holding: 100}").replace(
    "control\n", "monitor\n"
)


def draft(folder: Path, *edits: tuple[str, str]) -> str:
    return str(my_map(folder, ("name: generic-registers", "name: draft"), *edits))


def test_a_draft_takes_the_place_of_the_map_of_one_lift(tmp_path: Path) -> None:
    loaded = load(tmp_path, GENERIC, EVERYTHING)
    unlocked = with_draft(loaded, "main", draft(tmp_path))
    assert unlocked.codecs["main"].map.name == "draft"
    assert loaded.codecs["main"].map.name == "generic-registers"


@each_row(
    ("edits", "ranges", "why"),
    [
        ((), "[]", "go_to writes holding 16 on the wire, which is in none of `writable_ranges` of the controller plc"),
        ((), "[holding 16, coil 0 to 99]", "hold_door.front writes holding 17 on the wire"),
        (
            (("[16, 19]", "[16, 119]"), ('at: "holding:17"', 'at: "holding:117"')),
            "[holding 0 to 199]",
            "writes the same registers as",
        ),
    ],
)
def test_what_the_site_does_not_leave_open_is_not_unlocked(
    tmp_path: Path, edits: tuple[tuple[str, str], ...], ranges: str, why: str
) -> None:
    text = GENERIC + OFFSET
    given = ("map: generic-registers", f"map: generic-registers, writable_ranges: {ranges}")
    with pytest.raises(NotPossible, match=why):
        with_draft(load(tmp_path, text, given), "main", draft(tmp_path, *edits))


def test_a_lift_that_the_site_does_not_have_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotPossible, match="no lift 'west'; the lifts are main"):
        with_draft(load(tmp_path, GENERIC), "west", draft(tmp_path))
