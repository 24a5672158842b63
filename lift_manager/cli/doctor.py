"""`lift-manager doctor`: find by reading what is wrong between a map and a controller."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import textwrap
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ControllerTaken, LockUnusable
from lift_manager.app import network_wires
from lift_manager.cli.active_machine import WithoutEtcd, active_machine_problem
from lift_manager.cli.common import (
    Floors,
    controller_address,
    err,
    load_map_or_exit,
    load_site_or_exit,
    out,
    print_lines,
    print_stderr,
    read_floors,
)
from lift_manager.commissioning.doctor.collect import SECONDS, collect, plain_wire
from lift_manager.commissioning.doctor.evidence import Probe
from lift_manager.commissioning.doctor.probes import RISKS, MakeWire
from lift_manager.commissioning.doctor.report import (
    NotAReport,
    Report,
    as_json,
    differences,
    lines,
    make_report,
    read_report,
    summary,
)
from lift_manager.commissioning.doctor.subjects import (
    ExaminedController,
    Subjects,
    subjects_at,
    subjects_of_site,
)
from lift_manager.commissioning.maps_check import unset_text
from lift_manager.config.load import LoadedSite
from lift_manager.plain.version import running_version
from register_maps.error_texts import closest

CANNOT_RUN = 2

ALL = "all"


def doctor(  # noqa: PLR0913  a parameter per option
    subject: Annotated[
        str, typer.Argument(metavar="SITE|HOST:PORT", help="A site file, or the address of a controller.")
    ],
    *,
    map_name: Annotated[
        str, typer.Option("--map", metavar="MAP", help="With HOST:PORT: the map of the controller, by name or path.")
    ] = "",
    unit: Annotated[
        int | None, typer.Option(min=0, max=255, help="With HOST:PORT: the unit id, instead of that of the map.")
    ] = None,
    floors: Floors = "",
    seconds: Annotated[
        float | None,
        typer.Option(
            min=1,
            max=3600,
            help=f"How long it reads, {SECONDS:g} or more by default; ride the lift meanwhile, and it sees more.",
            show_default=False,
        ),
    ] = None,
    probe: Annotated[
        list[str],
        typer.Option(
            metavar="NAME", help=f"Also read what a manager would not: {', '.join(Probe)} or all. Can be repeated."
        ),
    ] = [],  # noqa: B006 - typer makes a new list of it
    without_etcd: WithoutEtcd = False,
    as_json_: Annotated[bool, typer.Option("--json", help="Print JSON, for other programs and for --against.")] = False,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Compare with an earlier run with --json, such as the one at hand-over; the record of a checkout has it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Find what is wrong between a map and a controller.

    It only reads: one connection, one read at a time. Stop the manager first.

    Exit codes: 0 nothing needs work (with --against: nothing differs); 1 something does; 2 it could not run.

    Example: lift-manager doctor 192.0.2.10:502 --map generic-registers --floors B1=-1,G=0,L1=1
    """
    chosen = _chosen(probe)
    before = None
    if against is not None:
        try:
            before = read_report(against)
        except NotAReport as error:
            raise _cannot_run(str(error)) from error
    subjects, make_wire = _subjects(subject, map_name, unit, floors, without_etcd=without_etcd)
    for name in chosen:
        print_stderr(f"probe {name}: {RISKS[name]}")
    try:
        report = _examine(subjects, seconds, chosen, make_wire)
    except ControllerTaken as error:
        raise _cannot_run(f"{error}, or look at its signals with `lift-manager watch`") from error
    except LockUnusable as error:
        raise _cannot_run(str(error)) from error
    except KeyboardInterrupt:
        raise _cannot_run("stopped; nothing was written") from None
    found = None if before is None else differences(before, report)
    if as_json_:
        print_lines([as_json(report)])
        for line in found or ():
            print_stderr(line)
    else:
        _print(report, subjects, found)
    raise typer.Exit(report.needs_work if found is None else bool(found))


def _chosen(names: list[str]) -> tuple[Probe, ...]:
    """Return the chosen probes, in the order in which they are made. Raises typer.BadParameter."""
    for name in names:
        if name not in {*Probe, ALL}:
            raise typer.BadParameter(
                f"there is no probe {name!r}{closest(name, [*Probe, ALL])}; there are {', '.join(Probe)} and {ALL}",
                param_hint="--probe",
            )
    return tuple(probe for probe in Probe if ALL in names or probe in names)


def _cannot_run(text: str) -> typer.Exit:
    print_stderr(text)
    return typer.Exit(CANNOT_RUN)


def _subjects(
    subject: str, map_name: str, unit: int | None, floors: str, *, without_etcd: bool
) -> tuple[Subjects, MakeWire]:
    """Return what to examine: the controllers of a site file, or one address."""
    if Path(subject).is_file() or subject.endswith((".yaml", ".yml")):
        if map_name or unit is not None or floors:
            raise typer.BadParameter(
                "a site file says it already; leave it out, or give HOST:PORT", param_hint="--map, --unit, --floors"
            )
        loaded = load_site_or_exit(Path(subject))
        if problem := active_machine_problem(loaded, without_etcd=without_etcd):
            raise _cannot_run(problem)
        return subjects_of_site(loaded), _site_wires(loaded)
    host, port = host_and_port(subject)
    loaded_map = load_map_or_exit(map_name) if map_name else None
    if loaded_map is None:
        print_stderr("without --map doctor knows no points: it reads one register, to see whether anything answers")
    else:
        for line in unset_text(loaded_map):
            print_stderr(line)
        if endpoints := loaded_map.map.endpoints:
            print_stderr(
                f"points of {', '.join(endpoints)} are not read: only a site file says where these devices are"
            )
    return subjects_at(host, port, loaded_map, unit=unit, floors=read_floors(floors)), plain_wire


def _site_wires(loaded: LoadedSite) -> MakeWire:
    wires = network_wires(loaded.path.parent)

    def is_own(controller: ExaminedController) -> bool:
        """Whether it is the controller of the site file, and not another port of its host."""
        spec = loaded.site.controllers[controller.name]
        return (spec.host, spec.port) == (controller.host, controller.port)

    return lambda controller: (
        wires(loaded.site.controllers[controller.name]) if is_own(controller) else plain_wire(controller)
    )


def host_and_port(text: str) -> tuple[str, int]:
    """Parse HOST or HOST:PORT. Raises typer.BadParameter."""
    address = controller_address(text)
    if address is None:
        raise typer.BadParameter(
            f"{text!r} is neither a site file that exists nor an address such as 192.0.2.10:502",
            param_hint="SITE|HOST:PORT",
        )
    return address


def _examine(subjects: Subjects, seconds: float | None, probes: Iterable[Probe], make_wire: MakeWire) -> Report:
    """Read from the controllers, with a line of progress for a person."""
    with err.status("connecting") if err.is_terminal else contextlib.nullcontext() as status:

        def show(text: str) -> None:
            if status is not None:
                status.update(text.replace("[", r"\["))

        evidence = asyncio.run(
            collect(subjects, seconds=seconds, probes=tuple(probes), make_wire=make_wire, report=show)
        )
    time = datetime.now().astimezone().isoformat(timespec="seconds")
    return make_report(subjects, evidence, version=running_version(), time=time)


def _print(report: Report, subjects: Subjects, found: tuple[str, ...] | None) -> None:
    """Print a line per finding; at a terminal it is folded, so that no word is cut in two."""
    _print_folded(lines(report, subjects))
    _print_folded([summary(report)])
    if found is not None:
        _print_folded(found or ["Nothing differs from the earlier run."])


def _print_folded(texts: Iterable[str]) -> None:
    if not out.is_terminal:
        print_lines(texts)
        return
    width = min(shutil.get_terminal_size().columns, 100)
    for text in texts:
        print_lines(
            textwrap.wrap(text, width, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
        )
