"""The I/O list: what stands in its lines, and that every form of it says the same and runs nothing."""

import csv
import io
import re
import subprocess
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

import pytest
from openpyxl import load_workbook
from openpyxl.workbook import Workbook

from lift_manager.commissioning.iolist import as_csv, as_html, as_xlsx
from lift_manager.commissioning.iolist.build import io_list
from lift_manager.commissioning.iolist.model import COLUMNS, FROM_LIFT, TO_LIFT, IoList, IoPoint, LiftList
from lift_manager.config.load import load_site
from register_maps.load import load
from tests.support.rows import each_row

EVIL = '=HYPERLINK("http://evil.example","G")'
SITE = f"""\
schema: 1
name: "Sankt Anna & <b>Söhne</b>"
controllers:
  plc: {{host: 192.0.2.10, map: generic-registers}}
  coils: {{host: 192.0.2.11, port: 1502, unit_id: 3, map: generic-coils}}
  agv: {{host: 192.0.2.12, map: two-stop-agv}}
  relay: {{host: 192.0.2.13, map: waveshare-relay}}
  machine room: {{host: 192.0.2.14, unit_id: 9}}
lifts:
  bed-lift:
    controller: plc
    access: control
    floors: {{B1: -1, "1": 1, '{EVIL}': 2}}
    offset: {{holding: 100}}
  "Goods.1":
    controller: coils
    floors: {{G: 0, "1": 1}}
  "goods.1":
    controller: agv
    parameters: {{first_input: 200}}
    floors: {{4F: 0, 5F: 1}}
  Pushed:
    controller: relay
    endpoints: {{sensor: {{controller: machine room}}}}
    override:
      endpoints: {{sensor: {{unit_id: 1, served: {{discrete: [[0, 3]]}}}}}}
      signals:
        door.front: {{open_limit: "sensor/discrete:0", closed_limit: "sensor/discrete:1"}}
        car_floor: {{one_of: ["sensor/discrete:2", "sensor/discrete:3"]}}
    floors: {{L1: 0, L2: 1}}
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> IoList:
    path = tmp_path_factory.mktemp("site") / "site.yaml"
    path.write_text(SITE, "utf-8")
    return io_list(load_site(path))


def lift(found: IoList, name: str) -> LiftList:
    return next(lift for lift in found.lifts if lift.name == name)


def point(found: IoList, name: str, signal: str) -> IoPoint:
    (one,) = [point for point in lift(found, name).points if point.signal == signal]
    return one


def test_a_register_is_a_line_with_both_addresses_its_values_and_its_floors(found: IoList) -> None:
    assert point(found, "bed-lift", "car_floor") == IoPoint(
        signal="car_floor",
        meaning="the floor at which the car stands, or which it passed last",
        direction=FROM_LIFT,
        printed="holding:1",
        table="holding",
        wire="101",
        unit_id=1,
        function="FC03",
        values=f"signed; the code of a floor, 0 = not known. -1 = B1, 1 = 1, 2 = {EVIL}",
        contact="number, no contact",
        times="",
        supplied_by="lift company",
        remarks="the floor the car stands at or last passed",
    )


def test_a_command_is_a_line_with_its_times_and_what_becomes_of_it(found: IoList) -> None:
    assert point(found, "bed-lift", "hold_door.front") == IoPoint(
        signal="hold_door.front",
        meaning="opens the front door and keeps it open, as the door-open button does",
        direction=TO_LIFT,
        printed="holding:17",
        table="holding",
        wire="117",
        unit_id=1,
        function="write FC06, read FC03",
        values="1 = on, 0 = released",
        contact="number, no contact",
        times="held until released, at most 30 s unless renewed; written again every 1 s; cleared by the"
        " controller after 27 s, to see it written again",
        supplied_by="lift manager",
        remarks=(
            "close_door.front is released first; when the link is lost: the watchdog of the controller releases it; "
            "1 = open the door and hold it; the controller releases it 3 s after the last write. After 27 s it clears the point, "
            "and keeps holding if it is written again"
        ),
    )


def test_every_contact_of_a_signal_is_a_line_of_its_own(found: IoList) -> None:
    told = {point.signal: point for point in lift(found, "Goods.1").points}
    assert [name for name in told if name.startswith("car_floor")] == [
        "car_floor: floor G",
        "car_floor: floor 1",
        *(f"car_floor: code {code}, no floor of this site; stays off" for code in range(2, 8)),
    ]
    assert told["door.front: fully open"].contact == "NO: closes (1) for fully open"
    assert told["motion: down"].values == "1 = down"
    spare = told["car_floor: code 2, no floor of this site; stays off"]
    assert (spare.values, spare.contact, spare.remarks) == ("always 0", "not used", "")
    assert (spare.unit_id, spare.wire, spare.function) == (3, "2", "FC02")
    call = told["go_to: floor 1"]
    assert (call.wire, call.function, call.contact) == ("1", "write FC15, read FC01", "NO: closes (1) while commanded")
    unused = told["go_to: code 7, no floor of this site; stays off"]
    assert (unused.values, unused.contact, unused.times, unused.remarks) == ("always 0", "not used", "", "")


def test_a_normally_closed_contact_says_what_a_broken_wire_reads_as(found: IoList) -> None:
    assert point(found, "Goods.1", "fire").contact == "NC: opens (0) for yes; a broken wire reads as yes"
    assert point(found, "Goods.1", "overload").contact == "NO: closes (1) for yes"
    assert point(found, "bed-lift", "fire").wire == "105 bit 0"


def test_parameters_move_the_addresses_and_stand_in_the_facts(found: IoList) -> None:
    assert point(found, "goods.1", "fault").printed == "discrete:205"
    assert ("Parameters", "first_input = 200, first_output = 0") in lift(found, "goods.1").facts


def test_a_second_device_is_named_with_its_unit_id_and_whoever_has_to_agree(found: IoList) -> None:
    door = point(found, "Pushed", "door.front: fully open")
    assert (door.unit_id, door.printed) == (9, "sensor/discrete:0")
    assert door.supplied_by == "to be agreed"
    assert door.remarks == "on the second device sensor (machine room)"
    assert ("Second device sensor", "machine room: 192.0.2.14, port 502, unit id 9") in lift(found, "Pushed").facts
    assert (
        point(found, "Pushed", "go_to: floor L2").values
        == "the time in the request (5 counts of 0.1 s) closes the relay"
    )


def test_the_facts_of_a_lift_are_its_controller_map_fingerprint_and_floors(found: IoList) -> None:
    assert lift(found, "bed-lift").facts == (
        ("Controller", "plc: 192.0.2.10, port 502, unit id 1"),
        ("Map", "generic-registers (template): Generic lift controller, everything in holding registers"),
        ("Fingerprint of the map (sha256)", load("generic-registers").sha256),
        ("Moved by", "holding +100 from the printed address"),
        ("Floors, lowest first", f"B1 = -1, 1 = 1, {EVIL} = 2"),
        ("Access", "control: the manager commands the lift"),
        ("Fire", "visible (fire, mode word)"),
        ("The car is at a floor by", "level signal"),
    )
    facts = dict(lift(found, "Goods.1").facts)
    assert facts["Access"] == "monitor: nothing is written"
    assert facts["Written as a whole"] == "coil 0 to 7 on the wire, FC15"
    assert dict(lift(found, "Pushed").facts)["Changed by the site"] == (
        "endpoints.sensor, signals.door.front, signals.car_floor"
    )


def test_the_cover_has_every_caution_of_the_site(found: IoList) -> None:
    assert any(line.startswith("goods.1: fire is not visible on this interface") for line in found.cautions)


def table(found: IoList, name: str) -> list[list[str]]:
    return [list(COLUMNS), *map(list, lift(found, name).rows)]


@pytest.fixture(scope="module")
def book(found: IoList) -> Workbook:
    return load_workbook(io.BytesIO(as_xlsx.render(found)))


def cells(book: Workbook, sheet: str) -> list[list[str]]:
    return [["" if value is None else str(value) for value in row] for row in book[sheet].iter_rows(values_only=True)]


def test_the_workbook_has_a_cover_and_one_sheet_per_lift_whatever_a_lift_is_called(book: Workbook) -> None:
    assert book.sheetnames == ["Cover", "bed-lift", "Goods.1", "goods.1 2", "Pushed"]


def test_a_sheet_of_the_workbook_has_every_line_as_text_and_room_to_sign(book: Workbook, found: IoList) -> None:
    for sheet, name in zip(book.sheetnames[1:], ["bed-lift", "Goods.1", "goods.1", "Pushed"], strict=True):
        assert cells(book, sheet) == table(found, name)
        assert {cell.data_type for row in book[sheet].iter_rows() for cell in row if cell.value is not None} == {"s"}
        assert [cell.value for cell in book[sheet][1]][-3:] == ["Tested by", "Date", "Result"]
        assert all(cell.value is None for row in book[sheet].iter_rows(min_row=2, min_col=15) for cell in row)


def test_nothing_in_the_workbook_is_a_formula_not_even_after_an_edit(found: IoList) -> None:
    lifts = tuple(LiftList(EVIL, ((EVIL, EVIL),), lift.points, EVIL, EVIL, EVIL) for lift in found.lifts[:1])
    evil = load_workbook(io.BytesIO(as_xlsx.render(IoList(EVIL, ((EVIL, EVIL),), lifts, ("-1", "@x", "+1", EVIL)))))
    begun = [
        cell
        for sheet in evil.worksheets
        for row in sheet.iter_rows()
        for cell in row
        if str(cell.value or "").startswith(("=", "+", "-", "@"))
    ]
    assert {str(cell.value) for cell in begun} >= {EVIL, "-1", "@x", "+1"}
    assert all(cell.data_type == "s" and cell.quotePrefix for cell in begun)


def test_the_cover_of_the_workbook_says_what_is_in_doubt(book: Workbook, found: IoList) -> None:
    text = {cell for row in cells(book, "Cover") for cell in row}
    assert "I/O list: Sankt Anna & <b>Söhne</b>" in text
    assert {load("generic-registers").sha256, "plc: 192.0.2.10, port 502, unit id 1"} <= text
    assert set(found.cautions) <= text
    assert {"Issued by", "Revision", "Signature"} <= text


def test_every_sheet_is_set_up_for_a4_landscape(book: Workbook) -> None:
    for sheet in book.worksheets:
        assert (sheet.page_setup.orientation, str(sheet.page_setup.paperSize)) == ("landscape", "9")
        assert (sheet.page_setup.fitToWidth, sheet.page_setup.fitToHeight) == (1, 0)
        assert sheet.sheet_properties.pageSetUpPr is not None
        assert sheet.sheet_properties.pageSetUpPr.fitToPage
        # one character of a column is 7 dots of 1/96 inch in Excel, and 277 mm are left between the margins
        millimetres = sum(column.width for column in sheet.column_dimensions.values()) * 7 / 96 * 25.4
        assert millimetres <= 277 / 0.8
    bed = book["bed-lift"]
    assert bed.print_title_rows == "$1:$1"
    assert bed.freeze_panes == "C2"
    assert bed.oddHeader is not None
    assert "Sankt Anna && <b>Söhne</b>" in str(bed.oddHeader.left.text)


NAMES = [
    (["Lift", "LIFT", "lift"], ["Lift", "LIFT 2", "lift 3"]),
    (["cover", "History"], ["cover 2", "History 2"]),
    (["a/b", "a:b", "[x]*?\\"], ["a b", "a b 2", "x"]),
    (["'quoted'", "///"], ["quoted", "Lift"]),
    (["x" * 40, "x" * 41], ["x" * 31, "x" * 29 + " 2"]),
]


@each_row(("lifts", "sheets"), NAMES)
def test_a_sheet_gets_a_name_that_excel_takes(lifts: Sequence[str], sheets: list[str]) -> None:
    assert as_xlsx.sheet_names(lifts) == sheets


def test_the_csv_file_is_one_table_that_a_spreadsheet_opens_as_utf_8(found: IoList) -> None:
    raw = as_csv.render(found)
    assert raw.startswith(b"\xef\xbb\xbf")
    rows = list(csv.reader(io.StringIO(raw.decode("utf-8-sig"), newline="")))
    assert rows[0] == [*as_csv.HEAD, *COLUMNS]
    assert len(rows) == 1 + sum(len(lift.points) for lift in found.lifts)
    assert rows[1][:4] == [
        "bed-lift",
        "plc: 192.0.2.10, port 502, unit id 1",
        "generic-registers",
        load("generic-registers").sha256,
    ]
    assert rows[1][4:] == table(found, "bed-lift")[1]


def test_no_cell_of_the_csv_file_begins_like_a_formula(found: IoList) -> None:
    lifts = tuple(LiftList(EVIL, (), lift.points, "@SUM(1)", "-1", "+1") for lift in found.lifts[:1])
    text = as_csv.render(IoList("x", (), lifts, ())).decode("utf-8-sig")
    rows = list(csv.reader(io.StringIO(text, newline="")))[1:]
    assert {tuple(row[:4]) for row in rows} == {(f"'{EVIL}", "'@SUM(1)", "'-1", "'+1")}
    assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for row in rows for cell in row)


@each_row("cell", ["=1", "+1", "-1", "@A1", "\t=1", "\r=1"])
def test_a_text_that_begins_like_a_formula_gets_an_apostrophe(cell: str) -> None:
    assert as_csv.safe(cell) == f"'{cell}"


@each_row("cell", ["", "1 = up", "a-b", "'x", "lift → manager"])
def test_any_other_text_stays_as_it_is(cell: str) -> None:
    assert as_csv.safe(cell) == cell


class Page(HTMLParser):
    """Tags, attributes and table cells of a page; fails on a tag that is closed in the wrong order."""

    VOID = frozenset({"meta", "col"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: set[str] = set()
        self.tables: list[list[list[str]]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes.update(name for name, _ in attrs)
        if tag not in self.VOID:
            self._open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] in ("td", "th"):
            self.tables[-1][-1][-1] += data
        elif self._open and self._open[-1] != "style":
            self.words.append(data)


@pytest.fixture(scope="module")
def page(found: IoList) -> Page:
    return Page(as_html.render(found).decode())


def test_the_page_has_a_table_per_lift_with_every_line(page: Page, found: IoList) -> None:
    lists = [table for table in page.tables if table[0] == list(COLUMNS)]
    assert lists == [table(found, lift.name) for lift in found.lifts]


def test_the_page_has_the_cautions_and_the_facts_of_every_lift(page: Page, found: IoList) -> None:
    assert set(found.cautions) <= set(page.words)
    assert "I/O list: Sankt Anna & <b>Söhne</b>" in page.words
    facts = [list(fact) for lift in found.lifts for fact in lift.facts]
    shown = [row for table in page.tables for row in table]
    assert all(fact in shown for fact in facts)


def test_the_page_runs_nothing_and_fetches_nothing(page: Page, found: IoList) -> None:
    assert set(page.tags) == {
        *("html", "head", "meta", "title", "style", "body", "h1", "h2", "ul", "li", "section"),
        *("table", "col", "thead", "tbody", "tr", "th", "td"),
    }
    assert page.attributes == {"lang", "charset", "class", "style"}
    style = as_html.render(found).decode().partition("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style
    assert "@page { size: A4 landscape" in style


@pytest.mark.external("chromium")
def test_a_browser_prints_the_page_on_a4_landscape(found: IoList, tmp_path: Path) -> None:
    page, paper = tmp_path / "io.html", tmp_path / "io.pdf"
    page.write_bytes(as_html.render(found))
    chromium = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    subprocess.run([*chromium, f"--print-to-pdf={paper}", page.as_uri()], capture_output=True, check=True, timeout=240)
    sizes = re.findall(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", paper.read_bytes())
    assert len(sizes) > len(found.lifts)  # a cover, and every lift on a sheet of its own
    assert {(round(float(width)), round(float(height))) for width, height in sizes} == {(842, 595)}
