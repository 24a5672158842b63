"""Recorded announcements of the lobby view: what is served, and when it is played in a real browser."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from lift_manager.lift.session import Holder
from lift_manager.rides.ride import Guidance, Phase
from lift_manager.web.app import make_app
from register_maps.words import Mode
from tests.lift_manager.web.fake import FakeSite, ask_app, serving
from tests.lift_manager.web.fake_rides import a_ride
from tests.lift_manager.web.listening import Happening
from tests.support.devtools import Tab, chromium
from tests.support.rows import each_row

SOUND = Path(__file__).parents[2] / "support" / "enters.wav"
"""A tenth of a second of silence."""
RECORDED = {"enters": SOUND, "stopped": SOUND}


def test_the_list_leads_to_the_recordings_and_to_nothing_else_in_their_folder() -> None:
    app = make_app(FakeSite(), announcements={"enters": SOUND})
    assert ask_app(app, "GET", "/announcements").json() == {"enters": "announcements/enters.wav"}
    answer = ask_app(app, "GET", "/announcements/enters.wav")
    assert (answer.content, answer.headers["content-type"]) == (SOUND.read_bytes(), "audio/wav")
    assert answer.headers["x-content-type-options"] == "nosniff"
    for path in ("rows.py", "enters", "..%2Fsupport%2Frows.py", "%2Fetc%2Fpasswd", ""):
        assert ask_app(app, "GET", f"/announcements/{path}").status_code == 404


def test_a_site_without_recordings_has_an_empty_list_and_a_recording_that_is_gone_is_404(tmp_path: Path) -> None:
    assert ask_app(make_app(FakeSite()), "GET", "/announcements").json() == {}
    app = make_app(FakeSite(), announcements={"enters": tmp_path / "enters.wav"})
    assert ask_app(app, "GET", "/announcements/enters.wav").status_code == 404


PLAYED = """
window.played = [];
HTMLMediaElement.prototype.play = function () { window.played.push(this.src.split("/").pop()); return Promise.resolve(); };
0
"""


HEARD = """
window.heard = 0;
const play = HTMLMediaElement.prototype.play;
HTMLMediaElement.prototype.play = async function () { await play.call(this); window.heard += 1; };
0
"""


async def open_lobby(tab: Tab, port: int) -> None:
    await tab.open(f"http://127.0.0.1:{port}/lobby/lift?lang=en")
    await tab.sees("No robot at the moment")
    await tab.value(PLAYED)


@pytest.mark.external("chromium")
def test_what_the_lobby_view_begins_to_say_is_played_once(tmp_path: Path) -> None:
    async def use() -> None:
        site = Happening()
        ride = a_ride(Holder("ride", "amr-7"))
        async with chromium(tmp_path) as tab, serving(make_app(site, announcements=RECORDED)) as port:
            await open_lobby(tab, port)
            for guidance in (Guidance.ENTER, Guidance.WAIT, Guidance.ENTER):
                site.rides_on(replace(ride, phase=Phase.BOARDING, guidance=guidance))
                entering = guidance is Guidance.ENTER
                await tab.sees("Robot enters, please let it pass" if entering else "A robot is getting in")
            assert await tab.value("window.played") == ["enters.wav"]
            site.shift(mode=Mode.FIRE)
            await tab.sees("Robots stopped")
            await tab.until("window.played.length === 2")

    asyncio.run(use())


@pytest.mark.external("chromium")
@each_row(("policy", "mute"), [("no-user-gesture-required", False), ("document-user-activation-required", True)])
def test_the_lobby_view_shows_that_the_browser_allows_no_sound(policy: str, mute: bool, tmp_path: Path) -> None:
    async def use() -> None:
        site = Happening()
        profile = tmp_path / str(mute)
        async with (
            chromium(profile, options=[f"--autoplay-policy={policy}"]) as tab,
            serving(make_app(site, announcements=RECORDED)) as port,
        ):
            await tab.open(f"http://127.0.0.1:{port}/lobby/lift?lang=en")
            await tab.sees("No robot at the moment")
            await tab.value(HEARD)
            site.shift(mode=Mode.FIRE)
            await tab.sees("Robots stopped")
            if mute:
                await tab.until("document.querySelector('.mute')")
            else:
                await tab.until("window.heard === 1")
                assert await tab.value("document.querySelector('.mute') === null")

    asyncio.run(use())
