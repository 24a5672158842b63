"""Minutes in which robots come through the doors of the program: /api/v1 sessions, rides and the workshop API, over HTTP without
a network. For recordings: what is asked for and answered is JSON, so that nothing here knows the manager's own values."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from random import Random
from typing import Any

import httpx

from lift_manager.lab.virtual_time import elapse
from lift_manager.lab.world.world import World
from lift_manager.web.app import make_app
from tests.campaigns.playing import BOARDS_S, LIFT
from tests.campaigns.schedules import Asks, RobotRides, Schedule

Json = Any
Hears = Callable[[float, dict[str, Json], dict[str, Json]], None]
"""Hears the time, the request and the reply."""
LOOKS_EVERY_S = 0.5
SAYS_EVERY_S = 2.0
OVER = frozenset({"done", "cancelled", "gave_up"})


@dataclass(frozen=True)
class Visit:
    """One robot, or one person, and what it wants."""

    at: float
    by: str
    """session, ride, workshop or person."""
    robot: str
    pickup: int
    destination: int
    for_s: float
    """It gives up after this time."""
    mute: bool
    """It falls silent once it is inside."""
    ends: bool
    """Whether it closes its session, or cancels its ride, when it gives up."""


def visits(seed: int) -> tuple[Visit, ...]:
    """Draw who comes in the minute of a seed."""
    random = Random(f"visits {seed}")
    found = []
    for number in range(random.choice((1, 2, 2, 3))):
        pickup = random.randrange(8)
        found.append(
            Visit(
                at=random.uniform(0.5, 4) if not number else random.uniform(3, 40),
                by=random.choice(("session", "session", "ride", "ride", "workshop", "person")),
                robot=random.choice(("r1", "r2")),
                pickup=pickup,
                destination=pickup + random.randrange(1, 4),
                for_s=random.choice((8.0, 30.0, 60.0, 60.0)),
                mute=random.random() < 0.15,
                ends=random.random() < 0.8,
            )
        )
    return tuple(found)


def with_visits(schedule: Schedule) -> Schedule:
    """Return the same minute without the robots that it has itself; they would only take the lift from the visitors."""
    others = tuple(event for event in schedule.events if not isinstance(event, RobotRides | Asks))
    return replace(schedule, events=others)


def actors(world: World, seed: int, hears: Hears) -> list[Coroutine[Any, Any, None]]:
    """Return what the visitors of a seed do."""
    client = Client(world, hears)
    return [_visit(client, visit, world.lifts[LIFT].floors) for visit in visits(seed)]


class Client:
    """Asks the manager that runs now, whichever that is after a restart."""

    def __init__(self, world: World, hears: Hears) -> None:
        self._world = world
        self._hears = hears
        self._manager: object = None
        self._app: Any = None

    async def post(self, path: str, body: Json, **query: str) -> tuple[int, Json]:
        """Return status and body of the answer."""
        return await self._call("POST", path, body, query)

    async def get(self, path: str, *, quiet: bool = False) -> tuple[int, Json]:
        """Return status and body of the answer; `quiet` leaves it out of the recording."""
        return await self._call("GET", path, None, {}, quiet=quiet)

    async def _call(
        self, method: str, path: str, body: Json, query: dict[str, str], *, quiet: bool = False
    ) -> tuple[int, Json]:
        if self._manager is not self._world.manager:
            self._manager, self._app = self._world.manager, make_app(self._world.manager)
        at = asyncio.get_running_loop().time()
        transport = httpx.ASGITransport(self._app, client=("127.0.0.1", 50000))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            answer = await client.request(method, path, json=body, params=query)
        said = answer.json()
        if not quiet:
            self._hears(at, {"request": f"{method} {path}", "body": body}, {"status": answer.status_code, "body": said})
        return answer.status_code, said


@asynccontextmanager
async def _given_up(after_s: float) -> AsyncIterator[None]:
    try:
        async with asyncio.timeout(after_s):
            yield
    except TimeoutError:
        return


async def _visit(client: Client, visit: Visit, floors: Sequence[str]) -> None:
    await elapse(visit.at)
    start, destination = floors[visit.pickup % len(floors)], floors[visit.destination % len(floors)]
    match visit.by:
        case "session":
            await _session(client, visit, start, destination)
        case "ride":
            await _ride(client, visit, start, destination)
        case "workshop":
            async with _given_up(visit.for_s):
                await _workshop(client, start, 12.0)
                await _workshop(client, destination, 12.0)
            await _ask(client, destination, 0)
        case _:
            await client.post(f"/api/v1/lifts/{LIFT}/lockout", {"by": "the guard", "reason": "moving furniture"})
            await elapse(5.0)
            await client.post(f"/api/v1/lifts/{LIFT}/lockout/end", {"by": "the guard"})
            await client.post(f"/api/v1/lifts/{LIFT}/acknowledge", {"by": "the guard"})
            await elapse(20.0)
            await client.post(
                f"/api/v1/lifts/{LIFT}/session/force-release", {"by": "the guard", "reason": "in the way"}
            )


async def _ask(client: Client, floor: str, door: int) -> None:
    await client.post("/open-rmf/demo-lift/lift_request", {"floor": floor, "door_state": door}, lift_name=LIFT)


async def _workshop(client: Client, floor: str, for_s: float) -> None:
    for _ in range(round(for_s)):
        await _ask(client, floor, 2)
        await elapse(1.0)


async def _session(client: Client, visit: Visit, start: str, destination: str) -> None:
    """Open a session, be brought from one floor to another, and close it; end where it is refused for good."""
    sessions = f"/api/v1/lifts/{LIFT}/sessions"
    wish = {"robot": visit.robot, "ttl_s": 20.0, "idempotency_key": f"{visit.robot}-{visit.at:.3f}"}
    opened: Json = None
    place = ""
    async with _given_up(visit.for_s):
        while opened is None:
            status, said = await client.post(sessions, wish)
            opened = said if status in (200, 201) else None
            await elapse(SAYS_EVERY_S if opened is None else 0.0)
        place = f"{sessions}/{opened['id']}"
        await client.post(f"{place}/commands", {"do": "go_to", "floor": start})
        await _until_open(client, place, start)
        await elapse(BOARDS_S)
        if visit.mute:
            return
        await client.post(f"{place}/commands", {"do": "robot_in_place"})
        await client.post(f"{place}/commands", {"do": "go_to", "floor": destination}, wait="2")
        await _until_open(client, place, destination)
        await elapse(BOARDS_S)
        await client.post(f"{place}/commands", {"do": "let_go_door"})
        await client.post(f"{place}/close", {"robot": "left"})
        return
    if place and visit.ends:
        await client.post(f"{place}/close", {})


async def _until_open(client: Client, place: str, floor: str) -> None:
    while True:
        status, _ = await client.post(f"{place}/renew", {})
        for _ in range(round(SAYS_EVERY_S / LOOKS_EVERY_S)):
            await elapse(LOOKS_EVERY_S)
            _, lift = await client.get(f"/api/v1/lifts/{LIFT}", quiet=True)
            if status == 200 and (lift["floor"], lift["robot_door"]) == (floor, "open"):
                return


async def _ride(client: Client, visit: Visit, start: str, destination: str) -> None:
    """Begin a ride and do what it is told, as a robot that takes its time through the door."""
    wish = {"lift": "any", "from": start, "to": destination, "robot": visit.robot}
    status, said = await client.post("/api/v1/rides", wish | {"idempotency_key": f"{visit.robot}-{visit.at:.3f}"})
    if status not in (200, 201, 202):
        return
    ride, inside = f"/api/v1/rides/{said['id']}", False
    async with _given_up(visit.for_s):
        while said.get("phase") not in OVER:
            await elapse(LOOKS_EVERY_S)
            _, said = await client.get(ride)
            if said.get("guidance") != ("leave" if inside else "enter"):
                continue
            await elapse(BOARDS_S)
            inside = not inside
            if visit.mute:
                return
            await client.post(f"{ride}/{'entered' if inside else 'left'}", {})
        return
    if visit.ends:
        await client.post(f"{ride}/cancel", {"reason": "it takes too long"})
