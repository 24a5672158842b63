"""The folder of a hub: its settings, its sites, and the configuration of NATS servers that follows from them.

hub.yaml         settings, written by hand; optional
sites.json       the sites and their public keys, and the password of the hub at its own NATS server
nats.conf        for that server; written by the program; beside it nats.log, nats.err and nats.pid
accounts.conf    in its place where hub.yaml names NATS servers that run by themselves: what each of them includes
hub.lock         held by the hub that runs with this folder
hub.keys.json    the keys of the hub's callers
hub.db           rows of all journals, as far as they were read
sites/ID/        what a site needs: to be carried there, and removed here
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import secrets
import shutil
import ssl
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
)
from pydantic_core import PydanticCustomError

from drivers.own_files import is_shared, open_own, read_own, replace_file
from lift_manager.api.fields import first_mistake
from lift_manager.config.certificates import certificates_in
from lift_manager.config.site import HUB_SITE_ID, Host, Port
from lift_manager.hub import subjects
from lift_manager.hub.connection import client_context
from lift_manager.hub.errors import FolderUnusable
from lift_manager.hub.nkey import Nkey, make_nkey

_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\s/@:\[\]]+)(?::(\d{1,5}))?")


def _require_brackets(address: str) -> None:
    """Refuse an IPv6 address of which nobody knows where it ends and its port begins."""
    if address.count(":") > 1 and not address.startswith("["):
        message = "{address}: an IPv6 address needs brackets, such as [2001:db8::5] or [2001:db8::5]:7422"
        raise PydanticCustomError("address", message, {"address": address})


def _address(text: str) -> str:
    _require_brackets(text)
    found = _ADDRESS.fullmatch(text)
    if found is None or not 0 < int(found[2] or 1) < 65536:
        message = "{address} is no name or address, with or without a port, such as hub.example or 192.0.2.5:7422"
        raise PydanticCustomError("address", message, {"address": repr(text)})
    return text


def _server_url(url: str) -> str:
    _require_brackets(url.partition("://")[2])
    return url


def _several(given: object) -> object:
    return (given,) if isinstance(given, str) else given


SiteId = Annotated[str, StringConstraints(pattern=HUB_SITE_ID)]
ServerUrl = Annotated[
    str, StringConstraints(pattern=r"^(nats|tls)://[^/@\s]+:[0-9]{1,5}$"), AfterValidator(_server_url)
]
"""Without credentials: those of the hub are in sites.json."""
Address = Annotated[str, AfterValidator(_address)]
"""A name or an address, with or without a port."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TlsFiles(_Part):
    """A certificate and its key. Files in PEM form, relative to the folder."""

    certificate: str
    key: str


class HttpSettings(_Part):
    """Where the hub listens for its callers."""

    host: Host = "127.0.0.1"
    port: Port = 5080
    tls: TlsFiles | None = None
    """HTTPS only; plain HTTP by default."""
    without_keys: str | None = None
    """Why it is acceptable that any caller on a network address may send any request while there are no keys."""
    host_names: tuple[Host, ...] = ()
    """Names by which clients address the hub, besides its addresses and localhost; others are refused while there are no keys."""


class NatsSettings(_Part):
    """The NATS server of the hub, or the servers."""

    servers: tuple[ServerUrl, ...] = ()
    """NATS servers that run by themselves, and that include accounts.conf. None: the hub runs one of its own."""
    address: Annotated[tuple[Address, ...], BeforeValidator(_several), Field(min_length=1)] = ("127.0.0.1",)
    """Names or addresses by which the leaf nodes of sites reach it, or several servers; with a port where it is not `leaf_port`."""
    leaf_host: Host = "127.0.0.1"
    """Where it listens for them."""
    leaf_port: Port = 7422
    client_port: Port = 4222
    """Where it listens for the hub, on 127.0.0.1."""
    site_port: Port = 4223
    """Where the leaf node of a site listens for its manager, on 127.0.0.1 of the site."""
    tls: TlsFiles | None = None
    """For leaf nodes; without it what they send can be read on the way."""
    ca: str | None = None
    """The CA of that certificate, which is carried to the sites; by default those that their computers trust."""
    program: str = "nats-server"

    @property
    def urls(self) -> tuple[str, ...]:
        """Where the hub itself connects."""
        return self.servers or (f"nats://127.0.0.1:{self.client_port}",)

    @property
    def leafs_use_tls(self) -> bool:
        """Whether leaf nodes connect with TLS; to servers that run by themselves, if the hub does."""
        return self.tls is not None or any(url.startswith("tls:") for url in self.servers)


class HubSettings(_Part):
    """hub.yaml."""

    http: HttpSettings = HttpSettings()
    nats: NatsSettings = NatsSettings()


class Switch(_Part):
    """Who switched a site off or on last, and why."""

    is_off: bool
    by: str
    reason: str = ""
    at: AwareDatetime


class SiteEntry(_Part):
    """A site."""

    nkey: Annotated[str, StringConstraints(pattern=r"^U[A-Z2-7]{55}$")]
    """The public key of its leaf node."""
    switch: Switch | None = None
    """None if nobody has ever switched it."""

    @property
    def off(self) -> Switch | None:
        """Who switched the site off; None while it is on."""
        return self.switch if self.switch is not None and self.switch.is_off else None


class Registry(_Part):
    """sites.json."""

    format: str = Field(default="lift-manager hub", pattern="^lift-manager hub$")
    version: int = Field(default=1, ge=1, le=1)
    password: str = Field(min_length=20, repr=False)
    """Of the hub at its own NATS server."""
    sites: Mapping[SiteId, SiteEntry] = {}

    def with_site(self, site: str, entry: SiteEntry | None) -> Registry:
        """Return the registry with another entry for a site; None removes it."""
        others = {name: found for name, found in self.sites.items() if name != site}
        return self.model_copy(update={"sites": others if entry is None else {**others, site: entry}})


class HubFolder:
    """The files of a hub. Every method that reads or writes raises FolderUnusable."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys = path / "hub.keys.json"
        self.rows = path / "hub.db"
        self.nats_conf = path / "nats.conf"
        self.accounts_conf = path / "accounts.conf"
        self.registry_file = path / "sites.json"

    def claim(self) -> int:
        """Lock the folder against another hub until the returned descriptor is closed, or this process ends."""
        try:
            lock = open_own(self.path / "hub.lock")
        except OSError as error:
            raise FolderUnusable(f"{self.path} cannot be written ({error.strerror or error})") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(lock)
            raise FolderUnusable(f"another hub runs with {self.path}; stop that one first") from error
        return lock

    def settings(self) -> HubSettings:
        """Return the settings; the defaults where there is no file."""
        file = self.path / "hub.yaml"
        try:
            found: Any = yaml.safe_load(file.read_text("utf-8"))
        except FileNotFoundError:
            return HubSettings()
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise FolderUnusable(f"{file} cannot be read: {error}") from error
        try:
            return HubSettings.model_validate({} if found is None else found)
        except ValidationError as error:
            raise FolderUnusable(f"{file}: {first_mistake(error)}") from error

    def tls_changed_at(self) -> tuple[int, ...]:
        """Return what changes with the TLS files of the NATS server."""
        tls = self.settings().nats.tls
        files = () if tls is None else (tls.certificate, tls.key)
        try:
            return tuple((self.path / file).stat().st_mtime_ns for file in files)
        except OSError as error:
            raise FolderUnusable(f"{error.filename} cannot be read ({error.strerror})") from error

    def certificates(self) -> dict[str, datetime | None]:
        """Return until when the certificates of the settings are valid, by what they are for; None for one that cannot be read."""
        settings = self.settings()
        http, nats = settings.http.tls, settings.nats.tls
        files = {
            "api": None if http is None else http.certificate,
            "nats": None if nats is None else nats.certificate,
            "ca": settings.nats.ca,
        }
        return {
            name: min((found.not_valid_after_utc for found in certificates_in(self.path / file)), default=None)
            for name, file in files.items()
            if file is not None
        }

    def client_tls(self) -> ssl.SSLContext | None:
        """Return the TLS of connections to NATS servers with tls:// URLs; None where there is none."""
        nats = self.settings().nats
        if not any(url.startswith("tls:") for url in nats.servers):
            return None
        ca = None if nats.ca is None else self.path / nats.ca
        try:
            return client_context(ca)
        except OSError as error:
            raise FolderUnusable(f"nats.ca: {ca} cannot be used: {error.strerror or error}") from error

    def registry(self) -> Registry:
        """Return the sites; a registry without sites where there is no file."""
        if is_shared(self.path):
            text = f"{self.path} can be written by others, who could add sites; `chmod 700 {self.path}`"
            raise FolderUnusable(text)
        try:
            data, _ = read_own(self.registry_file)
        except FileNotFoundError:
            return Registry(password=secrets.token_urlsafe(24))
        except OSError as error:
            raise FolderUnusable(f"{self.registry_file} cannot be read ({error.strerror or error})") from error
        try:
            return Registry.model_validate_json(data)
        except ValidationError as error:
            raise FolderUnusable(f"{self.registry_file}: {first_mistake(error)}; restore a copy of it") from None

    def write(self, registry: Registry) -> None:
        """Write the registry, and what follows from it for the NATS servers."""
        settings = self.settings().nats
        try:
            replace_file(self.registry_file, registry.model_dump_json(indent=2).encode() + b"\n")
            if settings.servers:
                replace_file(self.accounts_conf, _configuration(_accounts(registry)).encode())
            else:
                replace_file(self.nats_conf, server_configuration(settings, registry, self.path).encode())
        except OSError as error:
            raise FolderUnusable(f"{self.path} cannot be written ({error.strerror or error})") from error

    def add_site(self, site: str) -> Path:
        """Add a site, and return the folder to be carried there."""
        if re.fullmatch(HUB_SITE_ID, site) is None:
            text = f"{site!r} cannot be the id of a site: 1 to 32 small letters, digits and hyphens, with no hyphen at either end"
            raise FolderUnusable(text)
        registry = self.registry()
        if site in registry.sites:
            raise FolderUnusable(f"there is a site {site} already; remove it first: it then needs its new files")
        nkey, password = make_nkey(), secrets.token_urlsafe(24)
        settings, folder = self.settings().nats, self.path / "sites" / site
        try:
            folder.mkdir(parents=True, mode=0o700, exist_ok=True)
            if settings.ca is not None:
                shutil.copyfile(self.path / settings.ca, folder / "ca.pem")
            replace_file(folder / "leaf.conf", leaf_configuration(settings, site, nkey, password).encode())
            replace_file(folder / "manager.password", password.encode() + b"\n")
        except OSError as error:
            raise FolderUnusable(f"{folder} cannot be written ({error.strerror or error})") from error
        self.write(registry.with_site(site, SiteEntry(nkey=nkey.public)))
        return folder

    def remove_site(self, site: str) -> None:
        """Remove a site: its key opens nothing any more."""
        self._entry(site)
        self.write(self.registry().with_site(site, None))
        shutil.rmtree(self.path / "sites" / site, ignore_errors=True)

    def switch_off(self, site: str, by: str, reason: str) -> None:
        """Switch a site off: its leaf node is refused until it is switched on again."""
        entry = self._entry(site)
        if entry.off is not None:
            raise FolderUnusable(f"{site} was switched off by {entry.off.by} already: {entry.off.reason}")
        off = Switch(is_off=True, by=by, reason=reason, at=datetime.now(UTC))
        self.write(self.registry().with_site(site, entry.model_copy(update={"switch": off})))

    def switch_on(self, site: str, by: str) -> None:
        """Switch a site on."""
        entry = self._entry(site)
        if entry.off is None:
            raise FolderUnusable(f"{site} is not switched off")
        on = Switch(is_off=False, by=by, at=datetime.now(UTC))
        self.write(self.registry().with_site(site, entry.model_copy(update={"switch": on})))

    def _entry(self, site: str) -> SiteEntry:
        sites = self.registry().sites
        if site not in sites:
            raise FolderUnusable(f"there is no site {site!r}; the sites are {', '.join(sites) or 'none'}")
        return sites[site]


def _accounts(registry: Registry) -> dict[str, object]:
    """Return the accounts of the NATS servers: one for each site, and one for the hub.

    What leaves the account of a site is fixed here, by its subjects: whatever a site publishes, it publishes as itself. A site that is
    switched off has no account, so its leaf node is refused.
    """
    live = [(site, entry) for site, entry in registry.sites.items() if entry.off is None]
    accounts = {account(site): _site_account(site, entry) for site, entry in live}
    imports: list[object] = []
    for site, _ in live:
        of = account(site)
        imports += [
            {"stream": {"account": of, "subject": subjects.news(site)}},
            {"service": {"account": of, "subject": subjects.rows(site)}},
            {"service": {"account": of, "subject": subjects.request(site, ">")}},
        ]
    exports = [{"service": subjects.update(site, "*"), "accounts": [account(site)]} for site, _ in live]
    hub = {
        "users": [{"user": "hub", "password": registry.password}],
        "imports": imports,
        "exports": exports,
    }
    system = {"users": [{"user": "system", "password": registry.password}]}
    return {"accounts": {**accounts, "HUB": hub, SYSTEM: system}, "system_account": SYSTEM}


def server_configuration(settings: NatsSettings, registry: Registry, folder: Path) -> str:
    """Return the configuration of the NATS server that the hub runs."""
    # else leaf nodes learn the addresses of this computer, and try those too, which may be other computers where they are
    host = settings.leaf_host
    leafnodes: dict[str, object] = {
        "listen": f"{f'[{host}]' if ':' in host and not host.startswith('[') else host}:{settings.leaf_port}",
        "no_advertise": True,
        "compression": COMPRESSION,
    }
    if settings.tls is not None:
        leafnodes["tls"] = {
            "cert_file": str(folder.absolute() / settings.tls.certificate),
            "key_file": str(folder.absolute() / settings.tls.key),
        }
    return _configuration(
        {
            "server_name": "lift-manager-hub",
            "listen": f"127.0.0.1:{settings.client_port}",
            "max_payload": MAX_PAYLOAD,
            "ping_interval": PING,
            "pid_file": str(folder.absolute() / PID_FILE),
            "log_file": str(folder.absolute() / LOG_FILE),
            "logfile_size_limit": LOG_BYTES,
            "logfile_max_num": 3,
            "leafnodes": leafnodes,
            **_accounts(registry),
        }
    )


CERTIFICATES = {"api": "http: tls", "nats": "nats: tls", "ca": "nats: ca"}
"""What certificates are for, with the setting that names each."""
PID_FILE, LOG_FILE = "nats.pid", "nats.log"
LOG_BYTES = 10_000_000
"""Of one of three log files: a site that is refused causes lines as often as it likes."""
SYSTEM = "SYSTEM"
"""The account through which the hub closes the connection of a site that is switched off."""
PING = "5s"
"""How often a server tests a connection; after two tests without a reply it gives it up. By default that takes a leaf node six minutes."""
COMPRESSION = "off"
"""By default a server compresses what goes between it and a leaf node, which takes 3.5 MB of each site on both sides (2.15, measured)."""
MAX_PAYLOAD = 1024 * 1024
"""Bytes of a message: a thousand lifts fit."""


def account(site: str) -> str:
    """Return the account of a site on the NATS servers of the hub."""
    return f"SITE_{site}"


def _site_account(site: str, entry: SiteEntry) -> dict[str, object]:
    own = f"{subjects.prefix(site)}.>"
    return {
        "users": [
            {
                "nkey": entry.nkey,
                # _R_: where the server of the hub expects the reply to a request that it let into this account
                "permissions": {"publish": [own, "_R_.>"], "subscribe": [own]},
            }
        ],
        "exports": [
            {"stream": subjects.news(site), "accounts": ["HUB"]},
            {"service": subjects.rows(site), "accounts": ["HUB"], "response_type": "stream"},
            {"service": subjects.request(site, ">"), "accounts": ["HUB"]},
        ],
        "imports": [{"service": {"account": "HUB", "subject": subjects.update(site, "*")}}],
    }


def leaf_configuration(settings: NatsSettings, site: str, nkey: Nkey, password: str) -> str:
    """Return the configuration of the leaf node of a site, whose JetStream works with and without the hub."""
    scheme = "tls" if settings.leafs_use_tls else "nats-leaf"
    remote: dict[str, object] = {
        "urls": [f"{scheme}://{_with_port(address, settings.leaf_port)}" for address in settings.address],
        "nkey": nkey.seed,
        "account": subjects.ACCOUNT,
        "compression": COMPRESSION,
    }
    if settings.leafs_use_tls:
        remote["tls"] = {"ca_file": "ca.pem"} if settings.ca is not None else {}
    account = {
        "jetstream": "enabled",
        "users": [{"user": "manager", "password": password}],
        # the hub reads rows, and can do nothing else with the stream
        "mappings": {subjects.rows(site): f"$JS.API.DIRECT.GET.{subjects.STREAM}"},
    }
    return _configuration(
        {
            "server_name": f"leaf-{site}",
            "listen": f"127.0.0.1:{settings.site_port}",
            "max_payload": MAX_PAYLOAD,
            "ping_interval": PING,
            "jetstream": {"domain": subjects.domain(site), "store_dir": "jetstream"},
            "accounts": {subjects.ACCOUNT: account},
            "leafnodes": {"reconnect": "2s", "remotes": [remote]},
        }
    )


def _with_port(address: str, port: int) -> str:
    """Return an address with its port, or with this one where it has none."""
    has_port = ":" in address.rpartition("]")[2]
    return address if has_port else f"{address}:{port}"


def _configuration(content: Mapping[str, object]) -> str:
    """Return a configuration of a NATS server: JSON, which is a form of its notation."""
    return f"# Written by `lift-manager hub`; it holds secrets.\n{json.dumps(content, indent=2)[1:-1].strip()}\n"
