"""`lift-manager hub`: serve many sites through one API, and add sites, switch them off and on, and make keys."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from socket import socket
from typing import Annotated, Any
from urllib.parse import quote, urlsplit

import httpx
import typer

from lift_manager.api.keys import Key
from lift_manager.api.roles import OF_SOME_LIFTS, Role
from lift_manager.app import renew_certificates
from lift_manager.cli.common import fail, out, print_lines, print_stderr
from lift_manager.cli.hub_update import app as update_app
from lift_manager.cli.key_file import key_of
from lift_manager.cli.keys import check_name, current_user, keep_to_owner, key_line
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.tls_options import Ca, tls_context
from lift_manager.config.certificates import EXPIRY_WARNING
from lift_manager.hub.commands import read_action
from lift_manager.hub.connection import require_nats
from lift_manager.hub.errors import FolderUnusable, HubError, NatsMissing, SiteRefused
from lift_manager.hub.folder import CERTIFICATES, HttpSettings, HubFolder, HubSettings, NatsSettings
from lift_manager.hub.messages import BeginRide, CancelRide
from lift_manager.hub.nats_server import NatsServerMissing
from lift_manager.hub.remote_site import SiteState
from lift_manager.hub.service import Hub
from lift_manager.hub.signing import sign, signed_text
from lift_manager.hub.web import make_hub_app
from lift_manager.plain.signals import stop_on_signals
from lift_manager.plain.text import counted
from lift_manager.store.errors import KeysUnusable
from lift_manager.store.keys import KeyFile, make_key, read_keys, revoke_key
from lift_manager.systemd import Notifier, notifier, report_to_systemd
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.origin import is_loopback
from lift_manager.web.server import listen, serve
from lift_manager.web.tls import ServerCertificates, ServerTls

KEYS_OF = "hub"
"""The name of the hub in its key file, where a site has its own."""

app = typer.Typer()
site_app = typer.Typer(no_args_is_help=True, help="Add and remove sites, and switch them off and on.")
keys_app = typer.Typer(no_args_is_help=True, help="Make, list and revoke the keys of the hub.")
app.add_typer(site_app, name="site")
app.add_typer(keys_app, name="keys")
app.add_typer(update_app, name="update")

Folder = Annotated[
    Path, typer.Option("--folder", metavar="FOLDER", help="The folder of the hub; it is made where it is missing.")
]
SiteName = Annotated[str, typer.Argument(metavar="ID", help="The id of the site: small letters, digits and hyphens.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Who does it; for the record.")]
DEFAULT = Path("hub")

_log = logging.getLogger("lift_manager")


@app.callback(invoke_without_command=True)
def hub(
    context: typer.Context,
    folder: Folder = DEFAULT,
    *,
    log_format: LogOption = LogFormat.HUMAN,
) -> None:
    """Serve the lifts of many sites, or manage the sites.

    Runs a NATS server for the leaf nodes of the sites, unless hub.yaml names servers that run by themselves. Ctrl-C or SIGTERM ends both;
    the sites run as before.

    Example: lift-manager hub --folder hub
    """
    if context.invoked_subcommand is not None:
        if folder != DEFAULT:
            text = f"write it at the end: lift-manager hub {context.invoked_subcommand} ... --folder FOLDER"
            raise typer.BadParameter(text, param_hint="--folder")
        return
    log_to_stderr(log_format)
    raise_file_limit()
    with _reporting():
        require_nats()
        place = _open(folder)
        settings = place.settings().http
        for caution in (*_cautions(place.settings()), *_expiry_cautions(place)):
            _log.warning("%s", caution)
        try:
            sock = listen(settings.host, settings.port)
        except ListenError as error:
            raise fail(f"{error}; it is `http` in {folder / 'hub.yaml'}") from error
        with sock:
            keys = _key_file(place, settings, sock)
            run(_serve(Hub(place), settings, keys, sock))


@site_app.command("add")
def add(site: SiteName, folder: Folder = DEFAULT) -> None:
    """Add a site, and write what it needs into a folder to be carried there.

    A running hub accepts it within a second.

    Example: lift-manager hub site add berlin --folder hub
    """
    with _reporting():
        place = _open(folder)
        files, port = place.add_site(site), place.settings().nats.site_port
    server = "" if port == NatsSettings().site_port else f", server: 'nats://127.0.0.1:{port}'"
    print_lines(
        [
            f"{site}: added; carry {files} to the site, and remove it here: it holds the only copy of the site's secret",
            "there, start the leaf node in that folder: nats-server -c leaf.conf",
            "and add to the site file:",
            f"hub: {{site: {site}, password: {site}/manager.password{server}}}",
        ]
    )


@site_app.command("remove")
def remove(site: SiteName, folder: Folder = DEFAULT) -> None:
    """Remove a site. What its journal reported stays.

    Example: lift-manager hub site remove berlin --folder hub
    """
    with _reporting():
        _open(folder).remove_site(site)
    print_lines([f"{site}: removed; its key opens nothing any more"])


@site_app.command("off")
def off(
    site: SiteName,
    by: By,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; for the record.")],
    folder: Folder = DEFAULT,
) -> None:
    """Switch a site off: its leaf node is disconnected and refused. The site itself runs as before.

    Example: lift-manager hub site off berlin --by "M. Weber" --reason "its key was copied" --folder hub
    """
    with _reporting():
        _open(folder).switch_off(site, by, reason)
    print_lines([f"{site}: off; a running hub disconnects it within a few seconds"])


@site_app.command("on")
def on(site: SiteName, by: By, folder: Folder = DEFAULT) -> None:
    """Switch a site on.

    Example: lift-manager hub site on berlin --by "M. Weber" --folder hub
    """
    with _reporting():
        _open(folder).switch_on(site, by)
    print_lines([f"{site}: on; its leaf node connects by itself"])


@site_app.command("list")
def list_sites(folder: Folder = DEFAULT) -> None:
    """List the sites of a hub.

    Example: lift-manager hub site list --folder hub
    """
    with _reporting():
        sites = _open(folder).registry().sites
    if not sites:
        print_lines(["there is no site; add one with `lift-manager hub site add`"])
    for site, entry in sorted(sites.items()):
        state = (
            "on"
            if entry.off is None
            else f"off since {entry.off.at:%Y-%m-%d %H:%M} UTC, by {entry.off.by}: {entry.off.reason}"
        )
        print_lines([f"{site}: {state}, key {entry.nkey[:8]}..."])


@keys_app.command("make")
def make(
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="The owner of the key.")],
    role: Annotated[
        Role,
        typer.Option(
            "--role", help="viewer reads; robot may pass commands on to the lifts named here; operator to all."
        ),
    ],
    lift: Annotated[
        list[str] | None,
        typer.Option(
            "--lift", metavar="SITE/LIFT", help="A lift to which this robot may send commands; can be repeated."
        ),
    ] = None,
    folder: Folder = DEFAULT,
) -> None:
    """Make a key of the hub and print it, this once. A command needs a key of the site as well.

    Example: lift-manager hub keys make --name dashboard --role viewer --folder hub
    """
    if role is Role.RMF:
        raise typer.BadParameter("a hub has no Open-RMF: its adapters connect to their site", param_hint="--role")
    lifts = tuple(dict.fromkeys(lift or ()))
    if (role in OF_SOME_LIFTS) != bool(lifts):
        text = "name the lifts of a robot, as in berlin/goods; a key with another role is for every lift"
        raise typer.BadParameter(text, param_hint="--lift")
    if wrong := next((entry for entry in lifts if entry.count("/") != 1), None):
        raise typer.BadParameter(f"{wrong!r}: write site and lift, as in berlin/goods", param_hint="--lift")
    key = Key("", check_name(name), role, lifts)
    with _reporting():
        made = make_key(_open(folder).keys, KEYS_OF, key, by=current_user(), at=datetime.now(UTC))
    print_stderr(
        f"{name}: a key with the role {role}; a running hub accepts it within a second, and needs a key from now on"
    )
    keep_to_owner(sys.stdout)
    out.print(made.reveal(), markup=False, highlight=False, soft_wrap=True)


@keys_app.command("list")
def list_keys(folder: Folder = DEFAULT) -> None:
    """List the keys of the hub.

    Example: lift-manager hub keys list --folder hub
    """
    with _reporting():
        keys = read_keys(_open(folder).keys, KEYS_OF).keys
    print_lines([key_line(entry) for entry in keys] or ["there is no key; `lift-manager hub keys make` makes one"])


@keys_app.command("revoke")
def revoke(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of a live key.")], folder: Folder = DEFAULT
) -> None:
    """Revoke a key of the hub.

    Example: lift-manager hub keys revoke dashboard --folder hub
    """
    with _reporting():
        revoke_key(_open(folder).keys, KEYS_OF, name, by=current_user(), at=datetime.now(UTC))
    print_lines([f"{name}: revoked; a running hub refuses it within a second"])


@app.command("send")
def send(
    site: SiteName,
    action: Annotated[
        list[str],
        typer.Argument(
            metavar="[LIFT] ACTION",
            help="The lift, unless the action is about a ride; and the action as JSON. docs/reference/hub.md has all of them.",
        ),
    ],
    *,
    key_file: Annotated[
        Path, typer.Option("--key-file", metavar="FILE", help="A key of the site, which signs the action.")
    ],
    hub_key_file: Annotated[
        Path | None, typer.Option("--hub-key-file", metavar="FILE", help="A key of the hub, if it has keys.")
    ] = None,
    address: Annotated[
        str, typer.Option("--hub", metavar="URL", help="Where the hub listens.")
    ] = "http://127.0.0.1:5080",
    ca: Ca = None,
) -> None:
    """Send one signed action to a site, and print the reply.

    Send it again with the same idempotency key to learn what became of it.

    Example: lift-manager hub send berlin goods '{"what": "open", "body": {"idempotency_key": "a1"}}' --key-file site.key
    """
    *lifts, text = action
    if len(lifts) > 1:
        raise typer.BadParameter(
            "write one action, or a lift and one action; JSON goes into quotes", param_hint="ACTION"
        )
    lift = "".join(lifts)
    site_key, hub_key = key_of(key_file), key_of(hub_key_file) if hub_key_file else None
    if site_key is None:
        raise fail(f"{key_file} holds no key")
    headers = {} if hub_key is None else {"Authorization": f"Bearer {hub_key.reveal()}"}
    path = f"/lifts/{lift}/commands" if lift else _path_of_ride(text)
    tls = tls_context(ca, None, None)
    try:
        with httpx.Client(base_url=f"{address}/api/v1/sites/{site}", headers=headers, verify=tls) as client:
            ticket = _reply(client.post("/tickets"))["ticket"]
            key_id, signature = sign(site_key, signed_text(site, lift, ticket, text))
            body = {"ticket": ticket, "key_id": key_id, "signature": signature, "action": text}
            reply = _reply(client.post(path, json=body))
    except httpx.HTTPError as error:
        raise fail(f"no hub answers at {address} ({error}); name it with --hub URL") from error
    print_lines([json.dumps({name: value for name, value in reply.items() if value is not None}, indent=2)])


def _path_of_ride(text: str) -> str:
    """Return where an action about a ride is sent to."""
    try:
        action = read_action(text)
    except SiteRefused as refused:
        raise fail(str(refused)) from refused
    match action:
        case BeginRide():
            return "/rides"
        case CancelRide(ride=ride):
            return f"/rides/{quote(ride, safe='')}/cancel"
        case _:
            raise fail(f"name the lift before the action: `{action.what}` is for one lift")


def _reply(response: httpx.Response) -> Any:
    """Return the JSON of a reply, or print why there is none and exit with 1."""
    found = response.json()
    if response.status_code != 200:
        raise fail(f"{found['detail']} ({found['code']})" if "code" in found else str(found))
    return found


def _open(folder: Path) -> HubFolder:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise FolderUnusable(
            f"{folder} cannot be made ({error.strerror or error}); choose another with --folder"
        ) from error
    return HubFolder(folder)


@contextmanager
def _reporting() -> Iterator[None]:
    """Print a sentence and exit if the hub cannot do something: with 2 if something has to be installed first, else with 1."""
    try:
        yield
    except (NatsMissing, NatsServerMissing) as error:
        print_stderr(str(error))
        raise typer.Exit(2) from error
    except (HubError, KeysUnusable) as error:
        raise fail(str(error)) from error


def _cautions(settings: HubSettings) -> Iterator[str]:
    """Yield what people should know at every start, a line each."""
    for url in settings.nats.servers:
        parts = urlsplit(url)
        if parts.scheme == "nats" and not is_loopback(parts.hostname or ""):
            yield f"the hub connects to {url} without TLS: others on the way can read its password and what sites send; write tls://"
    if settings.nats.tls is None and not settings.nats.servers and not is_loopback(settings.nats.leaf_host):
        yield f"leaf nodes connect to {settings.nats.leaf_host} without TLS: others on the way can read and change what sites send; add `nats: {{tls: ...}}`"
    if settings.http.tls is None and not is_loopback(settings.http.host):
        yield f"the API listens on {settings.http.host} without TLS: keys cross the network as they are; add `http: {{tls: ...}}`"


def _expiry_cautions(place: HubFolder) -> Iterator[str]:
    """Yield a line about each certificate that does not last much longer."""
    for name, until in place.certificates().items():
        if until is not None and until - datetime.now(UTC) < EXPIRY_WARNING:
            yield f"the certificate of `{CERTIFICATES[name]}` in hub.yaml is valid until {until:%Y-%m-%d}; renew it in time"


def _key_file(folder: HubFolder, settings: HttpSettings, sock: socket) -> KeyFile:
    host = sock.getsockname()[0]
    is_open = is_loopback(host) or settings.without_keys is not None
    keys = KeyFile(folder.keys, KEYS_OF, open_without_keys=is_open)
    if not keys.names and not is_open:
        text = (
            f"others can reach {host}, and there is no key to identify callers: make one with `lift-manager hub keys make`, or"
            " listen on 127.0.0.1, or give the reason why none is needed in hub.yaml, with `http: {without_keys: ...}`"
        )
        raise FolderUnusable(text)
    return keys


async def _serve(hub: Hub, settings: HttpSettings, keys: KeyFile, sock: socket) -> None:
    stop = asyncio.Event()
    stop_on_signals(stop)
    tls = None
    if settings.tls is not None:
        files = (hub.folder.path / settings.tls.certificate, hub.folder.path / settings.tls.key)
        try:
            tls = ServerCertificates(ServerTls(*files, None))
        except ListenError as error:
            raise FolderUnusable(str(error)) from error
    host, port = sock.getsockname()[:2]
    where = f"{'http' if tls is None else 'https'}://{host}:{port}"

    systemd, connected = notifier(), asyncio.Event()

    def ready() -> None:
        out.print(f"hub: {counted(len(hub.registry.sites), 'site')} on {where}", highlight=False)
        gc.freeze()  # a full collection of all that lives as long as the process would delay every reply by a tenth of a second
        connected.set()

    web = make_hub_app(hub, keys, host_names=(settings.host, *settings.host_names))
    async with asyncio.TaskGroup() as tasks:
        work = [serve(web, sock, tls=tls), hub.run(ready), keys.run(lambda _: None), _report(systemd, hub, connected)]
        running = [tasks.create_task(one) for one in (*work, *([] if tls is None else [renew_certificates(tls)]))]
        await stop.wait()
        systemd.send("STOPPING=1")
        for task in running:
            task.cancel()


async def _report(systemd: Notifier, hub: Hub, connected: asyncio.Event) -> None:
    """Report to systemd until cancelled: ready once there is a connection, then that the loop runs, and how many sites are online."""
    systemd.send("STATUS=waiting for a NATS server")
    await connected.wait()

    def status() -> str:
        online = sum(hub.state(site) is SiteState.ONLINE for site in hub.registry.sites)
        found = f"{counted(len(hub.registry.sites), 'site')}, {online} online"
        return found if hub.is_up else f"{found}, no connection to a NATS server"

    # no polls: a site that cannot be reached, or a NATS server, is not reached sooner by another start
    await report_to_systemd(systemd, {}, dict, status)
