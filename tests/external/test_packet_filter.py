"""The packet filter in a real kernel: who reaches a controller, and what becomes of bytes that were written after their term.

Everything happens in a network namespace of its own, on its loopback interface.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from tests.support.programs import HANGS_S, LIFT_MANAGER, ROOT

pytestmark = pytest.mark.external("nft", "ip", "unshare")

SITE = """\
schema: 1
name: Filtered
controllers:
  four: {{host: 127.0.0.1, port: 502, map: generic-registers}}
  six: {{host: "::1", port: 502, map: generic-registers}}
lifts:
  x: {{controller: four, floors: {{L1: 1, L2: 2}}}}
  y: {{controller: six, floors: {{L1: 1, L2: 2}}}}
cluster:
  machines: {{north: {{address: "http://10.0.0.1:5003"}}, south: {{address: "http://10.0.0.2:5003"}}}}
  etcd: ["http://127.0.0.1:2379"]
  packet_filter: {socket}
"""


@pytest.fixture(scope="module", autouse=True)
def _namespace() -> None:
    """Leave the tests out where a container keeps its programs from namespaces or from nftables."""
    probe = ["unshare", "--map-root-user", "--net", "nft", "list", "tables"]
    tried = subprocess.run(probe, capture_output=True, text=True, timeout=HANGS_S, check=False)
    if tried.returncode:
        pytest.skip(f"no namespace with nftables on this computer: {tried.stderr.strip()}")


def inside(script: str, *arguments: object) -> str:
    """Run a Python script as root of a namespace with a loopback interface, and whatever it starts; return what it prints."""
    ready = 'ip link set lo up; exec "$0" -c "$@"'
    command = [
        "unshare",
        "--map-root-user",
        "--net",
        "--pid",
        "--kill-child",
        "--fork",
        "sh",
        "-euc",
        ready,
        sys.executable,
        script,
    ]
    done = subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


COMMON = dedent("""\
    import json, os, re, socket, struct, subprocess, sys, threading
    received = {}
    def read(connection, port):
        try:
            while data := connection.recv(100):
                received[port] = received.get(port, "") + data.decode()
                connection.sendall(b"ok")
            received[port] += ", end"
        except ConnectionResetError:
            received[port] += ", reset"
    def serve(listening):
        while True:
            connection, peer = listening.accept()
            threading.Thread(target=read, args=(connection, peer[1]), daemon=True).start()
    for host in ("127.0.0.1", "::1"):
        listening = socket.create_server((host, 502), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
        threading.Thread(target=serve, args=(listening,), daemon=True).start()
    def connected(host):
        made = socket.create_connection((host, 502), 10)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        made.sendall(b"first")
        assert made.recv(9) == b"ok"
        return made, made.getsockname()[1]
    def reached(host):
        try:
            socket.create_connection((host, 502), 10).close()
        except ConnectionRefusedError:
            return False
        return True
    def dropped():
        shown = subprocess.run(["nft", "list", "table", "inet", "lift_manager_term"], capture_output=True, text=True, check=True).stdout
        return sum(map(int, re.findall(r"counter packets (\\d+) bytes \\d+ drop", shown)))
    def wait(look):
        while not look():
            pass
""")

BYTES = COMMON + dedent("""\
    from lift_manager.cluster.filter_helper import load_rules
    from lift_manager.cluster.filter_kernel import Kernel
    from lift_manager.cluster.filter_rules import connection_sets
    CONTROLLERS = [("127.0.0.1", 502), ("::1", 502)]
    MS = 3_600_000
    load_rules(CONTROLLERS)
    kernel, sets, found = Kernel(), connection_sets(CONTROLLERS), {}
    for host in ("127.0.0.1", "::1"):
        seen = found[host] = {}
        seen["nobody"] = reached(host)
        kernel.permit(os.getuid() + 1, MS, sets)
        seen["another user"] = reached(host)
        kernel.permit(os.getuid(), MS, sets)
        seen["the manager"] = reached(host)
        # bytes of a term that are written after it, and repeated by the kernel into the next one
        late, port = connected(host)
        kernel.withdraw()
        seen["after its term"] = reached(host)
        late.sendall(b"late")
        kernel.permit(os.getuid(), MS, sets)
        before = dropped()
        wait(lambda: dropped() >= before + 2)
        seen["of the next term"] = reached(host)
        late.close()
        wait(lambda: "reset" in received[port])
        seen["late"] = received[port]
        # the same with a permission that returns within a term: these bytes are of its own
        own, port = connected(host)
        kernel.withdraw()
        own.sendall(b"own")
        kernel.permit(os.getuid(), MS)
        assert own.recv(9) == b"ok"
        seen["own"] = received[port]
        # a permission that runs out
        kernel.permit(os.getuid(), 50)
        wait(lambda: not reached(host))
        own.close()
        wait(lambda: "reset" in received[port])
        seen["closed after its term"] = received[port]
    print(json.dumps(found))
""")


def test_bytes_that_were_written_after_their_term_never_arrive_and_a_reset_does() -> None:
    expected = {
        "nobody": False,
        "another user": False,
        "the manager": True,
        "after its term": False,
        "of the next term": True,
        "late": "first, reset",
        "own": "firstown",
        "closed after its term": "firstown, reset",
    }
    assert json.loads(inside(BYTES)) == {"127.0.0.1": expected, "::1": expected}


HELPER = COMMON + dedent("""\
    from drivers.clock import boottime
    from lift_manager.cluster.filter_messages import PermissionRequest, encode, controller_names
    path, *command = sys.argv[1:]
    found = {"before": reached("127.0.0.1")}
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    wait(lambda: "nobody reaches 2 controllers" in running.stderr.readline())
    found["it runs"] = reached("127.0.0.1")
    manager = socket.socket(socket.AF_UNIX)
    manager.connect(path)
    names = controller_names([("127.0.0.1", 502), ("::1", 502)])
    manager.sendall(encode(PermissionRequest(7, boottime() + 3600.0, names)))
    found["answer"] = manager.recv(1000).decode()
    found["term"] = reached("127.0.0.1")
    # as a firewall that is loaded does
    subprocess.run(["nft", "flush", "ruleset"], check=True)
    manager.sendall(encode(PermissionRequest(7, boottime() + 0.05, names)))
    manager.recv(1000)
    wait(lambda: not reached("127.0.0.1"))
    manager.sendall(encode(PermissionRequest(7, boottime() + 3600.0, names)))
    manager.recv(1000)
    found["loaded again"] = reached("127.0.0.1")
    manager.close()
    wait(lambda: not reached("127.0.0.1"))
    found["removal while it runs"] = subprocess.run([*command, "--remove"], capture_output=True).returncode
    running.terminate()
    found["ended"] = running.wait()
    found["after its end"] = reached("127.0.0.1")
    found["removal"] = subprocess.run([*command, "--remove"]).returncode
    found["after its removal"] = reached("127.0.0.1")
    print(json.dumps([found, os.path.exists(path)]))
""")


def test_the_program_permits_a_manager_with_a_term_and_keeps_everybody_off_after_its_end(tmp_path: Path) -> None:
    path, site = tmp_path / "socket", tmp_path / "site.yaml"
    site.write_text(SITE.format(socket=path), "utf-8")
    said = inside(HELPER, path, *LIFT_MANAGER, "cluster", "packet-filter", site, "--user", "0").splitlines()
    assert json.loads(said[-1]) == [
        {
            "before": True,
            "it runs": False,
            "answer": '{"refused": ""}\n',
            "term": True,
            "loaded again": True,
            "removal while it runs": 1,
            "ended": 0,
            "after its end": False,
            "removal": 0,
            "after its removal": True,
        },
        False,
    ]
    assert said[0] == "the packet filter is removed; whoever can reach the network of the controllers reaches them"
