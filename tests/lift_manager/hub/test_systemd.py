"""What systemd learns of a hub, and the units for a hub, its NATS servers, and the leaf node of a site."""

import configparser
import signal
from pathlib import Path

import httpx
import pytest
import yaml

from tests.lift_manager.hub.rig import Rig
from tests.support.programs import HANGS_S, OUT_WITHIN_S, ROOT, eventually, free_port, running
from tests.support.systemd import Systemd, systemd_at

UNITS = ROOT / "deploy" / "systemd"
HUB, NATS, LEAF = (f"lift-manager-{name}.service" for name in ("hub", "nats", "leaf"))


def until_status(systemd: Systemd, status: str) -> list[str]:
    """Take what arrives until it has this status; return that message."""
    while f"STATUS={status}" not in (message := systemd.hear()):
        assert "READY=1" not in message
    return message


def test_a_hub_is_ready_once_it_has_its_nats_server_and_says_when_that_is_lost(tmp_path: Path) -> None:
    address = str(tmp_path / "notify")
    rig = Rig(tmp_path / "hub")
    rig.use_separate_server()
    rig.add("berlin")
    settings = yaml.safe_load((rig.place.path / "hub.yaml").read_text())
    port = free_port()
    (rig.place.path / "hub.yaml").write_text(yaml.safe_dump({**settings, "http": {"port": port}}))
    rig.place.write(rig.place.registry())

    def is_ready() -> bool:
        return httpx.get(f"http://127.0.0.1:{port}/readyz", trust_env=False, timeout=HANGS_S).is_success

    variables = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "400000"}
    with systemd_at(address) as systemd, running("hub", "--folder", rig.place.path, env=variables) as hub:
        assert systemd.hear() == ["STATUS=waiting for a NATS server"]
        with rig.nats_server():
            assert systemd.hear() == ["READY=1", "WATCHDOG=1", "STATUS=1 site, 0 online"]
            assert is_ready()
        lost = until_status(systemd, "1 site, 0 online, no connection to a NATS server")
        assert lost[0] == "WATCHDOG=1"
        assert not is_ready()
        with rig.nats_server():
            until_status(systemd, "1 site, 0 online")
            eventually(is_ready)
            systemd.heard()  # a socket keeps only a few datagrams that nobody takes, and drops the next
            hub.tell(signal.SIGTERM)
            while "STOPPING=1" not in systemd.hear():
                pass
            assert hub.ended() == 0


def service_of(name: str) -> configparser.SectionProxy:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]  # systemd's names have capitals
    unit.read_string((UNITS / name).read_text("utf-8"))
    return unit["Service"]


def test_the_unit_of_the_hub_fits_the_program() -> None:
    service = service_of(HUB)
    assert (service["Type"], service["NotifyAccess"]) == ("notify", "main")
    assert " -I -m lift_manager hub --folder /var/lib/lift-manager-hub" in service["ExecStart"]
    assert service["StateDirectory"] == "lift-manager-hub"
    # a hub ends its own NATS server, and has to be the first to learn that it is to end
    assert service["KillMode"] == "mixed"
    assert float(service["TimeoutStopSec"]) > OUT_WITHIN_S
    assert service["TimeoutStartSec"] == "infinity"


@pytest.mark.parametrize("name", [NATS, LEAF])
def test_a_nats_server_is_given_no_option_that_keeps_it_from_reading_its_configuration_again(name: str) -> None:
    (_, *words) = service_of(name)["ExecStart"].split()
    assert len(words) == 2
    assert words[0] == "-c"
    # a minimal Debian has no program `kill`; systemd replaces $MAINPID as a word of its own only, and ${MAINPID} anywhere
    assert service_of(NATS)["ExecReload"] == "nats-server --signal reload=${MAINPID}"


def test_the_leaf_node_and_the_hub_are_no_users_who_reach_the_state_of_lifts() -> None:
    users = [service_of(name)["User"] for name in ("lift-manager.service", HUB, LEAF)]
    assert len(set(users)) == len(users)
    # the server beside a hub reads the file that the hub writes
    assert service_of(NATS)["User"] == service_of(HUB)["User"]


@pytest.mark.parametrize("name", [HUB, NATS, LEAF])
def test_the_units_deny_what_that_of_the_manager_denies(name: str) -> None:
    own, of_manager = service_of(name), service_of("lift-manager.service")
    first = list(of_manager).index("CapabilityBoundingSet")
    denied = {key: of_manager[key] for key in list(of_manager)[first:] if key != "ReadWritePaths"}
    assert denied.items() <= dict(own).items()
