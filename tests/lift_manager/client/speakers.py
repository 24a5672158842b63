"""Two ways to speak to a manager that have to come to the same: HTTP by hand, and the typed client."""

import json
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from typing import Any, Protocol

import httpx
from pydantic import BaseModel

from lift_manager.api.rides import RideRequest
from lift_manager.api.sessions import CommandRequest
from lift_manager.client import LiftManagerClient, Refused
from lift_manager.rides.ride import RideWord
from tests.support.programs import HANGS_S

Said = dict[str, Any]
"""An answer as JSON; a refusal is its problem+json."""


class Speaker(Protocol):
    """What both can say. Names of lifts are given as they are."""

    async def lifts(self) -> Said: ...
    async def lift(self, lift: str) -> Said: ...
    async def capabilities(self, lift: str) -> Said: ...
    async def signals(self, lift: str) -> Said: ...
    async def open(self, lift: str, robot: str, key: str) -> Said: ...
    async def session(self, lift: str, session: str) -> Said: ...
    async def renew(self, lift: str, session: str, ttl_s: float) -> Said: ...
    async def command(self, lift: str, session: str, wish: Said, wait: float) -> Said: ...
    async def followed(self, lift: str, session: str, command: str, wait: float) -> Said: ...
    async def hand_over(self, lift: str, session: str, to: str) -> Said: ...
    async def close(self, lift: str, session: str) -> Said: ...
    async def begin(self, wish: Said) -> Said: ...
    async def plan(self, wish: Said) -> Said: ...
    async def ride(self, ride: str) -> Said: ...
    async def word(self, ride: str, word: str) -> Said: ...
    async def cancel(self, ride: str, reason: str) -> Said: ...
    async def person(self, lift: str, what: str, by: str, reason: str = "") -> Said: ...
    async def first_event(self, lift: str) -> Said: ...


class ByHand:
    """HTTP as somebody writes it who has read no more than the documentation."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http

    async def lifts(self) -> Said:
        return await self._get("lifts")

    async def lift(self, lift: str) -> Said:
        return await self._get(f"lifts/{lift}")

    async def capabilities(self, lift: str) -> Said:
        return await self._get(f"lifts/{lift}/capabilities")

    async def signals(self, lift: str) -> Said:
        return await self._get(f"lifts/{lift}/signals")

    async def open(self, lift: str, robot: str, key: str) -> Said:
        return await self._post(f"lifts/{lift}/sessions", {"robot": robot, "idempotency_key": key})

    async def session(self, lift: str, session: str) -> Said:
        return await self._get(f"lifts/{lift}/sessions/{session}")

    async def renew(self, lift: str, session: str, ttl_s: float) -> Said:
        return await self._post(f"lifts/{lift}/sessions/{session}/renew", {"ttl_s": ttl_s})

    async def command(self, lift: str, session: str, wish: Said, wait: float) -> Said:
        return await self._post(f"lifts/{lift}/sessions/{session}/commands?wait={wait:g}", wish)

    async def followed(self, lift: str, session: str, command: str, wait: float) -> Said:
        return await self._get(f"lifts/{lift}/sessions/{session}/commands/{command}?wait={wait:g}")

    async def hand_over(self, lift: str, session: str, to: str) -> Said:
        return await self._post(f"lifts/{lift}/sessions/{session}/hand-over", {"to": to})

    async def close(self, lift: str, session: str) -> Said:
        return await self._post(f"lifts/{lift}/sessions/{session}/close", {})

    async def begin(self, wish: Said) -> Said:
        return await self._post("rides", wish)

    async def plan(self, wish: Said) -> Said:
        return await self._post("rides", wish | {"dry_run": True})

    async def ride(self, ride: str) -> Said:
        return await self._get(f"rides/{ride}")

    async def word(self, ride: str, word: str) -> Said:
        return await self._post(f"rides/{ride}/{word}", {})

    async def cancel(self, ride: str, reason: str) -> Said:
        return await self._post(f"rides/{ride}/cancel", {"reason": reason})

    async def person(self, lift: str, what: str, by: str, reason: str = "") -> Said:
        return await self._post(f"lifts/{lift}/{what}", {"by": by} | ({"reason": reason} if reason else {}))

    async def first_event(self, lift: str) -> Said:
        async with self._http.stream("GET", "events", params={"lift": lift}) as response:
            assert response.headers["content-type"].startswith("text/event-stream")
            async for line in response.aiter_lines():
                if line.startswith("data:"):
                    found: Said = json.loads(line[5:])
                    return found
        raise AssertionError("the stream ended")

    async def _get(self, path: str) -> Said:
        return self._read(await self._http.get(path))

    async def _post(self, path: str, body: Said) -> Said:
        return self._read(await self._http.post(path, json=body))

    def _read(self, response: httpx.Response) -> Said:
        said: Said = response.json()
        kind = "application/json" if response.is_success else "application/problem+json"
        assert response.headers["content-type"] == kind
        assert response.is_success or said["status"] == response.status_code
        return said


class Typed:
    """The client."""

    def __init__(self, client: LiftManagerClient) -> None:
        self._client = client

    async def lifts(self) -> Said:
        return {"lifts": [lift.model_dump(mode="json") for lift in await self._client.lifts()]}

    async def lift(self, lift: str) -> Said:
        return await _dumped(self._client.lift(lift))

    async def capabilities(self, lift: str) -> Said:
        return await _dumped(self._client.capabilities(lift))

    async def signals(self, lift: str) -> Said:
        return await _dumped(self._client.signals(lift))

    async def open(self, lift: str, robot: str, key: str) -> Said:
        return await _dumped(self._client.open_session(lift, robot=robot, key=key))

    async def session(self, lift: str, session: str) -> Said:
        return await _dumped(self._client.get_session(lift, session))

    async def renew(self, lift: str, session: str, ttl_s: float) -> Said:
        return await _dumped(self._client.renew_session(lift, session, ttl_s=ttl_s))

    async def command(self, lift: str, session: str, wish: Said, wait: float) -> Said:
        return await _dumped(self._client.command(lift, session, CommandRequest.model_validate(wish), wait=wait))

    async def followed(self, lift: str, session: str, command: str, wait: float) -> Said:
        return await _dumped(self._client.get_command(lift, session, command, wait=wait))

    async def hand_over(self, lift: str, session: str, to: str) -> Said:
        return await _dumped(self._client.hand_over_session(lift, session, to))

    async def close(self, lift: str, session: str) -> Said:
        return await _dumped(self._client.close_session(lift, session, robot=None))

    async def begin(self, wish: Said) -> Said:
        return await _dumped(self._client.begin_ride(RideRequest.model_validate(wish)))

    async def plan(self, wish: Said) -> Said:
        return await _dumped(self._client.plan_ride(RideRequest.model_validate(wish)))

    async def ride(self, ride: str) -> Said:
        return await _dumped(self._client.get_ride(ride))

    async def word(self, ride: str, word: str) -> Said:
        return await _dumped(self._client.ride_word(ride, RideWord(word)))

    async def cancel(self, ride: str, reason: str) -> Said:
        return await _dumped(self._client.cancel_ride(ride, reason))

    async def person(self, lift: str, what: str, by: str, reason: str = "") -> Said:
        match what:
            case "acknowledge":
                return await _dumped(self._client.acknowledge(lift, by))
            case "lockout":
                return await _dumped(self._client.lock_out(lift, by, reason))
            case "lockout/end":
                return await _dumped(self._client.end_lockout(lift, by))
            case _:
                return await _dumped(self._client.force_release(lift, by, reason))

    async def first_event(self, lift: str) -> Said:
        async with self._client.events(lift=lift) as events:
            async for event in events:
                if isinstance(event, BaseModel):
                    return event.model_dump(mode="json", by_alias=True)
        raise AssertionError("the stream ended")


async def _dumped(asked: Awaitable[BaseModel]) -> Said:
    try:
        return (await asked).model_dump(mode="json", by_alias=True)
    except Refused as error:
        return error.problem.model_dump(mode="json", exclude_none=True)


@asynccontextmanager
async def by_hand(url: str) -> AsyncIterator[Speaker]:
    async with httpx.AsyncClient(base_url=f"{url}/api/v1/", trust_env=False, timeout=HANGS_S) as http:
        yield ByHand(http)


@asynccontextmanager
async def typed(url: str) -> AsyncIterator[Speaker]:
    async with LiftManagerClient(url) as client:
        yield Typed(client)


__all__ = ["Said", "Speaker", "by_hand", "typed"]
