"""The page of a hub for everybody: with a keyboard alone, on a phone, with a thousand sites, and while the hub does not reply; in a real browser."""

import asyncio
from pathlib import Path

import pytest

from lift_manager.api.keys import KeyRing
from lift_manager.hub.web import make_hub_app
from tests.lift_manager.hub.fake import fake_hub
from tests.lift_manager.web.fake import serving
from tests.lift_manager.web.page_shown import ACTIVE, tab_to
from tests.support.devtools import chromium

pytestmark = pytest.mark.external("chromium")

ROWS = "document.querySelectorAll('.sites tbody tr').length"


def test_an_operator_of_a_hub_needs_nothing_but_a_keyboard(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin", "rome") as hub:
            async with chromium(tmp_path / "browser") as tab, serving(make_hub_app(hub, KeyRing())) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en")
                await tab.until(f"{ROWS} === 2")
                await tab_to(tab, "The rome")
                assert await tab.value(f"{ACTIVE}.matches(':focus-visible')")
                await tab.press("Enter")
                await tab.until(f"{ACTIVE}.matches('.site-name')")
                await tab_to(tab, "Switch rome off")
                await tab.press("Enter", "Tab")
                for text in ("M. Weber", "its key was copied"):
                    await tab.until(f"{ACTIVE}.matches('.decision input')")
                    await tab.type(text)
                    await tab.press("Tab")
                await tab.press("Enter")
                await tab.sees("rome is switched off.")
                assert await tab.value(f"{ACTIVE}.innerText") == "rome is switched off."
                await tab.sees("This site is switched off")
                await tab.value("history.back()")
                await tab.until(f"{ACTIVE}.dataset.site === 'rome'")

    asyncio.run(use())


def test_what_somebody_types_is_still_there_after_the_hub_was_away(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin") as hub:
            async with chromium(tmp_path / "browser") as tab, serving(make_hub_app(hub, KeyRing())) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en#/berlin")
                await tab.until("document.querySelector('.actions button') && document.querySelector('.card')")
                await tab.value("document.querySelector('.actions button').click()")
                await tab.until("document.querySelectorAll('.decision input').length === 2")
                await tab.value("document.querySelectorAll('.decision input')[1].focus()")
                await tab.type("its key was")
                offline = {"latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
                await tab.send("Network.emulateNetworkConditions", offline=True, **offline)
                await tab.sees("No news from the hub.")
                await tab.until("document.querySelectorAll('.card.unknown .hatched').length === 2")
                await tab.until("document.querySelector('.site-facts dd').innerText === 'Not known'")
                await tab.send("Network.emulateNetworkConditions", **{**offline, "offline": False})
                await tab.until("document.querySelectorAll('.card:not(.unknown)').length === 2")
                assert await tab.value("document.querySelectorAll('.decision input')[1].value") == "its key was"

    asyncio.run(use())


def test_no_view_of_a_hub_is_wider_than_a_phone(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin", "a-site-with-a-long-name", "rome") as hub:
            hub.fakes["berlin"].cut()
            hub.folder.switch_off("rome", "M. Weber", "its key was copied")
            hub.follow()
            hub.write("a-site-with-a-long-name", "locked out: new ropes")
            async with chromium(tmp_path / "browser") as tab, serving(make_hub_app(hub, KeyRing())) as port:
                await tab.look(width=360, height=740)
                for view, ready in (
                    ("", f"{ROWS} === 3"),
                    ("#/berlin", "document.querySelector('[role=alert] .trouble')"),
                    ("#/a-site-with-a-long-name", "document.querySelector('.card')"),
                    ("#/rome", "document.querySelector('.actions button')"),
                ):
                    await tab.open("about:blank")
                    await tab.open(f"http://127.0.0.1:{port}/?lang=de{view}")
                    await tab.until(ready)
                    assert await tab.value("document.scrollingElement.scrollWidth - innerWidth") <= 0, view

    asyncio.run(use())


def test_a_thousand_sites_are_fluid_and_a_list_left_in_the_middle_is_found_again(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, *(f"site-{number:04}" for number in range(1000))) as hub:
            hub.fakes["site-0999"].cut()
            async with chromium(tmp_path / "browser") as tab, serving(make_hub_app(hub, KeyRing())) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en")
                await tab.until(f"{ROWS} >= 100")
                assert await tab.value(ROWS) < 300  # the rest when it comes near
                await tab.until(f"(scrollTo(0, document.body.scrollHeight), {ROWS} === 1000)")
                await tab.value(
                    "window.blocked = []; new PerformanceObserver((list) => blocked.push(...list.getEntries().map((one) =>"
                    " one.duration))).observe({ entryTypes: ['longtask'] }); 0"
                )
                polls = len(tab.requested)
                async with asyncio.timeout(60):
                    while len(tab.requested) < polls + 3:  # noqa: ASYNC110  it is the browser's clock
                        await asyncio.sleep(0.1)
                assert await tab.value("Math.max(0, ...blocked)") < 500
                assert all(fake.requests == 0 for fake in hub.fakes.values())
                await tab.value("location.hash = '#/site-0700'")
                await tab.until("document.querySelector('.card')")
                await tab.value("history.back()")
                await tab.until(f"{ACTIVE}.dataset.site === 'site-0700'")
                await tab.value("document.querySelector('.filter [type=checkbox]').click()")
                await tab.until(f"{ROWS} === 1")

    asyncio.run(use())
