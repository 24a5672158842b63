"""What a site file may say: one building's controllers and lifts."""

from __future__ import annotations

from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag
from pydantic_core import PydanticCustomError

from lift_manager.lift.hours import Hours, read_hours
from lift_manager.lift.rmf import ADAPTER_ID, ADAPTER_ID_LIMIT, LONGEST_GRACE_S, RmfRules
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
"""For an answer, a connection or a fresh reading: whoever waits longer than this has no news but history."""
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]
FileName = Annotated[
    str,
    StringConstraints(min_length=1, max_length=1024, pattern=r"^[^\x00-\x1f\x7f]+$"),
    Field(description="the path of a file, relative to the site file"),
]
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
    """Which doors serve it; all doors of the map when not said."""


def _form(value: object) -> str:
    return "[long]" if isinstance(value, dict | Floor) else "[short]"


def _floor(value: int | Floor) -> Floor:
    """`L1: 1` is short for `L1: {code: 1}`."""
    return Floor(code=value) if isinstance(value, int) else value


if TYPE_CHECKING:
    AnyFloor = Floor
else:
    # a tagged union and not a BeforeValidator: behind one, pydantic no longer knows that lists and words came from JSON
    AnyFloor = Annotated[
        Annotated[Code, Tag("[short]")] | Annotated[Floor, Tag("[long]")], Discriminator(_form), AfterValidator(_floor)
    ]


def is_parameter_value(value: object) -> bool:
    """Whether a parameter of a map may be this: a number or text, not yes or no."""
    return isinstance(value, int | float | str) and not isinstance(value, bool)


def _parameter_value(value: object) -> object:
    if not is_parameter_value(value):
        raise PydanticCustomError("parameter_value", "must be a number or text")
    return value


if TYPE_CHECKING:
    Given = ParameterValue
else:
    # not a union: pydantic would speak of its branches, one after the other
    Given = Annotated[Any, AfterValidator(_parameter_value)]


def _hours(text: str) -> Hours:
    try:
        return read_hours(text)
    except ValueError as error:
        raise PydanticCustomError("robot_hours", "{problem}", {"problem": str(error)}) from error


def _not_none_at_all(hours: tuple[Hours, ...]) -> tuple[Hours, ...]:
    # not `min_length`: pydantic would count an entry with a mistake as no entry, and say so too
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
    """Refuse what can be neither a name nor an address, though it looks like one."""
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

if TYPE_CHECKING:
    SomeHours = Hours
else:
    SomeHours = Annotated[Text, AfterValidator(_hours)]


class ApiTls(_Part):
    """What the manager shows to its clients, and what they have to show. Files in PEM form."""

    certificate: FileName
    """The manager's, and after it those between it and its CA."""
    key: FileName
    client_ca: FileName | None = None
    """Then only clients with a certificate of this CA are heard."""


class Api(_Part):
    """Where the manager listens."""

    host: Host = "127.0.0.1"
    port: Port = 5003
    """5003 is where clients of the Open-RMF workshop look."""
    tls: ApiTls | None = None
    """HTTPS, and nothing else on that port; plain HTTP when not said."""
    without_keys: Text | None = None
    """Why it is acceptable that whoever reaches another address than loopback may ask anything while there are no keys."""
    host_names: tuple[Host, ...] = ()
    """Names by which clients address the manager, beside its addresses and localhost: others are refused while there are no keys."""
    trusted_proxies: tuple[SomeNetwork, ...] = ()
    """Addresses and networks of proxies, through which many clients connect: the limit on connections of one client is none for them."""


class ControllerTls(_Part):
    """What one controller has to show, and what is shown to it: Modbus/TCP Security. Files in PEM form."""

    ca: FileName
    """The CA of the controller's certificate, or that certificate itself."""
    certificate: FileName
    """Ours. A role that the controller knows us by is part of it."""
    key: FileName
    server_name: Text | None = None
    """The name or address in the controller's certificate, where that is not its `host`."""


class Controller(_Part):
    """One device at one address. What is left out comes from its map."""

    host: Host
    tls: ControllerTls | None = None
    said_port: Port | None = Field(default=None, alias="port")
    map: Text | None = None
    """A shipped map by name, or a path relative to the site file. Only a controller that serves endpoints alone needs none."""
    unit_id: UnitId | None = None
    timeout_s: Wait | None = None
    connect_timeout_s: Wait = 1.0
    min_gap_s: Annotated[float, Field(ge=0, le=10)] | None = None
    reconnect_min_s: Seconds | None = None
    max_registers_per_read: Annotated[int, Field(strict=True, ge=1, le=125)] | None = None
    max_bits_per_read: Annotated[int, Field(strict=True, ge=1, le=2000)] | None = None
    tid_echo: bool | None = None

    @property
    def port(self) -> int:
        """Where it is connected to: 502, or 802 over TLS, when not said."""
        if self.said_port is not None:
            return self.said_port
        return MODBUS_PORT if self.tls is None else SECURE_PORT


class Endpoint(_Part):
    """Where one further device of a lift is."""

    controller: Text
    unit_id: UnitId | None = None
    """Its controller's when not said, else the map's."""


_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
RosName = Annotated[
    str,
    StringConstraints(max_length=255, pattern=rf"^/?{_NAME}(/{_NAME})*$"),
    Field(description="letters, digits and underscores, with slashes between, as ROS 2 names topics"),
]


class Rmf(_Part):
    """What Open-RMF is told, and where it is found."""

    clear_s: Clear = 30.0
    """`clear_s` of a lift for the sessions of RMF, whose robots set out on one OPEN and do not look again."""
    end_grace_s: Annotated[float, Field(ge=0, le=LONGEST_GRACE_S)] = RmfRules().end_grace_s
    """How long door hold and robot mode stay after END_SESSION, should the session go on after all."""
    fire_alarm: bool = False
    """Tell of a fire on `fire_alarm_trigger`: every fleet of that RMF evacuates."""
    emergency_signal: bool = False
    """Tell of it on `emergency_signal`, which kilted and later know."""
    emergency_fleets: tuple[Text, ...] = ()
    """The fleets that it names; all of them when not said."""
    clear_on_acknowledge: bool = False
    """Tell once that it is over when a person has acknowledged. That clears the alarms of others, too."""
    namespace: RosName | None = None
    """Before both topics."""
    lift_states: RosName = "lift_states"
    lift_requests: RosName = "lift_requests"
    adapter_lift_requests: RosName = "adapter_lift_requests"
    adapter_id: Annotated[str, StringConstraints(max_length=ADAPTER_ID_LIMIT, pattern=ADAPTER_ID)] = ""
    """Of the adapter inside the manager, where others are beside it; made of domain and namespace when not said."""
    domain: Annotated[int, Field(strict=True, ge=0, le=232)] | None = None
    """That of ROS_DOMAIN_ID when not said."""
    peers: tuple[Text, ...] = ()
    """Addresses to look for RMF at where there is no multicast."""
    use_sim_time: bool = False
    """Take the time from /clock, as the nodes of a simulation do."""

    @property
    def rules(self) -> RmfRules:
        """What of it the manager tells every adapter."""
        return RmfRules(
            end_grace_s=self.end_grace_s,
            fire_alarm=self.fire_alarm,
            emergency_signal=self.emergency_signal,
            emergency_fleets=self.emergency_fleets,
            clear_on_acknowledge=self.clear_on_acknowledge,
        )


class LiftRmf(_Part):
    """One lift as RMF's building map names it; what is left out is named there as here."""

    name: Text | None = None
    floors: dict[Text, Text] = Field(default_factory=dict)
    """Our floor to RMF's."""


class Lift(_Part):
    """One lift on a controller, and on further devices where its map has endpoints."""

    controller: Text
    display_name: DisplayName | None = None
    """What people call it; its name when not said."""
    parameters: dict[Text, Given] = Field(default_factory=dict)
    """Values for the parameters of its map."""
    override: dict[Text, Any] = Field(default_factory=dict)
    """Laid over its map, key by key, in the words of the map. Keys that are numbers are text here: LoadedSite.maps has the result."""
    endpoints: dict[Text, Endpoint] = Field(default_factory=dict)
    """The map's endpoints by name; every one of them has its place here."""
    floors: dict[Text, AnyFloor] = Field(min_length=2)
    """Lowest first."""
    access: Literal["monitor", "control"] = "monitor"
    """`monitor` writes not one byte."""
    offset: dict[Table, Annotated[int, Field(strict=True, ge=-65535, le=65535)]] = Field(default_factory=dict)
    """Moves every address of a table of the controller itself, for one lift of several on it."""
    unit_id: UnitId | None = None
    group: Text | None = None
    """The group that answers its landing calls together with other lifts."""
    infer_occupancy: bool = False
    """A caller without a word for it boards and leaves by what it asks."""
    board_min_s: Annotated[float, Field(ge=0, le=600)] = 5.0
    """A floor asked sooner than this after the door stood open is no sign of boarding."""
    poll_s: Annotated[float, Field(ge=0.02, le=60)] | None = None
    """0.2, or `min_poll_s` of the map where that is more."""
    max_age_s: Wait | None = None
    lease_s: Seconds = 300.0
    max_session_hold_s: Seconds = 900.0
    max_session_s: Seconds = 3600.0
    """How long a session lasts at most, renewed or not; it ends when no robot is under way."""
    clear_s: Clear = 10.0
    """From the withdrawal of OPEN to the release of a held door, where the manager knows the end of the hold beforehand."""
    takeover_after_s: Seconds | None = None
    """A holder that is silent for so long loses an empty car to the next caller; never when not said."""
    robot_hours: Annotated[tuple[SomeHours, ...], AfterValidator(_not_none_at_all)] | None = None
    """When robots may begin, by the clock on the building's wall; always when not said."""
    between_sessions_s: Annotated[float, Field(ge=0, le=600)] = 5.0
    """What people get for themselves between two robots."""
    fire_release_delay_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """From telling robots of a fire to letting everything go. Bounded: a robot at 0.5 m/s is out of a doorway in two seconds."""
    rmf: LiftRmf = LiftRmf()
    """Its names in RMF's building map."""
    accept_latching: Text | None = None
    """Why it is acceptable that an output stays on when this manager is lost and nothing lets it go."""


class Journal(_Part):
    """How much is kept of what was done. The oldest rows go first."""

    keep_days: Annotated[int, Field(strict=True, ge=1, le=36500)] = 400
    """More than a year, so that what happened at the last inspection is still there."""
    max_mb: Annotated[int, Field(strict=True, ge=10, le=1_000_000)] = 500


class Site(_Part):
    """One building."""

    schema_: Literal[1] = Field(alias="schema")
    name: Text
    timezone: Annotated[Text, AfterValidator(_zone)] | None = None
    """The building's, by its IANA name; that of this machine when not said."""
    state: Text | None = None
    """The folder in which is kept what outlives the manager, relative to the site file."""
    journal: Journal = Journal()
    api: Api = Api()
    rmf: Rmf = Rmf()
    controllers: dict[Text, Controller] = Field(min_length=1)
    lifts: dict[str, Lift] = Field(min_length=1)
    """By name. `check_site` looks at the names: a wrong one hides no other mistake."""
