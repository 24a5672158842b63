"""GET lift_state and GET /api/v1/lifts keep their newest answer, and give at every moment what one that keeps nothing gives."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, cast

from starlette.types import ASGIApp, Message, Scope

from lift_manager.api.lifts import Lift
from lift_manager.lift.state import LiftState
from lift_manager.runtime.site import Site
from lift_manager.web.app import make_app
from lift_manager.web.lift_texts import LiftTexts
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import OPEN_AT_L1, open_at_l1
from tests.lift_manager.web.fake import STATE
from tests.support.virtual_time import elapse

CLEAR_S = 3.0
CLOSE_S = 0.0004
"""Less than the time between the age limit of a reading and the tick for it."""


class WorkedOut:
    """A site that works out every state anew."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def __getattr__(self, name: str) -> Any:
        return getattr(self._site, name)

    def lasting_state(self, lift: str) -> LiftState:
        return self._site.state(lift)


async def answer(app: ASGIApp) -> bytes:
    """Head and body of the answer to GET lift_state."""
    scope: Scope = {
        "type": "http",
        "method": "GET",
        "path": STATE,
        "query_string": b"lift_name=lift",
        "headers": [(b"host", b"localhost")],
    }
    sent: list[Message] = []

    async def receive() -> Message:
        raise AssertionError("a GET has no body")

    async def send(message: Message) -> None:
        sent.append(message)

    await app(scope, receive, send)
    return repr(sent[0]).encode() + b"".join(message.get("body", b"") for message in sent)


class Watch:
    """Compares the answers of both applications, and the kept text with the model; keeps each answer that differs from the one before."""

    def __init__(self, made: Bench) -> None:
        self._site = made.site
        self._max_age_s = made.site.config("lift").capabilities.max_age_s
        self._texts = LiftTexts(made.site)
        self._keeping = make_app(made.site)
        self._working_out = make_app(cast("Site", WorkedOut(made.site)))
        self.answers: list[bytes] = []

    async def look(self) -> None:
        found = await answer(self._keeping)
        assert found == await answer(self._working_out)
        lift = Lift.of(self._site.state("lift"), max_age_s=self._max_age_s)
        assert self._texts.of("lift").whole() == lift.model_dump_json().encode()
        if self.answers[-1:] != [found]:
            self.answers.append(found)

    async def over(self, seconds: float, step_s: float = 0.01) -> None:
        """Look again and again, and at the end."""
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        while (left_s := end - loop.time()) > 0:
            await self.look()
            await asyncio.sleep(min(step_s, left_s))
        await self.look()

    def is_open(self) -> list[bool]:
        """Whether each of the answers invites a robot."""
        return [b'"door_state":2' in found for found in self.answers]


def on_watched_bench(check: Callable[[Bench, Watch], Awaitable[None]]) -> None:
    async def watched(made: Bench) -> None:
        await check(made, Watch(made))

    # no poll falls on a moment at which time changes something
    on_bench(watched, PLAIN, lease_s=12.0, clear_s=CLEAR_S, poll_s=0.17)


def test_open_begins_with_the_reading_after_the_hold_and_ends_clear_s_before_the_release() -> None:
    async def check(made: Bench, watch: Watch) -> None:
        made.driver.values = OPEN_AT_L1
        await elapse(0.5)
        await watch.look()
        made.accept("L1")
        await watch.over(1, CLOSE_S)
        left_s = made.state.releases_in_s
        assert left_s is not None
        await watch.over(left_s - CLEAR_S - 0.05)
        await watch.over(0.05, CLOSE_S)
        await watch.over(0.05, CLOSE_S)
        assert watch.is_open() == [True, False, True, False]
        await watch.over(CLEAR_S)
        assert made.state.holder is None

    on_watched_bench(check)


def test_a_lift_is_offline_as_soon_as_its_reading_is_too_old_and_live_with_the_next() -> None:
    async def check(made: Bench, watch: Watch) -> None:
        await open_at_l1(made)
        await watch.look()
        made.driver.silent = True
        await watch.over(made.driver.capabilities.max_age_s + 0.5, CLOSE_S)
        made.driver.silent = False
        await watch.over(0.5)
        live, *offline, again = watch.answers
        assert again == live
        assert all(b'"success":false' in found for found in offline)
        assert b"last reading 1.0 s ago" in offline[0]

    on_watched_bench(check)


def test_a_person_withdraws_open_between_two_readings() -> None:
    async def check(made: Bench, watch: Watch) -> None:
        await open_at_l1(made)
        await watch.look()
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await watch.look()
        assert watch.is_open() == [True, False]

    on_watched_bench(check)


def test_a_state_is_worked_out_once_for_all_who_request_it_between_two_readings() -> None:
    async def check(made: Bench) -> None:
        first = made.site.lasting_state("lift")
        assert made.site.lasting_state("lift") is first
        await elapse(0.2)
        assert made.site.lasting_state("lift") is not first

    on_bench(check, PLAIN, poll_s=0.2)
