"""Files that are no site file, files at the limits, and what `check` says about a file."""

from pathlib import Path

import pytest

from lift_manager.config.load import check_file, load_site
from register_maps.errors import MapFileError
from register_maps.load import MAPS
from register_maps.source import MAX_BYTES
from tests.lift_manager.config.site_files import GENERIC, Said, assert_says_exactly, load, my_map, said
from tests.support.rows import each_row


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        pytest.param(b"", said(None, "", "empty"), id="nothing"),
        pytest.param(b"# soon\n", said(None, "", "empty"), id="a comment only"),
        pytest.param(b"- one\n- two\n", said(1, "", "must be a table of keys", "list"), id="a list"),
        pytest.param(b"signals: {}\n", said(None, "", "this is a register map and not a site file"), id="a map"),
        pytest.param(b"hello\n", said(1, "", "must be a table of keys"), id="text"),
        pytest.param(b"\x7fELF\x02\x01\xff\xfe", said(1, "", "not UTF-8"), id="a program"),
        pytest.param(b"name: a\x00b\n", said(1, "", "U+0000 is not allowed"), id="a zero byte"),
        pytest.param(b"a: " + b"[" * 500 + b"]" * 500, said(1, "", "nested more than"), id="a tower of brackets"),
    ],
)
def test_a_file_that_is_no_site_file_is_refused_in_one_finding(tmp_path: Path, content: bytes, expected: Said) -> None:
    path = tmp_path / "site.yaml"
    path.write_bytes(content)
    with pytest.raises(MapFileError) as caught:
        load_site(path)
    assert_says_exactly(caught.value.findings, expected)


def test_a_file_over_the_limit_is_refused_without_being_read(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    with path.open("wb") as file:
        file.write(b"\xff not UTF-8, which reading would find")
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(MapFileError) as caught:
        load_site(path)
    assert_says_exactly(caught.value.findings, said(None, "", f"{MAX_BYTES + 1} bytes", "not read", str(MAX_BYTES)))


def test_a_file_just_under_the_limit_is_read(tmp_path: Path) -> None:
    padding = "#" * (MAX_BYTES - len(GENERIC) - 1) + "\n"
    assert load(tmp_path, GENERIC + padding).site.name == "A building"


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    for path, words in [(tmp_path / "none.yaml", "no such file"), (tmp_path, "is a directory")]:
        with pytest.raises(MapFileError) as caught:
            load_site(path)
        assert caught.value.findings[0].file == str(path)
        assert_says_exactly(caught.value.findings, said(None, "", words))


def test_check_says_what_each_lift_is_after_its_cautions(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(GENERIC, "utf-8")
    assert check_file(path) == [
        "caution: main: map generic-registers is a template and was not taken from a real lift; compare every signal with the real lift",
        "main: control, floors B1, L1, L2, map generic-registers (template)",
        f"{path}: no mistakes",
    ]


def test_check_lists_what_is_assumed_of_the_lifts_of_a_site_where_that_is_wanted(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(GENERIC.replace("    access: control\n", "    access: control\n    unit_id: 7\n"), "utf-8")
    heading = (
        "assumed, because neither the site nor the map of main says otherwise; compare it with the vendor's table:"
    )
    lines = check_file(path, verbose=True)
    assert "  requests may follow one another without a pause (`min_gap_s`)" in lines[lines.index(heading) :]
    assert not any("answers as unit" in line for line in lines)
    assert heading not in check_file(path)


@each_row("path", sorted(MAPS.glob("*.yaml")))
def test_check_knows_a_map_from_a_site_file(path: Path) -> None:
    assert check_file(path)[-1].startswith(f"{path}: map {path.stem} (")


def test_check_takes_a_map_whose_signals_are_misspelt_for_a_map(tmp_path: Path) -> None:
    path = my_map(tmp_path, ("\nsignals:", "\nsignal:"))
    with pytest.raises(MapFileError) as caught:
        check_file(path)
    assert any("did you mean `signals`" in finding.message for finding in caught.value.findings)
    assert not any(finding.key == "lifts" for finding in caught.value.findings)
