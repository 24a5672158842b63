"""Panels in memory, on virtual time, and what is requested of them."""

from collections.abc import Awaitable, Callable
from typing import Any

import httpx

from lift_manager.lab.panel.app import make_panel
from lift_manager.lab.panel.lift import PanelLift
from lift_manager.lab.plant import default_floors
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse, run_virtual

Json = dict[str, Any]
HOST = "http://127.0.0.1:5004"


def paneled(map_name: str = "generic-registers", *, speed: float = 1.0) -> PanelLift:
    """A lift with the usual floors of a shipped map, by the name of that map; not on any network."""
    codec = compiled(map_name)
    return PanelLift(map_name, codec, default_floors(codec.map), speed=speed)


class Desk:
    """Somebody at the panel of one lift."""

    def __init__(self, lift: PanelLift, client: httpx.AsyncClient) -> None:
        self.lift = lift
        self.client = client

    async def state(self) -> Json:
        found: Json = (await self.client.get(f"/lifts/{self.lift.name}")).raise_for_status().json()
        return found

    async def does(self, control: str, **body: Any) -> Json:
        """Use a control, which is accepted; returns the lift after it."""
        answer = await self.client.post(f"/lifts/{self.lift.name}/{control}", json=body)
        assert answer.status_code == 200, answer.text
        found: Json = answer.json()
        return found

    async def refused(self, control: str, **body: Any) -> tuple[int, str]:
        answer = await self.client.post(f"/lifts/{self.lift.name}/{control}", json=body)
        return answer.status_code, str(answer.json()["detail"])

    async def becomes(self, condition: Callable[[Json], bool], within_s: float = 60.0) -> Json:
        """Look four times a second, as the page does, until the lift is as it should be."""
        for _ in range(round(within_s * 4)):
            if condition(state := await self.state()):
                return state
            await elapse(0.25)
        raise AssertionError(f"not within {within_s:g} s: {await self.state()}")


def at_desk(work: Callable[[Desk], Awaitable[None]], map_name: str = "generic-registers") -> None:
    """Let somebody work at the panel of a lift."""

    async def main() -> None:
        lift = paneled(map_name)
        transport = httpx.ASGITransport(make_panel([lift]))
        async with httpx.AsyncClient(transport=transport, base_url=HOST) as client:
            await work(Desk(lift, client))
        lift.controls.close()

    run_virtual(main)


def register(state: Json, name: str) -> Json:
    """The register of a signal or a command."""
    found: Json = next(one for one in state["registers"] if one["name"] == name)
    return found
