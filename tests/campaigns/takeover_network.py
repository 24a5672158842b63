"""Where the machines of the takeover campaign are: all on the loopback, or each in a network namespace of its own.

    machine north   machine south   witness   field
          |               |            |        |
          +---------------+--- switch -+--------+

`field` is where the campaign itself runs: the controller under one address, and the clients and observers under another. The switch is
a bridge in a namespace of its own; what is cut is dropped there, by sender and receiver, so that one direction can be cut alone. Nothing
outside the namespaces is changed.
"""

import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

MACHINES = ("north", "south")
WITNESS = "witness"
FIELD = "field"
CONTROLLER = "controller"
_SWITCH = "switch"
_ADDRESSES = {
    "north": "10.77.0.1",
    "south": "10.77.0.2",
    WITNESS: "10.77.0.3",
    FIELD: "10.77.0.4",
    CONTROLLER: "10.77.0.5",
}
"""The first address of the field is that of clients and observers: Linux sends from the first one of a network."""
_NEIGHBOUR = "net.ipv4.neigh.eth0.retrans_time_ms=100"
"""As docs/explanation/cluster.md demands: with Linux's second, bytes of a machine that was unplugged arrive after its term."""
_RULES = """
table bridge cuts {
 set cut { type ipv4_addr . ipv4_addr; }
 chain forward {
  type filter hook forward priority 0; policy accept;
  ip saddr . ip daddr @cut drop
 }
}
"""

Direction = tuple[str, str]
"""Sender and receiver."""


class CannotMakeNetworks(Exception):
    """The message says what is missing."""


class Network(Protocol):
    """Where the machines are."""

    addresses: Mapping[str, str]

    def command(self, machine: str, words: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs a program on a machine."""
        ...


class Loopback:
    """Everything on 127.0.0.1: nothing can be cut."""

    addresses: Mapping[str, str] = dict.fromkeys(_ADDRESSES, "127.0.0.1")

    def command(self, machine: str, words: Sequence[str]) -> tuple[str, ...]:
        """Return the words as they are."""
        return tuple(words)


class Namespaces:
    """The namespaces whose names begin with a prefix."""

    addresses: Mapping[str, str] = _ADDRESSES

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def command(self, machine: str, words: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs a program on a machine; it keeps its process id."""
        return ("ip", "netns", "exec", self._name(machine), *words)

    def cut(self, directions: Iterable[Direction]) -> None:
        """Lose every packet that goes in one of these directions, until `heal`."""
        pairs = ", ".join(f"{_ADDRESSES[sender]} . {_ADDRESSES[receiver]}" for sender, receiver in directions)
        self._on_switch("nft", "add", "element", "bridge", "cuts", "cut", f"{{ {pairs} }}")

    def heal(self) -> None:
        """Lose nothing any more."""
        self._on_switch("nft", "flush", "set", "bridge", "cuts", "cut")

    def unplug(self, machine: str) -> None:
        """Pull the cable of a machine out of the switch: what it sends goes nowhere, and nobody is told."""
        self._on_switch("ip", "link", "set", machine, "down")

    def plug(self, machine: str) -> None:
        """Put it in again."""
        self._on_switch("ip", "link", "set", machine, "up")

    def _on_switch(self, *words: str) -> None:
        _run(*self.command(_SWITCH, words))

    def make(self) -> None:
        """Make the namespaces, and connect them."""
        for name in (_SWITCH, *MACHINES, WITNESS, FIELD):
            _run("ip", "netns", "add", self._name(name))
            _run("ip", "-n", self._name(name), "link", "set", "lo", "up")
        switch = self._name(_SWITCH)
        _run("ip", "-n", switch, "link", "add", "lan", "type", "bridge")
        _run("ip", "-n", switch, "link", "set", "lan", "up")
        for name in (*MACHINES, WITNESS, FIELD):
            own = self._name(name)
            _run("ip", "-n", switch, "link", "add", name, "type", "veth", "peer", "name", "eth0", "netns", own)
            _run("ip", "-n", switch, "link", "set", name, "master", "lan", "up")
            for place in (name, *((CONTROLLER,) if name == FIELD else ())):
                _run("ip", "-n", own, "address", "add", f"{_ADDRESSES[place]}/24", "dev", "eth0")
            _run(*self.command(name, ("sysctl", "-qw", _NEIGHBOUR)))
            _run("ip", "-n", own, "link", "set", "eth0", "up")
        _run(*self.command(_SWITCH, ("nft", "-f", "-")), given=_RULES)

    def remove(self) -> None:
        """End what still runs in the namespaces, and remove them."""
        for name in (*MACHINES, WITNESS, FIELD, _SWITCH):
            own = self._name(name)
            shown = subprocess.run(["ip", "netns", "pids", own], capture_output=True, text=True, check=False)
            for process in shown.stdout.split():
                with suppress(ProcessLookupError):
                    os.kill(int(process), signal.SIGKILL)
            subprocess.run(["ip", "netns", "delete", own], capture_output=True, check=False)

    def _name(self, machine: str) -> str:
        return f"{self.prefix}-{machine}"


_OWN_NAME = re.compile(rf"(takeover-(\d+)-\d+)-(?:{'|'.join((_SWITCH, *MACHINES, WITNESS, FIELD))})")
"""The prefix holds the id of the command's process, and the seed."""


def leftovers(names: Iterable[str], is_running: Callable[[int], bool]) -> set[str]:
    """Return the prefixes of the namespaces, among all of a computer, whose command does not run any more."""
    ours = filter(None, map(_OWN_NAME.fullmatch, names))
    return {found[1] for found in ours if not is_running(int(found[2]))}


def _remove_leftovers() -> None:
    """Remove what commands left that were killed, with the programs that still run in it."""
    shown = _run("ip", "netns", "list")
    names = (line.split()[0] for line in shown.splitlines())  # an id may follow the name
    for prefix in leftovers(names, lambda process: Path(f"/proc/{process}").exists()):
        Namespaces(prefix).remove()


@contextmanager
def namespaces(seed: int) -> Iterator[Namespaces]:
    """Make namespaces, and remove them whatever happens, `kill -9` of the command included: the next one does. Raises CannotMakeNetworks."""
    if os.geteuid() != 0:
        raise CannotMakeNetworks(
            "network namespaces need root: run it with sudo, or with --loopback, where nothing is cut"
        )
    _remove_leftovers()
    made = Namespaces(f"takeover-{os.getpid()}-{seed}")
    try:
        made.make()
        yield made
    finally:
        made.remove()


def _run(*words: str, given: str = "") -> str:
    try:
        done = subprocess.run(words, input=given, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise CannotMakeNetworks(f"there is no {words[0]}: apt-get install iproute2 nftables") from error
    if done.returncode:
        raise CannotMakeNetworks(f"{' '.join(words)}: {done.stderr.strip()}")
    return done.stdout
