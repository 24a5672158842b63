"""The page: what a browser is sent, that its texts are whole, and what a real browser makes of it."""

import asyncio
import hashlib
import json
import re
from pathlib import Path

import pytest

from lift_manager.api.roles import Role
from lift_manager.lift.state import Quality
from lift_manager.web.app import make_app
from lift_manager.web.page import FOLDER
from register_maps.words import Mode
from tests.lift_manager.web.fake import FakeSite, ask, ask_app, serving
from tests.lift_manager.web.keyed import key, ring
from tests.lift_manager.web.listening import Happening
from tests.support.devtools import chromium
from tests.support.rows import each_row

VIEWS = ["/", "/wall", "/lobby/lift"]
OWN = [*FOLDER.glob("*.js"), *(FOLDER / "src").glob("*.js")]
LANGUAGES = json.loads((FOLDER / "texts" / "languages.json").read_text("utf-8"))
TEXT_IN_MARKUP = re.compile(r"<[a-zA-Z][^<>]*[^=]>\s*([A-Za-z][a-z]+)")
TEXT_IN_ATTRIBUTE = re.compile(r'(?:aria-label|title|placeholder|alt)="([A-Za-z]+)')


def texts_of(language: str) -> dict[str, str]:
    found: dict[str, str] = json.loads((FOLDER / "texts" / f"{language}.json").read_text("utf-8"))
    return found


@each_row("path", VIEWS)
def test_a_view_runs_no_script_but_its_own_and_asks_nobody_but_the_manager(path: str) -> None:
    answer = ask(FakeSite(), "GET", path)
    policy = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "//" not in answer.text.replace("<!doctype html>", "")
    assert not re.search(r"<script(?! type=\"module\" src=)|\sstyle=|\son\w+=", answer.text)


@each_row("path", ["main.js", "src/app.js", "texts/de.json", "style.css", "icon.svg", "vendor/htm-preact.js"])
def test_a_file_of_the_page_is_served_as_what_it_is_and_compared_at_each_load(path: str) -> None:
    answer = ask(FakeSite(), "GET", f"/page/{path}")
    assert answer.status_code == 200
    assert (answer.headers["cache-control"], answer.headers["x-content-type-options"]) == ("no-cache", "nosniff")
    assert ask(FakeSite(), "GET", f"/page/{path}", headers={"if-none-match": answer.headers["etag"]}).status_code == 304


def test_the_vendored_file_is_the_published_one_and_its_licences_are_beside_it() -> None:
    digest, name = (FOLDER / "vendor" / "SHA256SUMS").read_text().split()
    assert hashlib.sha256((FOLDER / "vendor" / name).read_bytes()).hexdigest() == digest
    assert digest == "72284e8e9079c87817145df1110f74e8a2aa040b2fc384922e18dfcb46fc1fd7"
    assert "Apache License" in (FOLDER / "vendor" / "LICENSE.htm").read_text()
    assert "MIT License" in (FOLDER / "vendor" / "LICENSE.preact").read_text()


@each_row("language", list(LANGUAGES))
def test_a_language_has_every_text_with_the_same_values_to_fill_in(language: str) -> None:
    english, texts = texts_of("en"), texts_of(language)
    assert texts.keys() == english.keys()
    filled = {key: sorted(re.findall(r"{\w+}", text)) for key, text in texts.items()}
    assert filled == {key: sorted(re.findall(r"{\w+}", text)) for key, text in english.items()}
    assert all(texts.values())


def test_every_text_that_a_script_names_is_there_and_no_script_has_one_of_its_own() -> None:
    english = texts_of("en")
    for file in OWN:
        script = file.read_text("utf-8")
        assert {key for key in re.findall(r"\bt\(\"([\w.]+)\"", script) if key not in english} == set(), file.name
        assert TEXT_IN_MARKUP.findall(script) == [], file.name
        assert TEXT_IN_ATTRIBUTE.findall(script) == [], file.name


def imported(file: Path) -> set[Path]:
    """Return a script and all that it imports."""
    found = {file}
    for name in re.findall(r'from "(\./[^"]+|\.\./[^"]+)"', file.read_text("utf-8")):
        if (other := (file.parent / name).resolve()) not in found and other.suffix == ".js":
            found |= imported(other)
    return found


def test_views_without_controls_load_none() -> None:
    actions = FOLDER / "src" / "actions.js"
    assert actions in imported(FOLDER / "main.js")
    assert not {actions, FOLDER / "src" / "sessions.js"} & (
        imported(FOLDER / "wall.js") | imported(FOLDER / "lobby.js")
    )


def test_only_lifts_behind_a_simulated_controller_are_said_to_be_simulated() -> None:
    app = make_app(FakeSite(), simulated={"goods"})
    said = {
        name: ask_app(app, "GET", f"/api/v1/lifts/{name}/capabilities").json()["simulated"]
        for name in ("lift", "goods")
    }
    assert said == {"lift": False, "goods": True}


@pytest.mark.external("chromium")
def test_a_real_browser_shows_lifts_and_says_when_one_of_them_or_the_manager_is_lost(tmp_path: Path) -> None:
    async def use() -> None:
        site = Happening()
        async with chromium(tmp_path) as tab:
            async with serving(make_app(site, simulated={"goods"})) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en")
                await tab.until("document.querySelectorAll('.card:not(.unknown)').length === 2")
                await tab.until("document.querySelectorAll('.card .watermark').length === 1")
                site.shift(mode=Mode.FIRE)
                await tab.sees("Fire. Robots are stopped.")
                site.shift(quality=Quality.OFFLINE, floor=None, doors={}, mode=Mode.UNKNOWN, reason="no answer")
                await tab.sees("The lift cannot be read.")
                await tab.until("document.querySelectorAll('.card.unknown .hatched').length === 1")
                for session, troubles in (({"name": "r1"}, 0), ({"name": "r2"}, 1), (None, 1)):
                    lift = {
                        "mode": "robot",
                        "quality": "live",
                        "doors": {},
                        "session": session,
                        "restrictions": {"maybe_occupied_by": "fleet:r1"},
                    }
                    call = f"m.troubles({json.dumps(lift)}, {{t: (text) => text, word: (text) => text}}).length"
                    assert await tab.value(f"import('/page/src/facts.js').then((m) => {call})") == troubles
                assert tab.complaints == []
                assert {url.split("/")[2] for url in tab.requested} == {f"127.0.0.1:{port}"}
            await tab.sees("No news from the manager")
            await tab.until("document.querySelectorAll('.card.unknown .hatched').length === 2")

    asyncio.run(use())


@pytest.mark.external("chromium")
def test_a_browser_logs_in_once_and_acts_as_its_key_until_it_logs_out(tmp_path: Path) -> None:
    async def use() -> None:
        site = FakeSite()
        app = make_app(site, ring(Role.OPERATOR, open_without_keys=False))
        async with chromium(tmp_path) as tab, serving(app) as port:
            base = f"http://127.0.0.1:{port}"
            await tab.open(f"{base}/?lang=en")
            for typed, seen in (("no key", "This key is not valid here."), (key(Role.OPERATOR), "Nobody holds it")):
                await tab.until("document.activeElement.matches('.login input')")
                await tab.type(typed)
                await tab.press("Enter")
                await tab.sees(seen)
            await tab.sees("Logged in as the operator")
            for path in ("/wall", "/lobby/lift", "/"):
                await tab.open(f"{base}{path}?lang=en")
                await tab.until("document.querySelector('.card, .message') && !document.querySelector('.login')")
            # scripts cannot read it, and nothing of it is stored
            kept = "document.cookie + JSON.stringify({...localStorage}) + JSON.stringify({...sessionStorage})"
            assert "lift-manager-" + str(port) not in await tab.value(kept)
            assert "lm_" not in await tab.value(kept)
            # another tab logs in again, and this one has its cookie and the token of its own login
            await tab.value(
                "import('/page/src/api.js').then(async ({ Api }) => { const [one, other] = [new Api(), new Api()];"
                f" await one.askAccount(); await other.logIn('{key(Role.OPERATOR)}');"
                " await one.post('lifts/lift/drain', { by: 'M. Weber', reason: 'update' }); })"
            )
            assert site.decisions == [("begin_drain", "lift", "M. Weber (key the operator)", "update")]
            await tab.sees("Log out")
            await tab.value("document.querySelector('.card .open').click()")
            await tab.until("document.querySelector('dialog[open]')")
            # a login that ends elsewhere: nothing stands before the form
            await tab.value(
                "import('/page/src/api.js').then(async ({ Api }) => { const api = new Api(); await api.askAccount(); await api.logOut(); })"
            )
            await tab.until("document.activeElement.matches('.login input') && !document.querySelector('dialog')")
            await tab.type(key(Role.OPERATOR))
            await tab.press("Enter")
            await tab.sees("Log out")
            await tab.value("[...document.querySelectorAll('nav button')].find(b => b.innerText === 'Log out').click()")
            await tab.until("document.querySelector('.login input')")
            await tab.open(f"{base}/wall?lang=en")
            await tab.until("document.querySelector('.login input')")
            assert await tab.value("document.querySelectorAll('.card').length") == 0

    asyncio.run(use())
