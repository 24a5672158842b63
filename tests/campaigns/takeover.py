"""Two real managers, three real members of etcd, and a simulated lift: what can happen to one of them happens, at random moments, while the
lift is commanded. Judged at the controller, by connection and epoch.

    sudo python -m tests.campaigns.takeover --faults 1000 --lanes 3 --seed 1
    sudo python -m tests.campaigns.takeover --faults 100 --lanes 3 --seed 1 --packet-filter
    python -m tests.campaigns.takeover --faults 100 --seed 1 --loopback

Each machine and the witness are in a network namespace of their own, so that networks can be cut; with --loopback all are on the loopback,
and nothing is cut. Faults are divided among pairs of managers; --lanes is how many pairs run at once. In one pair of four the controller
has a single slot for a connection, and keeps that of a silent peer for 10 s; in every second one the lift is used by a robot with rides.
Each machine reaches the controller over a cable of its own, which writes down when which bytes passed. Observers watch the key at each
member of etcd. Clocks are those of one computer, so all times can be compared. Everything that was made is removed at
the end, and the namespaces of a command that was killed by the next one.
"""

import argparse
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import httpx

from lift_manager.lab.bench.bench import Bench
from lift_manager.lab.bench.plan import LiftPlan, plan_lifts
from lift_manager.lab.bench.simulator import LiftSimulator
from lift_manager.lab.bench.site import site_file
from register_maps.codec import compile_map
from register_maps.load import load
from tests.campaigns.takeover_clients import Client, Requests, Robot
from tests.campaigns.takeover_judge import (
    Alone,
    Finding,
    Row,
    first_difference,
    judge_answers,
    judge_order,
    judge_passages,
    percentile,
)
from tests.campaigns.takeover_network import (
    CONTROLLER,
    FIELD,
    MACHINES,
    WITNESS,
    CannotMakeNetworks,
    Loopback,
    Namespaces,
    Network,
    namespaces,
)
from tests.campaigns.takeover_rig import LIFT, Cables, Machine, Observers, build_clock, slow_disk
from tests.support.etcd import Members, etcd_members
from tests.support.programs import HANGS_S, call, eventually

MAPS = ("generic-registers", "generic-registers-cluster")
"""Whose controller obeys whoever writes, and whose obeys the manager of the highest epoch."""
IDLE_S = 10.0
"""How long a controller with one slot keeps that of a peer that says nothing."""
QUIET_S = 0.6
"""How long nothing is requested after a takeover, so that what the takeover itself does shows."""
BUSY = 0.4
"""The share of faults during which the lift is requested all the time; in the others nothing is, and so nothing may be pressed."""
STOPS_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0, 15.0, 30.0)
CUTS_S = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
DELAYS_S = (0.05, 0.2, 0.5, 1.0)
JUMPS_S = (-100, -5, 5, 100, 3600, 86400)
"""How far a clock on the wall jumps. Not further back: a lease is continued by the time of day, see docs/explanation/cluster.md."""
FAULTS_OF_A_PAIR = 25
PAIR_WITHIN_S = 3600.0

ON_LOOPBACK = ("kill", "stop_active", "stop_active", "handover", "stop_standby", "end", "kill_member", "stop_leader")
FAULTS = (
    *ON_LOOPBACK,
    *("kill", "lose_machine", "lose_machine", "unplug", "cut_active", "cut_active", "cut_standby", "cut_all"),
    *("cut_one_way", "cut_one_way", "cut_controller", "kill_leader", "slow_disk", "slow_disk", "jump_clock"),
    "go_on_alone",
)


@dataclass
class Tally:
    """What a campaign saw."""

    faults: Counter[str] = field(default_factory=Counter)
    takeovers_s: dict[str, list[float]] = field(default_factory=dict)
    """From the fault to the first state of the other machine, by fault."""
    epochs: int = 0
    writes: int = 0
    presses: int = 0
    states: int = 0
    invitations: int = 0
    rides: int = 0
    kept: int = 0
    """Takeovers after which a session continued."""
    findings: list[str] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Add what another one saw."""
        self.faults.update(other.faults)
        for name, took in other.takeovers_s.items():
            self.takeovers_s.setdefault(name, []).extend(took)
        for name in ("epochs", "writes", "presses", "states", "invitations", "rides", "kept"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.findings += other.findings


@dataclass(frozen=True)
class Happening:
    """A fault that has begun."""

    undo: Callable[[], None]
    lasts_s: float | None = None
    """None: until the other machine commands the lift."""


class Pair:
    """Both machines, what they share, and somebody who uses the lift."""

    def __init__(
        self,
        plan: LiftPlan,
        lift: LiftSimulator,
        members: Members,
        folder: Path,
        network: Network,
        *,
        seed: int,
        rides: bool,
        forked: bool,
        filtered: bool,
    ) -> None:
        self.lift, self.members, self.network = lift, members, network
        self.dice, self.tally = Random(seed), Tally()
        clock = build_clock(folder) if isinstance(network, Namespaces) else None
        arbitration = compile_map(plan.map.map).arbitration
        self.cables = Cables(lift.ports[""], network.addresses[CONTROLLER], arbitration)
        self.machines = {name: Machine(name, folder, network, clock=clock, forked=forked) for name in MACHINES}
        self.observers = Observers(members.urls, "bench")
        self.keys = self.observers.keys
        self.client: Client = (Robot if rides else Requests)(lift, self.dice, self._find)
        self._plan = plan
        self._seed = seed
        self._filtered = filtered
        self._has_one_slot = plan.map.map.link.max_connections == 1
        self._happened: list[tuple[float, str]] = [(0.0, "start")]
        self._alone: list[tuple[str, datetime, datetime]] = []
        """Which machine went on alone, from when until when: what it wrote meanwhile is in its journal only."""

    @contextmanager
    def running(self) -> Iterator[None]:
        with ExitStack() as stack:
            stack.enter_context(self.cables.running())
            for machine in self.machines.values():
                machine.site.write_text(json.dumps(self._site(machine)), "utf-8")
            stack.enter_context(self.observers.running())
            prepared = call("cluster", "init", self.machines["north"].site)
            assert prepared.returncode == 0, prepared.stderr
            for machine in self.machines.values():
                if self._filtered:
                    stack.enter_context(machine.filtered())
                stack.enter_context(machine.running())
                machine.start()
            eventually(lambda: self.active)
            yield

    def _site(self, machine: Machine) -> dict[str, object]:
        made = site_file([self._plan], {LIFT: {"": self.cables.ports[machine.name]}}, machine.folder)
        made["controllers"][LIFT]["host"] = self.network.addresses[CONTROLLER]
        addresses = {name: {"address": one.url} for name, one in self.machines.items()}
        api = {"host": machine.host, "without_keys": "nobody else is in this network"}
        cluster: dict[str, object] = {"machines": addresses, "etcd": self.members.urls}
        if self._filtered:
            cluster["packet_filter"] = str(machine.folder / "filter")
        return made | {"state": "state", "api": api, "cluster": cluster}

    @property
    def active(self) -> Machine | None:
        """Whoever has just given a state."""
        now = time.monotonic()
        return next((one for one in self.machines.values() if one.first_state(now - 0.3) is not None), None)

    def other(self, machine: Machine) -> Machine:
        return next(one for one in self.machines.values() if one is not machine)

    def use(self, for_s: float, ended: threading.Event | None = None) -> None:
        """Let the client use the lift for a while."""
        pause, ends_at = ended or threading.Event(), time.monotonic() + for_s
        while time.monotonic() < ends_at and not pause.wait(self.dice.choice((0.0, 0.05, 0.2, 0.6))):
            if (active := self.active) is not None:
                self.client.act(active)

    @contextmanager
    def _used(self) -> Iterator[None]:
        ended = threading.Event()
        thread = threading.Thread(target=self.use, args=(PAIR_WITHIN_S, ended), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def finish(self) -> None:
        """Let what the client has begun end well."""
        try:
            eventually(self._finished)
        except AssertionError:
            self._find(f"does not end: {self.client.unfinished()}")
        self.tally.rides += self.client.ridden

    def _finished(self) -> bool:
        self.use(0.5)
        return not self.client.unfinished()

    # -- faults

    def meet(self, name: str) -> None:
        """Let something happen, wait until the lift is commanded again, and judge what a takeover itself did."""
        active = self._awaited(self._ready, "before")
        epoch, passages = self.keys.newest.epoch, len(self.cables.passages)
        expects_session = self.client.expects_session()
        is_busy = self.dice.random() < BUSY
        self.tally.faults[name] += 1
        began = time.monotonic()
        self._happened.append((began, f"{name} of {active.name}{', busy' if is_busy else ''}"))
        happening: Happening = getattr(self, f"_{name}")(active)
        with ExitStack() as stack:
            if is_busy:
                stack.enter_context(self._used())
            found = self._follow(self.other(active), began, happening.lasts_s)
            if found is not None:
                self._note_takeover(name, found - began)
                self._judge_takeover(epoch, passages, expects_session=expects_session, is_busy=is_busy)
            if happening.lasts_s is not None:
                threading.Event().wait(max(0.0, began + happening.lasts_s - time.monotonic()))
            happening.undo()
            ended = time.monotonic()
            commanding = self._awaited(lambda: self._commands(ended), f"after {name}")
            if found is None and commanding is not active:
                first = commanding.first_state(began)
                assert first is not None
                self._note_takeover(f"{name}, from its end", first.at - ended)
            if found is None and self.keys.newest.epoch != epoch:
                self._judge_takeover(epoch, passages, expects_session=expects_session, is_busy=is_busy)

    def _ready(self) -> Machine | None:
        """Return the active machine, once everything is well and the other one could take over."""
        active = self.active
        if active is None or self.keys.newest.owner != active.name or not self.other(active).stands_by():
            return None
        return active if all(map(_is_healthy, self.members.urls)) else None

    def _awaited(self, look: Callable[[], Machine | None], when: str) -> Machine:
        try:
            return eventually(look)
        except AssertionError as error:
            logs = "\n".join(f"--- {one.name}\n{one.log[-3000:]}" for one in self.machines.values())
            raise AssertionError(f"seed {self._seed}, {when}: nobody commands the lift\n{logs}") from error

    def _follow(self, other: Machine, began: float, lasts_s: float | None) -> float | None:
        """Return when the other machine commanded the lift; None if it did not while the fault lasted."""
        if lasts_s is None:
            self._awaited(lambda: other if other.first_state(began) else None, self._happened[-1][1])
        else:
            with suppress(AssertionError):
                eventually(lambda: other.first_state(began), lasts_s)
        first = other.first_state(began)
        return None if first is None else first.at

    def _commands(self, since: float) -> Machine | None:
        """Return who has the key and has given a state since then."""
        owner = self.machines.get(self.keys.newest.owner)
        return owner if owner is not None and owner.first_state(since) is not None else None

    def _note_takeover(self, name: str, took_s: float) -> None:
        name += " (one slot)" if self._has_one_slot else ""
        self.tally.takeovers_s.setdefault(name, []).append(took_s)

    def _kill(self, active: Machine) -> Happening:
        active.end()
        return Happening(active.start)

    def _end(self, active: Machine) -> Happening:
        active.tell(signal.SIGTERM)

        def undo() -> None:
            assert active.program is not None
            active.program.ended()
            active.end()
            active.start()

        return Happening(undo)

    def _stop_active(self, active: Machine) -> Happening:
        return self._stopped(active)

    def _stop_standby(self, active: Machine) -> Happening:
        return self._stopped(self.other(active))

    def _stopped(self, machine: Machine) -> Happening:
        machine.tell(signal.SIGSTOP)
        return Happening(lambda: machine.tell(signal.SIGCONT), self.dice.choice(STOPS_S))

    def _handover(self, active: Machine) -> Happening:
        done = call("handover", active.site, "--by", "Eve")
        if done.returncode:
            if "no manager is active" not in done.stderr:  # it may have lost its term just before
                self._find(f"the handover from {active.name} failed: {done.stderr}")
            return Happening(_nothing, 0.0)
        return Happening(_nothing)

    def _kill_member(self, _: Machine) -> Happening:
        return self._killed_member(self.dice.choice(self.members.names))

    def _kill_leader(self, _: Machine) -> Happening:
        return self._killed_member(self.members.leader())

    def _killed_member(self, name: str) -> Happening:
        self.members.kill(name)
        return Happening(lambda: self.members.start(name), self.dice.uniform(0.5, 3.0))

    def _stop_leader(self, _: Machine) -> Happening:
        name = self.members.leader()
        self.members.tell(name, signal.SIGSTOP)
        return Happening(lambda: self.members.tell(name, signal.SIGCONT), self.dice.uniform(0.5, 4.0))

    # -- faults that need networks

    @property
    def _namespaces(self) -> Namespaces:
        assert isinstance(self.network, Namespaces)
        return self.network

    def _lose_machine(self, active: Machine) -> Happening:
        """Its power fails: nothing of it is heard any more, not even that its connections end."""
        self._namespaces.unplug(active.name)
        self.members.kill(active.name)
        active.end()

        def undo() -> None:
            self._namespaces.plug(active.name)
            self.members.start(active.name)
            active.start()

        return Happening(undo)

    def _go_on_alone(self, active: Machine) -> Happening:
        """The witness is lost, then the active machine; a person lets the other one go on alone, and joins them once all is back."""
        alone = self.other(active)
        self.members.kill(WITNESS)
        self._awaited(
            lambda: active if self._serves(active.name) and self._serves(alone.name) else None, "a lost witness"
        )
        self.use(1.0)
        self._lose_machine(active)
        self._stop(alone)
        decided_at = datetime.now(UTC)
        self._by_eve("solo", alone, "--off", active.name)
        epoch = decided_epoch(alone.site)
        self.keys.alone.append(Alone(alone.name, time.monotonic(), epoch))
        alone.start()

        def undo() -> None:
            self._namespaces.plug(active.name)
            for name in (active.name, WITNESS):
                self.members.start(name)
            eventually(lambda: f"{alone.name} goes on alone" in call("cluster", "status", alone.site).stdout)
            is_early = self.dice.random() < 0.5
            if is_early:  # it stands by until they are joined
                active.start()
            self.use(2.0)
            self._stop(alone)
            self.keys.alone[-1].until = time.monotonic()
            self._by_eve("join", alone)
            self._alone.append((alone.name, decided_at, datetime.now(UTC)))
            alone.start()
            if not is_early:
                active.start()

        return Happening(undo)

    def _serves(self, name: str) -> bool:
        return _is_healthy(self.members.urls[self.members.names.index(name)])

    def _stop(self, machine: Machine) -> None:
        """End a manager in good order."""
        machine.tell(signal.SIGTERM)
        assert machine.program is not None
        machine.program.ended()
        machine.end()

    def _by_eve(self, command: str, machine: Machine, *more: str) -> None:
        done = call("cluster", command, machine.site, "--by", "Eve", "--machine", machine.name, *more)
        assert done.returncode == 0, f"{command} on {machine.name}: {done.stdout}{done.stderr}"

    def _unplug(self, active: Machine) -> Happening:
        """It runs on, and reaches nobody."""
        self._namespaces.unplug(active.name)
        return Happening(lambda: self._namespaces.plug(active.name), self.dice.choice(CUTS_S))

    def _cut_active(self, active: Machine) -> Happening:
        """Active | standby and witness. Both reach the controller."""
        return self._cut_off(active)

    def _cut_standby(self, active: Machine) -> Happening:
        """Active and witness | standby. Both reach the controller."""
        return self._cut_off(self.other(active))

    def _cut_off(self, machine: Machine) -> Happening:
        return self._cut(*((machine.name, one) for one in (self.other(machine).name, WITNESS)))

    def _cut_all(self, active: Machine) -> Happening:
        """Active | standby | witness: nobody has a majority."""
        standby = self.other(active).name
        return self._cut((active.name, standby), (active.name, WITNESS), (standby, WITNESS))

    def _cut_one_way(self, active: Machine) -> Happening:
        """One machine is not heard by the two others, or does not hear them."""
        machine = self.dice.choice(tuple(self.machines.values()))
        directions = [(machine.name, one) for one in (self.other(machine).name, WITNESS)]
        is_heard = self.dice.random() < 0.5
        return self._lost([(to, of) for of, to in directions] if is_heard else directions)

    def _cut_controller(self, active: Machine) -> Happening:
        """Active | controller, in both directions or in one."""
        there, back = (active.name, CONTROLLER), (CONTROLLER, active.name)
        return self._lost(self.dice.choice(([there, back], [there], [back])))

    def _cut(self, *between: tuple[str, str]) -> Happening:
        return self._lost([*between, *((second, first) for first, second in between)])

    def _lost(self, directions: Sequence[tuple[str, str]]) -> Happening:
        self._namespaces.cut(directions)
        return Happening(self._namespaces.heal, self.dice.choice(CUTS_S))

    def _jump_clock(self, active: Machine) -> Happening:
        """The clock on the wall of one machine, or of both, jumps, and is set right again."""
        both = tuple(self.machines.values())
        jumping = self.dice.choice(((active,), (self.other(active),), both))
        ahead_s = self.dice.choice(JUMPS_S)
        for machine in jumping:
            machine.set_clock(ahead_s)

        def undo() -> None:
            for machine in both:
                machine.set_clock(0)

        return Happening(undo, self.dice.choice((3.0, 5.0)))

    def _slow_disk(self, active: Machine) -> Happening:
        """The disk of a member, of all of them, or of a manager takes longer for each flush."""
        processes = {name: process.pid for name, process in self.members.processes.items()}
        assert active.program is not None
        of = self.dice.choice(
            ((processes[active.name],), (processes[WITNESS],), tuple(processes.values()), (active.program.pid,))
        )
        stack = ExitStack()
        stack.enter_context(slow_disk(of, self.dice.choice(DELAYS_S)))
        return Happening(stack.close, self.dice.choice((3.0, 6.0)))

    # -- judge

    def _judge_takeover(self, epoch: int, passages: int, *, expects_session: bool, is_busy: bool) -> None:
        """The session goes on; and if nothing was requested since the fault, nothing may be pressed."""
        newest = self.keys.newest
        alone = next((one for one in self.keys.alone if one.until == math.inf), None)
        owner = newest.owner if alone is None else alone.machine
        machine = self.machines.get(owner)
        if machine is None or (alone is None and newest.epoch == epoch):
            return
        threading.Event().wait(QUIET_S)
        taken_at = self.keys.since(newest.epoch) if alone is None else alone.since
        connected = [
            one.at for one in self.cables.passages[passages:] if one.machine == machine.name and one.at >= taken_at
        ]
        for write in () if is_busy or not connected else self.lift.writes:
            if write.on and write.at_s > connected[0]:
                self._find(f"the takeover by {machine.name} pressed {write.command} {write.floor or ''}", write.at_s)
        if expects_session and (alone is not None or self.keys.newest.owner == machine.name):
            self.client.judge(machine)
            self.tally.kept += 1

    def judge_log(self) -> None:
        """Judge everything that was written down."""
        passages = self.cables.passages
        answers = [answer for machine in self.machines.values() for answer in machine.answers]
        found = (
            *judge_passages(self.keys, passages),
            *judge_order(self.keys, passages),
            *judge_answers(self.keys, answers),
        )
        for finding in found:
            self._add(finding)
        self.tally.writes += sum(passage.is_write for passage in passages)
        self.tally.states += len(answers)
        self.tally.invitations += sum(answer.is_open for answer in answers)
        self.tally.epochs += self.keys.epochs
        self.tally.presses += sum(write.on for write in self.lift.writes)

    def judge_journals(self) -> None:
        """Both journals verify, and hold the same rows but those of a machine that was alone, once both machines have ended in good order."""
        exports = []
        for machine in (self.other(eventually(lambda: self.active)), eventually(lambda: self.active)):
            assert machine.program is not None
            threading.Event().wait(1.0)  # what the other machine writes until then is copied
            machine.tell(signal.SIGTERM)
            machine.program.ended()
            machine.end()
            verified = call("audit", machine.site, "--verify")
            if verified.returncode:
                self._find(f"the journal of {machine.name} does not verify: {verified.stdout}{verified.stderr}")
            rows = machine.folder / "rows.jsonl"
            call("audit", machine.site, "--last", "1000000", "--jsonl", rows)
            exports.append(list(self._of_both(machine, rows)))
            for error in machine.errors:
                self._find(f"{machine.name} crashed: {error}")
        if differing := first_difference(*exports):
            self._find(f"the two journals differ: {differing}")

    def _of_both(self, machine: Machine, file: Path) -> Iterator[Row]:
        """Yield the rows of a journal that the other one has as well."""
        for line in file.read_text("utf-8").splitlines():
            row = json.loads(line)
            at = datetime.fromisoformat(row["at"])
            if not any(name == machine.name and since <= at <= until for name, since, until in self._alone):
                # after the rows of one that was alone, its numbers are others, and so are its hashes
                yield {**row, "seq": 0, "hash": ""} if self._alone else row

    def keep(self, folder: Path) -> None:
        """Keep what the managers logged and wrote down, to look for the cause of a finding."""
        folder.mkdir(parents=True, exist_ok=True)
        for machine in self.machines.values():
            for file in (*machine.folder.glob("life-*/err"), *machine.folder.glob("rows.jsonl")):
                name = "-".join(file.relative_to(machine.folder.parent).parts)
                shutil.copy(file, folder / f"{self._seed}-{name}")

    def _find(self, text: str, at: float | None = None) -> None:
        self._add(Finding(time.monotonic() if at is None else at, text))

    def _add(self, finding: Finding) -> None:
        number, (began, what) = max(
            (number, one) for number, one in enumerate(self._happened) if one[0] <= finding.at or number == 0
        )
        where = f"seed {self._seed}, fault {number} ({what}), {finding.at - began:+.2f} s"
        self.tally.findings.append(f"{where}: {finding.text}")


def decided_epoch(site: Path) -> int:
    """Return the epoch with which a machine goes on alone, as its disk has it."""
    (file,) = (site.parent / "state").rglob("*.solo")
    return int(json.loads(file.read_text("utf-8"))["epoch"])


def _nothing() -> None:
    """Undo nothing."""


def _is_healthy(member: str) -> bool:
    """Whether a member of etcd serves, with a leader."""
    with suppress(httpx.HTTPError, ValueError):
        return bool(httpx.get(f"{member}/health", timeout=1.0, trust_env=False).json()["health"] == "true")
    return False


def campaign(
    faults: int,
    seed: int,
    *,
    kinds: tuple[str, ...] | None = None,
    network: Network | None = None,
    one_slot: bool = False,
    map_name: str = MAPS[0],
    rides: bool = False,
    forked: bool = False,
    keep: Path | None = None,
    filtered: bool = False,
) -> Tally:
    """Let so many faults happen to one pair: `kinds` in their order, or by default all of them in a random order.

    Logs and journals of a pair with findings are copied to the folder `keep`.
    """
    where, dice = network or Loopback(), Random(seed)
    every = list(kinds or (ON_LOOPBACK if isinstance(where, Loopback) else FAULTS))
    if kinds is None:
        dice.shuffle(every)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        (folder / "etcd").mkdir()
        wish = {"name": LIFT, "map": _map(folder, map_name, one_slot=one_slot), "speed": 20.0, "clear_s": 10.0}
        bench = stack.enter_context(Bench((wish,), near=folder, folder=folder))
        (plan,) = plan_lifts((wish,), folder)
        names = (*MACHINES, WITNESS)
        members = stack.enter_context(
            etcd_members(folder / "etcd", *names, hosts=where.addresses, command=where.command)
        )
        pair = Pair(
            plan, bench.simulator(), members, folder, where, seed=seed, rides=rides, forked=forked, filtered=filtered
        )
        with pair.running():
            for number in range(faults):
                pair.use(dice.uniform(0.3, 3.0))
                pair.meet(every[number % len(every)])
            pair.finish()
            pair.judge_journals()
        pair.judge_log()
        if keep is not None and pair.tally.findings:
            pair.keep(keep)
    return pair.tally


def _map(folder: Path, name: str, *, one_slot: bool) -> str:
    """Return the map; that of a controller with one slot is written into the folder."""
    if not one_slot:
        return name
    shipped, place = load(name).path.read_text("utf-8"), folder / "one-slot.yaml"
    link = "link: {"
    assert link in shipped
    place.write_text(shipped.replace(link, f"{link}max_connections: 1, idle_timeout_s: {IDLE_S:g}, ", 1), "utf-8")
    return "./one-slot.yaml"


# -- the command


@dataclass(frozen=True)
class Part:
    """What one pair does of a campaign, in a process of its own."""

    faults: int
    seed: int
    one_slot: bool
    rides: bool
    map_name: str = MAPS[0]
    kinds: tuple[str, ...] | None = None
    keep: str | None = None
    filtered: bool = False

    def run(self, folder: Path, cancelled: threading.Event, *, loopback: bool) -> Tally:
        """Run it, in networks of its own, until its end or until it is cancelled."""
        with ExitStack() as stack:
            network: Network = Loopback()
            if not loopback:
                network = stack.enter_context(namespaces(self.seed))
            return self._run(network, folder, cancelled)

    def _run(self, network: Network, folder: Path, cancelled: threading.Event) -> Tally:
        own = folder / f"{self.seed}"
        own.mkdir()
        result, out = own / "result", own / "out"
        words = [sys.executable, "-m", "tests.campaigns.takeover", "--part", json.dumps(asdict(self))]
        words += ["--result", str(result), *(["--inside", network.prefix] if isinstance(network, Namespaces) else [])]
        with out.open("wb") as written:
            process = subprocess.Popen(
                network.command(FIELD, words),
                stdout=written,
                stderr=written,
                env=os.environ | {"TMPDIR": str(own)},
                start_new_session=True,  # Ctrl-C is for the command, which ends its parts
            )
            ends_at = time.monotonic() + PAIR_WITHIN_S
            while process.poll() is None and time.monotonic() < ends_at:
                if cancelled.wait(0.2):
                    break
            _end(process)
        if result.exists():
            given = json.loads(result.read_text("utf-8"))
            return Tally(**given | {"faults": Counter(given["faults"])})
        if cancelled.is_set():
            return Tally()
        return Tally(findings=[f"seed {self.seed} ended with {process.returncode}: {out.read_text('utf-8')[-6000:]}"])


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let a process end what it has started, if it still runs, and end it."""
    if process.poll() is None:
        process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(HANGS_S)
    process.kill()
    process.wait()


def parts(faults: int, seed: int, map_name: str, kinds: tuple[str, ...] | None, keep: str | None) -> list[Part]:
    """Divide a campaign among pairs."""
    numbers = range(-(-faults // FAULTS_OF_A_PAIR))
    return [
        Part(
            min(FAULTS_OF_A_PAIR, faults - number * FAULTS_OF_A_PAIR),
            seed * 1000 + number,
            one_slot=number % 4 == 3,
            rides=number % 2 == 0 if number % 8 < 4 else number % 2 == 1,
            map_name=map_name,
            kinds=kinds,
            keep=keep,
        )
        for number in numbers
    ]


def run_parts(todo: Sequence[Part], lanes: int, *, loopback: bool) -> Tally:
    """Run the parts, so many at once. Ctrl-C and SIGTERM end it, and what the parts that had ended saw is returned with a finding."""
    tally, cancelled = Tally(), threading.Event()
    with TemporaryDirectory(prefix="takeover-") as folder, ThreadPoolExecutor(lanes) as pool:
        running = {pool.submit(part.run, Path(folder), cancelled, loopback=loopback): part for part in todo}
        try:
            for job in as_completed(running):
                seen = job.result()
                tally.add(seen)
                found = len(seen.findings)
                sys.stdout.write(f"seed {running[job].seed}: {seen.faults.total()} faults, {found} findings\n")
                sys.stdout.flush()
        except BaseException as error:
            cancelled.set()
            pool.shutdown(wait=False, cancel_futures=True)
            if not isinstance(error, KeyboardInterrupt):
                raise
            tally.findings.append("it was ended before all faults had happened")
    return tally


def report(tally: Tally, took_s: float) -> Iterator[str]:
    """Yield what was seen, a line each."""
    faults = ", ".join(f"{count} {name}" for name, count in sorted(tally.faults.items()))
    yield f"{tally.faults.total()} faults ({faults}) in {took_s:.0f} s"
    yield (
        f"{tally.epochs} epochs, {tally.writes} writes and {tally.presses} presses at the controller, {tally.states} states,"
        f" {tally.invitations} of them OPEN; {tally.rides} rides ended well, {tally.kept} sessions continued;"
        f" {len(tally.findings)} findings"
    )
    for name, took in sorted(tally.takeovers_s.items()):
        half, most = percentile(took, 0.5), percentile(took, 0.99)
        yield f"{name}: {len(took)} takeovers, p50 {half:.2f} s, p99 {most:.2f} s, longest {max(took):.2f} s"
    yield from (f"FOUND {text}" for text in tally.findings)


def _run_part(part: Part, prefix: str | None, result: Path) -> int:
    """Be the process of a part; what it saw goes into a file."""
    tally = campaign(
        part.faults,
        part.seed,
        kinds=tuple(part.kinds) if part.kinds else None,
        network=Namespaces(prefix) if prefix else Loopback(),
        one_slot=part.one_slot,
        rides=part.rides,
        map_name=part.map_name,
        keep=Path(part.keep) if part.keep else None,
        filtered=part.filtered,
    )
    result.write_text(json.dumps(vars(tally)), "utf-8")
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lanes", type=int, default=1)
    parser.add_argument("--loopback", action="store_true")
    parser.add_argument("--map", choices=MAPS, default=MAPS[0])
    parser.add_argument("--kinds", nargs="*", choices=sorted(set(FAULTS)))
    parser.add_argument(
        "--keep", metavar="FOLDER", help="where logs and journals of a pair with findings are copied to"
    )
    for internal in ("--part", "--inside", "--result"):
        parser.add_argument(internal, help=argparse.SUPPRESS)
    parser.add_argument("--packet-filter", action="store_true", help="with the packet filter on both machines")
    given = parser.parse_args()
    if given.loopback and given.packet_filter:
        parser.error("the packet filter is tried in networks alone: it would change that of this computer")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if given.part:
        return _run_part(Part(**json.loads(given.part)), given.inside, Path(given.result))
    began = time.monotonic()
    kinds = tuple(given.kinds) if given.kinds else None
    try:
        todo = parts(given.faults, given.seed, given.map, kinds, given.keep)
        todo = [replace(part, filtered=given.packet_filter) for part in todo]
        tally = run_parts(todo, given.lanes, loopback=given.loopback)
    except CannotMakeNetworks as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for line in report(tally, time.monotonic() - began):
        sys.stdout.write(f"{line}\n")
    return 1 if tally.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
