"""What a site needs of the network: worked out from the maps, and put into words that do not change by themselves."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lift_manager.commissioning import maps_plan
from lift_manager.commissioning.network.build import network
from lift_manager.commissioning.network.errors import UnknownHost
from lift_manager.commissioning.network.gaps import address_gaps, unit_gaps
from lift_manager.commissioning.network.model import Network, Span, joined
from lift_manager.config.load import load_site
from lift_manager.hub.folder import HubFolder
from register_maps.codec import compile_map
from register_maps.load import load, shipped
from register_maps.words import Table
from tests.support.network import called, printed
from tests.support.rows import each_row

SITE = """\
schema: 1
name: Main hospital
controllers:
  plc: {host: HOST, map: generic-registers}
  bits: {host: 192.0.2.21, port: 1502, map: generic-coils}
lifts:
  east: {controller: plc, access: control, floors: {L1: 1, L2: 2}}
  west: {controller: plc, access: control, unit_id: 2, offset: {holding: 100}, floors: {L1: 1, L2: 2}}
  north: {controller: bits, floors: {L1: 0, L2: 1}}
"""
MANAGER = "192.0.2.5"


def written(folder: Path, host: str = "192.0.2.20", text: str = SITE) -> Path:
    path = folder / "site.yaml"
    path.write_text(text.replace("HOST", host), "utf-8")
    return path


def found(path: Path, *known: str) -> Network:
    return network(load_site(path), lambda _: known)


# -- what is read and written


def test_a_lift_is_looked_for_where_its_offset_and_its_unit_put_it(tmp_path: Path) -> None:
    plc, _ = found(written(tmp_path)).stations
    assert [unit.unit_id for unit in plc.units] == [1, 2]
    east, west = plc.units
    assert [str(span) for span in east.reads] == ["holding 0 to 7", "holding 16 to 19"]
    assert [str(span) for span in west.reads] == ["holding 100 to 107", "holding 116 to 119"]
    assert [(write.function, str(write.span), write.label) for write in west.writes] == [
        (6, "holding 116", "go_to at holding:16"),
        (6, "holding 117", "hold_door.front at holding:17"),
        (6, "holding 118", "robot_mode at holding:18"),
        (6, "holding 119", "close_door.front at holding:19"),
    ]


def test_a_watched_lift_writes_nothing_and_its_outputs_are_not_read(tmp_path: Path) -> None:
    _, bits = found(written(tmp_path)).stations
    (unit,) = bits.units
    assert unit.writes == ()
    assert {span.table for span in unit.reads} == {Table.DISCRETE}


@each_row("name", shipped())
def test_every_request_of_a_maps_plan_is_let_through_and_every_write_of_it_has_its_function(
    name: str, tmp_path: Path
) -> None:
    loaded = load(name)
    source = loaded.map
    if loaded.unset or not source.signals.keys() >= {"car_floor", "door.front"}:
        return  # it needs something from a site
    planned = [sent.received for part in maps_plan.plan(source).parts for sent in part.requests]
    codes = set(maps_plan.example_floors(compile_map(source)).values())
    assert planned
    assert len(codes) >= 2
    path = written(tmp_path, text=_site_of(name, sorted(codes)))
    units = [unit for station in found(path).stations for unit in station.units]
    for received in planned:
        cells = {(received.request.table, received.request.address + step) for step in range(received.request.count)}
        if received.request.is_write:
            spans = [w.span for unit in units for w in unit.writes if w.function == received.request.function]
        else:
            spans = [span for unit in units for span in unit.reads]
        assert cells <= {(span.table, address) for span in spans for address in range(span.start, span.last + 1)}


def _site_of(name: str, codes: list[int]) -> str:
    return (
        f"schema: 1\nname: One\ncontrollers:\n  plc: {{host: 192.0.2.20, map: {name}}}\nlifts:\n  lift: {{controller: plc, access: "
        f"control, accept_latching: a test, floors: {{A: {codes[0]}, B: {codes[1]}}}}}\n"
    )


# -- numbers


def meant(term: str, top: int) -> set[int]:
    """What Suricata takes a term for: counted from 1, both ends left out, and the three oddities that are measured in tests/campaigns/network/suricata_edges.py."""
    low, between, high = term.partition("<>")
    if between and int(low) > 0 and int(high) < 0xFFFF:
        return set(range(int(low) + 1, int(high)))
    assert not between, f"{term} is not what it says"
    if term.startswith("<"):
        return set(range(int(term[1:])))
    return set(range(int(term[1:]) + 1, top + 1)) if term.startswith(">") else {int(term)}


@settings(max_examples=30)
@given(st.sets(st.one_of(st.integers(0, 12), st.integers(65520, 65535)), min_size=1))
def test_gaps_are_all_addresses_but_the_used_ones(used: set[int]) -> None:
    spans = list(joined(Span(Table.COIL, address, 1) for address in used))
    found = [meant(term, 0xFFFF) for gap in address_gaps(spans) for term in gap.terms]
    on_the_wire = {(address - 1) % 0x10000 for addresses in found for address in addresses}
    assert on_the_wire == set(range(0x10000)) - used
    assert sum(map(len, found)) == len(on_the_wire), "no address is named twice"


@given(st.sets(st.integers(0, 255), min_size=1))
def test_unit_gaps_are_all_units_but_the_used_ones(used: set[int]) -> None:
    found = set[int]().union(*(meant(term, 255) for term in unit_gaps(used)))
    assert found == set(range(256)) - used


# -- Suricata's file


def rules_of(text: str) -> Iterator[str]:
    return (line for line in text.splitlines() if line and not line.startswith("#"))


def sids(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"sid:(\d+);", text)]


def test_the_same_site_makes_the_same_file_and_it_says_which_maps_it_is_made_from(tmp_path: Path) -> None:
    path = written(tmp_path)
    first, second = (printed(path, "--suricata", "--manager", MANAGER) for _ in range(2))
    assert first == second
    for loaded in load_site(path).maps.values():
        assert f"{loaded.map.name}, sha256 {loaded.sha256}" in first
    assert not re.search(r"20\d\d-\d\d", first)


def test_every_rule_has_a_number_of_its_own_in_the_range_for_local_rules(tmp_path: Path) -> None:
    text = printed(written(tmp_path), "--suricata", "--manager", MANAGER, "--reads")
    numbers = sids(text)
    assert len(numbers) == len(list(rules_of(text))) == len(set(numbers))
    assert all(1_000_000 <= number < 2_000_000 for number in numbers)


def test_a_rule_keeps_its_number_when_others_come_and_when_the_manager_moves(tmp_path: Path) -> None:
    path = written(tmp_path)
    plain = sids(printed(path, "--suricata", "--manager", MANAGER))
    assert sids(printed(path, "--suricata", "--manager", "192.0.2.6")) == plain
    assert set(plain) < set(sids(printed(path, "--suricata", "--manager", MANAGER, "--reads")))


def test_a_message_names_map_command_and_printed_address(tmp_path: Path) -> None:
    text = printed(written(tmp_path), "--suricata", "--manager", MANAGER)
    (line,) = [line for line in rules_of(text) if "modbus:unit 2, function 6" in line and "address <117" in line]
    message = re.search(r'msg:"([^"]*)"', line)
    assert message
    assert "write one register (function 06) below go_to at holding:16" in message[1]
    assert message[1].endswith("to unit 2 of plc (192.0.2.20:502), map generic-registers")


def test_a_name_in_the_site_file_cannot_end_a_message_or_a_comment(tmp_path: Path) -> None:
    text = SITE.replace("  plc:", "  'a\\\"; sid:1; b|41|':").replace(
        "controller: plc", "controller: 'a\\\"; sid:1; b|41|'"
    )
    made = printed(written(tmp_path, text=text), "--suricata", "--manager", MANAGER)
    for line in rules_of(made):
        assert 1 not in sids(re.sub(r"\\.", "", line))
        assert len(re.findall(r'(?<!\\)"', line)) == 2, line


def test_drop_is_what_was_asked_for(tmp_path: Path) -> None:
    made = printed(written(tmp_path), "--suricata", "--manager", MANAGER, "--action", "drop")
    assert {line.split()[0] for line in rules_of(made)} == {"drop"}


# -- names, and what is refused


def test_a_controller_given_by_name_is_looked_up_and_the_file_says_so(tmp_path: Path) -> None:
    plc, _ = found(written(tmp_path, "plc.example"), "192.0.2.77", "192.0.2.78").stations
    assert plc.addresses == ("192.0.2.77", "192.0.2.78")
    made = printed(written(tmp_path, "localhost"), "--nftables")
    assert "plc: localhost is 127.0.0.1" in made
    assert "let it reach the resolver too" in made


def test_a_name_that_nobody_knows_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(
        UnknownHost, match=r"controller plc: this computer cannot resolve plc\.example.*write the address"
    ):
        found(written(tmp_path, "plc.example"))


def test_the_table_needs_no_address(tmp_path: Path) -> None:
    made = printed(written(tmp_path, "plc.example"))
    assert "plc (plc.example:502), Modbus/TCP: no encryption" in made
    assert "writes  FC06  holding 116: go_to at holding:16, lift west" in made
    assert "bits (192.0.2.21:1502)" in made
    assert "writes  nothing" in made


@each_row(
    ("options", "words"),
    [
        (("--suricata",), "the address of the manager's computer"),
        (("--nftables-gateway",), "the address of the manager's computer"),
        (("--suricata", "--manager", "plc"), "plc is no address"),
        (("--nftables", "--clients", "10.0.0.1/24"), "has host bits set"),
        (("--nftables", "--user", 'a" drop'), "is no user"),
        (("--nftables", "--systemd"), "at a time"),
    ],
)
def test_what_makes_no_sense_is_refused(options: tuple[str, ...], words: str, tmp_path: Path) -> None:
    code, out, err = called(written(tmp_path), *options)
    assert (code, out) == (2, "")
    assert words in err


# -- the hub of many sites


def of_hub(folder: Path, nats: str = "", own: str = "") -> Path:
    """Write a site of a hub, with the files of its leaf node as the hub writes them."""
    (folder / "hub").mkdir(mode=0o700)
    (folder / "hub" / "hub.yaml").write_text(f"nats: {{address: [192.0.2.90, 192.0.2.91]{nats}}}")
    HubFolder(folder / "hub").add_site("berlin")
    hub = f"hub: {{site: berlin, password: hub/sites/berlin/manager.password{own}}}"
    return written(folder, text=f"{SITE}{hub}\n")


def test_the_table_has_the_leaf_node_and_where_it_connects_to(tmp_path: Path) -> None:
    made = printed(of_hub(tmp_path, ", servers: ['tls://192.0.2.90:4222']"))
    assert "127.0.0.1:4223, NATS without TLS, on the manager's own computer only" in made
    assert "192.0.2.90:7422, NATS with TLS; the leaf node begins it, and the hub begins none" in made
    assert "192.0.2.91:7422, NATS with TLS" in made


def test_rules_let_the_leaf_node_reach_the_hub_and_nothing_reaches_the_leaf_node(tmp_path: Path) -> None:
    site = of_hub(tmp_path)
    own = printed(site, "--nftables")
    assert "elements = { 192.0.2.90 . 7422, 192.0.2.91 . 7422 }" in own
    accepted, dropped = (
        own.index('ip daddr . tcp dport @hub4 meta skuid "lift-manager" accept'),
        own.index('meta skuid "lift-manager" ct direction original'),
    )
    assert accepted < dropped
    gateway = printed(site, "--nftables-gateway", "--manager", MANAGER)
    assert "ip saddr @managers4 ip daddr . tcp dport @hub4 accept" in gateway
    assert "ip daddr @managers4 ip saddr . tcp sport @hub4 ct direction reply accept" in gateway
    assert "192.0.2.90" not in printed(site, "--systemd"), "the manager itself reaches its leaf node alone"


def test_a_leaf_node_on_another_computer_is_what_the_manager_reaches(tmp_path: Path) -> None:
    site = of_hub(tmp_path, own=", server: 'nats://192.0.2.80:4223'")
    assert "192.0.2.80:4223, NATS without TLS, on another computer" in printed(site)
    assert "elements = { 192.0.2.80 . 4223 }" in printed(site, "--nftables")
    assert "IPAddressAllow=192.0.2.80" in printed(site, "--systemd")


def test_rules_are_not_made_without_the_address_of_the_hub_and_the_table_says_that_it_is_unknown(
    tmp_path: Path,
) -> None:
    site = of_hub(tmp_path)
    leaf_conf = tmp_path / "hub" / "sites" / "berlin" / "leaf.conf"
    leaf_conf.write_text("leafnodes { remotes = [] }\n")
    assert "leaf.confisnotas`lift-managerhubsiteadd`writesit" in "".join(printed(site).split())
    leaf_conf.unlink()
    code, out, err = called(site, "--nftables")
    assert (code, out) == (1, "")
    assert "leaf.conf cannot be read (No such file or directory), and it names the address of the hub" in err


# -- two managers


def test_the_managers_of_a_cluster_reach_their_etcd(tmp_path: Path) -> None:
    machines = "machines: {north: {address: 'http://192.0.2.21:5003'}, south: {address: 'http://192.0.2.22:5003'}}"
    members = "etcd: ['http://192.0.2.21:2379', 'http://192.0.2.22:2379', 'http://[2001:db8::23]:2379']"
    site = written(tmp_path, text=f"{SITE}cluster: {{{machines}, {members}}}\n")
    assert "[2001:db8::23]:2379, HTTP" in printed(site)
    own = printed(site, "--nftables")
    assert "elements = { 192.0.2.21 . 2379, 192.0.2.22 . 2379 }" in own
    for accepted in ("ip daddr . tcp dport @etcd4", "ip6 daddr . tcp dport @etcd6"):
        assert own.index(f'{accepted} meta skuid "lift-manager" accept') < own.index("ct direction original")
    gateway = printed(site, "--nftables-gateway", "--manager", "192.0.2.21", "--manager", "192.0.2.22")
    assert "ip daddr @managers4 ip saddr . tcp sport @etcd4 ct direction reply accept" in gateway
    assert "IPAddressAllow=2001:db8::23" in printed(site, "--systemd")


# -- systemd


def test_the_drop_in_lists_every_address_and_no_other(tmp_path: Path) -> None:
    text = SITE.replace("controllers:", "api: {host: 192.0.2.5, port: 5004}\ncontrollers:", 1)
    made = printed(written(tmp_path, text=text), "--systemd", "--clients", "10.0.0.0/24")
    assert [line for line in made.splitlines() if not line.startswith("#")] == [
        "[Service]",
        "IPAddressDeny=any",
        "IPAddressAllow=localhost",
        "IPAddressAllow=192.0.2.20",
        "IPAddressAllow=192.0.2.21",
        "IPAddressAllow=10.0.0.0/24",
        "SocketBindDeny=any",
        "SocketBindAllow=tcp:5004",
    ]
