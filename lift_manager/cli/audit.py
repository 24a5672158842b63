"""`lift-manager audit`: show, follow, export and verify the journal of a site."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Annotated, BinaryIO
from zoneinfo import ZoneInfo

import typer

from lift_manager.cli.audit_text import RowTable, escape_unprintable, write_csv, write_jsonl
from lift_manager.cli.common import err, fail, load_site_or_exit, out, print_lines, print_stderr, store_path_of
from lift_manager.config.site import Site
from lift_manager.lift.journal import RowKind
from lift_manager.store.chain import StoredRow
from lift_manager.store.errors import ChainBroken, JournalUnreadable
from lift_manager.store.read import (
    ALL_ROWS,
    Follower,
    RowFilter,
    microseconds,
    open_journal,
    time_of,
)
from lift_manager.store.verify import Chain, Seal, read_seal, verify

LAST = 50
"""Rows of a table by default."""
LAST_FOLLOWED = 10
"""Rows that `--follow` shows before new ones."""
LOOK_S = 0.25
"""From one check for new rows to the next. Chosen: immediate for a person, negligible for a computer."""

_DAY_US = 86_400_000_000
_NEARLY_FULL = 0.9
"""Of `max_mb`: a journal that is cut because of its size stays above this."""
_AGO = re.compile(r"([0-9]{1,6})([smhdw])")
_DAY = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")
_UNITS = {"s": "seconds", "m": "minutes", "h": "hours", "d": "days", "w": "weeks"}
SiteOption = Annotated[
    Path | None, typer.Argument(metavar="SITE", help="The site file. The journal is where `serve` keeps it.")
]
JournalOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="This file instead: a copy, or a journal that was moved away.")
]
OfLift = Annotated[str | None, typer.Option(metavar="LIFT", help="Rows of this lift.")]
Kinds = Annotated[list[RowKind] | None, typer.Option("--kind", help="Rows of this kind; may be given more than once.")]
Caller = Annotated[
    str | None, typer.Option(metavar="CALLER", help="Rows of this caller, as in the table, or of a face.")
]
Since = Annotated[
    str | None,
    typer.Option(metavar="TIME", help="A date, a time by the building's clock, both, or how long ago: 2h, 3d."),
]
Until = Annotated[str | None, typer.Option(metavar="TIME", help="Before this time; of a date, its end.")]
Last = Annotated[
    int | None,
    typer.Option(min=0, max=1_000_000, metavar="N", help=f"The newest N of them; {LAST} in a table by default."),
]
Find = Annotated[str | None, typer.Option(metavar="TEXT", help="Rows with this in their text, in capitals or not.")]
OfEvent = Annotated[
    str | None,
    typer.Option(
        "--event", metavar="ID", help="The row of this event, whose id is in the log and in the event stream."
    ),
]
Follow = Annotated[bool, typer.Option("--follow", help="Go on with new rows as they come, until Ctrl-C.")]
Csv = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Write every column for a spreadsheet; - prints it.")
]
Jsonl = Annotated[
    Path | None,
    typer.Option("--jsonl", metavar="FILE", help="Write every column, a JSON object per line; - prints it."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]
Verify = Annotated[
    bool, typer.Option("--verify", help="Verify the whole chain: no row was changed and none is missing.")
]
SinceSeal = Annotated[
    str | None,
    typer.Option(
        metavar="SEAL",
        help="Verify, and compare with the seal that --verify printed earlier: NUMBER:HASH, or 'NUMBER:HASH from FIRST'.",
    ),
]


@dataclass(frozen=True, slots=True)
class JournalSource:
    """A journal, and its site."""

    path: Path
    site: Site | None
    """None if only a journal file was given."""
    copy: bool

    @property
    def zone(self) -> tzinfo | None:
        """The time zone of the building; None for that of this computer."""
        return ZoneInfo(self.site.timezone) if self.site is not None and self.site.timezone is not None else None


def audit(  # noqa: PLR0913  a parameter per option
    site: SiteOption = None,
    *,
    journal: JournalOption = None,
    lift: OfLift = None,
    kinds: Kinds = None,
    caller: Caller = None,
    since: Since = None,
    until: Until = None,
    last: Last = None,
    find: Find = None,
    event: OfEvent = None,
    follow: Follow = False,
    as_csv: Csv = None,
    as_jsonl: Jsonl = None,
    force: Force = False,
    verified: Verify = False,
    since_seal: SinceSeal = None,
) -> None:
    """Show, export and verify the journal.

    It says who requested what, what was written to the lift because of it, and the outcome.

    Example: lift-manager audit site.yaml --lift main --since 2h
    """
    seal = _seal(since_seal)
    walk = verified or seal is not None
    _require_one_of(
        {"--follow": follow, "--csv": as_csv is not None, "--jsonl": as_jsonl is not None, "--verify": walk}
    )
    if walk and (lift, kinds, caller, since, until, last, find, event) != (None,) * 8:
        raise typer.BadParameter("the whole chain is verified; leave out what chooses rows", param_hint="--verify")
    source = _journal_source(site, journal)
    now = datetime.now(UTC).astimezone(source.zone)
    row_filter = RowFilter(lift, frozenset(kinds or ()), caller, _since(since, now), _until(until, now), find, event)
    try:
        if walk:
            _verify(source, seal)
        elif as_csv is not None:
            _export(source, row_filter, last, as_csv, write_csv, force=force)
        elif as_jsonl is not None:
            _export(source, row_filter, last, as_jsonl, write_jsonl, force=force)
        elif follow:
            _follow(source, row_filter, LAST_FOLLOWED if last is None else last)
        else:
            _show(source, row_filter, last)
    except JournalUnreadable as error:
        raise fail(escape_unprintable(str(error))) from error


def _show(source: JournalSource, row_filter: RowFilter, last: int | None) -> None:
    count = LAST if last is None else last
    with open_journal(source.path, copy=source.copy) as reader:
        found = reader.newest(row_filter, count + 1)
    rows = found[-count:] if count else []
    if not rows:
        print_stderr(_no_rows_message(source, row_filter, any_rows=bool(found)))
        return
    if len(found) > count and last is None:
        err.print(f"the newest {count} rows; --last N shows more", style="dim", highlight=False)
    RowTable(out, source.zone, rows, _lifts(source)).show(rows)


def _follow(source: JournalSource, row_filter: RowFilter, count: int) -> None:
    with open_journal(source.path, copy=source.copy) as reader:
        newest = next(iter(reader.newest(ALL_ROWS, 1)), None)
        rows = reader.newest(row_filter, count, newest.seq if newest is not None else None)
    table = RowTable(out, source.zone, rows, _lifts(source))
    follower = Follower(source.path, row_filter, newest, copy=source.copy)
    try:
        table.show(rows)
        while True:
            news = follower.poll()
            if news.replaced:
                err.print(
                    f"{source.path}: another journal is in its place; these are its rows", markup=False, soft_wrap=True
                )
            if news.cut is not None:
                err.print("rows {} to {} were cut before they could be shown".format(*news.cut), highlight=False)
            table.show(news.rows)
            time.sleep(LOOK_S)
    except KeyboardInterrupt:
        return  # Ctrl-C is the normal end
    finally:
        follower.close()


def _verify(source: JournalSource, seal: Seal | None) -> None:
    with open_journal(source.path, copy=source.copy) as reader:
        try:
            chain = verify(reader, reader.site if source.site is None else source.site.name, seal)
        except ChainBroken as broken:
            with suppress(JournalUnreadable):
                if (row := reader.row(broken.seq)) is not None:
                    RowTable(out, source.zone, [row], ()).show([row])
            raise fail(escape_unprintable(f"{source.path}: {broken}")) from broken
        print_lines(_verdict(source, escape_unprintable(reader.site), chain, seal))


def _verdict(source: JournalSource, site: str, chain: Chain, seal: Seal | None) -> Iterator[str]:
    yield f"{source.path}: the chain of the site {site} holds"
    if chain.newest is None:
        yield "rows    none"
        return
    newest = chain.newest
    at = time_of(newest).astimezone(source.zone)
    yield f"rows    {chain.rows}, from {chain.first} to {newest.seq}"
    if chain.cut is not None:
        yield f"cut     rows up to {chain.cut.through} were cut, says row {chain.cut.anchor}"
        yield from _unexpected_cut(source, chain)
    if seal is not None:
        yield f"noted   row {seal.seq} is the one that was noted"
        if seal.first is not None:
            gone = f"rows {seal.first} to {chain.first - 1} were there then, and were cut since"
            yield f"        {gone if chain.first > seal.first else 'no row was cut since'}"
    yield f"newest  {at:%Y-%m-%d %H:%M:%S.%f %z}"
    yield f"seal    {newest.seq}:{newest.hash.hex()} from {chain.first}"
    yield "Keep the seal in another place; `--since-seal` shows later that nothing up to it was rewritten, and which rows were cut."


def _unexpected_cut(source: JournalSource, chain: Chain) -> Iterator[str]:
    """Yield a warning if rows were cut that the site file keeps: there may be a good reason, but somebody should know it."""
    cut, oldest = chain.cut, chain.oldest
    if source.site is None or cut is None or oldest is None:
        return
    keeps, megabytes = source.site.journal, source.path.stat().st_size / 1e6
    days = (cut.at - oldest.at) / _DAY_US
    if days >= keeps.keep_days - 1 or megabytes >= _NEARLY_FULL * keeps.max_mb:
        return
    remaining = f"that cut left rows of the last {max(days, 0):.0f} days"
    yield f"odd     {remaining}; the site file keeps {keeps.keep_days}, and the journal has {megabytes:.0f} of {keeps.max_mb} MB:"
    yield "        were `keep_days` or `max_mb` smaller then, was the clock wrong, was no manager running, or has somebody cut it?"


def _export(
    source: JournalSource,
    row_filter: RowFilter,
    last: int | None,
    path: Path,
    write: Callable[[Iterable[StoredRow], BinaryIO], int],
    *,
    force: bool,
) -> None:
    with open_journal(source.path, copy=source.copy) as reader:
        rows = reader.rows(row_filter) if last is None else reader.newest(row_filter, last)
        if str(path) == "-":
            write(rows, sys.stdout.buffer)
            return
        if path.exists() and not (force and path.is_file()):
            raise fail(f"{path}: there already; give another name, or --force to replace a file")
        part_file = path.with_name(f"{path.name}.part")
        try:
            with part_file.open("wb") as file:
                if write is write_csv:
                    file.write(b"\xef\xbb\xbf")  # without it a spreadsheet does not read letters beyond ASCII
                count = write(rows, file)
            part_file.replace(path)
        except OSError as error:
            raise fail(f"{path} cannot be written: {error.strerror or error}") from error
        finally:
            part_file.unlink(missing_ok=True)
    print_lines([f"{count} row{'' if count == 1 else 's'} in {path}"])


def _journal_source(site: Path | None, journal: Path | None) -> JournalSource:
    if site is None:
        if journal is None:
            raise typer.BadParameter("name the site file, or a journal with --journal FILE", param_hint="SITE")
        return JournalSource(journal, None, copy=True)
    loaded = load_site_or_exit(site)
    if journal is not None:
        return JournalSource(journal, loaded.site, copy=True)
    return JournalSource(store_path_of(loaded), loaded.site, copy=False)


def _lifts(source: JournalSource) -> Iterable[str]:
    return () if source.site is None else source.site.lifts


def _no_rows_message(source: JournalSource, row_filter: RowFilter, *, any_rows: bool) -> str:
    if row_filter.lift is not None and source.site is not None and row_filter.lift not in source.site.lifts:
        return f"no row is of a lift {row_filter.lift!r}; the lifts of this site are {', '.join(source.site.lifts)}"
    if any_rows or row_filter == ALL_ROWS:
        return "no rows"
    return "no row matches"


def _require_one_of(options: dict[str, bool]) -> None:
    given = [option for option, is_given in options.items() if is_given]
    if len(given) > 1:
        raise typer.BadParameter(f"{' and '.join(given)} do not go together; give one of them", param_hint=given[1])


def _seal(text: str | None) -> Seal | None:
    try:
        return None if text is None else read_seal(text)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--since-seal") from error


def _since(text: str | None, now: datetime) -> int | None:
    return None if text is None else microseconds(_moment(text, now, "--since")[0])


def _until(text: str | None, now: datetime) -> int | None:
    return None if text is None else microseconds(_moment(text, now, "--until")[1])


def _moment(text: str, now: datetime, option: str) -> tuple[datetime, datetime]:
    """Return the begin and end of a time: a date is a whole day, everything else a moment."""
    zone = now.tzinfo if isinstance(now.tzinfo, ZoneInfo) else None
    try:
        if ago := _AGO.fullmatch(text):
            moment = now - timedelta(**{_UNITS[ago[2]]: int(ago[1])})
        elif _DAY.fullmatch(text):
            day = datetime.fromisoformat(text)
            return _at(day, zone), _at(day + timedelta(days=1), zone)
        else:
            moment = _at(datetime.fromisoformat(f"{now:%Y-%m-%d}T{text}" if text[2:3] == ":" else text), zone)
    except (ValueError, OverflowError) as error:
        advice = "write 2026-11-21, 18:30, 2026-11-21T18:30, or how long ago, such as 90s, 30m, 2h, 3d, 1w"
        raise typer.BadParameter(f"{text!r} is no time; {advice}", param_hint=option) from error
    return moment, moment


def _at(moment: datetime, zone: tzinfo | None) -> datetime:
    """Convert to UTC; a time without a zone is by the building's clock, or else by this computer's."""
    if moment.tzinfo is None and zone is not None:
        moment = moment.replace(tzinfo=zone)
    return moment.astimezone(UTC)
