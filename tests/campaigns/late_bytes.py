"""What of a sender's bytes reaches a controller after its term, with the packet filter and without it.

    sudo python -m tests.campaigns.late_bytes --times 50

A sender with a short term is in a network namespace of its own, and never resets its connection, so that the kernel alone decides. Three
things happen to it, each at a random moment near the end of the term:

stopped      by SIGSTOP between its look at the clock and its write; it continues after the term
unplugged    it writes in its term with its cable pulled, which is put back after the term; the kernel has forgotten its neighbours by then
neighbour    the same, and it has forgotten them before the write

A raw socket at the controller writes down every frame with bytes of a connection. All clocks are that of one computer. The result is a line
for each case; the command fails if a frame of the first case came after the term through the filter, or one of the others later than `NEIGHBOUR_S`.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import sleep

from drivers.clock import boottime
from tests.campaigns.takeover_network import CONTROLLER, FIELD, CannotMakeNetworks, Namespaces, namespaces
from tests.support.programs import LIFT_MANAGER, ROOT, eventually

SENDER = "north"
PORT = 502
TERM_S = 1.5
"""Shorter than a real one, to be done sooner; the filter gives what is requested."""
WATCHED_S = 2.5
"""How long frames are waited for: Linux repeats bytes after 0.2, 0.4 and 0.8 s, and notices within a second that a cable is back."""
NEIGHBOUR_S = 0.31
"""How long after the term a packet may leave that had passed the filter: three attempts to find a neighbour, and a few ticks."""
CASES = ("stopped", "unplugged", "neighbour")
SITE = """\
schema: 1
name: Late bytes
controllers: {{plc: {{host: {host}, port: {port}, map: generic-registers}}}}
lifts: {{main: {{controller: plc, floors: {{L1: 1, L2: 2}}}}}}
cluster:
  machines: {{north: {{address: "http://10.77.0.1:5003"}}, south: {{address: "http://10.77.0.2:5003"}}}}
  etcd: ["http://127.0.0.1:2379"]
  packet_filter: {socket}
"""
RECEIVER = """
import json, socket, struct, sys, threading, time
from drivers.clock import boottime
SO_TIMESTAMPNS = 35
def serve():
    with socket.create_server(("0.0.0.0", int(sys.argv[1]))) as listening:
        while True:
            threading.Thread(target=read, args=(listening.accept()[0],), daemon=True).start()
def read(connection):
    try:
        while connection.recv(100):
            pass
    except OSError:
        pass
threading.Thread(target=serve, daemon=True).start()
with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800)) as frames:
    frames.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    print("ready", flush=True)
    while True:
        frame, ((_, _, stamp),), *_ = frames.recvmsg(2000, 100)
        # when the kernel received it, which may be long before this process has its turn
        seconds, nanoseconds = struct.unpack("qq", stamp)
        at, header = boottime() - time.time() + seconds + nanoseconds / 1e9, 4 * (frame[0] & 15)
        if frame[9] == 6 and int.from_bytes(frame[header + 2 : header + 4]) == int(sys.argv[1]):
            data = frame[header + 4 * (frame[header + 12] >> 4) : int.from_bytes(frame[2:4])]
            if data:
                print(json.dumps([at, data.decode()]), flush=True)
"""
WRITER = """
import os, signal, socket, sys
from drivers.clock import boottime
from lift_manager.cluster.filter_messages import PermissionRequest, controller_names, encode
host, port, path, term_s, pause_s = sys.argv[1], int(sys.argv[2]), *sys.argv[3:4], *map(float, sys.argv[4:])
until = boottime() + term_s
if path:
    manager = socket.socket(socket.AF_UNIX)
    manager.connect(path)
    request = PermissionRequest(int(boottime() * 1000), until, controller_names([(host, port)]))
    manager.sendall(encode(request))
    assert b'"refused": ""' in manager.recv(1000)
connection = socket.create_connection((host, port), 1)
connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
connection.sendall(b"first")
print(until, flush=True)
sys.stdin.readline()
if until - boottime() > 0:
    if pause_s:
        os.kill(os.getpid(), signal.SIGSTOP)
    connection.sendall(b"late")
    print("written", flush=True)
sys.stdin.readline()
"""


@dataclass
class Tally:
    """What came of one case."""

    case: str
    filtered: bool
    times: int = 0
    """Without those in which a busy computer let the term end before the write."""
    late: int = 0
    """Times in which a frame with late bytes came after the term."""
    after_s: list[float] = field(default_factory=list)
    """How long after its term the last frame of each such time came."""

    @property
    def is_wrong(self) -> bool:
        """Whether the filter let something through that it should have dropped."""
        allowed_s = 0.0 if self.case == "stopped" else NEIGHBOUR_S
        return self.filtered and any(after_s > allowed_s for after_s in self.after_s)

    def __str__(self) -> str:
        last = f", the last one {max(self.after_s):.2f} s after it" if self.after_s else ""
        filtered = "with the filter" if self.filtered else "without it"
        return f"{self.case}, {filtered}: {self.times} times, in {self.late} bytes came after the term{last}"


class Lane:
    """One case in namespaces of its own."""

    def __init__(self, network: Namespaces, folder: Path, frames: list[tuple[float, str]], dice: Random) -> None:
        self.network, self.frames, self.dice = network, frames, dice
        self.socket = folder / "socket"
        self.host = network.addresses[CONTROLLER]

    def repeat(self, tally: Tally) -> None:
        """Let it happen once, unless the computer is too busy for it."""
        stopped = tally.case == "stopped"
        path = str(self.socket) if tally.filtered else ""
        script = (sys.executable, "-c", WRITER, self.host, str(PORT), path, str(TERM_S), str(float(stopped)))
        with subprocess.Popen(
            self.network.command(SENDER, script), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
        ) as writer:
            assert writer.stdin is not None
            assert writer.stdout is not None
            if not (line := writer.stdout.readline()):
                return  # the term was over before there was a connection
            until = float(line)
            try:
                # the write comes up to a tenth of a second before the end of the term
                sleep(max(until - boottime() - self.dice.uniform(0.03, 0.1), 0.0))
                if not stopped:
                    self.network.unplug(SENDER)
                if tally.case == "neighbour":
                    subprocess.run(self.network.command(SENDER, ("ip", "neigh", "flush", "all")), check=True)
                writer.stdin.write("\n")
                writer.stdin.flush()
                sleep(max(until - boottime(), 0.0) + self.dice.uniform(0.02, 0.3))
                if stopped:
                    writer.send_signal(signal.SIGCONT)
                else:
                    self.network.plug(SENDER)
                sleep(WATCHED_S)
            finally:
                writer.kill()
            is_written = "written" in writer.stdout.read()
        after = [at - until for at, data in self.frames if at > until and "late" in data]
        self.frames.clear()
        tally.times += is_written
        tally.late += bool(after)
        tally.after_s += after[-1:]


@contextmanager
def lane(case: str, *, filtered: bool, seed: int) -> Iterator[Lane]:
    """Make the namespaces, with a receiver, and a filter unless there is to be none."""
    with ExitStack() as ends:
        folder = Path(ends.enter_context(TemporaryDirectory()))
        network = ends.enter_context(namespaces(seed))
        command = network.command(FIELD, (sys.executable, "-c", RECEIVER, str(PORT)))
        receiver = ends.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT))
        ends.callback(receiver.kill)
        frames: list[tuple[float, str]] = []
        assert receiver.stdout is not None
        receiver.stdout.readline()
        threading.Thread(target=_collect, args=(receiver.stdout, frames.append), daemon=True).start()
        made = Lane(network, folder, frames, Random(f"{case} {seed}"))
        if filtered:
            site = folder / "site.yaml"
            site.write_text(SITE.format(host=made.host, port=PORT, socket=made.socket), "utf-8")
            words = (*LIFT_MANAGER, "cluster", "packet-filter", str(site), "--user", str(os.getuid()))
            log = ends.enter_context((folder / "log").open("w"))
            helper = ends.enter_context(subprocess.Popen(network.command(SENDER, words), stderr=log))
            ends.callback(helper.kill)
            eventually(lambda: "nobody reaches" in (folder / "log").read_text())
        yield made


def _collect(lines: Iterator[str], add: Callable[[tuple[float, str]], None]) -> None:
    for line in lines:
        at, data = json.loads(line)
        add((at, data))


def play(case: str, times: int, *, filtered: bool, seed: int) -> Tally:
    """Repeat one case."""
    tally = Tally(case, filtered)
    with lane(case, filtered=filtered, seed=seed) as made:
        while tally.times < times:
            made.repeat(tally)
    return tally


def main() -> int:
    """Play every case, with and without the filter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--lanes", type=int, default=6, help="how many cases run at once")
    arguments = parser.parse_args()
    plans = [(case, filtered) for case in CASES for filtered in (False, True)]
    with ThreadPoolExecutor(arguments.lanes) as pool:
        running = [
            pool.submit(play, case, arguments.times, filtered=filtered, seed=seed)
            for seed, (case, filtered) in enumerate(plans)
        ]
        try:
            tallies = [each.result() for each in running]
        except CannotMakeNetworks as error:
            sys.stderr.write(f"{error}\n")
            return 2
    for tally in tallies:
        sys.stdout.write(f"{tally}{'  WRONG' if tally.is_wrong else ''}\n")
    return int(any(tally.is_wrong for tally in tallies))


if __name__ == "__main__":
    raise SystemExit(main())
