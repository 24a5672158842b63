"""Three NATS servers in one cluster, from the configuration that is shipped, each in a folder of its own as on three computers."""

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.lift_manager.hub.rig import NATS_SERVER, Rig
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S, ROOT, free_port

SHIPPED = ROOT / "deploy" / "nats" / "server.conf"
NAMES = ("n1", "n2", "n3")


class Servers:
    """Three servers, none of which runs yet. The first one is on the computer of the hub, and the others have copies of its file."""

    def __init__(self, rig: Rig, folder: Path) -> None:
        self.rig, self._folder = rig, folder
        self._ports = {name: {shipped: free_port() for shipped in (4222, 7422, 6222)} for name in NAMES}
        authority = Authority(folder / "ca")
        self._shown = authority.issue("server", "127.0.0.1")
        self._ca = authority.file
        rig.settings |= {"servers": self.urls(*NAMES), "ca": str(self._ca)}
        self.let_sites_connect_to(*NAMES)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def let_sites_connect_to(self, *names: str) -> None:
        """Let the sites that are added from now on know these servers."""
        self.rig.settings["address"] = [f"127.0.0.1:{self._ports[name][7422]}" for name in names]

    def urls(self, *names: str) -> list[str]:
        """Where the hub connects to these servers."""
        return [f"tls://127.0.0.1:{self._ports[name][4222]}" for name in names]

    def of(self, name: str) -> Path:
        """The folder of a server."""
        return self.rig.place.path if name == "n1" else self._folder / name

    def copy_accounts(self, *names: str, tell: bool = True) -> None:
        """Bring the file of the hub to these computers, or to all others, and let their servers read it, or do not `tell` them."""
        for name in names or NAMES[1:]:
            shutil.copy(self.rig.place.accounts_conf, self.of(name))
            if tell and name in self._processes:
                self._processes[name].send_signal(signal.SIGHUP)

    def times_read(self, name: str) -> int:
        """How often a server has read its configuration again."""
        return (self.of(name) / "server.log").read_text().count("Reloaded server configuration")

    def is_connected(self, name: str) -> bool:
        """Whether a server has a connection of a leaf node, where there is one leaf node."""
        log = (self.of(name) / "server.log").read_text()
        return log.count("Leafnode connection created") > log.count("Leafnode connection closed")

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run all of them, once there are sites."""
        for name in NAMES:
            self.of(name).mkdir(exist_ok=True)
        self.copy_accounts()
        try:
            for name in NAMES:
                self.start(name)
            yield
        finally:
            for name in self._processes:
                self.kill(name)

    def kill(self, name: str) -> None:
        """End one of them, as a loss of power would."""
        self._processes[name].kill()
        self._processes[name].wait(HANGS_S)

    def start(self, name: str) -> None:
        """Start one of them."""
        folder, text = self.of(name), SHIPPED.read_text()
        for shown, given in (
            (self._shown.certificate, "server.pem"),
            (self._shown.key, "server.key"),
            (self._ca, "ca.pem"),
        ):
            shutil.copy(shown, folder / given)
        for port, own in self._ports[name].items():
            text = text.replace(f'"0.0.0.0:{port}"', f'"127.0.0.1:{own}"')
        text = re.sub(r"tls://(n\d):6222", lambda found: f"tls://127.0.0.1:{self._ports[found[1]][6222]}", text)
        (folder / "server.conf").write_text(text)
        with (folder / "server.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [NATS_SERVER, "-c", "server.conf"],
                cwd=folder,
                env=os.environ | {"NATS_NAME": name},
                stdout=log,
                stderr=log,
            )

    def of_site(self, site: str) -> str:
        """The server to which the leaf node of a site has connected last."""
        ports = re.findall(r"127\.0\.0\.1:(\d+) .*Leafnode connection created", self.rig.log_of(site))
        return self.at(ports[-1])

    def at(self, address: str) -> str:
        """The server with an address."""
        port = int(address.rpartition(":")[2])
        return next(name for name in NAMES if port in self._ports[name].values())
