"""axe-core looks for what keeps somebody from using the page: in every view, in the light and in the dark."""

import asyncio
from pathlib import Path

import pytest

from tests.lift_manager.web.page_shown import open_lockout, shown
from tests.support.axe_core import problems

pytestmark = pytest.mark.external("chromium")


def test_axe_finds_nothing_serious_in_any_view(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, _, address, locked):
            found: dict[tuple[str, str], list[str]] = {}
            for theme in ("light", "dark"):
                await tab.look(prefers_color_scheme=theme)
                for url, ready in (
                    (f"{address}/?lang=de", ".card .trouble"),
                    (f"{address}/?view=table", "table.lifts .badge"),
                    (f"{address}/wall", ".card .watermark"),
                    (f"{address}/lobby/lift", ".message"),
                    (f"{address}/lobby/goods", ".tone-alarm"),
                    (f"{address}/errors", "tbody tr"),
                    (f"{locked}/", ".login input"),
                    (f"{locked}/lobby/lift", ".login input"),
                ):
                    await tab.open(url)
                    await tab.until(f"document.querySelector('{ready}')")
                    found[theme, url] = await problems(tab)
                await tab.open(f"{address}/?lang=en")
                await open_lockout(tab, 1)
                found[theme, "details"] = await problems(tab)
            assert {view: wrong for view, wrong in found.items() if wrong} == {}

    asyncio.run(use())


def test_axe_would_find_a_field_without_a_name(tmp_path: Path) -> None:
    async def use() -> None:
        async with shown(tmp_path) as (tab, _, address, _):
            await tab.open(f"{address}/errors")
            await tab.until("document.querySelector('tbody tr')")
            await tab.value("document.querySelector('main').append(document.createElement('input')); 0")
            (found,) = await problems(tab)
            assert found.startswith("label: ")

    asyncio.run(use())
