"""Printed addresses and where they are on the wire, typed by hand."""

import pytest
from pydantic import ValidationError

from register_maps.address import Place, notations, parse, served_number, space
from register_maps.schema import Addressing
from register_maps.words import Table
from tests.support.rows import each_row

FROM_0 = Addressing(base=0)
FROM_1 = Addressing(base=1)
MODICON = Addressing(notation="modicon")
DELTA = Addressing(notation="delta-dvp")
OPENPLC = Addressing(notation="openplc")


def at(place: Place) -> tuple[str, str, int, int | None]:
    return place.endpoint, place.table, place.number, place.bit


@each_row(
    ("addressing", "text", "found"),
    [
        (FROM_0, "holding:12", ("", "holding", 12, None)),
        (FROM_0, "holding:0", ("", "holding", 0, None)),
        (FROM_0, "holding:0x0C", ("", "holding", 12, None)),
        (FROM_0, "coil:0X20", ("", "coil", 32, None)),
        (FROM_0, "input:7.3", ("", "input", 7, 3)),
        (FROM_0, "holding:0x180.15", ("", "holding", 384, 15)),
        (FROM_0, "discrete:65535", ("", "discrete", 65535, None)),
        # The number itself goes on the wire, whatever it looks like.
        (FROM_0, "holding:40001", ("", "holding", 40001, None)),
        (FROM_0, "discrete:10001", ("", "discrete", 10001, None)),
        (FROM_1, "holding:12", ("", "holding", 11, None)),
        (FROM_1, "holding:1.0", ("", "holding", 0, 0)),
        (FROM_1, "coil:0x11", ("", "coil", 16, None)),
        # Out of range is for the check to say, with the place.
        (FROM_1, "holding:0", ("", "holding", -1, None)),
        (FROM_0, "holding:65536", ("", "holding", 65536, None)),
        (MODICON, "00001", ("", "coil", 0, None)),
        (MODICON, "10004", ("", "discrete", 3, None)),
        (MODICON, "30008.3", ("", "input", 7, 3)),
        (MODICON, "40001", ("", "holding", 0, None)),
        (MODICON, "40013", ("", "holding", 12, None)),
        (MODICON, "49999", ("", "holding", 9998, None)),
        (MODICON, "000017", ("", "coil", 16, None)),
        (MODICON, "400013", ("", "holding", 12, None)),
        (MODICON, "410001", ("", "holding", 10000, None)),
        (MODICON, "465536", ("", "holding", 65535, None)),
        (DELTA, "X17", ("", "discrete", 0x040F, None)),
        (DELTA, "M1536", ("", "coil", 0xB000, None)),
        (DELTA, "D10.4", ("", "holding", 0x100A, 4)),
        # A name that a PLC does not have can still be said as the wire counts.
        (DELTA, "coil:0x0600", ("", "coil", 0x0600, None)),
        (OPENPLC, "%QX0.3", ("", "coil", 3, None)),
        (OPENPLC, "%MW0", ("", "holding", 1024, None)),
        (FROM_0, "sensor/discrete:0", ("sensor", "discrete", 0, None)),
        (FROM_1, "door-box-2/holding:5.1", ("door-box-2", "holding", 4, 1)),
        (MODICON, "sensor/10001", ("sensor", "discrete", 0, None)),
        (DELTA, "sensor/X17", ("sensor", "discrete", 0x040F, None)),
    ],
)
def test_an_address_is_read_in_the_notation_of_its_map(
    addressing: Addressing, text: str, found: tuple[str, str, int, int | None]
) -> None:
    place = parse(text, addressing)
    assert at(place) == found
    assert place.text == text


@each_row(
    ("addressing", "text", "why"),
    [
        (FROM_0, "12", "write table:number"),
        (FROM_0, "holding", "write table:number"),
        (FROM_0, "holding:", "write table:number"),
        (FROM_0, "holding:-1", "write table:number"),
        (FROM_0, "holding:1.", "write table:number"),
        (FROM_0, "holding: 1", "write table:number"),
        (FROM_0, "Holding:1", "write table:number"),
        (FROM_0, "register:1", "write table:number"),
        (FROM_0, "holding:1\n", "write table:number"),
        (FROM_0, "Sensor/holding:1", "write table:number"),
        (FROM_0, "a/b/holding:1", "write table:number"),
        (FROM_0, "holding:1.16", "0 to 15"),
        (FROM_0, "coil:1.0", "belongs to a holding or input register"),
        (FROM_0, "discrete:1.0", "belongs to a holding or input register"),
        (MODICON, "holding:12", "five or six digits"),
        (MODICON, "4001", "five or six digits"),
        (MODICON, "4000001", "five or six digits"),
        (MODICON, "20001", "five or six digits"),
        (MODICON, "50001", "five or six digits"),
        (MODICON, "40001.16", "0 to 15"),
        (MODICON, "00001.1", "belongs to a holding or input register"),
        (DELTA, "X18", "octal"),
        (DELTA, "Z1", "names begin with"),
        (DELTA, "X7.1", "belongs to a holding or input register"),
        (DELTA, "D1.16", "0 to 15"),
    ],
)
def test_an_address_that_says_no_place_is_refused_with_the_form_that_is_meant(
    addressing: Addressing, text: str, why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        parse(text, addressing)


@each_row(
    ("addressing", "table", "printed", "wire"),
    [
        (FROM_0, Table.HOLDING, 0, 0),
        (FROM_0, Table.HOLDING, 40001, 40001),
        (FROM_1, Table.COIL, 17, 16),
        (FROM_1, Table.INPUT, 1, 0),
        (MODICON, Table.COIL, 1, 0),
        (MODICON, Table.COIL, 17, 16),
        (MODICON, Table.DISCRETE, 10001, 0),
        (MODICON, Table.INPUT, 30010, 9),
        (MODICON, Table.HOLDING, 40001, 0),
        (MODICON, Table.HOLDING, 49999, 9998),
        (MODICON, Table.HOLDING, 400001, 0),
        (MODICON, Table.HOLDING, 465536, 65535),
        (MODICON, Table.DISCRETE, 165536, 65535),
        # With the letters of a PLC, `served` counts as the wire does.
        (DELTA, Table.COIL, 0xB000, 0xB000),
    ],
)
def test_served_ranges_are_counted_as_the_addresses_are(
    addressing: Addressing, table: Table, printed: int, wire: int
) -> None:
    assert served_number(table, printed, addressing) == wire


def test_tables_of_a_second_device_go_by_its_name() -> None:
    assert space("", Table.COIL) == "coil"
    assert space("sensor", Table.COIL) == "sensor/coil"
    assert parse("sensor/holding:3", FROM_0).space == "sensor/holding"
    assert parse("holding:3", FROM_0).space == "holding"


def test_every_notation_can_be_named_in_a_map() -> None:
    assert notations()[0] == "modicon"
    for name in notations():
        assert Addressing(notation=name).base is None


@each_row("said", [{}, {"base": 0, "notation": "modicon"}, {"notation": "codesys"}, {"base": 2}])
def test_a_map_says_exactly_one_way_of_counting(said: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Addressing.model_validate(said)
