"""`lift-manager hub update`: sign configuration updates, roll them out at a hub, and take them at a site."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import (
    SiteFile,
    duration_s,
    fail,
    load_site_or_exit,
    out,
    print_lines,
    store_path_of,
)
from lift_manager.cli.serve_checks import obstacles
from lift_manager.hub.errors import HubError, UpdateRefused, file_errors
from lift_manager.hub.folder import HubFolder
from lift_manager.hub.update.changes import misplaced_files
from lift_manager.hub.update.collect import collect
from lift_manager.hub.update.desk import UpdateFiles, standing
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import roll_back
from lift_manager.hub.update.package import ENDING, Content, make_package, read_private_key, write_key
from lift_manager.hub.update.rollout import AT_ONCE
from lift_manager.hub.update.stage import stage as stage_package
from lift_manager.plain.text import counted

app = typer.Typer(no_args_is_help=True, help="Sign configuration updates, roll them out, and take them at a site.")

Folder = Annotated[Path, typer.Option("--folder", metavar="FOLDER", help="The folder of the hub.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is recorded with the action.")]
HUB = Path("hub")


@app.command("key")
def key(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="Where the private key goes, such as office.key.")],
    *,
    passphrase: Annotated[bool, typer.Option("--passphrase", help="Ask for a passphrase that encrypts it.")] = False,
) -> None:
    """Make the key with which a person signs updates. It stays with that person: neither the hub nor a site needs it.

    Example: lift-manager hub update key office.key
    """
    words = typer.prompt("Passphrase", hide_input=True, confirmation_prompt=True) if passphrase else ""
    with _reporting():
        public, mark = write_key(path, words)
    print_lines(
        [
            f"{path}: the private key; keep it to yourself",
            f"{public}: the public key, {mark}; carry it to each site, where `hub: updates` of the site file names it",
        ]
    )


@app.command("make")
def make(
    sites: Annotated[list[Path], typer.Argument(metavar="SITE...", help="The site files, one for each site.")],
    *,
    number: Annotated[int, typer.Option("--number", min=1, help="Higher than that of every update before.")],
    key_file: Annotated[Path, typer.Option("--key", metavar="FILE", help="The private key that signs it.")],
    by: By,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the packages go.")],
    more: Annotated[
        list[Path] | None,
        typer.Option(
            "--with", metavar="FILE", help="Also pack this file, relative to each site file; can be repeated."
        ),
    ] = None,
) -> None:
    """Check site files, and pack each with its maps and recorded announcements into a signed package for its site.

    Example: lift-manager hub update make sites/*.yaml --number 8 --key office.key --by "M. Weber" -o update-8
    """
    with _reporting():
        contents = [_content(path, number, by, tuple(more or ())) for path in sites]
        if len({content.site for content in contents}) < len(contents):
            raise UpdateRefused("two of these site files have the same `hub: site`")
        private = read_private_key(key_file, lambda: str(typer.prompt(f"Passphrase of {key_file}", hide_input=True)))
        packages = {output / f"{content.site}{ENDING}": make_package(content, private) for content in contents}
        _write_new(output, packages)
    print_lines(f"{path}: update {number}, {len(data) // 1024 + 1} KB" for path, data in packages.items())


@app.command("offer")
def offer(
    packages: Annotated[Path, typer.Argument(metavar="FOLDER", help="What `make` wrote.")],
    *,
    canary: Annotated[
        list[str], typer.Option("--canary", metavar="SITE", help="A site that has it first; can be repeated.")
    ],
    by: By,
    skip: Annotated[
        list[str] | None, typer.Option("--skip", metavar="SITE", help="Leave this site out; can be repeated.")
    ] = None,
    healthy_for: Annotated[
        str, typer.Option("--healthy-for", metavar="TIME", help="How long canaries run well before the others follow.")
    ] = "30m",
    at_once: Annotated[
        int, typer.Option("--at-once", min=1, help="How many sites may be under way at the same time.")
    ] = AT_ONCE,
    folder: Folder = HUB,
) -> None:
    """Begin a roll-out in place of the one before: canaries first, then the others, until one site fails.

    Sites ask once a minute, and take it when nothing is under way there. A site that has it already has nothing to do.

    Example: lift-manager hub update offer update-8 --canary berlin --by "M. Weber" --folder hub
    """
    if (healthy_s := duration_s(healthy_for, "smh")) is None:
        raise typer.BadParameter("write a time such as 30m or 2h", param_hint="--healthy-for")
    files = [path for path in sorted(packages.glob(f"*{ENDING}")) if path.stem not in (skip or ())]
    with _reporting():
        place = HubFolder(folder)
        rollout = UpdateFiles(folder).begin(
            files, canary, place.registry().sites.keys(), by, healthy_s=healthy_s, at_once=at_once
        )
    first = ", ".join(rollout.canaries)
    print_lines([f"update {rollout.number}: {counted(len(rollout.targets), 'site')}, {first} first"])


@app.command("status")
def status(folder: Folder = HUB) -> None:
    """Show the newest roll-out, site by site.

    Example: lift-manager hub update status --folder hub
    """
    with _reporting():
        files = UpdateFiles(folder)
        rollout, reports = files.rollout(), files.reports()
    if rollout is None:
        print_lines(["there was no roll-out; `lift-manager hub update offer` begins one"])
        return
    by = f"made by {rollout.made_by}, offered by {rollout.by} at {rollout.at:%Y-%m-%d %H:%M} UTC"
    lines = [f"update {rollout.number}: {by}, {', '.join(rollout.canaries)} first"]
    if rollout.stopped is not None:
        lines.append(
            f"stopped by {rollout.stopped.by} at {rollout.stopped.at:%Y-%m-%d %H:%M} UTC: {rollout.stopped.why}"
        )
    for one in standing(rollout, reports):
        runs = "" if one.installed is None else f", runs by {one.installed or 'its first configuration'}"
        lines.append(f"{one.site}: {one.progress}{runs}{f': {one.text}' if one.text else ''}")
    print_lines(lines)


@app.command("stop")
def stop(
    by: By,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; for the record.")],
    folder: Folder = HUB,
) -> None:
    """Stop the roll-out. Sites that have the update keep it; where it waits it is withdrawn.

    Example: lift-manager hub update stop --by "M. Weber" --reason "wrong floors" --folder hub
    """
    with _reporting():
        rollout = UpdateFiles(folder).stop(by, reason)
    print_lines([f"update {rollout.number}: offered to no further site"])


@app.command("adopt")
def adopt(
    site: SiteFile,
    place: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="The folder for updates, of the manager's user alone.")
    ],
) -> None:
    """At a site: put its configuration into a folder in which updates can take its place. Run it as the manager's user.

    Example: lift-manager hub update adopt site.yaml /var/lib/lift-manager/updates
    """
    with _reporting():
        loaded = load_site_or_exit(site)
        if loaded.site.hub is None or not loaded.site.hub.updates:
            raise UpdateRefused(
                "name the public key of the office in the site file first: `hub: {updates: [/etc/lift-manager/office.pub]}`"
            )
        if wrong := [*misplaced_files(loaded), *(str(finding) for finding in loaded.unusable)]:
            raise UpdateRefused("\n".join(wrong))
        store_path_of(loaded)
        installation = Installation(place.absolute())
        installation.begin(collect(loaded, ()))
    print_lines([f"serve {installation.site_file} from now on; `check`, `checkout` and the others take it as well"])


@app.command("back")
def back(
    site: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder for updates.")],
    by: By,
) -> None:
    """At a site, while its manager is stopped: go back to the configuration before the newest update.

    Example: lift-manager hub update back /var/lib/lift-manager/updates --by "Anna Berg"
    """
    with _reporting():
        installation = Installation(site.absolute())
        with installation.claimed():
            installed = installation.read()
            if installed.before is None:
                raise UpdateRefused("there is no configuration to go back to")
            after = roll_back(installed, f"{by} has decided it")
            installation.write(after)
    print_lines([f"the configuration before update {installed.current.number} is in its place; start the manager"])


@app.command("stage", hidden=True)
def stage(place: Annotated[Path, typer.Argument(metavar="FOLDER")]) -> None:
    """Check the package that has arrived, for a running manager.

    Example: lift-manager hub update stage /var/lib/lift-manager/updates
    """
    with suppress(OSError):  # the lifts come first, where that is allowed
        os.nice(10)
    installation = Installation(place)
    with _reporting():
        with file_errors(installation.incoming, "read"):
            package = installation.incoming.read_bytes()
        staged = stage_package(package, installation, obstacles)
    out.print(staged.model_dump_json(), markup=False, highlight=False, soft_wrap=True)


def _content(path: Path, number: int, by: str, more: tuple[Path, ...]) -> Content:
    """Check a site file, and return what goes into its package."""
    loaded = load_site_or_exit(path)
    if loaded.site.hub is None:
        raise UpdateRefused(f"{path} has no `hub`, so it belongs to no site that takes updates")
    if wrong := misplaced_files(loaded):
        raise UpdateRefused("\n".join(f"{path}: {line}" for line in wrong))
    files = collect(loaded, more)
    return Content.of(site=loaded.site.hub.site, number=number, made_by=by, made_at=datetime.now(UTC), files=files)


def _write_new(folder: Path, packages: dict[Path, bytes]) -> None:
    """Write packages into a new folder: nobody mixes those of two updates."""
    try:
        folder.mkdir(parents=True)
        for path, data in packages.items():
            path.write_bytes(data)
    except FileExistsError as error:
        raise UpdateRefused(f"{folder} is there already; choose another one for this update") from error
    except OSError as error:
        raise UpdateRefused(f"{error.filename} cannot be written ({error.strerror})") from error


@contextmanager
def _reporting() -> Iterator[None]:
    """Print a sentence and exit with 1 if something cannot be done."""
    try:
        yield
    except HubError as error:
        raise fail(str(error)) from error
