"""Two real managers, three real members of etcd, and a simulated lift: one of them is killed, stopped or cut off at random moments
while the lift is commanded. Judged at the controller, by connection.

    python -m tests.campaigns.takeover --faults 100 --seed 1

Each machine reaches the controller over a cable of its own, which writes down when which bytes passed. An observer reads the key in
etcd fifty times a second. Clocks are those of one computer, so all times can be compared.
"""

import argparse
import asyncio
import json
import signal
import statistics
import sys
import threading
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import httpx

from lift_manager.cluster.content import Place, decode_key
from lift_manager.cluster.errors import EtcdError
from lift_manager.cluster.etcd import Etcd, read
from lift_manager.cluster.term import TERM_S, Key
from lift_manager.lab.bench.bench import Bench
from lift_manager.lab.bench.plan import LiftPlan, plan_lifts
from lift_manager.lab.bench.simulator import LiftSimulator
from lift_manager.lab.bench.site import site_file
from tests.support.etcd import Members, etcd_members
from tests.support.programs import HANGS_S, LIFT_MANAGER, Program, call, eventually, free_port

LIFT = "lift"
MAP = "generic-registers"
MACHINES = ("north", "south")
LOOKS_EVERY_S = 0.02
LAG_S = 0.5
"""How much later the observer may see a key than its owner acts on it, on a busy computer."""
QUIET_S = 0.6
"""How long nothing is requested after a takeover, so that what the takeover itself does shows."""
WRITES = frozenset({5, 6, 15, 16, 22, 23})
"""Function codes of Modbus that write."""
STOPS_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0)


@dataclass(frozen=True)
class Passage:
    """Something that went over a cable to the controller."""

    at: float
    """By `time.monotonic`."""
    machine: str
    is_write: bool
    """False for a connection that was made."""


class Cables:
    """Between each machine and the controller."""

    def __init__(self, controller: int) -> None:
        self._controller = controller
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

            server = await asyncio.start_server(connected, "127.0.0.1", 0)
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
                        self.passages.append(Passage(time.monotonic(), machine, is_write=True))
                    behind.write(head + body)
        finally:
            back.cancel()
            for each in (behind, writer):
                each.transport.abort()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(ConnectionError):
        while data := await reader.read(4096):
            writer.write(data)


class Observer:
    """What the key in etcd was, and when."""

    def __init__(self, urls: list[str], site: str) -> None:
        self.seen: list[tuple[float, Key]] = []
        self._etcd = Etcd(urls, timeout_s=0.5)
        self._place = Place(site)
        self._ended = threading.Event()

    @contextmanager
    def running(self) -> Iterator[None]:
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join()
            self._etcd.close()

    def _run(self) -> None:
        while not self._ended.wait(LOOKS_EVERY_S):
            with suppress(EtcdError):
                key = decode_key(self._etcd.transact([], [read(self._place.active)]).ranges[0])
                if not self.seen or self.seen[-1][1].revision != key.revision:
                    self.seen.append((time.monotonic(), key))

    def wrong(self, passage: Passage) -> str:
        """Why a machine must not have done this at that moment; empty if it may."""
        times = [at for at, _ in self.seen]
        index = bisect_right(times, passage.at)
        later = [key for at, key in self.seen[index:] if at <= passage.at + LAG_S]
        if any(key.owner == passage.machine for key in later):
            return ""
        if index == 0:
            return "before anybody was active"
        since, key = self.seen[index - 1]
        if key.owner != passage.machine:
            return f"{passage.at - since:.2f} s after the key said epoch {key.epoch} of {key.owner or 'nobody'}"
        if passage.at > since + TERM_S:
            return f"{passage.at - since - TERM_S:.2f} s after its term in epoch {key.epoch}"
        return ""


@dataclass
class Tally:
    """What a campaign saw."""

    faults: Counter[str] = field(default_factory=Counter)
    takeovers_s: dict[str, list[float]] = field(default_factory=dict)
    """From the fault to the first state of the other machine, by fault."""
    epochs: int = 0
    writes: int = 0
    presses: int = 0
    kept: int = 0
    """Takeovers after which a session continued."""
    findings: list[str] = field(default_factory=list)


class Machine:
    """One manager, which can be started again."""

    def __init__(self, name: str, folder: Path, *, forked: bool) -> None:
        self.name = name
        self.folder = folder / name
        self.site = self.folder / "site.yaml"
        self.port = free_port()
        self._forked = forked
        self._lives = 0
        self.program: Program | None = None
        (self.folder / "tmp").mkdir(parents=True)
        self.http = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=0.5, trust_env=False)
        self.errors: list[str] = []

    def start(self) -> None:
        self._lives += 1
        life = self.folder / f"life-{self._lives}"
        life.mkdir()
        words = ("serve", str(self.site), "--port", str(self.port), "--machine", self.name)
        # two managers on one computer: the lock that keeps them from one controller is not what is tried here
        more = {"TMPDIR": str(self.folder / "tmp")}
        command = words if self._forked else (*LIFT_MANAGER, *words)
        self.program = Program(command, life, None, forked=self._forked, more=more)

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

    def state(self) -> dict[str, object] | None:
        """The state of the lift; None from a standby, or if nothing answers."""
        try:
            reply = self.http.get("/open-rmf/demo-lift/lift_state", params={"lift_name": LIFT}).json()
        except (httpx.HTTPError, ValueError):
            return None
        return dict(reply["data"]) if reply["success"] else None

    @property
    def log(self) -> str:
        """What its present life has logged."""
        return "" if self.program is None else self.program.err

    def stands_by(self) -> bool:
        """Whether it could take over now."""
        with suppress(httpx.HTTPError):
            reply = self.http.get("/readyz")
            return reply.status_code == httpx.codes.OK and reply.json().get("role") == "standby"
        return False


class Pair:
    """Both machines, what they share, and somebody who requests the lift."""

    def __init__(
        self,
        plan: LiftPlan,
        lift: LiftSimulator,
        members: Members,
        folder: Path,
        dice: Random,
        tally: Tally,
        *,
        forked: bool,
    ) -> None:
        self.lift, self.members, self.dice, self.tally = lift, members, dice, tally
        self.cables = Cables(lift.ports[""])
        self.machines = {name: Machine(name, folder, forked=forked) for name in MACHINES}
        self.observer = Observer(members.urls, "bench")
        self._plan = plan
        self._floor = ""
        self._is_held_since: int | None = None
        """How many writes there were when the present hold was requested; None if nothing certain is known about a session."""

    @contextmanager
    def running(self) -> Iterator[None]:
        with ExitStack() as stack:
            stack.enter_context(self.cables.running())
            for machine in self.machines.values():
                machine.site.write_text(json.dumps(self._site(machine)), "utf-8")
                stack.enter_context(closing(machine.http))
            prepared = call("cluster", "init", self.machines["north"].site)
            assert prepared.returncode == 0, prepared.stderr
            stack.enter_context(self.observer.running())
            for machine in self.machines.values():
                stack.callback(machine.end)
                machine.start()
            eventually(lambda: self.active)
            yield

    def _site(self, machine: Machine) -> dict[str, object]:
        made = site_file([self._plan], {LIFT: {"": self.cables.ports[machine.name]}}, machine.folder)
        addresses = {name: {"address": f"http://127.0.0.1:{one.port}"} for name, one in self.machines.items()}
        cluster = {"machines": addresses, "etcd": self.members.urls}
        return made | {"state": "state", "cluster": cluster}

    @property
    def active(self) -> Machine | None:
        return next((machine for machine in self.machines.values() if machine.state() is not None), None)

    def other(self, machine: Machine) -> Machine:
        return next(one for one in self.machines.values() if one is not machine)

    # -- requests

    def command(self, for_s: float) -> None:
        """Request floors for a while, of whoever is active."""
        ends_at = time.monotonic() + for_s
        while time.monotonic() < ends_at:
            if (active := self.active) is not None:
                self._request(active)
            threading.Event().wait(self.dice.choice((0.0, 0.05, 0.2, 0.6)))

    def _request(self, machine: Machine) -> None:
        floor = self.dice.choice(self.lift.floors)
        before, self._is_held_since = self._is_held_since, None
        seen = len(self.lift.writes)
        try:
            params, body = {"lift_name": LIFT}, {"floor": floor, "door_state": 2}
            reply = machine.http.post("/open-rmf/demo-lift/lift_request", params=params, json=body).json()
        except (httpx.HTTPError, ValueError):
            return
        if reply["success"]:
            self._is_held_since = before if before is not None and floor == self._floor else seen
            self._floor = floor
        else:
            self._is_held_since = before

    @property
    def _has_session(self) -> bool:
        """Whether something was pressed for the last request, and so after it was committed."""
        since = self._is_held_since
        return since is not None and any(write.on for write in self.lift.writes[since:])

    # -- faults

    def meet(self, name: str) -> None:
        """Let something happen, wait until the lift is commanded again, and judge what the takeover itself did."""
        active = eventually(self._with_standby)
        epoch, had_session = self.observer.seen[-1][1].epoch, self._has_session
        passages = len(self.cables.passages)
        self.tally.faults[name] += 1
        began = time.monotonic()
        undo = getattr(self, f"_{name}")(active)
        try:
            found = eventually(lambda: self._commanded(active, name))
        except AssertionError as error:
            logs = "\n".join(f"--- {one.name}\n{one.log[-3000:]}" for one in self.machines.values())
            raise AssertionError(f"after {name} of {active.name} nobody commands the lift\n{logs}") from error
        took_s = time.monotonic() - began
        undo()
        if self.observer.seen[-1][1].epoch == epoch:
            return
        if found is not active:
            self.tally.takeovers_s.setdefault(name, []).append(took_s)
        self._judge_takeover(found, passages, had_session=had_session)

    def _with_standby(self) -> Machine | None:
        """Return the active machine, once the other one could take over."""
        active = self.active
        return active if active is not None and self.other(active).stands_by() else None

    def _commanded(self, before: Machine, name: str) -> Machine | None:
        """Return who commands the lift; after what ends a term for certain, the other machine."""
        found = self.active
        return None if found is before and name in ("kill", "end") else found

    def _kill(self, active: Machine) -> Callable[[], None]:
        active.end()
        return active.start

    def _end(self, active: Machine) -> Callable[[], None]:
        active.tell(signal.SIGTERM)
        assert active.program is not None
        active.program.ended()
        active.end()
        return active.start

    def _stop_active(self, active: Machine) -> Callable[[], None]:
        return self._stopped(active)

    def _stop_standby(self, active: Machine) -> Callable[[], None]:
        return self._stopped(self.other(active))

    def _stopped(self, machine: Machine) -> Callable[[], None]:
        machine.tell(signal.SIGSTOP)
        timer = threading.Timer(self.dice.choice(STOPS_S), machine.tell, (signal.SIGCONT,))
        timer.start()
        return timer.join

    def _handover(self, active: Machine) -> Callable[[], None]:
        done = call("handover", active.site, "--by", "Eve")
        if done.returncode:
            self._finding(f"the handover from {active.name} failed: {done.stderr}")
        return lambda: None

    def _kill_member(self, active: Machine) -> Callable[[], None]:
        name = self.dice.choice(self.members.names)
        self.members.kill(name)
        threading.Event().wait(self.dice.uniform(0.5, 3.0))
        return lambda: self.members.start(name)

    def _stop_leader(self, active: Machine) -> Callable[[], None]:
        name = self.members.leader()
        self.members.tell(name, signal.SIGSTOP)
        threading.Event().wait(self.dice.uniform(0.5, 4.0))
        return lambda: self.members.tell(name, signal.SIGCONT)

    # -- judge

    def _judge_takeover(self, machine: Machine, passages: int, *, had_session: bool) -> None:
        """Nothing was requested since: nothing may be pressed, and the session goes on."""
        connected = [one.at for one in self.cables.passages[passages:] if one.machine == machine.name]
        threading.Event().wait(QUIET_S)
        for write in self.lift.writes:
            if connected and write.on and write.at_s > connected[0]:
                self._finding(f"the takeover by {machine.name} pressed {write.command} {write.floor or ''}")
        if not had_session:
            return
        reply = machine.http.get(f"/api/v1/lifts/{LIFT}", timeout=HANGS_S)
        if reply.status_code == httpx.codes.OK and reply.json()["session"] is None:
            self._finding(f"{machine.name} took over without the session to {self._floor}")
        self.tally.kept += 1

    def judge_passages(self) -> None:
        """Each connection and each write was made by the machine whose key it was, within its term."""
        for passage in self.cables.passages:
            if why := self.observer.wrong(passage):
                what = "wrote" if passage.is_write else "connected"
                self._finding(f"{passage.machine} {what} {why}")
        self.tally.writes += sum(passage.is_write for passage in self.cables.passages)
        self.tally.epochs += self.observer.seen[-1][1].epoch
        self.tally.presses += sum(write.on for write in self.lift.writes)

    def judge_journals(self) -> None:
        """Both journals verify, and hold the same rows, once both machines have ended in good order."""
        exports = []
        for machine in (self.other(eventually(lambda: self.active)), self.active):
            assert machine is not None
            assert machine.program is not None
            threading.Event().wait(1.0)  # what the other machine writes until then is copied
            machine.tell(signal.SIGTERM)
            machine.program.ended()
            machine.end()
            verified = call("audit", machine.site, "--verify")
            if verified.returncode:
                self._finding(f"the journal of {machine.name} does not verify: {verified.stdout}{verified.stderr}")
            rows = machine.folder / "rows.jsonl"
            call("audit", machine.site, "--last", "1000000", "--jsonl", rows)
            exports.append(rows.read_text("utf-8").splitlines())
            self._findings_of(machine)
        shorter, longer = sorted(exports, key=len)
        for number, (one, other) in enumerate(zip(shorter, longer, strict=False), 1):
            if one != other:
                self._finding(f"the two journals differ from row {number} on: {one} and {other}")
                break

    def _findings_of(self, machine: Machine) -> None:
        for error in machine.errors:
            self._finding(f"{machine.name} crashed: {error}")

    def _finding(self, text: str) -> None:
        self.tally.findings.append(text)


FAULTS = ("kill", "stop_active", "stop_active", "handover", "stop_standby", "end", "kill_member", "stop_leader")


def campaign(faults: int, seed: int, *, kinds: tuple[str, ...] = FAULTS, forked: bool = False) -> Tally:
    """Let so many faults happen to one pair."""
    tally, dice = Tally(), Random(seed)
    wish = {"name": LIFT, "map": MAP, "speed": 20.0, "clear_s": 10.0}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        (folder / "etcd").mkdir()
        bench = stack.enter_context(Bench((wish,), near=Path.cwd(), folder=folder))
        (plan,) = plan_lifts((wish,), Path.cwd())
        members = stack.enter_context(etcd_members(folder / "etcd", "a", "b", "w"))
        pair = Pair(plan, bench.simulator(), members, folder, dice, tally, forked=forked)
        with pair.running():
            for number in range(faults):
                pair.command(dice.uniform(0.3, 3.0))
                # each kind as often as any other
                pair.meet(kinds[number % len(kinds)])
            pair.command(1.0)
            pair.judge_journals()
        pair.judge_passages()
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    began = time.monotonic()
    tally = campaign(given.faults, given.seed)
    faults = ", ".join(f"{count} {name}" for name, count in sorted(tally.faults.items()))
    sys.stdout.write(
        f"{tally.faults.total()} faults ({faults}) in {time.monotonic() - began:.0f} s; {tally.epochs} epochs, {tally.writes}"
        f" writes and {tally.presses} presses at the controller; {tally.kept} sessions continued; {len(tally.findings)} findings\n"
    )
    for name, took in sorted(tally.takeovers_s.items()):
        sys.stdout.write(
            f"{name}: {len(took)} takeovers, median {statistics.median(took):.2f} s, longest {max(took):.2f} s\n"
        )
    for text in tally.findings:
        sys.stdout.write(f"FOUND {text}\n")
    return 1 if tally.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
