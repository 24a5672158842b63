"""Suricata rules: only these writes, only from this host. Pure.

The grammar is that of the user guide (rules/modbus-keyword). What it leaves open was measured with Suricata 7.0.10: two `modbus`
keywords in one rule must both hold; `access write` covers functions 5, 6, 15, 16, 22 and 23; `unassigned`, `reserved` and `user`
cover every function from 25 to 127, and a number in their place covers them all at once.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from lift_manager.commissioning.network import lines
from lift_manager.commissioning.network.gaps import Gap, address_gaps, unit_gaps
from lift_manager.commissioning.network.model import Network, Span, Station, Unit, joined
from lift_manager.commissioning.wording import FUNCTIONS
from register_maps.words import READ_FUNCTION, Table

FIRST_SID, SIDS = 1_000_000, 1_000_000
"""The range that is kept free for rules of one's own."""

_WRITE_TABLE = {5: Table.COIL, 15: Table.COIL, 6: Table.HOLDING, 16: Table.HOLDING, 22: Table.HOLDING}
_READ_WRITE = 23
_OTHER_FUNCTIONS = (7, 8, 9, 10, 11, 12, 13, 14, 17, 18, 19, 20, 21, 24)
"""Below 25, neither reads nor writes of the four tables (Modbus Application Protocol V1.1b3, 5.1; 9, 10, 13, 14, 18 and 19 have no use there)."""
_OTHER_ADDRESSES = ("unassigned", "reserved", "user")
_WORD = {Table.COIL: "coils", Table.DISCRETE: "discretes", Table.HOLDING: "holding", Table.INPUT: "input"}
_MALFORMED = {
    "invalid_protocol_id": "a protocol id other than 0",
    "invalid_length": "a length that does not fit its function",
    "invalid_function_code": "a function code that Modbus does not have",
}
_MODBUS_PORT = 502
_MAX_LABELS = 8
"""Commands that one message names. Chosen: a line that still fits a screen."""
_ESCAPED = re.compile(r'[\\";:|]')


@dataclass(frozen=True, slots=True)
class _Rule:
    protocol: str
    ours: bool | None
    """From the manager's host, from any other, or from anybody (None)."""
    station: Station
    port: int
    options: tuple[str, ...]
    message: str

    @property
    def identity(self) -> str:
        """What its number follows from: nothing that changes with the manager's address, or with other rules."""
        return f"{self.protocol} {self.ours} {self.station.addresses} {self.port} {self.options}"


def rules(found: Network, managers: Sequence[str], *, action: str = "alert", reads: bool = False) -> Iterator[str]:
    """Yield the lines of a rules file; `managers` are the addresses of the manager's host, one at least.

    With `reads`, what the manager does not read, and reads of others, raise an alert too.
    """
    yield from _header(found, managers)
    used: set[int] = set()
    for station in found.stations:
        yield ""
        yield from lines.comment(f"{lines.address_text(station)}, map {', '.join(station.maps)}")
        for rule in _station(station, reads=reads):
            yield _text(rule, action, managers, _sid(f"{found.site} {rule.identity}", used))


def _header(found: Network, managers: Sequence[str]) -> Iterator[str]:
    yield from lines.header(found, "Suricata rules")
    ports = sorted({station.port for station in found.stations})
    yield from lines.comment(
        f"The lift manager is at {', '.join(managers)}. Addresses in messages are as the map prints them; behind `address` they count from 1, as "
        "Suricata counts.",
        "",
        "Suricata has to look for Modbus, on these ports, for as long as a connection lasts. In suricata.yaml:",
        "  app-layer.protocols.modbus.enabled: yes",
        f"  app-layer.protocols.modbus.detection-ports.dp: {', '.join(map(str, ports))}",
        "  app-layer.protocols.modbus.stream-depth: 0",
        "  stream.reassembly.depth: 0",
        "It has to see both directions of every connection to the controllers: a mirror port, or the gateway itself.",
        "",
        "Try them as `alert` first. With `drop`, and Suricata inline, what a rule names does not reach the controller.",
        "Not seen: a write that the map declares, sent by another program on the manager's own computer.",
    )
    if any({15, 16} & unit.functions for station in found.stations for unit in station.units):
        yield from lines.comment(
            "Not seen: a block write (function 15 or 16) by that computer which reaches the last address, 65535 on the wire. "
            "Suricata loses count there."
        )
    if any(station.tls for station in found.stations):
        yield from lines.comment(
            "Controllers with TLS: nobody can look inside. Their rules are about who connects, and that it is TLS; their ports are listed so "
            "that plain Modbus there is found at once."
        )


def _station(station: Station, *, reads: bool) -> Iterator[_Rule]:
    if station.tls:
        yield from _tls(station)
        return
    yield from _any_host_rules(station)
    yield from _foreign_host_rules(station)
    if station.writes:
        yield from _own_host_rules(station)
    if reads:
        yield from _reads(station)


def _tls(station: Station) -> Iterator[_Rule]:
    where = f"{lines.address_text(station)}, map {', '.join(station.maps)}"
    connect = ("flow:to_server", "flags:S,12")
    yield _Rule("tcp", False, station, station.port, connect, f"another host connects to {where}")
    no_tls = ("flow:established,to_server", "app-layer-protocol:!tls")
    yield _Rule("tcp", None, station, station.port, no_tls, f"a connection without TLS to {where}")
    if station.port != _MODBUS_PORT:
        text = f"a connection to the port without TLS of {where}"
        yield _Rule("tcp", None, station, _MODBUS_PORT, connect, text)


def _any_host_rules(station: Station) -> Iterator[_Rule]:
    """What neither the manager nor anybody else has a reason for."""
    where = f"{lines.address_text(station)}, map {', '.join(station.maps)}"
    for function in _OTHER_FUNCTIONS:
        yield _modbus(
            None, station, (f"function {function}",), f"function {function:02}, which is never used, to {where}"
        )
    for kind in _OTHER_ADDRESSES:
        yield _modbus(None, station, (f"function {kind}",), f"{kind} function, which is never used, to {where}")
    for event, what in _MALFORMED.items():
        options = ("flow:established,to_server", f"app-layer-event:modbus.{event}")
        yield _Rule("modbus", None, station, station.port, options, f"{what}, to {where}")
    options = ("flow:established,to_server", "app-layer-protocol:!modbus")
    yield _Rule("tcp", None, station, station.port, options, f"something other than Modbus to {where}")


def _foreign_host_rules(station: Station) -> Iterator[_Rule]:
    where = f"{lines.address_text(station)}, map {', '.join(station.maps)}"
    if station.writes:
        text = f"another host writes to {where}: {_labels(write.label for write in station.writes)}"
        yield _modbus(False, station, ("access write",), text)
    else:
        yield _modbus(None, station, ("access write",), f"a write to {where}, which no command is for")


def _own_host_rules(station: Station) -> Iterator[_Rule]:
    """Writes by the manager's host that no command makes."""
    where = lines.address_text(station)
    used = frozenset[int]().union(*(unit.functions for unit in station.units))
    for function in (*sorted(_WRITE_TABLE.keys() - used), _READ_WRITE):
        text = f"function {function:02}, which no command uses, to {where}, map {', '.join(station.maps)}"
        yield _modbus(True, station, (f"function {function}",), text)
    for term in unit_gaps({unit.unit_id for unit in station.units}):
        text = f"a write to a unit of {where} that no lift is on, map {', '.join(station.maps)}"
        yield _modbus(True, station, (f"unit {term}, access write",), text)
    for unit in station.units:
        if unit.writes:
            yield from _unit(station, unit, used)
        else:
            text = f"a write to unit {unit.unit_id} of {where}, map {', '.join(unit.maps)}, where no command is"
            yield _modbus(True, station, (f"unit {unit.unit_id}, access write",), text)


def _unit(station: Station, unit: Unit, used: frozenset[int]) -> Iterator[_Rule]:
    where = f"unit {unit.unit_id} of {lines.address_text(station)}, map {', '.join(unit.maps)}"
    for function in sorted(used - unit.functions):
        text = f"function {function:02}, which no command uses there, to {where}"
        yield _modbus(True, station, (f"unit {unit.unit_id}, function {function}",), text)
    for function in sorted(unit.functions):
        table = _WRITE_TABLE[function]
        spans = list(joined(write.span for write in unit.writes if write.function == function))
        for gap in address_gaps(spans):
            text = f"{FUNCTIONS[function]} (function {function:02}) {_place(unit, function, gap)} to {where}"
            for term in gap.terms:
                first = f"unit {unit.unit_id}, function {function}"
                yield _modbus(True, station, (first, f"access write {_WORD[table]}, address {term}"), text)


def _place(unit: Unit, function: int, gap: Gap) -> str:
    below = [write.label for write in unit.writes if write.function == function and _overlaps(write.span, gap.before)]
    above = [write.label for write in unit.writes if write.function == function and _overlaps(write.span, gap.after)]
    if below and above:
        return f"between {_labels(below)} and {_labels(above)},"
    return f"above {_labels(below)}," if below else f"below {_labels(above)},"


def _overlaps(span: Span, stretch: Span | None) -> bool:
    return stretch is not None and stretch.start <= span.start <= stretch.last


def _reads(station: Station) -> Iterator[_Rule]:
    where = f"{lines.address_text(station)}, map {', '.join(station.maps)}"
    yield _modbus(False, station, ("access read",), f"another host reads from {where}")
    for term in unit_gaps({unit.unit_id for unit in station.units}):
        yield _modbus(True, station, (f"unit {term}, access read",), f"a read from a unit that no lift is on, {where}")
    for unit in station.units:
        for table, function in READ_FUNCTION.items():
            spans = [span for span in unit.reads if span.table == table]
            text = (
                f"{FUNCTIONS[function]} (function {function:02}) outside what is polled, unit {unit.unit_id} of {where}"
            )
            for gap in address_gaps(spans):
                if not gap.terms:
                    yield _modbus(True, station, (f"unit {unit.unit_id}, access read {_WORD[table]}",), text)
                for term in gap.terms:
                    keyword = f"unit {unit.unit_id}, access read {_WORD[table]}, address {term}"
                    yield _modbus(True, station, (keyword,), text)


def _modbus(ours: bool | None, station: Station, keywords: Iterable[str], message: str) -> _Rule:  # noqa: FBT001 - three answers
    options = ("flow:established,to_server", *(f"modbus:{keyword}" for keyword in keywords))
    return _Rule("modbus", ours, station, station.port, options, message)


def _labels(labels: Iterable[str]) -> str:
    listed = list(dict.fromkeys(labels))
    more = f" and {len(listed) - _MAX_LABELS} more" if len(listed) > _MAX_LABELS else ""
    return ", ".join(listed[:_MAX_LABELS]) + more


def _text(rule: _Rule, action: str, managers: Sequence[str], sid: int) -> str:
    source = {None: "any", True: _group(managers), False: f"!{_group(managers)}"}[rule.ours]
    message = _ESCAPED.sub(
        lambda found: found[0] if found[0] == ":" else f"\\{found[0]}", f"lift-manager: {rule.message}"
    )
    head = f"{action} {rule.protocol} {source} any -> {_group(rule.station.addresses)} {rule.port}"
    options = "; ".join((f'msg:"{message}"', *rule.options, f"sid:{sid}", "rev:1"))
    return f"{head} ({options};)"


def _group(addresses: Sequence[str]) -> str:
    return f"[{','.join(addresses)}]"


def _sid(identity: str, used: set[int]) -> int:
    """Number a rule by what it says, so that it keeps its number when others come and go."""
    number = int.from_bytes(hashlib.sha256(identity.encode()).digest()[:8], "big") % SIDS
    while number in used:
        number = (number + 1) % SIDS
    used.add(number)
    return FIRST_SID + number
