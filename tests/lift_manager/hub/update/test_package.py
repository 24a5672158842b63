"""What a signature covers, and what never gets into a package."""

import base64
from pathlib import Path

import pytest

from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.collect import collect
from lift_manager.hub.update.package import (
    LARGEST,
    Content,
    make_package,
    read_package,
    read_private_key,
    read_public_key,
    trusted_keys,
    verify,
    write_key,
)
from tests.lift_manager.hub.update.office import AT, OWN_MAP, Office


def test_a_package_of_a_trusted_key_is_returned_with_who_signed_it(office: Office) -> None:
    trusted = trusted_keys((str(office.public),))
    verified = verify(office.package(8), trusted)
    assert (verified.content.site, verified.content.number, verified.content.made_by) == ("berlin", 8, "M. Weber")
    assert set(verified.content.unpacked()) == {"site.yaml", "own.yaml"}
    assert verified.signed_by.startswith("office.pub (")


def test_a_package_of_another_key_is_refused(office: Office, tmp_path: Path) -> None:
    stranger, _ = write_key(tmp_path / "stranger.key")
    with pytest.raises(UpdateRefused, match="not signed with a key that this site trusts"):
        verify(office.package(8), trusted_keys((str(stranger),)))
    with pytest.raises(UpdateRefused, match="not signed with a key"):
        verify(office.package(8), {})


@pytest.mark.parametrize("of_its_length", [0.02, 0.3, 0.6, 0.999])
def test_a_byte_that_was_changed_anywhere_is_noticed(office: Office, of_its_length: float) -> None:
    package = bytearray(office.package(8))
    at = int(len(package) * of_its_length)
    package[at] = ord("A") if package[at] != ord("A") else ord("B")
    with pytest.raises(UpdateRefused, match="not signed with a key"):
        verify(bytes(package), trusted_keys((str(office.public),)))


@pytest.mark.parametrize("data", [b"", b"\n", b"A" * 88, b"A" * 88 + b"\n{}", b"x" * (LARGEST + 1)])
def test_what_is_no_package_is_refused(data: bytes) -> None:
    with pytest.raises(UpdateRefused, match=r"no configuration update|cannot be read"):
        read_package(data)


@pytest.mark.parametrize("name", ["../site.yaml", "/etc/passwd", "a/../b", "a//b", "", ".hidden", "a/.b", "a\nb"])
def test_a_name_that_leads_out_of_the_folder_is_refused(name: str) -> None:
    with pytest.raises(UpdateRefused, match="files"):
        Content.of(site="berlin", number=1, made_by="A", made_at=AT, files={"site.yaml": b"", name: b""})


def test_a_package_that_is_too_large_is_not_made(office: Office) -> None:
    files = {"site.yaml": b"", "film": bytes(LARGEST)}
    with pytest.raises(UpdateRefused, match="are the most"):
        make_package(Content.of(site="a", number=1, made_by="A", made_at=AT, files=files), office.key)


def test_a_private_key_is_for_its_owner_alone_and_never_replaced(tmp_path: Path) -> None:
    public, mark = write_key(tmp_path / "office.key", "secret words")
    assert (tmp_path / "office.key").stat().st_mode & 0o077 == 0
    assert read_private_key(tmp_path / "office.key", lambda: "secret words").public_key() == read_public_key(public)
    assert len(mark) == 16
    with pytest.raises(UpdateRefused, match="the passphrase is wrong"):
        read_private_key(tmp_path / "office.key", lambda: "others")
    with pytest.raises(UpdateRefused, match="is there already"):
        write_key(tmp_path / "office.key")


def test_a_public_key_that_others_can_replace_is_not_trusted(office: Office) -> None:
    office.public.chmod(0o666)
    with pytest.raises(UpdateRefused, match="can be written by others"):
        trusted_keys((str(office.public),))


@pytest.mark.parametrize(
    "secret",
    ["-----BEGIN PRIVATE KEY-----\nAAAA", f"lm_{'0' * 8}_{'7' * 64}"],
)
def test_a_file_with_a_secret_is_not_packed(office: Office, secret: str) -> None:
    loaded = office.draft(office.site())
    (loaded.path.parent / "more.txt").write_text(f"words\n{secret}\n")
    with pytest.raises(UpdateRefused, match="holds a key"):
        collect(loaded, (Path("more.txt"),))


def test_a_map_outside_the_folder_of_the_site_file_is_not_packed(office: Office) -> None:
    (office.folder / "drafts").mkdir()
    (office.folder / "drafts" / "own.yaml").write_text(OWN_MAP)
    site = office.site(controllers={"plc": {"host": "192.0.2.10", "map": "../own.yaml"}})
    with pytest.raises(UpdateRefused, match="is not in the folder of"):
        collect(office.draft(site), ())


def test_announcements_and_named_files_are_packed_by_their_names(office: Office) -> None:
    loaded = office.draft(office.site(announcements="words"))
    folder = loaded.path.parent
    (folder / "words").mkdir()
    (folder / "words" / "enters.wav").write_bytes(b"\x00\xff")
    (folder / "notes.md").write_text("read this")
    files = collect(loaded, (Path("notes.md"),))
    assert set(files) == {"site.yaml", "own.yaml", "words/enters.wav", "notes.md"}
    content = Content.of(site="berlin", number=1, made_by="A", made_at=AT, files=files)
    assert content.unpacked() == files
    assert base64.b64decode(content.files["words/enters.wav"]) == b"\x00\xff"
