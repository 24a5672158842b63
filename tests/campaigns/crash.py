"""A real manager is killed at random moments while it commands a lift, and started again: what it did is written down, who holds
the lift still does, and nothing is pressed because of the restart.

    python -m tests.campaigns.crash --kills 200 --seed 1

The controllers are simulated ones at the other end of a socket; they outlive every kill and are the witness. The journal is read
with plain SQL, and its chain by the program.
"""

import argparse
import json
import sqlite3
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import httpx

from lift_manager.lab.bench.bench import Bench
from lift_manager.lab.bench.plan import LiftPlan, plan_lifts
from lift_manager.lab.bench.simulator import LiftSimulator, Write
from lift_manager.lab.bench.site import site_file
from lift_manager.lab.world.truth import Truth
from tests.support.programs import HANGS_S, LIFT_MANAGER, Program, call, eventually

MAPS = ("robotnik-il-eth", "generic-registers", "two-stop-agv", "seer-siemens-chengdu")
"""Bits in shared words, registers, coils written together, calls that stay on. Only the second lets go by itself when nobody writes."""
WATCHED = frozenset({"generic-registers"})
LIFT = "lift"
STARTS_WITHIN_S = 60.0
QUIET_S = 0.6
"""How long nothing is asked after a restart, so that what the restart itself does shows."""
CLEAR_S = 10.0
"""So long a restart keeps a door for a robot that may have been invited, although the door signal is not proven. Chosen: the default of a
site file."""


class Unexpected(Exception):
    """A manager did not do what every one does: start, answer."""


@dataclass
class Tally:
    """What a campaign saw."""

    kills: int = 0
    presses: int = 0
    restored: int = 0
    """Restarts after which a session was taken up."""
    in_startup: int = 0
    """Kills before the manager listened."""
    gaps: int = 0
    """Restarts that took longer than the controllers wait, so that their holds fell by themselves."""
    findings: list[str] = field(default_factory=list)


@dataclass
class Wish:
    """What the last answer that certainly came means for the session."""

    floor: str = ""
    held: bool = False
    certain: bool = True
    """False after a request whose answer was lost."""
    since: int = 0
    """How many writes there were when it was asked for: after the next press its session is on the disk."""


class Victim:
    """One lift, and the manager that is killed again and again."""

    def __init__(
        self,
        plan: LiftPlan,
        simulator: LiftSimulator,
        folder: Path,
        random: Random,
        tally: Tally,
        *,
        lives_s: float,
        forked: bool,
    ) -> None:
        """`lives_s` is how long a life may last beyond its start and the quiet after it; `forked` leaves the imports out of a start."""
        self._plan = plan
        self._lift = simulator
        self._random = random
        self._tally = tally
        self._lives_s = lives_s
        self._forked = forked
        self._state = folder / "state"
        self._folder = folder
        self._site = folder / "site.yaml"
        said = site_file([plan], {LIFT: simulator.ports}, folder) | {"state": str(self._state)}
        self._site.write_text(json.dumps(said), "utf-8")
        self._wish = Wish()
        self._judged = 0
        """Writes that were compared with the journal."""
        self._lives = 0

    @property
    def _journal(self) -> Path:
        (path,) = self._state.glob("*.db")
        return path

    def live_and_die(self) -> None:
        """Start the manager, look at what the start did, ask for things, and kill it somewhere in between."""
        self._lives += 1
        (*_, (since, before)), seen = self._lift.history, len(self._lift.writes)
        began = time.monotonic()
        with self._process() as program:
            if self._random.random() < 0.15:
                self._tally.in_startup += 1
                threading.Event().wait(self._random.uniform(0.0, 1.2))
                program.end()
                self._after_kill()
                return
            port = int(program.says(r"127\.0\.0\.1:(\d+)/docs")[1])
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=HANGS_S, trust_env=False) as http:
                eventually(lambda: self._state_of(http), STARTS_WITHIN_S)
                threading.Event().wait(QUIET_S)
                fallen = {name for at, truth in self._lift.history if at >= since for name in truth.fallen}
                self._judge_restart(before, seen, fallen, began + CLEAR_S)
                killer = threading.Timer(self._random.uniform(0.0, self._lives_s), program.end)
                killer.start()
                self._ask_until_killed(http, killer)
                killer.join()
        self._after_kill()

    def _after_kill(self) -> None:
        self._tally.kills += 1
        self._judge_journal()

    @contextmanager
    def _process(self) -> Iterator[Program]:
        folder = self._folder / f"life-{self._lives}"
        folder.mkdir()
        words = ("serve", str(self._site), "--port", "0")
        program = Program(words if self._forked else (*LIFT_MANAGER, *words), folder, None, forked=self._forked)
        found = len(self._tally.findings)
        try:
            yield program
        except AssertionError as error:
            raise Unexpected(f"{error}: {program.err[-2000:]}") from error
        finally:
            program.end()
        if len(self._tally.findings) > found:
            self._tally.findings[-1] += f"\n{program.err[-2000:]}"
        if "Traceback" in program.err:
            self._finding(f"the manager crashed: {program.err[-2000:]}")

    def _state_of(self, http: httpx.Client) -> dict[str, object] | None:
        answer = http.get("/open-rmf/demo-lift/lift_state", params={"lift_name": LIFT}).json()
        return dict(answer["data"]) if answer["success"] else None

    def _ask_until_killed(self, http: httpx.Client, killer: threading.Timer) -> None:
        while killer.is_alive():
            try:
                self._ask(http)
            except httpx.TransportError:
                return
            threading.Event().wait(self._random.choice((0.0, 0.01, 0.1, 0.4, 1.5)))

    def _ask(self, http: httpx.Client) -> None:
        state = self._state_of(http)
        if state is None:
            return
        here = str(state["current_floor"])
        lets_go = bool(here) and self._random.random() < 0.2
        floor = here if lets_go else self._random.choice(self._lift.floors)
        hold = not lets_go and self._random.random() < 0.9
        seen = len(self._lift.writes)
        was, self._wish = self._wish, Wish(certain=False)
        body = {"floor": floor, "door_state": 2 if hold else 0}
        answer = http.post("/open-rmf/demo-lift/lift_request", params={"lift_name": LIFT}, json=body).json()
        if not answer["success"]:
            self._wish = was
            return
        if not hold:
            # a call without a hold is over by itself on arrival, sooner or later
            self._wish = Wish(certain=lets_go)
            return
        same = was.held and was.floor == floor
        self._wish = Wish(floor, held=True, since=was.since if same else seen)

    @property
    def _is_on_the_disk(self) -> bool:
        """Whether something was pressed for the session of the last wish, and so after it was written down."""
        wish = self._wish
        return wish.certain and wish.held and any(write.on for write in self._lift.writes[wish.since :])

    def _judge_restart(self, before: Truth, seen: int, fallen: set[str], doors_until: float) -> None:
        """Nothing was asked since the kill: nothing may be pressed, and what the session wants stays on.

        What has `fallen`, the controller let go of by itself: it waits for 3 s after the last write. After `doors_until`, which comes
        before this is judged where the computer is very busy, a door that is not proven may shut.
        """
        since = self._lift.writes[seen:]
        for write in since:
            if write.on:
                self._finding(f"the restart pressed {write.command} {write.floor or ''}: {since}")
        if not self._is_on_the_disk:
            return
        if not self._row("kind = 'session' AND text LIKE '%as before the restart%'"):
            self._finding(f"the session to {self._wish.floor} was not taken up after the restart")
            return
        self._tally.restored += 1
        # at another floor than it asked for last, its door is to shut: the manager was killed between its call and that release
        doors = {name for name in before.commands if name.startswith("hold_door") and before.at == self._wish.floor}
        held = doors | (before.commands & {"robot_mode"})
        if held & fallen and self._plan.map.map.name in WATCHED:
            self._tally.gaps += 1
            return
        for write in since:
            if not write.on and write.command in held and (write.command not in doors or write.at_s < doors_until):
                self._finding(f"the restart let go of {write.command} of a session that goes on: {since}")

    def _judge_journal(self) -> None:
        """Every press that the controller took has a row from before it, and the chain holds."""
        writes: tuple[Write, ...] = self._lift.writes
        pressed = Counter((write.command, write.floor) for write in writes if write.on)
        if pressed:
            rows = self._press_rows()
            for what, times in pressed.items():
                if rows[what] < times:
                    self._finding(f"the controller took {times} presses of {what}, and the journal has {rows[what]}")
            self._tally.presses += sum(write.on for write in writes[self._judged :])
        self._judged = len(writes)
        if self._state.is_dir() and list(self._state.glob("*.db")):
            ended = call("audit", self._site, "--verify")
            if ended.returncode:
                self._finding(f"the journal does not verify: {ended.stdout}{ended.stderr}")

    def _press_rows(self) -> Counter[tuple[str, str | None]]:
        with closing(self._open()) as journal:
            found = journal.execute("SELECT data FROM rows WHERE kind = 'press'").fetchall()
        said = [json.loads(data) for (data,) in found]
        return Counter((row["command"], row["floor"]) for row in said)

    def _row(self, where: str) -> bool:
        """Whether this life of the manager has written such a row."""
        with closing(self._open()) as journal:
            (began,) = journal.execute(
                "SELECT max(seq) FROM rows WHERE kind = 'manager' AND text LIKE '%started%'"
            ).fetchone()
            found = journal.execute(f"SELECT count(*) FROM rows WHERE seq >= ? AND {where}", (began,)).fetchone()
        return bool(found[0])

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(f"file:{self._journal}?mode=ro", uri=True)

    def _finding(self, text: str) -> None:
        self._tally.findings.append(f"{self._plan.map.map.name}, life {self._lives}: {text}")

    def end_well(self) -> None:
        """Let the manager end in good order: then nothing is pressed any more."""
        self._lives += 1
        with self._process() as program:
            program.says(r"127\.0\.0\.1:(\d+)/docs")
            threading.Event().wait(QUIET_S)
            code, _ = program.stop()
        if code:
            self._finding(f"the last manager ended with {code}: {program.err[-2000:]}")
        left = {
            name for name in self._lift.truth.commands if name.startswith(("hold_door", "robot_mode", "go", "call"))
        }
        if left:
            self._finding(f"after the orderly end {sorted(left)} is still pressed")
        self._judge_journal()


def campaign(
    kills: int, seed: int, maps: tuple[str, ...] = MAPS, *, lives_s: float = 3.0, forked: bool = False
) -> Tally:
    """Kill a manager so many times, spread over the maps."""
    tally, random = Tally(), Random(seed)
    for number, name in enumerate(maps):
        share = kills // len(maps) + (number < kills % len(maps))
        if not share:
            continue
        wish = {"name": LIFT, "map": name, "speed": 20.0, "clear_s": CLEAR_S}
        with ExitStack() as stack:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            bench = stack.enter_context(Bench((wish,), near=Path.cwd(), folder=folder))
            (plan,) = plan_lifts((wish,), Path.cwd())
            dice = Random(random.getrandbits(64))
            victim = Victim(plan, bench.simulator(), folder, dice, tally, lives_s=lives_s, forked=forked)
            try:
                for _ in range(share):
                    victim.live_and_die()
                victim.end_well()
            except Unexpected as error:
                tally.findings.append(f"{name}: {error}")
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--maps", nargs="*", default=MAPS)
    given = parser.parse_args()
    began = time.monotonic()
    tally = campaign(given.kills, given.seed, tuple(given.maps))
    sys.stdout.write(
        f"{tally.kills} kills ({tally.in_startup} of them during the start) in {time.monotonic() - began:.0f} s;"
        f" {tally.presses} presses reached a controller; {tally.restored} sessions were taken up again, {tally.gaps} of them"
        f" after the controller had let go by itself; {len(tally.findings)} findings\n"
    )
    for text in tally.findings:
        sys.stdout.write(f"FOUND {text}\n")
    return 1 if tally.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
