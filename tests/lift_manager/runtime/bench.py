"""A site of one lift over a scripted driver, on virtual time."""

import asyncio
from asyncio import Future
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace

from drivers.model import Capabilities, LiftValues
from lift_manager.domain.journal import Row, RowKind
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.lift.trust import Trust
from lift_manager.runtime.actor import LiftActor, LiftSettings
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import MemoryRecorder, Recorder
from lift_manager.runtime.site import Site
from register_maps.words import Door, Mode, Side
from tests.lift_manager.core.scripted import PLAIN, ScriptedDriver
from tests.support.virtual_time import elapse, run_virtual

FRONT = Side.FRONT
FLOORS = ("L1", "L2", "L3")
ROBOT, OTHER = Holder("api", "fleet/robot1"), Holder("api", "fleet/robot2")
PROVEN = DurableRecord(trust=Trust(PLAIN.map_hash, door_proven=True))
"""An earlier trip has proved the door signal."""


class SlowRecorder(MemoryRecorder):
    """Puts on its disk what the test lets it."""

    def __init__(self, records: Mapping[str, DurableRecord] | None = None) -> None:
        super().__init__(records)
        self.waiting: list[Future[str | None]] = []
        self.unwritten: list[Future[None]] = []

    def before(self, row: Row) -> Future[str | None]:
        self.note(row)
        self.waiting.append(asyncio.get_running_loop().create_future())
        return self.waiting[-1]

    def written(self, lift: str) -> Future[None] | None:
        self.unwritten.append(asyncio.get_running_loop().create_future())
        return self.unwritten[-1]

    async def commit(self, failure: str | None = None) -> None:
        """Answer everything that waits."""
        for answer in self.waiting:
            answer.set_result(failure)
        self.waiting.clear()
        await elapse(0.2)


@dataclass
class Bench:
    """One running lift."""

    driver: ScriptedDriver
    actor: LiftActor
    site: Site
    life: SiteLife
    recorder: Recorder
    bus: Bus[Event]
    events: list[Event] = field(default_factory=list)
    running: list[asyncio.Task[None]] = field(default_factory=list)

    @property
    def state(self) -> LiftState:
        return self.site.state("lift")

    def door(self) -> RobotDoor:
        return self.state.robot_door

    def holder(self) -> Holder | None:
        return self.state.holder

    @property
    def pressing(self) -> list[str]:
        """Texts of the rows that presses wait for."""
        return [row.text for row in self.rows if row.kind is RowKind.PRESS]

    @property
    def rows(self) -> list[Row]:
        """Of a recorder in memory."""
        assert isinstance(self.recorder, MemoryRecorder)
        return self.recorder.rows

    def ask(self, floor: str, *, hold: bool = True, holder: Holder = ROBOT) -> None:
        self.site.request("lift", holder, floor, hold_door=hold)

    def heard(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]

    async def car(self, floor: str | None, door: Door) -> None:
        """Let the lift say this, and time pass until the manager has read it."""
        flags = {"may_enter": True, "may_leave": True} if door is Door.OPEN else {}
        self.driver.values = replace(self.driver.values, floor=floor, doors={FRONT: door}, flags=flags)
        await elapse(0.5)

    async def called_to(self, floor: str) -> None:
        """Call the car and let it arrive with its door open and held."""
        self.ask(floor)
        await elapse(0.5)
        await self.car(None, Door.CLOSED)
        await self.car(floor, Door.OPEN)


def on_lift(
    check: Callable[[Bench], Awaitable[None]],
    able: Capabilities = PLAIN,
    *,
    recorder: Recorder | None = None,
    site: Mapping[str, object] | None = None,
    left_on: frozenset[str] = frozenset(),
    takes_s: float = 0.0,
) -> None:
    """Run a check. The car stands at L2 with its door shut; `left_on` is what an earlier manager left on."""

    async def main() -> None:
        store: Recorder = recorder or MemoryRecorder({"lift": PROVEN})
        values = LiftValues(floor="L2", mode=Mode.NORMAL, doors={FRONT: Door.CLOSED})
        driver = ScriptedDriver(able, values, left_on=left_on, takes_s=takes_s)
        config = LiftConfig(
            name="lift",
            source=driver.source,
            floors=FLOORS,
            doors_at=dict.fromkeys(FLOORS, (FRONT,)),
            control=True,
            capabilities=driver.capabilities,
            **{"between_sessions_s": 0.0, **(site or {})},  # type: ignore[arg-type]  # settings of the site by name
        )
        bus: Bus[Event] = Bus()
        actor = LiftActor(driver, config, bus, store, settings=LiftSettings(poll_s=0.1))
        one = Site([actor], bus, store)
        made = Bench(driver, actor, one, SiteLife(one, [actor]), store, bus)
        with bus.tap(lambda _, event: made.events.append(event)):
            made.running = [asyncio.ensure_future(work) for work in (*made.life.drives(), made.life.run())]
            await elapse(0.5)
            try:
                await check(made)
            finally:
                for work in made.running:
                    work.cancel()
                await asyncio.gather(*made.running, return_exceptions=True)

    run_virtual(main, limit_s=7200)
