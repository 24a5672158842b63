"""Minutes in which robots come through the doors of the program: /api/v1 sessions, rides and the workshop API, over HTTP without
a network. For recordings: what is asked for and answered is JSON, so that nothing here knows the manager's own values."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
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
    return tuple(_draw(random, first=not number) for number in range(random.choice((1, 2, 2, 3))))


def _draw(random: Random, *, first: bool) -> Visit:
    return Visit(
        at=random.uniform(0.5, 4) if first else random.uniform(3, 40),
        by=random.choice(("session", "session", "ride", "ride", "workshop", "person")),
        robot=random.choice(("r1", "r2")),
        pickup=random.randrange(8),
        destination=random.randrange(8),
        for_s=random.choice((8.0, 30.0, 60.0, 60.0)),
        mute=random.random() < 0.15,
        ends=random.random() < 0.8,
    )


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
        self._site: object = None
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
        if self._site is not self._world.site:
            self._site, self._app = self._world.site, make_app(self._world.site)
        at = asyncio.get_running_loop().time()
        transport = httpx.ASGITransport(self._app, client=("127.0.0.1", 50000))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            answer = await client.request(method, path, json=body, params=query)
        said = answer.json()
        if not quiet:
            self._hears(at, {"request": f"{method} {path}", "body": body}, {"status": answer.status_code, "body": said})
        return answer.status_code, said


async def _in_time(seconds: float, doing: Coroutine[Any, Any, None]) -> bool:
    """Return whether it was done within so many seconds; what was not is given up."""
    try:
        async with asyncio.timeout(seconds):
            await doing
        return True
    except TimeoutError:
        return False


async def _visit(client: Client, visit: Visit, floors: Sequence[str]) -> None:
    await elapse(visit.at)
    start = floors[visit.pickup % len(floors)]
    elsewhere = [floor for floor in floors if floor != start]
    destination = elsewhere[visit.destination % len(elsewhere)]
    match visit.by:
        case "session":
            await _session(client, visit, start, destination)
        case "ride":
            await _ride(client, visit, start, destination)
        case "workshop":
            await _in_time(visit.for_s, _workshop(client, (start, destination)))
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


async def _workshop(client: Client, floors: Sequence[str]) -> None:
    for floor in floors:
        for _ in range(12):
            await _ask(client, floor, 2)
            await elapse(1.0)


async def _session(client: Client, visit: Visit, start: str, destination: str) -> None:
    """Open a session and be brought from one floor to another; close it, unless it falls silent."""
    places: list[str] = []
    done = await _in_time(visit.for_s, _trip(client, visit, (start, destination), places))
    if places and visit.ends and not done:
        await client.post(f"{places[0]}/close", {})


async def _trip(client: Client, visit: Visit, floors: tuple[str, str], places: list[str]) -> None:
    """Where the session is goes into `places`."""
    sessions = f"/api/v1/lifts/{LIFT}/sessions"
    wish = {"robot": visit.robot, "ttl_s": 20.0, "idempotency_key": f"{visit.robot}-{visit.at:.3f}"}
    while not places:
        status, said = await client.post(sessions, wish)
        if status in (200, 201):
            places.append(f"{sessions}/{said['id']}")
        else:
            await elapse(SAYS_EVERY_S)
    (place,), (start, destination) = places, floors
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


async def _until_open(client: Client, place: str, floor: str) -> None:
    while True:
        status, _ = await client.post(f"{place}/renew", {})
        for _ in range(round(SAYS_EVERY_S / LOOKS_EVERY_S)):
            await elapse(LOOKS_EVERY_S)
            _, lift = await client.get(f"/api/v1/lifts/{LIFT}", quiet=True)
            if status == 200 and (lift["floor"], lift["robot_door"]) == (floor, "open"):
                return


async def _ride(client: Client, visit: Visit, start: str, destination: str) -> None:
    """Begin a ride and follow it; cancel it where it takes too long."""
    wish = {"lift": "any", "from": start, "to": destination, "robot": visit.robot}
    status, said = await client.post("/api/v1/rides", wish | {"idempotency_key": f"{visit.robot}-{visit.at:.3f}"})
    if status not in (200, 201, 202):
        return
    ride = f"/api/v1/rides/{said['id']}"
    done = await _in_time(visit.for_s, _follow(client, visit, ride))
    if visit.ends and not done:
        await client.post(f"{ride}/cancel", {"reason": "it takes too long"})


async def _follow(client: Client, visit: Visit, ride: str) -> None:
    """Do what a ride says, as a robot that takes its time through the door."""
    inside = False
    while True:
        await elapse(LOOKS_EVERY_S)
        _, said = await client.get(ride)
        if said.get("phase") in OVER:
            return
        if said.get("guidance") != ("leave" if inside else "enter"):
            continue
        await elapse(BOARDS_S)
        inside = not inside
        if visit.mute:
            return
        await client.post(f"{ride}/{'entered' if inside else 'left'}", {})
