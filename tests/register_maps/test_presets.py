"""PLC names against addresses typed by hand from the vendors' tables (see the sources in each preset)."""

import pytest
from pydantic import ValidationError

from register_maps.presets import PRESETS, Area, load_preset
from register_maps.words import Table
from tests.support.rows import each_row

COIL, DISCRETE, HOLDING, INPUT = Table.COIL, Table.DISCRETE, Table.HOLDING, Table.INPUT

Found = tuple[Table, int, int | None]

NAMES: dict[str, dict[str, Found]] = {
    # %QX0.0-%QX99.7 are 0-799 and %QX100.0-%QX199.7 are 800-1599; %QW0-1023 are 0-1023, %MW0-1023 are 1024-2047.
    "openplc": {
        "%QX0.0": (COIL, 0, None),
        "%QX0.3": (COIL, 3, None),
        "%QX2.6": (COIL, 22, None),
        "%QX99.7": (COIL, 799, None),
        "%QX100.0": (COIL, 800, None),
        "%QX199.7": (COIL, 1599, None),
        "%IX0.7": (DISCRETE, 7, None),
        "%IX1.0": (DISCRETE, 8, None),
        "%IW0": (INPUT, 0, None),
        "%IW1023": (INPUT, 1023, None),
        "%QW0": (HOLDING, 0, None),
        "%QW1023": (HOLDING, 1023, None),
        "%MW0": (HOLDING, 1024, None),
        "%MW1023": (HOLDING, 2047, None),
        "%MW3.5": (HOLDING, 1027, 5),
    },
    # S0 0000, X0 0400 and Y0 0500 (octal), M0-M1535 0800-0DFF, M1536-M4095 B000-B9FF, D0 1000.
    "delta-dvp": {
        "S0": (COIL, 0x0000, None),
        "S1023": (COIL, 0x03FF, None),
        "X0": (DISCRETE, 0x0400, None),
        "X7": (DISCRETE, 0x0407, None),
        "X10": (DISCRETE, 0x0408, None),
        "X17": (DISCRETE, 0x040F, None),
        "X377": (DISCRETE, 0x04FF, None),
        "Y0": (COIL, 0x0500, None),
        "Y20": (COIL, 0x0510, None),
        "Y377": (COIL, 0x05FF, None),
        "M0": (COIL, 0x0800, None),
        "M1279": (COIL, 0x0CFF, None),
        "M1535": (COIL, 0x0DFF, None),
        "M1536": (COIL, 0xB000, None),
        "M2048": (COIL, 0xB200, None),
        "M4095": (COIL, 0xB9FF, None),
        "D0": (HOLDING, 0x1000, None),
        "D1": (HOLDING, 0x1001, None),
        "D1311": (HOLDING, 0x151F, None),
        "D10.4": (HOLDING, 0x100A, 4),
    },
    # Q0-Q627 0000-01F7, R0-R255 02BC-03BB, M0 03E8, M8000-M8317 2328-2427, I0-I627 0000-01F7; M325 is 1261, D756 is 756.
    "idec": {
        "Q0": (COIL, 0, None),
        "Q7": (COIL, 7, None),
        "Q10": (COIL, 8, None),
        "Q627": (COIL, 0x01F7, None),
        "R0": (COIL, 0x02BC, None),
        "R255": (COIL, 0x03BB, None),
        "M0": (COIL, 1000, None),
        "M325": (COIL, 1261, None),
        "M2557": (COIL, 3047, None),
        "M8000": (COIL, 0x2328, None),
        "M8317": (COIL, 0x2427, None),
        "I0": (DISCRETE, 0, None),
        "I627": (DISCRETE, 503, None),
        "D756": (HOLDING, 756, None),
    },
    # 8000-80FF hold four arrays of 256; %M is 3000-5FFF, two bytes to a register.
    "beckhoff-tf6250": {
        "GVL.mb_Input_Coils[0]": (DISCRETE, 0x8000, None),
        "GVL.mb_Output_Coils[3]": (COIL, 0x8003, None),
        "GVL.mb_Input_Registers[16]": (INPUT, 0x8010, None),
        "GVL.mb_Output_Registers[255]": (HOLDING, 0x80FF, None),
        "GVL.mb_Output_Registers[2].15": (HOLDING, 0x8002, 15),
        "%MB0": (HOLDING, 0x3000, None),
        "%MB2": (HOLDING, 0x3001, None),
        "%MW0": (HOLDING, 0x3000, None),
        "%MW20": (HOLDING, 0x300A, None),
        "%MW24574": (HOLDING, 0x5FFF, None),
    },
    # Y 0-2047 (Y0-Y127F), R from 2048, X from 0, DT 0-32764, WL 0-127, LD 2000-2255; words of 16, last digit hexadecimal.
    "panasonic-fp-x": {
        "Y0": (COIL, 0, None),
        "Y9": (COIL, 9, None),
        "YF": (COIL, 15, None),
        "Y10": (COIL, 16, None),
        "Y1F": (COIL, 31, None),
        "Y127F": (COIL, 0x07FF, None),
        "R0": (COIL, 0x0800, None),
        "R255F": (COIL, 0x17FF, None),
        "X73F": (DISCRETE, 0x049F, None),
        "DT0": (HOLDING, 0, None),
        "DT32764": (HOLDING, 32764, None),
        "WL127": (INPUT, 0x007F, None),
        "LD0": (INPUT, 0x07D0, None),
        "LD255": (INPUT, 0x08CF, None),
    },
    # 00001-08192 are Q0.0-Q1023.7, 10001-18192 are I0.0-I1023.7, 30001-30512 are IW0-IW1022.
    "s7-1200": {
        "Q0.0": (COIL, 0, None),
        "%Q0.7": (COIL, 7, None),
        "Q1.0": (COIL, 8, None),
        "%Q1023.7": (COIL, 8191, None),
        "%I0.5": (DISCRETE, 5, None),
        "I1023.7": (DISCRETE, 8191, None),
        "IW0": (INPUT, 0, None),
        "%IW64": (INPUT, 32, None),
        "IW1022": (INPUT, 511, None),
    },
}

REFUSED = [
    ("openplc", "%QX0.8", "bit 0 to 7"),
    ("openplc", "%QX3", "bit 0 to 7"),
    ("openplc", "%QX200.0", "outside"),
    ("openplc", "%MW1024", "outside"),
    ("openplc", "%MD0", "names begin with"),
    ("openplc", "QX0.0", "names begin with"),
    ("openplc", "%MWA", "digits 0 to 9"),
    ("delta-dvp", "X18", "octal"),
    ("delta-dvp", "Y9", "octal"),
    ("delta-dvp", "X400", "outside"),
    ("delta-dvp", "M4096", "outside"),
    ("delta-dvp", "M5000", "outside"),
    ("delta-dvp", "D1312", "outside"),
    ("delta-dvp", "T0", "names begin with"),
    ("delta-dvp", "", "names begin with"),
    ("idec", "Q8", "octal"),
    ("idec", "M5A", "octal"),
    ("idec", "Q630", "outside"),
    ("idec", "M2560", "outside"),
    ("idec", "M8320", "outside"),
    ("beckhoff-tf6250", "%MB1", "must be even"),
    ("beckhoff-tf6250", "%MW3", "must be even"),
    ("beckhoff-tf6250", "%MW24576", "outside"),
    ("beckhoff-tf6250", "GVL.mb_Output_Registers[256]", "outside"),
    ("beckhoff-tf6250", "mb_Output_Registers[0]", "names begin with"),
    ("panasonic-fp-x", "Y1280", "outside"),
    ("panasonic-fp-x", "YG", "names begin with"),
    ("panasonic-fp-x", "DT1F", "digits 0 to 9"),
    ("s7-1200", "Q0", "bit 0 to 7"),
    ("s7-1200", "IW3", "must be even"),
    ("s7-1200", "DB10.DBW0", "names begin with"),
]


def test_every_shipped_preset_is_held_to_its_table() -> None:
    assert sorted(NAMES) == sorted(PRESETS)


@each_row(
    ("preset", "name", "found"), [(preset, name, found) for preset in NAMES for name, found in NAMES[preset].items()]
)
def test_a_name_is_where_the_vendor_says(preset: str, name: str, found: Found) -> None:
    assert load_preset(preset).find(name) == found


@each_row(("preset", "name", "why"), REFUSED)
def test_a_name_that_the_plc_does_not_have_is_refused_with_the_reason(preset: str, name: str, why: str) -> None:
    with pytest.raises(ValueError, match=why) as refused:
        load_preset(preset).find(name)
    assert repr(name) in str(refused.value)


@pytest.mark.parametrize(("preset", "letter", "points"), [("idec", "Q", 504), ("idec", "I", 504)])
def test_octal_last_digits_count_the_points_that_the_manual_counts(preset: str, letter: str, points: int) -> None:
    found = [f"{letter}{tens or ''}{digit}" for tens in range(63) for digit in range(8)]
    assert len(found) == points
    assert [load_preset(preset).find(name)[1] for name in found] == list(range(points))


@each_row("preset", PRESETS)
def test_a_preset_says_where_it_was_read_and_gives_no_address_two_names_of_one_letter(preset: str) -> None:
    known = load_preset(preset)
    assert known.name == preset
    assert known.provenance.sources[0].startswith("elevator-interfaces 2")
    for letter in {area.letter for area in known.areas}:
        places = [
            (area.table, address)
            for area in known.areas
            if area.letter == letter
            for address in range(area.start, area.start + area.count)
        ]
        assert len(places) == len(set(places)), letter


def test_what_only_a_web_page_says_is_marked() -> None:
    weak = {area.letter for name in PRESETS for area in load_preset(name).areas if area.trust == "web-page"}
    assert weak == {"%MB", "%MW"}


def test_connections_and_unit_ids_are_told_where_a_source_tells_them() -> None:
    assert "8 clients" in load_preset("idec").limits["connections"]
    assert load_preset("idec").limits["unit id"] == "ignored"
    assert "one client per instance" in load_preset("s7-1200").limits["connections"]
    assert "100 registers or 256 bits" in load_preset("delta-dvp").limits["requests"]


def test_there_is_no_preset_of_another_name() -> None:
    with pytest.raises(ValueError, match="there is no preset 'codesys'; there are beckhoff"):
        load_preset("codesys")


def test_an_area_cannot_go_beyond_the_last_address() -> None:
    Area(letter="D", table=HOLDING, start=0xFF00, count=0x100)
    with pytest.raises(ValidationError, match="go beyond address 65535"):
        Area(letter="D", table=HOLDING, start=0xFF00, count=0x101)


def test_registers_are_not_counted_by_byte_and_bit() -> None:
    with pytest.raises(ValidationError, match=r"byte\.bit counts bits"):
        Area(letter="%QW", table=HOLDING, start=0, count=8, numbers="byte_and_bit")
