"""Two members over a stand-in for etcd, in virtual time: who is active, until when, and how roles change."""

import asyncio
import itertools
from asyncio import Future
from collections.abc import Awaitable, Callable, Sequence

import pytest

from lift_manager.cluster.content import (
    VERSION,
    Handover,
    Head,
    Place,
    decode_key,
    encode_handover,
    encode_head,
    encode_key,
)
from lift_manager.cluster.errors import EtcdUnavailable
from lift_manager.cluster.etcd import Etcd, Json, put, read
from lift_manager.cluster.etcd import Result as EtcdResult
from lift_manager.cluster.member import SILENCE_S, Member
from lift_manager.cluster.term import ANSWERING_S, RENEW_S, UNCHANGED_S, Key
from lift_manager.store.committer import Result
from tests.support.memory_etcd import MemoryEtcd
from tests.support.virtual_time import cancel_all, elapse, run_virtual

PLACE = Place("Main hospital")


def now() -> float:
    return asyncio.get_running_loop().time()


class AtOnce:
    """Carries out each job when it is submitted."""

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        future: Future[Result] = asyncio.get_running_loop().create_future()
        try:
            future.set_result(work())
        except Exception as error:  # noqa: BLE001  raised again where the job is awaited
            future.set_exception(error)
        return future

    def stop(self) -> None:
        """Have no thread."""


class Cable(Etcd):
    """What one machine reaches etcd by."""

    def __init__(self, etcd: MemoryEtcd) -> None:
        super().__init__(["http://127.0.0.1:1"], timeout_s=1.0)
        self._shared = etcd
        self.is_cut = False

    def transact(self, compare: Sequence[Json], then: Sequence[Json], otherwise: Sequence[Json] = ()) -> EtcdResult:
        if self.is_cut:
            raise EtcdUnavailable("the cable is cut")
        return self._shared.transact(compare, then, otherwise)


class Pair:
    """Machines, and the etcd that they share."""

    def __init__(self, *names: str) -> None:
        self.etcd = MemoryEtcd()
        self.cables = {name: Cable(self.etcd) for name in names}
        self.members = [
            Member(name, f"http://{name}:5003", cable, PLACE, jobs=AtOnce, clock=now)
            for name, cable in self.cables.items()
        ]

    def write(self, key: str, value: bytes) -> None:
        self.etcd.transact([], [put(key, value)])

    def key(self) -> Key:
        return decode_key(self.etcd.transact([], [read(PLACE.active)]).ranges[0])


def play(check: Callable[..., Awaitable[None]], *names: str, prepared: bool = True) -> None:
    async def run() -> None:
        pair = Pair(*names)
        if prepared:
            pair.write(PLACE.active, encode_key(Key(0)))
        tasks = [asyncio.create_task(member.run()) for member in pair.members]
        try:
            await check(pair, *pair.members)
        finally:
            await cancel_all(tasks)

    run_virtual(run)


def test_one_of_two_is_active_and_the_other_knows_where() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        await elapse(10.0)
        assert pair.key().owner == "a"
        assert a.active is not None
        assert a.active.key.epoch == 1
        assert b.active is None
        assert b.key is not None
        assert b.key.address == "http://a:5003"

    play(check, "a", "b")


def test_in_an_etcd_that_was_never_prepared_nobody_is_active() -> None:
    async def check(pair: Pair, a: Member) -> None:
        await elapse(10.0)
        assert a.active is None
        assert "cluster init" in a.trouble
        assert pair.etcd.entries == {}

    play(check, "a", prepared=False)


def test_the_fence_moves_with_every_renewal_and_falls_when_etcd_is_silent() -> None:
    async def check(pair: Pair, a: Member) -> None:
        active = await a.until_active()
        fences: list[float] = []
        active.follow(fences.append)
        await elapse(RENEW_S * 3.5)
        steps = [later - earlier for earlier, later in itertools.pairwise(fences)]
        assert steps == pytest.approx([RENEW_S] * 3)
        assert active.remaining_s == pytest.approx(fences[-1] - now())
        pair.cables["a"].is_cut = True
        await active.ends.wait()
        assert 0.0 < active.clear_s < active.remaining_s < 0.3
        assert not active.releases.is_set()
        await active.releases.wait()
        assert active.remaining_s > 0.0
        await active.over.wait()
        assert now() == pytest.approx(fences[-1])
        pair.cables["a"].is_cut = False
        await elapse(10.0)
        assert a.active is active
        assert active.remaining_s == 0.0
        assert fences[-1] < now()

    play(check, "a")


def test_the_other_machine_takes_over_within_three_seconds() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        lost = await a.until_active()
        await elapse(1.0)
        pair.cables["a"].is_cut = True
        cut_at = now()
        taken = await b.until_active()
        assert lost.over.is_set()
        assert (taken.key.epoch, pair.key().owner) == (2, "b")
        assert UNCHANGED_S - RENEW_S < now() - cut_at < 3.0

    play(check, "a", "b")


def test_a_machine_that_gives_up_is_followed_at_once() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        active = await a.until_active()
        a.leave()
        await elapse(5.0)  # what it takes to release everything
        assert active.remaining_s > 1.0
        await a.give_up()
        given_up_at = now()
        assert active.remaining_s == 0.0
        a.stand_by()
        taken = await b.until_active()
        assert now() - given_up_at <= RENEW_S
        assert taken.key.epoch == 2
        await elapse(5.0)
        assert a.active is None

    play(check, "a", "b")


def test_a_machine_without_another_takes_the_key_again_after_it_has_given_up() -> None:
    async def check(pair: Pair, a: Member) -> None:
        await a.until_active()
        await a.give_up()
        a.stand_by()
        given_up_at = now()
        assert (await a.until_active()).key.epoch == 2
        assert now() - given_up_at == pytest.approx(UNCHANGED_S, abs=RENEW_S)

    play(check, "a")


def test_a_term_that_is_over_is_not_given_up_for_another() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        await a.until_active()
        pair.cables["a"].is_cut = True
        await b.until_active()
        pair.cables["a"].is_cut = False
        await a.give_up()
        assert pair.key().owner == "b"

    play(check, "a", "b")


def test_a_handover_needs_a_standby_and_the_present_epoch() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        active = await a.until_active()
        pair.cables["b"].is_cut = True
        pair.write(PLACE.handover, encode_handover(Handover(1, "Eve")))
        await elapse(3.0)
        assert not active.ends.is_set()
        pair.write(PLACE.handover, encode_handover(Handover(7, "Eve", "b")))
        await elapse(3.0)
        assert not active.ends.is_set()
        pair.write(PLACE.handover, encode_handover(Handover(1, "Eve")))
        pair.cables["b"].is_cut = False
        await active.over.wait()
        assert pair.key().owner == "a"  # what was decided is still to be committed
        await a.give_up()
        assert (await b.until_active()).key.epoch == 2
        await elapse(3.0)
        assert b.active is not None
        assert not b.active.ends.is_set()

    play(check, "a", "b")


def test_a_standby_accepts_a_handover_once_it_could_take_over_and_not_before() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        pair.cables["b"].is_cut = True
        active = await a.until_active()
        pair.write(PLACE.handover, encode_handover(Handover(1, "Eve")))
        pair.cables["b"].is_cut = False
        await elapse(ANSWERING_S - 0.1)
        assert not active.ends.is_set()
        await active.over.wait()
        await a.give_up()
        given_up_at = now()
        await b.until_active()
        assert now() - given_up_at <= RENEW_S

    play(check, "a", "b")


def test_a_standby_that_cannot_read_what_the_active_wrote_accepts_no_handover() -> None:
    async def check(pair: Pair, a: Member, _: Member) -> None:
        active = await a.until_active()
        pair.write(PLACE.head, encode_head(Head(9, "x", version=VERSION + 1)))
        await elapse(1.0)
        pair.write(PLACE.handover, encode_handover(Handover(1, "Eve")))
        await elapse(20.0)
        assert not active.ends.is_set()

    play(check, "a", "b")


def test_a_standby_of_an_older_version_takes_nothing_that_it_cannot_read_and_says_so() -> None:
    async def check(pair: Pair, older: Member) -> None:
        pair.write(PLACE.head, encode_head(Head(9, "x", version=VERSION + 1)))
        await elapse(60.0)
        assert older.active is None
        assert "install the newer version on this machine too" in older.trouble
        pair.write(PLACE.head, encode_head(Head(10, "x")))
        assert (await older.until_active()).remaining_s > 0

    play(check, "older")


def test_a_standby_reports_that_etcd_is_silent_for_longer_than_an_election() -> None:
    async def check(pair: Pair, a: Member, b: Member) -> None:
        await a.until_active()
        pair.cables["b"].is_cut = True
        await elapse(SILENCE_S - 1.0)
        assert b.trouble == ""
        await elapse(2.0)
        assert b.trouble == "the cable is cut"
        pair.cables["b"].is_cut = False
        await elapse(1.0)
        assert b.trouble == ""

    play(check, "a", "b")
