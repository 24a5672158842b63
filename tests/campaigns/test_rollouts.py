"""A roll-out with one bad site, and what its judge calls wrong; hundreds are one command, see README.md beside this."""

from dataclasses import replace

import pytest

from tests.campaigns.rollouts import NEW, OLD, Record, judge, play

GOOD = Record(
    bad="paris",
    canaries=("berlin",),
    healthy_s=900.0,
    at_once=1,
    starts={
        "berlin": [(0.0, OLD), (100.0, NEW)],
        "paris": [(0.0, OLD), (1700.0, NEW), (1800.0, OLD)],
        "rome": [(0.0, OLD)],
    },
    rows={"paris": ["configuration update 8 is rolled back, and ..."]},
    events=[(1805.0, "paris", "rolled back", "..."), (1805.0, "paris", "stopped", "... paris has rolled it back ...")],
)
ROME_TOO = {**GOOD.starts, "rome": [(0.0, OLD), (3000.0, NEW)]}


@pytest.mark.parametrize(
    ("record", "wrong"),
    [
        (replace(GOOD, starts={**GOOD.starts, "rome": [(0.0, OLD), (50.0, "['site.yaml']")]}), "in between"),
        (
            replace(GOOD, starts={**GOOD.starts, "paris": GOOD.starts["paris"][:2]}),
            "paris is bad, and has not gone back",
        ),
        (replace(GOOD, rows={"paris": []}), "the journal of paris does not say"),
        (replace(GOOD, events=GOOD.events[1:]), "no event of the hub says"),
        (replace(GOOD, events=GOOD.events[:1]), "did not stop once"),
        (replace(GOOD, starts=ROME_TOO), "rome got it 1195 s after the roll-out was stopped"),
        (
            replace(GOOD, busy={"berlin": [(90.0, 110.0)]}),
            "berlin changed its configuration at 100 s while it was busy",
        ),
        (replace(GOOD, healthy_s=1800.0), "before the canaries had run well"),
        (replace(GOOD, starts={**GOOD.starts, "rome": [(0.0, OLD), (1750.0, NEW)]}), "2 sites were on trial at once"),
        (
            replace(GOOD, starts={**GOOD.starts, "berlin": [*GOOD.starts["berlin"], (9000.0, OLD)]}),
            "berlin does not run by it",
        ),
        (replace(GOOD, must_fail=False), "nothing was wrong"),
    ],
)
def test_the_judge_finds_what_must_not_be(record: Record, wrong: str) -> None:
    assert list(judge(GOOD)) == []
    assert any(wrong in one for one in judge(record))


@pytest.mark.parametrize(("seed", "about"), [(6, "it is refused, at another site"), (12, "an alarm, at another site")])
def test_of_many_sites_each_has_the_new_version_or_the_old_one_and_the_bad_one_stops_the_roll_out(
    seed: int, about: str
) -> None:
    assert play(seed) == (about, [])
