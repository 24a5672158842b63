"""`lift-manager bundle`: what support needs to know of a site, without its secrets."""

from __future__ import annotations

import asyncio
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from lift_manager.cli.common import SiteFile, fail, print_lines, print_stderr
from lift_manager.cli.connection import KeyFile, Manager
from lift_manager.cli.key_file import key_of
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey, tls_context
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.errors import ClientError
from lift_manager.commissioning.bundle.archive import Bundle, SecretFound
from lift_manager.commissioning.bundle.redact import Redactor, passwords
from lift_manager.commissioning.output import OutputRefused, check_ending, check_free, save
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.config.tls import path_of
from lift_manager.lift.journal import RowKind
from lift_manager.plain.http import MANAGER
from lift_manager.plain.version import running_version
from lift_manager.store.chain import StoredRow
from lift_manager.store.errors import JournalUnreadable, KeysUnusable, StoreUnusable
from lift_manager.store.keys import keys_path, read_keys
from lift_manager.store.place import store_path
from lift_manager.store.read import ALL_ROWS, open_journal, time_of
from register_maps.errors import MapFileError
from register_maps.load import MAPS

ROWS = 2000
"""Of the journal by default. Chosen: an afternoon of a busy lift."""
WITHIN_S = 5.0
"""For each request to a manager. Chosen: one that does not answer must not keep anybody from the rest."""


def bundle(  # noqa: PLR0913  each is an option of the command line
    site: SiteFile,
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write it; the ending is .zip.")
    ] = Path("support.zip"),
    attach: Annotated[
        list[Path],
        typer.Option(
            "--attach",
            metavar="FILE",
            help="Put this in too, such as a trace or a report; can be repeated. Texts are redacted.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 - typer makes a new list of it
    rows: Annotated[
        int, typer.Option(min=0, max=1_000_000, metavar="N", help="The newest N rows of the journal.")
    ] = ROWS,
    with_names: Annotated[
        bool, typer.Option("--with-names", help="Keep the names of people and robots, and what people wrote.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Write a support bundle, without secrets.

    It has the site file, maps, versions, journal, and the state of a running manager. Its MANIFEST.txt lists every file, and everything
    that was left out with the reason. It works while the manager runs, while it does not, and for a site file with mistakes. Nothing is
    sent anywhere.

    Example: lift-manager bundle site.yaml -o support.zip --attach trace.jsonl
    """
    try:
        check_ending(output, [".zip"])
        check_free([output], force=force)
    except OutputRefused as error:
        raise fail(str(error)) from error
    if not site.is_file():
        raise fail(f"{site}: there is no such site file; a bundle is made of one")
    key, tls = key_of(key_file), tls_context(ca, certificate, certificate_key)
    loaded, mistakes = _load(site)
    journal = [] if loaded is None else _journal_path(loaded)
    secrets = [*([key.reveal()] if key is not None else []), *_secrets(site, loaded, journal)]
    made = Bundle(_redactor(loaded, with_names=with_names))
    found_rows = _newest_rows(made, loaded, journal, rows)
    texts = [_text_of(site), *(f"{row.text}\n{row.data}" for row in found_rows)]
    texts += [_text_of(one.path) for one in loaded.maps.values()] if loaded is not None else []
    made.redactor.learn_secrets([*secrets, *(password for text in texts for password in passwords(text))])
    made.redactor.learn_names(_names(found_rows))
    _add_site(made, site)
    made.add_text("check.txt", "what `lift-manager check` says of the site file", "\n".join([*mistakes, ""]))
    _add_maps(made, loaded)
    made.add_text(
        "versions.txt", "versions of Python, of its packages and of the system", "\n".join([*_versions(), ""])
    )
    _add_journal(made, found_rows, whole=len(found_rows) < rows)
    client = LiftManagerClient(manager, key, tls=tls, within_s=WITHIN_S)
    asyncio.run(_add_manager(made, client, manager))
    for path in attach:
        _attach(made, path)
    try:
        content = made.archive(made_at=datetime.now().astimezone(), version=running_version(), secrets=secrets)
        save({output: content}, force=force)
    except SecretFound as error:
        raise fail(f"nothing was written: {error}; leave that file out") from error
    except OutputRefused as error:
        raise fail(str(error)) from error
    print_lines(f"left out: {what}: {why}" for what, why in made.left_out)
    names = "with names of people" if with_names else "names of people are numbers in it"
    print_lines(
        [
            f"{output}: {len(made.pieces)} files, {len(content) // 1024 + 1} KB, without secrets; {names}. Read MANIFEST.txt first"
        ]
    )


# -- what there is


def _load(site: Path) -> tuple[LoadedSite | None, list[str]]:
    try:
        loaded = load_site(site)
    except MapFileError as error:
        return None, [str(finding) for finding in error.findings]
    return loaded, [*map(str, loaded.unusable), *loaded.cautions(), "no mistakes" if not loaded.unusable else ""]


def _text_of(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return ""  # what cannot be read is not in the bundle either, and says so there


def _redactor(loaded: LoadedSite | None, *, with_names: bool) -> Redactor:
    if loaded is None:
        return Redactor(with_names=with_names)
    floors = {floor for lift in loaded.site.lifts.values() for floor in lift.floors}
    keep = {*loaded.site.lifts, *loaded.site.controllers, *floors}
    return Redactor(with_names=with_names, hashes=[one.sha256 for one in loaded.maps.values()], keep=keep)


def _journal_path(loaded: LoadedSite) -> list[Path]:
    with suppress(StoreUnusable):
        return [store_path(loaded.site.name, loaded.site.state, loaded.path, os.environ)]
    return []


def _secrets(site: Path, loaded: LoadedSite | None, journal: Iterable[Path]) -> Iterator[str]:
    """Yield the secrets of this computer that can be read: digests of keys, and lines of private keys."""
    if loaded is None:
        return
    for path in journal:
        with suppress(KeysUnusable):
            yield from (entry.sha256 for entry in read_keys(keys_path(path), loaded.site.name).keys)
    parts = [loaded.site.api.tls, *(one.tls for one in loaded.site.controllers.values())]
    for part in parts:
        if part is not None:
            with suppress(OSError, UnicodeDecodeError):
                lines = path_of(site.parent, part.key).read_text("ascii").splitlines()
                yield from (line.strip() for line in lines if len(line.strip()) >= 32 and "-----" not in line)


def _newest_rows(made: Bundle, loaded: LoadedSite | None, journal: Iterable[Path], count: int) -> list[StoredRow]:
    if loaded is None:
        made.leave_out("journal.jsonl", "the site file has mistakes, so that the place of its journal is not known")
        return []
    for path in journal:
        try:
            with open_journal(path) as reader:
                return list(reader.newest(ALL_ROWS, count))
        except JournalUnreadable as error:
            made.leave_out("journal.jsonl", str(error))
    return []


def _names(rows: Iterable[StoredRow]) -> Iterator[str]:
    for row in rows:
        yield row.caller
        with suppress(ValueError, RecursionError):
            data = json.loads(row.data)
            if isinstance(data, dict):
                yield from (
                    str(data[key]) for key in ("by", "holder", "robot", "name") if isinstance(data.get(key), str)
                )


def _versions() -> Iterator[str]:
    yield f"lift-manager {running_version()}"
    yield f"python {sys.version.split()[0]} ({platform.python_implementation()}, {platform.machine()})"
    yield f"system {platform.system()} {platform.release()}"
    with suppress(OSError):
        release = platform.freedesktop_os_release()
        yield f"distribution {release.get('PRETTY_NAME', release.get('NAME', ''))}"
    yield f"processors {os.cpu_count()}"
    packages = {f"{found.metadata['Name']} {found.version}" for found in distributions() if found.metadata["Name"]}
    yield from sorted(packages, key=str.lower)


# -- what goes in


def _add_site(made: Bundle, site: Path) -> None:
    try:
        data = yaml.safe_load(site.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        made.leave_out(
            "site.yaml", f"it cannot be read as YAML ({type(error).__name__}), and its text may hold anything"
        )
        return
    made.add_redacted("site.yaml", "the site file, without comments", _yaml(made, data))


def _add_maps(made: Bundle, loaded: LoadedSite | None) -> None:
    if loaded is None:
        made.leave_out("maps", "the site file has mistakes, so that its maps are not known")
        return
    sheet = []
    for name, one in loaded.maps.items():
        sheet.append(f"{name}: {one.map.name}, {one.map.provenance.trust}, sha256 {one.sha256}")
    made.add_text(
        "maps.txt", "the map of each lift, with its hash including the changes of the site", "\n".join([*sheet, ""])
    )
    for path in sorted({one.path for one in loaded.maps.values()}):
        try:
            text = path.read_text("utf-8")
            if path.parent == MAPS:
                made.add_redacted(f"maps/{path.name}", "a shipped map", text)
            else:
                about = "a map of this site, without comments"
                made.add_redacted(f"maps/{path.name}", about, _yaml(made, yaml.safe_load(text)))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            made.leave_out(f"maps/{path.name}", f"it cannot be read: {error}")


def _yaml(made: Bundle, data: Any) -> str:
    text: str = yaml.safe_dump(made.redactor.data(data), sort_keys=False, allow_unicode=True, width=120)
    return text


def _add_journal(made: Bundle, rows: list[StoredRow], *, whole: bool) -> None:
    if rows:
        about = "the whole journal" if whole else f"the newest {len(rows)} rows of the journal"
        lines = (json.dumps(_row(made.redactor, row), ensure_ascii=False) for row in rows)
        made.add_redacted("journal.jsonl", about, "\n".join([*lines, ""]))


def _row(redactor: Redactor, row: StoredRow) -> dict[str, Any]:
    try:
        data = json.loads(row.data)
    except (ValueError, RecursionError):
        data = {}
    text = row.text
    if row.kind == RowKind.PERSON and not redactor.with_names:
        # what follows is the person's own words, or the answer to them
        text = text.partition(":")[0]
    return {
        "seq": row.seq,
        "at": time_of(row).astimezone(UTC).isoformat(),
        "kind": row.kind,
        "lift": redactor.text(row.lift),
        "caller": redactor.name(row.caller),
        "text": redactor.text(text),
        "data": redactor.data(data),
    }


async def _add_manager(made: Bundle, client: LiftManagerClient, address: str) -> None:
    """Add what a running manager says; note why it says nothing."""
    async with client:
        try:
            lifts = await client.lifts()
            made.redactor.learn_names(lift.session.name for lift in lifts if lift.session is not None)
            _add_json(made, "manager/lifts.json", "the lifts, from the running manager", lifts)
            _add_json(made, "manager/readiness.json", "whether robots are served", [await client.readiness()])
        except ClientError as error:
            made.leave_out("manager/", f"the state of a running manager: {address}: {error}")
            return
        requests: list[tuple[str, str, Callable[[], Any]]] = [
            ("manager/metrics.txt", "its metrics", client.metrics),
            *((f"manager/{lift.name}-signals.json", "every signal of a lift", lambda name=lift.name: client.signals(name)) for lift in lifts),
            *(
                (f"manager/{lift.name}-capabilities.json", "what a lift can do", lambda name=lift.name: client.capabilities(name))
                for lift in lifts
            ),
        ]  # fmt: skip
        for name, about, request in requests:
            try:
                answer = await request()
            except ClientError as error:
                made.leave_out(name, str(error))
                continue
            if isinstance(answer, str):
                made.add_text(name, about, answer)
            else:
                _add_json(made, name, about, [answer])


def _add_json(made: Bundle, name: str, about: str, answers: Iterable[Any]) -> None:
    data = []
    for answer in answers:
        plain = answer.model_dump(mode="json")
        session = plain.get("session")
        if isinstance(session, dict) and session.get("name"):
            session["name"] = made.redactor.name(session["name"])
        if isinstance(plain.get("reason"), str):  # of a lift: why it is offline, in words of the program
            plain["why"] = plain.pop("reason")
        data.append(made.redactor.data(plain))
    text = json.dumps(data if len(data) != 1 else data[0], indent=2, ensure_ascii=False)
    made.add_redacted(name, about, text + "\n")


def _attach(made: Bundle, path: Path) -> None:
    try:
        made.add_file(f"attached/{path.name}", "attached by the person who made this", path.read_bytes())
    except OSError as error:
        print_stderr(f"{path} cannot be read: {error.strerror or error}; it is not in the bundle")
        made.leave_out(f"attached/{path.name}", f"it cannot be read: {error.strerror or error}")
