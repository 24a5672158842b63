"""nft, which nobody here wrote, takes the rules that the site file makes, and the kernel does what they say.

Everything happens in a network namespace of its own.
"""

import json
import subprocess
from pathlib import Path
from textwrap import dedent

import pytest

from tests.support.network import printed

pytestmark = pytest.mark.external("nft", "unshare", "ip")

MANAGER, OTHER = "12345", "12346"
"""Whom the manager runs as, and somebody else on its computer; numbers, for nobody of these names need exist."""

SITE = """\
schema: 1
name: Two worlds
api: {{host: {api}, port: 5003}}
controllers:
  old: {{host: 192.0.2.20, map: generic-registers}}
  six: {{host: "2001:db8::21", port: 1502, map: generic-coils}}
  near: {{host: 127.0.0.1, port: 5020, map: generic-registers}}
lifts:
  x: {{controller: old, floors: {{L1: 1, L2: 2}}}}
  y: {{controller: six, floors: {{L1: 0, L2: 1}}}}
  z: {{controller: near, floors: {{L1: 1, L2: 2}}}}
"""


def made(folder: Path, *options: str, api: str = "127.0.0.1") -> Path:
    site, rules = folder / "site.yaml", folder / "site.nft"
    site.write_text(SITE.format(api=api), "utf-8")
    rules.write_text(printed(site, *options), "utf-8")
    return rules


def inside(script: str, *arguments: object) -> str:
    """Run a shell script as root of a namespace with a loopback interface and one dead end, 192.0.2.0/24."""
    ready = "ip link set lo up; ip link add end type veth peer name far; ip link set far up; ip link set end up"
    ready += "; ip addr add 192.0.2.5/24 dev end"
    command = ["unshare", "--net", "sh", "-euc", f"{ready}\n{script}", "sh", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


CLIENTS = ("--clients", "10.0.0.0/24", "--clients", "10.0.0.128/25", "--clients", "fd00::/8")


@pytest.mark.parametrize("api", ["127.0.0.1", "192.0.2.5"])
@pytest.mark.parametrize(
    "options",
    [
        ("--nftables", "--user", MANAGER),
        ("--nftables", "--user", "root", *CLIENTS),
        ("--nftables-gateway", "--manager", "192.0.2.5"),
        ("--nftables-gateway", "--manager", "192.0.2.5", "--manager", "2001:db8::5", *CLIENTS),
    ],
    ids=["host", "host with clients", "gateway", "gateway with clients"],
)
def test_nft_takes_the_rules_and_takes_them_again(options: tuple[str, ...], api: str, tmp_path: Path) -> None:
    rules = made(tmp_path, *options, api=api)
    inside('nft -c -f "$1"; nft -f "$1"; nft -f "$1"', rules)


def test_only_the_managers_user_reaches_a_controller_and_it_reaches_nothing_else(tmp_path: Path) -> None:
    rules = made(tmp_path, "--nftables", "--user", MANAGER)
    connect = dedent("""\
        import json, os, socket, sys
        with socket.create_server(("127.0.0.1", 5020)), socket.create_server(("127.0.0.1", 5003)):
            found = {}
            for user, host, port in json.loads(sys.argv[1]):
                child = os.fork()
                if not child:
                    os.setuid(int(user))
                    with socket.socket() as link:
                        link.settimeout(0.3)
                        os._exit(bool(link.connect_ex((host, port))))
                found[f"{user} {host}:{port}"] = os.waitpid(child, 0)[1] == 0
        print(json.dumps(found))
    """)
    tried = [
        (MANAGER, "127.0.0.1", 5020),
        (OTHER, "127.0.0.1", 5020),
        (OTHER, "127.0.0.1", 5003),
        (MANAGER, "192.0.2.20", 502),
        (OTHER, "192.0.2.20", 502),
        (MANAGER, "192.0.2.77", 502),
        (OTHER, "192.0.2.77", 80),
    ]
    script = 'nft -f "$1"; python3 -c "$2" "$3"; nft -j list ruleset'
    reached, ruleset = inside(script, rules, connect, json.dumps(tried)).splitlines()[:2]
    assert json.loads(reached) == {
        f"{MANAGER} 127.0.0.1:5020": True,
        f"{OTHER} 127.0.0.1:5020": False,
        f"{OTHER} 127.0.0.1:5003": True,
        # a dead end: what became of these the counters say
        f"{MANAGER} 192.0.2.20:502": False,
        f"{OTHER} 192.0.2.20:502": False,
        f"{MANAGER} 192.0.2.77:502": False,
        f"{OTHER} 192.0.2.77:80": False,
    }
    rejected_near_and_old, rejected_six, dropped, api = counters(ruleset)
    assert (rejected_near_and_old, rejected_six, api) == (2, 0, 0)
    assert dropped >= 1


GATEWAY = """\
mount -t tmpfs none /run; mkdir /run/netns /run/held
echo 1 >/proc/sys/net/ipv4/ip_forward
number=1
for name in controllers managers clients others; do
    ip netns add $name
    ip link add to-$name type veth peer name eth netns $name
    ip addr add 10.$number.0.1/24 dev to-$name; ip link set to-$name up
    ip -n $name addr add 10.$number.0.2/24 dev eth; ip -n $name addr add 10.$number.0.3/24 dev eth
    ip -n $name link set eth up; ip -n $name route add default via 10.$number.0.1
    ip netns exec $name python3 -c "$3" & servers="${servers:-} $!"
    number=$((number + 1))
done
trap 'kill $servers' EXIT
until [ "$(for name in controllers managers clients others; do ip netns exec $name ss -Hlt; done | wc -l)" -eq 12 ]; do :; done
# as on a gateway that keeps track of connections already
nft 'table inet other { chain forward { type filter hook forward priority 0; ct state established counter; }; }'
holders=""
while read -r name target port; do
    ip netns exec $name python3 -c "$5" $target $port "$name $target:$port" & holders="$holders $!"
done <<END
$6
END
until [ "$(ls /run/held | wc -l)" -eq "$(echo "$6" | wc -l)" ]; do :; done
nft -f "$1"
touch /run/loaded
wait $holders
echo "$4" | while read -r name target port; do
    ip netns exec $name python3 -c "$2" $target $port && echo "$name $target:$port yes" || echo "$name $target:$port no"
done
"""


def test_the_gateway_lets_the_manager_to_the_controllers_and_clients_to_the_manager_and_nobody_else(
    tmp_path: Path,
) -> None:
    site = tmp_path / "site.yaml"
    site.write_text(
        "schema: 1\nname: Behind a gateway\napi: {host: 10.2.0.2, port: 5003}\ncontrollers:\n  plc: {host: 10.1.0.2, map: "
        "generic-registers}\nlifts:\n  lift: {controller: plc, floors: {L1: 1, L2: 2}}\n",
        "utf-8",
    )
    rules = tmp_path / "site.nft"
    rules.write_text(printed(site, "--nftables-gateway", "--manager", "10.2.0.2", "--clients", "10.3.0.0/24"), "utf-8")
    connect = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), 0.3)"
    serve = dedent("""\
        import select, signal, socket, threading
        signal.alarm(40)  # ends it whatever becomes of the shell
        def echo(connection):
            while data := connection.recv(100):
                connection.sendall(data)
        held = [socket.create_server(("0.0.0.0", port)) for port in (502, 5003, 22)]
        while True:
            for listening in select.select(held, [], [])[0]:
                threading.Thread(target=echo, args=(listening.accept()[0],), daemon=True).start()
    """)
    hold = dedent("""\
        import os, signal, socket, sys, time
        signal.alarm(40)
        with socket.create_connection((sys.argv[1], int(sys.argv[2])), 0.5) as held:
            held.sendall(b"before")
            assert held.recv(100) == b"before"
            open(f"/run/held/{os.getpid()}", "w").close()
            while not os.path.exists("/run/loaded"):
                time.sleep(0.01)
            try:
                held.sendall(b"after")
                answer = held.recv(100)
            except TimeoutError:
                answer = b""
        # in one piece: others write at the same time
        sys.stdout.write(f"held {sys.argv[3]} {'yes' if answer == b'after' else 'no'}\\n")
    """)
    wanted = {
        "managers 10.1.0.2:502": "yes",
        "managers 10.1.0.2:22": "no",
        "managers 10.1.0.3:502": "no",  # no controller of this site
        "clients 10.1.0.2:502": "no",
        "others 10.1.0.2:502": "no",
        "others 10.1.0.2:22": "no",
        "controllers 10.4.0.2:22": "no",
        "clients 10.2.0.2:5003": "yes",
        "clients 10.2.0.2:22": "no",
        "others 10.2.0.2:5003": "no",
        "managers 10.4.0.2:22": "no",
        "others 10.3.0.2:22": "yes",
    }
    # connected before the rules are loaded, and asked again afterwards
    held = {
        "managers 10.1.0.2:502": "yes",
        "others 10.1.0.2:502": "no",
        "clients 10.2.0.2:5003": "yes",
        "others 10.2.0.2:5003": "no",
        "controllers 10.4.0.2:22": "no",
        "others 10.3.0.2:22": "yes",
    }
    tried, kept = ("\n".join(each.replace(":", " ") for each in table) for table in (wanted, held))
    command = [
        "unshare",
        "--net",
        "--mount",
        "sh",
        "-euc",
        GATEWAY,
        "sh",
        str(rules),
        connect,
        serve,
        tried,
        hold,
        kept,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=40, check=False)
    assert done.returncode == 0, done.stderr
    assert dict(line.rsplit(" ", 1) for line in done.stdout.splitlines()) == {
        **wanted,
        **{f"held {each}": answer for each, answer in held.items()},
    }


def counters(ruleset: str) -> list[int]:
    """The packets that each counting rule has seen, in their order."""
    rules = [item["rule"] for item in json.loads(ruleset)["nftables"] if "rule" in item]
    return [part["counter"]["packets"] for rule in rules for part in rule["expr"] if "counter" in part]
