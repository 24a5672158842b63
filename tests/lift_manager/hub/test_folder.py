"""The folder of a hub: who is a site, and what follows from it for NATS servers."""

import base64
import binascii
import json
from pathlib import Path
from typing import Any

import pytest

from lift_manager.config.hub import hub_servers
from lift_manager.hub.errors import FolderUnusable
from lift_manager.hub.folder import HubFolder
from lift_manager.hub.nkey import make_nkey


@pytest.fixture
def place(tmp_path: Path) -> HubFolder:
    (tmp_path / "hub").mkdir(mode=0o700)
    return HubFolder(tmp_path / "hub")


def configuration(file: Path) -> Any:
    return json.loads("{" + file.read_text().partition("\n")[2] + "}")


def test_a_site_gets_an_account_that_exports_its_own_subjects_to_the_hub_alone(place: HubFolder) -> None:
    place.add_site("berlin")
    place.add_site("rome")
    accounts = configuration(place.nats_conf)["accounts"]
    assert set(accounts) == {"SITE_berlin", "SITE_rome", "HUB", "SYSTEM"}
    berlin = accounts["SITE_berlin"]
    assert berlin["users"][0]["permissions"] == {
        "publish": ["site.berlin.>", "_R_.>"],
        "subscribe": ["site.berlin.>"],
    }
    assert "rome" not in json.dumps(berlin)
    assert all(export["accounts"] == ["HUB"] for export in berlin["exports"])
    for entry in accounts["HUB"]["imports"]:
        (of,) = entry.values()
        assert of["subject"].startswith(f"site.{of['account'].removeprefix('SITE_')}.")


def test_the_secret_of_a_site_is_in_its_own_files_alone(place: HubFolder) -> None:
    files = place.add_site("berlin")
    seed = configuration(files / "leaf.conf")["leafnodes"]["remotes"][0]["nkey"]
    assert seed.startswith("SU")
    assert seed not in place.registry_file.read_text() + place.nats_conf.read_text()
    assert {file.stat().st_mode & 0o077 for file in (place.registry_file, place.nats_conf, *files.iterdir())} == {0}


def test_the_leaf_node_lets_the_hub_read_rows_and_nothing_else_of_the_stream(place: HubFolder) -> None:
    leaf = configuration(place.add_site("berlin") / "leaf.conf")
    assert leaf["accounts"]["SITE"]["mappings"] == {"site.berlin.rows": "$JS.API.DIRECT.GET.JOURNAL"}
    assert leaf["jetstream"]["domain"] == "site-berlin"
    assert leaf["listen"].startswith("127.0.0.1:")


def test_a_site_that_is_switched_off_has_no_account_until_it_is_switched_on(place: HubFolder) -> None:
    place.add_site("berlin")
    place.switch_off("berlin", "M. Weber", "its key was copied")
    assert "SITE_berlin" not in place.nats_conf.read_text()
    with pytest.raises(FolderUnusable, match=r"switched off by M\. Weber already"):
        place.switch_off("berlin", "A", "B")
    place.switch_on("berlin", "M. Weber")
    assert "SITE_berlin" in place.nats_conf.read_text()
    with pytest.raises(FolderUnusable, match="is not switched off"):
        place.switch_on("berlin", "M. Weber")


def test_a_site_that_is_removed_and_added_again_has_another_key(place: HubFolder) -> None:
    place.add_site("berlin")
    before = place.registry().sites["berlin"].nkey
    with pytest.raises(FolderUnusable, match="already"):
        place.add_site("berlin")
    place.remove_site("berlin")
    place.add_site("berlin")
    assert place.registry().sites["berlin"].nkey != before


def test_servers_that_run_by_themselves_get_the_accounts_and_leaf_nodes_know_all_of_them(place: HubFolder) -> None:
    nats = "servers: ['tls://n1:4222', 'tls://n2:4222'], address: [n1, n2], leaf_port: 7423"
    (place.path / "hub.yaml").write_text(f"nats: {{{nats}}}")
    leaf = configuration(place.add_site("berlin") / "leaf.conf")
    assert leaf["leafnodes"]["remotes"][0]["urls"] == ["tls://n1:7423", "tls://n2:7423"]
    found = configuration(place.accounts_conf)
    assert set(found) == {"accounts", "system_account"}
    assert set(found["accounts"]) == {"SITE_berlin", "HUB", "SYSTEM"}
    assert place.accounts_conf.stat().st_mode & 0o077 == 0
    assert not place.nats_conf.exists()


@pytest.mark.parametrize(
    ("address", "urls"),
    [
        ("hub.example", ["nats-leaf://hub.example:7422"]),
        ("[hub.example, 'hub.example:7522']", ["nats-leaf://hub.example:7422", "nats-leaf://hub.example:7522"]),
        (
            "['[2001:db8::5]', '[2001:db8::5]:7522']",
            ["nats-leaf://[2001:db8::5]:7422", "nats-leaf://[2001:db8::5]:7522"],
        ),
    ],
)
def test_leaf_nodes_connect_to_every_address_and_to_its_port_where_it_has_one(
    place: HubFolder, address: str, urls: list[str]
) -> None:
    (place.path / "hub.yaml").write_text(f"nats: {{address: {address}}}")
    leaf = place.add_site("berlin") / "leaf.conf"
    assert configuration(leaf)["leafnodes"]["remotes"][0]["urls"] == urls
    assert [server.port for server in hub_servers(leaf)] == [int(url.rpartition(":")[2]) for url in urls]


def test_a_server_that_listens_on_an_ipv6_address_is_given_its_brackets(place: HubFolder) -> None:
    (place.path / "hub.yaml").write_text("nats: {leaf_host: '::1'}")
    place.add_site("berlin")
    assert configuration(place.nats_conf)["leafnodes"]["listen"] == "[::1]:7422"


def test_a_connection_that_is_dead_is_given_up_within_seconds_on_both_sides(place: HubFolder) -> None:
    leaf = configuration(place.add_site("berlin") / "leaf.conf")
    assert leaf["ping_interval"] == configuration(place.nats_conf)["ping_interval"] == "5s"


def test_connections_of_sites_are_not_compressed_which_would_take_megabytes_for_each(place: HubFolder) -> None:
    leaf = configuration(place.add_site("berlin") / "leaf.conf")
    assert leaf["leafnodes"]["remotes"][0]["compression"] == "off"
    assert configuration(place.nats_conf)["leafnodes"]["compression"] == "off"


@pytest.mark.parametrize("site", ["", "Berlin", "a.b", "*", ">", "a b", "-a", "a-", "a" * 33, "../a", "a\n", "é"])
def test_an_id_that_would_mean_something_in_a_subject_or_a_path_is_refused(place: HubFolder, site: str) -> None:
    with pytest.raises(FolderUnusable, match="cannot be the id"):
        place.add_site(site)
    assert not place.registry_file.exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nats: {leaf_prot: 1}", "nats.leaf_prot: Extra inputs"),
        ("http: {port: 0}", "http.port"),
        ("nats: {servers: ['nats://me:secret@n1:4222']}", "nats.servers.0"),
        ("nats: {address: []}", "nats.address"),
        (
            "nats: {address: '2001:db8::5'}",
            r"nats\.address\.0: 2001:db8::5: an IPv6 address needs brackets, such as \[",
        ),
        ("nats: {address: [n1, 'n2:x']}", r"nats\.address\.1: 'n2:x' is no name or address"),
        ("nats: {address: 'n1:70000'}", r"nats\.address\.0: 'n1:70000' is no name"),
        ("nats: {servers: ['tls://2001:db8::5:4222']}", r"nats\.servers\.0: .*needs brackets"),
        ("nats: [", "cannot be read"),
        ("[]", "valid dictionary"),
    ],
)
def test_a_mistake_in_the_settings_is_named(place: HubFolder, text: str, message: str) -> None:
    (place.path / "hub.yaml").write_text(text)
    with pytest.raises(FolderUnusable, match=message):
        place.settings()


def test_a_folder_that_others_can_write_to_decides_nothing(place: HubFolder) -> None:
    place.path.chmod(0o777)
    with pytest.raises(FolderUnusable, match="chmod 700"):
        place.registry()


def test_an_nkey_is_in_the_notation_of_nats() -> None:
    key = make_nkey()
    for text, length in ((key.public, 56), (key.seed, 58)):
        assert len(text) == length
        data = base64.b32decode(text + "=" * (-len(text) % 8))
        assert binascii.crc_hqx(data[:-2], 0) == int.from_bytes(data[-2:], "little")
    assert (key.public[0], key.seed[:2]) == ("U", "SU")
    assert key.seed not in repr(key)
