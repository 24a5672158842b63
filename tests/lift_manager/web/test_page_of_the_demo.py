"""The page of the demo in a real browser: a ride, people, a lost controller, and a fire that an operator acknowledges."""

import asyncio
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.support.devtools import Tab, chromium
from tests.support.programs import HANGS_S, Started

pytestmark = pytest.mark.external("chromium")


async def ride_of_a_robot(api: httpx.AsyncClient, tab: Tab) -> None:
    """Ride with the first lift as a robot that does what it is told."""
    ride: dict[str, Any] = (
        await api.post("rides", json={"lift": "lift", "robot": "amr-7", "from": "L1", "to": "L2"})
    ).json()
    path = f"rides/{ride['id']}"
    for guidance, words, report in (("enter", "boarding, enters", "entered"), ("leave", "leaving the car", "left")):
        await tab.until(f"document.querySelector('dialog').innerText.includes('{words}')")
        assert (await api.get(path)).json()["guidance"] == guidance
        (await api.post(f"{path}/{report}", json={})).raise_for_status()
    await tab.until("document.querySelector('dialog').innerText.includes('Nobody holds it')")
    assert (await api.get(path)).json()["guidance"] == "done"


async def acknowledge(tab: Tab) -> None:
    """Press the button, and fill in its form, in the details of a lift."""
    button = "[...document.querySelectorAll('dialog button')].find((one) => one.innerText === 'Acknowledge')"
    await tab.until(f"{button}")
    await tab.value(f"{button}.click()")
    await tab.until("document.querySelector('.decision input')")
    await tab.value("document.querySelector('.decision input').focus()")
    await tab.type("M. Weber")
    await tab.value("document.querySelector('.decision .check input').click()")
    await tab.value("document.querySelector('.decision button').click()")
    await tab.sees("Acknowledged.")


def test_the_page_shows_what_happens_to_the_lifts_of_the_demo(tmp_path: Path) -> None:
    async def use(base: str, panel: str) -> None:
        async with (
            httpx.AsyncClient(base_url=f"{base}/api/v1/", trust_env=False, timeout=HANGS_S) as api,
            httpx.AsyncClient(base_url=f"{panel}/lifts/", trust_env=False, timeout=HANGS_S) as lifts,
            chromium(tmp_path) as tab,
        ):
            await tab.open(f"{base}/?lang=en")
            await tab.until("document.querySelectorAll('.card:not(.unknown) .watermark').length === 3")
            await tab.value("document.querySelector('[data-lift=lift] .open').click()")
            await tab.until("document.querySelector('dialog tbody td')")
            await ride_of_a_robot(api, tab)
            await tab.sees("Call to L2 (amr-7): done")

            await lifts.post("lift/inputs", json={"obstruction": ["front"], "overload": True})
            await tab.sees("something in the door, too much load")
            await lifts.post("lift/inputs", json={"obstruction": [], "overload": False})

            await lifts.post("tower/faults/begin", json={"name": "drop_request", "values": {}})
            await tab.until("document.querySelector('[data-lift=tower].unknown .hatched')")
            await tab.sees("The lift cannot be read.")
            await lifts.post("tower/reset")
            await tab.until("document.querySelector('[data-lift=tower]:not(.unknown)')")

            await lifts.post("lift/inputs", json={"fire": True})
            await tab.until("document.querySelector('dialog').innerText.includes('Fire. Robots are stopped.')")
            await lifts.post("lift/inputs", json={"fire": False})
            await tab.until("document.querySelector('dialog').innerText.includes('There was a fire.')")
            await acknowledge(tab)
            await tab.until("document.querySelector('.card.tone-alarm') === null")

            assert tab.complaints == []
            assert {url.split("/")[2] for url in tab.requested} == {base.removeprefix("http://")}

    with Started() as start:
        program = start("demo", "--port", "0", "--panel", "0", "--speed", "10")
        program.says("Ctrl-C ends the demo")
        base = program.says(r"(http://127\.0\.0\.1:\d+)/docs")[1]
        panel = program.says(r"make faults: (http://127\.0\.0\.1:\d+)/")[1]
        asyncio.run(use(base, panel))
