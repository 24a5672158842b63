"""Real members of etcd on the loopback, ended by their id whatever happens."""

import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from lift_manager.cluster.errors import EtcdError
from lift_manager.cluster.etcd import Etcd, read
from tests.support.programs import HANGS_S, eventually, free_port

FAST = ("--heartbeat-interval=50", "--election-timeout=500", "--pre-vote")
"""What docs/how-to/two-managers.md recommends: a new leader within half a second, and none because a member comes back."""


@dataclass(frozen=True)
class Certificates:
    """PEM files of a member, or of a manager."""

    ca: Path
    certificate: Path
    key: Path


@dataclass
class Members:
    """The members of one cluster."""

    folder: Path
    tls: Certificates | None
    names: tuple[str, ...]
    hosts: Mapping[str, str] = field(default_factory=dict)
    """Where each member is; 127.0.0.1 if it is not named."""
    command: Callable[[str, Sequence[str]], Sequence[str]] = lambda _, words: words
    """The command that runs these words where a member is."""
    client: dict[str, int] = field(default_factory=dict)
    peer: dict[str, int] = field(default_factory=dict)
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @property
    def urls(self) -> list[str]:
        scheme = "http" if self.tls is None else "https"
        return [f"{scheme}://{self._host(name)}:{self.client[name]}" for name in self.names]

    def start(self, name: str) -> None:
        """Start a member, or start it again with its data."""
        url = self.urls[self.names.index(name)]
        peers = {one: f"http://{self._host(one)}:{port}" for one, port in self.peer.items()}
        words = [
            *("etcd", "--name", name, "--data-dir", str(self.folder / name), *FAST),
            *("--listen-client-urls", url, "--advertise-client-urls", url),
            *("--listen-peer-urls", peers[name], "--initial-advertise-peer-urls", peers[name]),
            *("--initial-cluster", ",".join(f"{one}={address}" for one, address in peers.items())),
            *("--auto-compaction-mode", "periodic", "--auto-compaction-retention", "5m", "--log-level", "error"),
        ]
        if self.tls is not None:
            words += ["--cert-file", str(self.tls.certificate), "--key-file", str(self.tls.key)]
            words += ["--trusted-ca-file", str(self.tls.ca), "--client-cert-auth"]
        with (self.folder / f"{name}.log").open("ab") as log:
            # the tests unset what a shell may have set for etcdctl
            env = {key: value for key, value in os.environ.items() if not key.startswith("ETCD")}
            command = self.command(name, words)
            self.processes[name] = subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=env)

    def tell(self, name: str, number: signal.Signals) -> None:
        self.processes[name].send_signal(number)

    def kill(self, name: str) -> None:
        process = self.processes.pop(name)
        process.kill()
        process.wait()

    def _host(self, name: str) -> str:
        return self.hosts.get(name, "127.0.0.1")

    def leader(self) -> str:
        """The member that leads, as `etcdctl` shows it; members that are electing one are waited for."""
        words = ["etcdctl", "--endpoints", ",".join(self.urls), "endpoint", "status", "-w", "simple"]

        def look() -> str | None:
            done = subprocess.run(
                words,
                env=os.environ | {"ETCDCTL_API": "3"},
                capture_output=True,
                text=True,
                check=False,
                timeout=HANGS_S,
            )
            leads = [line for line in done.stdout.splitlines() if line.split(", ")[4] == "true"]
            return leads[0].split(", ")[0] if len(leads) == 1 else None

        return self.names[self.urls.index(eventually(look))]


@contextmanager
def etcd_members(
    folder: Path,
    *names: str,
    tls: Certificates | None = None,
    hosts: Mapping[str, str] | None = None,
    command: Callable[[str, Sequence[str]], Sequence[str]] = lambda _, words: words,
) -> Iterator[Members]:
    """Run these members; they have a leader once this is entered. `hosts` and `command` are as in `Members`."""
    members = Members(folder, tls, names or ("one",), hosts or {}, command)
    members.client = {name: free_port() for name in members.names}
    members.peer = {name: free_port() for name in members.names}
    try:
        for name in members.names:
            members.start(name)
        if tls is None:
            answers(members)
        yield members
    finally:
        for name in list(members.processes):
            members.kill(name)


def answers(members: Members) -> None:
    """Wait until there is a leader."""
    etcd = Etcd(members.urls, timeout_s=5.0)

    def look() -> bool:
        try:
            etcd.transact([], [read("anything")])
        except EtcdError:
            return False
        return True

    eventually(look)
    etcd.close()
