"""The page of a hub: what a browser is sent, that its texts are whole, and what a real browser makes of it."""

import asyncio
import json
import re
from pathlib import Path

import pytest

from lift_manager.api.keys import KeyRing
from lift_manager.api.roles import Role
from lift_manager.hub.page import FOLDER
from lift_manager.hub.remote_site import BATCH, SILENT_S, SiteState
from lift_manager.hub.update.rollout import Progress
from lift_manager.hub.web import make_hub_app
from lift_manager.lift.journal import RowKind
from lift_manager.web.page import FOLDER as SITE_PAGE
from tests.lift_manager.hub.fake import fake_hub
from tests.lift_manager.web.fake import ask_app, serving
from tests.lift_manager.web.keyed import key, ring
from tests.support.axe_core import problems
from tests.support.devtools import chromium
from tests.support.rows import each_row

SCRIPTS = [FOLDER / "main.js", *(FOLDER / "src").glob("*.js")]
LANGUAGES = list(json.loads((SITE_PAGE / "texts" / "languages.json").read_text("utf-8")))
REPLACED = {"login.help", "trouble.lost"}
"""Texts of a site's page that read differently on that of a hub."""
LOST = """({ Poll }) => new Promise((done) => {
    const seen = [];
    const replies = [{}];
    const get = async () => replies.pop() ?? Promise.reject(new Error("no reply"));
    const onChange = () => {
        if (seen.push(poll.current) > 1 && !poll.current) done([seen[0], seen.at(-1)], poll.stop());
    };
    const poll = new Poll({ get }, { path: "sites", everyMs: () => 20, currentMs: 300, onChange });
    poll.start();
})"""
"""Whether a reply is current when it comes, and after the hub has not replied again for longer than it holds."""


def texts_of(folder: Path, language: str) -> dict[str, str]:
    found: dict[str, str] = json.loads((folder / "texts" / f"{language}.json").read_text("utf-8"))
    return found


def test_a_browser_runs_no_script_but_ours_and_connects_to_nothing_but_the_hub(tmp_path: Path) -> None:
    with fake_hub(tmp_path, "berlin") as hub:
        app = make_hub_app(hub, KeyRing())
        document = ask_app(app, "GET", "/")
        policy = dict(part.split(" ", 1) for part in document.headers["content-security-policy"].split("; "))
        assert policy["default-src"] == policy["frame-ancestors"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
        assert "//" not in document.text.replace("<!doctype html>", "")
        assert not re.search(r"<script(?! type=\"module\" src=)|\sstyle=|\son\w+=", document.text)
        for path in re.findall(r'(?:href|src)="((?:hub|page)/[^"]+)"', document.text):
            served = ask_app(app, "GET", f"/{path}")
            assert (served.status_code, served.headers["x-content-type-options"]) == (200, "nosniff"), path
        assert ask_app(app, "GET", "/errors").status_code == 200


@each_row("language", LANGUAGES)
def test_a_language_has_every_text_of_the_hub_with_the_same_values_to_fill_in(language: str) -> None:
    english, texts = texts_of(FOLDER, "en"), texts_of(FOLDER, language)
    assert texts.keys() == english.keys()
    filled = {name: sorted(re.findall(r"{\w+}", text)) for name, text in texts.items()}
    assert filled == {name: sorted(re.findall(r"{\w+}", text)) for name, text in english.items()}
    assert all(texts.values())


def test_every_text_that_a_script_names_is_there_and_every_text_of_the_hub_is_named() -> None:
    own, shared = texts_of(FOLDER, "en"), texts_of(SITE_PAGE, "en")
    assert own.keys() & shared.keys() == REPLACED
    scripts = "".join(file.read_text("utf-8") for file in SCRIPTS)
    assert set(re.findall(r"\bt\(\"([\w.]+)\"", scripts)) - (own | shared).keys() == set()
    prefixes = tuple(f"{prefix}." for prefix in re.findall(r"\b(?:t|word)\([`\"]([\w.]+?)(?:\.\$\{|\", )", scripts))
    actions = {f"actions.{one}{rest}" for one in ("site_off", "site_on") for rest in ("", ".help", ".done")}
    unnamed = {name for name in own if f'"{name}"' not in scripts and not name.startswith(prefixes)}
    assert unnamed == REPLACED | actions


def test_what_the_hub_reports_has_a_word() -> None:
    texts = texts_of(FOLDER, "en")
    words = {
        "sites.state": {*SiteState, "on"},
        "events.kind": set(RowKind),
        "events.progress": {*Progress, "stopped"},
    }
    for kind, values in words.items():
        named = {name.removeprefix(f"{kind}.") for name in texts if name.startswith(f"{kind}.")}
        assert named == values, kind


def test_the_page_calls_a_site_behind_or_silent_by_the_limits_of_the_hub() -> None:
    script = (FOLDER / "src" / "words.js").read_text("utf-8")
    limits = {name: float(value) for name, value in re.findall(r"^const ([A-Z_]+) = (\d+);", script, re.MULTILINE)}
    assert limits == {"SILENT_S": SILENT_S, "BEHIND": BATCH}


@pytest.mark.external("chromium")
def test_a_real_browser_shows_sites_then_lifts_and_never_what_it_does_not_know(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin", "hamburg", "leipzig", "rome") as hub:
            hub.fakes["hamburg"].cut()
            hub.fakes["leipzig"].report(live=1, behind=BATCH + 1)
            hub.write("berlin", "locked out: new ropes")
            async with chromium(tmp_path / "browser") as tab, serving(make_hub_app(hub, KeyRing())) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en")
                for text in (
                    "need attention: 2",
                    "Cut off, or its manager",
                    "Lifts that cannot be read: 1",
                    "Behind",
                ):
                    await tab.sees(text)
                assert sum(fake.requests for fake in hub.fakes.values()) == 0  # the list contacts no site
                await tab.value("document.querySelector('.filter [type=checkbox]').click()")
                await tab.sees("2 of 4")

                await tab.value("location.hash = '#/berlin'")
                await tab.until("document.querySelectorAll('.card:not(.unknown)').length === 2")
                await tab.sees("round trip 4 ms")
                await tab.sees("locked out: new ropes")
                hub.fakes["berlin"].cut()
                await tab.sees("Cut off: what the lifts of this site do is not known here.")
                await tab.until("document.querySelectorAll('.card.unknown .hatched').length === 2")

                await tab.value("location.hash = '#/rome'")
                await tab.until("document.querySelector('.card')")
                await tab.value("document.querySelector('.actions button').click()")
                for text in ("M. Weber", "its key was copied"):
                    await tab.until("document.querySelector('.decision input')")
                    await tab.value(
                        "[...document.querySelectorAll('.decision input')].find((one) => !one.value).focus()"
                    )
                    await tab.type(text)
                await tab.press("Enter")
                await tab.sees("rome is switched off.")
                await tab.until("document.querySelector('.actions button').innerText === 'Switch rome on'")
                await tab.sees("Switched off by M. Weber: its key was copied")
                await tab.until("document.querySelector('.card') === null")
                assert [line for line in tab.complaints if not line.endswith("/lifts")] == []
                assert {url.split("/")[2] for url in tab.requested} == {f"127.0.0.1:{port}"}
                await tab.value("location.hash = '#/'")
                await tab.sees("need attention: 4")
                assert await tab.value(f"import('/hub/src/poll.js').then({LOST})") == [True, False]

    asyncio.run(use())


@pytest.mark.external("chromium")
def test_axe_finds_nothing_serious_in_any_view_of_a_hub(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin", "hamburg", "rome") as hub:
            hub.fakes["hamburg"].cut()
            hub.folder.switch_off("rome", "M. Weber", "its key was copied")
            hub.follow()
            hub.write("berlin", "locked out: new ropes")
            app, locked = make_hub_app(hub, KeyRing()), make_hub_app(hub, ring(Role.VIEWER, open_without_keys=False))
            async with chromium(tmp_path / "browser") as tab, serving(app) as port, serving(locked) as other:
                found: dict[str, list[str]] = {}
                for theme, url, ready in (
                    ("light", f"{port}/", ".sites .trouble"),
                    ("dark", f"{port}/", ".sites .trouble"),
                    ("dark", f"{port}/?lang=de#/berlin", "section:has(.card) ~ section .events td"),
                    ("light", f"{port}/#/hamburg", "[role=alert] .trouble"),
                    ("light", f"{other}/", ".login input"),
                ):
                    await tab.look(prefers_color_scheme=theme)
                    await tab.open("about:blank")  # another hash alone is no new page
                    await tab.open(f"http://127.0.0.1:{url}")
                    await tab.until(f"document.querySelector('{ready}')")
                    found[f"{theme} {url}"] = await problems(tab)
                assert {url: wrong for url, wrong in found.items() if wrong} == {}

    asyncio.run(use())


@pytest.mark.external("chromium")
def test_a_viewer_logs_in_and_is_offered_no_off_switch(tmp_path: Path) -> None:
    async def use() -> None:
        with fake_hub(tmp_path, "berlin") as hub:
            app = make_hub_app(hub, ring(Role.VIEWER, Role.OPERATOR, open_without_keys=False))
            async with chromium(tmp_path / "browser") as tab, serving(app) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en#/berlin")
                for role, switches in ((Role.VIEWER, 0), (Role.OPERATOR, 1)):
                    await tab.until("document.activeElement.matches('.login input')")
                    await tab.type(key(role))
                    await tab.press("Enter")
                    await tab.sees(f"Logged in as the {role}")
                    await tab.until("document.querySelector('.card')")
                    await tab.until(f"document.querySelectorAll('.actions').length === {switches}")
                    await tab.value(
                        "[...document.querySelectorAll('nav button')].find(b => b.innerText === 'Log out').click()"
                    )

    asyncio.run(use())
