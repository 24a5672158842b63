"""When a machine that goes on alone may command the lifts, input by input."""

from dataclasses import replace

from lift_manager.cluster.solo import Found, Mark, SoloOrder, Watch, step
from lift_manager.cluster.term import ANSWER_S, RENEW_S, TERM_S, UNCHANGED_S, Sent, Tick, Unanswered

Input = Tick | Sent | Found | Unanswered
START = Watch(revision=7, known_at=100.0)


def after(watch: Watch, *inputs: Input) -> tuple[Watch, list[SoloOrder]]:
    """The watch after these inputs, and everything that was ordered."""
    ordered: list[SoloOrder] = []
    for happened in inputs:
        watch, orders = step(watch, happened)
        ordered += orders
    return watch, ordered


def silence(watch: Watch, at: float) -> tuple[Watch, list[SoloOrder]]:
    """A request that was sent then, and never answered."""
    return after(watch, Sent(at), Unanswered(at, at + ANSWER_S))


def answer(watch: Watch, at: float, revision: int = 7, mark: Mark = Mark.MISSING) -> tuple[Watch, list[SoloOrder]]:
    """A request that was sent then, and answered at once."""
    return after(watch, Sent(at), Found(at, at + 0.01, revision, mark))


def active(at: float = 103.0) -> Watch:
    """A watch whose newest request was sent then."""
    watch, _ = silence(START, at)
    assert watch.is_active
    return watch


def test_it_begins_once_etcd_has_been_silent_for_long_enough() -> None:
    watch, _ = silence(START, 100.0 + UNCHANGED_S - ANSWER_S - 0.01)
    assert not watch.is_active
    watch, _ = silence(watch, 102.6)
    assert (watch.is_active, watch.until) == (True, 102.6 + TERM_S)


def test_an_etcd_that_answers_now_and_then_is_not_silent() -> None:
    watch, _ = answer(START, 102.0)
    watch, _ = silence(watch, 103.0)
    assert not watch.is_active


def test_it_looks_first_and_writes_its_mark_once_the_key_was_unmoved_for_long_enough() -> None:
    assert after(START, Tick(100.0 + UNCHANGED_S - 0.01))[1] == [SoloOrder.LOOK]
    watch, _ = answer(START, 101.0)
    assert after(watch, Tick(100.0 + UNCHANGED_S))[1] == [SoloOrder.MARK]
    watch, _ = answer(watch, 102.6, mark=Mark.OWN)
    assert (watch.is_active, watch.until) == (True, 102.6 + TERM_S)


def test_silence_and_the_own_mark_prolong_its_term_and_nothing_else_does() -> None:
    assert silence(active(), 103.6)[0].until == 103.6 + TERM_S
    assert answer(active(), 103.6, mark=Mark.OWN)[0].until == 103.6 + TERM_S
    assert active().wake_at == 103.0 + RENEW_S
    assert after(active(), Tick(103.6))[1] == [SoloOrder.MARK]


def test_another_manager_that_was_active_ends_its_term_at_once() -> None:
    for revision, mark in ((8, Mark.MISSING), (8, Mark.OWN), (7, Mark.OTHER)):
        watch, orders = answer(active(), 103.6, revision, mark)
        assert (watch.is_active, watch.is_contested, orders) == (False, True, [SoloOrder.FENCE])


def test_after_that_only_etcd_lets_it_go_on() -> None:
    contested, _ = answer(active(), 103.6, revision=8)
    assert not silence(contested, 200.0)[0].is_active
    assert not answer(contested, 104.0, revision=8, mark=Mark.OWN)[0].is_active
    assert not answer(contested, 200.0, revision=8, mark=Mark.OTHER)[0].is_active
    watch, _ = answer(contested, 200.0, revision=8, mark=Mark.OWN)
    assert (watch.is_active, watch.is_contested) == (True, False)


def test_a_process_that_was_stopped_for_longer_than_its_term_looks_again_first() -> None:
    watch, orders = after(active(), Tick(110.0))
    assert (watch.is_active, orders) == (False, [SoloOrder.FENCE, SoloOrder.LOOK])
    assert not silence(watch, 110.0)[0].is_active
    assert answer(watch, 110.0, mark=Mark.OWN)[0].is_active


def test_an_answer_that_comes_after_the_term_is_over_revives_it_only_for_what_remains() -> None:
    watch, _ = after(active(), Sent(104.9), Found(104.9, 106.9, 7, Mark.OWN))
    assert not watch.is_active


def test_answers_to_earlier_requests_change_nothing() -> None:
    watch, _ = after(active(), Sent(103.6))
    for late in (Found(102.0, 103.7, 9, Mark.OTHER), Unanswered(102.0, 103.7)):
        assert after(watch, late) == (watch, [])


def test_a_start_that_remembers_another_manager_does_not_trust_silence() -> None:
    assert not silence(replace(START, is_contested=True), 200.0)[0].is_active
