"""Lifts over HTTP: what they publish, and that nothing is sent twice to who has it."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import httpx
import pytest

from lift_manager.api.lifts import Lift
from lift_manager.api.problem import Problem
from lift_manager.api.roles import Role
from lift_manager.lift.refusals import Blocking
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.web.lift_texts import LiftText, LiftTexts
from lift_manager.web.lifts import matches_tag
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import FakeSite, ask, one_lift
from tests.lift_manager.web.fake_lifts import DOOR, IDLE
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row

LIFTS = "/api/v1/lifts"
HELD = replace(IDLE, holder=Holder("api", "amr-7"), held_since_s=12.5)
OFFLINE = replace(IDLE, quality=Quality.OFFLINE, reason="nothing newer within 2 s: no answer", age_s=7.25)
WRITES = "/lift/commands/writes?step=press%20hold_door.front"
EVERY = ["", "/lift", "/lift/capabilities", "/lift/signals", "/lift/commands", WRITES]


def read(site: FakeSite, path: str, tag: str | None = None) -> httpx.Response:
    headers = {} if tag is None else {"If-None-Match": tag}
    return ask(site, "GET", f"{LIFTS}{path}", headers=headers)


def test_every_lift_is_told_in_the_order_of_the_site() -> None:
    answer = read(FakeSite(), "")
    assert answer.status_code == 200
    assert [lift["name"] for lift in answer.json()["lifts"]] == ["lift", "goods"]


def test_a_lift_says_who_holds_it_and_from_when_on_it_is_too_old() -> None:
    said = read(one_lift(replace(HELD, waiting=2)), "/lift").json()
    assert (said["name"], said["floor"], said["robot_door"], said["quality"]) == ("lift", "L1", "closed", "live")
    assert said["session"] == {"face": "api", "name": "amr-7", "for_s": 12.5, "ending": False}
    assert (said["age_s"], said["max_age_s"], said["waiting"]) == (0.1, 2.0, 2)


def test_what_a_lift_can_do_and_what_its_signals_say_is_told() -> None:
    able = read(FakeSite(), "/lift/capabilities").json()
    assert (able["name"], able["display_name"]) == ("lift", "")
    assert (able["commands"], able["access"], able["map"]) == (
        ["go_to", "hold_door.front"],
        "control",
        "generic-registers",
    )
    assert able["doors_at"] == {"L1": ["front"], "L2": ["front"]}
    assert able["checkout"] is None
    (door,) = read(FakeSite(), "/lift/signals").json()["signals"]
    assert door["name"] == "door.front"
    assert (door["value"], door["raw"], door["age_s"]) == ("open", 2, 0.1)
    assert door["addresses"] == ["holding:12"]
    assert door["wire"] == ["holding 11"]


def test_the_commands_of_a_lift_and_what_they_would_write_are_told() -> None:
    (hold,) = read(FakeSite(), "/lift/commands").json()["commands"]
    assert (hold["name"], hold["addresses"], hold["wire"]) == ("hold_door.front", ["holding:17"], ["holding 17"])
    assert (hold["action"], hold["on_link_loss"], hold["state"]) == ("hold", "device_watchdog", "at rest")
    (write,) = read(FakeSite(), WRITES).json()["writes"]
    assert (write["name"], write["what"], write["frame"]) == ("hold_door.front", "press", "010600110001")


def test_steps_are_needed_to_tell_what_they_would_write() -> None:
    refused(read(FakeSite(), "/lift/commands/writes"), 422, "malformed")


@each_row("path", ["/elevator", "/elevator/capabilities", "/elevator/signals", "/elevator/commands", "/li%22ft"])
def test_an_unknown_lift_is_404_with_the_lifts_there_are(path: str) -> None:
    assert refused(read(FakeSite(), path), 404, "unknown_lift").endswith("the lifts are lift, goods")


@each_row("path", ["/", "//capabilities", "/a%2Fb", "/a/b/signals"])
def test_a_path_that_no_name_of_a_lift_fits_into_leads_nowhere(path: str) -> None:
    refused(read(FakeSite(), path), 404, "no_such_path")


@each_row(
    ("name", "quoted"), [("B-2_goods.1", "B-2_goods.1"), ("signals", "signals"), ("a.b", "a%2Eb"), ("lift", "l%69ft")]
)
@each_row("part", ["", "/capabilities", "/signals"])
def test_a_lift_with_any_name_can_be_read(name: str, quoted: str, part: str) -> None:
    answer = read(FakeSite({name: replace(IDLE, lift=name)}), f"/{quoted}{part}")
    assert (answer.status_code, answer.json()["name"]) == (200, name)


@each_row("path", EVERY)
def test_who_has_an_answer_is_told_that_nothing_but_time_has_passed_and_how_old_it_is(path: str) -> None:
    first = read(one_lift(HELD), path)
    assert first.headers["cache-control"] == "no-cache"
    assert float(first.headers["lift-age-s"]) == pytest.approx(0.1)
    later = FakeSite({"lift": replace(HELD, age_s=0.9, held_since_s=99.0)}, signals=(replace(DOOR, age_s=1.5),))
    again = read(later, path, first.headers["etag"])
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == first.headers["etag"]
    assert again.headers["cache-control"] == "no-cache"
    assert float(again.headers["lift-age-s"]) == pytest.approx(0.9)
    assert float(read(later, path).headers["lift-age-s"]) == pytest.approx(0.9)


CHANGES: list[Mapping[str, Any]] = [
    {"floor": "L2"},
    {"floor": None, "standing": False},
    {"holder": None, "held_since_s": None},
    {"holder": Holder("api", "amr-8")},
    {"waiting": 1},
    {"quality": Quality.OFFLINE, "reason": "nothing newer within 2 s: no answer"},
    {"permissions": {"may_enter": True}},
    {"restrictions": replace(IDLE.restrictions, fire_latched=True)},
    {"not_visible": {"fire": "no signal"}},
]


@each_row("change", CHANGES)
@each_row("path", ["", "/lift"])
def test_whatever_else_has_changed_is_sent(change: Mapping[str, Any], path: str) -> None:
    tag = read(one_lift(HELD), path).headers["etag"]
    answer = read(one_lift(replace(HELD, **change)), path, tag)
    assert answer.status_code == 200
    assert answer.headers["etag"] != tag


@each_row("change", [{"value": "closed"}, {"raw": 1}, {"value": None}])
def test_a_signal_that_has_changed_is_sent(change: Mapping[str, Any]) -> None:
    tag = read(FakeSite(), "/lift/signals").headers["etag"]
    assert read(FakeSite(signals=(replace(DOOR, **change),)), "/lift/signals", tag).status_code == 200


@each_row("reason", ["closed for 900 s", "closed for 30.5 s", "refused for 30 s"])
@each_row("path", ["", "/lift"])
def test_a_reason_in_other_words_or_with_other_numbers_is_sent(path: str, reason: str) -> None:
    known = replace(OFFLINE, reason="closed for 30 s")
    tag = read(one_lift(known), path).headers["etag"]
    assert read(one_lift(replace(known, age_s=19.0)), path, tag).status_code == 304
    assert read(one_lift(replace(known, reason=reason)), path, tag).status_code == 200


@each_row("path", EVERY)
def test_a_lift_that_was_never_read_has_no_age(path: str) -> None:
    never = one_lift(replace(OFFLINE, age_s=None))
    assert "lift-age-s" not in read(never, path).headers
    assert "lift-age-s" not in read(never, path, "*").headers


def test_the_age_of_all_is_that_of_the_oldest_live_one() -> None:
    def aged(lift: str, age_s: float, quality: Quality = Quality.LIVE) -> LiftState:
        return replace(IDLE, lift=lift, age_s=age_s, quality=quality)

    states = [aged("a", 0.25), aged("b", 0.75), aged("c", 500.0, Quality.OFFLINE)]
    answer = read(FakeSite({state.lift: state for state in states}), "")
    assert answer.headers["lift-age-s"] == "0.750"


@each_row(
    ("lines", "known"),
    [
        (['W/"abc"'], True),
        (['"abc"'], True),
        (["*"], True),
        ([" * "], True),
        (['"x", W/"abc" , "y"'], True),
        (['"x"', 'W/"abc"'], True),
        ([], False),
        ([""], False),
        (["abc"], False),
        (['W/"abcd"'], False),
        (['"x", "y"'], False),
        (['"*"'], False),
    ],
)
def test_if_none_match_is_compared_weakly_and_may_be_a_list(lines: list[str], known: bool) -> None:
    assert matches_tag("abc", lines) is known


def test_a_tag_tells_nothing_to_who_may_not_read() -> None:
    headers = {"If-None-Match": "*"}
    assert ask(FakeSite(), "GET", f"{LIFTS}/lift", keys=ring(Role.ROBOT), headers=headers).status_code == 401
    read_by = ask(
        FakeSite(), "GET", f"{LIFTS}/goods", keys=ring(Role.ROBOT), headers={**headers, **bearing(Role.ROBOT)}
    )
    assert read_by.status_code == 304


def test_seconds_are_told_to_the_millisecond() -> None:
    uneven = replace(IDLE, age_s=0.07999999999447027)
    assert read(one_lift(uneven), "/lift").json()["age_s"] == 0.08
    blocked = Problem.of(409, "held", "", "", blocking=Blocking(since_s=0.43500000000494765, age_s=None))
    assert (blocked.since_s, blocked.age_s) == (0.435, None)


ODD = 'he said: "age_s":null,"for_s":0.0,"releases_in_s":5,'
TIMES: list[Mapping[str, Any]] = [
    {},
    {"age_s": None},
    {"age_s": 0.00049},
    {"age_s": 86400.12345},
    {"held_since_s": None},
    {"held_since_s": 1e7 / 3},
    {"releases_at": 1234.5678, "releases_in_s": 0.0},
    {"releases_at": 1234.5678, "releases_in_s": 287.49996},
    {"releases_at": math.inf, "releases_in_s": math.inf},
    {"holder": None, "held_since_s": None},
    {"holder": Holder("api", ODD), "reason": ODD, "lift": ODD, "releases_in_s": 1.0, "releases_at": 2.0},
]


@each_row("times", TIMES)
@each_row("known", [HELD, OFFLINE])
def test_a_kept_text_with_its_seconds_is_the_model_as_json(known: LiftState, times: Mapping[str, Any]) -> None:
    state = replace(known, **times)
    assert LiftText.of(state, 2.0).whole() == Lift.of(state, max_age_s=2.0).model_dump_json().encode()


@each_row("change", [change for change in CHANGES if "holder" not in change])
def test_a_text_is_kept_until_more_than_time_has_changed(change: Mapping[str, Any]) -> None:
    site = one_lift(replace(HELD, releases_at=300.0, releases_in_s=287.5))
    texts = LiftTexts(site)
    first = texts.of("lift")
    later = replace(site.lifts["lift"], age_s=0.9, held_since_s=13.3, releases_in_s=286.7)
    site.lifts["lift"] = later
    assert texts.of("lift").bare is first.bare
    assert texts.of("lift").whole() == Lift.of(later, max_age_s=2.0).model_dump_json().encode()
    for changed in (replace(later, **change), replace(later, releases_at=301.0)):
        site.lifts["lift"] = changed
        assert texts.of("lift").whole() == Lift.of(changed, max_age_s=2.0).model_dump_json().encode()
