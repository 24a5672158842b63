"""Writes down refusals and logins that concern no lift: a few a minute one by one, the rest counted. Counts every refusal."""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn, Protocol

from drivers.rate_limits import RowRateLimiter, get_or_add
from lift_manager.lift.journal import Json, Row, RowKind, short
from lift_manager.lift.refusals import Refused
from lift_manager.runtime.errors import raised

REFUSALS = 10
"""How many refusals of one caller, and logins of one key, get rows of their own, a minute. Chosen: as many as the log has lines
for them."""


@dataclass(frozen=True, slots=True)
class FaceRefusal:
    """A request that a face refused by itself: for its key, its role, or the lift that it named."""

    code: str
    text: str
    """Why, in our own words: nothing that a caller sent, and no secret."""
    lift: str = ""
    """As the caller named it, if it did."""
    caller: str = ""
    """`<face>:<name>` of a key that is valid here; empty without one."""
    address: str = ""


class Rows(Protocol):
    """The recorder of rows."""

    def note(self, row: Row) -> None:
        """Write this down soon."""
        ...


class RefusalLog:
    """The refusals of a site."""

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        self._limiters: OrderedDict[tuple[RowKind, str], RowRateLimiter] = OrderedDict()
        """By caller. Those without a key are one, and so are people: they sign with any name."""
        self.counts: Counter[tuple[str, str]] = Counter()
        """Every refusal, written down or not, by lift and code; the lift is empty if none of the site was named."""
        self.on_raised: list[Callable[[str, Refused], None]] = []
        """Called with every refusal that is raised, and the same lift."""

    def refuse(self, lift: str, refused: Refused) -> NoReturn:
        """Count a refusal, and raise it."""
        self.count(lift, refused.code)
        for receive in self.on_raised:
            receive(lift, refused)
        raise raised(refused)

    def count(self, lift: str, code: str) -> None:
        """Count a refusal, whoever writes it down."""
        self.counts[lift, str(code)] += 1

    def turned_away(self, who: FaceRefusal) -> None:
        """Record a request that reached no lift."""
        text = f"refused: {who.text}" + (f", from {who.address}" if who.address else "")
        data: dict[str, Json] = {"refused": who.code, "address": who.address}
        self._note(
            (RowKind.REQUEST, who.caller), who.code, Row(RowKind.REQUEST, text, short(who.lift), who.caller, data)
        )

    def person_refused(self, lift: str, by: str, action: str, *, code: str, message: str) -> None:
        """Record a person's decision that was refused; `action` is which."""
        data: dict[str, Json] = {"said": action, "refused": code}
        row = Row(RowKind.PERSON, f"{action} refused: {message}", short(lift), by, data)
        self._note((RowKind.PERSON, ""), code, row)

    def login(self, key: str, address: str, *, ended: bool) -> None:
        """Record that a browser logged in with a key, or out."""
        word = "logged_out" if ended else "logged_in"
        text = f"a browser logged {'out' if ended else 'in'}" + (f", from {address}" if address else "")
        data: dict[str, Json] = {"done": word, "address": address}
        self._note((RowKind.KEY, key), word, Row(RowKind.KEY, text, "", key, data), differs=True)

    def report(self, *, end: bool = False) -> None:
        """Write the rows of what was counted for a minute, or of everything at the end."""
        now = asyncio.get_running_loop().time()
        for whose, limiter in self._limiters.items():
            if end or limiter.is_due(now):
                self._limiters[whose] = self._reported(whose, limiter, now)

    def _note(self, whose: tuple[RowKind, str], code: str, row: Row, *, differs: bool = False) -> None:
        now = asyncio.get_running_loop().time()
        limiter, gone = get_or_add(self._limiters, whose, lambda: RowRateLimiter(REFUSALS))
        if gone is not None:
            self._reported(*gone, now)
        limiter, is_admitted = limiter.admit((row.lift, row.caller, row.text), now, differs=differs)
        if not is_admitted:
            limiter = limiter.count(code, now)
        if is_admitted or limiter.is_due(now):
            limiter = self._reported(whose, limiter, now)
        self._limiters[whose] = limiter
        if is_admitted:
            self._rows.note(row)

    def _reported(self, whose: tuple[RowKind, str], limiter: RowRateLimiter, now: float) -> RowRateLimiter:
        """Write the row of what was only counted; return the limiter after that."""
        answers, for_s = limiter.counts, now - limiter.counted_since
        if not answers:
            return limiter
        kind, caller = whose
        times, shown = sum(answers.values()), ", ".join(f"{count} {code}" for code, count in sorted(answers.items()))
        what = "logged in or out" if kind is RowKind.KEY else "refused"
        more = "once more" if times == 1 else f"{times} more times"
        text = f"{what} {more} within {for_s:.0f} s: {shown}"
        self._rows.note(Row(kind, text, "", caller, {"times": times, "answers": dict(answers)}))
        return limiter.cleared()
