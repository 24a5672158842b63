"""What SECURITY.md names is there."""

import re

from tests.support.programs import ROOT, call

PAGE = (ROOT / "SECURITY.md").read_text("utf-8")


def test_every_command_and_option_that_it_names_exists() -> None:
    commands = set(re.findall(r"`lift-manager\s+([a-z]+)", PAGE))
    assert commands >= {"network", "audit", "keys", "lockout", "release"}
    helps = [call("--help"), *(call(name, "--help") for name in commands)]
    known = {word for shown in helps for word in re.findall(r"--[a-z-]+", shown.stdout)}
    named = set(re.findall(r"--[a-z][a-z-]+", PAGE))
    assert named >= {"--suricata", "--since-seal"}
    assert named <= known
    assert call("keys", "make", "--help").returncode == 0


def test_a_reporting_address_is_not_made_up() -> None:
    assert "Report a vulnerability" in PAGE
    assert not re.search(r"[\w.]+@[\w.]+", PAGE)
