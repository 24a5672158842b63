"""A machine that goes on alone over a stand-in for etcd, in virtual time, and a standby that comes back."""

import asyncio
import dataclasses
from collections.abc import Awaitable, Callable

from lift_manager.cluster.content import Place, Solo, encode_key, encode_solo
from lift_manager.cluster.etcd import put
from lift_manager.cluster.member import Member
from lift_manager.cluster.solo_member import SoloMember
from lift_manager.cluster.term import ANSWERING_S, RENEW_S, UNCHANGED_S, Key
from tests.lift_manager.cluster.test_member import AtOnce, now
from tests.support.memory_etcd import MemoryEtcd
from tests.support.virtual_time import cancel_all, elapse, run_virtual

PLACE = Place("Main hospital")
SOUTH = Key(0, 4, "south", "http://south:5003")


class Site:
    """One etcd without a majority at first, in which south was active last, and what north has on its disk."""

    def __init__(self) -> None:
        self.etcd = MemoryEtcd()
        self.etcd.transact([], [put(PLACE.active, encode_key(SOUTH))])
        self.solo = Solo("abc", "north", "south", "Eve", "today", 1_000_004, self.etcd.revision, 9)
        self.kept: list[Solo] = []
        self.etcd.has_majority = False

    def north(self, solo: Solo | None = None) -> SoloMember:
        north = "http://north:5003"
        return SoloMember(solo or self.solo, north, self.etcd, PLACE, self.kept.append, jobs=AtOnce, clock=now)

    def south(self) -> Member:
        return Member("south", "http://south:5003", self.etcd, PLACE, jobs=AtOnce, clock=now)

    def renew(self) -> None:
        """Let south be active for once, whatever this machine has found."""
        self.etcd.has_majority = True
        self.etcd.transact([], [put(PLACE.active, encode_key(SOUTH))])


def play(
    check: Callable[[Site, SoloMember], Awaitable[None]], solo: Callable[[Solo], Solo] = lambda solo: solo
) -> None:
    async def run() -> None:
        site = Site()
        north = site.north(solo(site.solo))
        tasks = [asyncio.create_task(north.run())]
        try:
            await check(site, north)
        finally:
            await cancel_all(tasks)

    run_virtual(run)


def test_it_is_active_without_etcd_in_an_epoch_of_its_own_and_says_so() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        assert "it looks first" in north.trouble
        active = await north.until_active()
        assert UNCHANGED_S <= now() < UNCHANGED_S + 2 * RENEW_S
        await elapse(60.0)
        assert active.remaining_s > 0
        assert (active.key.epoch, active.key.owner, active.alone) == (1_000_004, "north", site.solo.text)
        assert north.trouble == ""

    play(check)


def test_once_etcd_answers_it_says_there_that_it_is_alone_and_a_standby_that_comes_back_waits() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        active = await north.until_active()
        south = site.south()
        standby = asyncio.create_task(south.run())
        await elapse(10.0)
        site.etcd.has_majority = True
        await elapse(1.0)
        assert site.etcd.entries[PLACE.solo].value == encode_solo(site.solo)
        await elapse(ANSWERING_S + 60.0)
        assert south.active is None
        assert south.trouble == f"{site.solo.text}; `lift-manager cluster join` on north ends that"
        site.etcd.has_majority = False
        await elapse(60.0)
        assert active.remaining_s > 0
        assert site.kept == []
        await cancel_all([standby])

    play(check)


def test_another_manager_that_is_active_ends_its_term_and_this_is_remembered() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        active = await north.until_active()
        site.renew()
        await active.over.wait()
        assert active.remaining_s == 0.0
        assert [solo.contested for solo in site.kept] == [True]
        assert "another manager was active since" in north.trouble
        await north.give_up()
        north.stand_by()
        for _ in range(20):
            await elapse(RENEW_S)
            site.renew()
        assert north.active is None
        site.etcd.has_majority = False
        await elapse(60.0)
        assert north.active is None

    play(check)


def test_once_that_manager_has_ended_it_goes_on() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        active = await north.until_active()
        site.renew()
        await active.over.wait()
        await north.give_up()
        north.stand_by()
        again = await north.until_active()
        assert again is not active
        assert again.remaining_s > 0
        assert [solo.contested for solo in site.kept] == [True, False]
        assert PLACE.solo in site.etcd.entries

    play(check)


def test_a_term_that_was_given_up_begins_again_after_another_look() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        first = await north.until_active()
        await north.give_up()
        north.stand_by()
        assert first.over.is_set()
        given_up_at = now()
        assert (await north.until_active()).remaining_s > 0
        assert now() - given_up_at >= UNCHANGED_S

    play(check)


def test_a_start_after_that_does_not_trust_the_silence_of_etcd() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        await elapse(60.0)
        assert north.active is None
        site.etcd.has_majority = True
        assert (await north.until_active()).remaining_s > 0

    play(check, lambda solo: dataclasses.replace(solo, contested=True))


def test_a_decision_of_the_other_machine_that_etcd_holds_comes_first() -> None:
    async def check(site: Site, north: SoloMember) -> None:
        site.etcd.has_majority = True
        others = Solo("def", "south", "north", "Adam", "today", 2_000_004, 0, 9)
        site.etcd.transact([], [put(PLACE.solo, encode_solo(others))])
        await elapse(60.0)
        assert north.active is None

    play(check)
