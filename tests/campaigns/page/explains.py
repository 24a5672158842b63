"""What the page says when something is missing, refused or wrong; in a real browser."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from drivers.model import Command, CommandKind, Outcome, Result
from lift_manager.api.lifts import Lift
from lift_manager.lift.commands import CommandState
from lift_manager.lift.events import CommandEnded, CommandFollowed
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.web.app import make_app
from register_maps.words import Door, Mode, Motion, Side
from tests.lift_manager.web.fake import FakeSite, serving
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.fake_sessions import a_command, a_session
from tests.lift_manager.web.listening import Happening
from tests.support.devtools import chromium

pytestmark = pytest.mark.external("chromium")

VIEWS = ["/", "/wall", "/lobby/lift"]


@pytest.mark.parametrize("path", VIEWS)
def test_a_view_that_cannot_fetch_its_texts_says_so_and_tries_again_by_itself(path: str, tmp_path: Path) -> None:
    app, has_texts = make_app(FakeSite()), asyncio.Event()

    async def without_texts(scope: Scope, receive: Receive, send: Send) -> None:
        lacks = not has_texts.is_set() and scope["type"] == "http" and "/texts/" in scope["path"]
        await (Response(status_code=503) if lacks else app)(scope, receive, send)

    async def use() -> None:
        async with chromium(tmp_path) as tab, serving(without_texts) as port:
            await tab.open(f"http://127.0.0.1:{port}{path}?lang=en")
            await tab.sees("No information at the moment" if path.startswith("/lobby") else "Connecting to the manager")
            await tab.until("document.querySelectorAll('body *:not(noscript)').length === 1")
            has_texts.set()
            await tab.until(
                "document.querySelector('.card:not(.unknown), .message') && !document.querySelector('.starting')"
            )

    asyncio.run(use())


def test_a_door_whose_contacts_contradict_each_other_is_a_warning(tmp_path: Path) -> None:
    async def use() -> None:
        site = Happening()
        async with chromium(tmp_path) as tab, serving(make_app(site)) as port:
            await tab.open(f"http://127.0.0.1:{port}/?lang=en")
            await tab.until("document.querySelectorAll('.card.tone-plain').length === 2")
            site.shift(doors={Side.FRONT: Door.UNKNOWN})
            await tab.sees("The door cannot be read (front)")
            await tab.until("document.querySelectorAll('.card.tone-warn').length === 1")
            await tab.sees("need attention: 1")
            site.shift(doors={Side.FRONT: Door.CLOSED})
            await tab.until("document.querySelectorAll('.card.tone-plain').length === 2")

    asyncio.run(use())


def test_a_session_whose_last_command_failed_says_so_while_nothing_else_explains_why_the_car_stands(
    tmp_path: Path,
) -> None:
    held: dict[str, Any] = {"holder": Holder("api", "amr-7"), "held_since_s": 60.0}
    shown = "Last command: Call to L2: sent, but nothing shows that it took effect. no lamp within 4 s"

    async def use() -> None:
        site = Happening()

        async def shows(said: bool) -> None:
            await tab.until(
                f"document.querySelector('.card .facts').innerText.includes({json.dumps(shown)}) === {json.dumps(said)}"
            )

        def ends(result: Result, reason: str = "") -> None:
            outcome = Outcome(Command(CommandKind.GO_TO, "L2"), result, reason)
            site.happens(CommandEnded("lift", outcome, Holder("api", "amr-7")))

        async with chromium(tmp_path) as tab, serving(make_app(site)) as port:
            await tab.open(f"http://127.0.0.1:{port}/?lang=en")
            await tab.until("document.querySelector('.card:not(.unknown)')")
            site.shift(**held)
            ends(Result.UNCONFIRMED, "no lamp within 4 s")
            await shows(True)
            await tab.value("document.querySelector('.card .open').click()")
            await tab.until(
                "[...document.querySelectorAll('dialog dt')].some((one) => one.innerText === 'Last command')"
            )
            explanations: tuple[dict[str, Any], ...] = (
                {"motion": Motion.UP},
                {"robot_door": RobotDoor.OPEN},
                {"mode": Mode.INSPECTION},
                {"restrictions": replace(IDLE.restrictions, waiting_for="the lift")},
            )
            for explained in explanations:
                site.shift(**explained)
                await shows(False)
                site.lifts["lift"] = IDLE
                site.shift(**held)
                await shows(True)
            ends(Result.CONFIRMED)
            await shows(False)
            # one that was refused without a press
            call = a_command(a_session(Holder("api", "amr-7")), "c1")
            rejected = replace(call, state=CommandState.REJECTED, reason="the door is held")
            site.happens(CommandFollowed("lift", rejected, is_recorded=True))
            await tab.sees("Last command: Call to L2: not carried out. the door is held")
            # another session of the same robot has nothing to do with it
            site.shift(holder=None, held_since_s=None)
            site.shift(**held)
            await tab.until("!document.querySelector('.card .failed')")
            assert tab.complaints == []

    asyncio.run(use())


def test_an_outcome_counts_for_the_session_in_which_it_came_however_long_that_lasts(tmp_path: Path) -> None:
    def held(for_s: float) -> str:
        lift = Lift.of(replace(IDLE, holder=Holder("api", "amr-7"), held_since_s=for_s), max_age_s=2.0)
        return lift.model_dump_json()

    outcome = {"lift": "lift", "holder": "api:amr-7", "command": "go_to L2", "result": "unconfirmed", "reason": "late"}

    async def use() -> None:
        async with chromium(tmp_path) as tab, serving(make_app(FakeSite())) as port:
            await tab.open(f"http://127.0.0.1:{port}/?lang=en")
            await tab.until("document.querySelector('.card')")
            for later, counts in ((held(60.0), True), (held(1.0), False)):
                found = await tab.value(
                    "Promise.all([import('/page/src/store.js'), import('/page/src/facts.js')]).then(([{ Store }, { failedCommand }]) => {"
                    f" const store = new Store(); store.setLift({held(0.0)}, 0); store.addCommand({json.dumps(outcome)}, 30_000);"
                    f" store.setLift({later}, 60_000);"
                    " const same = (text) => text;"
                    " return failedCommand(store.record('lift'), { t: same, word: same }) !== null; })"
                )
                assert found is counts

    asyncio.run(use())


def test_an_operator_locks_a_lift_out_only_after_saying_where_they_stood(tmp_path: Path) -> None:
    async def use() -> None:
        site = FakeSite()
        async with chromium(tmp_path) as tab, serving(make_app(site)) as port:
            await tab.open(f"http://127.0.0.1:{port}/?lang=en")
            await tab.until("document.querySelector('.card .open')")
            await tab.value("document.querySelector('.card .open').focus()")
            await tab.press("Enter")
            await tab.sees("Lock out")
            await tab.value(
                "[...document.querySelectorAll('.actions button')].find(b => b.innerText === 'Lock out').focus()"
            )
            await tab.press("Enter")
            for number, text in enumerate(("M. Weber", "new ropes")):
                await tab.until(f"document.querySelectorAll('.decision label input')[{number}]")
                await tab.value(f"document.querySelectorAll('.decision label input')[{number}].focus()")
                await tab.type(text)
            await tab.value("document.querySelector('.decision button').click()")
            assert site.decisions == []
            await tab.value("document.querySelector('.decision .check input').click()")
            await tab.value("document.querySelector('.decision button').click()")
            await tab.sees("Locked out.")
            assert site.decisions == [("lock_out", "lift", "M. Weber (stood at the lift)", "new ropes")]

    asyncio.run(use())
