"""What a person is told of lifts in RMF, and what becomes of a lift that somebody asks for at the command line."""

import tracemalloc
from collections.abc import Iterable
from dataclasses import replace

import pytest

from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_MOVING,
    DOOR_OPEN,
    END_SESSION,
    HUMAN_MODE,
    MODE_AGV,
    MODE_HUMAN,
    MODE_OFFLINE,
    MOTION_STOPPED,
    MOTION_UNKNOWN,
    MOTION_UP,
    LiftRequest,
    LiftState,
    Time,
)
from lift_manager.rmf.request import Attempt, AttemptEnd, OperatorRequest
from lift_manager.rmf.watch import MAX_KEPT, REPEAT_COUNT_S, SILENT_S, Topics, Watch, describe_request, describe_state
from tests.support.rows import each_row

ADAPTER, LIFT = "adapter_lift_requests", "lift_requests"
TOPICS = Topics(to_supervisor=ADAPTER, to_lift=LIFT)
STATE = LiftState(
    lift_time=Time(1, 2),
    lift_name="lift1",
    available_floors=("L1", "L2"),
    current_floor="L2",
    destination_floor="L2",
    door_state=DOOR_OPEN,
    motion_state=MOTION_STOPPED,
    available_modes=(MODE_HUMAN, MODE_AGV),
    current_mode=MODE_AGV,
    session_id="fleet/robot1",
)
IDLE = replace(STATE, session_id="", current_floor="L1", door_state=DOOR_CLOSED, current_mode=MODE_HUMAN)
REQUEST = LiftRequest("lift1", Time(), "fleet/robot1", AGV_MODE, "L2", DOOR_OPEN)
END = replace(REQUEST, request_type=END_SESSION, destination_floor="", door_state=DOOR_CLOSED)


@each_row(
    ("state", "words"),
    [
        (STATE, "lift1: at L2, door open, stopped, AGV, held by fleet/robot1"),
        (replace(IDLE, destination_floor="L1"), "lift1: at L1, door closed, stopped, HUMAN, free"),
        (
            replace(STATE, current_floor="L1", motion_state=MOTION_UP, door_state=DOOR_CLOSED),
            "lift1: at L1, called to L2, door closed, going up, AGV, held by fleet/robot1",
        ),
        (
            replace(STATE, current_floor="", destination_floor="", door_state=DOOR_MOVING, motion_state=MOTION_UNKNOWN,
                    current_mode=MODE_OFFLINE),
            "lift1: at no known floor, door not open, motion unknown, OFFLINE, held by fleet/robot1",
        ),
        (
            replace(STATE, door_state=9, motion_state=8, current_mode=7),
            "lift1: at L2, door_state 9, motion_state 8, mode 7, held by fleet/robot1",
        ),
    ],
)  # fmt: skip
def test_a_state_in_words(state: LiftState, words: str) -> None:
    assert describe_state(state) == words


@each_row(
    ("request_", "words"),
    [
        (REQUEST, "lift1: fleet/robot1 requests L2, door open (AGV)"),
        (replace(REQUEST, request_type=HUMAN_MODE, door_state=DOOR_CLOSED), "lift1: fleet/robot1 requests L2, door closed (HUMAN)"),
        (replace(REQUEST, request_type=9, door_state=1), "lift1: fleet/robot1 requests L2, door_state 1 (request_type 9)"),
        (END, "lift1: fleet/robot1 ends its session"),
        (replace(END, session_id=""), "lift1: somebody without a session id ends its session"),
        (
            replace(REQUEST, request_type=END_SESSION),
            "lift1: fleet/robot1 ends its session (END_SESSION, although it names L2, door open)",
        ),
        (replace(REQUEST, session_id="a\n\x1b[31m"), "lift1: a\\n\\x1b[31m requests L2, door open (AGV)"),
        (replace(REQUEST, session_id="x" * 1000), f"lift1: {'x' * 80}... requests L2, door open (AGV)"),
    ],
)  # fmt: skip
def test_a_request_in_words(request_: LiftRequest, words: str) -> None:
    assert describe_request(request_) == words


def told(lines: Iterable[str]) -> list[str]:
    return list(lines)


def test_a_state_is_told_when_it_changes_and_not_when_only_its_time_does() -> None:
    watch = Watch(TOPICS)
    assert told(watch.report_state(STATE, 0.0)) == ["lift1: has the floors L1, L2", describe_state(STATE)]
    assert told(watch.report_state(replace(STATE, lift_time=Time(2, 0)), 0.5)) == []
    changed = replace(STATE, door_state=DOOR_MOVING)
    assert told(watch.report_state(changed, 1.0)) == [describe_state(changed)]


def test_requests_that_repeat_are_counted_for_each_session_and_topic_and_the_count_is_told_now_and_then() -> None:
    watch = Watch(TOPICS)
    line = "lift1: fleet/robot1 requests L2, door open (AGV), to the supervisor"
    assert told(watch.report_request(ADAPTER, REQUEST, 0.0)) == [line]
    assert told(watch.report_request(LIFT, REQUEST, 0.1)) == [
        "lift1: fleet/robot1 requests L2, door open (AGV), to the lift"
    ]
    lines = [said for turn in range(1, 40) for said in watch.report_request(ADAPTER, REQUEST, turn / 2)]
    assert lines == [f"{line}: 20 more times"]
    other = replace(REQUEST, session_id="fleet/robot2")
    assert told(watch.report_request(ADAPTER, other, 19.6))[0].startswith("lift1: fleet/robot2 requests L2")
    assert told(watch.report_request(ADAPTER, END, 19.7)) == [
        f"{line}: 19 more times",
        "lift1: fleet/robot1 ends its session, to the supervisor",
    ]
    assert told(watch.report_counts(19.8)) == []


def test_counts_are_told_when_requests_cease_and_at_the_end() -> None:
    watch = Watch(TOPICS)
    line = told(watch.report_request(LIFT, REQUEST, 0.0))[0]
    assert told(watch.report_request(LIFT, REQUEST, 0.5)) == []
    assert told(watch.report_elapsed(REPEAT_COUNT_S - 0.1)) == []
    assert told(watch.report_elapsed(REPEAT_COUNT_S)) == [f"{line}: once more"]
    assert told(watch.report_request(LIFT, REQUEST, REPEAT_COUNT_S + 1)) == []
    assert told(watch.report_counts(REPEAT_COUNT_S + 2)) == [f"{line}: once more"]


def test_what_cannot_be_read_is_told_once_and_then_counted() -> None:
    watch = Watch(TOPICS)
    line = "unreadable message: its text is not UTF-8 (lift_requests)"
    said = [
        line
        for turn in range(100)
        for line in watch.report_unreadable("its text is not UTF-8 (lift_requests)", turn / 5)
    ]
    assert said == [line, f"{line}: 50 more times"]
    assert told(watch.report_unreadable("x" * 1000, 20.0)) == [f"unreadable message: {'x' * 80}..."]
    assert told(watch.report_elapsed(21.0)) == [f"{line}: 49 more times"]


def test_of_more_sessions_than_fit_the_one_not_heard_for_longest_is_forgotten_with_its_count_told() -> None:
    watch = Watch(TOPICS)
    line = told(watch.report_request(LIFT, REQUEST, 0.0))[0]
    other = replace(REQUEST, session_id="other")
    told(watch.report_request(LIFT, other, 0.0))
    assert told(watch.report_request(LIFT, REQUEST, 0.1)) == []
    for n in range(MAX_KEPT - 2):
        assert len(told(watch.report_request(LIFT, replace(REQUEST, session_id=f"s{n}"), 1.0))) == 1
    assert len(told(watch.report_request(LIFT, replace(REQUEST, session_id="one more"), 1.0))) == 1
    assert told(watch.report_request(LIFT, REQUEST, 1.1)) == []
    assert len(told(watch.report_request(LIFT, other, 1.2))) == 1, "it was forgotten"
    flood = [replace(REQUEST, session_id=f"t{n}") for n in range(MAX_KEPT)]
    lines = [said for one in flood for said in watch.report_request(LIFT, one, 2.0)]
    assert [said for said in lines if "more" in said] == [f"{line}: 2 more times"]
    assert told(watch.report_counts(3.0)) == []


def test_of_more_lifts_than_fit_the_one_not_heard_for_longest_is_forgotten() -> None:
    watch = Watch(TOPICS)
    names = [f"lift{n}" for n in range(MAX_KEPT + 1)]
    for name in names:
        told(watch.report_state(replace(STATE, lift_name=name), 0.0))
    assert watch.lifts == tuple(names[1:])
    assert len(told(watch.report_elapsed(SILENT_S))) == MAX_KEPT


def test_texts_of_any_length_are_not_kept() -> None:
    watch = Watch(TOPICS)
    long = "x" * 1_000_000
    tracemalloc.start()
    try:
        for n in range(20):
            told(watch.report_request(LIFT, replace(REQUEST, session_id=f"{n}{long}", lift_name=f"{n}{long}"), 0.0))
            told(watch.report_state(replace(STATE, lift_name=f"{n}{long}", available_floors=(f"{n}{long}",)), 0.0))
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < len(long)


def test_a_lift_that_falls_silent_is_told_of_once_and_again_when_it_is_heard() -> None:
    watch = Watch(TOPICS)
    told(watch.report_state(STATE, 0.0))
    assert told(watch.report_elapsed(SILENT_S - 0.1)) == []
    assert told(watch.report_elapsed(SILENT_S)) == ["lift1: nobody has published its state for 3 s"]
    assert told(watch.report_elapsed(SILENT_S + 1)) == []
    assert told(watch.report_state(STATE, 9.0)) == ["lift1: its state is published again"]
    assert told(watch.report_state(STATE, 9.5)) == []


def test_one_lift_can_be_watched_alone() -> None:
    watch = Watch(TOPICS, "lift1")
    assert told(watch.report_state(replace(STATE, lift_name="lift2"), 0.0)) == []
    assert told(watch.report_request(LIFT, replace(REQUEST, lift_name="lift2"), 0.0)) == []
    assert len(told(watch.report_state(STATE, 0.0))) == 2
    assert watch.lifts == ("lift1",)


class Street:
    """An attempt, what it sent, and who would hear it."""

    def __init__(self, errand: OperatorRequest, *, supervised: bool = True, adapters: int = 1) -> None:
        self.sent: list[tuple[float, LiftRequest, bool]] = []
        self.lines: list[str] = []
        self._supervised = supervised
        self.now = 0.0
        self.attempt = Attempt(errand, lambda: adapters, self._send, within_s=60.0, now=0.0)

    def _send(self, request: LiftRequest, direct: bool) -> None:
        self.sent.append((self.now, request, direct))
        if self._supervised or direct:
            self.lines += self.attempt.handle_relayed_request(request)

    def ended(self) -> AttemptEnd | None:
        return self.attempt.end

    def until(self, now: float, state: LiftState | None) -> None:
        """Let the lift say this twice a second until then."""
        while self.now < now and self.attempt.end is None:
            self.now += 0.5
            if state is not None:
                self.lines += self.attempt.handle_state(state, self.now)
            self.lines += self.attempt.tick(1000.0 + self.now, self.now)


ERRAND = OperatorRequest("lift1", "L2", "trial")


def test_a_request_goes_to_the_supervisor_once_a_second_until_the_lift_is_there_for_that_session() -> None:
    street = Street(ERRAND)
    street.until(3.0, IDLE)
    assert street.ended() is None
    there = replace(STATE, session_id="trial")
    street.until(4.0, replace(there, door_state=DOOR_MOVING))
    street.until(5.0, replace(there, session_id="fleet/robot1"))
    assert street.ended() is None
    street.until(9.0, there)
    assert street.ended() is AttemptEnd.FULFILLED
    assert [at for at, *_ in street.sent] == [0.5, 1.5, 2.5, 3.5, 4.5]
    _, request, direct = street.sent[0]
    assert (request, direct) == (
        LiftRequest("lift1", Time(1000, 500_000_000), "trial", AGV_MODE, "L2", DOOR_OPEN),
        False,
    )
    assert street.lines[:2] == [describe_state(IDLE), "a lift supervisor passes the request on"]
    assert "--end --session trial" in street.lines[-1]


def test_without_a_supervisor_the_lift_adapter_is_asked_directly_and_that_is_said() -> None:
    street = Street(replace(ERRAND, human=True, open_door=False), supervised=False)
    street.until(6.0, IDLE)
    assert "no lift supervisor passes it on: sending it to the lift adapter directly" in street.lines
    assert "a lift supervisor passes the request on" not in street.lines
    assert [(at, direct) for at, _, direct in street.sent][:5] == [
        (0.5, False),
        (1.5, False),
        (2.5, False),
        (3.5, True),
        (4.5, True),
    ]
    assert street.sent[-1][1].request_type == HUMAN_MODE
    assert street.sent[-1][1].door_state == DOOR_CLOSED


def test_the_lift_adapter_is_asked_at_once_where_that_is_wanted() -> None:
    street = Street(replace(ERRAND, direct=True))
    street.until(1.0, IDLE)
    assert [(at, direct) for at, _, direct in street.sent] == [(0.5, True)]
    assert street.lines == [describe_state(IDLE)]


def test_a_lift_that_another_session_holds_is_not_asked_directly() -> None:
    street = Street(ERRAND, supervised=False)
    street.until(20.0, STATE)
    assert not any(direct for *_, direct in street.sent)


INSTEAD = OperatorRequest("lift1", "L1", "fleet/robot1", instead_of="fleet/robot2")


def test_what_a_supervisor_serves_for_ever_is_ended_right_before_the_request_of_the_one_that_holds_the_lift() -> None:
    street = Street(INSTEAD, supervised=False)
    street.until(2.0, STATE)
    assert [(at, sent.session_id, sent.request_type, direct) for at, sent, direct in street.sent] == [
        (0.5, "fleet/robot2", END_SESSION, False),
        (0.5, "fleet/robot1", AGV_MODE, False),
        (1.5, "fleet/robot2", END_SESSION, False),
        (1.5, "fleet/robot1", AGV_MODE, False),
    ]
    list(street.attempt.handle_relayed_request(street.sent[1][1]))
    street.until(3.0, STATE)
    assert [sent.session_id for _, sent, _ in street.sent[4:]] == ["fleet/robot1"]
    street.until(5.0, replace(STATE, current_floor="L1"))
    assert street.ended() is AttemptEnd.FULFILLED


def test_a_session_that_holds_the_lift_itself_is_not_ended_for_another() -> None:
    street = Street(INSTEAD)
    street.until(5.0, replace(STATE, session_id="fleet/robot2"))
    assert street.ended() is AttemptEnd.REFUSED
    assert street.sent == []
    assert street.lines[-1] == "fleet/robot2 holds the lift itself, so its session is not ended for another"


def test_without_a_supervisor_nothing_is_asked_instead_of_another_session_and_the_reason_comes_soon() -> None:
    street = Street(INSTEAD, supervised=False)
    street.until(70.0, STATE)
    assert street.ended() is AttemptEnd.TOO_LATE
    assert street.now == 3.5
    assert not any(direct for *_, direct in street.sent)
    assert street.lines[-1].startswith(
        "not passed on within 3 s: either there is no lift supervisor, or fleet/robot2 is not the session it serves"
    )


def test_nobody_who_listens_is_said_and_nothing_is_waited_for() -> None:
    street = Street(ERRAND, supervised=False, adapters=0)
    street.until(60.0, IDLE)
    assert street.ended() is AttemptEnd.REFUSED
    assert "nobody receives it" in street.lines[-1]
    assert street.now < 5.0


def test_an_end_is_over_when_the_session_is_not_told_any_more() -> None:
    street = Street(replace(ERRAND, floor=None))
    street.until(2.0, replace(STATE, session_id="trial"))
    request = street.sent[0][1]
    assert (request.request_type, request.destination_floor, request.door_state) == (END_SESSION, "", DOOR_CLOSED)
    street.until(9.0, IDLE)
    assert street.ended() is AttemptEnd.FULFILLED
    assert street.lines[-1] == "lift1 is not held by trial any more"


def test_an_end_is_sent_even_where_the_lift_tells_no_session_because_the_supervisor_may_have_it() -> None:
    street = Street(replace(ERRAND, floor=None))
    street.until(2.0, IDLE)
    assert len(street.sent) == 1
    assert street.ended() is AttemptEnd.FULFILLED


@pytest.mark.parametrize(
    ("errand", "state", "words"),
    [
        (replace(ERRAND, floor="L9"), IDLE, "lift1 has no floor 'L9'; it has L1, L2"),
        (
            replace(ERRAND, lift="lift9"),
            IDLE,
            "nobody publishes the state of a lift 'lift9'; published lifts: lift1",
        ),
        (ERRAND, None, "nobody publishes the state of a lift 'lift1'; published lifts: none"),
    ],
)
def test_a_lift_or_floor_that_is_not_there_is_not_asked_for(
    errand: OperatorRequest, state: LiftState | None, words: str
) -> None:
    street = Street(errand)
    street.until(60.0, state)
    assert street.ended() is AttemptEnd.REFUSED
    assert street.lines[-1] == words
    assert street.sent == []
    assert street.now <= 6.0


@pytest.mark.parametrize(
    ("state", "left"),
    [
        (replace(STATE, session_id="trial", door_state=DOOR_MOVING), ["trial holds the lift; end it with"]),
        (IDLE, ["trial may still get the lift; end it with"]),
    ],
)
def test_a_request_that_ends_before_the_lift_comes_says_how_its_session_is_ended(
    state: LiftState, left: list[str]
) -> None:
    street = Street(ERRAND)
    assert list(street.attempt.report_open_session()) == []
    street.until(5.0, state)
    said = list(street.attempt.report_open_session())
    assert [line.partition(" `")[0] for line in said] == left
    assert said[0].endswith("`lift-manager rmf request lift1 --end --session trial`")


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (STATE, "not within 60 s: fleet/robot1 holds the lift; it is another's turn once that session has ended"),
        (IDLE, "not within 60 s: the lift did not accept the session; the log of its adapter has the reason"),
        (
            replace(STATE, session_id="trial", door_state=DOOR_MOVING),
            "not within 60 s: lift1: at L2, door not open, stopped, AGV, held by trial",
        ),
    ],
)
def test_what_stood_in_the_way_is_said_when_the_time_is_over(state: LiftState, words: str) -> None:
    street = Street(ERRAND)
    street.until(61.0, state)
    assert street.ended() is AttemptEnd.TOO_LATE
    assert street.lines[-1] == words
