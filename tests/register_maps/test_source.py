"""Strict YAML: what is refused, in which line, under which key, and in which words."""

import os
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from register_maps.errors import MapFileError
from register_maps.load import MAPS
from register_maps.source import MAX_BYTES, Finding, Source, read, try_validate, validate
from tests.support.examples import examples
from tests.support.rows import each_row


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Room(Part):
    code: Annotated[int, Field(ge=0, le=9)]
    size_m: float = 1.0
    kind: Literal["hall", "shaft"] = "hall"
    locked: bool = False
    span: tuple[int, int] = (0, 1)


class House(Part):
    name: Annotated[str, StringConstraints(min_length=1, max_length=10)]
    rooms: dict[str, Room] = Field(default_factory=dict)
    tags: tuple[str, ...] = Field(default=("x",), min_length=1)
    near: Room | str | None = None
    codes: dict[int, str] = Field(default_factory=dict)


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "house.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def findings_of(path: Path) -> tuple[Finding, ...]:
    with pytest.raises(MapFileError) as caught:
        validate(read(path), House)
    return caught.value.findings


REFUSED: list[tuple[str, str | bytes, int | None, str, str]] = [
    ("a tab that indents", "name: a\nrooms:\n\thall: {code: 1}\n", 3, "", "tab; use spaces"),
    ("a tab after a key", "name:\t@\n", 1, "", "tab; use spaces"),
    ("a byte that is not UTF-8", b"name: a\ntags: [\xe9]\n", 2, "", "0xE9 is not UTF-8"),
    ("a control character", "name: a\ntags: ['\x01']\n", 2, "", "U+0001 is not allowed"),
    ("nothing at all", "# only a comment\n", None, "", "empty"),
    ("a list instead of keys", "- name\n", 1, "", "must be a table of keys, not a list; for example {name: ...}"),
    ("text instead of keys", "name: a\nrooms: {hall: 5}\n", 2, "rooms.hall", "must be a table of keys, not 5; for example {code: 1}"),
    ("a number instead of a table", "name: a\nrooms: 5\n", 2, "rooms", "must be a table of keys, not 5; for example {name: {code: 1}}"),
    ("a colon too many", "name: a: b\n", 1, "", "must be quoted"),
    ("wrong indentation", "name: a\nrooms:\n  hall: {code: 1}\n shaft: {code: 2}\n", 4, "", "indentation"),
    ("an open bracket", "tags: [a\nname: b\n", 2, "", "closing bracket is missing (what it belongs to starts in line 1)"),
    ("an open quotation mark", 'tags: []\nname: "b\n', 3, "", "quotation mark is not closed"),
    ("a character YAML keeps for itself", "name: @home\n", 1, "", "must be quoted"),
    ("an anchor", "name: &n a\n", 1, "name", "anchor `&n`"),
    ("an alias", "name: &n a\ntags: *n\n", 2, "tags", "alias `*n`: anchors and aliases are not allowed"),
    ("an alias as a key", "name: &n a\n*n : b\n", 2, "", "alias `*n`"),
    ("a tag", "name: !!str 5\n", 1, "name", "tag `!!str`"),
    ("a tag of somebody's own", "name: !secret x\n", 1, "name", "tag `!secret`"),
    ("two documents", "name: a\n---\nname: b\n", 2, "", "second document"),
    ("a key given twice", "name: a\ntags: [b]\nname: c\n", 3, "name", "given twice, in line 1 and here"),
    ("a number as a key", "name: a\nrooms:\n  1: {code: 1}\n", 3, "rooms.1", 'YAML reads 1 as a number; quote it: "1"'),
    ("a boolean as a key", "name: a\nrooms: {no: {code: 1}}\n", 2, "rooms.no", 'as a boolean; quote it: "no"'),
    ("null as a key", "name: a\nrooms: {~: {code: 1}}\n", 2, "rooms.~", 'as nothing; quote it: "~"'),
    ("a date as a key", "name: a\nrooms: {2026-01-02: {code: 1}}\n", 2, "rooms.2026-01-02", "as a date; quote it"),
    ("a merge key", "name: a\nrooms:\n  <<: {code: 1}\n", 3, "rooms.<<", "as a merge; quote it"),
    ("a list as a key", "name: a\nrooms:\n  ? [b]\n  : {code: 1}\n", 3, "rooms", "where a key belongs"),
    ("an octal number", "name: a\nrooms: {b: {code: 010}}\n", 2, "rooms.b.code", "YAML reads 010 as 8; write 8"),
    ("a number of base 60", "name: a\nrooms: {b: {code: 1:05}}\n", 2, "rooms.b.code", "YAML reads 1:05 as 65; write 65"),
    ("a number of 5000 digits", f"name: a\nrooms: {{b: {{code: {'9' * 5000}}}}}\n", 2, "rooms.b.code", "not a number that can"),
    ("half a character", 'name: "\\ud800"\n', 1, "name", "half a character"),
    ("an unknown key", "name: a\nrooms:\n  b: {code: 1, knd: hall}\n", 3, "rooms.b.knd", "did you mean `kind`?"),
    ("an unknown key like no other", "name: a\nzzz: 1\n", 2, "zzz", "allowed are codes, name, near, rooms, tags"),
    ("a comma in a bare text", "name: a\nrooms: {b: {code: 1, or so}}\n", 2, "rooms.b.or so", "quote that text"),
    ("a missing key", "rooms: {}\n", 1, "name", "is missing"),
    ("a missing key deep down", "name: a\nrooms:\n  b: {}\n", 3, "rooms.b.code", "is missing"),
    ("a number where text belongs", "name: 5003\n", 1, "name", 'YAML reads 5003 as a number; quote it: "5003"'),
    ("a boolean where text belongs", "name: on\n", 1, "name", 'YAML reads on as a boolean; quote it: "on"'),
    ("nothing where text belongs", "name:\n", 1, "name", "must be text; nothing is given"),
    ("text where a number belongs", 'name: a\nrooms: {b: {code: "1"}}\n', 2, "rooms.b.code", "a whole number, not the text '1'"),
    ("a fraction where a whole number belongs", "name: a\nrooms: {b: {code: 1.5}}\n", 2, "rooms.b.code", "not 1.5"),
    ("yes where a number belongs", "name: a\nrooms: {b: {code: yes}}\n", 2, "rooms.b.code", "a whole number, not yes"),
    ("yes where seconds belong", "name: a\nrooms: {b: {code: 1, size_m: yes}}\n", 2, "rooms.b.size_m", "a number, not yes"),
    ("a number where yes or no belongs", "name: a\nrooms: {b: {code: 1, locked: 1}}\n", 2, "rooms.b.locked", "true or false, not 1"),
    ("a number that is too large", "name: a\nrooms: {b: {code: 10}}\n", 2, "rooms.b.code", "at most 9, not 10"),
    ("a number that is too small", "name: a\nrooms: {b: {code: -1}}\n", 2, "rooms.b.code", "at least 0, not -1"),
    ("a word outside the list", "name: a\nrooms: {b: {code: 1, kind: hal}}\n", 2, "rooms.b.kind", "one of hall, shaft, not 'hal'; did you mean `hall`?"),
    ("a pair of three", "name: a\nrooms: {b: {code: 1, span: [1, 2, 3]}}\n", 2, "rooms.b.span", "at most 2 entries, not 3"),
    ("a pair of one", "name: a\nrooms: {b: {code: 1, span: [1]}}\n", 2, "rooms.b.span", "entry 2 is missing"),
    ("a list that is too short", "name: a\ntags: []\n", 2, "tags", "at least 1 entry, not 0"),
    ("text that is too long", "name: abcdefghijk\n", 1, "name", "at most 10 characters"),
    ("text that is empty", 'name: ""\n', 1, "name", "must not be empty"),
    ("an entry of a list", "name: a\ntags:\n  - b\n  - 2\n", 4, "tags[1]", 'quote it: "2"'),
    ("a table where text belongs", "name: {a: b}\n", 1, "name", "must be text, not a table of keys"),
    ("a key that should be a number", "name: a\ncodes:\n  a: b\n", 3, "codes.a", "the key must be a whole number"),
    ("a branch of a union", "name: a\nnear:\n  code: x\n", 3, "near.code", "a whole number"),
]  # fmt: skip


@each_row(("text", "line", "key", "words"), [case[1:] for case in REFUSED])
def test_a_mistake_is_named_with_its_line_its_key_and_plain_words(
    tmp_path: Path, text: str | bytes, line: int | None, key: str, words: str
) -> None:
    path = written(tmp_path, text)
    found = findings_of(path)
    assert any(f.line == line and f.key == key and words in f.message for f in found), "\n".join(map(str, found))
    assert not any(re.search(r"pydantic|Input should|https?:", str(finding)) for finding in found)


def test_a_finding_reads_like_the_message_of_a_compiler(tmp_path: Path) -> None:
    assert str(Finding("site.yaml", 12, "lifts.lift.floors", "message")) == "site.yaml:12: lifts.lift.floors: message"
    assert str(Finding("site.yaml", None, "", "is empty")) == "site.yaml: is empty"


def test_every_mistake_of_a_file_is_found_at_once(tmp_path: Path) -> None:
    text = "name: &a 5\nzzz: 1\nrooms:\n  no: {code: 1}\n  b: {code: 99, kind: hal}\n  b: {}\ntags: *a\n"
    lines = [finding.line for finding in findings_of(written(tmp_path, text))]
    assert sorted({line for line in lines if line}) == [1, 2, 4, 5, 6, 7]
    assert lines == sorted(line or 0 for line in lines)


def test_mistakes_before_broken_yaml_are_still_told(tmp_path: Path) -> None:
    found = findings_of(written(tmp_path, "name: &a b\ntags: [c\n"))
    assert [finding.line for finding in found] == [1, 3]


@each_row(
    "content",
    [
        "root:$6$SECRET$hash:19000:0:99999:7:::\nuser:SECRET:1::\n",
        "-----BEGIN PRIVATE KEY-----\nMIISECRET/abc+def==\n-----END PRIVATE KEY-----\n",
        "SECRET: {SECRET: SECRET}\nSECRETS: &SECRET [*SECRET]\n",
        "user: *SECRET\npassword: &SECRET x\nopen: [SECRET\n",
        "- SECRET\n",
        "!!SECRET x\n",
        "SECRET",
    ],
)
def test_nothing_of_a_file_of_another_kind_is_quoted(tmp_path: Path, content: str) -> None:
    found = findings_of(written(tmp_path, content))
    assert found
    assert "SECRET" not in "".join(map(str, found))


def test_an_alias_is_one_finding_and_its_expansion_none(tmp_path: Path) -> None:
    found = findings_of(written(tmp_path, "name: a\nrooms: {b: &x {code: 1}, c: *x}\n"))
    assert [finding.key for finding in found] == ["rooms.b", "rooms.c"]


def test_a_million_laughs_is_refused_without_laughing(tmp_path: Path) -> None:
    lines = ["name: a", "x0: &x0 [ha, ha]", *(f"x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9)}]" for n in range(1, 40))]
    found = findings_of(written(tmp_path, "\n".join(lines) + "\n"))
    assert sum("alias `" in finding.message for finding in found) == 39 * 9


def test_nesting_ends_before_recursion_does(tmp_path: Path) -> None:
    found = findings_of(written(tmp_path, "name: a\ntags: " + "[" * 900_000))
    assert [(finding.line, finding.message) for finding in found] == [(2, "nested more than 40 levels deep")]


def test_a_file_over_a_megabyte_is_not_read(tmp_path: Path) -> None:
    path = written(tmp_path, b"\xff" * (MAX_BYTES + 1))  # not UTF-8: reading it would say so
    (finding,) = findings_of(path)
    assert finding.line is None
    assert "1000001 bytes and was not read; the limit is 1000000" in finding.message


def test_a_file_of_a_megabyte_is_read(tmp_path: Path) -> None:
    text = "name: a\n#"
    assert validate(read(written(tmp_path, text + "x" * (MAX_BYTES - len(text)))), House).name == "a"


@each_row(
    ("path", "words"),
    [
        ("nowhere.yaml", "there is no such file"),
        (".", "is a directory"),
        ("house.yaml/site.yaml", "cannot be read: Not a directory"),
        ("a\0b.yaml", "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_a_finding_without_a_line(tmp_path: Path, path: str, words: str) -> None:
    written(tmp_path, "name: a\n")
    (finding,) = findings_of(tmp_path / path)
    assert finding.line is None
    assert words in finding.message


def test_a_pipe_is_refused_before_it_can_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    (finding,) = findings_of(tmp_path / "pipe.yaml")
    assert "not an ordinary file" in finding.message


def test_number_keys_are_taken_where_they_belong(tmp_path: Path) -> None:
    path = written(tmp_path, "name: a\ncodes: {1: b, 0x10: c}\nrooms: {2: {code: 1}}\n")
    source = read(path, number_keys=lambda where: where == ("codes",))
    assert [finding.key for finding in source.findings] == ["rooms.2"]
    assert isinstance(source.data, dict)
    assert source.data["codes"] == {1: "b", 16: "c"}


@each_row("again", ["1", "0x1", "0b1", '"1"'])
def test_one_number_key_in_two_spellings_is_given_twice(tmp_path: Path, again: str) -> None:
    path = written(tmp_path, f"name: a\ncodes:\n  1: b\n  {again}: c\n")
    source = read(path, number_keys=lambda where: where == ("codes",))
    assert [finding.line for finding in source.findings] == [4]
    assert "given twice, in line 3 and here" in source.findings[0].message


def test_a_line_is_found_for_a_key_and_for_what_is_missing_below_it(tmp_path: Path) -> None:
    source = read(written(tmp_path, "name: a\nrooms:\n  b:\n    code: 1\n"))
    assert source.line(("rooms", "b", "code")) == 4
    assert source.line(("rooms", "b", "kind")) == 3
    assert source.line(("nothing",)) == 1


def test_unknown_keys_do_not_hide_what_else_can_be_checked(tmp_path: Path) -> None:
    tried = try_validate(read(written(tmp_path, "name: a\nzzz: 1\nrooms: {b: {code: 2, kid: 1}}\n")), House)
    house, found = tried.model, tried.findings
    assert house is not None
    assert house.rooms["b"].code == 2
    assert {finding.key for finding in found} == {"zzz", "rooms.b.kid"}


def test_wrong_entries_of_a_spared_table_are_left_out(tmp_path: Path) -> None:
    source = read(written(tmp_path, "name: a\nrooms: {b: {code: 99}, c: {code: 1}, d: 5}\n"))
    tried = try_validate(source, House, spare=("rooms",))
    house, found = tried.model, tried.findings
    assert house is not None
    assert list(house.rooms) == ["c"]
    assert [finding.key for finding in found] == ["rooms.b.code", "rooms.d"]


def test_a_good_file_is_data_with_its_digest(tmp_path: Path) -> None:
    source = read(written(tmp_path, "\ufeff%YAML 1.1\n---\nname: 2026-01-02\nrooms: {b: {code: 0x9, size_m: 2}}\n..."))
    assert isinstance(source, Source)
    assert len(source.sha256) == 64
    house = validate(source, House)
    assert (house.name, house.rooms["b"].code, house.rooms["b"].size_m) == ("2026-01-02", 9, 2.0)


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "9" * 30, "-9223372036854775809"])
def test_a_number_that_nothing_can_hold_is_a_finding(tmp_path: Path, number: str) -> None:
    path = tmp_path / "huge.yaml"
    path.write_text(f"a: {number}\n")
    (finding,) = read(path).findings
    assert str(finding).endswith("is not a number that can be used")


def outcome(folder: Path, text: str) -> object:
    try:
        return replace(read(written(folder, text)), sha256="")
    except MapFileError as error:
        return error.findings


def both_parsers(folder: Path, text: str) -> tuple[object, object]:
    """What a text is read as by libyaml, and by PyYAML's own parser, which reads whatever holds a question mark."""
    return outcome(folder, f"# .\n{text}"), outcome(folder, f"# ?\n{text}")


@each_row("path", sorted(MAPS.glob("*.yaml")))
def test_both_parsers_of_yaml_read_a_shipped_map_alike(path: Path, tmp_path: Path) -> None:
    quick, slow = both_parsers(tmp_path, path.read_text("utf-8"))
    assert isinstance(quick, Source)
    assert quick == slow


LISTED = "a: 1\nb: {c: [1, 2], d: e f}\ng:\n  - h: 1\n    i: 'j'\n  - \"k l\"\nm: >\n  n\n  o\n"
SPOILERS = [
    *":,-[]{}#&*!|>'\"%@`~= \n\t\\",
    ": ",
    "- ",
    "---\n",
    "&a ",
    "*a",
    "<<: ",
    "a:1",
    "[a:b]",
    "\r\n",
    "\u2028",
    "\ufeff",
]


@examples(100)
@given(st.lists(st.tuples(st.integers(0, len(LISTED)), st.integers(0, 3), st.sampled_from(SPOILERS)), max_size=3))
def test_both_parsers_of_yaml_read_a_spoiled_file_alike(changes: list[tuple[int, int, str]]) -> None:
    text = LISTED
    for where, length, spoiler in changes:
        text = text[:where] + spoiler + text[where + length :]
    with tempfile.TemporaryDirectory() as folder:
        quick, slow = both_parsers(Path(folder), text)
    assert quick == slow
