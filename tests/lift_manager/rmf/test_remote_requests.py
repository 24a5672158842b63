"""What the adapter asks, on its way to a manager in another process: in order, never lost in silence, and one lift does not delay another."""

import threading
import time
from dataclasses import replace

from lift_manager.rmf.port import UNREACHABLE, Answer, EndOfSession, ManagerRequest, SessionDemand
from lift_manager.rmf.remote_manager import SENDERS
from tests.lift_manager.rmf.remote_rig import BRISK, CALM, PATIENT, RARELY, SITE, Manager, connected, scripted_manager
from tests.support.rows import each_row
from tests.support.scripted_http import WITHIN_S, Asked, Script, Scripted, Wire, answers, problem, said


def wanted(lift: str = "east", floor: str = "L2", session: str = "fleet/amr-7") -> SessionDemand:
    return SessionDemand(lift, session, floor, hold_door=True)


def ended(lift: str = "east", session: str = "fleet/amr-7") -> EndOfSession:
    return EndOfSession(lift, session, 3.0)


def posts(server: Scripted) -> list[Asked]:
    return [asked for asked in server.asked if asked.method == "POST"]


def test_what_is_asked_arrives_as_the_manager_expects_it_and_its_answer_comes_back() -> None:
    with scripted_manager(Manager()) as (server, remote, listener):
        for asked in (wanted(), ended()):
            remote.send(asked)
            assert listener.next_answer() == Answer(asked, accepted=True, boot=SITE.boot, event=SITE.event)
        first, second = posts(server)
    assert (first.path, first.json) == (
        "/api/v1/lifts/east/rmf/wanted",
        {"session_id": "fleet/amr-7", "floor": "L2", "hold_door": True},
    )
    assert (second.path, second.json) == (
        "/api/v1/lifts/east/rmf/ended",
        {"session_id": "fleet/amr-7", "grace_s": 3.0},
    )


@each_row(
    ("lift", "path"),
    [("a/b", "a%2Fb"), ("..", "%2E%2E"), ("lift 1?#%", "lift%201%3F%23%25"), ("Fahrst\u00fchle", "Fahrst%C3%BChle")],
)
def test_a_lift_may_have_any_name(lift: str, path: str) -> None:
    with scripted_manager(Manager()) as (server, remote, listener):
        remote.send(wanted(lift))
        assert listener.next_answer().accepted
        assert posts(server)[0].path == f"/api/v1/lifts/{path}/rmf/wanted"


@each_row(
    ("script", "code", "reason"),
    [
        (lambda _, wire: wire.send(problem(409, "held", "api:amr-8 holds it")), "held", "(held): api:amr-8 holds it"),
        (lambda _, wire: wire.send(problem(403, "not_allowed")), "not_allowed", "needs a key of the role rmf"),
        (lambda _, wire: wire.send(problem(503, "stopping")), "stopping", "refuses (stopping)"),
        (answers(409, b"<html>", "text/html"), UNREACHABLE, "is no lift manager (HTTP 409, text/html)"),
        (answers(409, {"code": 7, "detail": "x"}), UNREACHABLE, "is no lift manager (HTTP 409, application/json)"),
        (answers(302, also="location: /\r\n"), UNREACHABLE, "redirects elsewhere"),
        (answers(200, b"<html>", "text/html"), UNREACHABLE, "is no lift manager (HTTP 200, text/html)"),
        (answers(200, {"boot": "a", "event": -1}), UNREACHABLE, "is no lift manager"),
        (answers(202, {"boot": "a", "event": 1}), UNREACHABLE, "is no lift manager"),
        (lambda _, wire: wire.hang_up(), UNREACHABLE, "closed without an answer"),
        (lambda _, wire: wire.send(said(200, {"boot": "a", "event": 1})[:-3]), UNREACHABLE, "in time"),
        (lambda _, __: None, UNREACHABLE, "no whole answer came in time"),
    ],
)
def test_what_is_not_yes_comes_back_with_its_code_and_is_asked_once(script: Script, code: str, reason: str) -> None:
    pace = BRISK if "in time" in reason else CALM
    with scripted_manager(Manager(scripts={"wanted": script}), pace) as (server, remote, listener):
        remote.send(wanted())
        answer = listener.next_answer()
        assert (answer.accepted, answer.code, answer.boot, answer.event) == (False, code, "", 0)
        assert reason in answer.reason
        assert len(posts(server)) == 1


def test_nobody_there_is_an_answer_too() -> None:
    server = Scripted(Manager())
    with server:
        pass
    with connected(server.port) as (remote, listener):
        remote.send(ended())
        answer = listener.next_answer()
    assert (answer.code, "nothing listens there" in answer.reason) == (UNREACHABLE, True)


def test_the_questions_of_a_lift_keep_their_order_however_slow_the_answers_are() -> None:
    pause = threading.Event()

    def script(asked: Asked, wire: Wire) -> None:
        pause.wait(0.02)
        wire.send(said(200, {"boot": "a", "event": len(posts(server))}))

    lifts = [f"lift{number}" for number in range(6)]
    asked: list[ManagerRequest] = [
        demand for floor in ("L1", "L2") for lift in lifts for demand in (wanted(lift, floor), ended(lift, floor))
    ]
    with scripted_manager(Manager(scripts={"wanted": script, "ended": script})) as (server, remote, listener):
        for each in asked:
            remote.send(each)
        answered = [listener.next_answer().request for _ in asked]
        arrived = posts(server)
    for lift in lifts:
        mine = [each for each in asked if each.lift == lift]
        assert [each for each in answered if each.lift == lift] == mine
        words = [each.path.rpartition("/")[2] for each in arrived if f"/{lift}/" in each.path]
        assert words == ["wanted", "ended", "wanted", "ended"]


def test_a_lift_that_is_stuck_delays_no_other() -> None:
    stuck = threading.Event()

    def script(asked: Asked, wire: Wire) -> None:
        if "/stuck/" in asked.path:
            assert stuck.wait(WITHIN_S)
        wire.send(said(200, {"boot": "a", "event": 1}))

    with scripted_manager(Manager(scripts={"wanted": script, "ended": script})) as (_, remote, listener):
        for each in (wanted("stuck"), ended("stuck"), wanted("east"), ended("east"), wanted("west")):
            remote.send(each)
        others = [listener.next_answer().request for _ in range(3)]
        assert sorted(each.lift for each in others) == ["east", "east", "west"]
        stuck.set()
        assert [listener.next_answer().request for _ in range(2)] == [wanted("stuck"), ended("stuck")]


def test_no_number_of_lifts_that_are_stuck_delays_the_end_of_a_session() -> None:
    stuck = threading.Event()

    def script(_: Asked, wire: Wire) -> None:
        assert stuck.wait(WITHIN_S)
        wire.send(said(200, {"boot": "a", "event": 1}))

    lifts = [f"stuck{number}" for number in range(2 * SENDERS)]
    with scripted_manager(Manager(scripts={"wanted": script})) as (server, remote, listener):
        for lift in lifts:
            remote.send(wanted(lift))
        for _ in range(SENDERS - 1):
            server.next("POST")
        remote.send(ended("east"))
        assert listener.next_answer().request == ended("east")
        assert len(posts(server)) == SENDERS
        stuck.set()
        assert sorted(listener.next_answer().request.lift for _ in lifts) == lifts


def test_a_connection_that_the_manager_closed_meanwhile_loses_nothing() -> None:
    def script(asked: Asked, wire: Wire) -> None:
        # the first of each connection is answered, the next one finds its end
        if [other.connection for other in posts(server)].count(asked.connection) > 1:
            wire.hang_up()
        else:
            wire.send(said(200, {"boot": "a", "event": 1}))

    with scripted_manager(Manager(scripts={"ended": script})) as (server, remote, listener):
        for _ in range(12):
            remote.send(ended())
            assert listener.next_answer().accepted


def test_the_answer_yes_lets_the_site_be_asked_where_no_event_tells_of_it() -> None:
    def script(_: Asked, wire: Wire) -> None:
        manager.site = replace(RARELY, event=8)
        wire.send(said(200, {"boot": "boot", "event": 8}))

    manager = Manager(RARELY, {"wanted": script})
    with scripted_manager(manager, PATIENT) as (_, remote, listener):
        assert listener.next_site().site.event == 7
        remote.send(wanted())
        assert listener.next_answer().event == 8
        assert listener.next_site().site.event == 8


def test_what_is_asked_of_a_manager_that_is_lost_is_answered_in_time() -> None:
    with scripted_manager(lambda _, __: None, BRISK) as (_, remote, listener):
        began = time.monotonic()
        for each in (wanted("east"), ended("west")):
            remote.send(each)
        assert {listener.next_answer().code for _ in range(2)} == {UNREACHABLE}
        assert time.monotonic() - began < WITHIN_S
