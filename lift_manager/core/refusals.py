"""Writes down whom a site refused before any lift was asked, and what people were refused; a few a minute, and the rest counted."""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict

from drivers.sparing import Sparing, newest
from lift_manager.core.journal import Journal
from lift_manager.domain import journal_rows as rows
from lift_manager.domain.asking import Refused, TurnedAway
from lift_manager.domain.journal import Row, RowKind

REFUSALS = 10
"""Refusals of one caller that have rows of their own, a minute. Chosen: as many as the log has lines for them."""


class RefusalLog:
    """The refusals of a site."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._sparing: OrderedDict[tuple[RowKind, str], Sparing] = OrderedDict()
        """By caller. Those without a key are one, and so are people: they sign with any name."""
        self.counts: Counter[tuple[str, str]] = Counter()
        """Every refusal, written down or not, by lift and code; the lift is empty where none of the site was named."""

    def count(self, lift: str, code: str) -> None:
        """Count a refusal, whoever writes it down."""
        self.counts[lift, str(code)] += 1

    def turned_away(self, who: TurnedAway) -> None:
        """Note a request that reached no lift."""
        self._note((RowKind.REQUEST, who.caller), who.code, rows.turned_away(who))

    def person_refused(self, lift: str, by: str, said: str, refused: Refused) -> None:
        """Note a person's word that was not taken; `said` is which."""
        self._note((RowKind.PERSON, ""), refused.code, rows.person_refused(lift, by, said, refused))

    def tell(self, *, end: bool = False) -> None:
        """Write down what was counted for a minute, or at the end all of it."""
        now = asyncio.get_running_loop().time()
        for whose, sparing in self._sparing.items():
            if end or sparing.due(now):
                self._tell(whose, sparing, now)

    def _note(self, whose: tuple[RowKind, str], code: str, row: Row) -> None:
        now = asyncio.get_running_loop().time()
        sparing, gone = newest(self._sparing, whose, lambda: Sparing(REFUSALS))
        if gone is not None:
            self._tell(*gone, now)
        if sparing.admits((row.lift, row.caller, row.text), now):
            self._tell(whose, sparing, now)
            self._journal.note(row)
            return
        sparing.count(code, now)
        if sparing.due(now):
            self._tell(whose, sparing, now)

    def _tell(self, whose: tuple[RowKind, str], sparing: Sparing, now: float) -> None:
        if sparing.counts:
            self._journal.note(rows.refused_more(*whose, *sparing.told(now)))
