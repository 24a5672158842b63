"""Certificates and keys that a site file names: what cannot be used is a mistake, what a person should know a caution."""

import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from lift_manager.config.load import LoadedSite, check_file
from register_maps.errors import MapFileError
from tests.lift_manager.config.site_files import GENERIC, assert_says_exactly, edited, findings, load, said
from tests.support.certificates import Authority

LINK = "tls: {ca: ca.pem, certificate: link.pem, key: link.key}"
SECURED = edited(
    GENERIC,
    ("port: 502, map: generic-registers}", f"map: generic-registers, {LINK}}}"),
    ("name: A building\n", "name: A building\napi: {tls: {certificate: api.pem, key: api.key, client_ca: ca.pem}}\n"),
)


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    made = Authority(tmp_path)
    made.issue("link", "lift-manager")
    made.issue("api", "127.0.0.1", "lift-pc")
    return made


def about_files(loaded: LoadedSite) -> list[str]:
    words = ("certificate", "key ", "port 802")
    return [line for line in loaded.cautions() if any(word in line for word in words)]


def test_good_files_are_listed_with_whom_they_are_for(tmp_path: Path, authority: Authority) -> None:
    loaded = load(tmp_path, SECURED)
    assert (loaded.unusable, about_files(loaded)) == ((), [])
    lines = check_file(tmp_path / "site.yaml")
    until = f"{datetime.now(UTC) + timedelta(days=365):%Y-%m-%d}"
    assert f"api: HTTPS, certificate for lift-pc, 127.0.0.1, until {until}" in lines
    assert f"plc: Modbus/TCP Security, without a role, certificate until {until}" in lines


def test_over_tls_the_port_is_802_unless_another_is_said(tmp_path: Path, authority: Authority) -> None:
    ports = []
    for port in ("", "port: 8802, "):
        loaded = load(tmp_path, SECURED, ("host: 10.0.0.5, ", f"host: 10.0.0.5, {port}"))
        ports.append(loaded.controllers["plc"].port)
    assert ports == [802, 8802]
    assert load(tmp_path, GENERIC, (" port: 502,", "")).controllers["plc"].port == 502


def test_two_entries_for_one_controller_are_found_by_the_port_that_nobody_said(
    tmp_path: Path, authority: Authority
) -> None:
    second = ("lifts:\n", "  again: {host: 10.0.0.5, port: 802, map: generic-registers}\nlifts:\n")
    assert_says_exactly(
        findings(tmp_path, SECURED, second),
        said(6, "controllers.again.port", "10.0.0.5:802 is controller 'plc' already"),
    )


def test_port_802_without_tls_is_a_caution(tmp_path: Path) -> None:
    told = about_files(load(tmp_path, GENERIC, ("port: 502", "port: 802")))
    assert told == [
        "plc: port 802 is that of Modbus/TCP Security, but there is no `tls`: a controller that speaks it there hangs up"
    ]


# -- what cannot be used


def remove(folder: Path, name: str) -> None:
    (folder / name).unlink()


def garble(folder: Path, name: str) -> None:
    (folder / name).write_bytes(b"nothing that a machine reads")


def lock(folder: Path, name: str) -> None:
    key = serialization.load_pem_private_key((folder / name).read_bytes(), None)
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    (folder / name).write_bytes(key.private_bytes(pem, pkcs8, serialization.BestAvailableEncryption(b"open sesame")))


def exchange(folder: Path, name: str) -> None:
    (folder / name).write_bytes((folder / ("api.key" if name == "link.key" else "link.key")).read_bytes())


def pipe(folder: Path, name: str) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)


API, PLC = "api.tls", "controllers.plc.tls"


@pytest.mark.parametrize(
    ("spoil", "name", "where", "words"),
    [
        (remove, "api.pem", [(3, f"{API}.certificate")], "does not exist; paths are relative to the site file"),
        (remove, "link.key", [(5, f"{PLC}.key")], "does not exist"),
        (remove, "ca.pem", [(3, f"{API}.client_ca"), (5, f"{PLC}.ca")], "does not exist"),
        (garble, "link.pem", [(5, f"{PLC}.certificate")], "holds no certificate that can be read"),
        (garble, "api.key", [(3, f"{API}.key")], "holds no private key that can be read"),
        (lock, "link.key", [(5, f"{PLC}.key")], "is protected by a passphrase, and nobody is there to type it"),
        (pipe, "link.pem", [(5, f"{PLC}.certificate")], "cannot be read: it is not a file, but a pipe or a device"),
        (pipe, "api.key", [(3, f"{API}.key")], "cannot be read: it is not a file, but a pipe or a device"),
        (pipe, "ca.pem", [(3, f"{API}.client_ca"), (5, f"{PLC}.ca")], "cannot be read: it is not a file"),
        (exchange, "link.key", [(5, f"{PLC}.key")], "does not belong to the certificate"),
        (exchange, "api.key", [(3, f"{API}.key")], "does not belong to the certificate"),
    ],
)
def test_a_file_that_cannot_be_used_is_a_mistake_at_its_place(
    tmp_path: Path,
    authority: Authority,
    spoil: Callable[[Path, str], None],
    name: str,
    where: list[tuple[int, str]],
    words: str,
) -> None:
    spoil(tmp_path, name)
    loaded = load(tmp_path, SECURED)
    assert_says_exactly(loaded.unusable, *(said(line, key, str(tmp_path / name), words) for line, key in where))
    with pytest.raises(MapFileError) as caught:
        check_file(tmp_path / "site.yaml")
    assert caught.value.findings == loaded.unusable
    assert not any(secret in str(caught.value) for secret in ("PRIVATE", "nothing that a machine", "open sesame"))


def test_other_mistakes_of_the_site_file_do_not_hide_these(tmp_path: Path, authority: Authority) -> None:
    remove(tmp_path, "api.pem")
    found = findings(tmp_path, SECURED, ("controller: plc", "controller: nobody"))
    assert {finding.key for finding in found} == {"lifts.main.controller", f"{API}.certificate"}


def test_a_file_that_this_user_may_not_read_says_so(tmp_path: Path, authority: Authority) -> None:
    if os.geteuid() == 0:
        # root reads everything; a folder is what nobody reads as a file
        remove(tmp_path, "link.key")
        (tmp_path / "link.key").mkdir()
        expected = "cannot be read: Is a directory"
    else:
        (tmp_path / "link.key").chmod(0)
        expected = "may not be read by the user that runs this"
    assert_says_exactly(load(tmp_path, SECURED).unusable, said(5, f"{PLC}.key", expected))


def test_a_missing_word_is_a_mistake_of_the_site_file(tmp_path: Path) -> None:
    found = findings(tmp_path, SECURED, (", key: link.key", ""), (", key: api.key", ""))
    assert {finding.key for finding in found} == {f"{PLC}.key", f"{API}.key"}


# -- what a person should know


@pytest.mark.parametrize(
    ("days", "words"),
    [
        (-2, "has expired on"),
        (29, "in 28 days; renew it before that"),
        (31, ""),
    ],
)
def test_what_expires_is_told_in_time_and_keeps_nobody_from_starting(
    tmp_path: Path, authority: Authority, days: int, words: str
) -> None:
    since = datetime.now(UTC) - timedelta(days=400)
    authority.issue("link", "lift-manager", since=since, until=timedelta(days=days))
    loaded = load(tmp_path, SECURED)
    told = about_files(loaded)
    assert loaded.unusable == ()
    if words:
        (line,) = told
        assert line.startswith(f"plc: certificate {tmp_path / 'link.pem'} ")
        assert words in line
    else:
        assert told == []


def test_a_certificate_from_the_future_points_at_the_clock(tmp_path: Path, authority: Authority) -> None:
    authority.issue("api", "127.0.0.1", since=datetime.now(UTC) + timedelta(days=5))
    (line,) = about_files(load(tmp_path, SECURED))
    assert "is not valid before" in line
    assert "check the clock of this computer" in line


@pytest.mark.parametrize(("mode", "told"), [(0o600, False), (0o640, False), (0o644, True)])
def test_a_key_that_everybody_can_read_is_a_caution(
    tmp_path: Path, authority: Authority, mode: int, *, told: bool
) -> None:
    (tmp_path / "link.key").chmod(mode)
    lines = about_files(load(tmp_path, SECURED))
    expected = f"plc: everybody on this computer can read the key {tmp_path / 'link.key'}; `chmod 600` corrects it"
    assert lines == ([expected] if told else [])
