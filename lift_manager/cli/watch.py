"""`lift-manager watch`: one lift, live, for people at its controller."""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, TextIO

import typer
from rich.console import Group, JustifyMethod, OverflowMethod, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from lift_manager.cli.active_machine import WithoutEtcd
from lift_manager.cli.common import fail, out, print_lines
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.own_manager import SiteOption, run_directly
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError, Refused, Unreachable
from lift_manager.commissioning.watch import text
from lift_manager.commissioning.watch.history import WINDOW_S, Change, History, Row, SignalQuality
from lift_manager.plain.http import MANAGER
from register_maps.error_texts import closest

MIN_POLL_S = 0.1
"""Chosen: nobody reads faster, and ten requests a second are little work for a manager."""
DRAW_EVERY_S = 0.25
FIRST_WITHIN_S = 5.0
"""How long `--once` waits for the first reading. Chosen: a controller that answers has answered several times by then."""
HEADINGS = ("signal", "value", "raw", "printed", "wire", "age s", "qual.", "changed")
FLEXIBLE = (1, 3, 4)
"""Which of the columns may be narrower than what is in them: value, printed, wire."""
MIN_WIDTH = 6
COLUMNS = ("time", "lift", "signal", "value", "raw", "address", "wire")
"""Of a recording."""


def watch(  # noqa: PLR0913  each is an option of the command line
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")],
    *,
    changed: Annotated[
        bool, typer.Option("--changed", help=f"Only the signals that changed within the last {WINDOW_S:.0f} s.")
    ] = False,
    signals: Annotated[
        list[str] | None,
        typer.Option("--signal", metavar="NAME", help="Only this signal; may be given several times."),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Print the table once; exit code 1 if it is old.")] = False,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FILE.csv", help="Write a line for each change to a new file as well."),
    ] = None,
    site: SiteOption = None,
    without_etcd: WithoutEtcd = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Show every signal of a lift, live.

    It also shows the car in its shaft, and the last minute. In a pipe it prints one line for each change instead. It only reads. Ctrl-C
    ends it.

    Example: lift-manager watch east --site site.yaml --record changes.csv
    """
    if record is not None and once:
        raise typer.BadParameter(
            "--once shows one moment, in which nothing changes; leave one of them out", param_hint="--record"
        )
    if record is not None and record.exists():
        raise fail(f"{record}: there already; give another name")
    watcher = Watcher(lift, tuple(signals or ()), is_recent=changed)
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)

    async def work(client: LiftManagerClient) -> None:
        if not once:
            await watcher.follow(client, log)
        elif not await watcher.print_once(client):
            raise typer.Exit(1)

    try:
        with _open_log(record) as log, suppress(KeyboardInterrupt):
            if site is None:
                connection.run(work)
            else:
                run_directly(site, work, name="watch", without_etcd=without_etcd)
    except OSError as error:
        raise fail(
            f"{error.filename or record or 'the output'}: cannot be written: {error.strerror or error}"
        ) from error


class Watcher:
    """Follows one lift and shows it."""

    def __init__(self, lift: str, signals: Sequence[str], *, is_recent: bool) -> None:
        """`is_recent`: only what changed lately."""
        self._name = lift
        self._names = signals
        self._is_recent = is_recent
        self._history = History(signals)
        self._was_live = True

    async def print_once(self, client: LiftManagerClient) -> bool:
        """Print the table; returns whether it is current."""
        await self._prepare(client)
        ends_s = _now() + FIRST_WITHIN_S
        await self._take(client)
        while not self._history.is_live(_now()) and _now() < ends_s:
            await asyncio.sleep(MIN_POLL_S)
            await self._take(client)
        out.print(self._view(is_traced=False))
        return self._history.is_live(_now())

    async def follow(self, client: LiftManagerClient, log: ChangeLog | None) -> None:
        """Show the lift until this is cancelled."""
        period_s = max(MIN_POLL_S, await self._prepare(client))
        if not out.is_terminal:
            await self._poll(client, period_s, log, is_printed=True)
        try:
            with Live(console=out, auto_refresh=False, screen=True) as live:
                await _first_of(self._poll(client, period_s, log, is_printed=False), self._draw(live))
        finally:
            # what was last seen stays on the terminal
            out.print(self._view(is_traced=True))

    async def _prepare(self, client: LiftManagerClient) -> float:
        """Check the names of lift and signals; return the period of the polls."""
        able = await client.capabilities(self._name)
        for name in self._names:
            if name not in able.signals:
                raise fail(
                    f"{self._name} has no signal {name!r}{closest(name, able.signals)}; it has {', '.join(able.signals)}"
                )
        return able.poll_s

    async def _poll(
        self, client: LiftManagerClient, period_s: float, log: ChangeLog | None, *, is_printed: bool
    ) -> None:
        while True:
            began_s = _now()
            try:
                changes = await self._take(client)
            except Refused:
                raise
            except ClientError as error:
                self._history.fail(error.text if isinstance(error, Unreachable) else str(error))
                changes = ()
            for change in changes:
                if log is not None:
                    log.change(self._name, change)
                if is_printed and not (self._is_recent and change.before is None):
                    print_lines([text.change_line(change, self._name)])
            if self._history.is_live(_now()) is not self._was_live:
                self._was_live = not self._was_live
                line = text.headline(self._history, _now())
                if log is not None:
                    log.note(self._name, line)
                if is_printed:
                    print_lines([f"{datetime.now().astimezone():%H:%M:%S} {line}"])
            await asyncio.sleep(max(0.0, began_s + period_s - _now()))

    async def _take(self, client: LiftManagerClient) -> tuple[Change, ...]:
        requested_s = _now()
        signals, lift = await asyncio.gather(client.signals(self._name), client.lift(self._name))
        return self._history.take(signals, lift, requested_s, datetime.now(UTC))

    async def _draw(self, live: Live) -> None:
        while True:
            live.update(self._view(is_traced=True, height=out.height), refresh=True)
            await asyncio.sleep(DRAW_EVERY_S)

    def _view(self, *, is_traced: bool, height: int | None = None) -> RenderableType:
        """Return everything, of which the table and the shaft are cut where they are higher than the terminal."""
        now_s, is_live = _now(), self._history.is_live(_now())
        head = Text(text.headline(self._history, now_s), style="" if is_live else "bold reverse")
        rows = list(self._history.rows(now_s, recent=self._is_recent))
        columns = max(20, min(60, out.width - 16))
        traced = text.trace(self._history, now_s, columns=columns, is_unicode=_is_unicode()) if is_traced else []
        if height is None:
            shaft, most = text.shaft(self._history, now_s), len(rows)
        else:
            spare = height - len(traced) - 5 - len(head.wrap(out, out.width))
            shaft = text.shaft(self._history, now_s, rows=max(4, spare - len(rows)))
            most = max(1, spare - len(shaft))
        parts: list[RenderableType] = [
            head,
            "",
            Text("\n".join(shaft)),
            "",
            signal_table(rows[:most], width=out.width, is_cut=height is not None),
        ]
        if len(rows) > most:
            parts.append(Text(f"... {len(rows) - most} more: a higher terminal, --signal or --changed shows them"))
        if self._is_recent and not rows:
            parts.append(Text(f"no signal has changed within the last {WINDOW_S:.0f} s"))
        if traced:
            parts += ["", Text("\n".join(traced), no_wrap=True, overflow="crop")]
        return Group(*parts)


class ChangeLog:
    """A file with a line for each change, for spreadsheets."""

    def __init__(self, file: TextIO) -> None:
        """`file` is new."""
        self._file = file
        self._writer = csv.writer(file)
        self._write(COLUMNS)

    def change(self, lift: str, change: Change) -> None:
        """Write a change."""
        signal = change.signal
        raw = "" if signal.raw is None else signal.raw
        addresses, wire = ", ".join(signal.addresses), ", ".join(signal.wire)
        self._write((_stamp(change.at), lift, signal.name, text.value_text(signal.value), raw, addresses, wire))

    def note(self, lift: str, line: str) -> None:
        """Write that a lift has become offline, or live; no signal has a line of that kind."""
        self._write((_stamp(datetime.now(UTC)), lift, "", line, "", "", ""))

    def _write(self, cells: Sequence[object]) -> None:
        self._writer.writerow(cells)
        self._file.flush()


@contextmanager
def _open_log(path: Path | None) -> Iterator[ChangeLog | None]:
    if path is None:
        yield None
        return
    with path.open("x", encoding="utf-8", newline="") as file:
        yield ChangeLog(file)


def signal_table(rows: Sequence[Row], *, width: int, is_cut: bool) -> Table:
    """Return the table of signals. Where it is wider than `width`, values and addresses are cut or folded, and nothing else."""
    cells = [text.cells(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(HEADINGS, *cells, strict=True)]
    while sum(widths) + len(widths) - 1 > width and max(widths[index] for index in FLEXIBLE) > MIN_WIDTH:
        widths[max(FLEXIBLE, key=lambda index: widths[index])] -= 1
    table = Table(box=None, pad_edge=False, header_style="", padding=(0, 1, 0, 0))
    for index, heading in enumerate(HEADINGS):
        justify: JustifyMethod = "right" if heading in ("raw", "age s") else "left"
        overflow: OverflowMethod = "ellipsis" if is_cut else "fold"
        table.add_column(heading, width=widths[index], no_wrap=is_cut, overflow=overflow, justify=justify)
    for row, line in zip(rows, cells, strict=True):
        style = "bold" if row.is_recent else "" if row.quality is SignalQuality.OK else "reverse"
        table.add_row(*map(Text, line), style=style)
    return table


async def _first_of(*work: Coroutine[None, None, None]) -> None:
    """Run work until the first of it ends; raise what that raised."""
    tasks = [asyncio.create_task(one) for one in work]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _is_unicode() -> bool:
    return out.encoding.lower().startswith("utf")


def _stamp(at: datetime) -> str:
    return at.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _now() -> float:
    return asyncio.get_running_loop().time()
