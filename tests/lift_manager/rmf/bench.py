"""An adapter on a bench: a manager that answers by the rules of its sessions, and everything that went out, on a clock turned by hand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from lift_manager.plain.rmf import Alarms, HeldBy, LiftView, SiteView
from lift_manager.rmf.adapter import Adapter, RmfOutput
from lift_manager.rmf.lift_state import MIN_GAP_S
from lift_manager.rmf.messages import AGV_MODE, DOOR_CLOSED, DOOR_OPEN, END_SESSION, LiftRequest, LiftState, Time
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, ManagerRequest, SessionDemand

A, B = "fleet_a/robot1", "fleet_b/robot2"
EPOCH = 1_700_000_000.0


def lift(name: str = "lift", **changes: object) -> LiftView:
    """An idle lift that stands at L1 with its door shut; RMF calls its floors by other names."""
    view = LiftView(
        lift=name,
        name=f"{name}_rmf",
        floors={"L1": "Level 1", "L2": "Level 2", "L3": "Level 3"},
        live=True,
        reason="",
        age_s=0.1,
        max_age_s=1.0,
        floor="L1",
        standing=True,
        destination=None,
        door="closed",
        motion="stopped",
        mode="normal",
        robot_mode_on=None,
        holder=None,
        ending=False,
        fire_latched=False,
        waiting_for="",
        keeps_off="",
    )
    return replace(view, **changes)  # type: ignore[arg-type]


def wants(session: str, floor: str, lift: str = "lift_rmf", **changes: object) -> LiftRequest:
    request = LiftRequest(lift, Time(), session, AGV_MODE, floor, DOOR_OPEN)
    return replace(request, **changes)  # type: ignore[arg-type]


def ends(session: str, floor: str = "", lift: str = "lift_rmf") -> LiftRequest:
    return LiftRequest(lift, Time(), session, END_SESSION, floor, DOOR_CLOSED)


@dataclass
class RecordedAlarms:
    """What RMF was told of fires."""

    offered: list[Alarms] = field(default_factory=list)
    said: list[bool] = field(default_factory=list)
    forgotten_after: list[int] = field(default_factory=list)
    """How much had been said when it was forgotten."""

    def offer(self, alarms: Alarms) -> None:
        self.offered.append(alarms)

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        assert alarms in self.offered
        self.said.append(on)

    def forget(self) -> None:
        self.forgotten_after.append(len(self.said))


@dataclass
class Bench:
    """The manager keeps an ended session until `over` is called, as it does for the grace."""

    views: dict[str, LiftView] = field(default_factory=lambda: {"lift": lift()})
    now: float = 100.0
    alarms: Alarms = field(default_factory=Alarms)
    boot: str = "first"
    event: int = 0
    refusal_code: str = ""
    """The code with which all demands are refused; `unreachable` if nobody answers."""
    sent_requests: list[ManagerRequest] = field(default_factory=list)
    published: list[LiftState] = field(default_factory=list)
    alarm: RecordedAlarms = field(default_factory=RecordedAlarms)
    waiting: list[ManagerRequest] = field(default_factory=list)
    slow: bool = False
    """Answers are given when `answer_all` is called."""
    adapter_id: str = ""
    first_reading_s: float = 0.0

    def __post_init__(self) -> None:
        self.adapter = self._adapter()

    def restart_adapter(self) -> None:
        self.adapter = self._adapter()
        self.waiting.clear()

    def _adapter(self) -> Adapter:
        out = RmfOutput(self.published.append, self.alarm)
        return Adapter(
            self,
            out,
            lambda: EPOCH + self.now,
            adapter_id=self.adapter_id,
            first_reading_s=self.first_reading_s,
        )

    def send(self, request: ManagerRequest) -> None:
        assert request.lift not in [one.lift for one in self.waiting], "asked again before it was answered"
        self.sent_requests.append(request)
        self.waiting.append(request)

    def answer_all(self) -> None:
        for request in [self.waiting.pop(0) for _ in range(len(self.waiting))]:
            self.adapter.on_answer(self._decide(request), self.now)

    def _decide(self, request: ManagerRequest) -> Answer:
        view = self.views.get(request.lift)
        if view is None:
            return Answer(request, accepted=False, code="unknown_lift", reason="there is no such lift")
        ours = HeldBy("rmf", request.session, request.adapter)
        if self.refusal_code in (UNREACHABLE, NOT_SENT, "stopping"):
            return Answer(request, accepted=False, code=self.refusal_code, reason="nobody answers")
        if isinstance(request, SessionDemand):
            if self.refusal_code or view.holder not in (None, ours):
                return Answer(request, accepted=False, code=self.refusal_code or "held", reason="held by another")
            self.views[request.lift] = replace(view, holder=ours, ending=False, destination=request.floor)
        elif view.holder not in (None, ours):
            return Answer(request, accepted=False, code="held", reason="held by another")
        elif view.holder == ours:
            self.views[request.lift] = replace(view, ending=True)
        self.event += 1
        return Answer(request, accepted=True, boot=self.boot, event=self.event)

    def turn(self) -> None:
        """Let everything that is due happen, questions, answers and changes included."""
        for _ in range(10):
            before = len(self.sent_requests), len(self.published)
            self.adapter.tick(self.now)
            if not self.slow:
                self.answer_all()
            self.now += MIN_GAP_S
            self.adapter.tick(self.now)
            if (len(self.sent_requests), len(self.published)) == before:
                return
        raise AssertionError("it does not come to rest")

    def report_site(self) -> None:
        """Bring the manager's newest answer."""
        self.event += 1
        self.adapter.on_site(self.site(), self.now, self.now)
        self.turn()

    def site(self) -> SiteView:
        """Return the manager's answer as it is now."""
        return SiteView(self.boot, self.event, tuple(self.views.values()), 3.0, self.alarms)

    def change(self, name: str = "lift", **changes: object) -> None:
        """Change a lift, and let the adapter hear it."""
        self.views[name] = replace(self.views[name], **changes)  # type: ignore[arg-type]
        self.report_site()

    def over(self, name: str = "lift") -> None:
        """The manager lets a session go."""
        self.change(name, holder=None, ending=False, destination=None)

    def receive(self, *requests: LiftRequest) -> None:
        """RMF sends these at one moment."""
        for request in requests:
            self.adapter.on_request(request, self.now)
        self.turn()
        self.step(0.0)

    def fleet(self, *requests: LiftRequest) -> None:
        """A fleet sends these to its lift supervisor at one moment."""
        for request in requests:
            self.adapter.on_fleet_request(request, self.now)
        self.turn()

    def step(self, seconds: float = 0.1) -> None:
        """Let a short time pass; the manager is heard at its end."""
        self.now += seconds
        self.report_site()

    def elapse(self, seconds: float) -> None:
        """Let time pass, the manager heard ten times a second."""
        for _ in range(round(seconds / 0.1)):
            self.step()

    @property
    def state(self) -> LiftState:
        """What was published last."""
        return self.published[-1]

    def demands(self) -> list[tuple[str, str]]:
        """Session and floor of everything wanted so far."""
        return [(one.session, one.floor) for one in self.sent_requests if isinstance(one, SessionDemand)]

    def ended_sessions(self) -> list[str]:
        return [one.session for one in self.sent_requests if isinstance(one, EndOfSession)]


def bench(**changes: object) -> Bench:
    """An adapter that has heard its manager."""
    made = Bench(**changes)  # type: ignore[arg-type]
    made.report_site()
    return made


def riding(**changes: object) -> Bench:
    """The lift stands at L2 with its door open and held for A."""
    made = bench(**changes)
    made.receive(wants(A, "Level 2"))
    made.change(floor="L2", door="open")
    made.step()
    return made
