"""`lift-manager bundle`: what is in the archive, and that no secret of a planted set is, in whatever file it was."""

import io
import json
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner, Result

from lift_manager.api.keys import Key
from lift_manager.api.roles import Role
from lift_manager.cli.main import app
from lift_manager.lab.bench import LiftSite
from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.keys import keys_path, make_key
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow
from tests.support.certificates import Authority
from tests.support.programs import free_port
from tests.support.rows import each_row

NAME = "Main hospital"
PASSWORD = "hunter2-of-the-proxy"
SITE = """\
schema: 1
name: Main hospital
state: kept
# the proxy: https://anna:{password}@proxy.example, ask Anna Berg
api:
  tls: {{certificate: manager.pem, key: manager.key}}
controllers:
  plc: {{host: 192.0.2.10, map: ./own.yaml}}
lifts:
  east: {{controller: plc, access: control, accept_latching: "Anna Berg stands by", floors: {{G: 0, First: 1}}}}
"""
MAP_COMMENT = f"# measured by Anna Berg; token: {PASSWORD}\n"


def bundled(*words: str | Path) -> Result:
    done = CliRunner().invoke(app, ["bundle", *map(str, words)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def content(archive: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(archive.read_bytes())) as found:
        return {name: found.read(name) for name in found.namelist()}


class Planted:
    """A site with secrets in every place where there may be one."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "site.yaml"
        self.file.write_text(SITE.format(password=PASSWORD))
        shipped = (Path(__file__).parents[2] / "register_maps" / "maps" / "two-stop-agv.yaml").read_text()
        (folder / "own.yaml").write_text(MAP_COMMENT + shipped.replace("name: two-stop-agv", "name: own"))
        Authority(folder).issue("manager", "127.0.0.1")
        self.private = (folder / "manager.key").read_text()
        journal = store_path(NAME, "kept", self.file, {})
        journal.parent.mkdir(mode=0o700, exist_ok=True)
        now = datetime(2026, 11, 20, tzinfo=UTC)
        self.token = make_key(
            keys_path(journal), NAME, Key("", "amr-7", Role.ROBOT, ("east",)), by="Anna Berg", at=now
        ).reveal()
        self.digest = json.loads(keys_path(journal).read_text())["keys"][0]["sha256"]
        store = SqliteStore(journal, NAME, Limits(keep_days=400, max_mb=500))
        rows = [
            Row(RowKind.MANAGER, "a manager started"),
            Row(RowKind.REQUEST, "requests First", "east", "api:amr-7", {"floor": "First", "key": self.token}),
            Row(RowKind.PERSON, f"lockout by Anna Berg: password: {PASSWORD}", "east", "Anna Berg", {"said": "lockout", "reason": f"use {PASSWORD}"}),
            Row(RowKind.REQUEST, "refused: east is locked out by Anna Berg: she cleans", "east", "api:amr-7"),
            Row(RowKind.LINK, f"connection to https://x:{PASSWORD}@plc failed, digest {self.digest}", "east"),
        ]  # fmt: skip
        store.commit({}, [PendingRow(1_700_000_000_000_000 + at, row) for at, row in enumerate(rows)])
        store.close()

    @property
    def secrets(self) -> list[str]:
        private = [line for line in self.private.splitlines() if "-----" not in line and len(line) > 20]
        return [self.token, self.token.rpartition("_")[2], self.digest, PASSWORD, *private]


@pytest.fixture
def planted(tmp_path: Path) -> Planted:
    return Planted(tmp_path)


def attachments(planted: Planted) -> list[str | Path]:
    """Return options that attach files full of secrets."""
    files = {
        "doctor.txt": f"Authorization: Bearer {planted.token}\n{planted.private}\nkey {planted.digest.upper()}",
        "trace.jsonl": json.dumps({"url": f"http://a:{PASSWORD}@b", "pem": planted.private}) + "\n",
    }
    words: list[str | Path] = []
    for name, text in files.items():
        (planted.folder / name).write_text(text)
        words += ["--attach", planted.folder / name]
    return words


@pytest.mark.parametrize("names", [[], ["--with-names"]])
def test_no_planted_secret_is_anywhere_in_the_bundle(planted: Planted, names: list[str]) -> None:
    target = planted.folder / "support.zip"
    done = bundled(planted.file, "-o", target, *attachments(planted), *names, "--manager", f"127.0.0.1:{free_port()}")
    assert done.exit_code == 0, done.output
    files = content(target)
    assert {
        "site.yaml",
        "journal.jsonl",
        "maps/own.yaml",
        "attached/doctor.txt",
        "attached/trace.jsonl",
    } <= files.keys()
    for name, data in files.items():
        text = data.decode().lower()
        found = [secret for secret in planted.secrets if secret.lower() in text]
        assert found == [], name
        assert "private key-----" not in text, name


def test_names_and_words_of_people_are_numbers_unless_they_are_wanted(planted: Planted) -> None:
    target = planted.folder / "support.zip"
    assert bundled(planted.file, "-o", target).exit_code == 0
    assert [
        name for name, data in content(target).items() if b"Anna" in data or b"cleans" in data or b"amr-7" in data
    ] == []
    journal = [json.loads(line) for line in content(target)["journal.jsonl"].decode().splitlines()]
    assert [row["caller"] for row in journal] == ["", "api:name-1", "name-2", "api:name-1", ""]
    assert journal[2]["text"] == "lockout by (left out)"
    assert bundled(planted.file, "-o", target, "--with-names", "--force").exit_code == 0
    assert b"Anna Berg" in content(target)["journal.jsonl"]


def test_what_support_needs_is_there(planted: Planted) -> None:
    target = planted.folder / "support.zip"
    assert bundled(planted.file, "-o", target).exit_code == 0
    files = {name: data.decode() for name, data in content(target).items()}
    assert yaml.safe_load(files["site.yaml"])["controllers"]["plc"]["host"] == "192.0.2.10"
    assert yaml.safe_load(files["maps/own.yaml"])["name"] == "own"
    assert files["maps.txt"].startswith("east: own, integration-code, sha256 ")
    assert "no mistakes" in files["check.txt"]
    assert "python 3." in files["versions.txt"]
    assert "pymodbus 3." in files["versions.txt"]
    assert len(files["journal.jsonl"].splitlines()) == 5


def test_the_manifest_lists_every_file_and_what_was_left_out_with_the_reason(planted: Planted) -> None:
    target = planted.folder / "support.zip"
    done = bundled(planted.file, "-o", target, "--attach", planted.folder / "none.pcapng", "--rows", "2")
    assert done.exit_code == 0
    files = content(target)
    manifest = files["MANIFEST.txt"].decode()
    assert all(f"  {name}  (" in manifest for name in files if name != "MANIFEST.txt")
    for line in (
        "journal.jsonl", "the newest 2 rows of the journal", "attached/none.pcapng: it cannot be read",
        "manager/: the state of a running manager", "the key file of the site: key digests are secrets", "private keys",
    ):  # fmt: skip
        assert line in manifest, line
    assert "it is not in the bundle" in done.stderr
    assert "left out: manager/" in done.stdout


def test_a_binary_attachment_goes_in_as_it_is_unless_it_holds_a_known_secret(planted: Planted) -> None:
    target, trace = planted.folder / "support.zip", planted.folder / "trace.pcapng"
    trace.write_bytes(b"\x0a\x0d\x0d\x0a\xff\xfe frames")
    assert bundled(planted.file, "-o", target, "--attach", trace).exit_code == 0
    assert content(target)["attached/trace.pcapng"] == trace.read_bytes()
    trace.write_bytes(b"\xff\xfe" + planted.digest.encode("utf-16-le"))
    done = bundled(planted.file, "-o", target, "--attach", trace, "--force")
    assert done.exit_code == 1
    assert "nothing was written: attached/trace.pcapng holds a secret" in done.stderr


@each_row(
    ("text", "says"),
    [
        ("schema: 1\nname: [broken", "it cannot be read as YAML"),
        ("schema: 1\nname: No lifts\ncontrollers: {}\npassword: hunter2-of-the-proxy\n", "the site file has mistakes"),
    ],
)
def test_a_site_file_with_mistakes_makes_a_bundle_too(
    text: str, says: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("broken")
    (folder / "site.yaml").write_text(text)
    done = bundled(folder / "site.yaml", "-o", folder / "support.zip")
    assert done.exit_code == 0, done.output
    assert says in content(folder / "support.zip")["MANIFEST.txt"].decode()
    assert all(PASSWORD.encode() not in data for data in content(folder / "support.zip").values())


def test_a_wrong_command_line_is_refused(tmp_path: Path) -> None:
    assert "there is no such site file" in bundled(tmp_path / "none.yaml").stderr
    (tmp_path / "site.yaml").write_text("schema: 1\n")
    assert "the ending says what to write" in bundled(tmp_path / "site.yaml", "-o", tmp_path / "x.tar").stderr
    (tmp_path / "there.zip").write_text("mine")
    done = bundled(tmp_path / "site.yaml", "-o", tmp_path / "there.zip")
    assert (done.exit_code, (tmp_path / "there.zip").read_text()) == (1, "mine")


@pytest.mark.lift("main")
def test_the_state_of_a_running_manager_is_in_it(lift_site: LiftSite, planted: Planted) -> None:
    lift_site.request("L2", by="tug of Anna Berg")
    lift_site.wait_for(lambda state: state.holder is not None, within_s=60)
    target = planted.folder / "support.zip"
    done = bundled(planted.file, "-o", target, "--manager", lift_site.address)
    assert done.exit_code == 0, done.output
    files = {name: data.decode() for name, data in content(target).items()}
    wanted = ("lifts.json", "readiness.json", "main-signals.json", "main-capabilities.json")
    assert {f"manager/{name}" for name in wanted} <= files.keys()
    assert json.loads(files["manager/lifts.json"])["name"] == "main"
    assert "manager/metrics.txt: " in files["MANIFEST.txt"]  # this manager has none, and that is said
    assert [name for name, text in files.items() if "Anna" in text] == []
