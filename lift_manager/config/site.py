"""The model of a site file: the controllers and lifts of one building."""

from __future__ import annotations

import re
from functools import cache
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag
from pydantic_core import PydanticCustomError

from lift_manager.lift.hours import Hours, read_hours
from lift_manager.lift.rmf_view import ADAPTER_ID, ADAPTER_ID_LIMIT, LONGEST_GRACE_S, RmfRules
from lift_manager.plain.text import is_printable
from register_maps.expand import ParameterValue
from register_maps.words import Side, Table

Text = Annotated[
    str,
    StringConstraints(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="text on one line, without control characters"),
]


def _printable(text: str) -> str:
    if not is_printable(text) or text.isspace():
        raise PydanticCustomError("printable", "must be printable text on one line")
    return text


DisplayName = Annotated[Text, AfterValidator(_printable)]
Seconds = Annotated[float, Field(gt=0, le=86400)]
Clear = Annotated[float, Field(gt=0, le=600)]
"""What a robot needs to be out of a doorway."""
Wait = Annotated[float, Field(gt=0, le=10)]
"""Time limit for a reply, a connection or a fresh reading: anything longer would be history, not news."""
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]
FileName = Annotated[
    str,
    StringConstraints(min_length=1, max_length=1024, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="the path of a file, relative to the site file"),
]
OwnFile = Annotated[
    FileName,
    StringConstraints(pattern=r"^/"),
    Field(description="the absolute path of a file of this computer, which no update replaces"),
]
HIGHEST_ADDRESS = 65535
MODBUS_PORT = 502
SECURE_PORT = 802
"""Registered for mbap/TLS/TCP."""
UnitId = Annotated[int, Field(strict=True, ge=0, le=255)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


Code = Annotated[int, Field(strict=True, ge=-32768, le=65535)]


class Floor(_Part):
    """One floor of one lift."""

    code: Code
    """What the controller calls it."""
    doors: tuple[Side, ...] | None = None
    """Which doors serve it; by default all doors of the map."""


def _form(value: object) -> str:
    return "[long]" if isinstance(value, dict | Floor) else "[short]"


def _floor(value: int | Floor) -> Floor:
    """`L1: 1` is short for `L1: {code: 1}`."""
    return _floor_of(value) if isinstance(value, int) else value


@cache
def _floor_of(code: int) -> Floor:
    """Return the floor of a code. Lifts share it: each would take 0.4 KB, and many lifts have the same codes."""
    return Floor(code=code)


if TYPE_CHECKING:
    AnyFloor = Floor
else:
    # a tagged union and not a BeforeValidator: behind one, pydantic no longer knows that lists and words came from JSON
    AnyFloor = Annotated[
        Annotated[Code, Tag("[short]")] | Annotated[Floor, Tag("[long]")], Discriminator(_form), AfterValidator(_floor)
    ]


def is_parameter_value(value: object) -> bool:
    """Whether a value may be a parameter of a map: a number or text, not a boolean."""
    return isinstance(value, int | float | str) and not isinstance(value, bool)


def _parameter_value(value: object) -> object:
    if not is_parameter_value(value):
        raise PydanticCustomError("parameter_value", "must be a number or text")
    return value


if TYPE_CHECKING:
    Given = ParameterValue
else:
    # not a union: pydantic would report each of its branches
    Given = Annotated[Any, AfterValidator(_parameter_value)]


def _hours(text: str) -> Hours:
    try:
        return read_hours(text)
    except ValueError as error:
        raise PydanticCustomError("robot_hours", "{problem}", {"problem": str(error)}) from error


def _not_none_at_all(hours: tuple[Hours, ...]) -> tuple[Hours, ...]:
    # not `min_length`: pydantic would not count an entry with a mistake, and report that too
    if not hours:
        raise PydanticCustomError(
            "robot_hours", "names no hours; leave it out, or keep robots off with `access: monitor`"
        )
    return hours


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (ValueError, OSError, ZoneInfoNotFoundError):
        message = "{name} is no time zone; write one of the IANA names, such as Europe/Berlin or Asia/Singapore"
        raise PydanticCustomError("timezone", message, {"name": repr(name)}) from None
    return name


def _host(text: str) -> str:
    """Refuse what can be neither a name nor an address, although it looks like one."""
    if "/" in text or " " in text:
        raise PydanticCustomError("host", "must be a name or an address alone, such as 192.0.2.5 or lift-plc.example")
    name, colon, port = text.partition(":")
    if colon and port.isdecimal():
        message = "must be a name or an address alone: write `host: {name}` and `port: {port}`"
        raise PydanticCustomError("host", message, {"name": name, "port": port})
    if set(text) <= set("0123456789.") and not _is_address(text):
        raise PydanticCustomError(
            "host", "{text} is no IPv4 address: it has four numbers from 0 to 255", {"text": text}
        )
    return text


def _is_address(text: str) -> bool:
    try:
        ip_address(text)
    except ValueError:
        return False
    return True


def _url(text: str) -> str:
    """Refuse what is no base URL of an HTTP server."""
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.path not in ("", "/") or parts.query:
        raise PydanticCustomError("url", "must be a URL such as https://192.0.2.11:2379, without a path")
    return text.rstrip("/")


MACHINE = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
"""The name of a machine: a host name is one."""

Host = Annotated[Text, AfterValidator(_host)]


Network = IPv4Network | IPv6Network


def _network(text: str) -> Network:
    try:
        return ip_network(text)
    except ValueError:
        message = "{text} is no address and no network, such as 192.0.2.5 or 192.0.2.0/28"
        raise PydanticCustomError("network", message, {"text": repr(text)}) from None


if TYPE_CHECKING:
    SomeNetwork = Network
else:
    SomeNetwork = Annotated[Text, AfterValidator(_network)]


class WritableRange(NamedTuple):
    """Adjacent coils or holding registers of a controller, by their addresses on the wire."""

    table: Table
    first: int
    last: int

    def __str__(self) -> str:
        return f"{self.table} {self.first}" if self.first == self.last else f"{self.table} {self.first} to {self.last}"

    def holds(self, table: Table, address: int) -> bool:
        """Whether an address is one of them."""
        return table is self.table and self.first <= address <= self.last


def _writable_range(text: str) -> WritableRange:
    found = re.fullmatch(r"(coil|holding) ([0-9]{1,5})(?: to ([0-9]{1,5}))?", text)
    if found is not None:
        first, last = int(found[2]), int(found[3] or found[2])
        if first <= last <= HIGHEST_ADDRESS:
            return WritableRange(Table(found[1]), first, last)
    raise PydanticCustomError(
        "writable_range",
        "must be a table and its addresses on the wire, lowest first, such as `coil 16 to 31` or `holding 40`",
    )


if TYPE_CHECKING:
    SomeRange = WritableRange
else:
    SomeRange = Annotated[Text, AfterValidator(_writable_range)]

if TYPE_CHECKING:
    SomeHours = Hours
else:
    SomeHours = Annotated[Text, AfterValidator(_hours)]


class ApiTls(_Part):
    """The certificate of the manager, and the CA of its clients. Files in PEM form."""

    certificate: FileName
    """That of the manager, followed by the intermediate ones."""
    key: FileName
    client_ca: FileName | None = None
    """If set, only clients with a certificate of this CA are accepted."""


class Api(_Part):
    """Where the manager listens."""

    host: Host = "127.0.0.1"
    port: Port = 5003
    """5003 is where clients of the Open-RMF workshop look."""
    tls: ApiTls | None = None
    """HTTPS only; plain HTTP by default."""
    without_keys: Text | None = None
    """Why it is acceptable that any caller on a network address may send any request while there are no keys."""
    host_names: tuple[Host, ...] = ()
    """Names by which clients address the manager, besides its addresses and localhost; others are refused while there are no keys."""
    trusted_proxies: tuple[SomeNetwork, ...] = ()
    """Addresses and networks of proxies for many clients, which the connection limit per client does not apply to."""


class ControllerTls(_Part):
    """Modbus/TCP Security: the CA of a controller, and the certificate of the manager. Files in PEM form."""

    ca: FileName
    """The CA of the controller's certificate, or that certificate itself."""
    certificate: FileName
    """That of the manager, with the role by which the controller knows it."""
    key: FileName
    server_name: Text | None = None
    """The name or address in the certificate of the controller, if that is not its `host`."""


class Controller(_Part):
    """One device at one address. Defaults come from its map."""

    host: Host
    tls: ControllerTls | None = None
    given_port: Port | None = Field(default=None, alias="port")
    map: Text | None = None
    """A shipped map by name, or a path relative to the site file. Only a controller that serves only endpoints needs none."""
    unit_id: UnitId | None = None
    timeout_s: Wait | None = None
    connect_timeout_s: Wait = 1.0
    min_gap_s: Annotated[float, Field(ge=0, le=10)] | None = None
    reconnect_min_s: Seconds | None = None
    idle_timeout_s: Seconds | None = None
    """After this long without a request it closes the connection, or forgets its client."""
    max_registers_per_read: Annotated[int, Field(strict=True, ge=1, le=125)] | None = None
    max_bits_per_read: Annotated[int, Field(strict=True, ge=1, le=2000)] | None = None
    tid_echo: bool | None = None
    writable_ranges: tuple[SomeRange, ...] = ()
    """What `lift-manager poke --unlock` may write besides the commands of the map; nothing by default."""
    simulated: Annotated[bool, Field(strict=True)] = False
    """It is a simulator: interfaces for people show that. Nothing else depends on it."""

    @property
    def port(self) -> int:
        """The port to connect to; by default 502, or 802 over TLS."""
        if self.given_port is not None:
            return self.given_port
        return MODBUS_PORT if self.tls is None else SECURE_PORT


class Endpoint(_Part):
    """The address of a further device of a lift."""

    controller: Text
    unit_id: UnitId | None = None
    """By default that of its controller, otherwise that of the map."""


_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
RosName = Annotated[
    str,
    StringConstraints(max_length=255, pattern=rf"^/?{_NAME}(/{_NAME})*$"),
    Field(description="letters, digits and underscores, with slashes between, as ROS 2 names topics"),
]


class Rmf(_Part):
    """The settings of Open-RMF."""

    clear_s: Clear = 30.0
    """`clear_s` of a lift for sessions of RMF, whose robots start on one OPEN and do not check again."""
    end_grace_s: Annotated[float, Field(ge=0, le=LONGEST_GRACE_S)] = RmfRules().end_grace_s
    """How long door hold and robot mode stay after END_SESSION, in case the session continues after all."""
    fire_alarm: bool = False
    """Publish a fire on `fire_alarm_trigger`: every fleet of that RMF evacuates."""
    emergency_signal: bool = False
    """Publish it on `emergency_signal`, which kilted and later support."""
    emergency_fleets: tuple[Text, ...] = ()
    """The fleets that it names; by default all of them."""
    clear_on_acknowledge: bool = False
    """Publish its end once a person has acknowledged it. This clears the alarms of others, too."""
    namespace: RosName | None = None
    """Prefix of both topics."""
    lift_states: RosName = "lift_states"
    lift_requests: RosName = "lift_requests"
    adapter_lift_requests: RosName = "adapter_lift_requests"
    adapter_id: Annotated[str, StringConstraints(max_length=ADAPTER_ID_LIMIT, pattern=ADAPTER_ID)] = ""
    """The id of the adapter in the manager, if there are other adapters; by default made of domain and namespace."""
    domain: Annotated[int, Field(strict=True, ge=0, le=232)] | None = None
    """By default that of ROS_DOMAIN_ID."""
    peers: tuple[Text, ...] = ()
    """Addresses of RMF, for networks without multicast."""
    use_sim_time: bool = False
    """Use the time of /clock, as the nodes of a simulation do."""

    @property
    def rules(self) -> RmfRules:
        """The part of it that the manager passes to every adapter."""
        return RmfRules(
            end_grace_s=self.end_grace_s,
            fire_alarm=self.fire_alarm,
            emergency_signal=self.emergency_signal,
            emergency_fleets=self.emergency_fleets,
            clear_on_acknowledge=self.clear_on_acknowledge,
        )


class LiftRmf(_Part):
    """The names of one lift in RMF's building map; by default those of the site file."""

    name: Text | None = None
    floors: dict[Text, Text] = Field(default_factory=dict)
    """RMF's name of a floor, by its name here."""


_SAME_NAMES = LiftRmf()


class Lift(_Part):
    """One lift on a controller, and on further devices where its map has endpoints."""

    controller: Text
    display_name: DisplayName | None = None
    """The name for people; by default its name."""
    parameters: dict[Text, Given] = Field(default_factory=dict)
    """Values for the parameters of its map."""
    override: dict[Text, Any] = Field(default_factory=dict)
    """Changes to its map, key by key, in the format of a map. Number keys are text here: LoadedSite.maps has the result."""
    endpoints: dict[Text, Endpoint] = Field(default_factory=dict)
    """The endpoints of the map by name; all of them are required."""
    floors: dict[Text, AnyFloor] = Field(min_length=2)
    """Lowest first."""
    access: Literal["monitor", "control"] = "monitor"
    """`monitor` never writes."""
    offset: dict[Table, Annotated[int, Field(strict=True, ge=-65535, le=65535)]] = Field(default_factory=dict)
    """Moves all addresses of a table of the controller itself, for one of several lifts on it."""
    unit_id: UnitId | None = None
    group: Text | None = None
    """The group with which it shares landing calls."""
    infer_occupancy: bool = False
    """Infer from the requests of a caller whether its robot boards and leaves, if the caller cannot report it."""
    board_min_s: Annotated[float, Field(ge=0, le=600)] = 5.0
    """A request for a floor sooner than this after the door opened does not indicate boarding."""
    poll_s: Annotated[float, Field(ge=0.02, le=60)] | None = None
    """By default 0.2, or `min_poll_s` of the map if that is more."""
    poll_ridden_s: Annotated[float, Field(ge=0.02, le=60)] | None = None
    """The same while a session has the lift, where the controller answers four times as fast. By default 0.05, or `min_poll_s`."""
    max_age_s: Wait | None = None
    lease_s: Seconds = 300.0
    max_session_hold_s: Seconds = 900.0
    max_session_s: Seconds = 3600.0
    """The longest duration of a session, renewed or not; it ends when no robot is under way."""
    clear_s: Clear = 10.0
    """From the withdrawal of OPEN to the release of a held door, if the manager knows the end of the hold in advance."""
    takeover_after_s: Seconds | None = None
    """A holder that is silent for this long loses an empty car to the next caller; by default never."""
    robot_hours: Annotated[tuple[SomeHours, ...], AfterValidator(_not_none_at_all)] | None = None
    """When robots may begin, in the local time of the building; by default always."""
    between_sessions_s: Annotated[float, Field(ge=0, le=600)] = 5.0
    """Time reserved for people between two robots."""
    fire_release_delay_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """From announcing a fire to robots to releasing everything. Bounded: a robot at 0.5 m/s is out of a doorway in two seconds."""
    rmf: LiftRmf = Field(default_factory=lambda: _SAME_NAMES)  # pydantic would copy a default for each lift
    """Its names in RMF's building map."""
    accept_latching: Text | None = None
    """Why it is acceptable that an output stays on when this manager is lost and nothing releases it."""


HUB_SITE_ID = r"^[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?$"
"""The id of a site at a hub: a token of a NATS subject and of an account name, in an address and in a file name."""


class Hub(_Part):
    """The hub of many sites that this one belongs to."""

    site: Annotated[
        str,
        StringConstraints(pattern=HUB_SITE_ID),
        Field(description="1 to 32 small letters, digits and hyphens, as `lift-manager hub site add` was given it"),
    ]
    """The id of this site at the hub."""
    server: Annotated[
        str,
        StringConstraints(max_length=300, pattern=r"^(nats|tls)://[^\s/@]+$"),
        Field(description="the address of a NATS server, such as nats://127.0.0.1:4223"),
    ] = "nats://127.0.0.1:4223"
    """The site's own leaf node."""
    password: FileName
    """The file with the password for it."""
    commands: Annotated[bool, Field(strict=True)] = False
    """Whether users with a key of this site may command its lifts through the hub."""
    updates: tuple[OwnFile, ...] = ()
    """Public keys of the people whose configuration updates this site takes; by default it takes none."""


class Machine(_Part):
    """One of the two machines of a cluster."""

    address: Annotated[Text, AfterValidator(_url)]
    """Where clients reach its manager, such as https://192.0.2.11:5003."""
    switch: Text | None = None
    """The network switch that it hangs on, for a warning if that is the other one's as well."""
    supply: Text | None = None
    """Its power supply, likewise."""


class ClusterTls(_Part):
    """The CA of the members of etcd, and the certificate of the manager. Files in PEM form."""

    ca: FileName
    certificate: FileName
    key: FileName


Argument = Annotated[
    str,
    StringConstraints(min_length=1, max_length=1000, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="a program or one of its arguments: 1 to 1000 characters, none of them a control character"),
]


class Fence(_Part):
    """How a site keeps the other machine away from a controller."""

    command: Annotated[tuple[Argument, ...], Field(min_length=1)]
    """A program and its arguments, run by the machine that takes over, before it connects; it ends with 0 once the way of the other
    machine to the controller is closed. It runs in the folder of the site file."""
    within_s: Annotated[float, Field(gt=0, le=60)] = 5.0
    """How long it may take; then it is killed, and tried again."""


class Cluster(_Part):
    """Two managers of which one is active."""

    machines: dict[Annotated[Text, StringConstraints(pattern=MACHINE)], Machine]
    """By name. Both machines have the same site file."""
    machine: Text | None = None
    """The name of this machine; by default its host name."""
    etcd: tuple[Annotated[Text, AfterValidator(_url)], ...] = Field(min_length=1)
    """The client URLs of its members."""
    tls: ClusterTls | None = None
    """Needed for https."""

    fence: dict[Text, Fence] = Field(default_factory=dict)
    """By controller; without one, a write of a manager that was just replaced may still arrive there."""
    packet_filter: FileName | None = None
    """The socket of the packet filter that runs on each machine, and lets only a manager with a term reach the controllers."""

    def number_of(self, machine: str) -> int:
        """Return the number by which controllers that arbitrate know a machine: 1 for the first one here."""
        return list(self.machines).index(machine) + 1

    accept_latching: dict[Text, Text] = Field(default_factory=dict)
    """Why it is acceptable, by lift, that a write of a manager that was just replaced puts an output on that stays on."""


class Journal(_Part):
    """The limits of the journal. The oldest rows are removed first."""

    keep_days: Annotated[int, Field(strict=True, ge=1, le=36500)] = 400
    """More than a year, so that what happened at the last inspection is still there."""
    max_mb: Annotated[int, Field(strict=True, ge=10, le=1_000_000)] = 500


class Site(_Part):
    """One building."""

    schema_: Literal[1] = Field(alias="schema")
    name: Text
    timezone: Annotated[Text, AfterValidator(_zone)] | None = None
    """The IANA name of the time zone of the building; by default that of this machine."""
    state: Text | None = None
    """The folder of the store and the keys, relative to the site file."""
    journal: Journal = Journal()
    require_checkout: Annotated[bool, Field(strict=True)] = False
    """Do not start while a lift with `access: control` has no signed record of its acceptance test that fits its map."""
    api: Api = Api()
    announcements: FileName | None = None
    """The folder with recorded announcements for the lobby view, relative to the site file."""
    rmf: Rmf = Rmf()
    hub: Hub | None = None
    """By default there is none."""
    cluster: Cluster | None = None
    """The other machine, and the etcd that decides which of the two is active; by default this manager is alone."""
    controllers: dict[Text, Controller] = Field(min_length=1)
    lifts: dict[str, Lift] = Field(min_length=1)
    """By name. `check_site` checks the names, so that a wrong one does not hide other mistakes."""
