"""The page for everybody: with a keyboard alone, a screen reader, a phone, on a wall, in the dark; in a real browser."""

import asyncio
import itertools
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.web.app import make_app
from register_maps.words import Mode
from tests.lift_manager.web.fake import FakeSite, serving
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.listening import Happening
from tests.lift_manager.web.page_shown import ACTIVE, open_lockout, shown, tab_to
from tests.support.devtools import chromium
from tests.support.rows import each_row

pytestmark = pytest.mark.external("chromium")

CARD = "lift \N{EN DASH} details"
"""What a screen reader says of the button that opens a lift."""


def test_an_operator_needs_nothing_but_a_keyboard(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, site, address, _):
            await tab.open(f"{address}/?lang=en")
            await tab.until("document.querySelectorAll('.card .open').length === 2")
            await tab_to(tab, CARD)
            assert await tab.value(f"{ACTIVE}.matches(':focus-visible')")
            await tab.press("Enter")
            await tab.until(f"document.querySelector('dialog[open]')?.contains({ACTIVE})")
            await tab_to(tab, "Lock out")
            # nothing behind the dialog can be reached: from its last element the focus leaves to the browser and comes back to its first
            reached = set()
            for _ in range(30):
                await tab.press("Tab")
                reached.add(await tab.value(f"{ACTIVE} === document.body || {ACTIVE}.closest('dialog') !== null"))
            assert reached == {True}
            await tab_to(tab, "Lock out")
            await tab.press("Enter")
            await tab.until("document.querySelector('.decision')")
            for text in ("M. Weber", "new ropes"):
                await tab.until("document.querySelector('.decision input')")
                while not await tab.value(f"{ACTIVE}.matches('.decision label:not(.check) input') && !{ACTIVE}.value"):
                    await tab.press("Tab")
                await tab.type(text)
            await tab.press("Tab", " ", "Tab", "Enter")
            await tab.sees("Locked out.")
            # the form is gone, and the focus is at what came of it
            assert "Locked out." in await tab.value(f"{ACTIVE}.innerText")
            assert site.decisions == [("lock_out", "lift", "M. Weber (stood at the lift)", "new ropes")]
            await tab.press("Escape")
            await tab.until("document.querySelector('dialog') === null")
            assert await tab.value(f"{ACTIVE}.textContent") == CARD

    asyncio.run(use())


def test_a_call_says_what_came_of_it_and_a_session_that_begins_with_a_refusal_ends(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, site, address, _):
            site.lifts["lift"] = replace(IDLE, floors=("L1", "L2", "L3"))
            await tab.open(f"{address}/?lang=en")
            await tab.until("document.querySelectorAll('.card .open').length === 2")
            await tab_to(tab, CARD)
            await tab.press("Enter")
            await tab.until("document.querySelector('.floors button')")
            await tab_to(tab, "L3")
            await tab.press("Enter")
            await tab.sees("Refused. no floor 'L3'")
            assert [kind for kind, *_ in site.done] == ["open", "command", "close"]
            await tab_to(tab, "L2")
            await tab.press("Enter")
            await tab.sees("Call to L2: done, the lift shows it")
            assert [kind for kind, *_ in site.done[3:]] == ["open", "command"]

    asyncio.run(use())


@pytest.mark.parametrize(("mode", "said", "offered"), [(Mode.FIRE, "Fire.", False), (Mode.NORMAL, "There was", True)])
def test_a_fire_is_over_before_anybody_is_asked_to_acknowledge_it(
    mode: Mode, said: str, offered: bool, tmp_path: Path
) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, site, address, _):
            burnt = replace(IDLE.restrictions, fire_latched=True)
            site.lifts = {"lift": replace(IDLE, mode=mode, restrictions=burnt)}
            await tab.open(f"{address}/?lang=en")
            await tab.until("document.querySelector('.card .open')")
            await tab_to(tab, CARD)
            await tab.press("Enter")
            await tab.until("document.querySelector('dialog .actions button')")
            troubles = "[...document.querySelectorAll('dialog .trouble strong')].map((trouble) => trouble.innerText)"
            (trouble,) = await tab.value(troubles)
            assert trouble.startswith(said)
            buttons = "[...document.querySelectorAll('dialog .actions button')].map((button) => button.innerText)"
            assert ("Acknowledge" in await tab.value(buttons)) is offered

    asyncio.run(use())


def test_the_table_has_every_fact_of_the_pictures(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, _, address, _):
            await tab.open(f"{address}/?lang=en")
            await tab.until("document.querySelectorAll('.card .trouble').length === 1")
            facts = "[...document.querySelectorAll('.facts p:not(.place):not(.quiet), .trouble strong, .mode')].map(p => p.innerText)"
            said = {fact.removeprefix("Doors: ").strip() for fact in await tab.value(facts)}
            assert "Fire. Robots are stopped." in said
            await tab.value("document.querySelector('nav button').click()")
            await tab.until("document.querySelectorAll('table.lifts tbody tr').length === 2")
            table = await tab.value("document.querySelector('table.lifts').innerText")
            assert {fact for fact in said if fact not in table} == set()
            for picture in ("caption", "th[scope=col]", "th[scope=row]"):
                assert await tab.value(f"document.querySelector('table.lifts {picture}') !== null")

    asyncio.run(use())


def test_no_view_is_wider_than_a_phone(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, _, address, locked):
            await tab.look(width=360, height=740)
            wide = "document.scrollingElement.scrollWidth - innerWidth"
            for url, ready in (
                (f"{address}/?lang=de", ".card .trouble"),
                (f"{address}/wall", ".card"),
                (f"{address}/lobby/goods", ".message"),
                (f"{address}/errors", "tbody tr"),
                (f"{locked}/?lang=de", ".login input"),
            ):
                await tab.open(url)
                await tab.until(f"document.readyState === 'complete' && document.querySelector('{ready}')")
                assert await tab.value(wide) <= 0, url
            await tab.open(f"{address}/?lang=en")
            await open_lockout(tab)
            assert await tab.value("(d => d.scrollWidth - d.clientWidth)(document.querySelector('dialog'))") <= 0

    asyncio.run(use())


@each_row(
    "floors", [("Basement", "Ground"), ("Car park of the north building", "L1"), tuple(f"L{n}" for n in range(1, 41))]
)
def test_names_of_floors_are_whole_and_readable(floors: tuple[str, ...], tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path / str(len(floors[0]))) as (tab, site, address, _):
            site.lifts["lift"] = replace(IDLE, floors=floors, floor=floors[0])
            await tab.look(width=1280, height=800)
            await tab.open(f"{address}/?lang=en")
            await tab.until("document.querySelectorAll('.card').length === 2")
            names = "[...document.querySelectorAll('.card:first-of-type .floor text')]"
            assert floors[0] in await tab.value(f"{names}.map((name) => name.textContent)")
            assert await tab.value(f"{names}.every((name) => name.getBBox().x >= 0)")
            edges = await tab.value(
                f"{names}.map((name) => name.getBoundingClientRect()).map((it) => [it.top, it.bottom])"
            )
            assert all(bottom - top > 8 for top, bottom in edges)
            # the lowest floor comes first
            assert all(above[1] <= below[0] + 2 for below, above in itertools.pairwise(edges))
            for width, height in ((1280, 800), (360, 740)):
                await tab.look(width=width, height=height)
                await tab.open(f"{address}/lobby/lift?lang=en")
                await tab.until("document.querySelector('.floor')")
                assert await tab.value("document.scrollingElement.scrollWidth <= innerWidth")

    asyncio.run(use())


def test_a_wall_draws_few_lifts_large_and_many_so_that_all_fit(tmp_path: Path) -> None:
    async def use() -> None:
        sizes = []
        async with chromium(tmp_path) as tab:
            await tab.look(width=1920, height=1080)
            for count in (1, 6, 24, 60):
                modes = [Mode.FIRE if number % 4 == 0 else Mode.NORMAL for number in range(count)]
                lifts = {f"lift-{n}": replace(IDLE, lift=f"lift-{n}", mode=mode) for n, mode in enumerate(modes)}
                async with serving(make_app(FakeSite(lifts))) as port:
                    await tab.open(f"http://127.0.0.1:{port}/wall")
                    await tab.until(f"document.querySelectorAll('.card').length === {count}")
                    await tab.until("document.documentElement.style.fontSize")
                    sizes.append(await tab.value("parseFloat(document.documentElement.style.fontSize)"))
                    assert await tab.value("document.scrollingElement.scrollHeight <= innerHeight"), count
                    cards = "[...document.querySelectorAll('.card')]"
                    assert await tab.value(f"{cards}.every((card) => card.scrollHeight <= card.clientHeight)"), count
                    await tab.open("about:blank")
        assert sizes[0] > sizes[1] > sizes[2] > 16 > sizes[3] > 12

    asyncio.run(use())


def test_pages_that_were_left_keep_no_connection(tmp_path: Path) -> None:
    """A browser keeps pages to go back to, and has six connections for one host: the seventh page would wait for ever."""

    async def use() -> None:
        site = Happening()
        async with chromium(tmp_path) as tab, serving(make_app(site, streams=4)) as port:
            for number in range(8):
                await tab.open(f"http://127.0.0.1:{port}/?lang=en&number={number}")
                await tab.until("document.querySelector('.card:not(.unknown)')")
            assert tab.complaints == []  # such as 503: no place for another stream
            await tab.value("history.back()")
            await tab.until("location.search.endsWith('number=6')")
            site.shift(mode=Mode.INSPECTION)
            await tab.sees("Not for robots: Inspection.")

    asyncio.run(use())
