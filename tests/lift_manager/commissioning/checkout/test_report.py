"""The report of an acceptance test: what stands in it, and that every form of it says the same and runs nothing."""

import csv
import io
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from lift_manager.commissioning.checkout.record import (
    Confirmation,
    Item,
    Latency,
    Outcome,
    PunchEntry,
    Record,
    Result,
    Severity,
    Stage,
    Trip,
    verdict,
)
from lift_manager.commissioning.checkout.report import as_csv, as_html, as_json, charts
from lift_manager.commissioning.checkout.report.difference import compare
from lift_manager.commissioning.checkout.report.figures import (
    CLOSES,
    OPENS,
    Times,
    door_times,
    figure_text,
    travel_times,
)
from lift_manager.commissioning.checkout.report.photos import LARGEST_MB, Photo, read_photos
from lift_manager.commissioning.checkout.report.words import NO_EXAMINATION, headline
from tests.lift_manager.commissioning.checkout.records import (
    FAT,
    ITEMS,
    PRECONDITIONS,
    SAT,
    UNSIGNED,
    at,
    result,
    signed,
)
from tests.support.rows import each_row

EVIL = '</style><script>alert(1)</script>"\'&\\0 =HYPERLINK("http://evil.example","G")'
PNG = b"\x89PNG\r\n\x1a\n" + bytes(20)


class Page(HTMLParser):
    """Tags, attributes and texts of a page; fails on a tag that is closed in the wrong order."""

    VOID = frozenset({"meta", "col", "br", "img"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: dict[str, set[str]] = {}
        self.rows: list[list[str]] = []
        self.headings: list[str] = []
        self.text = ""
        self.style = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            self.attributes.setdefault(name, set()).add(value or "")
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        elif tag in ("h1", "h2"):
            self.headings.append("")
        elif tag == "br":
            self.handle_data("\n")
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self._open:
            self.style += data
            return
        self.text += data
        if self._open and self._open[-1] in ("h1", "h2"):
            self.headings[-1] += data
        if "td" in self._open or "th" in self._open:
            self.rows[-1][-1] += data


def page(record: Record, against: Record | None = None, **photos: Photo) -> Page:
    return Page(as_html.render(record, against, photos).decode())


def row_of(found: Page, first: str) -> list[str]:
    return next(row for row in found.rows if row and row[0] == first)


def below(found: Page, number: str) -> str:
    """Return what stands below an item: its addresses, and what was seen."""
    return found.rows[found.rows.index(row_of(found, number)) + 1][1]


def with_results(*results: Result, items: tuple[Item, ...] = ITEMS[:2]) -> Record:
    return UNSIGNED.model_copy(update={"items": items, "results": results, "punch_list": (), "trips": ()})


@pytest.fixture(scope="module")
def sat() -> Page:
    return page(SAT, FAT)


def test_the_report_has_every_part_of_an_acceptance_test_in_order(sat: Page) -> None:
    assert sat.headings == [
        "Site acceptance test (SAT)",
        "Summary",
        "What was tested",
        "People, instruments and preconditions",
        *("Signals", "Commands", "Floors and doors", "Abnormal cases", "Robot trips", "The real robot"),
        *("Timing", "Trips", "Punch list", "As-built changes", "Difference FAT → SAT"),
        *("Hand-back of the lift", "Signatures", "Annex: earlier results", "Annex: fingerprint of the controller"),
    ]


def test_an_item_has_its_addresses_its_result_who_when_and_what_was_seen(sat: Page) -> None:
    assert row_of(sat, "A-04") == [
        "A-04",
        "manager killed while it holds the door\nThis program starts a second manager that holds the door, and kills it.",
        "hold_door.front: the watchdog of the controller releases it",
        "Pass",
        "Ana Keller, confirmed by Bo Lindqvist\n2026-11-23 09:00",
        "",
    ]
    assert below(sat, "A-04") == "released after 3 s · child killed at 09:12:04.3 · holding 117: 1 → 0 after 3.0 s"
    assert below(sat, "S-09").startswith("fire: holding:5 bit 0 (holding 105 bit 0)\nholding 105 bit 0: 0 → 1 → 0 · ")
    assert row_of(sat, "S-11")[3] == "FAIL"


def test_the_title_names_the_lift_the_hash_and_that_it_is_no_examination(sat: Page) -> None:
    assert row_of(sat, "Lift") == ["Lift", "bed-lift"]
    assert row_of(sat, "Record (sha256)")[1] == SAT.sha256
    assert "PASSED UNDER CONDITIONS" in sat.text
    assert "One robot of at most 300 kg, and nobody rides along." in sat.text
    assert sat.text.count(NO_EXAMINATION) == 2
    assert "EN 81-20" in NO_EXAMINATION
    assert "IEC 62381" in sat.text
    assert "Loop check after IEC 62382" in sat.text


def test_the_map_the_controller_and_the_versions_stand_in_it(sat: Page) -> None:
    assert row_of(sat, "Map (sha256)")[1] == SAT.map.sha256
    assert SAT.controller.fingerprint is not None
    assert row_of(sat, "Fingerprint (sha256)")[1] == SAT.controller.fingerprint.sha256
    assert row_of(sat, "Identity")[1] == "Thyra LC-3, serial 88-1203, program 2.14"
    assert row_of(sat, "As it says itself")[1] == "vendor Thyra, product code LC-3, revision 4.1"
    assert row_of(sat, "Versions")[1] == "lift-manager 1.0.0, Python 3.11.2"
    assert row_of(sat, "Served")[1] == "holding 100 to 131 (unit 1); coil 0 to 15 (unit 1)"


def test_every_page_has_the_hash_of_the_record_and_its_number(sat: Page) -> None:
    assert f'@bottom-left {{ content: "record sha256 {SAT.sha256}"' in sat.style
    assert '"page " counter(page) " of " counter(pages)' in sat.style


def test_the_summary_counts_results_by_group(sat: Page) -> None:
    assert row_of(sat, "Group") == [
        *("Group", "Items", "Pass", "FAIL", "Not applicable", "Proved by document", "Skipped", "Open")
    ]
    assert row_of(sat, "All") == ["All", "18", "15", "1", "1", "1", "", ""]


def test_a_precondition_has_its_newest_answer_with_number_or_reason(sat: Page) -> None:
    assert row_of(sat, "Permit to work")[2:5] == ["Yes", "PTW 4711", "the test"]
    assert row_of(sat, "Fire panel isolated")[2:5] == [
        "No",
        "tested with the fire brigade's line disconnected instead",
        "A-05",
    ]


def test_a_precondition_that_is_met_before_every_item_is_one_line() -> None:
    empty = [one.model_copy(update={"item": item}) for one in PRECONDITIONS[2:3] for item in ("", "A-01", "A-02")]
    found = page(UNSIGNED.model_copy(update={"preconditions": tuple(empty)}))
    assert row_of(found, "Car empty")[2:5] == ["Yes", "", "the test, A-01, A-02"]


def test_writes_that_repeat_are_counted() -> None:
    evidence = ("pressed", "written: a := 1", "written: b := 1", "written: a := 1", "released", "written: a := 1")
    found = page(with_results(result("S-01", Outcome.PASSED, 1, evidence=evidence)))
    assert below(found, "S-01").endswith(
        "pressed · written: a := 1 (2 times) · written: b := 1 · released · written: a := 1"
    )


def test_the_punch_list_has_severity_condition_and_who_accepted_it(sat: Page) -> None:
    listed = sat.rows[sat.rows.index(["No.", "Item", "Severity", "Point", "State", "Condition, accepted by", "Due"]) :]
    assert listed[1][:5] == [
        "1",
        "S-04",
        "A",
        "Door contact inverted in the map.",
        "Closed by Ana Keller\n2026-11-23 08:12",
    ]
    assert listed[2] == [
        *("2", "S-11", "B", "Overload contact is not wired.", "Open, accepted under a condition"),
        "One robot of at most 300 kg, and nobody rides along.\naccepted by Cy Okafor",
        "2026-12-15",
    ]


def test_a_point_that_nobody_accepted_is_said_to_be_open() -> None:
    entry = PunchEntry(number=1, text="no brake", severity=Severity.A, raised_at=at(1))
    found = page(UNSIGNED.model_copy(update={"punch_list": (entry,)}))
    assert "OPEN, not accepted" in found.text


def test_an_as_built_change_stands_against_the_approved_list(sat: Page) -> None:
    assert "Against the approved I/O list (Rev. C of 2026-11-12)." in sat.text
    assert row_of(sat, "door.front")[1:4] == [
        "NO: closes (1) for open",
        "NC: opens (0) for open",
        "The relay of the door operator has no free NO contact.",
    ]


def test_the_hand_back_says_who_took_the_lift_back_and_without_one_there_is_a_form(sat: Page) -> None:
    assert row_of(sat, "In normal service")[1] == "Yes"
    assert row_of(sat, "Taken back by")[1] == "Bo Lindqvist"
    form = page(UNSIGNED.model_copy(update={"hand_back": None}))
    assert row_of(form, "Taken back by")[1] == ""
    assert "Nothing is bridged, simulated or disconnected any more" in form.text


def test_a_factory_test_hands_no_lift_back() -> None:
    text = page(FAT.model_copy(update={"hand_back": None})).text
    assert "Hand-back of the lift" not in text
    assert "handed back" not in text


def test_a_signature_tells_whether_it_is_for_the_record_as_it_is(sat: Page) -> None:
    assert row_of(sat, "Run by")[1] == "Ana Keller, Robots Ltd"
    signatures = sat.rows[sat.rows.index(["Role", "Name", "Signature", "Date"]) :]
    assert signatures[1] == ["Run by", "Ana Keller", "signed in the record, as it is", "2026-11-23 10:04 UTC"]
    assert signatures[3:5] == [["Witness", "Cy Okafor", "", ""], ["Owner", "", "", ""]]
    changed = page(SAT.model_copy(update={"site": "Another hospital"}))
    assert "signed an earlier state (sha256" in changed.text
    assert "This record is not signed as it is" in changed.text


def test_an_item_without_a_result_is_open_and_says_when_it_has_changed_since() -> None:
    old = result("S-04", Outcome.PASSED, 5, digest="of an older map")
    found = page(with_results(result("S-01", Outcome.PASSED, 4), old))
    assert row_of(found, "S-04")[3:] == ["Open", "", "changed since it was tested"]
    assert "NOT COMPLETE" in found.text
    assert "Not complete: no result of 1 item (S-04)." in found.text


def test_a_result_that_no_longer_counts_stands_in_the_annex(sat: Page) -> None:
    assert [
        "S-04",
        "FAIL",
        "Ana Keller\n2026-11-23 08:06",
        "Reads open with the door closed: contact inverted.",
    ] in sat.rows


def test_the_difference_lists_items_that_came_out_differently_or_are_not_the_same_test() -> None:
    found = compare(FAT, SAT)
    assert [(item.item, item.before, item.after) for item in found.items] == [
        ("S-04", "pass", "pass"),
        ("S-11", "pass", "fail"),
        ("C-07", "pass", "not applicable"),
        ("R-02", "no such item", "proved by document"),
    ]
    assert found.items[0].changes == (
        "door.front: address holding:3 (holding 103), now holding:2 (holding 102)",
        "the map or the site file has changed what this item depends on",
    )
    assert found.same == len(ITEMS) - 4
    assert [row[0] for row in found.general] == [
        "Map (sha256)",
        "Controller",
        "Identity of the controller",
        "What the controller says that it is",
        "Fingerprint of the controller",
    ]


def test_another_number_of_trips_is_no_change_of_the_map() -> None:
    def more(item: Item) -> Item:
        return item.model_copy(update={"title": "9 whole trips", "subject": "9", "digest": "other"})

    items = tuple(more(item) if item.id == "T-01" else item for item in SAT.items)
    (found,) = compare(SAT, SAT.model_copy(update={"items": items})).items
    assert found.changes == ("title: '5 whole trips', now '9 whole trips'",)


def test_an_item_that_the_later_record_no_longer_has_is_a_difference() -> None:
    (gone,) = [item for item in compare(SAT, FAT).items if item.item == "R-02"]
    assert (gone.before, gone.after) == ("proved by document", "no such item")


def test_a_record_does_not_differ_from_itself() -> None:
    found = compare(SAT, SAT)
    assert (found.items, found.general, found.same) == ((), (), len(ITEMS))


def test_the_difference_compares_measured_times() -> None:
    found = {one.what: one for one in compare(FAT, SAT).figures}
    assert found["travel L2 → L1"].before_s < found["travel L2 → L1"].after_s
    assert {"door opens at L3", "door closes at B1"} <= found.keys()


def test_the_report_shows_the_difference_only_against_another_record(sat: Page) -> None:
    assert row_of(sat, "S-11")
    assert ["S-11", "overload: the car is overloaded", "pass", "fail", ""] in sat.rows
    assert not any("Difference" in heading for heading in page(SAT).headings)


def test_two_tests_of_one_stage_are_told_apart_by_their_dates() -> None:
    assert (
        "Difference SAT 2026-11-02 08:00 → SAT 2026-11-23 08:00"
        in page(SAT, FAT.model_copy(update={"stage": Stage.SAT})).headings
    )


def trip(start: str, end: str, **figures: float) -> Trip:
    return Trip(number=1, item="T-01", **{"from": start}, to=end, at=at(1), is_complete=True, figures=figures)


def test_doors_are_timed_by_floor_and_travel_from_floor_to_floor() -> None:
    record = UNSIGNED.model_copy(
        update={
            "results": (),
            "trips": (
                trip("L1", "L3", door_opens_s=3.0, door_closes_s=4.0, travel_s=9.0),
                trip("L1", "L3", door_opens_s=2.0, travel_s=11.0),
                trip("L3", "B1", door_opens_s=2.5, rear_door_opens_s=2.7),
                trip("roof", "L1", travel_s=9.0),
            ),
        }
    )
    assert door_times(record, OPENS) == (Times("L3", (3.0, 2.0)), Times("B1", (2.5,)), Times("B1 rear", (2.7,)))
    assert door_times(record, CLOSES) == (Times("L3", (4.0,)),)
    assert travel_times(record) == (Times("L1 → L3", (9.0, 11.0)),)
    assert travel_times(record)[0].median == 10.0


def test_a_floor_item_counts_to_the_door_times_of_its_floor() -> None:
    floors = tuple(item for item in ITEMS if item.id == "F-02")
    measured = with_results(result("F-02", Outcome.PASSED, 3, figures={"door_opens_s": 2.9}), items=floors)
    assert door_times(measured, OPENS) == (Times("L1", (2.9,)),)


@each_row(
    ("name", "text"), [("door_opens_s", "door opens 3 s"), ("levelling_mm", "levelling 3 mm"), ("tries", "tries 3")]
)
def test_a_figure_is_told_with_its_unit(name: str, text: str) -> None:
    assert figure_text(name, 3.0) == text


def test_charts_show_each_floor_and_the_percentiles() -> None:
    assert SAT.controller.fingerprint is not None
    assert SAT.controller.fingerprint.latency is not None
    svg = charts.histogram("Answers", SAT.controller.fingerprint.latency)
    assert "p50 14.06 ms" in svg
    assert "p99 52.01 ms" in svg


def test_a_percentile_at_the_right_end_is_written_inside_the_picture() -> None:
    svg = charts.histogram("Answers", Latency(p50_ms=1, p99_ms=98, max_ms=98, samples_ms=(1.0, 1.0, 98.0)))
    assert re.search(r'text-anchor="start"[^>]*>p50 1 ms', svg)
    assert re.search(r'text-anchor="end"[^>]*>p99 98 ms', svg)
    doors = charts.bars(
        "Doors", [("door opens", (Times("L<2>", (3.0, 2.0)),)), ("door closes", (Times("L<2>", (4.0,)),))]
    )
    assert "L&lt;2&gt;" in doors
    assert "2.5 s" in doors
    assert doors.count("<circle") == 2


def test_a_tower_has_several_charts_on_one_scale() -> None:
    opens = tuple(Times(f"L{floor}", (2.0 + floor / 100,)) for floor in range(60))
    found = charts.bars("Doors", [("door opens", opens), ("door closes", opens)])
    first, *more = found.split("</svg>")[:-1]
    assert len(more) == 2
    assert [re.findall(r'"middle">([0-9.]+)<', chart) for chart in more] == [
        re.findall(r'"middle">([0-9.]+)<', first)
    ] * 2
    assert found.count(">L0<") == found.count(">L59<") == 1


def test_a_chart_of_nothing_is_left_out() -> None:
    assert charts.bars("Doors", [("door opens", ())]) == ""
    empty = UNSIGNED.model_copy(
        update={"trips": (), "results": (), "controller": SAT.controller.model_copy(update={"fingerprint": None})}
    )
    found = page(empty)
    assert "Timing" not in found.headings
    assert "svg" not in found.tags


@each_row("most", [0.001, 0.9, 1.0, 3.0, 4.2, 7.0, 52.0, 1234.5])
def test_an_axis_ends_at_or_above_the_largest_value_with_a_few_round_ticks(most: float) -> None:
    svg = charts.bars("x", [("x", (Times("a", (most,)),))])
    ticks = [float(found) for found in re.findall(r'text-anchor="middle">([0-9.e-]+)<', svg)]
    assert ticks[-1] >= most * (1 - 1e-9)
    assert 4 <= len(ticks) <= 8


EVERY_TEXT = {
    "site": EVIL,
    "lift": EVIL,
    "floors": {EVIL: 1, "L1": 2},
    "versions": {EVIL: EVIL},
    "trips": (trip("L1", EVIL, door_opens_s=3.0, travel_s=3.0),),
    "items": tuple(
        item.model_copy(update={"group": EVIL, "title": EVIL, "action": EVIL, "expected": EVIL}) for item in ITEMS
    ),
    "results": tuple(
        one.model_copy(update={"note": EVIL, "evidence": (EVIL,), "photos": (EVIL,), "by": EVIL}) for one in SAT.results
    ),
    "punch_list": tuple(
        one.model_copy(update={"text": EVIL, "condition": EVIL, "accepted_by": EVIL, "due": EVIL})
        for one in SAT.punch_list
    ),
}


def test_no_text_of_a_record_becomes_markup_or_style() -> None:
    record = SAT.model_copy(update=EVERY_TEXT)
    found = page(record, FAT, **{EVIL: Photo(EVIL, "image/png", PNG)})
    assert "script" not in found.tags
    assert found.style.count('"') == page(SAT).style.count('"')
    assert "<" not in found.style
    assert found.text.count("<script>alert(1)</script>") > 20


def test_the_page_runs_nothing_and_fetches_nothing(sat: Page) -> None:
    assert sat.tags <= {
        *(
            "html",
            "head",
            "meta",
            "title",
            "style",
            "body",
            "h1",
            "h2",
            "h3",
            "p",
            "b",
            "br",
            "span",
            "div",
            "ul",
            "li",
        ),
        *("table", "col", "thead", "tbody", "tr", "th", "td", "section", "figure", "figcaption", "img"),
        *("svg", "rect", "path", "circle", "text"),
    }
    assert not {name for name in sat.attributes if name.startswith("on") or name in ("href", "src")}
    assert "url(" not in sat.style
    assert "@import" not in sat.style
    assert "@page { size: A4" in sat.style
    own = page(SAT, None, **{"photos/fire-panel.png": Photo("photos/fire-panel.png", "image/png", PNG)})
    (source,) = own.attributes["src"]
    assert source.startswith("data:image/png;base64,")


def test_photos_are_read_from_the_folder_of_the_record(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "fire-panel.png").write_bytes(PNG)
    found = read_photos(SAT, tmp_path)
    assert list(found) == ["photos/fire-panel.png"]
    assert found["photos/fire-panel.png"].media_type == "image/png"
    assert "photo photos/fire-panel.png, see annex" in row_of(page(SAT, None, **found), "A-05")[5]


def test_a_photo_that_cannot_be_shown_is_named_with_the_reason(tmp_path: Path) -> None:
    def problem() -> str:
        (photo,) = read_photos(SAT, tmp_path).values()
        assert not photo.data
        assert photo.problem in row_of(page(SAT, None, **{photo.path: photo}), "A-05")[5]
        return photo.problem

    assert problem() == "cannot be read (No such file or directory)"
    file = tmp_path / "photos" / "fire-panel.png"
    file.parent.mkdir()
    file.write_bytes(b"<svg onload='alert(1)'/>")
    assert problem() == "is no JPEG, PNG or GIF"
    file.write_bytes(PNG + bytes(LARGEST_MB * 1_000_000))
    assert problem() == f"larger than {LARGEST_MB} MB"


def test_the_as_left_baseline_is_an_annex() -> None:
    finding = {"severity": "note", "subject": "plc", "where": "holding:1", "text": "answers in 12 ms", "cure": ""}
    found = page(UNSIGNED.model_copy(update={"baseline": {"findings": [finding]}}))
    assert row_of(found, "plc") == ["plc", "holding:1", "answers in 12 ms"]
    assert "It has no findings." in page(UNSIGNED.model_copy(update={"baseline": {"findings": []}})).text


def test_the_json_form_has_the_record_the_verdict_and_the_difference() -> None:
    found: dict[str, Any] = json.loads(as_json.render(SAT, FAT))
    assert Record.model_validate_json(json.dumps(found["record"])) == SAT
    assert found["record_sha256"] == SAT.sha256
    assert found["verdict"]["passed"] is True
    assert found["verdict"]["text"] == "passed under conditions"
    assert found["results"]["S-11"]["outcome"] == "fail"
    assert [item["item"] for item in found["difference"]["items"]] == ["S-04", "S-11", "C-07", "R-02"]
    assert found["times_s"]["travel"]["L2 → L1"] == {"median": 7.8, "all": [7.8]}
    assert json.loads(as_json.render(SAT))["difference"] is None


def table(raw: bytes) -> list[dict[str, str]]:
    assert raw.startswith(b"\xef\xbb\xbf")
    return list(csv.DictReader(io.StringIO(raw.decode("utf-8-sig"), newline="")))


def test_the_csv_form_has_a_line_for_each_item() -> None:
    rows = table(as_csv.render(SAT, FAT))
    assert [row["Number"] for row in rows] == [item.id for item in ITEMS]
    failed = next(row for row in rows if row["Number"] == "S-11")
    assert (failed["Lift"], failed["Result"], failed["By"], failed["At (UTC)"]) == (
        *("bed-lift", "fail", "Ana Keller", "2026-11-23 08:20"),
    )
    assert failed["Punch list"] == "2 (B, open): Overload contact is not wired."
    assert (failed["Earlier result"], failed["Difference"]) == ("pass", "another result")
    assert (rows[0]["Earlier result"], rows[0]["Difference"]) == ("pass", "same")
    assert table(as_csv.render(FAT, SAT))[-1]["Difference"] == "no such item"
    assert "Difference" not in table(as_csv.render(SAT))[0]


def test_who_confirmed_a_result_by_phone_and_when_stands_beside_it() -> None:
    number, given = next((n, one) for n, one in enumerate(SAT.results, 1) if one is SAT.newest["S-01"])
    seen = Confirmation(item="S-01", result=number, name="Cy <Okafor>", at=at(77))
    confirmed = SAT.model_copy(update={"confirmations": (seen,)})
    text = "Cy <Okafor> by phone, 2026-11-23 09:17"
    assert row_of(page(confirmed), "S-01")[4].startswith(f"{given.by}, confirmed by {text}\n")
    assert next(row for row in table(as_csv.render(confirmed)) if row["Number"] == "S-01")["Confirmed by"] == text
    assert "confirmed by Cy <Okafor> by phone" not in page(SAT).text


def test_no_cell_of_the_csv_form_begins_like_a_formula() -> None:
    items = tuple(item.model_copy(update={"title": '=HYPERLINK("x")', "expected": "@x"}) for item in ITEMS)
    evil = SAT.model_copy(update={"items": items, "site": "+1"})
    cells = [
        cell
        for row in csv.reader(io.StringIO(as_csv.render(evil, FAT).decode("utf-8-sig"), newline=""))
        for cell in row
    ]
    assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in cells)


@each_row(
    ("bad", "words"),
    [
        ((), "PASSED"),
        ((Outcome.FAILED,), "NOT PASSED"),
        ((Outcome.SKIPPED,), "NOT PASSED"),
        ((Outcome.DOCUMENT,), "PASSED"),
    ],
)
def test_the_headline_follows_the_verdict(bad: tuple[Outcome, ...], words: str) -> None:
    outcome = bad[0] if bad else Outcome.PASSED
    record = with_results(result("S-01", Outcome.PASSED, 1), result("S-04", outcome, 2))
    assert headline(verdict(record)) == words
    assert words in page(record).text


@pytest.mark.external("chromium")
def test_a_browser_prints_the_report_on_a4_with_the_hash_on_each_page(tmp_path: Path) -> None:
    file, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    file.write_bytes(as_html.render(signed(UNSIGNED), FAT))
    chromium = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [*chromium, "--no-pdf-header-footer", f"--print-to-pdf={paper}", file.as_uri()]
    subprocess.run(command, capture_output=True, check=True, timeout=240)
    sizes = re.findall(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", paper.read_bytes())
    assert len(sizes) > 5
    assert {(round(float(width)), round(float(height))) for width, height in sizes} == {(595, 842)}
