"""`lift-manager trace`: record every frame of a link, and read what was recorded."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Iterator
from contextlib import ExitStack, aclosing, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live
from rich.text import Text

from lift_manager.cli.active_machine import WithoutEtcd
from lift_manager.cli.common import (
    Floors,
    duration_s,
    err,
    fail,
    load_map_or_exit,
    load_site_or_exit,
    print_lines,
    print_stderr,
    read_floors,
)
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.own_manager import SiteOption, run_directly
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.stream import Connected, StreamEvent
from lift_manager.commissioning.trace.names import Names, TracedLift, lifts_of_map, lifts_of_site
from lift_manager.commissioning.trace.pcapng import PcapngWriter
from lift_manager.commissioning.trace.record import Recorder, Sink
from lift_manager.commissioning.trace.recording import (
    Header,
    Item,
    Recording,
    RecordingUnusable,
    header_line,
    item_line,
    read_recording,
)
from lift_manager.commissioning.trace.show import Filter, lines, summary, summary_of
from lift_manager.plain.http import MANAGER
from lift_manager.plain.text import counted
from lift_manager.plain.version import running_version
from lift_manager.runtime.links import WireFrame
from lift_manager.web.events.frames import encode_frame
from register_maps.error_texts import closest

app = typer.Typer(no_args_is_help=True, help="Record every Modbus frame of a link, and read a recording.")

SILENT_S = 5.0
"""After this long without a frame the progress names the link. Chosen: every lift is polled more often."""


def _duration(text: str) -> float:
    found = duration_s(text.strip(), ("", "s", "m", "h"))
    if not found:
        raise typer.BadParameter(f"{text!r}: write a time such as 30s, 10m or 1h")
    return found


@app.command()
def record(  # noqa: PLR0913  each is an option of the command line
    link: Annotated[
        str,
        typer.Argument(
            metavar="LINK",
            help="The controller, by its name in the site file; may be left out where there is only one.",
            show_default=False,
        ),
    ] = "",
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="NAME", help="Write NAME.jsonl, and NAME.pcapng for Wireshark.")
    ],
    for_s: Annotated[
        float | None,
        typer.Option(
            "--for",
            metavar="TIME",
            parser=_duration,
            help="End after 30s, 10m or 1h; Ctrl-C ends it too.",
            show_default=False,
        ),
    ] = None,
    site: SiteOption = None,
    without_etcd: WithoutEtcd = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Record every frame between the manager and one controller.

    It writes a file for `trace show` and one for Wireshark, and nothing to a lift. Where the manager has keys, this needs one with the
    role commissioner. With --site it polls the lifts itself, in place of a manager, and records from the first frame of the connection.

    Exit code 1 if the controller gave no answer.

    Example: lift-manager trace record plc -o door-problem --for 30s
    """
    recording = _OpenRecording(_path(output, ".jsonl"), _path(output, ".pcapng"), for_s)
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    try:
        with suppress(KeyboardInterrupt):
            if site is None:
                connection.run(lambda client: recording.record(client, link))
            else:
                own = _OwnFrames()
                run_directly(
                    site,
                    lambda client: recording.record(client, link, own),
                    name="trace",
                    on_frame=own.put,
                    without_etcd=without_etcd,
                )
    except OSError as error:
        raise fail(f"{error.filename or output}: cannot be written: {error.strerror or error}") from error
    recorder = recording.recorder
    if recorder is None:
        raise typer.Exit(1)
    recorder.end()
    what = summary_of(recorder.counts, recorder.lasted_s)
    print_lines([f"{recording.jsonl} and {recording.pcapng.name}: {what}"])
    if not recorder.counts.answers:
        why = f"`lift-manager doctor {site}`" if site else "`lift-manager lifts`"
        raise fail(f"{recording.link}: the controller gave no answer; {why} shows why")


@app.command()
def show(  # noqa: PLR0913  each is an option of the command line
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The .jsonl file of a recording.")],
    *,
    site: Annotated[
        Path | None, typer.Option("--site", metavar="SITE", help="Name what is in it, as in this site file.")
    ] = None,
    lift: Annotated[
        str, typer.Option("--lift", metavar="LIFT", help="With --site: one of its lifts.", show_default=False)
    ] = "",
    map_name: Annotated[
        str | None, typer.Option("--map", metavar="MAP", help="Name what is in it, as in this map.")
    ] = None,
    floors: Floors = "",
    signals: Annotated[
        list[str] | None,
        typer.Option("--signal", metavar="NAME", help="Only reads of this signal; may be given several times."),
    ] = None,
    writes: Annotated[bool, typer.Option("--writes", help="Only writes.")] = False,
    errors: Annotated[
        bool, typer.Option("--errors", help="Only exceptions, missing and unfitting answers, and gaps.")
    ] = False,
    changes: Annotated[
        bool, typer.Option("--changes", help="No reads that return the same as the time before.")
    ] = False,
) -> None:
    """Show a recording: one line for each request with its answer.

    With --site or --map, signals and commands have their names.

    Example: lift-manager trace show door-problem.jsonl --map generic-registers --changes
    """
    try:
        recording = read_recording(file)
    except RecordingUnusable as error:
        raise fail(str(error)) from error
    names = Names(_lifts(recording, site, lift, map_name, floors))
    for name in signals or ():
        if name not in names.signals:
            known = (
                closest(name, names.signals)
                or f"; there is {', '.join(names.signals) or 'none without --site or --map'}"
            )
            raise typer.BadParameter(f"no signal {name!r}{known}", param_hint="--signal")
    print_lines(lines(recording, names, Filter(frozenset(signals or ()), writes, errors, changes)))
    began = recording.header.began.astimezone().strftime("%Y-%m-%d %H:%M:%S")
    print_stderr(f"{recording.header.link}, {began}: {summary(recording)}")


def _lifts(
    recording: Recording, site: Path | None, lift: str, map_name: str | None, floors: str
) -> tuple[TracedLift, ...]:
    if site is not None and map_name is not None:
        raise typer.BadParameter("the site names its maps; give --site or --map", param_hint="--map")
    if lift and site is None:
        raise typer.BadParameter("a lift is one of a site; give --site too", param_hint="--lift")
    if map_name is not None:
        return lifts_of_map(load_map_or_exit(map_name).map, read_floors(floors))
    if site is None:
        return ()
    loaded, link = load_site_or_exit(site), recording.header.link
    found = lifts_of_site(loaded, link, lift)
    if not found:
        whose = f"lift {lift!r}" if lift else "no lift"
        raise fail(
            f"{site}: {whose} is on the link {link!r} of the recording; --map MAP names its signals without a site"
        )
    return found


def _path(output: Path, ending: str) -> Path:
    stem = output.name.removesuffix(".jsonl").removesuffix(".pcapng")
    path = output.with_name(stem + ending)
    if path.exists():
        raise fail(f"{path}: there already; give another name")
    return path


@dataclass
class _OpenRecording:
    """A recording under way, and its files."""

    jsonl: Path
    pcapng: Path
    for_s: float | None
    """How long it is to last; None until Ctrl-C."""
    link: str = ""
    recorder: Recorder | None = None

    async def record(self, client: LiftManagerClient, link: str, own: _OwnFrames | None = None) -> None:
        """Record a link until the time is over, or this is cancelled, with `own` from its first frame on.

        Raises OSError where a file cannot be written.
        """
        self.link = await _chosen(client, link)
        began, began_at_s = (datetime.now(UTC), None) if own is None else own.beginning_of(self.link)
        header = Header(self.link, began, f"lift-manager {running_version()}")
        frames = client.frames(self.link) if own is None else aclosing(own.of(self.link))
        with self._files(header) as sink:
            self.recorder = Recorder(header, sink, began_at_s=began_at_s)
            with self._progress(self.recorder), suppress(TimeoutError):
                async with asyncio.timeout(self.for_s), frames as stream:
                    await self.recorder.record(stream)

    @contextmanager
    def _files(self, header: Header) -> Iterator[Sink]:
        with ExitStack() as stack:
            jsonl = stack.enter_context(self.jsonl.open("x", encoding="utf-8", buffering=1))
            packets = PcapngWriter(stack.enter_context(self.pcapng.open("xb")), header)
            jsonl.write(header_line(header))

            def write(item: Item) -> None:
                jsonl.write(item_line(header, item))
                packets.add(item)

            yield write

    @contextmanager
    def _progress(self, recorder: Recorder) -> Iterator[None]:
        """Show the progress at a terminal; elsewhere nobody watches it."""
        if not err.is_terminal:
            yield
            return
        with Live(get_renderable=lambda: self._line(recorder), console=err, refresh_per_second=4, transient=True):
            yield

    def _line(self, recorder: Recorder) -> Text:
        counts, elapsed_s = recorder.counts, recorder.elapsed_s
        notes = [f"{elapsed_s:.0f} s" if self.for_s is None else f"{elapsed_s:.0f} of {self.for_s:g} s"]
        if not recorder.is_connected:
            notes.append("the manager does not answer; trying again")
        elif elapsed_s - recorder.lasted_s > SILENT_S:
            notes.append("no frames: the link is down")
        found = f"{counted(counts.frames, 'frame')}, {counted(counts.writes, 'write')}"
        return Text(f"{self.link}: {found}; {'; '.join(notes)}; Ctrl-C ends it", overflow="ellipsis", no_wrap=True)


class _OwnFrames:
    """The frames of a manager in this process: unlike a stream, from before anybody can ask for them."""

    def __init__(self) -> None:
        self._waiting: asyncio.Queue[WireFrame] = asyncio.Queue()
        self._first_at: dict[str, float] = {}

    def put(self, frame: WireFrame) -> None:
        """Take the next frame of any link."""
        self._first_at.setdefault(frame.link, frame.at)
        self._waiting.put_nowait(frame)

    def beginning_of(self, link: str) -> tuple[datetime, float]:
        """Return when the first frame of a link came, or now, by the clock on the wall and by that of the loop."""
        now_s = asyncio.get_running_loop().time()
        first_s = self._first_at.get(link, now_s)
        return datetime.now(UTC) - timedelta(seconds=now_s - first_s), first_s

    async def of(self, link: str) -> AsyncGenerator[StreamEvent]:
        """Yield the frames of a link as a stream does, without end."""
        yield Connected()
        while True:
            frame = await self._waiting.get()
            if frame.link == link:
                yield encode_frame(frame)


async def _chosen(client: LiftManagerClient, link: str) -> str:
    """Return the link that was named, or the only one."""
    links = await client.links()
    if link in links:
        return link
    listed = ", ".join(links) or "none"
    if link:
        raise fail(f"no controller {link!r}{closest(link, links)}; the controllers are {listed}")
    if len(links) != 1:
        raise fail(f"name the controller to record; there is {listed}")
    return links[0]
