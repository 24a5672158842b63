"""What the takeover campaign is made of: cables to the controller, observers of the key, clients that watch, and managers."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time
from base64 import b64decode, b64encode
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx

from lift_manager.cluster.content import Place, decode_key
from lift_manager.cluster.etcd import Entry
from register_maps.arbitration import ArbitrationCodec
from register_maps.frames import parse_request
from tests.campaigns.takeover_judge import Answer, Keys, Passage
from tests.campaigns.takeover_network import MACHINES, Network
from tests.support.programs import LIFT_MANAGER, Program, free_port, started

LIFT = "lift"
DOOR_OPEN = 2
"""As in rmf_lift_msgs."""
STATES_EVERY_S = 0.05
ANSWERS_WITHIN_S = 0.5
"""How long a client waits for an answer; what comes later it does not use."""
WATCH_SILENCE_S = 2.0
"""Chosen: an active machine writes the key every 0.3 s, so whoever is silent for longer has no connection, or no leader."""
WRITES = frozenset({5, 6, 15, 16, 22, 23})
"""Function codes of Modbus that write."""
CLOCK = Path(__file__).with_name("takeover_clock.c")


def build_clock(folder: Path) -> Path:
    """Compile what gives one process another time of day; it is preloaded."""
    built = folder / "clock.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", str(built), str(CLOCK), "-ldl"], check=True)
    return built


class Cables:
    """Between each machine and the controller."""

    def __init__(self, controller: int, host: str, arbitration: ArbitrationCodec | None = None) -> None:
        """`controller` is its port on the loopback, and `host` the address at which machines reach the cables.

        `arbitration` is where a write carries the epoch of its manager.
        """
        self._arbitration = arbitration
        self._controller = controller
        self._host = host
        self.ports: dict[str, int] = {}
        self.passages: list[Passage] = []

    @contextmanager
    def running(self) -> Iterator[None]:
        """Pass everything on, in a thread of its own."""
        ready, loop = threading.Event(), asyncio.new_event_loop()
        ended = asyncio.Event()

        async def serve() -> None:
            async with self._served():
                ready.set()
                await ended.wait()

        thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
        thread.start()
        ready.wait()
        try:
            yield
        finally:
            loop.call_soon_threadsafe(ended.set)
            thread.join()
            loop.close()

    @asynccontextmanager
    async def _served(self) -> AsyncIterator[None]:
        connections: set[asyncio.Task[None]] = set()
        servers = []
        for machine in MACHINES:

            async def connected(
                reader: asyncio.StreamReader, writer: asyncio.StreamWriter, machine: str = machine
            ) -> None:
                task = asyncio.current_task()
                assert task is not None
                connections.add(task)
                task.add_done_callback(connections.discard)
                await self._pass_on(machine, reader, writer)

            server = await asyncio.start_server(connected, self._host, 0)
            self.ports[machine] = server.sockets[0].getsockname()[1]
            servers.append(server)
        yield
        for server in servers:
            server.close()
        for task in tuple(connections):
            task.cancel()
        await asyncio.gather(*connections, return_exceptions=True)

    async def _pass_on(self, machine: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.passages.append(Passage(time.monotonic(), machine, is_write=False))
        behind_reader, behind = await asyncio.open_connection("127.0.0.1", self._controller)
        back = asyncio.create_task(_copy(behind_reader, writer))
        try:
            with suppress(ConnectionError, asyncio.IncompleteReadError):
                while True:
                    head = await reader.readexactly(6)
                    body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
                    if body[1] in WRITES:
                        self.passages.append(
                            Passage(time.monotonic(), machine, is_write=True, claimed=self._claimed(head + body))
                        )
                    behind.write(head + body)
        finally:
            back.cancel()
            for each in (behind, writer):
                each.transport.abort()

    def _claimed(self, frame: bytes) -> int | None:
        """Return the epoch that a write carries."""
        if self._arbitration is None:
            return None
        request = parse_request(frame)
        return self._arbitration.decode({request.table: [0] * request.address + list(request.values)}).epoch


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(ConnectionError):
        while data := await reader.read(4096):
            writer.write(data)


class Observers:
    """Watch the key at each member of etcd, so that one of them sees it whatever is cut, lost or stopped."""

    def __init__(self, urls: Sequence[str], site: str) -> None:
        self.keys = Keys()
        self._lock = threading.Lock()
        self._urls = urls
        self._place = Place(site)
        self._ended = threading.Event()

    @contextmanager
    def running(self) -> Iterator[None]:
        threads = [threading.Thread(target=self._run, args=(url,), daemon=True) for url in self._urls]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            self._ended.set()
            for thread in threads:
                thread.join()

    def _run(self, url: str) -> None:
        with httpx.Client(base_url=url, timeout=WATCH_SILENCE_S, trust_env=False) as client:
            revision = 1
            while not self._ended.is_set():
                # what it missed is delivered first
                revision = max(revision, self.keys.newest.revision + 1)
                with suppress(httpx.HTTPError, ValueError):
                    revision = self._watch(client, revision)
                self._ended.wait(0.1)

    def _watch(self, client: httpx.Client, revision: int) -> int:
        """Read one stream to its end; returns where the next one begins."""
        key = b64encode(self._place.active.encode()).decode()
        request = {"create_request": {"key": key, "start_revision": str(revision)}}
        with client.stream("POST", "/v3/watch", json=request) as reply:
            for line in reply.iter_lines():
                at, result = time.monotonic(), json.loads(line).get("result", {})
                if result.get("canceled"):
                    # what came before was compacted
                    return int(result.get("compact_revision", revision))
                for event in result.get("events", ()):
                    self._add(at, event["kv"])
                if self._ended.is_set():
                    break
        return revision

    def _add(self, at: float, found: dict[str, Any]) -> None:
        key = decode_key([Entry(self._place.active, b64decode(found["value"]), int(found["mod_revision"]))])
        with self._lock:
            self.keys.add(at, key)


class Machine:
    """One manager, which can be started again, and a client that asks it for the state of the lift all the time."""

    def __init__(self, name: str, folder: Path, network: Network, *, clock: Path | None, forked: bool) -> None:
        """`clock` is what `build_clock` has built, if its time of day may jump."""
        self.name = name
        self.folder = folder / name
        self.site = self.folder / "site.yaml"
        self.host, self.port = network.addresses[name], free_port()
        self.url = f"http://{self.host}:{self.port}"
        self._network = network
        self._forked = forked
        self._lives = 0
        self._preloaded = clock
        self._clock = self.folder / "clock"
        self.program: Program | None = None
        (self.folder / "tmp").mkdir(parents=True)
        self.http = httpx.Client(base_url=self.url, timeout=ANSWERS_WITHIN_S, trust_env=False)
        self.answers: list[Answer] = []
        """Every state that it has given."""
        self.errors: list[str] = []
        self._ended = threading.Event()
        self.set_clock(0)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Watch it; it ends with the context."""
        thread = threading.Thread(target=self._watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join()
            self.end()
            self.http.close()

    @contextmanager
    def filtered(self) -> Iterator[None]:
        """Let the kernel of the machine keep everybody off the controller who has no term."""
        words = (*LIFT_MANAGER, "cluster", "packet-filter", str(self.site), "--user", str(os.getuid()))
        with started(*self._network.command(self.name, words)) as program:
            program.logs("nobody reaches 1 controller")
            yield

    def start(self) -> None:
        self._lives += 1
        life = self.folder / f"life-{self._lives}"
        life.mkdir()
        words: tuple[str, ...] = ("serve", str(self.site), "--port", str(self.port), "--machine", self.name)
        # two managers on one computer: the lock that keeps them from one controller is not what is tried here
        more = {"TMPDIR": str(self.folder / "tmp")}
        if not self._forked:
            words = self._network.command(self.name, (*LIFT_MANAGER, *words))
        if self._preloaded is not None:
            more |= {"LD_PRELOAD": str(self._preloaded), "CLOCK_AHEAD": str(self._clock)}
        self.program = Program(words, life, None, forked=self._forked, more=more)

    def set_clock(self, ahead_s: int) -> None:
        """Let its time of day be so much ahead of the right one, from now on."""
        with self._clock.open("r+b" if self._clock.exists() else "w+b") as file:
            file.write(ahead_s.to_bytes(8, sys.byteorder, signed=True))

    def tell(self, number: signal.Signals) -> None:
        assert self.program is not None
        self.program.tell(number)

    def end(self) -> None:
        if self.program is None:
            return
        self.program.tell(signal.SIGCONT)
        self.program.end()
        if "Traceback" in self.program.err:
            self.errors.append(self.program.err[-3000:])

    @property
    def log(self) -> str:
        """What its present life has logged."""
        return "" if self.program is None else self.program.err

    @property
    def life(self) -> str:
        """Its present life, for a client that has to announce itself to each."""
        return f"{self.name} {self._lives}"

    def first_state(self, since: float) -> Answer | None:
        """Return the first state that it has given of those that were asked for since then."""
        found = None
        for answer in reversed(self.answers):
            if answer.asked_at < since:
                break
            found = answer
        return found

    def stands_by(self) -> bool:
        """Whether it could take over now."""
        with suppress(httpx.HTTPError, ValueError):
            reply = self.http.get("/readyz")
            return reply.status_code == httpx.codes.OK and reply.json().get("role") == "standby"
        return False

    def _watch(self) -> None:
        with httpx.Client(base_url=self.url, timeout=ANSWERS_WITHIN_S, trust_env=False) as http:
            while not self._ended.wait(STATES_EVERY_S):
                asked_at = time.monotonic()
                with suppress(httpx.HTTPError, ValueError):
                    reply = http.get("/open-rmf/demo-lift/lift_state", params={"lift_name": LIFT}).json()
                    if reply["success"]:
                        is_open = reply["data"]["door_state"] == DOOR_OPEN
                        self.answers.append(Answer(asked_at, time.monotonic(), self.name, is_open))


@contextmanager
def slow_disk(processes: Sequence[int], delay_s: float) -> Iterator[None]:
    """Let each flush of these processes take so much longer, by strace."""
    with ExitStack() as stack:
        for process in processes:
            delays = f"inject=fsync,fdatasync:delay_enter={int(delay_s * 1e6)}"
            words = ["strace", "-f", "-qq", "-p", str(process), "-e", "trace=fsync,fdatasync", "-e", delays]
            tracer = subprocess.Popen([*words, "-o", "/dev/null"], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            stack.callback(tracer.wait)
            stack.callback(tracer.terminate)
        yield
