"""A checkout on virtual time: a simulated lift, managers that come and go, and a person who tells the truth about the lift."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import yaml

from drivers.modbus.wire import Wire
from lift_manager import app
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.states import open_at
from lift_manager.commissioning.checkout.engine import Checkout
from lift_manager.commissioning.checkout.person import NO, YES, Prompt, Question, Reply
from lift_manager.commissioning.checkout.plan import lift_digest, make_plan
from lift_manager.commissioning.checkout.record import (
    Controller,
    Item,
    MapIdentity,
    People,
    Person,
    Record,
    Stage,
    now,
)
from lift_manager.commissioning.checkout.registers import Registers
from lift_manager.commissioning.prober import Prober
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.lab.plant import simulated_lift
from lift_manager.lab.world.device import MemoryController
from lift_manager.lab.world.wire import FaultyWire
from lift_manager.web.app import make_app
from register_maps.codec import Codec, compile_map
from register_maps.load import MAPS, load
from register_maps.words import Door, Mode, Side, Table
from simulator.faults import Fault, Reboot, RobotModeWithdrawn
from simulator.modes import Key
from simulator.registers import ILLEGAL_ADDRESS, ExceptionReply, RegisterFace
from simulator.state import Parameters, ShownState
from simulator.wire_faults import WireFaults
from tests.support.asgi_streams import AsgiStreams

LIFT = "lift1"
FLOORS = {"L1": 0, "L2": 1, "L3": 2}
Change = Callable[[dict[str, Any]], None]


@dataclass
class Wiring:
    """The device at its terminals, where wires can be broken and outputs of the simulator be swapped."""

    face: RegisterFace
    forced: dict[tuple[Table, int], int] = field(default_factory=dict)
    """What reads the same whatever the lift does: broken and stuck inputs."""
    drifting: set[tuple[Table, int]] = field(default_factory=set)
    """Inputs that change by themselves every few seconds."""
    refused: set[tuple[Table, int]] = field(default_factory=set)
    """Addresses that the controller does not let anybody write: it answers exception 02."""

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        cells = self.face.read(table, address, count, now)
        for index in range(count):
            if (table, address + index) in self.drifting:
                cells[index] = int(now / 7) % 2
            cells[index] = self.forced.get((table, address + index), cells[index])
        return cells

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        if any((table, address + index) in self.refused for index in range(len(values))):
            raise ExceptionReply(ILLEGAL_ADDRESS)
        self.face.write(table, address, values, now)

    def mask_write(self, address: int, keep: int, put: int, now: float) -> None:
        self.face.mask_write(address, keep, put, now)

    def pulse(self, address: int, counts: int, now: float) -> None:
        self.face.pulse(address, counts, now)


def site_of(
    folder: Path, map_name: str = "generic-coils", floors: Mapping[str, int] = FLOORS, **lift: Any
) -> LoadedSite:
    path = folder / "site.yaml"
    # less often than by default, because a checkout asks over HTTP after each poll; nothing here is over sooner
    seen = {"access": "control", "poll_s": 0.8, "max_age_s": 2}
    site = {
        "schema": 1,
        "name": "bench",
        "controllers": {"plc": {"host": "192.0.2.5", "map": map_name}},
        "lifts": {LIFT: {"controller": "plc", "floors": dict(floors), **seen, **lift}},
    }
    path.write_text(json.dumps(site))
    return load_site(path)


def wired_otherwise(folder: Path, map_name: str, change: Change) -> Codec:
    """The map by which the lift is really wired: the one of the site, changed."""
    data = yaml.safe_load((MAPS / f"{map_name}.yaml").read_text("utf-8"))
    change(data)
    path = folder / "wired.yaml"
    path.write_text(yaml.safe_dump(data))
    return compile_map(load(path).map)


class Rig:
    """One simulated lift at the end of memory wires, and the access of a checkout to it."""

    def __init__(self, loaded: LoadedSite, *, wired: Codec | None = None, settings: Parameters | None = None) -> None:
        self.loaded = loaded
        self.codec = loaded.codecs[LIFT]
        self.floors = {name: floor.code for name, floor in loaded.site.lifts[LIFT].floors.items()}
        self.wired = wired or self.codec
        self.face = simulated_lift(self.wired, self.floors, like=settings)
        self.wiring = Wiring(self.face)
        self.controller = MemoryController({1: cast("RegisterFace", self.wiring)}, lambda _: None)
        self.faults = WireFaults(seed=0)
        self.running: list[asyncio.Task[None]] = []
        self.managers = 0

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def people(self, **changes: Any) -> None:
        self.face.people(self.now, replace(self.face.inputs, **changes))

    def begin(self, fault: Fault) -> None:
        self.face.begin(fault, self.now)

    def end(self, fault: Fault) -> None:
        self.face.end(fault, self.now)

    @asynccontextmanager
    async def manager(self) -> AsyncIterator[LiftManagerClient]:
        parts = app.build(self.loaded, self._wire)
        self.managers += 1
        self.running = [
            asyncio.create_task(part)
            for part in (*(link.run() for link in parts.links), *parts.life.drives(), parts.life.run())
        ]
        try:
            await parts.life.first_look()
            web = make_app(parts.site, frames=parts.sources, streams=16)
            async with LiftManagerClient("http://127.0.0.1", transport=AsgiStreams(web)) as client:
                yield client
        finally:
            if self.running:
                await parts.life.stop()
                await self._end()

    @asynccontextmanager
    async def registers(self) -> AsyncIterator[Registers]:
        prober = Prober(self._wire())
        try:
            await prober.connect()
            yield Registers(self.codec, {"": (prober, 1)}, self.codec.map.link)
        finally:
            prober.close()

    @asynccontextmanager
    async def holder(self, floor: str) -> AsyncIterator[_Holder]:
        async with AsyncExitStack() as stack:
            client = await stack.enter_async_context(self.manager())
            session = await stack.enter_async_context(client.session(LIFT, robot="holder"))
            await session.go_to(floor, hold_door=True, wait=60.0)
            async with asyncio.timeout(60.0):
                await session.until(open_at(floor))
            holder = _Holder(self, stack)
            yield holder
            if holder.killed:
                stack.pop_all()

    async def kill(self) -> None:
        await self._end()
        self.controller.hang_up()

    async def _end(self) -> None:
        running, self.running = self.running, []
        for task in running:
            task.cancel()
        await asyncio.wait(running)

    def _wire(self, _: object = None) -> Wire:
        return FaultyWire(self.controller, self.faults, peer="plc")


@dataclass
class _Holder:
    rig: Rig
    stack: AsyncExitStack
    killed: bool = False

    async def kill(self) -> None:
        await self.rig.kill()
        await self.stack.pop_all().aclose()
        self.killed = True


class TruthfulPerson:
    """Does what is asked on the simulated lift, and answers what it really does, whatever its registers show."""

    def __init__(self, rig: Rig, replies: Mapping[tuple[Prompt, str], Reply] | None = None) -> None:
        self.rig = rig
        self.questions: list[Question] = []
        self.told: list[str] = []
        self._replies = replies or {}
        self._floor = ""

    def show(self, text: str) -> None:
        self.told.append(text)

    async def answer(self, question: Question) -> Reply:
        self.questions.append(question)
        await asyncio.sleep(1.0)
        self.rig.face.advance(self.rig.now)
        if (known := self._replies.get((question.topic, question.subject))) is not None:
            return known
        word = await self._do(question)
        if isinstance(word, bool):
            word = YES if word else NO
        return Reply(word)

    async def _do(self, question: Question) -> str | bool:  # noqa: C901, PLR0911, PLR0912  a line for each question
        rig, value, subject = self.rig, question.value, question.subject
        match question.topic:
            case Prompt.MAKE:
                await self._make(subject, value)
            case Prompt.DISCONNECT:
                for point in rig.codec.signals[subject].points:
                    rig.wiring.forced[point.table, point.address] = 0
            case Prompt.RECONNECT:
                for point in rig.codec.signals[subject].points:
                    del rig.wiring.forced[point.table, point.address]
            case Prompt.SEND:
                await self._send(value)
            case Prompt.WHERE:
                return list(rig.floors)[self._picture.floor]
            case Prompt.DOOR | Prompt.HOLDS:
                return self._is_open(question.subject)
            case Prompt.CLOSED:
                await asyncio.sleep(8.0)
                return not self._is_open(question.subject)
            case Prompt.SERVES:
                await asyncio.sleep(20.0)
                return not self._is_open("front")
            case Prompt.STAYED:
                return list(rig.floors)[self._picture.floor] == self._floor
            case Prompt.SHOWN:
                return self._is_true(subject)
            case Prompt.CABLE:
                rig.controller.switch(on=value == "in")
            case Prompt.POWER:
                (rig.end if value == "on" else rig.begin)(Reboot(homes=False))
                rig.controller.switch(on=value == "on")
            case Prompt.FIRE:
                rig.people(fire=value == "on")
                await asyncio.sleep(5.0)
            case Prompt.LANDING:
                await asyncio.sleep(10.0)
                self._floor = list(rig.floors)[self._picture.floor]
                await self._press("landing_buttons", value)
            case Prompt.WITHDRAW:
                (rig.begin if value == "on" else rig.end)(RobotModeWithdrawn())
            case Prompt.RIDER:
                return "empty"
            case Prompt.AGAIN:
                return False
            case Prompt.PRECONDITION | Prompt.CLOSING if question.is_text:
                return "" if subject == "as_built" else f"the {subject}"
            case Prompt.CLOSING if "A" in question.choices:
                return "B"
            case _:
                return True
        return ""

    @property
    def _picture(self) -> ShownState:
        self.rig.face.advance(self.rig.now)
        return self.rig.face.picture

    def _is_open(self, side: str) -> bool:
        return bool(self._picture.doors[Side(side)] is Door.OPEN)

    def _is_true(self, subject: str) -> bool:
        rig = self.rig
        if subject == "robot_mode":
            return bool(self._picture.robot_mode_on)
        if subject == "fire":
            return bool(self._picture.mode is Mode.FIRE)
        image = rig.codec.empty_image()
        for space, spans in rig.codec.served.items():
            for span in spans:
                image[space][span.start : span.stop] = rig.wiring.read(Table(space), span.start, len(span), rig.now)
        return all(
            rig.codec.signals[name].decode(rig.codec.signals[name].extract(image))
            == rig.wired.signals[name].decode(rig.wired.signals[name].extract(image))
            for name in subject.split()
        )

    async def _make(self, name: str, value: str) -> None:
        on, rig = value == YES, self.rig
        match name:
            case "fire":
                rig.people(fire=on)
            case "overload":
                rig.people(overload=on)
            case "emergency_power":
                rig.people(emergency=on)
            case "robots_allowed":
                rig.people(robots_allowed=on)
            case "inspection" | "independent" | "out_of_service":
                rig.people(key=Key(name) if on else Key.NORMAL)
            case "mode":
                rig.people(key=Key(value) if value in set(Key) else Key.NORMAL)
            case _ if name.startswith("obstruction."):
                rig.people(obstruction=frozenset({Side(name.partition(".")[2])} if on else ()))
            case _ if name.startswith("door."):
                side = Side(name.partition(".")[2])
                rig.people(hold_door=frozenset({side} if value == "open" else ()))
                await asyncio.sleep(15.0)
            case _:
                raise AssertionError(f"nobody can make {name} {value}")
        await asyncio.sleep(1.0)

    async def _send(self, floor: str) -> None:
        await self._press("car_buttons", floor)
        index = list(self.rig.floors).index(floor)
        for _ in range(240):
            await asyncio.sleep(0.5)
            if self._picture.level_floor == index and self._picture.doors[Side.FRONT] is Door.CLOSED:
                return
        raise AssertionError(f"the car did not come to {floor}")

    async def _press(self, buttons: str, floor: str) -> None:
        index = list(self.rig.floors).index(floor)
        self.rig.people(**{buttons: frozenset({index})})
        await asyncio.sleep(1.0)
        self.rig.people(**{buttons: frozenset()})


def new_record(loaded: LoadedSite, items: tuple[Item, ...], stage: Stage = Stage.SAT) -> Record:
    return Record(
        stage=stage,
        site=loaded.site.name,
        lift=LIFT,
        floors={name: floor.code for name, floor in loaded.site.lifts[LIFT].floors.items()},
        map=MapIdentity(
            name=loaded.maps[LIFT].map.name, sha256=loaded.maps[LIFT].sha256, lift_sha256=lift_digest(loaded, LIFT)
        ),
        controller=Controller(name="plc", host="192.0.2.5", port=502, unit=1),
        versions={},
        people=People(run_by=Person(name="Ana"), technician=Person(name="Bo")),
        items=items,
        started_at=now(),
    )


async def check_out(
    rig: Rig,
    ids: Sequence[str] = (),
    *,
    person: TruthfulPerson | None = None,
    save: Callable[[Record], None] = lambda _: None,
    stage: Stage = Stage.SAT,
) -> Record:
    """Run some items, or all of them, with a truthful person; return the record."""
    items = make_plan(rig.loaded, LIFT, stage, trips=3)
    record = new_record(rig.loaded, items, stage)
    checkout = Checkout(record, save, person or TruthfulPerson(rig), rig, rig.codec, ["plc"])
    await checkout.run([item for item in items if not ids or item.id in ids])
    return checkout.record


__all__ = ["FLOORS", "LIFT", "Rig", "TruthfulPerson", "check_out", "new_record", "site_of", "wired_otherwise"]
