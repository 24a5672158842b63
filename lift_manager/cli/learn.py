"""`lift-manager learn`: find the registers of an undocumented controller during a ride."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConnectFailed, ControllerTaken, LockUnusable
from lift_manager.cli.common import controller_address, err, fail, print_lines, print_stderr, report_mistakes
from lift_manager.cli.keyboard import typed_lines
from lift_manager.cli.loop import run
from lift_manager.commissioning.learn import samples
from lift_manager.commissioning.learn.analyse import analyse
from lift_manager.commissioning.learn.draft import draft, report
from lift_manager.commissioning.learn.ride import HELP, clock, record
from lift_manager.commissioning.learn.samples import Recording, SamplesUnusable, guess_order, load_samples
from lift_manager.commissioning.learn.survey import FIRST, LAST, RISK, Progress, SurveyFailed, survey
from lift_manager.commissioning.output import OutputRefused, check_ending, check_free, save
from lift_manager.commissioning.prober import GAP_S, Prober, open_prober
from register_maps.errors import MapFileError
from register_maps.load import load

INTERRUPTED = 130
"""The exit code of a program that was ended with Ctrl-C, as shells have it."""
ADVANCE = 0.1
"""Where there is no terminal a line of progress is printed after each such share."""

_NOT_NAME = re.compile(r"[^a-z0-9]+")


def learn(  # noqa: PLR0913  each is an option of the command line
    controller: Annotated[
        str | None,
        typer.Argument(metavar="HOST:PORT", help="The controller; port 502 by default.", show_default=False),
    ] = None,
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write the draft of the map.")
    ] = Path("draft.yaml"),
    unit: Annotated[int, typer.Option(min=0, max=255, help="The unit id of the lift.")] = 1,
    first: Annotated[
        int | None,
        typer.Option(
            "--from",
            min=0,
            max=65535,
            metavar="A",
            help="First address, on the wire, of every table.",
            show_default=False,
        ),
    ] = None,
    last: Annotated[
        int | None,
        typer.Option(
            "--to",
            min=0,
            max=65535,
            metavar="B",
            help="Last address; without these two: 0 to 255 and likely others.",
            show_default=False,
        ),
    ] = None,
    floors: Annotated[
        str,
        typer.Option(metavar="NAMES", help="The floors, lowest first, such as B1,G,1,2; asked at the end otherwise."),
    ] = "",
    pause: Annotated[
        float, typer.Option(min=0.0, max=10.0, metavar="SECONDS", help="From an answer to the next request.")
    ] = GAP_S,
    save_to: Annotated[
        Path | None,
        typer.Option(
            "--samples",
            metavar="FILE",
            help="Save the recording too, so that it can be analysed again.",
            show_default=False,
        ),
    ] = None,
    from_samples: Annotated[
        Path | None,
        typer.Option(
            "--from-samples",
            metavar="FILE",
            help="Analyse this recording; nothing is read from a controller.",
            show_default=False,
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Begin without a question.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there already.")] = False,
) -> None:
    """Draft a map of an undocumented controller while you ride.

    It only reads. It finds out what can be read, and records all of it while you name each floor. Then it proposes which registers show
    position, door and motion, how sure that is, and why. A draft has no commands, and must be checked signal by signal. Exit code 1 if
    nothing was found.

    Example: lift-manager learn 192.0.2.10:502 -o east.yaml --samples ride.json
    """
    if (controller is None) == (from_samples is None):
        raise typer.BadParameter(
            "give the address of a controller, or a recording with --from-samples", param_hint="HOST:PORT"
        )
    order = _floor_names(floors)
    try:
        check_ending(output, [".yaml", ".yml"])
        check_free([path for path in (output, save_to) if path is not None], force=force)
    except OutputRefused as error:
        raise fail(str(error)) from error
    if from_samples is not None:
        try:
            recording = load_samples(from_samples)
        except SamplesUnusable as error:
            raise fail(str(error)) from error
    else:
        host, port = _address(str(controller))
        span = _Span(
            FIRST if first is None else first, LAST if last is None else last, is_default=(first, last) == (None, None)
        )
        recording = _visit(_Visit(host, port, unit, span, pause, order, needs_consent=not yes), save_to)
    recording.floors = order or recording.floors or guess_order(recording.named_floors)
    if save_to is not None:
        _save({save_to: samples.to_json(recording)})
        print_lines([f"{save_to}: the recording; `lift-manager learn --from-samples {save_to}` analyses it again"])
    _write_draft(recording, output)


@dataclass(frozen=True, slots=True)
class _Span:
    """Which addresses are tried."""

    first: int
    last: int
    is_default: bool

    def __post_init__(self) -> None:
        if self.first > self.last:
            raise typer.BadParameter(f"{self.first} is above --to {self.last}", param_hint="--from")


def _address(text: str) -> tuple[str, int]:
    address = controller_address(text.strip())
    if address is None:
        raise typer.BadParameter(
            f"{text!r} is no address: write HOST:PORT, such as 192.0.2.10:502", param_hint="HOST:PORT"
        )
    return address


def _floor_names(text: str) -> tuple[str, ...]:
    names = tuple(" ".join(name.split()) for name in text.split(",")) if text.strip() else ()
    if "" in names or len(set(names)) < len(names):
        raise typer.BadParameter("name every floor once, with commas between, such as B1,G,1,2", param_hint="--floors")
    return names


def _visit(visit: _Visit, save_to: Path | None) -> Recording:
    """Survey and ride; what was recorded is saved even if it ends early."""
    try:
        return run(visit.run())
    except KeyboardInterrupt:
        kept = _keep(visit.recording, save_to)
        print_stderr(f"\nended; nothing was written to the controller, and no draft was made{kept}")
        raise typer.Exit(INTERRUPTED) from None
    except ControllerTaken as error:
        raise fail(f"{error}; stop it first: `learn` needs the connection for itself") from error
    except ConnectFailed as error:
        raise fail(
            f"{error}; check address and port, and that no other program has the controller's connection"
            f"{_keep(visit.recording, save_to)}"
        ) from error
    except (LockUnusable, SurveyFailed) as error:
        raise fail(str(error)) from error


def _keep(recording: Recording | None, save_to: Path | None) -> str:
    if recording is None or save_to is None or not recording.marks:
        return ""
    recording.floors = recording.floors or guess_order(recording.named_floors)
    _save({save_to: samples.to_json(recording)})
    return f"; what was recorded so far is in {save_to}"


@dataclass
class _Visit:
    """One visit to a controller."""

    host: str
    port: int
    unit: int
    span: _Span
    pause_s: float
    order: tuple[str, ...]
    needs_consent: bool
    recording: Recording | None = None

    async def run(self) -> Recording:
        with typed_lines(sys.stdin.fileno()) as next_line:
            for line in textwrap.wrap(RISK, min(err.width, 120)):
                print_stderr(line)
            if self.needs_consent:
                print_stderr(f"begin reading from {self.host}:{self.port}, unit {self.unit}? [y/N]")
                if ((await next_line()) or "").strip().lower() not in ("y", "yes"):
                    print_stderr("nothing was read")
                    raise typer.Exit(1)
            async with open_prober(self.host, self.port, unit=self.unit, gap_s=self.pause_s) as prober:
                recording = await self._survey(prober)
                for line in (*HELP, ""):
                    print_stderr(line)
                await record(prober, recording, next_line, print_stderr)
            if not self.order:
                recording.floors = await self._prompt_order(recording.named_floors, next_line)
            return recording

    async def _survey(self, prober: Prober) -> Recording:
        progress = _ProgressLine()
        found = await survey(
            prober, progress.show, first=self.span.first, last=self.span.last, likely=self.span.is_default
        )
        progress.end()
        for note in found.notes:
            print_stderr(note)
        if not found.spans:
            raise SurveyFailed(
                f"unit {self.unit} at {prober.peer} answers for no address that was tried; try other addresses with --from and --to, or"
                " another --unit"
            )
        count = sum(span.count for span in found.spans)
        print_stderr(f"{count} addresses can be read: {', '.join(map(str, found.spans))}")
        began = datetime.now().astimezone().isoformat(timespec="seconds")
        self.recording = samples.begin(found, peer=prober.peer, unit=self.unit, began=began)
        return self.recording

    async def _prompt_order(self, named: tuple[str, ...], next_line: Callable[[], object]) -> tuple[str, ...]:
        guess = guess_order(named)
        if len(named) < 2 or not sys.stdin.isatty():
            return guess
        while True:
            print_stderr(f"the floors from the lowest to the highest? ENTER for {','.join(guess)}")
            line = await next_line()  # type: ignore[misc]
            if not line or not str(line).strip():
                return guess
            with suppress(typer.BadParameter):
                names = _floor_names(str(line))
                if set(names) >= set(named):
                    return names
            print_stderr(f"name every floor once, with commas between: {', '.join(named)}")


class _ProgressLine:
    """Shows how far a survey is: one line that changes, or, where there is no terminal, a line now and then."""

    def __init__(self) -> None:
        self._next = 0.0

    def show(self, progress: Progress) -> None:
        if not err.is_terminal and progress.share < self._next:
            return
        self._next = progress.share + ADVANCE
        text = (
            f"looking for what can be read: {progress.table} {progress.address}, {progress.share:4.0%},"
            f" about {clock(progress.remaining_s)} left, {progress.found} found"
        )
        if err.is_terminal:
            err.print(
                text.ljust(err.width - 1)[: err.width - 1], end="\r", markup=False, highlight=False, soft_wrap=True
            )
        else:
            print_stderr(text)

    def end(self) -> None:
        if err.is_terminal:
            print_stderr("")


def _save(files: dict[Path, bytes]) -> None:
    try:
        save(files, force=True)  # that they may be replaced was found out before the ride
    except OutputRefused as error:
        raise fail(str(error)) from error


def _write_draft(recording: Recording, output: Path) -> None:
    found = analyse(recording)
    name = _NOT_NAME.sub("-", output.stem.lower()).strip("-") or "draft"
    _save({output: draft(found, recording, name=name).encode()})
    try:
        load(output.absolute())
    except MapFileError as error:
        raise report_mistakes(error) from error
    print_lines(report(found, for_file=str(output)))
    if not found.usable():
        raise fail(f"{output}: a draft without a signal: nothing was found that is better than a guess")
    print_lines([f"{output}: the draft; read its comments first"])
