"""The keys of `hub` in a site file, and the file with the password for the leaf node."""

from pathlib import Path

import pytest

from lift_manager.config.hub import hub_password
from tests.lift_manager.config.site_files import GENERIC, assert_says_exactly, findings, load, said

HUB = "hub: {site: berlin, password: manager.password}\ncontrollers:\n"


def with_hub(text: str) -> tuple[str, str]:
    return ("controllers:\n", text)


def test_a_site_without_a_hub_has_none(tmp_path: Path) -> None:
    assert load(tmp_path, GENERIC).site.hub is None


def test_the_password_is_read_from_its_file_and_commands_are_off(tmp_path: Path) -> None:
    (tmp_path / "manager.password").write_text("secret\n")
    (tmp_path / "manager.password").chmod(0o600)
    loaded = load(tmp_path, GENERIC, with_hub(HUB))
    assert loaded.unusable == ()
    assert loaded.site.hub is not None
    assert (loaded.site.hub.server, loaded.site.hub.commands) == ("nats://127.0.0.1:4223", False)
    assert hub_password(loaded.site, tmp_path) == "secret"


@pytest.mark.parametrize(
    ("content", "mode", "words"),
    [(None, 0, "does not exist"), ("x", 0o644, "chmod 600"), (" \n", 0o600, "is empty")],
)
def test_a_password_that_cannot_be_used_prevents_the_start(
    tmp_path: Path, content: str | None, mode: int, words: str
) -> None:
    if content is not None:
        (tmp_path / "manager.password").write_text(content)
        (tmp_path / "manager.password").chmod(mode)
    (found,) = load(tmp_path, GENERIC, with_hub(HUB)).unusable
    assert (found.key, words in found.message) == ("hub.password", True)


@pytest.mark.parametrize(
    ("hub", "key", "words"),
    [
        ("{site: Berlin, password: p}", "hub.site", "small letters, digits and hyphens"),
        ("{site: a.b, password: p}", "hub.site", "small letters, digits and hyphens"),
        ("{site: a, password: p, server: 'nats://user:pw@127.0.0.1'}", "hub.server", "nats://127.0.0.1:4223"),
        ("{site: a, password: p, server: 'http://127.0.0.1'}", "hub.server", "nats://127.0.0.1:4223"),
        ("{site: a, password: p, commands: 1}", "hub.commands", "true or false"),
        ("{password: p}", "hub.site", "missing"),
    ],
)
def test_a_mistake_is_named_with_the_way_out(tmp_path: Path, hub: str, key: str, words: str) -> None:
    assert_says_exactly(findings(tmp_path, GENERIC, with_hub(f"hub: {hub}\ncontrollers:\n")), said(3, key, words))
