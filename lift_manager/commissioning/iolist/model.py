"""The I/O list as plain text in cells, independent of the file format."""

from __future__ import annotations

from dataclasses import dataclass

COLUMNS = (
    "No.",
    "Signal",
    "Meaning",
    "Direction",
    "Printed address",
    "Table",
    "Address on the wire",
    "Unit id",
    "Function",
    "Values",
    "Normal state (NO/NC)",
    "Times",
    "Supplied by",
    "Remarks",
    "Tested by",
    "Date",
    "Result",
)
"""The headings of a lift's list. The last three columns are filled in on paper."""

SIGN_OFF = 3
"""How many columns are empty, to be filled in on paper."""

FROM_LIFT, TO_LIFT = "lift → manager", "manager → lift"


@dataclass(frozen=True, slots=True, kw_only=True)
class IoPoint:
    """One line of the list: a contact, coil, register, or field of a register."""

    signal: str
    meaning: str
    direction: str
    printed: str
    table: str
    wire: str
    unit_id: int
    function: str
    values: str
    contact: str
    times: str
    supplied_by: str
    remarks: str

    @property
    def is_command(self) -> bool:
        """Whether the manager writes it."""
        return self.direction == TO_LIFT


@dataclass(frozen=True, slots=True)
class LiftList:
    """The list of one lift."""

    name: str
    facts: tuple[tuple[str, str], ...]
    """Labels and texts: its address, map, floors and so on."""
    points: tuple[IoPoint, ...]
    controller: str
    map: str
    sha256: str

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """The cells of each line, in the order of `COLUMNS`."""
        empty = ("",) * SIGN_OFF
        return tuple(
            (
                *(str(number), point.signal, point.meaning, point.direction, point.printed, point.table, point.wire),
                *(str(point.unit_id), point.function, point.values, point.contact, point.times, point.supplied_by),
                *(point.remarks, *empty),
            )
            for number, point in enumerate(self.points, start=1)
        )


@dataclass(frozen=True, slots=True)
class IoList:
    """The list of one site."""

    site: str
    facts: tuple[tuple[str, str], ...]
    lifts: tuple[LiftList, ...]
    cautions: tuple[str, ...]

    @property
    def title(self) -> str:
        """The heading of every page."""
        return f"I/O list: {self.site}"


SIGNATURES = ("Issued by", "Date of issue", "Revision", "Checked by (lift company)", "Signature")
"""Lines on the cover that are filled in on paper."""
