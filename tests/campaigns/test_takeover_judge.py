"""The judge of the takeover campaign finds each violation in a log that has one, and nothing in a log without."""

from dataclasses import replace

import pytest

from lift_manager.cluster.term import Key
from tests.campaigns.takeover_judge import (
    LAG_S,
    TERM_S,
    Alone,
    Answer,
    Keys,
    Passage,
    first_difference,
    judge_answers,
    judge_order,
    judge_passages,
    percentile,
)

LAST_RENEWAL, TAKEN = 10.0, 12.6
OVER = LAST_RENEWAL + TERM_S
"""When the term of north ends at the latest."""


def takeover() -> Keys:
    """North is active in epoch 1 until it stops renewing; south takes the key, and is active in epoch 2."""
    north = [(at / 10, 1, "north") for at in (*range(0, 100, 3), 10 * LAST_RENEWAL)]
    south = [(TAKEN + at / 10, 2, "south") for at in range(0, 100, 3)]
    keys = Keys()
    for revision, (at, epoch, owner) in enumerate([*north, *south], 1):
        keys.add(at, Key(revision, epoch, owner))
    return keys


def write(at: float, machine: str) -> Passage:
    return Passage(at, machine, is_write=True)


def connection(at: float, machine: str) -> Passage:
    return Passage(at, machine, is_write=False)


GOOD = [
    connection(0.1, "north"),
    write(1.0, "north"),
    write(OVER - 0.01, "north"),
    connection(TAKEN + 0.1, "south"),
    write(TAKEN + 0.2, "south"),
    write(TAKEN + 0.3, "south"),
]


def test_a_takeover_in_good_order_is_no_finding() -> None:
    keys = takeover()
    assert list(judge_passages(keys, GOOD)) == []
    assert list(judge_order(keys, GOOD)) == []


@pytest.mark.parametrize(
    ("passage", "why"),
    [
        (write(OVER + 0.05, "north"), "north wrote 0.05 s after its term in epoch 1"),
        (connection(OVER + 0.05, "north"), "north connected 0.05 s after its term in epoch 1"),
        (write(TAKEN + 0.25, "north"), "north wrote 0.25 s after the key said epoch 2 of south"),
        (write(5.05, "south"), "south wrote 0.25 s after the key said epoch 1 of north"),
        (write(-1.0, "north"), "north wrote before anybody was active"),
    ],
)
def test_what_a_machine_does_outside_its_term_is_found(passage: Passage, why: str) -> None:
    log = sorted([*GOOD, passage], key=lambda one: one.at)
    assert [finding.text for finding in judge_passages(takeover(), log)] == [why]


def test_the_owner_may_act_a_little_before_an_observer_sees_its_key() -> None:
    early = connection(TAKEN - LAG_S + 0.01, "south")
    assert list(judge_passages(takeover(), [early])) == []
    assert list(judge_passages(takeover(), [connection(TAKEN - LAG_S - 0.01, "south")]))


def test_a_write_carries_the_epoch_of_its_machine_or_is_found() -> None:
    claims = [(5.0, "north", 1), (TAKEN + 0.1, "south", 2), (TAKEN + 0.2, "south", 1)]
    log = [Passage(at, machine, is_write=True, claimed=epoch) for at, machine, epoch in claims]
    assert [finding.text for finding in judge_order(takeover(), log)] == [
        "south wrote for epoch 1, and it was active in epoch 2"
    ]


def test_writes_of_two_machines_that_interleave_are_found() -> None:
    log = [write(5.0, "north"), write(TAKEN + 0.1, "south"), write(TAKEN + 0.2, "north"), write(TAKEN + 0.3, "south")]
    assert [finding.text for finding in judge_order(takeover(), log)] == [
        "north wrote in epoch 1, and south had written in epoch 2 already"
    ]


def test_a_machine_that_is_active_again_in_a_later_epoch_interleaves_with_nobody() -> None:
    keys = takeover()
    keys.add(30.0, Key(1000, 3, "north"))
    assert list(judge_order(keys, [*GOOD, write(30.1, "north"), write(30.2, "north")])) == []
    assert len(list(judge_order(keys, [*GOOD, write(30.1, "north"), write(30.2, "south")]))) == 1


@pytest.mark.parametrize(("is_open", "what"), [(True, "north said OPEN"), (False, "north answered with a state")])
def test_a_state_of_a_machine_that_is_not_active_is_found(is_open: bool, what: str) -> None:
    late = Answer(OVER + 0.1, OVER + 0.2, "north", is_open)
    assert [finding.text for finding in judge_answers(takeover(), [late])] == [
        f"{what} 0.20 s after its term in epoch 1"
    ]
    under_way = Answer(OVER - 0.1, OVER + 0.1, "north", is_open)
    assert list(judge_answers(takeover(), [under_way])) == []


def test_a_key_that_is_seen_again_later_changes_nothing() -> None:
    keys = takeover()
    keys.add(99.0, Key(1, 1, "north"))
    assert keys.newest.owner == "south"
    assert keys.wrong("north", 99.0)


def test_a_percentile_is_one_of_the_values() -> None:
    assert percentile([3.0], 0.99) == 3.0
    assert percentile([1.0, 2.0, 3.0, 4.0], 0.5) == 2.0
    assert percentile(list(map(float, range(1, 101))), 0.99) == 99.0
    assert percentile(list(map(float, range(1, 11))), 0.99) == 10.0


def test_while_a_machine_goes_on_alone_it_may_act_without_the_key_and_no_other_may() -> None:
    keys = takeover()
    keys.alone.append(Alone("north", since=40.0, until=50.0, epoch=1_000_002))
    own = [connection(40.1, "north"), Passage(41.0, "north", is_write=True, claimed=1_000_002)]
    assert list(judge_passages(keys, own)) == []
    assert list(judge_order(keys, own)) == []
    late, other, under_old_epoch = write(50.1, "north"), write(42.0, "south"), replace(own[1], claimed=2)
    assert [finding.text for finding in judge_passages(keys, [late, other])] == [
        "north wrote 27.60 s after the key said epoch 2 of south",
        "south wrote 2.00 s after north went on alone",
    ]
    assert [finding.text for finding in judge_order(keys, [own[1], other, under_old_epoch])] == [
        "south wrote in epoch 2, and north had written in epoch 1000002 already",
        "north wrote for epoch 2, and it was active in epoch 1000002",
    ]


def test_two_journals_have_the_same_rows_but_for_an_end_and_for_what_one_says_it_lacks() -> None:
    rows = [{"kind": "press", "text": text} for text in "abcde"]
    gap = {"kind": "gap", "text": "rows of up to 2 commits are only in the journal of the other machine"}
    assert first_difference(rows, rows[:3]) == ""
    assert first_difference([*rows[:2], gap, rows[4]], rows) == ""
    assert first_difference(rows, [*rows[:2], gap]) == ""
    assert "'b'" in first_difference([rows[0], *rows[2:]], rows)
    assert "in one of them alone" in first_difference(rows, [rows[0], gap, {"kind": "press", "text": "x"}])
