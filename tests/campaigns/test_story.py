"""A finding comes with what happened before it."""

from lift_manager.lab.world.lift_under_test import Finding
from lift_manager.lab.world.witness import FaultChange, FloorRequest
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import RequestRefused
from tests.campaigns.story import MOST_STORIES, WORDS, Story

REQUEST = FloorRequest("lift1", Holder("api", "amr"), "L2", hold_door=True)


def test_the_words_before_a_finding_are_kept_whatever_happens_after_it() -> None:
    findings: list[Finding] = []
    story = Story(findings, {"lift1": ("plc1",), "lift2": ("plc2",)})
    story.on_fault(1.0, FaultChange("plc2", "a cut", began=True))
    story.on_fault(1.0, FaultChange("plc1", "noise", began=True))
    story.on_request(2.0, REQUEST, None)
    findings.append(Finding(2.5, "lift1", "pressed by a restart", "call"))
    story.on_press(2.5, "lift1", frozenset({"call"}))
    for number in range(2 * WORDS):
        story.on_press(3.0 + number, "lift1", frozenset({"go"}))
    assert [line.split(maxsplit=1)[1] for line in story.of(0)] == [
        "fault noise begins",
        "api:amr asks for L2, hold True, None: accepted",
        "pressed call",
    ]
    assert list(story.of(1)) == []


def test_a_restart_is_in_the_story_of_every_lift_and_a_refusal_in_it_once() -> None:
    findings: list[Finding] = []
    story = Story(findings, {"lift1": ("plc1",)})
    story.on_fault(1.0, FaultChange("the manager", "restart", began=True))
    for second in range(5):
        story.on_request(2.0 + second, REQUEST, RequestRefused(Refusal.HELD, "held"))
    findings.append(Finding(9.0, "lift1", "any", "thing"))
    story.on_press(9.0, "lift1", frozenset({"go"}))
    assert len(list(story.of(0))) == 3


def test_of_many_findings_the_first_have_a_story() -> None:
    findings: list[Finding] = []
    story = Story(findings, {"lift1": ("plc1",)})
    for number in range(MOST_STORIES + 1):
        findings.append(Finding(float(number), "lift1", "any", "thing"))
        story.on_press(float(number), "lift1", frozenset({"go"}))
    assert list(story.of(MOST_STORIES - 1))
    assert not list(story.of(MOST_STORIES))
