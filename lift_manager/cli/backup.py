"""`lift-manager backup`: everything of a site in one archive, while its manager runs."""

from __future__ import annotations

import grp
import os
import pwd
import stat
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from glob import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import typer

from drivers.own_files import is_shared
from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, print_lines, store_path_of
from lift_manager.commissioning.backup import BackupUnusable, Entry, Manifest, hash_of, write_archive
from lift_manager.commissioning.checkout.record import Record, RecordUnusable, load
from lift_manager.commissioning.output import OutputRefused, check_free
from lift_manager.config.hub import leaf_files
from lift_manager.config.load import LoadedSite
from lift_manager.config.tls import path_of
from lift_manager.plain.text import counted
from lift_manager.plain.version import running_version
from lift_manager.store.errors import ChainBroken, JournalUnreadable, KeysUnusable, StoreUnusable
from lift_manager.store.keys import keys_path, read_keys
from lift_manager.store.restored import StoreContent, copy_verified
from register_maps.load import MAPS

_CA = "a certificate of a CA"
NOT_COPIED = (".db", ".db-wal", ".db-shm", ".db-journal", ".lock", ".new", ".new-journal")
"""Endings of what belongs to a running manager; the database itself is copied in a way of its own."""


def backup(
    site: SiteFile,
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write it, such as tower.tar.gz.")
    ],
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
) -> None:
    """Back up a site.

    The archive has the site file, maps, certificates and keys, state, journal, API keys, checkout records, and the configuration of the
    leaf node of a site with a hub. The manager may run meanwhile. What was written is verified. The archive holds private keys: only you may read it. `lift-manager restore` puts it back.

    Example: lift-manager backup /etc/lift-manager/site.yaml -o tower.tar.gz
    """
    loaded = load_site_or_exit(site)
    store = store_path_of(loaded)
    try:
        check_free([output], force=force)
        if not output.parent.is_dir():
            raise fail(f"{output.parent}: there is no such folder")
        if is_shared(output.parent) and not output.parent.stat().st_mode & stat.S_ISVTX:
            raise fail(
                f"{output.parent}: others can write to this folder, and could replace the backup; choose another"
            )
        with TemporaryDirectory(dir=output.absolute().parent, prefix=".lift-manager-backup-") as scratch:
            found = _collect(loaded, store, Path(scratch))
            manifest = _manifest(loaded, store, found)
            write_archive(output, manifest, [item.source for item in found.items])
    except ChainBroken as error:
        advice = f"`lift-manager audit {site} --verify` shows it, and a copy of {store.parent} keeps it as it is"
        raise fail(f"nothing was written: the journal does not hold: {error}; {advice}") from error
    except (StoreUnusable, JournalUnreadable, KeysUnusable, BackupUnusable) as error:
        raise fail(f"nothing was written: {error}") from error
    except OutputRefused as error:
        raise fail(str(error)) from error
    except OSError as error:
        raise fail(f"nothing was written: {error.filename or output}: {error.strerror or error}") from error
    print_lines(_report(output, manifest, found))


@dataclass(frozen=True, slots=True)
class _Item:
    """A file that goes into a backup."""

    place: Literal["site", "state", "elsewhere"]
    name: str
    about: str
    source: Path
    """What is copied."""
    like: Path
    """Whose owner and permissions it has."""


@dataclass(slots=True)
class _Found:
    """What there is of a site."""

    items: list[_Item] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    content: StoreContent | None = None
    live_keys: int = 0


def _collect(loaded: LoadedSite, store: Path, scratch: Path) -> _Found:
    """Find every file of a site; the database is copied to `scratch`. Raises what the parts raise."""
    found = _Found()
    for about, path in _site_files(loaded):
        _add(found, loaded, store, about, path)
    _add_leaf_node(found, loaded, store)
    own = [*sorted(store.parent.glob(f"{escape(store.stem)}.*"))] if store.parent.is_dir() else []
    kept = [path for path in own if not path.name.endswith(NOT_COPIED) or path.name.endswith(".keys.json.lock")]
    if not kept and not store.exists():
        text = (
            f"there is nothing of {loaded.site.name!r} in {store.parent}: no manager has run with this folder, or this is not the one."
            " A service of systemd has it in STATE_DIRECTORY: `STATE_DIRECTORY=/var/lib/lift-manager` before the command names it, and"
            " so does `state:` in the site file"
        )
        raise StoreUnusable(text)
    if store.exists():
        copy = scratch / store.name
        found.content = copy_verified(store, loaded.site.name, copy)
        found.items.append(_Item("state", store.name, "the state of the lifts, and the journal", copy, store))
    found.live_keys = len(read_keys(keys_path(store), loaded.site.name).live)
    for path in kept:
        _add(found, loaded, store, _about(path), path)
        if ".checkout." in path.name:
            with suppress(RecordUnusable):  # it goes in as it is
                _add_photos(found, loaded, store, load(path))
    return found


def _site_files(loaded: LoadedSite) -> Iterator[tuple[str, Path]]:
    folder = loaded.path.parent
    yield "the site file", loaded.path
    maps = {one.path.resolve() for one in (*loaded.maps.values(), *loaded.spare_maps.values())}
    yield from (("a map of this site", path) for path in sorted(maps) if path.parent != MAPS)
    for part in (loaded.site.api.tls, *(one.tls for one in loaded.site.controllers.values())):
        if part is not None:
            yield "a private key", path_of(folder, part.key)
            yield "a certificate", path_of(folder, part.certificate)
            for name in ("ca", "client_ca"):
                if (file := getattr(part, name, None)) is not None:
                    yield _CA, path_of(folder, file)
    if loaded.site.hub is not None:
        yield "the password for the leaf node", path_of(folder, loaded.site.hub.password)


def _add_leaf_node(found: _Found, loaded: LoadedSite, store: Path) -> None:
    """Add what the leaf node of a site with a hub needs, if it lies beside the password; it may be on another computer, or another user's."""
    if loaded.site.hub is None:
        return
    leaf_conf, ca = leaf_files(loaded.site, loaded.path.parent)
    for about, path in (("the configuration of the leaf node, with the site's key for the hub", leaf_conf), (_CA, ca)):
        if os.access(path, os.R_OK):
            _add(found, loaded, store, about, path)
        elif path == leaf_conf or path.exists():
            why = "this user may not read it; root may" if path.exists() else "it is not beside the password"
            found.left_out.append((str(path), f"{about}: {why}"))
    found.left_out.append(
        ("the rows that the leaf node keeps for the hub", "they are copies of the journal, which is in here")
    )


def _about(path: Path) -> str:
    if path.name.endswith(".keys.json"):
        return "the API keys, as hashes"
    if path.name.endswith(".lock"):
        return "says that there were API keys"
    return "a checkout record" if ".checkout." in path.name else "of the state"


def _add_photos(found: _Found, loaded: LoadedSite, store: Path, record: Record | None) -> None:
    if record is None:
        return
    for name in dict.fromkeys(photo for result in record.results for photo in result.photos):
        path = store.parent / name
        if path.is_file():
            _add(found, loaded, store, "a photo of a checkout", path)
        else:
            found.left_out.append((str(path), "a photo of a checkout that is not there"))


def _add(found: _Found, loaded: LoadedSite, store: Path, about: str, path: Path) -> None:
    absolute = path.absolute()
    places: tuple[tuple[Literal["state", "site"], Path], ...] = (
        ("state", store.parent.absolute()),
        ("site", loaded.path.absolute().parent),
    )
    item = _Item("elsewhere", str(absolute).lstrip("/"), about, absolute, absolute)
    for place, folder in places:
        if absolute.is_relative_to(folder):
            item = _Item(place, str(absolute.relative_to(folder)), about, absolute, absolute)
            break
    if all((one.place, one.name) != (item.place, item.name) for one in found.items):
        found.items.append(item)


def _manifest(loaded: LoadedSite, store: Path, found: _Found) -> Manifest:
    chain = None if found.content is None else found.content.chain
    return Manifest(
        site=loaded.site.name,
        made_at=datetime.now(UTC).astimezone(),
        program=running_version(),
        site_file=next(item.name for item in found.items if item.about == "the site file"),
        site_folder=str(loaded.path.absolute().parent),
        state_folder=str(store.parent.absolute()),
        seal="" if chain is None or chain.newest is None else f"{chain.newest.seq}:{chain.newest.hash.hex()}",
        entries=tuple(map(_entry, found.items)),
        left_out=tuple(found.left_out),
    )


def _entry(item: _Item) -> Entry:
    status = item.like.stat()
    owner, group = str(status.st_uid), str(status.st_gid)
    with suppress(KeyError):
        owner = pwd.getpwuid(status.st_uid).pw_name
    with suppress(KeyError):
        group = grp.getgrgid(status.st_gid).gr_name
    return Entry(
        place=item.place,
        name=item.name,
        about=item.about,
        mode=stat.S_IMODE(status.st_mode)
        & 0o755,  # what others could change before is for its owner to change afterwards
        owner=owner,
        group=group,
        size=item.source.stat().st_size,
        sha256=hash_of(item.source),
    )


def _report(output: Path, manifest: Manifest, found: _Found) -> Iterator[str]:
    count = counted(len(manifest.entries), "file")
    yield f"{output}: {count} of {manifest.site}, {output.stat().st_size // 1024 + 1} KB, read back and verified"
    yield from contents(manifest)
    if found.content is not None:
        held = [lift for lift, saved in found.content.records.items() if saved.keeps_robots_out]
        lifts = counted(len(found.content.records), "lift")
        yield f"state    {lifts}; robots are kept off {', '.join(held) or 'none of them'}"
        chain = found.content.chain
        yield f"journal  {counted(chain.rows, 'row')}, and the chain holds" + (
            f"; seal {manifest.seal}" if manifest.seal else ""
        )
    else:
        yield "state    none: no manager has run for this site yet"
    yield f"keys     {counted(found.live_keys, 'live API key')}"
    yield "Only you can read it. Keep it so: it holds private keys, and who rode when."


def contents(manifest: Manifest) -> Iterator[str]:
    """Yield the files of a backup, a line each."""
    for entry in manifest.entries:
        name = f"/{entry.name}" if entry.place == "elsewhere" else entry.name
        yield f"  {name}: {entry.about}"
    yield from (f"  left out: {what}: {why}" for what, why in manifest.left_out)
