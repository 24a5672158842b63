"""What docs/how-to/two-managers.md has people set up, carried out with the blocks of the page: three machines on the loopback."""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.support.pages import blocks, not_run
from tests.support.programs import ROOT, call, eventually, free_port

pytestmark = pytest.mark.external("etcd", "openssl", "sh")

PAGE = ROOT / "docs" / "how-to" / "two-managers.md"
MACHINES = {"north": "192.0.2.11", "south": "192.0.2.12", "witness": "192.0.2.13"}


class Ports:
    """Puts the machines of the page on the loopback, on ports that are free."""

    def __init__(self) -> None:
        self._client, self._peer = str(free_port()), str(free_port())

    def translate(self, text: str) -> str:
        text = text.replace(":2379", f":{self._client}").replace(":2380", f":{self._peer}")
        # a member compares the certificate of another one with the address that it comes from, which is this one on the loopback
        text = text.replace("IP:$address", "IP:$address,IP:127.0.0.1")
        return text.replace("192.0.2.1", "127.0.0.1")


@contextmanager
def member(name: str, settings: str, folder: Path) -> Iterator[None]:
    """Run etcd with the settings of a machine."""
    places = {"/etc/etcd": str(folder), "/var/lib/etcd/lifts": str(folder / f"{name}-data")}
    for place, own in places.items():
        settings = settings.replace(place, own)
    env: Mapping[str, str] = dict(line.split("=", 1) for line in settings.splitlines())
    ours = {key: value for key, value in os.environ.items() if not key.startswith("ETCD")}
    process = subprocess.Popen(
        ["etcd", "--log-level", "error"],
        env={**ours, **env},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.kill()
        process.wait()


def is_prepared(site: Path) -> bool:
    done = call("cluster", "init", site)
    assert done.returncode == 0 or "etcd" in done.stderr, done.stderr
    return done.returncode == 0


def test_three_members_with_the_certificates_of_the_page_hold_the_site_of_the_page(tmp_path: Path) -> None:
    ports = Ports()
    skipped = not_run(PAGE)
    (make_certificates,) = [block for block in blocks(PAGE, "sh") if block.splitlines()[0] not in skipped]
    subprocess.run(
        ["sh", "-e", "-c", ports.translate(make_certificates)],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        timeout=120,
    )
    (settings,), (site,) = blocks(PAGE, "ini"), blocks(PAGE, "yaml")
    site = ports.translate(site).replace("/var/lib/lift-manager", "state").replace("manager.", "north.")
    (tmp_path / "site.yaml").write_text(site, "utf-8")
    with ExitStack() as members:
        for name, address in MACHINES.items():
            own = re.sub(r"(?<=URLS=https://)192\.0\.2\.11", address, settings)
            own = own.replace("ETCD_NAME=north", f"ETCD_NAME={name}").replace("/north.", f"/{name}.")
            members.enter_context(member(name, ports.translate(own), tmp_path))
        eventually(lambda: is_prepared(tmp_path / "site.yaml"))
        shown = call("cluster", "status", tmp_path / "site.yaml").stdout
    assert "Main hospital: no machine is active; epoch 0, commit 0" in shown
