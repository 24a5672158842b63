"""A recording as lines for people: one for each exchange, with signals and commands by name where they are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lift_manager.commissioning.trace.exchanges import Exchange, exchanges
from lift_manager.commissioning.trace.names import Names, SignalChange
from lift_manager.commissioning.trace.record import Counts, answer_text
from lift_manager.commissioning.trace.recording import Gap, Recording
from lift_manager.plain.text import counted
from register_maps import frames


@dataclass(frozen=True, slots=True)
class Filter:
    """Which exchanges are shown: those that pass each of these."""

    signals: frozenset[str] = frozenset()
    """Reads of one of these signals, and nothing else in their answers; empty for everything."""
    writes: bool = False
    """Writes only."""
    errors: bool = False
    """Exceptions, missing answers, answers that do not fit, and gaps only."""
    changes: bool = False
    """No reads that return what the same request returned before."""

    @property
    def is_empty(self) -> bool:
        """Whether everything passes."""
        return self == Filter()


def lines(recording: Recording, names: Names, shown: Filter) -> Iterator[str]:
    """Yield a line for each exchange and gap that the filter lets through."""
    before: dict[bytes, tuple[int, ...] | None] = {}
    for item in exchanges(recording.items):
        when = recording.time_of(item.at_s).astimezone().strftime("%H:%M:%S.%f")[:-3]
        if isinstance(item, Gap):
            if shown.errors or shown.is_empty:
                yield f"{when}          GAP: {item.reason}"
            continue
        signals = names.signals_in(item)
        key = b"" if item.request is None else item.request.frame[2:]
        is_same = item.values is not None and before.get(key) == item.values
        before[key] = item.values
        if _passes(item, names, shown, is_same=is_same):
            took = "       " if item.took_s is None else f"{item.took_s * 1000:4.0f} ms"
            chosen = tuple(one for one in signals if not shown.signals or one.name in shown.signals)
            if not shown.signals or not shown.changes or any(one.has_changed for one in chosen):
                yield f"{when} {took}  {_text(item, names, chosen, is_same=is_same)}"


def summary(recording: Recording) -> str:
    """Return what a recording holds, on one line."""
    found = exchanges(recording.items)
    counts = Counts(gaps=sum(isinstance(item, Gap) for item in found))
    counts.add(item for item in found if isinstance(item, Exchange))
    lasted_s = recording.items[-1].at_s - recording.items[0].at_s if recording.items else 0.0
    counts.frames = sum(not isinstance(item, Gap) for item in recording.items)
    return summary_of(counts, lasted_s)


def summary_of(counts: Counts, lasted_s: float) -> str:
    """Return counts of a recording, on one line."""
    parts = [
        f"{counted(counts.frames, 'frame')} in {lasted_s:.1f} s",
        counted(counts.writes, "write"),
        counted(counts.exceptions, "exception"),
        f"{counts.troubles} without a right answer",
        *([counted(counts.gaps, "gap")] if counts.gaps else []),
    ]
    return ", ".join(parts)


def _passes(exchange: Exchange, names: Names, shown: Filter, *, is_same: bool) -> bool:
    if shown.writes and not exchange.is_write:
        return False
    if shown.errors and not exchange.is_error:
        return False
    if shown.changes and is_same:
        return False
    request = exchange.parsed
    return not shown.signals or (request is not None and any(names.reads(request, name) for name in shown.signals))


def _text(exchange: Exchange, names: Names, signals: tuple[SignalChange, ...], *, is_same: bool) -> str:
    if exchange.request is None:
        answer = b"" if exchange.answer is None else exchange.answer.frame
        return f"ANSWER TO NO REQUEST: {frames.describe_answer(answer)}"
    request = frames.describe(exchange.request.frame)
    if exchange.is_write and exchange.parsed is not None:
        commanded = ", ".join(names.commands_in(exchange.parsed))
        request = f"WRITE {request.removeprefix('write ')}" + (f" = {commanded}" if commanded else "")
    if exchange.answer is None:
        return f"{request}: NO ANSWER"
    if exchange.is_error:
        return f"{request}: {answer_text(exchange).replace('exception', 'EXCEPTION', 1)}"
    if exchange.is_write:
        return f"{request}: done"
    if not signals and exchange.values is not None:
        return f"{request}: {' '.join(map(str, exchange.values))}"
    if not signals:
        return f"{request}: {answer_text(exchange)}"
    changed = ", ".join(_changed(one) for one in signals if one.has_changed)
    return f"{request}: {changed or ('unchanged' if is_same else 'the same signals')}"


def _changed(signal: SignalChange) -> str:
    return f"{signal.name} {signal.value}" + (f" (was {signal.before})" if signal.before is not None else "")
