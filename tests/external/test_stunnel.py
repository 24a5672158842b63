"""Modbus/TCP Security between parts that nobody here wrote: stunnel speaks TLS, pyModbusTCP or the simulator speaks Modbus."""

import asyncio
import re
import signal
import ssl
import subprocess
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvloop
from pyModbusTCP.server import DataBank, ModbusServer

from drivers.errors import ConnectFailed
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.tls import LinkTls
from drivers.modbus.wire import PymodbusWire
from register_maps import frames
from register_maps.words import Table
from tests.support.certificates import Authority, Shown
from tests.support.programs import Program, Started, eventually, free_port, run, started

pytestmark = pytest.mark.external("stunnel4", "openssl")

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 120.0
ROLE = "1.3.6.1.4.1.50316.802.1"


@dataclass(frozen=True)
class Stunnel:
    """Stunnel in front of a port, with mutual TLS."""

    port: int
    program: Program


def secured(
    start: Started, folder: Path, modbus: int, shown: Shown, believed: Path, *more: str, port: int = 0
) -> Stunnel:
    """Start stunnel; `more` are lines of its configuration."""
    port = port or free_port()
    config = folder / f"stunnel-{port}.conf"
    lines = [
        *("foreground = yes", "pid =", "[modbus]", f"accept = 127.0.0.1:{port}", f"connect = 127.0.0.1:{modbus}"),
        *(f"cert = {shown.certificate}", f"key = {shown.key}", f"CAfile = {believed}", "verifyChain = yes"),
        *("sslVersionMin = TLSv1.2", "TIMEOUTclose = 0", *more),
    ]
    config.write_text("\n".join(lines) + "\n", "utf-8")
    program = start.enter_context(started("stunnel4", str(config)))
    program.logs("Configuration successful")
    return Stunnel(port, program)


@pytest.fixture
def start() -> Iterator[Started]:
    with Started() as programs:
        yield programs


@pytest.fixture
def bank(start: Started) -> tuple[DataBank, int]:
    bank, port = DataBank(), free_port()
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=bank)
    server.start()
    start.callback(server.stop)
    return bank, port


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path)


@pytest.fixture
def plc(authority: Authority) -> Shown:
    return authority.issue("plc", "127.0.0.1")


@pytest.fixture
def tls(authority: Authority) -> LinkTls:
    ours = authority.issue("manager", "lift-manager")
    return LinkTls(ca=authority.file, certificate=ours.certificate, key=ours.key, handshake_s=LIMIT_S, files_s=LIMIT_S)


def on(loop: Callable[[], asyncio.AbstractEventLoop], main: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(LIMIT_S):
            await main

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(limited())


async def seen(true: Callable[[], bool]) -> None:
    while not true():  # noqa: ASYNC110 - a link tells nobody of its reason
        await asyncio.sleep(0.01)


@pytest.mark.parametrize(
    ("loop", "newest"),
    [(asyncio.new_event_loop, "TLSv1.2"), (uvloop.new_event_loop, "TLSv1.3")],
    ids=["asyncio, TLS 1.2", "uvloop, TLS 1.3"],
)
def test_registers_are_read_and_written_and_a_lost_tunnel_heals_by_itself(
    loop: Callable[[], asyncio.AbstractEventLoop],
    newest: str,
    start: Started,
    tmp_path: Path,
    bank: tuple[DataBank, int],
    plc: Shown,
    tls: LinkTls,
) -> None:
    memory, modbus = bank
    tunnel = secured(start, tmp_path, modbus, plc, tls.ca, f"sslVersionMax = {newest}")

    async def main() -> None:
        link = Link(
            lambda: PymodbusWire("127.0.0.1", tunnel.port, tls=tls),
            LinkSettings(tls=True, timeout_s=LIMIT_S),
            name="plc",
        )
        async with asyncio.TaskGroup() as group:
            group.create_task(link.run())
            await link.wait_up()
            memory.set_holding_registers(0, [7, 8])
            assert await link.read(frames.read(Table.HOLDING, 0, 2)) == b"\0\7\0\x08"
            await link.write(frames.write_registers(16, [1, 2, 3]))
            assert memory.get_holding_registers(16, 3) == [1, 2, 3]
            # the longest read, of more than one record's worth of answers in a row
            for _ in range(200):
                assert len(await link.read(frames.read(Table.HOLDING, 0, 125))) == 250
            await asyncio.to_thread(tunnel.program.tell, signal.SIGKILL)
            await asyncio.to_thread(tunnel.program.ended)
            await seen(lambda: link.reason != "")
            await asyncio.to_thread(secured, start, tmp_path, modbus, plc, tls.ca, port=tunnel.port)
            while True:
                with suppress(Exception):
                    await link.read(frames.read(Table.HOLDING, 0, 1))
                    break
                await asyncio.sleep(0.05)
            await link.close()

    on(loop, main())


@pytest.mark.parametrize("newest", ["TLSv1.2", "TLSv1.3"])
def test_stunnel_refuses_a_certificate_of_another_ca_and_the_link_says_so(
    newest: str, start: Started, tmp_path: Path, bank: tuple[DataBank, int], plc: Shown, tls: LinkTls
) -> None:
    stranger = Authority(tmp_path / "stranger", "stranger").issue("stranger", "stranger")
    tunnel = secured(start, tmp_path, bank[1], plc, tls.ca, f"sslVersionMax = {newest}")
    foreign = replace(tls, certificate=stranger.certificate, key=stranger.key)

    async def main() -> None:
        link = Link(
            lambda: PymodbusWire("127.0.0.1", tunnel.port, tls=foreign),
            LinkSettings(tls=True, timeout_s=LIMIT_S),
            name="plc",
        )
        async with asyncio.TaskGroup() as group:
            group.create_task(link.run())
            await seen(lambda: "certificate" in link.reason)
            assert f"refuses our certificate {stranger.certificate}: it does not know the CA of it" in link.reason
            await link.close()

    on(asyncio.new_event_loop, main())


def test_a_controller_with_nothing_but_rsa_key_exchange_is_not_spoken_to(
    start: Started, tmp_path: Path, bank: tuple[DataBank, int], plc: Shown, tls: LinkTls
) -> None:
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "9", "-subj", "/CN=plc"]
    shown = Shown(tmp_path / "rsa.pem", tmp_path / "rsa.key")
    subprocess.run(
        [*command, "-addext", "subjectAltName=IP:127.0.0.1", "-out", shown.certificate, "-keyout", shown.key],
        check=True,
        capture_output=True,
    )
    more = ["sslVersionMax = TLSv1.2", "ciphers = AES128-SHA256"]
    tunnel = secured(start, tmp_path, bank[1], shown, tls.ca, *more)

    async def main() -> None:
        wire = PymodbusWire("127.0.0.1", tunnel.port, tls=replace(tls, ca=shown.certificate))
        with pytest.raises(ConnectFailed, match="no cipher in common"):
            await wire.open(lambda _: None, lambda _: None, timeout_s=LIMIT_S)

    on(asyncio.new_event_loop, main())


def test_a_link_without_tls_into_a_port_with_it_ends_at_once(
    start: Started, tmp_path: Path, bank: tuple[DataBank, int], plc: Shown, authority: Authority
) -> None:
    tunnel = secured(start, tmp_path, bank[1], plc, authority.file)

    async def main() -> None:
        lost: asyncio.Queue[str] = asyncio.Queue()
        wire = PymodbusWire("127.0.0.1", tunnel.port)
        await wire.open(lambda _: None, lost.put_nowait, timeout_s=LIMIT_S)
        wire.send(frames.frame(frames.read(Table.HOLDING, 0, 1), 7))
        # OpenSSL hangs up without a word on what is no TLS; the start warns of port 802 without `tls`
        assert re.search("closed the connection|the connection broke", await lost.get())

    on(asyncio.new_event_loop, main())


# -- certificates as the how-to makes them


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    """The files that the commands of docs/how-to/keys-and-tls.md make, for a controller at 127.0.0.1."""
    text = (ROOT / "docs" / "how-to" / "keys-and-tls.md").read_text("utf-8")
    (commands,) = re.findall(r"```sh\n(openssl .*?)```", text, re.DOTALL)
    assert commands.count("192.0.2.20") == 1
    commands = commands.replace("192.0.2.20", "127.0.0.1")
    subprocess.run(["sh", "-e", "-u", "-c", commands], cwd=tmp_path, check=True, capture_output=True)
    return tmp_path


def site(folder: Path, port: int, api: str = "") -> Path:
    file = folder / "site.yaml"
    file.write_text(
        f"""\
schema: 1
name: Secured
state: kept
api: {{host: 127.0.0.1{api}}}
controllers:
  plc:
    host: 127.0.0.1
    port: {port}
    map: generic-registers
    tls: {{ca: ca.pem, certificate: manager.pem, key: manager.key}}
lifts:
  main: {{controller: plc, access: control, floors: {{L1: 1, L2: 2, L3: 3}}}}
""",
        "utf-8",
    )
    return file


def test_the_role_in_a_certificate_reaches_the_controller_and_is_shown_by_check(recipe: Path) -> None:
    done = run("check", site(recipe, 802))
    assert (done.returncode, done.stderr) == (0, "")
    assert "plc: Modbus/TCP Security, as 'LiftManager', certificate until 20" in done.stdout
    # openssl's own server, which prints what it was shown
    port = free_port()
    options = f"-accept 127.0.0.1:{port} -cert plc.pem -key plc.key -CAfile ca.pem -Verify 2 -naccept 1".split()
    command = ["openssl", "s_server", *options]
    with subprocess.Popen(command, cwd=recipe, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        tls = LinkTls(ca=recipe / "ca.pem", certificate=recipe / "manager.pem", key=recipe / "manager.key")

        async def main() -> None:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            while not wire.is_open:
                with suppress(ConnectFailed):
                    await wire.open(lambda _: None, lambda _: None, timeout_s=LIMIT_S)
            wire.send(b"\0\1\0\0\0\6\1\3\0\0\0\1")
            await asyncio.sleep(0)
            wire.close()

        on(asyncio.new_event_loop, main())
        said, _ = server.communicate(timeout=LIMIT_S)
    shown = re.search(r"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----", said, re.DOTALL)
    assert shown is not None, said
    text = subprocess.run(
        ["openssl", "x509", "-noout", "-text"], input=shown[0], capture_output=True, text=True, check=True
    )
    assert re.search(rf"{re.escape(ROLE)}: *\n *\.\.LiftManager", text.stdout)


# -- everything together


def test_serve_drives_a_lift_over_mutual_tls_and_is_spoken_to_over_mutual_tls(start: Started, recipe: Path) -> None:
    controller = start("simulate", "generic-registers", "--port", "0", "--floors", "L1=1,L2=2,L3=3", "--speed", "20")
    modbus = int(controller.says(r"127\.0\.0\.1:(\d+), unit")[1])
    tunnel = secured(start, recipe, modbus, Shown(recipe / "plc.pem", recipe / "plc.key"), recipe / "ca.pem")
    authority = Authority(recipe, "offices")
    authority.issue("api", "127.0.0.1")
    robot = authority.issue("robot", "robot")
    api = ", tls: {certificate: api.pem, key: api.key, client_ca: offices.pem}"
    manager = start("serve", site(recipe, tunnel.port, api), "--port", "0")
    url = manager.says(r"(https://127\.0\.0\.1:\d+)/docs")[1]

    context = ssl.create_default_context(cafile=str(authority.file))
    context.load_cert_chain(robot.certificate, robot.key)
    client = start.enter_context(httpx.Client(base_url=url, verify=context, trust_env=False, timeout=LIMIT_S))
    base = "/open-rmf/demo-lift"

    def state() -> dict[str, Any]:
        answer = client.get(f"{base}/lift_state", params={"lift_name": "main"}).json()
        found: dict[str, Any] = answer["data"]
        return found

    eventually(lambda: state().get("current_floor") == "L1")
    order = {"floor": "L3", "door_state": 2}
    answer = client.post(f"{base}/lift_request", params={"lift_name": "main"}, json=order).json()
    assert answer["success"], answer
    eventually(lambda: (state()["current_floor"], state()["door_state"]) == ("L3", 2))

    person = ["--by", "M. Weber", "--reason", "new ropes", "--manager", url]
    mutual: list[str | Path] = [
        "--ca",
        authority.file,
        "--certificate",
        robot.certificate,
        "--certificate-key",
        robot.key,
    ]
    nobody = run("lockout", "main", *person, "--ca", authority.file)
    assert nobody.returncode == 1
    assert "--certificate FILE" in nobody.stderr
    stranger = run("lockout", "main", *person)
    assert "name a CA of your own with --ca FILE" in stranger.stderr
    said = run("lockout", "main", *person, *mutual)
    assert (said.returncode, said.stderr) == (0, "")
    assert "locked out by M. Weber" in said.stdout

    # the controller is never spoken to but through the tunnel
    tunnel.program.tell(signal.SIGKILL)
    eventually(lambda: not client.get(f"{base}/lift_state", params={"lift_name": "main"}).json()["success"])
    secured(start, recipe, modbus, Shown(recipe / "plc.pem", recipe / "plc.key"), recipe / "ca.pem", port=tunnel.port)
    eventually(lambda: client.get(f"{base}/lift_state", params={"lift_name": "main"}).json()["success"])
    assert manager.stop()[0] == 0
    assert "Traceback" not in manager.err
    assert "PRIVATE KEY" not in manager.err + manager.out
