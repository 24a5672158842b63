"""The interpreter that the other tests rely on: standard blocks by their timing diagrams, and what it must refuse."""

from __future__ import annotations

import pytest

from tests.lift_manager.commissioning.plc.structured_text import Machine, StError
from tests.support.rows import each_row

BLOCK = """FUNCTION_BLOCK B
VAR_INPUT In : BOOL; END_VAR
VAR_OUTPUT Out : BOOL; END_VAR
VAR T : {kind}; Small : UINT; Whole : INT; Bits : WORD; Row : ARRAY [2..4] OF WORD; END_VAR
{body}
END_FUNCTION_BLOCK
"""


def trace(kind: str, levels: str, *, preset: str = "PT := T#300ms") -> str:
    """Output of a block, scan by scan at 0.1 s, for these input levels."""
    call = f"T(IN := In, {preset});" if kind != "R_TRIG" else "T(CLK := In);"
    machine = Machine(BLOCK.format(kind=kind, body=f"{call} Out := T.Q;"))
    seen = ""
    for number, level in enumerate(levels):
        machine.values["In"] = level == "1"
        machine.scan(round(number * 0.1, 6))
        seen += "1" if machine.values["Out"] else "0"
    return seen


@each_row(
    ("kind", "levels", "seen"),
    [
        ("TON", "0111111000", "0000111000"),
        ("TON", "0111011100", "0000000000"),
        ("TOF", "0100000000", "0111100000"),
        ("TOF", "0100100000", "0111111100"),
        ("TOF", "0000000000", "0000000000"),
        ("TP", "0100000000", "0111000000"),
        ("TP", "0111111111", "0111000000"),
        ("TP", "0101010000", "0111010000"[:4] + "011100"),
        ("R_TRIG", "0111011000", "0100010000"),
        ("R_TRIG", "1100000000", "1000000000"),
    ],
)
def test_standard_blocks_follow_their_timing_diagrams(kind: str, levels: str, seen: str) -> None:
    assert trace(kind, levels) == seen


def test_what_a_caller_passes_in_has_a_type_with_a_name() -> None:
    named = "TYPE Row : ARRAY [0..3] OF WORD; END_TYPE\nFUNCTION_BLOCK B\nVAR_IN_OUT Cells : Row; END_VAR\nCells[3] := 16#0001;\nEND_FUNCTION_BLOCK\n"
    machine = Machine(named)
    machine.scan(0.0)
    assert machine.values["Cells"] == {0: 0, 1: 0, 2: 0, 3: 1}
    with pytest.raises(StError, match="its type has no name"):
        Machine(named.replace("Cells : Row", "Cells : ARRAY [0..3] OF WORD"))


@each_row(
    "body",
    [
        "Out := In",  # no semicolon
        "IF In THEN Out := TRUE;",  # no END_IF
        "Out := Nowhere;",
        "In := TRUE;",
        "Out := 1;",
        "Small := Whole;",
        "Bits := Small;",
        "IF Whole THEN Out := TRUE; END_IF;",
        "Out := NOT Whole;",
        "Out := In AND Whole;",
        "Out := Bits;",
        "Row[5] := 16#0001;",
        "Out := Row[1] = 16#0001;",
        "T(PT := T#1s);",
        "T(IN := In, PT := T#1h);",
        "Other(IN := In, PT := T#1s);",
        "Out := T.ET;",
        "FOR Whole := 1 TO 3 DO Out := TRUE; END_FOR;",
        "Out := SHL(Bits, 1);",
    ],
)
def test_what_a_strict_plc_refuses_is_refused(body: str) -> None:
    with pytest.raises(StError):
        Machine(BLOCK.format(kind="TON", body=body))


@pytest.mark.parametrize(
    "body", ["Small := Small + 65535; Small := Small + 1;", "Bits := 16#10000;", "Whole := 32768;"]
)
def test_a_number_that_does_not_fit_is_refused_when_it_is_stored(body: str) -> None:
    machine = Machine(BLOCK.format(kind="TON", body=body))
    with pytest.raises(StError, match="does not fit"):
        machine.scan(0.0)


def test_a_name_is_declared_once_whatever_its_case() -> None:
    text = BLOCK.format(kind="TON", body="Out := In;").replace("Small : UINT", "OUT : UINT")
    with pytest.raises(StError, match="declared twice"):
        Machine(text)
