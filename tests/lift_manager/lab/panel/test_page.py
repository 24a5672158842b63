"""The page of the panel: what a browser is sent, that its texts are whole, and what a real browser makes of it."""

import asyncio
import json
import re
from pathlib import Path

import pytest

from lift_manager.lab.panel.app import PAGE, make_panel
from lift_manager.lab.panel.faults import FaultGroup
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, WIRE
from lift_manager.web.page import FOLDER
from simulator.faults import PowerLoss
from simulator.modes import Key
from tests.lift_manager.lab.panel.paneled import paneled
from tests.lift_manager.web.fake import ask_app, serving
from tests.support.devtools import chromium
from tests.support.rows import each_row

SCRIPTS = [PAGE / "main.js", *(PAGE / "src").glob("*.js")]
LANGUAGES = list(json.loads((FOLDER / "texts" / "languages.json").read_text("utf-8")))


CHANGES = """{
    const changes = new m.Changes();
    const row = (name, raw, value) => ({ name, raw, value });
    const of = (now) => ["fire", "alive"].map((name) => changes.of(name, now));
    const take = (fire, alive, now) => changes.take([row("fire", [fire], fire ? "yes" : "no"), row("alive", [alive], String(alive))], now);
    take(0, 1, 0);
    const found = [of(100)];
    take(1, 1, 200);
    found.push(of(300));
    for (let now = 6000; now < 8000; now += 500) take(1, now, now);
    changes.take([row("fire", null, null)], 8000);
    found.push(of(8000));
    return found;
}"""
"""What is marked of two registers: of one that changes once and is then not known, and of one that always changes."""


def texts_of(language: str) -> dict[str, str]:
    """The texts of the panel, and those of the manager's page that it uses too."""
    own: dict[str, str] = json.loads((PAGE / "texts" / f"{language}.json").read_text("utf-8"))
    shared: dict[str, str] = json.loads((FOLDER / "texts" / f"{language}.json").read_text("utf-8"))
    assert own.keys().isdisjoint(shared)
    return shared | own


def test_a_browser_runs_no_script_but_ours_and_asks_nobody_but_the_panel() -> None:
    app = make_panel([paneled()])
    policy = dict(
        part.split(" ", 1) for part in ask_app(app, "GET", "/").headers["content-security-policy"].split("; ")
    )
    assert policy["default-src"] == policy["frame-ancestors"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    for path in ("panel/main.js", "panel/panel.css", "panel/texts/de.json", "page/vendor/htm-preact.js"):
        served = ask_app(app, "GET", f"/{path}")
        assert (served.status_code, served.headers["x-content-type-options"]) == (200, "nosniff")


@each_row("language", LANGUAGES)
def test_a_language_has_every_text_of_the_panel_with_the_same_values_to_fill_in(language: str) -> None:
    english, texts = texts_of("en"), texts_of(language)
    assert texts.keys() == english.keys()
    filled = {key: sorted(re.findall(r"{\w+}", text)) for key, text in texts.items()}
    assert filled == {key: sorted(re.findall(r"{\w+}", text)) for key, text in english.items()}
    assert all(texts.values())


def test_every_text_that_a_script_names_is_there_and_every_text_of_the_panel_is_named() -> None:
    own = json.loads((PAGE / "texts" / "en.json").read_text("utf-8"))
    scripts = "".join(file.read_text("utf-8") for file in SCRIPTS)
    assert {key for key in re.findall(r"\bt\(\"([\w.]+)\"", scripts) if key not in texts_of("en")} == set()
    prefixes = tuple(f"{prefix}." for prefix in re.findall(r"\bt\([^)]*?`(\w+)\.\$\{", scripts))
    assert [key for key in own if f'"{key}"' not in scripts and not key.startswith(prefixes)] == []


def test_every_fault_group_and_key_of_the_simulator_has_a_text() -> None:
    texts = texts_of("en")
    names = {f"fault.{name}" for name in (*DEVICE_FAULTS, *WIRE)}
    names |= {f"group.{group}" for group in FaultGroup} | {f"key.{key}" for key in Key}
    assert {text for text in texts if text.startswith(("fault.", "group.", "key."))} == names
    usual = re.findall(r"name: \"(\w+)\", values", (PAGE / "src" / "faults.js").read_text("utf-8"))
    assert set(usual) <= DEVICE_FAULTS.keys() | WIRE.keys()
    assert {text for text in texts if text.startswith("usual.")} == {f"usual.{name}" for name in usual}


@pytest.mark.external("chromium")
def test_a_real_browser_presses_makes_faults_and_marks_the_registers_that_changed(tmp_path: Path) -> None:
    async def use() -> None:
        lift = paneled(speed=10.0)
        at_rest = lift.face.inputs
        async with chromium(tmp_path) as tab:
            async with serving(make_panel([lift])) as port:
                await tab.open(f"http://127.0.0.1:{port}/?lang=en")
                await tab.until("document.querySelectorAll('.registers tbody tr').length > 10")
                assert await tab.value(f"import('/panel/src/changes.js').then((m) => {CHANGES})") == [
                    [None, None],
                    [{"counts": False, "before": "no"}, None],
                    [None, {"counts": True}],
                ]
                await tab.value("document.querySelector('[aria-label=\"Landing call L3\"]').focus()")
                await tab.press("Enter")
                await tab.sees("At L3")
                # looked for in the page itself: the mark lasts for some seconds only
                marked = await tab.value(
                    "new Promise((done) => { const look = () => { const row = document.querySelector('tr.changed');"
                    " row ? done(row.innerText) : setTimeout(look, 20); };"
                    " document.querySelector('[aria-label=\"Landing call L1\"]').click(); look(); })"
                )
                assert "◆" in marked
                assert "was " in marked
                await tab.value(
                    "[...document.querySelectorAll('.switch')].find(b => b.innerText.includes('Too much')).click()"
                )
                await tab.until("document.querySelectorAll('.switch[aria-pressed=true]').length === 1")
                assert lift.face.inputs.overload
                await tab.value(
                    "(() => { const choice = document.querySelector('.chosen select'); choice.value = 'wrong_floor';"
                    " choice.dispatchEvent(new Event('change')); })()"
                )
                await tab.until("document.querySelector('.chosen input')")
                await tab.value("document.querySelector('.chosen input').focus()")
                await tab.type("-1")
                await tab.press("Enter")
                await tab.sees("wrong_floor, by=-1")
                await tab.value(
                    "[...document.querySelectorAll('button')].find(b => b.innerText.startsWith('End every')).click()"
                )
                await tab.sees("None.")
                assert lift.face.inputs == at_rest
                lift.begin(PowerLoss())
                await tab.sees("does not answer")
                await tab.until("document.querySelectorAll('tbody tr:not(.unknown)').length === 0")
                assert tab.complaints == []
                assert {url.split("/")[2] for url in tab.requested} == {f"127.0.0.1:{port}"}
            await tab.sees("No news from the simulator")
            await tab.until("document.querySelector('.shaft.unknown')")
            await tab.until("document.querySelectorAll('.call:disabled').length === 8")
            await tab.sees("Position unknown")

    asyncio.run(use())
