"""`lift-manager maps`: for people who write a register map, or hand one to a lift company."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import (
    Floors,
    MapName,
    SiteFile,
    fail,
    load_map_or_exit,
    load_site_or_exit,
    print_json,
    print_lines,
    read_floors,
    report_mistakes,
)
from lift_manager.commissioning import maps_check, maps_list, maps_plan, maps_show, maps_text
from lift_manager.commissioning.iolist import as_csv, as_html
from lift_manager.commissioning.iolist.build import io_list
from lift_manager.commissioning.iolist.model import IoList
from lift_manager.commissioning.output import OutputRefused, check_ending, save
from lift_manager.commissioning.plc.errors import ProgramError
from lift_manager.commissioning.plc.program import render as render_program
from register_maps.codec import compile_map
from register_maps.errors import MapFileError

app = typer.Typer()


def _as_xlsx(found: IoList) -> bytes:
    from lift_manager.commissioning.iolist import as_xlsx  # noqa: PLC0415  every other command would wait for its library

    return as_xlsx.render(found)


_IO_LISTS: Mapping[str, Callable[[IoList], bytes]] = {
    ".xlsx": _as_xlsx,
    ".csv": as_csv.render,
    ".html": as_html.render,
}

Json = Annotated[bool, typer.Option("--json", help="Print JSON, for other programs.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write it.")]


@app.callback(invoke_without_command=True)
def default(context: typer.Context, *, as_json: Json = False) -> None:
    """List and check maps; print I/O lists and PLC programs.

    Alone it lists the shipped maps.

    Example: lift-manager maps
    """
    if context.invoked_subcommand is None:
        list_maps(as_json=as_json)


@app.command("list")
def list_maps(*, as_json: Json = False) -> None:
    """List the shipped maps.

    The source of each, and its signals and commands.

    Example: lift-manager maps list --json
    """
    maps = maps_list.shipped_maps()
    if as_json:
        print_json(maps)
    else:
        print_lines(maps_list.lines(maps))


@app.command()
def show(map_name: MapName, *, as_json: Json = False) -> None:
    """Show every point of a map.

    Address as printed and on the wire, function, coding, source; and every fault, with how soon the manager sees it.

    Example: lift-manager maps show generic-registers
    """
    sheet = maps_show.map_sheet(load_map_or_exit(map_name))
    if as_json:
        print_json(sheet)
    else:
        print_lines(maps_text.lines(sheet))


@app.command()
def check(
    file: Annotated[str, typer.Argument(metavar="FILE|MAP", help="A map file, or a shipped map by name.")],
) -> None:
    """Find every mistake of a map, with a remedy for each.

    Exits 2 if there is a mistake.

    Example: lift-manager maps check ./my-lift.yaml
    """
    try:
        print_lines(maps_check.report(file))
    except MapFileError as error:
        raise report_mistakes(error) from error


@app.command()
def plan(map_name: MapName, floors: Floors = "") -> None:
    """Print the requests of one poll and of each command.

    As bytes and in plain words. Nothing is sent.

    Example: lift-manager maps plan generic-registers
    """
    loaded = load_map_or_exit(map_name)
    named = read_floors(floors)
    try:
        found = maps_plan.plan(loaded.map, named)
    except ValueError as error:
        raise fail(f"{loaded.map.name}: {error}") from error
    print_lines(maps_check.unset_text(loaded))
    print_lines(maps_plan.lines(found))


@app.command()
def iolist(site: SiteFile, output: Output, *, force: Force = False) -> None:
    """Write the I/O list that the lift company checks and signs.

    The ending of the file chooses the form: .xlsx, .csv or .html.

    Example: lift-manager maps iolist site.yaml -o io.xlsx
    """
    loaded = load_site_or_exit(site)
    try:
        render = _IO_LISTS[check_ending(output, _IO_LISTS)]
        found = io_list(loaded)
        save({output: render(found)}, force=force)
    except OutputRefused as error:
        raise fail(str(error)) from error
    points = sum(len(lift.points) for lift in found.lifts)
    print_lines([f"{output}: {points} points of {len(found.lifts)} lift{'' if len(found.lifts) == 1 else 's'}"])


@app.command()
def plc(map_name: MapName, output: Output, floors: Floors = "", *, force: Force = False) -> None:
    """Write a PLC program that serves a generic map.

    It is Structured Text (.st), with the wiring sheet beside it.

    Example: lift-manager maps plc generic-registers -o block.st
    """
    loaded = load_map_or_exit(map_name)
    named = read_floors(floors)
    wiring = output.with_name(f"{output.stem}-wiring.md")
    try:
        check_ending(output, [".st"])
        program = render_program(loaded.map, named or maps_plan.example_floors(compile_map(loaded.map)))
        save({output: program.st.encode(), wiring: program.wiring.encode()}, force=force)
    except (OutputRefused, ProgramError) as error:
        raise fail(str(error)) from error
    print_lines([f"{output}: the program", f"{wiring}: its wiring, and what to try before the first robot"])
    if named is None:
        print_lines(["The floors are examples; give the real ones with --floors."])
