"""Both neighbours of a running adapter, played by hand on the loop."""

import asyncio

from lift_manager.plain.rmf import Alarms, HeldBy, LiftView, SiteView
from lift_manager.rmf.dds import DdsListener
from lift_manager.rmf.messages import AGV_MODE, DOOR_OPEN, LiftRequest, LiftState, Time
from lift_manager.rmf.port import Answer, Deliver, ManagerListener, ManagerRequest, SessionDemand
from tests.lift_manager.rmf.bench import RecordedAlarms

REQUEST = LiftRequest("Lift1", Time(), "fleet/robot1", AGV_MODE, "L2", DOOR_OPEN)


def view(holder: HeldBy | None = None, **other: object) -> LiftView:
    said: dict[str, object] = {
        "lift": "main",
        "name": "Lift1",
        "floors": {"G": "L1", "First": "L2"},
        "live": True,
        "reason": "",
        "age_s": 0.1,
        "max_age_s": 1.0,
        "floor": "G",
        "standing": True,
        "destination": None,
        "door": "closed",
        "motion": "stopped",
        "mode": "normal",
        "robot_mode_on": None,
        "holder": holder,
        "ending": False,
        "fire_latched": False,
        "waiting_for": "",
        "keeps_off": "",
    }
    return LiftView(**said | other)  # type: ignore[arg-type]  # the fields, by name


class FakeRmf:
    """RMF's side: what was published when."""

    def __init__(self, listener: DdsListener, deliver: Deliver) -> None:
        self.listener, self.deliver = listener, deliver
        self.states: list[tuple[float, LiftState]] = []
        self.alarm = RecordedAlarms()
        self.closed = False

    def publish(self, state: LiftState) -> None:
        assert not self.closed
        self.states.append((asyncio.get_running_loop().time(), state))

    def close(self) -> None:
        self.closed = True

    def send(self, request: LiftRequest) -> None:
        self.deliver(lambda: self.listener.on_request(request))

    def send_of_fleet(self, request: LiftRequest) -> None:
        self.deliver(lambda: self.listener.on_fleet_request(request))


class FakeWay:
    """A manager that says yes at once, and tells how its lift is five times a second."""

    def __init__(self) -> None:
        self.asked: list[ManagerRequest] = []
        self.view = view()
        self.alarms = Alarms()
        self.closed = False
        self._number = 0

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        self.listener, self._deliver = listener, deliver
        self._tell()

    def send(self, asked: ManagerRequest) -> None:
        self.asked.append(asked)
        if isinstance(asked, SessionDemand):
            self.view = view(HeldBy("rmf", asked.session))
        self._number += 1
        answer = Answer(asked, accepted=True, boot="boot", event=self._number)
        self._deliver(lambda: self.listener.on_answer(answer, asyncio.get_running_loop().time()))

    def close(self) -> None:
        self.closed = True

    def lose(self) -> None:
        self._deliver(lambda: self.listener.on_manager_lost("it is switched off", asyncio.get_running_loop().time()))

    def tell(self, site: SiteView) -> None:
        now = asyncio.get_running_loop().time()
        self._deliver(lambda: self.listener.on_site(site, now, now))

    def _tell(self) -> None:
        if not self.closed:
            self.tell(SiteView("boot", self._number, (self.view,), 3.0, self.alarms))
            asyncio.get_running_loop().call_later(0.2, self._tell)
