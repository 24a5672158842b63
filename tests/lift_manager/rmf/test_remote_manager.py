"""The way to a manager in another process: how the lifts are, whatever answers there, and that threads and keys stay where they belong."""

import json
import logging
import queue
import ssl
import threading
import time
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import pytest

from lift_manager.plain.answers import describe_refusal
from lift_manager.plain.http import Address, Reply, Server
from lift_manager.rmf.port import Answer, EndOfSession, SessionDemand
from lift_manager.rmf.remote_manager import ANSWER_SHARE, MAX_REASONS, SENDERS, Pace, RemoteManager
from tests.lift_manager.rmf.remote_rig import (
    BRISK,
    CALM,
    KEY,
    LIFT,
    PATIENT,
    RARELY,
    SITE,
    STREAM,
    Lost,
    Manager,
    Received,
    RecordingListener,
    connected,
    event,
    scripted_manager,
    spoiled,
)
from tests.support.certificates import Authority
from tests.support.rows import each_row
from tests.support.scripted_http import (
    WITHIN_S,
    Asked,
    Script,
    Scripted,
    Wire,
    answers,
    problem,
    said,
    says_and_hangs_up,
)

RMF = "/api/v1/rmf"
HTML = b"<html><body>Bad gateway</body></html>"
WANTED = SessionDemand("east", "fleet/amr-7", "L2", hold_door=True)


def nothing(_: Asked, __: Wire) -> None:
    """The connection stays, and nothing comes."""


def own_threads() -> list[threading.Thread]:
    return [
        thread for thread in threading.enumerate() if thread.name in {"rmf_poller", "rmf_eventreader", "rmf_sender"}
    ]


def questions(server: Scripted) -> int:
    return sum(asked.path == RMF for asked in server.asked)


# how the lifts are


def test_the_site_is_heard_with_the_time_at_which_its_question_left() -> None:
    began = time.monotonic()
    with scripted_manager(Manager()) as (server, _, listener):
        heard = listener.next_site()
        server.next()
    assert heard.site == SITE
    assert began <= heard.asked_at <= heard.now <= time.monotonic()
    assert server.asked[0].headers["authorization"] == f"Bearer {KEY}"


def test_it_is_asked_often_enough_to_stay_fresh_on_one_connection() -> None:
    with scripted_manager(Manager()) as (server, _, listener):
        asked_at = [listener.next_site().asked_at for _ in range(6)]
        while asked_at[-1] - asked_at[-2] > LIFT.max_age_s:  # on a busy machine some take longer
            asked_at.append(listener.next_site().asked_at)
    gaps = [after - before for before, after in pairwise(asked_at)]
    assert min(gaps) > LIFT.max_age_s / 3 - 0.01
    assert len({asked.connection for asked in server.asked if asked.path == RMF}) == 1


def test_a_site_without_lifts_is_an_answer() -> None:
    with scripted_manager(Manager(replace(SITE, lifts=()))) as (_, _, listener):
        assert listener.next_site().site.lifts == ()


WRONG = [
    (nothing, "no manager answers at http://127.0.0.1:PORT (no whole answer came in time)"),
    (lambda _, wire: wire.hang_up(), "(the connection was closed without an answer)"),
    (says_and_hangs_up(said(200, asdict(SITE))[:-9]), "(half an answer came, and the connection was closed)"),
    (says_and_hangs_up(b"\0\1\2\3 no HTTP\r\n\r\n"), "(what answers there does not speak HTTP)"),
    (answers(502, HTML, "text/html"), "at http://127.0.0.1:PORT is no lift manager (HTTP 502, text/html)"),
    (answers(200, HTML, "text/html"), "is no lift manager (HTTP 200, text/html), or one of another version"),
    (answers(200, b"\xff\xfe"), "(HTTP 200, application/json), or one of another version than this adapter: it is no"),
    (answers(200, b"[" * 200_000), "it is not JSON"),
    (answers(200, [1]), "the answer is a list and no object"),
    (answers(200, {"data": {}, "success": True}), "the answer lacks `alarms`"),
    (answers(200, spoiled(lifts=[{"lift": "east"}])), "lifts[0] lacks `name`"),
    (answers(200, spoiled(event="7")), "the answer.event is text and no whole number"),
    (
        lambda _, wire: wire.send(problem(401, "bad_key", "it counts not")),
        "refuses (bad_key): it counts not; the adapter",
    ),
    (
        lambda _, wire: wire.send(problem(403, "not_allowed")),
        "(not_allowed): no; the adapter needs a key of the role rmf",
    ),
    (lambda _, wire: wire.send(problem(404, "no_such_path")), "is of a version that does not know this request"),
    (lambda _, wire: wire.send(problem(503, "stopping", "wait\na bit")), "refuses (stopping): wait a bit"),
    (answers(302, b"", also="location: http://elsewhere/\r\n"), "redirects elsewhere (HTTP 302); give the address of"),
]


def test_a_path_behind_the_address_that_no_manager_has_is_named() -> None:
    server = Server(Address.of("http://[::1]:5003/x"))
    body = json.dumps({"code": "no_such_path", "detail": "Not Found"}).encode()
    why = describe_refusal(server, Reply(404, "application/problem+json", body), "")
    assert why.startswith("the manager at http://[::1]:5003 has nothing under /x: leave the path out of its address")


@each_row(("script", "why"), WRONG)
def test_whatever_answers_in_its_place_is_told_once_and_the_manager_is_found_again(script: Script, why: str) -> None:
    manager = Manager()
    with scripted_manager(manager, BRISK if script is nothing else CALM) as (server, _, listener):
        listener.until_site()
        manager.scripts[RMF] = script
        reason = listener.next_loss()
        assert why.replace("PORT", str(server.port)) in reason
        tries = questions(server) + 1
        while questions(server) < tries:
            server.next()
        del manager.scripts[RMF]
        # nothing else was told in between
        assert isinstance(listener.next(), Received)


def test_a_manager_that_is_not_there_at_the_start_is_told_once_and_found() -> None:
    server = Scripted(Manager())
    server.listen()
    server.stop()
    with connected(server.port) as (_, listener):
        assert "nothing listens there: is the manager running?" in listener.next_loss()
        assert listener.all_until(time.monotonic() + 0.1) == []
        with server:
            assert isinstance(listener.next(), Received)


def test_a_manager_that_is_killed_is_missed_at_once_and_found_on_the_same_port() -> None:
    events = Events()
    server = Scripted(Manager(RARELY, {"events": events}))
    server.listen()
    with connected(server.port, PATIENT) as (_, listener):
        listener.next_site()
        events.until_open()
        server.stop()
        # its stream ended: the next question by itself would come much later
        assert "nothing listens there" in listener.next_loss()
        with server:
            assert isinstance(listener.next(), Received)


def test_each_reason_is_told_once_in_one_loss_and_again_in_the_next() -> None:
    manager = Manager()
    told = [f"reason {number}" for number in range(MAX_REASONS + 2)]

    def script(_: Asked, wire: Wire) -> None:
        wire.send(problem(503, "stopping", told[questions(server) % len(told)]))

    with scripted_manager(manager) as (server, _, listener):
        listener.next_site()
        for _ in range(2):
            manager.scripts[RMF] = script
            reasons = {listener.next_loss() for _ in range(MAX_REASONS)}
            assert len(reasons) == MAX_REASONS
            tries = questions(server) + len(told)
            while questions(server) < tries:
                server.next()
            del manager.scripts[RMF]
            assert isinstance(listener.next(), Received)


def test_a_server_that_closes_after_each_answer_is_as_good() -> None:
    manager = Manager(scripts={RMF: says_and_hangs_up(said(200, asdict(SITE)))})
    with scripted_manager(manager) as (_, _, listener):
        for _ in range(3):
            listener.next_site()


def test_an_answer_may_take_as_long_as_it_is_good_for() -> None:
    late = threading.Event()

    def script(_: Asked, wire: Wire) -> None:
        late.wait(0.2)
        wire.send(said(200, asdict(site)))

    site = replace(SITE, lifts=(replace(LIFT, max_age_s=WITHIN_S), LIFT))
    manager = Manager(site)
    with scripted_manager(manager, replace(PATIENT, poll_timeout_s=0.1)) as (_, _, listener):
        listener.until_site()
        manager.scripts[RMF] = script
        for _ in range(2):
            listener.next_site()


# events


def stream(*pieces: bytes) -> Script:
    return lambda _, wire: wire.send(STREAM, *pieces)


class Events:
    """A stream on which a test says what happens."""

    def __init__(self) -> None:
        self._wires: queue.Queue[Wire] = queue.Queue()
        self._wire: Wire | None = None

    def __call__(self, _: Asked, wire: Wire) -> None:
        wire.send(STREAM)
        self._wires.put(wire)

    def until_open(self) -> None:
        self._wire = self._wires.get(timeout=WITHIN_S)

    def tell(self, event_id: str) -> None:
        assert self._wire is not None
        self._wire.send(event(event_id))


def test_what_an_event_tells_is_asked_at_once_unless_it_was_shown_already() -> None:
    events = Events()
    manager = Manager(RARELY, {"events": events})
    with scripted_manager(manager, PATIENT) as (server, _, listener):
        assert listener.next_site().site.event == 7
        events.until_open()
        manager.site = replace(RARELY, event=9)
        # 7 is shown already; 8 and 9 are one question, 5 is none, and another boot is one
        events.tell("boot-7")
        for event_id, is_asked in (("boot-8", True), ("boot-9", False), ("boot-5", False), ("other-1", True)):
            events.tell(event_id)
            if is_asked:
                assert listener.next_site().site == manager.site
        assert listener.all_until(time.monotonic() + 0.1) == []
        assert questions(server) == 3


def test_an_event_that_comes_while_an_answer_is_under_way_is_asked_for_again() -> None:
    events = Events()
    numbers = iter((7, 8, 9))
    time_to_arrive = threading.Event()

    def script(_: Asked, wire: Wire) -> None:
        shown = next(numbers)
        if shown == 8:
            events.tell("boot-9")
            time_to_arrive.wait(0.1)
        wire.send(said(200, asdict(replace(RARELY, event=shown))))

    manager = Manager(replace(RARELY, event=8), {"events": events, RMF: script})
    with scripted_manager(manager, PATIENT) as (_, remote, listener):
        assert listener.next_site().site.event == 7
        events.until_open()
        remote.send(WANTED)  # decided as event 8, and so it is asked again
        assert [listener.next_site().site.event for _ in range(2)] == [8, 9]


@pytest.mark.parametrize("events", [answers(404), lambda _, wire: wire.send(problem(503, "too_many_streams")), nothing])
def test_without_a_stream_it_is_asked_all_the_same(events: Script) -> None:
    with scripted_manager(Manager(scripts={"events": events})) as (_, _, listener):
        for _ in range(3):
            listener.next_site()


@each_row(
    "script",
    [stream(), stream(b": half a heart"), says_and_hangs_up(STREAM), says_and_hangs_up(STREAM + event("boot-7"))],
)
def test_a_stream_that_falls_silent_or_ends_is_taken_up_again(script: Script) -> None:
    taken = threading.Semaphore(0)

    def events(asked: Asked, wire: Wire) -> None:
        taken.release()
        script(asked, wire)

    with scripted_manager(Manager(scripts={"events": events}), BRISK) as (_, _, listener):
        for _ in range(2):
            assert taken.acquire(timeout=WITHIN_S)
        listener.until_site()


def events_until(enough: threading.Event) -> Script:
    def script(_: Asked, wire: Wire) -> None:
        wire.send(STREAM)
        number = 0
        while not enough.wait(0.001):
            number += 1
            wire.send(event(f"x-{number}"))

    return script


def test_no_number_of_events_makes_more_than_fifty_questions_a_second_to_a_manager_that_takes_its_time() -> None:
    def site(_: Asked, wire: Wire) -> None:
        threading.Event().wait(Pace.min_poll_gap_s * ANSWER_SHARE)
        wire.send(said(200, asdict(RARELY)))

    enough = threading.Event()
    manager = Manager(RARELY, {"events": events_until(enough), RMF: site})
    with scripted_manager(manager, PATIENT) as (_, _, listener):
        heard = [listener.next_site() for _ in range(7)]
        enough.set()
    assert all(after.asked_at - before.asked_at > Pace.min_poll_gap_s - 0.001 for before, after in pairwise(heard))


def test_a_manager_that_answers_at_once_is_asked_again_as_soon_as_there_is_news() -> None:
    enough = threading.Event()
    manager = Manager(RARELY, {"events": events_until(enough)})
    with scripted_manager(manager, replace(PATIENT, min_poll_gap_s=1000.0)) as (_, _, listener):
        for _ in range(3):
            listener.next_site()
        enough.set()


# the end, and what stays inside


@each_row("manager", [Manager(), nothing, Manager(scripts={"events": stream()}), Manager(scripts={RMF: answers(500)})])
def test_the_end_ends_every_thread_whatever_it_waits_for(manager: Script) -> None:
    with Scripted(manager) as server, connected(server.port, Pace()) as (remote, listener):
        remote.send(WANTED)
        remote.send(EndOfSession("west", "s", 3.0))
        server.next()
        mine = own_threads()
        assert len(mine) == 2 + SENDERS
        began = time.monotonic()
        remote.close()
        assert time.monotonic() - began < WITHIN_S
        assert not any(thread.is_alive() for thread in mine)
        assert listener.all_until(time.monotonic() + 0.05) == []


def test_what_waits_in_the_adapters_thread_at_the_end_is_not_said_any_more() -> None:
    with scripted_manager(Manager()) as (server, remote, listener):
        server.next()
        waiting = listener.inbox.get(timeout=WITHIN_S)
        remote.close()
        waiting()
        assert listener.all_until(time.monotonic()) == []


def test_a_bug_of_a_thread_is_raised_in_the_adapters_own() -> None:
    listener = RecordingListener()
    first = iter((True,))

    def deliver(what: object) -> None:
        if next(first, False):
            raise RuntimeError("a bug")
        listener.inbox.put(what)  # type: ignore[arg-type]

    with Scripted(Manager()) as server:
        remote = RemoteManager(Server(Address("127.0.0.1", server.port)), BRISK)
        remote.start(listener, deliver)
        with pytest.raises(RuntimeError, match="a bug"):
            listener.inbox.get(timeout=WITHIN_S)()
        remote.close()


def test_the_key_is_in_no_reason_no_log_and_no_picture_of_anything(caplog: pytest.LogCaptureFixture) -> None:
    def echo(asked: Asked, wire: Wire) -> None:
        wire.send(problem(401, f"bad {asked.headers['authorization']}", f"not {asked.headers['authorization']}\nhere"))

    caplog.set_level(logging.DEBUG)
    kind = f"text/{KEY}"
    scripts: list[Script] = [echo, answers(200, [KEY], kind), answers(500, b"", kind), nothing]
    manager = Manager()
    with scripted_manager(manager, BRISK) as (server, remote, listener):
        said_ = [repr(remote), repr(vars(remote)), listener.until_site()]
        for script in scripts:
            manager.scripts = {RMF: script, "wanted": script, "events": script}
            remote.send(WANTED)
            heard: list[Received | Answer | Lost] = []
            while not {Answer, Lost} <= {type(one) for one in heard}:  # in either order, and each loss is told once
                heard.append(listener.next())
            said_ += heard
            manager.scripts = {}
            listener.until_site()
    assert all(KEY in asked.headers["authorization"] for asked in server.asked)
    assert KEY not in caplog.text + repr(said_)


def test_a_manager_that_speaks_https_is_heard_with_its_ca(tmp_path: Path) -> None:
    authority = Authority(tmp_path)
    shown = authority.issue("server", "127.0.0.1")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(shown.certificate, shown.key)
    with Scripted(Manager(), context) as server:
        listener = RecordingListener()
        remote = RemoteManager(Server(Address("127.0.0.1", server.port, tls=True), KEY, authority.file))
        remote.start(listener, listener.inbox.put)
        remote.send(WANTED)
        assert listener.next_answer().accepted
        assert isinstance(listener.next(), Received | Lost)
        remote.close()
