"""Certificates and the running manager: what the links are told, what is said every day, and what the command line refuses."""

import asyncio
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lift_manager import app
from lift_manager.config.load import load_site
from tests.support.certificates import Authority
from tests.support.programs import run, run_each
from tests.support.virtual_time import run_virtual

SITE = """\
schema: 1
name: A building
controllers:
  secured: {host: 127.0.0.1, port: 8802, map: generic-registers, tls: {ca: ca.pem, certificate: link.pem, key: link.key}}
  plain: {host: 127.0.0.1, port: 5020, map: generic-registers}
lifts:
  main: {controller: secured, floors: {L1: 1, L2: 2}}
  goods: {controller: plain, floors: {L1: 1, L2: 2}}
"""
ACK = ("ack", "main", "--by", "M. Weber", "--manager", "https://127.0.0.1:9")


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    (tmp_path / "site.yaml").write_text(SITE, "utf-8")
    made = Authority(tmp_path)
    made.issue("link", "lift-manager")
    return made


def test_a_link_knows_whether_an_exception_may_be_about_its_role(tmp_path: Path, authority: Authority) -> None:
    async def main() -> None:
        links = app.build(load_site(tmp_path / "site.yaml")).links
        assert [link.settings.tls for link in links] == [True, False]

    asyncio.run(main())


def test_a_certificate_that_expires_while_the_manager_runs_is_told_once_a_day(
    tmp_path: Path, authority: Authority, caplog: pytest.LogCaptureFixture
) -> None:
    loaded = load_site(tmp_path / "site.yaml")

    async def main() -> None:
        reminding = asyncio.create_task(app.remind(loaded))
        await asyncio.sleep(3.5 * app.REMIND_EVERY_S)
        assert caplog.messages == []
        since = datetime.now(UTC) - timedelta(days=300)
        authority.issue("link", "lift-manager", since=since, until=timedelta(days=10, hours=1))
        await asyncio.sleep(2 * app.REMIND_EVERY_S)
        reminding.cancel()
        with suppress(asyncio.CancelledError):
            await reminding

    run_virtual(main, limit_s=10 * app.REMIND_EVERY_S)
    assert len(caplog.messages) == 2
    assert all(line.startswith(f"secured: certificate {tmp_path / 'link.pem'} expires on ") for line in caplog.messages)


def test_a_manager_does_not_start_with_files_that_cannot_be_used(tmp_path: Path, authority: Authority) -> None:
    (tmp_path / "link.key").unlink()
    done = run("serve", tmp_path / "site.yaml", "--port", "0")
    assert done.returncode == 2
    assert f"controllers.secured.tls.key: {tmp_path / 'link.key'} is not there" in done.stderr
    assert "Traceback" not in done.stderr


REFUSALS = [
    (("--ca", "none.pem"), 1, "--ca none.pem cannot be used: No such file or directory"),
    (("--ca", "link.key"), 1, "--ca link.key cannot be used: it is not in PEM form"),
    (("--certificate", "link.pem"), 1, "its key is not in it (--certificate-key FILE)"),
    (("--certificate", "link.pem", "--certificate-key", "other.key"), 1, "its key belongs to another certificate"),
    (("--certificate-key", "link.key"), 2, "a key needs its certificate"),
    (("--ca", "ca.pem"), 1, "no manager answers at https://127.0.0.1:9"),
]


def test_the_command_line_says_which_of_its_files_does_not_fit(tmp_path: Path, authority: Authority) -> None:
    authority.issue("other", "other")
    for done, (_, code, words) in zip(
        run_each([(*ACK, *options) for options, _, _ in REFUSALS], tmp_path), REFUSALS, strict=True
    ):
        assert done.returncode == code
        assert words in done.stderr
        assert "Traceback" not in done.stderr
        assert "PRIVATE" not in done.stderr
