"""The page in a real browser, and what is pressed in it."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from lift_manager.api.roles import Role
from lift_manager.web.app import make_app
from register_maps.words import Mode
from tests.lift_manager.web.fake import FakeSite, serving
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.keyed import ring
from tests.lift_manager.web.listening import Happening
from tests.support.devtools import Tab, chromium

ACTIVE = "document.activeElement"


class Shown(NamedTuple):
    tab: Tab
    site: Happening
    address: str
    """Of a site without keys: one lift in normal service, one on fire behind a simulator."""
    locked: str
    """Of a site with keys."""


@asynccontextmanager
async def shown(profile: Path) -> AsyncIterator[Shown]:
    site = Happening({"lift": IDLE, "goods": replace(IDLE, lift="goods", mode=Mode.FIRE)})
    async with (
        chromium(profile) as tab,
        serving(make_app(site, simulated={"goods"})) as port,
        serving(make_app(FakeSite(), ring(Role.VIEWER, open_without_keys=False))) as locked,
    ):
        yield Shown(tab, site, f"http://127.0.0.1:{port}", f"http://127.0.0.1:{locked}")


async def open_lockout(tab: Tab, number: int = 0) -> None:
    """Open the form of a lockout, with the keyboard."""
    await tab.until(f"document.querySelectorAll('.card .open')[{number}]")
    await tab.value(f"document.querySelectorAll('.card .open')[{number}].focus()")
    await tab.press("Enter")
    await tab.until("document.querySelector('dialog .actions .floors') && document.querySelector('dialog tbody td')")
    await tab_to(tab, "Lock out")
    await tab.press("Enter")
    await tab.until("document.querySelector('.decision input')")


async def tab_to(tab: Tab, text: str) -> None:
    """Press Tab until an element of this text has the focus."""
    for _ in range(40):
        await tab.press("Tab")
        if await tab.value(f"{ACTIVE}.textContent") == text:
            return
    raise AssertionError(f"{text} cannot be reached with Tab")
