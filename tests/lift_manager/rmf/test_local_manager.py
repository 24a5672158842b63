"""An adapter in the manager's own process: what it asks is decided at once, what it hears comes later and once for each turn."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace

from lift_manager.lift.refusals import Refusal
from lift_manager.lift.rmf_view import RmfRules
from lift_manager.plain.rmf import HeldBy, LiftView, PartialSiteView, SiteView
from lift_manager.rmf.local_manager import LocalManager
from lift_manager.rmf.port import Answer, EndOfSession, ManagerRequest, SessionDemand
from register_maps.words import Door
from tests.lift_manager.runtime.scripted import FRONT, OTHER, PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

AMR = "fleet/amr-7"
TO_L1 = SessionDemand("lift", AMR, "L1", hold_door=True)


def _nothing(_: Answer) -> None:
    """Nothing more is asked because of it."""


def soon(what: Callable[[], None]) -> None:
    asyncio.get_running_loop().call_soon(what)


@dataclass
class RecordingListener:
    """Writes down what an adapter hears."""

    sites: list[SiteView] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    """When each was asked for, and when it was heard."""
    answers: list[Answer] = field(default_factory=list)
    lost_for: list[str] = field(default_factory=list)
    after_answer: Callable[[Answer], None] = _nothing

    def on_site(self, site: SiteView, asked_at: float, now: float) -> None:
        self.sites.append(site)
        self.times.append((asked_at, now))

    def on_answer(self, answer: Answer, now: float) -> None:
        self.answers.append(answer)
        self.after_answer(answer)

    def on_manager_lost(self, reason: str, now: float) -> None:
        self.lost_for.append(reason)

    @property
    def lift(self) -> LiftView:
        (lift,) = self.sites[-1].lifts
        return lift


@dataclass
class Both:
    """A manager with one lift, and an adapter inside it."""

    bench: Bench
    local: LocalManager
    listener: RecordingListener

    async def said(self, asked: ManagerRequest) -> Answer:
        """What is answered, by the end of the turn."""
        before = len(self.listener.answers)
        self.local.send(asked)
        assert len(self.listener.answers) == before, "the adapter is not called while it asks"
        await elapse(0)
        (answer,) = self.listener.answers[before:]
        assert answer.request == asked
        return answer


def local(check: Callable[[Both], Awaitable[None]], rules: RmfRules | None = None) -> None:
    """Run a check on virtual time."""

    async def on(made: Bench) -> None:
        made.site.rmf = rules or RmfRules()
        both = Both(made, LocalManager(made.site), RecordingListener())
        both.local.start(both.listener, soon)
        assert both.listener.sites == [], "not before it has returned"
        await elapse(0)
        await check(both)
        both.local.close()

    on_bench(on, PLAIN, poll_s=0.2)


def test_the_lifts_are_told_at_once_with_what_the_site_says() -> None:
    async def check(both: Both) -> None:
        (site,) = both.listener.sites
        assert site.end_grace_s == 7
        assert (both.listener.lift.lift, both.listener.lift.live, both.listener.lift.floor) == ("lift", True, "L2")
        ((asked_at, now),) = both.listener.times
        assert asked_at == now == asyncio.get_running_loop().time()

    local(check, RmfRules(end_grace_s=7))


def test_a_demand_is_taken_and_a_site_from_its_event_on_shows_it() -> None:
    async def check(both: Both) -> None:
        answer = await both.said(TO_L1)
        assert answer.accepted
        await elapse(0)
        shows = [site for site in both.listener.sites if site.boot == answer.boot and site.event >= answer.event]
        assert shows
        assert {site.lifts[0].holder for site in shows} == {HeldBy("rmf", AMR)}
        await elapse(0.5)
        assert both.bench.presses == ["go_to L1"]

    local(check)


def test_a_manager_that_ends_takes_no_session_away() -> None:
    async def check(both: Both) -> None:
        await both.said(TO_L1)
        await elapse(1)
        await both.bench.life.stop()
        await elapse(1)
        assert both.listener.lift.holder == HeldBy("rmf", AMR)

    local(check)


def test_a_change_does_not_wait_for_the_one_before_it() -> None:
    async def check(both: Both) -> None:
        await elapse(1)
        for floor in ("L1", "L3") * 12:
            both.bench.accept(floor)
            await elapse(0)
            assert both.listener.lift.destination == floor
            await elapse(0.004)

    local(check)


def test_a_change_is_reported_without_the_other_lifts_and_all_of_them_again_and_again() -> None:
    async def check(both: Both) -> None:
        both.bench.accept("L1")
        await elapse(0)
        assert [type(site) for site in both.listener.sites] == [SiteView, PartialSiteView]
        await elapse(1)
        assert [type(site) for site in both.listener.sites].count(SiteView) > 3

    local(check)


def test_a_demand_that_changes_nothing_is_followed_by_a_site_as_new_as_its_answer() -> None:
    async def check(both: Both) -> None:
        await both.said(TO_L1)
        await elapse(0.6)
        told = len(both.listener.sites)
        answer = await both.said(TO_L1)
        (site,) = both.listener.sites[told:]
        assert (site.boot, site.lifts[0].lift) == (answer.boot, "lift")
        assert site.event >= answer.event

    local(check)


def test_a_no_has_its_code_and_its_reason() -> None:
    async def check(both: Both) -> None:
        answer = await both.said(replace(TO_L1, floor="L9"))
        assert (answer.accepted, answer.code) == (False, "unknown_floor")
        assert "its floors are L1, L2, L3" in answer.reason
        assert (await both.said(replace(TO_L1, lift="nowhere"))).code == "unknown_lift"
        both.bench.accept("L3", holder=OTHER)
        assert (await both.said(TO_L1)).code == "held"
        assert (await both.said(EndOfSession("lift", AMR, 0))).code == "held"

    local(check)


def test_an_end_has_its_grace_and_without_a_session_it_is_yes() -> None:
    async def check(both: Both) -> None:
        assert (await both.said(EndOfSession("lift", AMR, 3))).accepted
        assert (await both.said(TO_L1)).accepted
        assert (await both.said(EndOfSession("lift", AMR, 3))).accepted
        await elapse(2.9)
        assert both.listener.lift.holder == HeldBy("rmf", AMR)
        await elapse(0.2)
        assert both.listener.lift.holder is None

    local(check)


def test_an_adapter_may_ask_the_next_thing_while_it_is_answered() -> None:
    async def check(both: Both) -> None:
        more: list[ManagerRequest] = [replace(TO_L1, session="fleet/amr-8"), EndOfSession("lift", AMR, 0)]

        def ask_on(_: Answer) -> None:
            if more:
                both.local.send(more.pop())

        both.listener.after_answer = ask_on
        both.local.send(TO_L1)
        await elapse(0.1)
        assert [answer.accepted for answer in both.listener.answers] == [True, True, True]
        assert both.listener.lift.holder == HeldBy("rmf", "fleet/amr-8")

    local(check)


def test_whatever_changes_in_one_turn_is_told_once_and_what_does_not_change_three_times_within_max_age() -> None:
    async def check(both: Both) -> None:
        told = len(both.listener.sites)
        for number in range(30):
            both.local.send(replace(TO_L1, floor=f"L{1 + number % 3}"))
        await elapse(0)
        assert len(both.listener.sites) <= told + 2
        await elapse(0.2)
        told = len(both.listener.sites)
        await elapse(1)
        assert 3 <= len(both.listener.sites) - told <= 5

    local(check)


def test_a_change_of_the_lift_is_told_in_the_turn_in_which_it_is_known() -> None:
    async def check(both: Both) -> None:
        both.bench.driver.values = replace(both.bench.driver.values, floor="L3", doors={FRONT: Door.CLOSED})
        told = len(both.listener.sites)
        for _ in range(20):
            await elapse(0.01)
            if both.bench.state.floor == "L3":
                break
        assert both.listener.lift.floor == "L3"
        assert len(both.listener.sites) == told + 1

    local(check)


def test_a_lift_that_is_lost_is_told_as_not_live() -> None:
    async def check(both: Both) -> None:
        both.bench.driver.silent = True
        await elapse(1.2)
        assert not both.listener.lift.live
        assert "no answer" in both.listener.lift.reason
        assert both.listener.lift.age_s is not None
        assert both.listener.lift.age_s > 1
        assert (await both.said(TO_L1)).code == Refusal.OFFLINE

    local(check)


def test_after_close_nothing_is_told_any_more_and_it_may_begin_again() -> None:
    async def check(both: Both) -> None:
        both.local.send(TO_L1)
        both.local.close()
        told = len(both.listener.sites)
        await elapse(5)
        both.local.send(EndOfSession("lift", AMR, 0))
        await elapse(1)
        assert (both.listener.answers, len(both.listener.sites)) == ([], told)
        both.local.start(both.listener, soon)
        await elapse(0)
        assert both.listener.lift.holder is None
        await elapse(2)
        assert 5 < len(both.listener.sites) - told < 9, "three times a second, and not twice so often"
        assert both.listener.lost_for == []

    local(check)


def test_two_adapters_inside_have_sessions_of_their_own_even_of_one_name() -> None:
    async def check(both: Both) -> None:
        other = replace(TO_L1, adapter="5")
        assert (await both.said(other)).accepted
        await elapse(0)
        assert both.listener.lift.holder == HeldBy("rmf", AMR, "5")
        refused = await both.said(TO_L1)
        assert (refused.code, f"held by rmf:{AMR}@5" in refused.reason) == ("held", True)
        assert (await both.said(EndOfSession("lift", AMR, 0))).code == "held"
        assert (await both.said(EndOfSession("lift", AMR, 0, adapter="5"))).accepted
        await elapse(0.1)
        assert both.listener.lift.holder is None

    local(check)
