"""`lift-manager restore`: put a backup of a site in place, with every lift locked out until a person has looked at it."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from pydantic import ValidationError

from drivers.own_files import is_shared, make_own, put_in_place
from lift_manager.cli.backup import contents
from lift_manager.cli.common import fail, print_lines
from lift_manager.commissioning.backup import BackupUnusable, Entry, Manifest, hash_of, unpack
from lift_manager.config.maps import is_value_table
from lift_manager.config.site import Site
from lift_manager.lift.events import Restriction
from lift_manager.plain.text import counted, is_printable
from lift_manager.store.errors import ChainBroken, CommitFailed, JournalUnreadable, KeysUnusable, StoreUnusable
from lift_manager.store.keys import keys_path, read_keys
from lift_manager.store.place import SHARED_FOLDER, claim, store_path, unshare_advice
from lift_manager.store.restored import lock_out_all, read_verified, restore_lockout
from lift_manager.store.retention import Limits
from register_maps.errors import MapFileError
from register_maps.source import read


def restore(
    archive: Annotated[Path, typer.Argument(metavar="BACKUP", help="What `lift-manager backup` wrote.")],
    site: Annotated[
        Path, typer.Argument(metavar="SITE", help="Where the site file goes; maps and certificates go beside it.")
    ],
    by: Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is recorded with the action.")],
    *,
    force: Annotated[
        bool,
        typer.Option("--force", help="Replace files that are there already; they are kept in a folder of their own."),
    ] = False,
) -> None:
    """Restore a site from a backup, and lock out every lift.

    Stop its manager first. A backup does not know what happened since: a fire, a lockout, a robot in a car. So no robot is served on a
    lift until a person has looked at it and ended its lockout. Sessions and rides of the backup are over.

    Example: lift-manager restore tower.tar.gz /etc/lift-manager/site.yaml --by "Anna Berg"
    """
    if not is_printable(by) or not by.strip() or len(by) > 64:
        raise typer.BadParameter("give your name on one line, with at most 64 letters", param_hint="--by")
    at = datetime.now(UTC).astimezone()
    site_file = site.absolute()
    try:
        with ExitStack() as ends:
            site_file.parent.mkdir(parents=True, exist_ok=True)
            scratch = Path(
                ends.enter_context(TemporaryDirectory(dir=site_file.parent, prefix=".lift-manager-restore-"))
            )
            plan = _plan(archive, scratch, site_file)
            _claim(plan, ends)
            _ready_store(plan, restore_lockout(by, at, plan.manifest.made_at))
            _require_free(plan, force=force)
            kept = _keep_present_files(plan, at)
            _put_in_place(plan)
    except ChainBroken as error:
        raise fail(f"nothing was changed: {archive}: the journal in it does not hold: {error}") from error
    except (BackupUnusable, StoreUnusable, JournalUnreadable, CommitFailed) as error:
        raise fail(f"nothing was changed: {error}") from error
    except OSError as error:
        text = f"{error.filename or site} cannot be written ({error.strerror or error}): run this as root, or as the manager's user"
        raise fail(
            f"{text}. The site is not restored; repeat this, with --force where a part of it is there already"
        ) from error
    print_lines(_report(plan, archive, kept))


@dataclass(frozen=True, slots=True)
class _File:
    """One file of a backup, unpacked."""

    source: Path
    entry: Entry | None
    """None for a store that was made just now."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """What goes where."""

    manifest: Manifest
    site: Site
    site_file: Path
    store: Path
    files: Mapping[Path, _File]
    """By its place; the site file last, so that no manager starts on half of a site."""

    def present(self) -> list[Path]:
        """Return the files that are there already and differ."""
        return [path for path, file in self.files.items() if path.exists() and hash_of(path) != hash_of(file.source)]


def _plan(archive: Path, scratch: Path, site_file: Path) -> _Plan:
    """Unpack a backup to `scratch`, verify it, and find a place for each file. Raises what the parts raise."""
    manifest = unpack(archive, scratch)
    try:
        site = Site.model_validate(read(scratch / "site" / manifest.site_file, number_keys=is_value_table).data)
    except (MapFileError, ValidationError) as error:
        raise BackupUnusable(f"{archive}: its site file has mistakes: {error}") from error
    if site.name != manifest.site:
        raise BackupUnusable(f"{archive}: its site file is not that of {manifest.site!r}")
    store = store_path(site.name, site.state, site_file, os.environ)
    if is_shared(store.parent):
        raise StoreUnusable(f"{store.parent} {SHARED_FOLDER}: {unshare_advice(store.parent)}")
    files = {store: _File(scratch / "state" / store.name, None)}
    folders = {"state": store.parent, "site": site_file.parent, "elsewhere": site_file.parent / "elsewhere"}
    for entry in manifest.entries:
        target = folders[entry.place] / entry.name
        files[target] = _File(scratch / entry.member, entry)
    own = files.pop(site_file.parent / manifest.site_file)
    files[site_file] = own
    if files[store].entry is not None:
        read_verified(files[store].source, site.name)
    return _Plan(manifest, site, site_file, store, files)


def _claim(plan: _Plan, ends: ExitStack) -> None:
    """Keep a manager from starting on this store until the end. Raises StoreUnusable while one runs."""
    folder = plan.store.parent
    if not folder.exists():
        folder.mkdir(mode=0o700, parents=True)
        _give(
            folder,
            next((file.entry for file in plan.files.values() if file.entry and file.entry.place == "state"), None),
        )
    try:
        lock = claim(plan.store)
    except StoreUnusable as error:
        text = f"a manager runs for {plan.site.name!r} with {plan.store}: stop it first, such as with `systemctl stop lift-manager`"
        raise StoreUnusable(text) from error
    if lock is not None:
        ends.callback(os.close, lock)
        _give(plan.store.with_name(f"{plan.store.name}.lock"), None)


def _require_free(plan: _Plan, *, force: bool) -> None:
    """Raise BackupUnusable if a file is there already and may not be replaced."""
    if (present := plan.present()) and not force:
        names = ", ".join(map(str, present))
        raise BackupUnusable(
            f"there already, and different: {names}; --force replaces them, and keeps them in a folder of their own"
        )


def _ready_store(plan: _Plan, lockout: Restriction) -> None:
    keeps = plan.site.journal
    source = plan.files[plan.store].source
    lock_out_all(source, plan.site.name, plan.site.lifts, Limits(keeps.keep_days, keeps.max_mb), lockout)


def _keep_present_files(plan: _Plan, at: datetime) -> Path | None:
    """Copy what will be replaced, and return the folder; None if there is nothing."""
    present = plan.present()
    if not present:
        return None
    folder = plan.store.parent / f"before-restore-{at.astimezone(UTC):%Y%m%dT%H%M%SZ}"
    folder.mkdir(mode=0o700)
    _give(folder, None)
    log = plan.store.with_name(f"{plan.store.name}-wal")
    for path in [*present, *([log] if plan.store in present and log.exists() else [])]:
        copy = folder / path.relative_to(path.anchor)
        copy.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        shutil.copy2(path, copy)
    return folder


def _put_in_place(plan: _Plan) -> None:
    for path, file in plan.files.items():
        for folder in reversed([parent for parent in path.parents if not parent.exists()]):
            folder.mkdir(mode=0o755 if folder.is_relative_to(plan.site_file.parent) else 0o700)
            _give(folder, None)
        temporary = path.with_name(f"{path.name}.new")
        with os.fdopen(make_own(temporary), "wb") as target, file.source.open("rb") as source:
            shutil.copyfileobj(source, target)
            target.flush()
            os.fsync(target.fileno())
        temporary.chmod(0o600 if file.entry is None else file.entry.mode)
        _give(temporary, file.entry)
        if path == plan.store:
            # SQLite would apply what is left of the former store to this one
            for ending in ("-wal", "-shm"):
                path.with_name(f"{path.name}{ending}").unlink(missing_ok=True)
        put_in_place(temporary, path)


def _give(path: Path, entry: Entry | None) -> None:
    """Give a file to its former owner if root restores it; to the owner of its folder where that user is not known here."""
    if os.geteuid() != 0:
        return
    folder = path.parent.stat()
    os.chown(path, folder.st_uid, folder.st_gid)
    if entry is not None:
        with suppress(LookupError):
            shutil.chown(path, group=entry.group)
        with suppress(LookupError):
            shutil.chown(path, user=entry.owner)


def _report(plan: _Plan, archive: Path, kept: Path | None) -> Iterator[str]:
    manifest = plan.manifest
    yield f"{manifest.site} is restored from {archive}, made {manifest.made_at:%Y-%m-%d %H:%M %z} by lift-manager {manifest.program}"
    yield from contents(manifest)
    yield f"site file  {plan.site_file}"
    moved = (
        ""
        if str(plan.store.parent) == manifest.state_folder
        else f"; at the time of the backup it was {manifest.state_folder}"
    )
    yield f"state      {plan.store.parent}{moved}"
    if kept is not None:
        yield f"replaced   what was there is kept in {kept}"
    for path, file in plan.files.items():
        if file.entry is not None and file.entry.place == "elsewhere":
            yield f"by hand    {path} belongs to /{file.entry.name}"
    try:
        live = [entry.name for entry in read_keys(keys_path(plan.store), manifest.site).live]
    except KeysUnusable as error:
        yield f"keys       {error}"
    else:
        revoke = "; one that was revoked since works again until it is revoked again" if live else ""
        yield f"keys       {counted(len(live), 'live API key')}{': ' if live else ''}{', '.join(live)}{revoke}"
    yield f"Every lift is locked out ({', '.join(plan.site.lifts)}): nobody knows what happened since the backup."
    yield f"1. `lift-manager check {shlex.quote(str(plan.site_file))}`, then start the manager"
    yield "2. look at each lift and into its car; after a fire, or for a robot that is not there any more: `lift-manager ack LIFT --by NAME`"
    yield "3. `lift-manager lockout LIFT --by NAME --end`"
