"""What the rules rest on, shown by Suricata itself: how it counts, what TLS hides, what a watched lift forbids."""

import re
import ssl
from pathlib import Path

import pytest

from lift_manager.commissioning.network.gaps import address_gaps, unit_gaps
from lift_manager.commissioning.network.model import Span
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table
from tests.support.network import printed
from tests.support.suricata import Capture, alerts, suricata

pytestmark = pytest.mark.external("suricata")

MANAGER, STRANGER, CONTROLLER = "192.0.2.5", "192.0.2.99", "192.0.2.20"
READ = (frames.frame(frames.read(Table.HOLDING, 0), 1), bytes.fromhex("0001 0000 0005 01 03 02 0000"))


def exchange(request: Request) -> tuple[bytes, bytes]:
    """A write of one address, and the answer that repeats it."""
    data = frames.frame(request, 7)
    return data, data


def said(captured: Capture, rules: str, folder: Path, ports: str = "502") -> dict[int, list[str]]:
    """The messages of all alerts, by the port that the connection came from."""
    found: dict[int, list[str]] = {}
    for event in alerts(suricata(captured.write(folder / "all.pcap"), rules, folder / "out", ports)):
        found.setdefault(event["src_port"], []).append(event["alert"]["signature"])
    return found


SETS = [
    [(0, 1)],
    [(1, 1)],
    [(5, 3)],
    [(0, 4), (6, 1), (8, 2)],
    [(2, 1), (65533, 1)],
    [(65534, 1)],
    [(10, 1), (65535, 1)],
    [(65534, 2)],
    [(0, 1), (65535, 1)],
]


@pytest.mark.parametrize("used", SETS, ids=str)
def test_suricata_counts_as_the_gaps_do_at_every_edge(used: list[tuple[int, int]], tmp_path: Path) -> None:
    spans = [Span(Table.HOLDING, start, count) for start, count in used]
    inside = {address for span in spans for address in range(span.start, span.last + 1)}
    near = {address + step for address in (*inside, 0, 65535) for step in range(-3, 4)}
    captured, ports = Capture(), {}
    for address in sorted(address for address in near if 0 <= address <= 65535):
        for request in (frames.write_register(address, 1), frames.mask_write(address, 0xFFFF, 0)):
            port = captured.connection(MANAGER, CONTROLLER, 502, [READ, exchange(request)])
            ports[port] = (address, request.function)
    terms = [term for gap in address_gaps(spans) for term in gap.terms]
    rules = "".join(
        f'alert modbus any any -> any 502 (msg:"x"; modbus:unit 1, access write holding, address {term}; sid:{number};)\n'
        for number, term in enumerate(terms, start=1)
    )
    found = {ports[port][0] for port in said(captured, rules, tmp_path)}
    assert found == {address for address, _ in ports.values()} - inside


@pytest.mark.parametrize("used", [{1}, {0}, {255}, {0, 5}, {1, 2, 254}, {0, 1, 255}], ids=str)
def test_suricata_takes_every_unit_but_the_used_ones(used: set[int], tmp_path: Path) -> None:
    captured, ports = Capture(), {}
    for unit in range(256):
        ports[captured.connection(MANAGER, CONTROLLER, 502, [exchange(frames.write_register(1, 1, unit))])] = unit
    rules = "".join(
        f'alert modbus any any -> any 502 (msg:"x"; modbus:unit {term}, access write; sid:{number};)\n'
        for number, term in enumerate(unit_gaps(used), start=1)
    )
    assert {ports[port] for port in said(captured, rules, tmp_path)} == set(range(256)) - used


SITE = """\
schema: 1
name: Rules
controllers:
  plc: {host: 192.0.2.20, map: generic-registers}
lifts:
  lift: {controller: plc, access: ACCESS, floors: {L1: 1, L2: 2}}
"""


def site(folder: Path, access: str = "control", text: str = SITE) -> Path:
    path = folder / "site.yaml"
    path.write_text(text.replace("ACCESS", access), "utf-8")
    return path


def test_every_function_but_the_used_ones_raises_an_alert(tmp_path: Path) -> None:
    captured, ports = Capture(), {}
    for function in range(256):
        data = bytes((0, 9, 0, 0, 0, 6, 1, function, 0, 16, 0, 1))
        ports[captured.connection(MANAGER, CONTROLLER, 502, [READ, (data, b"")])] = function
    rules = printed(site(tmp_path), "--suricata", "--manager", MANAGER)
    silent = set(range(256)) - {ports[port] for port in said(captured, rules, tmp_path)}
    # reads, and the one function that this map writes with; with its top bit set a code is an exception, which no device carries out
    assert silent - set(range(128, 256)) == {1, 2, 3, 4, 6}
    assert silent >= {1, 2, 3, 4, 6}


def test_any_write_to_a_controller_of_watched_lifts_raises_an_alert(tmp_path: Path) -> None:
    captured = Capture()
    written = frames.write_register(16, 1)
    own = captured.connection(MANAGER, CONTROLLER, 502, [READ, exchange(written)])
    other = captured.connection(STRANGER, CONTROLLER, 502, [exchange(written)])
    captured.connection(MANAGER, CONTROLLER, 502, [READ, READ])
    found = said(captured, printed(site(tmp_path, "monitor"), "--suricata", "--manager", MANAGER), tmp_path)
    expected = ["lift-manager: a write to plc (192.0.2.20:502), map generic-registers, which no command is for"]
    assert found == {own: expected, other: expected}


def test_what_begins_as_something_else_is_not_overlooked(tmp_path: Path) -> None:
    captured = Capture()
    write = exchange(frames.write_register(99, 1))
    junk = captured.connection(MANAGER, CONTROLLER, 502, [(b"\xff" * 12, b""), write])
    protocol = captured.connection(
        MANAGER, CONTROLLER, 502, [READ, (bytes.fromhex("0001 0007 0006 01 06 0063 0001"), b"")]
    )
    in_two = captured.connection(MANAGER, CONTROLLER, 502, [(write[0][:1], b""), (write[0][1:], write[1])])
    rules = printed(site(tmp_path), "--suricata", "--manager", MANAGER)
    found = said(captured, rules, tmp_path)
    assert any("something other than Modbus" in text for text in found[junk])
    assert any("a protocol id other than 0" in text for text in found[protocol])
    assert any("above go_to at holding:16" in text for text in found[in_two])


def test_an_exception_answer_and_an_unanswered_request_raise_nothing(tmp_path: Path) -> None:
    captured = Capture()
    refused = (frames.frame(frames.write_register(16, 1), 3), bytes.fromhex("0003 0000 0003 01 86 02"))
    captured.connection(MANAGER, CONTROLLER, 502, [READ, refused, (READ[0], b""), (READ[0], b"")])
    captured.connection(MANAGER, CONTROLLER, 502)
    assert said(captured, printed(site(tmp_path), "--suricata", "--manager", MANAGER, "--reads"), tmp_path) == {}


def test_of_a_controller_with_tls_the_rules_say_who_connects_and_that_it_is_tls(tmp_path: Path) -> None:
    text = SITE.replace("{host: 192.0.2.20,", "{host: 192.0.2.20, tls: {ca: ca.pem, certificate: me.pem, key: me.key},")
    captured = Capture()
    own = captured.connection(MANAGER, CONTROLLER, 802, [(client_hello(), b"\x15\x03\x03\0\x02\x02\x28")])
    other = captured.connection(STRANGER, CONTROLLER, 802, [(client_hello(), b"\x15\x03\x03\0\x02\x02\x28")])
    naked = captured.connection(MANAGER, CONTROLLER, 802, [exchange(frames.write_register(16, 1))])
    around = captured.connection(MANAGER, CONTROLLER, 502, [exchange(frames.write_register(16, 1))])
    rules = printed(site(tmp_path, text=text), "--suricata", "--manager", MANAGER)
    assert "modbus:" not in rules.split("# plc (192.0.2.20:802)")[1]
    found = said(captured, rules, tmp_path, ports_to_detect(rules))
    assert own not in found
    where = "plc (192.0.2.20:802), map generic-registers"
    assert set(found[other]) == {f"lift-manager: another host connects to {where}"}
    assert set(found[naked]) == {f"lift-manager: a connection without TLS to {where}"}
    assert set(found[around]) == {f"lift-manager: a connection to the port without TLS of {where}"}


def ports_to_detect(rules: str) -> str:
    """As the header asks for it."""
    (line,) = re.findall(r"detection-ports\.dp: (.*)", rules)
    return str(line)


def test_the_header_asks_for_every_port_that_is_used(tmp_path: Path) -> None:
    text = SITE.replace("lifts:", "  second: {host: 192.0.2.21, port: 1502, map: generic-coils}\nlifts:")
    text += "  other: {controller: second, floors: {L1: 0, L2: 1}}\n"
    rules = printed(site(tmp_path, text=text), "--suricata", "--manager", MANAGER)
    assert ports_to_detect(rules) == "502, 1502"
    captured = Capture()
    first = captured.connection(STRANGER, CONTROLLER, 502, [exchange(frames.write_register(16, 1))])
    second = captured.connection(STRANGER, "192.0.2.21", 1502, [exchange(frames.write_coil(1, value=True))])
    found = said(captured, rules, tmp_path, ports_to_detect(rules))
    assert {port: len(texts) for port, texts in found.items()} == {first: 1, second: 1}
    assert "second (192.0.2.21:1502), map generic-coils" in found[second][0]


def test_suricata_reads_a_name_as_it_stands_in_the_site_file(tmp_path: Path) -> None:
    name = 'a\\\\"; sid:1; b|41|, 電梯'
    text = SITE.replace("  plc:", f"  '{name}':").replace("controller: plc", f"controller: '{name}'")
    captured = Capture()
    other = captured.connection(STRANGER, CONTROLLER, 502, [exchange(frames.write_register(16, 1))])
    found = said(captured, printed(site(tmp_path, text=text), "--suricata", "--manager", MANAGER), tmp_path)
    assert found[other][0].startswith(f"lift-manager: another host writes to {name} (192.0.2.20:502)")


def client_hello() -> bytes:
    """The first words of a real TLS client."""
    from_server, to_server = ssl.MemoryBIO(), ssl.MemoryBIO()
    link = ssl.create_default_context().wrap_bio(from_server, to_server, server_hostname="plc.example")
    with pytest.raises(ssl.SSLWantReadError):
        link.do_handshake()
    return to_server.read()


def test_with_drop_a_forged_write_does_not_get_through_and_a_declared_one_does(tmp_path: Path) -> None:
    captured = Capture()
    captured.connection(MANAGER, CONTROLLER, 502, [READ, exchange(frames.write_register(16, 2))])
    forged = captured.connection(MANAGER, CONTROLLER, 502, [READ, exchange(frames.write_register(20, 2))])
    rules = printed(site(tmp_path), "--suricata", "--manager", MANAGER, "--action", "drop")
    events = suricata(captured.write(tmp_path / "all.pcap"), rules, tmp_path / "out", "502", "--simulate-ips")
    dropped = [(event["src_port"], event["alert"]["action"]) for event in alerts(events)]
    assert set(dropped) == {(forged, "blocked")}


def test_addresses_of_version_six_are_taken_too(tmp_path: Path) -> None:
    text = SITE.replace("192.0.2.20", '"2001:db8::20"')
    captured = Capture()
    captured.connection("2001:db8::5", "2001:db8::20", 502, [READ, exchange(frames.write_register(16, 2))])
    other = captured.connection("2001:db8::99", "2001:db8::20", 502, [READ, exchange(frames.write_register(16, 2))])
    rules = printed(site(tmp_path, text=text), "--suricata", "--manager", "2001:db8::5", "--manager", MANAGER)
    assert list(said(captured, rules, tmp_path)) == [other]
