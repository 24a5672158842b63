"""Writes the I/O list as a workbook: a cover, and one sheet for each lift, set up for A4 landscape."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from typing import cast

from openpyxl import Workbook
from openpyxl.cell.cell import Cell
from openpyxl.styles import Alignment, Border, Font, PatternFill, Side
from openpyxl.utils import get_column_letter
from openpyxl.worksheet.header_footer import HeaderFooterItem
from openpyxl.worksheet.page import PageMargins
from openpyxl.worksheet.properties import PageSetupProperties
from openpyxl.worksheet.worksheet import Worksheet

from lift_manager.commissioning.iolist.model import COLUMNS, SIGN_OFF, SIGNATURES, IoList, LiftList

COVER = "Cover"
MAX_NAME_LENGTH = 31
"""The longest name of a sheet in Excel."""

_WIDTHS = (3.5, 15, 18, 8.5, 11, 7.5, 8, 4.5, 8, 15, 14, 15, 8.5, 22, 7, 6.5, 6.5)
"""The widths of the columns in Excel characters. Chosen: they then fit on A4 landscape at four fifths of their size, which is 6.5 point."""
_FORBIDDEN_IN_NAME = re.compile(r"[\[\]:*?/\\]")

_LINE = Side(style="thin", color="FF888888")
_FRAME = Border(left=_LINE, right=_LINE, top=_LINE, bottom=_LINE)
_HEAD = PatternFill("solid", fgColor="FFE4E4E4")
_COMMAND = PatternFill("solid", fgColor="FFF4F4F4")
_SMALL = Font(name="Arial", size=8)
_BOLD = Font(name="Arial", size=8, bold=True)
_TITLE = Font(name="Arial", size=16, bold=True)
_HEADING = Font(name="Arial", size=11, bold=True)
_WRAPPED = Alignment(wrap_text=True, vertical="top")


def render(found: IoList) -> bytes:
    """Return the workbook as a file."""
    book = Workbook()
    book.properties.creator = "lift-manager"
    book.properties.title = found.title
    cover = book.worksheets[0]
    cover.title = COVER
    names = sheet_names([lift.name for lift in found.lifts])
    _cover(cover, found, names)
    for name, lift in zip(names, found.lifts, strict=True):
        _lift(book.create_sheet(name), found, lift)
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()


def sheet_names(lifts: Sequence[str]) -> list[str]:
    """Return a sheet name for each lift: its own name as far as Excel allows it, and unique regardless of case."""
    names: list[str] = []
    taken = {COVER.lower(), "history"}  # Excel reserves the second one
    for lift in lifts:
        plain = _FORBIDDEN_IN_NAME.sub(" ", lift).strip(" '") or "Lift"
        name, number = plain[:MAX_NAME_LENGTH].rstrip(" '"), 2
        while name.lower() in taken:
            ending = f" {number}"
            name, number = plain[: MAX_NAME_LENGTH - len(ending)].rstrip(" '") + ending, number + 1
        taken.add(name.lower())
        names.append(name)
    return names


def _cover(sheet: Worksheet, found: IoList, names: Sequence[str]) -> None:
    sheet.column_dimensions["A"].width = 32
    sheet.column_dimensions["B"].width = 110
    _text(sheet, 1, 1, found.title).font = _TITLE
    row = _facts(sheet, 3, found.facts)
    if found.cautions:
        row = _heading(sheet, row + 1, "To be settled before a robot rides")
        row = _facts(sheet, row, (("", line) for line in found.cautions))
    for name, lift in zip(names, found.lifts, strict=True):
        row = _heading(sheet, row + 1, f"Lift {lift.name}")
        row = _facts(sheet, row, (("Sheet", name), *lift.facts))
    row = _heading(sheet, row + 1, "Signatures")
    for label in SIGNATURES:
        sheet.row_dimensions[row].height = 24
        row = _facts(sheet, row, ((label, ""),))
    _for_paper(sheet, found.title)


def _lift(sheet: Worksheet, found: IoList, lift: LiftList) -> None:
    for column, (heading, width) in enumerate(zip(COLUMNS, _WIDTHS, strict=True), start=1):
        sheet.column_dimensions[get_column_letter(column)].width = width
        _cell(sheet, 1, column, heading, _BOLD).fill = _HEAD
    for row, (point, cells) in enumerate(zip(lift.points, lift.rows, strict=True), start=2):
        for column, text in enumerate(cells, start=1):
            cell = _cell(sheet, row, column, text, _SMALL)
            if point.is_command and column <= len(cells) - SIGN_OFF:
                cell.fill = _COMMAND
    sheet.freeze_panes = "C2"
    sheet.print_title_rows = "1:1"
    sheet.auto_filter.ref = f"A1:{get_column_letter(len(COLUMNS))}{len(lift.points) + 1}"
    _for_paper(sheet, f"{found.title}, lift {lift.name}: {lift.map} on {lift.controller}")


def _facts(sheet: Worksheet, row: int, facts: Iterable[tuple[str, str]]) -> int:
    """Write rows of label and text. Returns the row after them."""
    for label, text in facts:
        _cell(sheet, row, 1, label, _BOLD).fill = _HEAD
        _cell(sheet, row, 2, text, _SMALL)
        row += 1
    return row


def _heading(sheet: Worksheet, row: int, text: str) -> int:
    _text(sheet, row, 1, text).font = _HEADING
    return row + 1


def _cell(sheet: Worksheet, row: int, column: int, text: str, font: Font) -> Cell:
    cell = _text(sheet, row, column, text)
    cell.font, cell.border, cell.alignment = font, _FRAME, _WRAPPED
    return cell


def _text(sheet: Worksheet, row: int, column: int, text: str) -> Cell:
    """Write a cell as text. A text that begins like a formula is marked, so that it stays text when somebody edits the cell."""
    cell = cast("Cell", sheet.cell(row, column))  # none of these sheets has merged cells
    if text:
        cell.value = text
        cell.data_type = "s"
        cell.quotePrefix = text.startswith(("=", "+", "-", "@"))
    return cell


def _for_paper(sheet: Worksheet, title: str) -> None:
    sheet.page_setup.orientation = "landscape"
    sheet.page_setup.paperSize = Worksheet.PAPERSIZE_A4
    sheet.page_setup.fitToWidth = 1
    sheet.page_setup.fitToHeight = 0
    sheet.sheet_properties.pageSetUpPr = PageSetupProperties(fitToPage=True)
    sheet.page_margins = PageMargins(left=0.4, right=0.4, top=0.6, bottom=0.5, header=0.25, footer=0.25)
    header, footer = HeaderFooterItem(), HeaderFooterItem()
    header.left.text = title.replace("&", "&&")
    footer.left.text = "&A"
    footer.right.text = "page &P of &N"
    sheet.oddHeader, sheet.oddFooter = header, footer
