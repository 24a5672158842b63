"""What is shown of each thing that happens."""

import json
from typing import get_args

from pydantic import TypeAdapter

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.api.events import AnyEvent
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType
from lift_manager.lift.events import (
    Acknowledged,
    Advised,
    Alarm,
    Cause,
    CommandEnded,
    CommandFollowed,
    ForceReleased,
    HandedOver,
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.rides.inputs import RideChanged
from lift_manager.runtime.bus import Event, StateChanged
from lift_manager.web.events import sse
from lift_manager.web.events.encoding import aged, encode_event, has_ages
from tests.lift_manager.web.fake_lifts import AT, IDLE
from tests.lift_manager.web.fake_rides import a_ride
from tests.support.rows import each_row

ROBOT, OTHER = Holder("api", "amr-7"), Holder("rmf", "fleet/r1")
FOLLOWED = CommandStatus(
    id="secret-request",
    lift="lift",
    holder=ROBOT,
    kind=CommandType.GO_TO,
    floor="L2",
    state=CommandState.PENDING,
    reason="the car is on its way",
    proof=Proof.NONE,
    requested_at=AT,
    ended_at=None,
)
OUTCOME = Outcome(Command(CommandKind.GO_TO, "L2"), Result.CONFIRMED, "", Proof.READBACK, (), grant_missing=False)
LOCKOUT = Restriction(RestrictionKind.LOCKOUT, "A. Beck", "new ropes", AT)
DRAIN = Restriction(RestrictionKind.DRAIN, "A. Beck", "new ropes", AT)
CASES: tuple[tuple[Event, str, dict[str, object]], ...] = (
    (StateChanged("lift", IDLE), "state", {}),
    (SessionOpened("lift", ROBOT, "L2"), "session", {"what": "opened", "holder": "api:amr-7", "to": "L2"}),
    (
        SessionRestored("lift", ROBOT, "L2", "as before"),
        "session",
        {"what": "restored", "to": "L2", "text": "as before"},
    ),
    (HandedOver("lift", ROBOT, OTHER), "session", {"what": "handed_over", "holder": "api:amr-7", "to": "rmf:fleet/r1"}),
    (
        SessionEnded("lift", ROBOT, EndReason.FIRE, "there is a fire", Advice.STAY_ABOARD),
        "session",
        {"what": "ended", "reason": "fire", "text": "there is a fire", "advice": "stay_aboard"},
    ),
    (Advised("lift", ROBOT, Advice.CLEAR_DOORWAY, "fire"), "advice", {"advice": "clear_doorway", "text": "fire"}),
    (RestrictionBegun("lift", LOCKOUT), "person", {"what": "locked_out", "by": "A. Beck", "text": "new ropes"}),
    (
        RestrictionEnded("lift", "C. Li", AT, LOCKOUT),
        "person",
        {"what": "lockout_over", "by": "C. Li"},
    ),
    (RestrictionBegun("lift", DRAIN), "person", {"what": "drain_begun", "by": "A. Beck", "text": "new ropes"}),
    (RestrictionEnded("lift", "C. Li", AT, DRAIN), "person", {"what": "drain_over", "by": "C. Li"}),
    (
        Acknowledged("lift", "C. Li", AT, (Cause.FIRE,)),
        "person",
        {"what": "acknowledged", "text": "fire"},
    ),
    (
        ForceReleased("lift", "C. Li", AT, "it hangs", ROBOT, maybe_aboard=True),
        "person",
        {"what": "released", "by": "C. Li", "text": "api:amr-7: it hangs"},
    ),
    (
        CommandEnded("lift", OUTCOME, ROBOT),
        "command",
        {"command": "go_to L2", "result": "confirmed", "proof": "readback"},
    ),
    (Alarm("lift", "the door is blocked"), "alarm", {"text": "the door is blocked", "holder": None}),
    (
        CommandFollowed("lift", FOLLOWED, is_recorded=True),
        "request",
        {"do": "go_to", "floor": "L2", "status": "pending"},
    ),
    (RideChanged("lift", a_ride(ROBOT)), "ride", {}),
)


def test_every_event_that_there_is_is_among_these_cases() -> None:
    assert {type(event) for event, _, _ in CASES} == set(get_args(Event))


@each_row(("event", "name", "words"), CASES)
def test_an_event_says_what_happened_and_can_be_read_back(event: Event, name: str, words: dict[str, object]) -> None:
    said = encode_event(event, 2.0)
    lines = sse.event(said.event, said, "b0-7").decode().split("\n")
    assert lines[:2] == ["id: b0-7", f"event: {name}"]
    assert lines[3:] == ["", ""]
    data = json.loads(lines[2].removeprefix("data: "))
    assert data["event"] == name
    assert words.items() <= data.items()
    assert "secret" not in lines[2]
    read = TypeAdapter[object](AnyEvent).validate_json(lines[2].removeprefix("data: "))
    assert read == said


def test_text_with_line_breaks_stays_one_line_of_data() -> None:
    said = encode_event(Alarm("lift", "one\r\ntwo\n\nid: forged\n\u2028\u0085"), 2.0)
    sent = sse.event(said.event, said, "b0-1")
    assert sent.count(b"\n") == 4
    assert b"\r" not in sent


def test_only_what_says_how_long_something_has_been_so_grows_older() -> None:
    for event, _, _ in CASES:
        assert (aged(event, 5.0) != event) is has_ages(event)
