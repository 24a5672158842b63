"""Several callers, people, faults and restarts around one real manager; what must hold of its sessions after every step."""

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import VirtualTimeLoop, elapse
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, Witness
from lift_manager.lab.world.world import START_TIME, World
from lift_manager.lift.commands import CommandType
from lift_manager.lift.events import HandedOver, Restriction, SessionEnded, SessionOpened, SessionRestored
from lift_manager.lift.inputs import JoinQueue, LeaveQueue
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, same_but_for_time
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from register_maps.load import load
from register_maps.words import Mode
from simulator.faults import InMode
from simulator.state import Inputs, Parameters
from simulator.wire_faults import Exchange, HalfOpen
from tests.lift_manager.runtime.session_machine_steps import LINE, STAYERS, Stayers
from tests.support.refusals import reply

LIFT = "lift"
FLOORS = ("L1", "L2", "L3")
CALLERS = (Holder("api", "r1"), Holder("api", "r2"), Holder("rmf", "fleet/r1"), Holder("workshop", "workshop"))
LEASE_S, MAX_SESSION_S, TAKEOVER_S, BETWEEN_S = 40.0, 90.0, 35.0, 2.0
ARRIVES_S = 120.0
"""How long a robot under way may keep a session that is over otherwise: `arrive_within_s` of the map."""
LATE_S = 1.0
"""A poll, and its answer."""
RMF = CALLERS[2]
callers, floors = st.sampled_from(CALLERS), st.sampled_from(FLOORS)


@dataclass
class Book:
    """A witness that knows who held the lift when, and what each holder asked for."""

    holder: Holder | None = None
    wanted: set[str] = field(default_factory=set)
    """Floors that were asked for in the session that goes on, or was the last."""
    wanted_by: Holder | None = None
    given: dict[str, int] = field(default_factory=dict)
    presses: int = 0
    calls: int = 0
    ended: int = 0
    wrong: list[str] = field(default_factory=list)

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        self.given = dict(truth.given)

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """See whether the holder can have asked for it; a call is for a floor that it asked for."""
        self.presses += 1
        self.calls += "go_to" in commands
        if not self.wanted:
            self.wrong.append(f"{at:.2f} s: {sorted(commands)} pressed, and no holder asked")
        if "go_to" in commands and (floor := FLOORS[self.given["go_to"]]) not in self.wanted:
            self.wrong.append(f"{at:.2f} s: called to {floor}, and {self.wanted_by} asked for {sorted(self.wanted)}")

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Nothing about the state is noted here."""

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Nothing about the wire is noted here."""

    def on_event(self, at: float, event: Event) -> None:
        match event:
            case SessionOpened(holder=holder) | SessionRestored(holder=holder):
                if self.holder not in (None, holder):
                    self.wrong.append(f"{at:.2f} s: {holder} gets the lift, and {self.holder} holds it")
                self.holder = holder
            case HandedOver(holder=holder, to=to):
                if self.holder != holder:
                    self.wrong.append(f"{at:.2f} s: {holder} hands the lift over, and {self.holder} holds it")
                self.holder = self.wanted_by = to
            case SessionEnded(holder=holder):
                if self.holder not in (None, holder):
                    self.wrong.append(f"{at:.2f} s: the session of {holder} ends, and {self.holder} holds the lift")
                self.holder = None
                self.ended += 1
                if self.wanted_by == holder:
                    self.wanted.clear()
            case _:
                pass

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        if refused is not None:
            return
        if request.holder != self.wanted_by:
            self.wanted_by, self.wanted = request.holder, set()
        self.wanted.add(request.floor)

    def on_fault(self, at: float, change: FaultChange) -> None:
        """A kill ends no session by itself, but what is heard of it begins anew."""
        if change.fault == "restart":
            self.holder = None


def loaded_site() -> LoadedSite:
    lift = {
        "controller": "plc",
        "access": "control",
        "floors": {floor: code for code, floor in enumerate(FLOORS, start=1)},
        "poll_s": 0.5,
        "lease_s": LEASE_S,
        "max_session_s": MAX_SESSION_S,
        "takeover_after_s": TAKEOVER_S,
        "between_sessions_s": BETWEEN_S,
    }
    devices = {"plc": {"host": "memory", "port": 1, "map": "generic-registers"}}
    site = Site.model_validate({"schema": 1, "name": "machine", "controllers": devices, "lifts": {LIFT: lift}})
    return LoadedSite(site, {LIFT: load("generic-registers")}, Path("machine"))


class SessionMachine(RuleBasedStateMachine):
    """One lift on virtual time: the whole manager, its driver and a simulated controller."""

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(limit_s=1e9))
        self.book = Book()
        self.jump_s = 0.0
        self.present: set[str] = set()
        self.world: World
        self.life: asyncio.Task[None]

    def run(self, work: Coroutine[Any, Any, None]) -> None:
        self.runner.run(work)
        if self.life.done():
            self.life.result()

    @initialize()
    def start(self) -> None:
        loaded = loaded_site()
        # people want doors released at once here, and sessions end in every way: how long before that OPEN is withdrawn is not asked
        judges = oracle_of(loaded).lifts.items()
        self.oracle = Oracle({name: replace(about, clear_s=0.0) for name, about in judges})
        self.book_of_rules = Rules(self.oracle)
        witnesses: tuple[Witness, ...] = (self.oracle, self.book_of_rules, self.book)
        self.stayers = Stayers(LIFT, witnesses)
        self.world = World(
            loaded,
            witnesses,
            settings={LIFT: Parameters(speed=4)},
            observe_every_s=0.5,
            clock=self.clock,
        )
        self.stop = asyncio.Event()

        async def live() -> None:
            async with self.world.running():
                await self.stop.wait()

        async def begin() -> None:
            self.life = asyncio.get_running_loop().create_task(live())
            await elapse(3)

        self.runner.run(begin())

    def clock(self) -> datetime:
        return START_TIME + timedelta(seconds=asyncio.get_running_loop().time() + self.jump_s)

    @property
    def state(self) -> LiftState:
        return self.world.site.state(LIFT)

    @property
    def end_is_announced(self) -> bool:
        session = self.world.actors[LIFT].record.session
        return session is not None and session.end_is_announced

    def request(self, request: FloorRequest) -> None:
        """Request, and see that the reply and what becomes of the session fit together."""

        async def main() -> None:
            before = self.state.holder
            ended = self.book.ended
            refused = self.world.request(request)
            if refused is not None and refused.code is Refusal.HELD:
                assert self.state.holder is not None
                assert str(self.state.holder) in refused.message
                assert self.state.holder != request.holder
            if refused is None and self.state.holder is not None:
                assert self.state.holder == request.holder
            await elapse(0.2)
            lets_go = not request.hold_door or request.robot is RobotWord.LEFT
            if before is not None and before != request.holder and lets_go and self.book.ended == ended:
                assert self.state.holder == before

        self.run(main())

    @rule(holder=callers, floor=floors, hold=st.booleans(), word=st.sampled_from([None, None, *RobotWord]))
    def asks(self, holder: Holder, floor: str, hold: bool, word: RobotWord | None) -> None:
        self.request(FloorRequest(LIFT, holder, floor, hold, word))

    @rule(holder=callers, floor=floors, times=st.integers(2, 8))
    def repeats(self, holder: Holder, floor: str, times: int) -> None:
        async def main() -> None:
            for _ in range(times):
                self.world.request(FloorRequest(LIFT, holder, floor, hold_door=True))
                await elapse(2)

        self.run(main())

    @rule(floor=floors, hold=st.booleans())
    def rmf_asks(self, floor: str, hold: bool) -> None:
        self.request(FloorRequest(LIFT, RMF, floor, hold, stays=True))

    @rule(grace_s=st.sampled_from([0.0, 3.0]), then=st.sampled_from(["waits", "kills", "goes on"]))
    def rmf_ends(self, grace_s: float, then: str) -> None:
        async def main() -> None:
            before, calls = self.state.holder, self.book.calls
            answer = reply(self.world.site.end_session, LIFT, RMF, grace_s)
            assert isinstance(answer, RequestRefused) == (before not in (None, RMF))
            if before != RMF:
                assert self.state.holder == before
                return
            assert grace_s or self.state.holder is None
            if then == "kills":
                await self.world.restart()
                assert self.state.holder is None
            await elapse(grace_s * 0.9)
            assert self.book.calls == calls, "END has called the car"
            floor = self.state.destination
            if then == "goes on" and self.state.holder == RMF and floor is not None:
                again = self.world.request(FloorRequest(LIFT, RMF, floor, hold_door=True, stays=True))
                await elapse(2)
                assert again is not None or self.state.holder == RMF
                return
            await elapse(grace_s * 0.1 + 0.2)
            assert self.state.holder is None

        self.run(main())

    @rule(holder=callers)
    def releases(self, holder: Holder) -> None:
        async def main() -> None:
            before, floor = self.state.holder, self.state.floor
            if floor is None:
                return
            refused = self.world.request(FloorRequest(LIFT, holder, floor, hold_door=False))
            if before not in (None, holder):
                assert refused is not None, "a release by somebody else is obeyed"
                assert self.state.holder == before
            elif before == holder:
                assert self.state.holder is None
            await elapse(0.2)

        self.run(main())

    @rule(seconds=st.sampled_from([0.1, 1, 5, 20, 36]))
    def waits(self, seconds: float) -> None:
        self.run(elapse(seconds))

    @rule(seconds=st.sampled_from([0.1, 3]))
    def is_killed(self, seconds: float) -> None:
        async def main() -> None:
            before = self.state.holder
            await self.world.restart()
            await elapse(seconds)
            if self.state.holder is not None:
                assert self.state.holder == before

        self.run(main())

    @rule(holder=callers, floor=floors)
    def asks_and_the_manager_is_killed_at_once(self, holder: Holder, floor: str) -> None:
        async def main() -> None:
            self.world.request(FloorRequest(LIFT, holder, floor, hold_door=True))
            await self.world.restart()
            await elapse(3)

        self.run(main())

    @rule(seconds=st.sampled_from([-1e6, -10, 10, 60]))
    def clock_jumps(self, seconds: float) -> None:
        self.jump_s += seconds

    # -- sessions of their holders' own, and the line

    @rule(holder=st.sampled_from(STAYERS), ttl_s=st.sampled_from([None, 5.0, 1000.0]))
    def opens(self, holder: Holder, ttl_s: float | None) -> None:
        async def main() -> None:
            waits = self.world.actors[LIFT].record.queue
            self.stayers.open(self.world.site, waits, holder, ttl_s, asyncio.get_running_loop().time())
            await elapse(0.2)

        self.run(main())

    @rule(which=st.integers(0, 3), kind=st.sampled_from(CommandType), floor=floors, hold=st.booleans())
    def commands(self, which: int, kind: CommandType, floor: str, hold: bool) -> None:
        async def main() -> None:
            self.stayers.command(self.world.site, -which, kind, floor, asyncio.get_running_loop().time(), hold=hold)
            await elapse(0.2)

        self.run(main())

    @rule(floor=floors, other=floors, seconds=st.sampled_from([8, 20]))
    def rides(self, floor: str, other: str, seconds: float) -> None:
        """Do what a robot does, as far as it is let."""

        async def main() -> None:
            for kind, to in (
                (CommandType.GO_TO, floor),
                (CommandType.ROBOT_IN_PLACE, floor),
                (CommandType.GO_TO, other),
                (CommandType.ROBOT_LEFT, other),
            ):
                self.stayers.command(self.world.site, -1, kind, to, asyncio.get_running_loop().time(), hold=True)
                await elapse(seconds if kind is CommandType.GO_TO else 1)

        self.run(main())

    @rule(which=st.integers(0, 3))
    def renews(self, which: int) -> None:
        async def main() -> None:
            self.stayers.renew(self.world.site, -which, asyncio.get_running_loop().time())
            await elapse(0.2)

        self.run(main())

    @rule(which=st.integers(0, 3), word=st.sampled_from([None, *RobotWord]))
    def closes(self, which: int, word: RobotWord | None) -> None:
        async def main() -> None:
            self.stayers.close(self.world.site, -which, word)
            await elapse(0.2)

        self.run(main())

    @rule(holder=st.sampled_from(LINE), joins=st.booleans())
    def waits_in_line(self, holder: Holder, joins: bool) -> None:
        async def main() -> None:
            self.world.actors[LIFT].handle(JoinQueue(holder) if joins else LeaveQueue(holder))

        self.run(main())

    @rule(by=callers, to=callers)
    def hands_over(self, by: Holder, to: Holder) -> None:
        async def main() -> None:
            before = self.state.holder
            answer = reply(self.world.site.hand_over, LIFT, by, to)
            assert isinstance(answer, RequestRefused) == (before != by)
            if before != by:
                assert self.state.holder == before
            else:
                # after a restart this is the word of its holder, like a request for the same floor
                request = FloorRequest(LIFT, to, self.state.destination or "", hold_door=True)
                self.book_of_rules.on_request(asyncio.get_running_loop().time(), request, None)
            await elapse(0.2)

        self.run(main())

    @rule(at_once=st.booleans())
    def person_releases(self, at_once: bool) -> None:
        async def main() -> None:
            before = self.state.holder
            answer = reply(self.world.site.force_release, LIFT, "the guard", "it blocks the lift", at_once=at_once)
            assert isinstance(answer, RequestRefused) == (before is None)
            assert self.state.holder is None or (self.end_is_announced and not at_once)
            assert before is None or self.state.robot_door is not RobotDoor.OPEN
            await elapse(0.2)

        self.run(main())

    @rule()
    def person_looks(self) -> None:
        async def main() -> None:
            reply(self.world.site.end_lockout, LIFT, "the guard")
            reply(self.world.site.acknowledge, LIFT, "the guard")
            await elapse(0.2)

        self.run(main())

    @rule(at_once=st.booleans())
    def person_locks_out(self, at_once: bool) -> None:
        async def main() -> None:
            answer = reply(self.world.site.lock_out, LIFT, "the guard", "moving furniture", at_once=at_once)
            begun_at_once = at_once and isinstance(answer, Restriction)
            assert self.state.holder is None or (self.end_is_announced and not begun_at_once)
            assert self.state.robot_door is not RobotDoor.OPEN
            await elapse(0.2)

        self.run(main())

    @rule(name=st.sampled_from(["offline", "independent", "fire"]))
    def trouble(self, name: str) -> None:
        async def main() -> None:
            self.toggle(name, on=name not in self.present)
            await elapse(2)

        self.run(main())

    @precondition(lambda self: bool(self.present))
    @rule()
    def all_is_well(self) -> None:
        async def main() -> None:
            for name in tuple(self.present):
                self.toggle(name, on=False)
            await elapse(1)

        self.run(main())

    def toggle(self, name: str, *, on: bool) -> None:
        (self.present.add if on else self.present.discard)(name)
        match name:
            case "fire":
                self.world.set_inputs(LIFT, Inputs(fire=on))
            case "offline":
                (self.world.begin_wire_fault if on else self.world.end_wire_fault)("plc", HalfOpen())
            case _:
                (self.world.begin if on else self.world.end)(LIFT, InMode(Mode.INDEPENDENT))

    @invariant()
    def nothing_forbidden_has_happened(self) -> None:
        assert self.book.wrong == []
        findings = [str(finding) for finding in self.oracle.findings]
        assert not findings, findings
        self.run(self.look())
        held_s = self.state_now().held_since_s
        assert held_s is None or held_s <= MAX_SESSION_S + ARRIVES_S + LATE_S

    async def look(self) -> None:
        self.stayers.look(self.world.site)
        assert same_but_for_time(self.world.site.lasting_state(LIFT), self.state)

    def state_now(self) -> LiftState:
        """Return the state, from outside the loop."""
        found: list[LiftState] = []

        async def look() -> None:
            found.append(self.state)

        self.run(look())
        return found[0]

    def teardown(self) -> None:
        """Leave the lift alone: whatever was asked of it ends by itself, and then the manager lets go and ends."""

        async def end() -> None:
            for _ in range(3):
                await elapse((MAX_SESSION_S + ARRIVES_S) / 3 + LATE_S)
                if self.state.holder is None:
                    break
            assert self.state.holder is None, "a session that nobody asks for never ends"
            self.stop.set()
            await self.life

        try:
            self.run(end())
            self.nothing_is_left()
        finally:
            self.runner.close()

    def nothing_is_left(self) -> None:
        assert self.book.wrong == []
        findings = [str(finding) for finding in self.oracle.findings]
        assert not findings, findings
