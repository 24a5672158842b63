"""`lift-manager keys`: make, list and revoke the keys of a site."""

from __future__ import annotations

import getpass
import os
import re
import stat
import sys
from datetime import UTC, datetime
from typing import Annotated, TextIO

import typer

from lift_manager.api.keys import Key, holds_key
from lift_manager.api.roles import OF_SOME_LIFTS, Role
from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, out, print_lines, print_stderr, store_path_of
from lift_manager.config.load import LoadedSite
from lift_manager.store.errors import KeysUnusable
from lift_manager.store.keys import KeyEntry, keys_path, make_key, read_keys, revoke_key

app = typer.Typer(no_args_is_help=True, help="Make, list and revoke the keys of a site.")

_NAME = re.compile(r"\w(?:[\w .-]{0,30}\w)?")
_FACES = ("workshop", "api", "rmf", "page", "commissioning", "hub")
"""A session is shown as `<face>:<name>`, or as the face alone for anonymous callers."""
RUNNING = "a manager that runs for this site sees it within a second; one that is not running, at its start"

Name = Annotated[
    str, typer.Option("--name", metavar="NAME", help="The owner of the key; also the name of its sessions.")
]


@app.command()
def make(
    site: SiteFile,
    name: Name,
    role: Annotated[
        Role,
        typer.Option(
            "--role",
            help="viewer reads; robot also commands the lifts named here; rmf, for `lift-manager rmf`, opens RMF's sessions there;"
            " operator commands all lifts, and may do what people do.",
        ),
    ],
    lift: Annotated[
        list[str] | None,
        typer.Option("--lift", metavar="LIFT", help="A lift that this robot, or RMF, may command; can be repeated."),
    ] = None,
) -> None:
    """Make a key and print it, this once.

    The key goes to stdout, everything else to stderr.

    Example: lift-manager keys make site.yaml --name kitchen --role robot --lift goods
    """
    loaded = load_site_or_exit(site)
    key = Key("", check_name(name), role, _lifts(loaded, role, lift or []))
    path = keys_path(store_path_of(loaded))
    try:
        first = not read_keys(path, loaded.site.name).live
        made = make_key(path, loaded.site.name, key, by=current_user(), at=datetime.now(UTC))
    except KeysUnusable as error:
        raise fail(str(error)) from error
    print_stderr(f"{key.name}: a key with the role {role}, kept as a hash in {path}; {RUNNING}")
    print_stderr("this is the only time that it is shown; send it in the header `Authorization: Bearer ...`")
    if first:
        print_stderr("it is the first key of this site: from now on every request needs one, on this computer too")
        print_stderr(
            "a robot that rides without a key loses its ride: with a key it has another name, and is refused until its old"
            " session is over. Make the first key while no robot rides; if one does, wait until it is outside, or end its session with"
            " `lift-manager release`, look into the car, and run `lift-manager ack`"
        )
    keep_to_owner(sys.stdout)
    out.print(made.reveal(), markup=False, highlight=False, soft_wrap=True)


def keep_to_owner(stream: TextIO) -> None:
    """Make a file to which stdout is redirected private: the shell makes it readable for all, and no command accepts such a key."""
    try:
        number = stream.fileno()
    except OSError:
        return  # it is no file at all
    try:
        if stat.S_ISREG(os.fstat(number).st_mode):
            os.fchmod(number, 0o600)
    except OSError:
        print_stderr("every user of this computer may be able to read the file that the key goes to; `chmod 600` it")


@app.command("list")
def list_keys(site: SiteFile) -> None:
    """List the keys of a site, live and revoked.

    A key itself is never shown again.

    Example: lift-manager keys list site.yaml
    """
    loaded = load_site_or_exit(site)
    path = keys_path(store_path_of(loaded))
    try:
        keys = read_keys(path, loaded.site.name).keys
    except KeysUnusable as error:
        raise fail(str(error)) from error
    if not keys:
        print_lines([f"there is no key in {path}; make one with `lift-manager keys make`"])
    print_lines(key_line(entry) for entry in keys)


@app.command()
def revoke(
    site: SiteFile, name: Annotated[str, typer.Argument(metavar="NAME", help="The name of a live key.")]
) -> None:
    """Revoke a key.

    It is refused within a second. A session that it holds ends with its lease, or by `lift-manager release`.

    Example: lift-manager keys revoke site.yaml kitchen
    """
    loaded = load_site_or_exit(site)
    path = keys_path(store_path_of(loaded))
    try:
        remaining = revoke_key(path, loaded.site.name, name, by=current_user(), at=datetime.now(UTC))
    except KeysUnusable as error:
        raise fail(str(error)) from error
    print_lines([f"{name}: revoked; {RUNNING}"])
    if not remaining.live:
        print_stderr("it was the last live key: where the site is open without keys, as on 127.0.0.1, it is open again")


def check_name(name: str) -> str:
    if not _NAME.fullmatch(name) or holds_key(name):
        raise typer.BadParameter("use 1 to 32 letters, digits, spaces, points and hyphens", param_hint="--name")
    if name.casefold() in _FACES:
        raise typer.BadParameter(f"{name} is the name of a face of the manager; choose another", param_hint="--name")
    return name


def _lifts(loaded: LoadedSite, role: Role, lifts: list[str]) -> tuple[str, ...]:
    known = ", ".join(loaded.site.lifts)
    if role not in OF_SOME_LIFTS:
        if lifts:
            raise typer.BadParameter(f"a key with the role {role} is for every lift; leave it out", param_hint="--lift")
        return ()
    if not lifts:
        raise typer.BadParameter(f"name the lifts that this key may command: {known}", param_hint="--lift")
    for lift in lifts:
        if lift not in loaded.site.lifts:
            raise typer.BadParameter(f"this site has no lift {lift!r}; there is {known}", param_hint="--lift")
    return tuple(dict.fromkeys(lifts))


def key_line(entry: KeyEntry) -> str:
    lifts = f" for {', '.join(entry.lifts)}" if entry.lifts else ""
    made = f"made {entry.made_at:%Y-%m-%d %H:%M} UTC by {entry.made_by}"
    if entry.revoked_at is None:
        return f"{entry.name}: {entry.role}{lifts}, id {entry.id}, {made}"
    revoked = f"revoked {entry.revoked_at:%Y-%m-%d %H:%M} UTC by {entry.revoked_by}"
    return f"{entry.name}: {entry.role}{lifts}, id {entry.id}, {made}, {revoked}"


def current_user() -> str:
    """Return the user at the terminal: with sudo, not root."""
    if person := os.environ.get("SUDO_USER", ""):
        return person
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"user {os.getuid()}"
