"""What expectations say about traces that are made by hand: each of them can be met, and each can be broken."""

from pathlib import Path

import pytest
import yaml

from lift_manager.lab.scenario.assertions import (
    Broken,
    Count,
    DemandMet,
    Eventually,
    Never,
    Ordered,
    Run,
    While,
    Window,
    judge,
)
from lift_manager.lab.scenario.matching import Match, read_match
from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.scenario.trace import Entry, Value
from lift_manager.lab.scenario.vocabulary import KINDS
from register_maps.source import read
from tests.support.rows import each_row


def entry(at_s: float, kind: str, **fields: Value) -> Entry:
    told: dict[str, Value] = dict.fromkeys(KINDS[kind].fields)
    return Entry(at_s, "lift", kind, told | fields)


@pytest.fixture
def mistakes(tmp_path: Path) -> Mistakes:
    path = tmp_path / "match.yaml"
    path.write_text("{}\n")
    return Mistakes(read(path))


class Matches:
    def __init__(self, mistakes: Mistakes) -> None:
        self._mistakes = mistakes

    def __call__(self, text: str) -> Match:
        match = read_match(yaml.safe_load(f"{{{text}}}"), (), self._mistakes, None)
        assert match is not None, self._mistakes.findings
        return match


@pytest.fixture
def m(mistakes: Mistakes) -> Matches:
    return Matches(mistakes)


def run(*entries: Entry, lasts_s: float = 20.0) -> Run:
    return Run(entries, lasts_s)


FIRE = run(entry(0, "truth", mode="normal"), entry(10, "truth", mode="fire"), entry(15, "truth", mode="normal"))


def with_press(at_s: float) -> Run:
    before = [one for one in FIRE.entries if one.at_s <= at_s]
    after = [one for one in FIRE.entries if one.at_s > at_s]
    return Run([*before, entry(at_s, "press", command="go_to", floor="L2"), *after], FIRE.lasts_s)


@each_row(("at_s", "broken"), [(9.9, False), (10.0, True), (12.0, True), (14.9, True), (15.0, False), (18.0, False)])
def test_no_press_while_fire_was_active(m: Matches, at_s: float, broken: bool) -> None:
    demand = Never(m("kind: press"), While(m("kind: truth, mode: fire")))
    result = judge(demand, with_press(at_s))
    assert isinstance(result, Broken) is broken
    if isinstance(result, Broken):
        assert (result.at_s, result.entry) == (at_s, entry(at_s, "press", command="go_to", floor="L2"))


@pytest.mark.parametrize(("at_s", "broken"), [(10.5, False), (11.0, True), (14.0, True)])
def test_a_fault_may_have_its_time_to_be_seen(m: Matches, at_s: float, broken: bool) -> None:
    demand = Never(m("kind: press"), While(m("kind: truth, mode: fire"), settled_s=1.0))
    assert isinstance(judge(demand, with_press(at_s)), Broken) is broken


@each_row(
    ("opens", "closes", "broken"),
    [(2.0, 4.0, False), (2.0, 5.0, False), (2.0, 5.1, True), (6.0, 7.0, True), (8.0, 9.0, False), (4.0, 20.0, True)],
)
def test_door_never_reported_open_while_the_car_moved(m: Matches, opens: float, closes: float, broken: bool) -> None:
    """The car moves from 5 s to 8 s."""
    entries = [
        entry(0, "truth", standing=True),
        entry(5, "truth", standing=False),
        entry(8, "truth", standing=True),
        entry(opens, "state", robot_door="open"),
        entry(closes, "state", robot_door="closed"),
    ]
    demand = Never(m("kind: state, robot_door: open"), While(m("kind: truth, standing: false")))
    result = judge(demand, Run(sorted(entries, key=lambda one: one.at_s), 20.0))
    assert isinstance(result, Broken) is broken
    if isinstance(result, Broken):
        assert result.at_s == max(opens, 5.0)


def test_what_must_never_happen_may_not_happen_at_all(m: Matches) -> None:
    assert judge(Never(m("kind: press, command: go_to")), with_press(3.0)) == Broken(
        "it happened", 3.0, with_press(3.0).entries[1]
    )
    assert isinstance(judge(Never(m("kind: press, command: call")), with_press(3.0)), DemandMet)


def test_only_the_window_counts(m: Matches) -> None:
    never = Never(m("kind: press"))
    assert isinstance(judge(never, with_press(3.0), Window(after_s=3.5)), DemandMet)
    assert isinstance(judge(never, with_press(3.0), Window(before_s=2.5)), DemandMet)
    assert isinstance(judge(never, with_press(3.0), Window(2.5, 3.5)), Broken)


def test_what_lasts_into_the_window_is_broken_at_its_edge(m: Matches) -> None:
    result = judge(Never(m("kind: truth, mode: fire")), FIRE, Window(after_s=12.0))
    assert isinstance(result, Broken)
    assert result.at_s == 12.0


@pytest.mark.parametrize("kind", ["never", "count"])
def test_what_was_never_on_trial_has_failed(m: Matches, kind: str) -> None:
    during = While(m("kind: truth, mode: emergency"))
    demand = Never(m("kind: press"), during) if kind == "never" else Count(m("kind: press"), 0, 0, during)
    result = judge(demand, with_press(3.0))
    assert isinstance(result, Broken)
    assert "never tested: truth mode emergency" in result.text


def test_something_happens_in_time_or_it_does_not(m: Matches) -> None:
    fire = m("kind: truth, mode: fire")
    assert judge(Eventually(fire), FIRE) == DemandMet("at 10 s")
    assert isinstance(judge(Eventually(fire, within_s=10.0), FIRE), DemandMet)
    assert judge(Eventually(fire, within_s=9.9), FIRE) == Broken("it did not happen", 9.9)
    assert judge(Eventually(m("kind: truth, mode: emergency")), FIRE) == Broken("it did not happen", 20.0)


@pytest.mark.parametrize(("at_s", "within_s", "ok"), [(11.0, 1.0, True), (11.1, 1.0, False), (9.0, 5.0, False)])
def test_something_follows_something_else_in_time(m: Matches, at_s: float, within_s: float, ok: bool) -> None:
    demand = Eventually(m("kind: press"), within_s, m("kind: truth, mode: fire"))
    result = judge(demand, with_press(at_s))
    assert isinstance(result, DemandMet) is ok
    if isinstance(result, Broken):
        assert result.entry == entry(10, "truth", mode="fire")


def test_each_of_what_comes_before_must_be_followed(m: Matches) -> None:
    entries = [entry(at, "press", command="go_to") for at in (1.0, 5.0)]
    answered = [*entries, entry(2.0, "outcome", command="go_to"), entry(6.0, "outcome", command="go_to")]
    demand = Eventually(m("kind: outcome"), 1.5, m("kind: press"))
    assert isinstance(judge(demand, Run(sorted(answered, key=lambda one: one.at_s), 20.0)), DemandMet)
    result = judge(demand, run(*sorted(answered[:3], key=lambda one: one.at_s)))
    assert isinstance(result, Broken)
    assert result.entry == entries[1]


def test_what_holds_already_has_followed(m: Matches) -> None:
    still = run(entry(0, "state", robot_door="moving"), *FIRE.entries)
    demand = Eventually(m("kind: state, robot_door: moving"), 1.0, m("kind: truth, mode: fire"))
    assert isinstance(judge(demand, still), DemandMet)


def test_nothing_follows_what_never_came(m: Matches) -> None:
    result = judge(Eventually(m("kind: press"), None, m("kind: truth, mode: emergency")), with_press(3.0))
    assert isinstance(result, Broken)
    assert "never tested" in result.text


def test_order_is_kept_whatever_lies_between(m: Matches) -> None:
    entries = run(*(entry(float(at), "press", command=name) for at, name in enumerate(("a", "x", "b", "c"))))
    a, b, c = (m(f"kind: press, command: {name}") for name in "abc")
    assert judge(Ordered((a, b, c)), entries) == DemandMet("at 3 s")
    result = judge(Ordered((a, c, b)), entries)
    assert isinstance(result, Broken)
    assert "number 3 did not follow: press command b" in result.text
    assert result.entry == entries.entries[3]


def test_one_entry_is_not_two(m: Matches) -> None:
    press = m("kind: press")
    assert isinstance(judge(Ordered((press, press)), run(entry(1, "press", command="a"))), Broken)


def test_counts_have_bounds(m: Matches) -> None:
    presses = run(*(entry(float(at), "press", command="a") for at in range(1, 4)))
    press = m("kind: press")
    assert judge(Count(press, 3, 3), presses) == DemandMet("3 times")
    assert judge(Count(press, at_most=2), presses) == Broken("it happened 3 times", 3.0, presses.entries[2])
    assert judge(Count(press, at_least=4), presses) == Broken("it happened 3 times", 3.0, presses.entries[2])
    assert isinstance(judge(Count(press, at_most=2), presses, Window(after_s=1.5)), DemandMet)


def test_what_lasts_counts_once_until_it_ends(m: Matches) -> None:
    words = ("open", "open", "closed", "open")
    doors = run(*(entry(float(at), "state", robot_door=door, floor=str(at)) for at, door in enumerate(words)))
    assert judge(Count(m("kind: state, robot_door: open"), 2, 2), doors) == DemandMet("2 times")


def test_faults_hold_beside_one_another(m: Matches) -> None:
    faults = run(
        entry(1, "fault", fault="stuck_door", began=True),
        entry(2, "fault", fault="overload", began=True),
        entry(3, "fault", fault="overload", began=False),
        entry(4, "press", command="go_to"),
        entry(5, "fault", fault="stuck_door", began=False),
        entry(6, "press", command="go_to"),
    )
    during = While(m("kind: fault, fault: stuck_door, began: true"))
    assert judge(Count(m("kind: press"), 1, 1, during), faults) == DemandMet("once")


@each_row(
    ("match", "fields", "fits"),
    [
        ("floor: L2", {"floor": "L2"}, True),
        ("floor: L2", {"floor": "L1"}, False),
        ("floor: [L1, L2]", {"floor": "L1"}, True),
        ("floor: null", {"floor": None}, True),
        ("floor: null", {"floor": "L1"}, False),
        ("floor: {not: L1}", {"floor": None}, True),
        ("floor: {not: [L1, L2]}", {"floor": "L2"}, False),
        ("age_s: {above: 1}", {"age_s": 1.5}, True),
        ("age_s: {above: 1}", {"age_s": 1.0}, False),
        ("age_s: {above: 1, below: 2}", {"age_s": 2.5}, False),
        ("age_s: {below: 2}", {"age_s": None}, False),
        ("age_s: 1", {"age_s": 1.0}, True),
        ("reason: {contains: no answer}", {"reason": "there is no answer"}, True),
        ("reason: {contains: no answer}", {"reason": None}, False),
        ("standing: false", {"standing": False}, True),
        ("standing: false", {"standing": None}, False),
        ("standing: true, floor: L1", {"standing": True, "floor": "L2"}, False),
    ],
)
def test_a_match_compares_fields(m: Matches, match: str, fields: dict[str, Value], fits: bool) -> None:
    assert m(f"kind: state, {match}").fits(entry(1, "state", **fields)) is fits
    assert not m(f"kind: state, {match}").fits(entry(1, "truth"))


@each_row(
    ("match", "commands", "fits"),
    [
        ("go_to", ("go_to", "robot_mode"), True),
        ("go_to", ("robot_mode",), False),
        ("[go_to, robot_mode]", ("robot_mode",), True),
        ("null", (), True),
        ("null", ("go_to",), False),
        ("{not: go_to}", ("go_to", "robot_mode"), False),
        ("{not: go_to}", (), True),
    ],
)
def test_one_of_several_values_is_enough(m: Matches, match: str, commands: tuple[str, ...], fits: bool) -> None:
    assert m(f"kind: truth, commands: {match}").fits(entry(1, "truth", commands=commands)) is fits
