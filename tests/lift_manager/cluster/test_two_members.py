"""Two members and a model of etcd: whatever is lost, late, stopped or slow, never may both write at the same moment."""

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from lift_manager.cluster import solo
from lift_manager.cluster.solo import Found, Mark, SoloOrder, Watch
from lift_manager.cluster.term import (
    ANSWER_S,
    TERM_S,
    UNCHANGED_S,
    Answered,
    Key,
    Order,
    Role,
    Sent,
    Term,
    Tick,
    Unanswered,
    step,
)
from tests.support.examples import examples

RUN_S = 60.0
FASTEST = 1.1
"""The rates of two clocks differ by 10 % at most."""
LOST_IN_A_ROW = 3
"""`ANSWERING_S` has room for so many."""


class Arbiter:
    """What etcd does with the key: one change after the other, each with the next revision."""

    def __init__(self) -> None:
        self.key = Key(1)
        self.solo = ""
        """The machine that goes on alone."""
        self.answers_from = 0.0

    def mark(self, revision: int, owner: str) -> None:
        if self.key.revision == revision and not self.solo:
            self.solo = owner

    def carry_out(self, order: Order, expected: Key | None, owner: str) -> tuple[Key, bool]:
        if order is Order.TAKE and self.solo:
            return self.key, False
        if order is Order.LOOK or expected is None or expected.revision != self.key.revision:
            return self.key, False
        epoch = self.key.epoch + (order is Order.TAKE)
        self.key = Key(self.key.revision + 1, epoch, owner)
        return self.key, True


@dataclass
class Weather:
    """What happens to requests and processes, from one seed."""

    dice: random.Random
    loss: float
    slow: float
    stop: float

    def delay_s(self) -> float:
        if self.dice.random() < self.slow:
            return self.dice.uniform(0.0, self.dice.choice((ANSWER_S, 6.0)))
        return self.dice.uniform(0.001, 0.02)

    def is_lost(self) -> bool:
        return self.dice.random() < self.loss


@dataclass
class World:
    """Real time, in which everything happens in order."""

    weather: Weather
    arbiter: Arbiter = field(default_factory=Arbiter)
    now: float = 0.0
    queue: list[tuple[float, int, Callable[[], None]]] = field(default_factory=list)
    numbers: int = 0

    def at(self, when: float, call: Callable[[], None]) -> None:
        self.numbers += 1
        heapq.heappush(self.queue, (when, self.numbers, call))

    def run(self, watch: Callable[[], None]) -> None:
        while self.queue and self.queue[0][0] <= RUN_S:
            self.now, _, call = heapq.heappop(self.queue)
            watch()
            call()
            watch()


class Machine:
    """One manager: its clock has a rate of its own, and it may be stopped at any moment."""

    def __init__(self, name: str, rate: float, world: World) -> None:
        self.name, self.rate, self.world = name, rate, world
        self.term = Term()
        self.offset = world.weather.dice.uniform(0.0, 1e5)
        self.stopped_until = 0.0
        self.request = 0
        self.terms = 0
        self.tick()

    @property
    def clock(self) -> float:
        return self.offset + self.world.now * self.rate

    @property
    def may_write(self) -> bool:
        """What the fence lets pass; a stopped process counts, for it may be resumed between the check and the next line."""
        return self.term.role in (Role.ACTIVE, Role.LEAVING) and self.clock < self.term.until

    def real(self, clock: float) -> float:
        return (clock - self.offset) / self.rate

    def when_running(self, call: Callable[[], None]) -> None:
        if self.world.now < self.stopped_until:
            self.world.at(self.stopped_until, partial(self.when_running, call))
        else:
            call()

    def tick(self) -> None:
        self.stop_perhaps()
        self.when_running(lambda: self.take(Tick(self.clock)))

    def stop_perhaps(self) -> None:
        dice = self.world.weather.dice
        if dice.random() < self.world.weather.stop:
            self.stopped_until = self.world.now + dice.uniform(0.1, dice.choice((TERM_S, 30.0)))

    def take(self, happened: Tick | Answered | Unanswered) -> None:
        self.term, orders = step(self.term, happened)
        if self.term.role is Role.OVER:
            self.term = Term()  # it starts again as a standby
            self.request += 1
        for order in orders:
            if order in (Order.LOOK, Order.TAKE, Order.RENEW):
                self.send(order)
        # a timer may be late, and never early
        late_s = self.world.weather.dice.uniform(0.0, 0.01)
        self.world.at(max(self.real(self.term.wake_at), self.world.now) + late_s, partial(self.tick_of, self.request))

    def tick_of(self, request: int) -> None:
        if request == self.request:
            self.tick()

    def send(self, order: Order) -> None:
        self.term, _ = step(self.term, Sent(self.clock))
        self.request += 1
        number, expected, weather = self.request, self.term.key, self.world.weather
        arrives = self.world.now + weather.delay_s()
        if not weather.is_lost():
            self.world.at(arrives, partial(self.arrive, number, order, expected))
        self.world.at(self.world.now + ANSWER_S / self.rate, partial(self.give_up, number))
        self.stop_perhaps()

    def arrive(self, number: int, order: Order, expected: Key | None) -> None:
        if self.world.now < self.world.arbiter.answers_from:
            return
        key, applied = self.world.arbiter.carry_out(order, expected, self.name)
        if not self.world.weather.is_lost():
            answer = partial(self.answered, number, order, key, applied, is_barred=bool(self.world.arbiter.solo))
            self.world.at(self.world.now + self.world.weather.delay_s(), partial(self.when_running, answer))

    def answered(self, number: int, order: Order, key: Key, applied: bool, *, is_barred: bool) -> None:
        if number == self.request and self.term.sent_at is not None:
            self.terms += order is Order.TAKE and applied
            self.take(Answered(order, self.term.sent_at, self.clock, key, applied, is_barred))

    def give_up(self, number: int) -> None:
        self.when_running(lambda: self.unanswered(number))

    def unanswered(self, number: int) -> None:
        if number == self.request and self.term.sent_at is not None:
            self.take(Unanswered(self.term.sent_at, self.clock))


class SoloMachine:
    """A machine that goes on alone. Of its requests never more than `LOST_IN_A_ROW` in a row are lost while etcd has a majority."""

    def __init__(self, name: str, rate: float, world: World) -> None:
        self.name, self.rate, self.world = name, rate, world
        self.offset = world.weather.dice.uniform(0.0, 1e5)
        self.watch = Watch(world.arbiter.key.revision, self.clock)
        self.stopped_until = 0.0
        self.sent = self.lost = self.active_looks = 0
        self.tick()

    @property
    def clock(self) -> float:
        return self.offset + self.world.now * self.rate

    @property
    def may_write(self) -> bool:
        return self.watch.is_active and self.clock < self.watch.until

    def when_running(self, call: Callable[[], None]) -> None:
        if self.world.now < self.stopped_until:
            self.world.at(self.stopped_until, partial(self.when_running, call))
        else:
            call()

    def stop_perhaps(self) -> None:
        dice = self.world.weather.dice
        if dice.random() < self.world.weather.stop:
            self.stopped_until = self.world.now + dice.uniform(0.1, dice.choice((TERM_S, 30.0)))

    def tick(self) -> None:
        self.stop_perhaps()
        self.when_running(lambda: self.take(Tick(self.clock)))

    def take(self, happened: Tick | Found | Unanswered) -> None:
        self.watch, orders = solo.step(self.watch, happened)
        self.active_looks += self.watch.is_active
        for order in orders:
            if order is not SoloOrder.FENCE:
                self.send(order)
        if self.watch.sent_at is None:
            late_s = self.world.weather.dice.uniform(0.0, 0.01)
            self.world.at(max((self.watch.wake_at - self.offset) / self.rate, self.world.now) + late_s, self.tick)

    def send(self, order: SoloOrder) -> None:
        self.watch, _ = solo.step(self.watch, Sent(self.clock))
        self.sent += 1
        self.lost = self.lost + 1 if self.world.weather.is_lost() and self.lost < LOST_IN_A_ROW else 0
        arrives = self.world.now + self.world.weather.dice.uniform(0.001, ANSWER_S / 2)
        if not self.lost:
            self.world.at(arrives, partial(self.arrive, self.sent, order, self.watch.revision))
        self.world.at(self.world.now + ANSWER_S / self.rate, partial(self.give_up, self.sent))
        self.stop_perhaps()

    def arrive(self, number: int, order: SoloOrder, revision: int) -> None:
        arbiter = self.world.arbiter
        if self.world.now < arbiter.answers_from:
            return
        if order is SoloOrder.MARK:
            arbiter.mark(revision, self.name)
        mark = Mark.OWN if arbiter.solo == self.name else Mark.MISSING
        answer = partial(self.answered, number, arbiter.key.revision, mark)
        self.world.at(self.world.now + 0.005, partial(self.when_running, answer))

    def answered(self, number: int, revision: int, mark: Mark) -> None:
        if number == self.sent and self.watch.sent_at is not None:
            self.take(Found(self.watch.sent_at, self.clock, revision, mark))

    def give_up(self, number: int) -> None:
        self.when_running(lambda: self.unanswered(number))

    def unanswered(self, number: int) -> None:
        if number == self.sent and self.watch.sent_at is not None:
            self.take(Unanswered(self.watch.sent_at, self.clock))


def play_solo(
    seed: int, *, owner: str, loss: float, stop: float, answers_from: float, on_at: float, rates: tuple[float, float]
) -> tuple[SoloMachine, list[Machine]]:
    """One machine goes on alone; etcd answers from this time on, and the other machine is switched on against what was vouched for."""
    world = World(Weather(random.Random(seed), loss, 0.0, stop))
    world.arbiter.key, world.arbiter.answers_from = Key(9, 3, owner), answers_from
    alone, others = SoloMachine("a", rates[0], world), []
    world.at(on_at, lambda: others.append(Machine("b", rates[1], world)))

    def watch() -> None:
        assert not (alone.may_write and any(other.may_write for other in others)), (
            f"both may write at {world.now:.3f} s"
        )

    world.run(watch)
    return alone, others


def test_a_machine_that_goes_on_alone_never_writes_beside_another_that_comes_back() -> None:
    @given(
        st.integers(0, 2**32),
        st.sampled_from(("", "a", "b")),
        st.floats(0.0, 0.6),
        st.floats(0.0, 0.2),
        st.floats(0.0, 30.0),
        st.floats(0.0, 40.0),
        st.tuples(st.floats(1.0, FASTEST), st.floats(1.0, FASTEST)),
    )
    @examples(150)
    def check(
        seed: int, owner: str, loss: float, stop: float, answers_from: float, on_at: float, rates: tuple[float, float]
    ) -> None:
        play_solo(seed, owner=owner, loss=loss, stop=stop, answers_from=answers_from, on_at=on_at, rates=rates)

    check()


def test_it_goes_on_alone_after_etcd_is_back_and_the_other_machine_keeps_waiting() -> None:
    alone, (other,) = play_solo(1, owner="b", loss=0.0, stop=0.0, answers_from=20.0, on_at=15.0, rates=(1.0, FASTEST))
    assert alone.may_write
    assert (other.term.role, other.terms) == (Role.STANDBY, 0)


def play(seed: int, *, loss: float, slow: float, stop: float, rates: tuple[float, float]) -> tuple[Machine, Machine]:
    world = World(Weather(random.Random(seed), loss, slow, stop))
    machines = Machine("a", rates[0], world), Machine("b", rates[1], world)

    def watch() -> None:
        assert not all(machine.may_write for machine in machines), f"both may write at {world.now:.3f} s"

    world.run(watch)
    return machines


def test_never_may_two_members_write_at_once() -> None:
    probabilities = st.floats(0.0, 0.6)

    @given(
        st.integers(0, 2**32),
        probabilities,
        probabilities,
        st.floats(0.0, 0.2),
        st.tuples(st.floats(1.0, FASTEST), st.floats(1.0, FASTEST)),
    )
    @examples(150)
    def check(seed: int, loss: float, slow: float, stop: float, rates: tuple[float, float]) -> None:
        play(seed, loss=loss, slow=slow, stop=stop, rates=rates)

    check()


def test_the_worst_pair_of_clocks_still_has_a_pause_between_two_terms() -> None:
    assert TERM_S * FASTEST < UNCHANGED_S


def test_in_good_weather_one_member_stays_active_and_the_other_waits() -> None:
    one, other = play(1, loss=0.0, slow=0.0, stop=0.0, rates=(1.0, FASTEST))
    assert one.terms + other.terms == 1
    assert {one.term.role, other.term.role} == {Role.ACTIVE, Role.STANDBY}


def test_bad_weather_makes_terms_change() -> None:
    terms = sum(
        machine.terms
        for seed in range(20)
        for machine in play(seed, loss=0.1, slow=0.1, stop=0.02, rates=(1.0, FASTEST))
    )
    assert terms > 40
