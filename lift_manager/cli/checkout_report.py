"""`lift-manager checkout-report`: the report of an acceptance test, for people to sign and for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import fail, load_site_or_exit, print_lines, print_stderr, store_path_of
from lift_manager.commissioning.checkout.record import Record, RecordUnusable, Stage, load, record_path, verdict
from lift_manager.commissioning.checkout.report import as_csv, as_html, as_json
from lift_manager.commissioning.checkout.report.difference import compare
from lift_manager.commissioning.checkout.report.photos import read_photos
from lift_manager.commissioning.checkout.report.words import when
from lift_manager.commissioning.output import OutputRefused, check_ending, save

Render = Callable[[Record, Record | None, Path], bytes]


def _as_html(record: Record, against: Record | None, folder: Path) -> bytes:
    photos = read_photos(record, folder)
    for photo in photos.values():
        if photo.problem:
            print_stderr(f"photo {photo.path} is not in the report: it {photo.problem}")
    return as_html.render(record, against, photos)


_FORMS: Mapping[str, Render] = {
    ".html": _as_html,
    ".json": lambda record, against, _: as_json.render(record, against),
    ".csv": lambda record, against, _: as_csv.render(record, against),
}


def report(
    file: Annotated[
        Path, typer.Argument(metavar="SITE|RECORD", help="The site file, with LIFT; or the file of a record.")
    ],
    lift: Annotated[
        str | None, typer.Argument(metavar="[LIFT]", help="The lift, by its name in the site file.")
    ] = None,
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write it: .html, .json or .csv.")
    ],
    stage: Annotated[
        Stage, typer.Option(help="With LIFT: fat, in the factory; sat, at the lift; proof, the yearly test.")
    ] = Stage.SAT,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="RECORD",
            help="Show the difference from this record; for a sat by default from the fat next to it.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
) -> None:
    """Write the report of an acceptance test.

    HTML is for A4 paper and signatures, JSON and CSV are for other programs. The report of the test at the lift shows what differs from
    that in the factory.

    Print the HTML from Chromium, Chrome or Edge: each page then has the hash of the record and its number.

    Example: lift-manager checkout-report site.yaml main -o report.html
    """
    try:
        form = _FORMS[check_ending(output, _FORMS)]
        path = file if lift is None else _record_of(file, lift, stage)
        record = _load(path, lift)
        earlier_path = against if against is not None else _fat_of_the_same_lift(path, record)
        earlier = None if earlier_path is None else _load(earlier_path, None)
        save({output: form(record, earlier, path.parent)}, force=force)
    except (RecordUnusable, OutputRefused) as error:
        raise fail(str(error)) from error
    lines = [f"{output}: {record.lift}, {record.stage}, {verdict(record).text}; record sha256 {record.sha256[:16]}"]
    if earlier is not None:
        differing = len(compare(earlier, record).items)
        begun = when(earlier.started_at)
        lines.append(f"compared with the {earlier.stage} of {begun}: {differing} of {len(record.items)} items differ")
    print_lines(lines)


def _record_of(site: Path, lift: str, stage: Stage) -> Path:
    loaded = load_site_or_exit(site)
    if lift not in loaded.site.lifts:
        raise fail(f"{site} has no lift {lift}; it has {', '.join(loaded.site.lifts)}")
    return record_path(store_path_of(loaded), lift, stage)


def _load(path: Path, lift: str | None) -> Record:
    """Return the record in a file. Raises RecordUnusable, also if there is none."""
    record = load(path)
    if record is None:
        advice = (
            "" if lift is None else f"; `lift-manager checkout` makes it, and `--stage` names another one of {lift}"
        )
        raise RecordUnusable(f"there is no record {path}{advice}")
    return record


def _fat_of_the_same_lift(path: Path, record: Record) -> Path | None:
    """Return the record of the factory acceptance test next to that of the site acceptance test of the same lift, if there is one."""
    if record.stage is not Stage.SAT:
        return None
    # the name of an archived record goes on with its time
    lift_part, dot, _ = path.name.rpartition(f".{Stage.SAT}.")
    fat = path.with_name(f"{lift_part}.{Stage.FAT}.json")
    return fat if dot and fat.exists() else None
