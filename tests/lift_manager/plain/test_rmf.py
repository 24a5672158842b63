"""What an adapter is told, out of JSON: whole, or refused in words."""

import json
from dataclasses import asdict, fields, replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lift_manager.plain.rmf import Alarms, BadAnswer, HeldBy, LiftView, SiteView, parse_decision, parse_site
from tests.lift_manager.rmf.remote_rig import LIFT, SITE
from tests.support.rows import each_row

TEXT = st.text(max_size=8)
SECONDS = st.floats(0, 1e6)
LIFTS = st.builds(
    LiftView,
    lift=TEXT,
    name=TEXT,
    floors=st.dictionaries(TEXT, TEXT, max_size=4),
    live=st.booleans(),
    reason=TEXT,
    age_s=st.none() | SECONDS,
    max_age_s=SECONDS,
    floor=st.none() | TEXT,
    standing=st.booleans(),
    destination=st.none() | TEXT,
    door=TEXT,
    motion=TEXT,
    mode=TEXT,
    robot_mode_on=st.none() | st.booleans(),
    holder=st.none() | st.builds(HeldBy, face=TEXT, name=TEXT, adapter=TEXT),
    ending=st.booleans(),
    fire_latched=st.booleans(),
    waiting_for=TEXT,
    keeps_off=TEXT,
)
SITES = st.builds(
    SiteView,
    boot=TEXT,
    event=st.integers(0, 2**63 - 1),
    lifts=st.lists(LIFTS, max_size=3).map(tuple),
    end_grace_s=SECONDS,
    alarms=st.builds(
        Alarms,
        fire_alarm=st.booleans(),
        emergency_signal=st.booleans(),
        emergency_fleets=st.lists(TEXT, max_size=2).map(tuple),
        clear_on_acknowledge=st.booleans(),
    ),
)


def as_sent(site: SiteView, **more: Any) -> Any:
    return json.loads(json.dumps({**asdict(site), **more}))


@given(SITES)
@settings(max_examples=30)
def test_what_a_site_says_is_what_is_read(site: SiteView) -> None:
    assert parse_site(as_sent(site)) == site


def test_floors_keep_their_order() -> None:
    site = replace(SITE, lifts=(replace(LIFT, floors={"L2": "second", "L1": "first"}),))
    assert list(parse_site(as_sent(site)).lifts[0].floors) == ["L2", "L1"]


def test_what_a_later_manager_adds_is_passed_over() -> None:
    said = as_sent(SITE, weather="fine")
    said["lifts"][0]["weight"] = 7
    said["lifts"][0]["holder"]["since_s"] = 7
    said["alarms"]["bells"] = True
    assert parse_site(said) == SITE


def spoil(place: str, value: object) -> Any:
    """Return an answer in which something stands that is nothing of the kind."""
    said = as_sent(SITE)
    *way, last = place.split("/")
    part = said
    for step in way:
        part = part[int(step) if isinstance(part, list) else step]
    part[last] = value
    return said


PARTS = {"": SiteView, "alarms/": Alarms, "lifts/0/": LiftView, "lifts/0/holder/": HeldBy}
KEYS = [f"{place}{field.name}" for place, form in PARTS.items() for field in fields(form)]
LATER = "lifts/0/holder/adapter"
"""A manager from before adapters had ids does not say it."""


def test_a_manager_that_knows_no_adapters_has_one() -> None:
    said = as_sent(SITE)
    del said["lifts"][0]["holder"]["adapter"]
    (lift,) = parse_site(said).lifts
    assert lift.holder == HeldBy("rmf", "fleet/amr-7")


@each_row("place", [key for key in KEYS if key != LATER])
def test_a_key_that_is_missing_is_named(place: str) -> None:
    said = as_sent(SITE)
    *way, last = place.split("/")
    part = said
    for step in way:
        part = part[int(step) if isinstance(part, list) else step]
    del part[last]
    with pytest.raises(BadAnswer, match=rf"lacks `{last}`$"):
        parse_site(said)


@each_row("place", KEYS)
@each_row("value", [[[]], {"a": 1}, float("nan"), -1, 10**400])
def test_a_value_of_another_kind_is_refused_with_its_place(place: str, value: object) -> None:
    with pytest.raises(BadAnswer, match=r"^(the answer|lifts\[0\]).* (is .* (no|neither) |lacks)"):
        parse_site(spoil(place, value))


@each_row(
    ("place", "value", "why"),
    [
        ("lifts/0/live", 1, "lifts[0].live is 1, neither true nor false"),
        ("lifts/0/live", None, "lifts[0].live is null, neither true nor false"),
        ("lifts/0/age_s", "0.1", "lifts[0].age_s is text and no number of seconds"),
        ("lifts/0/age_s", -0.1, "lifts[0].age_s is -0.1 and no number of seconds"),
        ("lifts/0/max_age_s", True, "lifts[0].max_age_s is True and no number of seconds"),
        ("lifts/0/max_age_s", float("inf"), "lifts[0].max_age_s is inf and no number of seconds"),
        ("lifts/0/floors", ["L1"], "lifts[0].floors is a list and no object"),
        ("lifts/0/floors", {"L1": None}, "lifts[0].floors.L1 is null and no text"),
        ("lifts/0/holder", "rmf:a/b", "lifts[0].holder is text and no object"),
        ("lifts/0/door", None, "lifts[0].door is null and no text"),
        ("event", 7.0, "the answer.event is 7.0 and no whole number"),
        ("event", False, "the answer.event is False and no whole number"),
        ("alarms/emergency_fleets", [7], "the answer.alarms.emergency_fleets is 7 and no text"),
        ("lifts", {}, "the answer.lifts is an object and no list"),
    ],
)
def test_it_says_what_is_wrong_and_where(place: str, value: object, why: str) -> None:
    with pytest.raises(BadAnswer) as refused:
        parse_site(spoil(place, value))
    assert str(refused.value) == why


@each_row("said", [None, [], "x", 7, True])
def test_what_is_no_object_is_no_answer(said: object) -> None:
    for read in (parse_site, parse_decision):
        with pytest.raises(BadAnswer, match=r"^the answer is .* and no object$"):
            read(said)


def test_a_decision_is_a_boot_and_a_number() -> None:
    assert parse_decision({"boot": "a", "event": 3, "more": 1}) == ("a", 3)
    for said in ({"boot": "a"}, {"event": 3}, {"boot": 1, "event": 3}, {"boot": "a", "event": "3"}):
        with pytest.raises(BadAnswer):
            parse_decision(said)


def test_a_holder_reads_as_face_and_name() -> None:
    assert str(LIFT.holder) == "rmf:fleet/amr-7"
