"""The adapter's place in RMF, over a real domain on the loopback interface."""

import asyncio
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds import Dds, DdsFailed, Monitor
from lift_manager.rmf.dds_inbox import MOST_CALLS
from lift_manager.rmf.lasting import LastingRmf
from lift_manager.rmf.messages import END_SESSION, LiftRequest, LiftState
from lift_manager.rmf.ros_settings import RosSettings
from tests.support.dds_partner import LIMIT_S, Offer, Partner
from tests.support.dds_rig import ORACLE, Heard, adapter, at_once, padded, request, settings_of_test, state

REQUESTS, STATES, FIRE = "rt/lift_requests", "rt/lift_states", "rt/fire_alarm_trigger"


@pytest.fixture
def settings() -> RosSettings:
    return settings_of_test()


@pytest.fixture
def joined(settings: RosSettings) -> Iterator[tuple[Dds, Heard, Partner]]:
    with adapter(settings) as (dds, heard):
        partner = Partner(settings.domain)
        yield dds, heard, partner
        partner.close()


def broken(good: LiftRequest) -> bytes:
    return ORACLE.request(good).replace(b"L2", b"\xff\xfe")


def test_a_request_with_broken_text_does_not_take_its_neighbours_along(settings: RosSettings) -> None:
    gate = threading.Event()
    heard = Heard()

    def when_all_are_there(call: Callable[[], None]) -> None:
        assert gate.wait(LIMIT_S)
        call()

    dds = Dds(settings, heard, when_all_are_there)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    before, bad, after = request("before"), request("bad"), request("after")
    partner.write(REQUESTS, ORACLE.request(before), broken(bad), broken(bad), ORACLE.request(after))
    gate.set()
    assert heard.wait_for("requested", 2) == [before, after]
    assert heard.of("broken") == ["its text is not UTF-8 (lift_requests)"] * 2
    assert [what for what, _ in heard.events] == ["matched", "requested", "broken", "broken", "requested"]
    partner.close()
    dds.close()


def test_a_new_publisher_is_told_of_before_its_first_request_even_in_the_middle_of_others(
    settings: RosSettings,
) -> None:
    gate = threading.Event()
    heard = Heard()

    def wait_in_the_first_request(call: Callable[[], None]) -> None:
        call()
        if heard.of("requested"):
            assert gate.wait(LIMIT_S)

    dds = Dds(settings, heard, wait_in_the_first_request)
    partners = [Partner(settings.domain), Partner(settings.domain)]
    for name, partner in zip(("first", "second"), partners, strict=True):
        partner.offer(REQUESTS, "request", Offer())
        partner.write(REQUESTS, ORACLE.request(request(name)))
        heard.wait_for("requested")
    gate.set()
    heard.wait_for("requested", 2)
    assert [what for what, _ in heard.events] == ["matched", "requested", "matched", "requested"]
    for partner in partners:
        partner.close()
    dds.close()


def test_a_text_of_a_megabyte_arrives_whole(joined: tuple[Dds, Heard, Partner]) -> None:
    _, heard, partner = joined
    partner.offer(REQUESTS, "request", Offer())
    long = request(session="x" * 1_000_000)
    partner.write(REQUESTS, ORACLE.request(long), ORACLE.request(request()))
    assert heard.wait_for("requested", 2) == [long, request()]


def test_a_flood_that_nobody_takes_is_bounded_and_its_end_is_kept(settings: RosSettings) -> None:
    calls: list[Callable[[], None]] = []
    heard = Heard()
    dds = Dds(settings, heard, calls.append)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer(depth=1))
    data = ORACLE.request(request("flood"))
    partner.write(REQUESTS, *[data] * 10_000, ORACLE.request(request("last")))
    while not (heard.events and heard.events[-1] == ("requested", request("last"))):
        for call in calls[:]:
            calls.remove(call)
            call()
        assert len(calls) <= 1
    lost = 10_001 - len(heard.of("requested"))
    partner.close()
    dds.close()
    assert lost >= 0
    assert lost == 0 or dds.dropped  # a full reader counts as one loss, and may have lost none or many


class UntilLast(Heard):
    """Hears thousands, and can be waited for until the one for the lift `last`."""

    def __init__(self) -> None:
        super().__init__()
        self.requests: list[LiftRequest] = []
        self.last = threading.Event()

    def on_request(self, request: LiftRequest) -> None:
        self.requests.append(request)
        if request.lift_name == "last":
            self.last.set()


@contextmanager
def held_up(settings: RosSettings) -> Iterator[tuple[UntilLast, Partner, Callable[[], None]]]:
    """A hearer whose thread stands still, and what lets it go on."""
    gate, begun = threading.Event(), threading.Event()
    heard = UntilLast()

    def when_let_go(call: Callable[[], None]) -> None:
        begun.set()
        assert gate.wait(LIMIT_S)
        call()

    dds = Dds(settings, heard, when_let_go)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    partner.write(REQUESTS, ORACLE.request(request("first")))
    assert begun.wait(LIMIT_S)
    try:
        yield heard, partner, gate.set
    finally:
        gate.set()
        partner.close()
        dds.close()


def test_a_burst_of_one_robot_does_not_lose_the_end_of_another(
    settings: RosSettings, caplog: pytest.LogCaptureFixture
) -> None:
    end = request(session="fleet/holder", kind=END_SESSION)
    flood = [ORACLE.request(request("flood"))] * 3000
    with held_up(settings) as (heard, partner, go_on):
        partner.write(REQUESTS, *flood, ORACLE.request(end), *flood, ORACLE.request(request("last")))
        go_on()
        assert heard.last.wait(LIMIT_S)
        assert heard.requests.count(end) == 1
    assert caplog.records == []


def test_more_than_the_reader_can_keep_is_told_of_and_counted(
    settings: RosSettings, caplog: pytest.LogCaptureFixture
) -> None:
    with held_up(settings) as (heard, partner, go_on):
        partner.write(REQUESTS, *[ORACLE.request(request("flood"))] * 11_000, ORACLE.request(request("last")))
        go_on()
        assert heard.last.wait(LIMIT_S)
    assert [record.getMessage() for record in caplog.records] == [
        "messages of RMF arrive faster than they can be processed: the oldest are dropped unread",
        "at least 1 messages of RMF were dropped unread in total",
    ]


@pytest.mark.parametrize(("session", "delivered"), [("fleet/robot1", 1), ("", 0)])
def test_the_end_of_a_session_waits_out_a_flood_that_nobody_takes(
    settings: RosSettings, session: str, delivered: int
) -> None:
    calls: list[Callable[[], None]] = []
    heard = Heard()
    dds = Dds(settings, heard, calls.append)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    end = request(session=session, kind=END_SESSION)
    partner.write(REQUESTS, ORACLE.request(end))
    while dds.dropped < 2:
        partner.write(REQUESTS, *[ORACLE.request(request("flood"))] * 200)
    while calls:
        calls.pop()()
    assert heard.of("requested").count(end) == delivered
    partner.close()
    dds.close()


def test_requests_that_nobody_takes_are_given_up_and_counted(settings: RosSettings) -> None:
    calls: list[Callable[[], None]] = []
    heard = Heard()
    dds = Dds(settings, heard, calls.append)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    data = ORACLE.request(request("flood"))
    written = 0
    while dds.dropped < MOST_CALLS / 2:  # the first may be lost before they come here: a busy machine takes them late
        partner.write(REQUESTS, *[data] * 200)
        written += 200
    partner.close()
    assert len(calls) == 1
    while calls:
        calls.pop()()
    dds.close()
    assert len(heard.of("requested")) >= MOST_CALLS
    assert len(heard.of("requested")) + dds.dropped <= written


def test_a_standby_is_in_rmf_receives_and_publishes_in_its_terms_alone(settings: RosSettings) -> None:
    end, fire = request(kind=END_SESSION), Alarms(fire_alarm=True)

    async def main() -> None:
        lasting = LastingRmf(partial(Dds, settings), fire, asyncio.get_running_loop().time)
        partner = Partner(settings.domain)
        offered = {endpoint.topic_name for what, endpoint in partner.endpoints() if what == "writer"}
        assert {STATES, FIRE} <= offered
        states, alarms = partner.hear(STATES, "state", Offer()), partner.hear(FIRE, "alarm", Offer())
        partner.offer(REQUESTS, "request", Offer())
        partner.write(REQUESTS, ORACLE.request(end))
        told = [padded(ORACLE.state(state(floor=floor))) for floor in ("first", "second")]
        for floor in ("first", "second"):
            await play_term(lasting, floor)
        assert await asyncio.to_thread(states.wait_for, lambda samples: len(samples) >= 2) == told
        await asyncio.to_thread(alarms.wait_for, lambda samples: len(samples) == 2)
        partner.close()
        lasting.close()

    async def play_term(lasting: LastingRmf, floor: str) -> None:
        remaining_s = 1.0
        heard = Heard()
        term = lasting.attach(lambda: remaining_s > 0, heard, at_once)
        (ended,) = await asyncio.to_thread(heard.wait_for, "requested")
        assert (ended.lift_name, ended.session_id, ended.request_type) == ("lift1", end.session_id, END_SESSION)
        term.publish(state(floor=floor))
        term.publish_alarms(fire, on=True)
        remaining_s = 0.0
        term.publish(state(floor="too late"))
        term.publish_alarms(fire, on=True)
        term.close()

    asyncio.run(main())


def test_somebody_elses_state_of_our_lift_is_told(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, heard, partner = joined
    partner.offer(STATES, "state", Offer())
    dds.publish(state("lift1"))
    partner.write(
        STATES, ORACLE.state(state("lift9")), ORACLE.state(state("lift1")).replace(b"lift1", b"\xff\xfe\xfd11")
    )
    partner.write(STATES, ORACLE.state(state("lift1")))
    heard.wait_for("rival")
    assert set(heard.events) == {("rival", "lift1")}


def test_our_own_states_are_no_rivals(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, heard, partner = joined
    ear = partner.hear(STATES, "state", Offer())
    partner.offer(REQUESTS, "request", Offer())
    for _ in range(10):
        dds.publish(state("lift1"))
    ear.wait_for(lambda samples: len(samples) == 10)
    partner.write(REQUESTS, ORACLE.request(request()))
    heard.wait_for("requested")
    assert heard.of("rival") == []


def test_the_clock_of_a_simulation_is_followed() -> None:
    settings = settings_of_test(use_sim_time=True, namespace="/sim")
    with adapter(settings) as (_, heard):
        partner = Partner(settings.domain)
        partner.offer("rt/clock", "clock", Offer(reliable=False))
        partner.write("rt/clock", ORACLE.clock(12, 500_000_000))
        heard.wait_until("clock", lambda seconds: seconds == 12.5)
        partner.write("rt/clock", ORACLE.clock(13, 0))
        heard.wait_until("clock", lambda seconds: seconds == 13.0)
        partner.close()


def test_a_namespace_and_other_topics_are_kept_apart_from_the_plain_ones() -> None:
    settings = settings_of_test(namespace="/b1", requests_topic="sim/asked", states_topic="/said")
    with adapter(settings) as (dds, heard):
        partner = Partner(settings.domain)
        for topic in (REQUESTS, "rt/sim/asked", "rt/b1/sim/asked"):
            partner.offer(topic, "request", Offer())
            partner.write(topic, ORACLE.request(request(topic)))
        ear = partner.hear("rt/said", "state", Offer())
        dds.publish(state())
        assert ear.wait_for(bool) == [padded(ORACLE.state(state()))]
        assert [one.lift_name for one in heard.wait_for("requested")] == ["rt/b1/sim/asked"]
        partner.close()


def test_two_domains_do_not_hear_each_other() -> None:
    here, there = settings_of_test(domain=101), settings_of_test(domain=102)
    with adapter(here) as (_, heard), adapter(there) as (_, heard_there):
        partners = [Partner(settings.domain) for settings in (there, here)]
        for partner in partners:
            partner.offer(REQUESTS, "request", Offer())
        partners[0].write(REQUESTS, ORACLE.request(request("there")))
        assert heard_there.wait_for("requested") == [request("there")]
        partners[1].write(REQUESTS, ORACLE.request(request("here")))
        assert heard.wait_for("requested") == [request("here")]
        assert heard_there.of("requested") == [request("there")]
        for partner in partners:
            partner.close()


def test_what_is_heard_comes_in_the_thread_of_the_loop(settings: RosSettings) -> None:
    threads: list[threading.Thread] = []

    async def main() -> list[Any]:
        loop, done = asyncio.get_running_loop(), asyncio.Event()

        class InLoop(Heard):
            def on_request(self, request: LiftRequest) -> None:
                threads.append(threading.current_thread())
                super().on_request(request)
                done.set()

        heard = InLoop()
        dds = Dds(settings, heard, loop.call_soon_threadsafe)
        partner = Partner(settings.domain)
        partner.offer(REQUESTS, "request", Offer())
        partner.write(REQUESTS, ORACLE.request(request()))
        async with asyncio.timeout(LIMIT_S):
            await done.wait()
        partner.close()
        dds.close()
        return heard.of("requested")

    assert asyncio.run(main()) == [request()]
    assert threads == [threading.main_thread()]


def test_it_can_be_closed_twice_and_opened_again_and_leaves_no_thread(settings: RosSettings) -> None:
    before = threading.active_count()
    for _ in range(3):
        dds = Dds(settings, Heard(), at_once)
        assert threading.active_count() == before + 1
        dds.close()
        dds.close()
        assert threading.active_count() == before


def test_a_bug_in_the_thread_that_hears_is_raised_in_the_adapters_own(settings: RosSettings) -> None:
    """The adapter would go on publishing and hear no request and no END any more."""
    delivered: list[Callable[[], None]] = []
    broke = threading.Event()
    handed_over = threading.Event()

    def deliver(call: Callable[[], None]) -> None:
        if not broke.is_set():
            broke.set()
            raise ZeroDivisionError("a bug")
        delivered.append(call)
        handed_over.set()

    dds = Dds(settings, Heard(), deliver)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    partner.write(REQUESTS, ORACLE.request(request()))
    assert handed_over.wait(LIMIT_S)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        delivered[0]()
    partner.close()
    dds.close()
    assert "dds" not in {thread.name for thread in threading.enumerate()}


def test_nothing_is_delivered_after_closing(settings: RosSettings) -> None:
    calls: list[Callable[[], None]] = []
    asked = threading.Event()
    heard = Heard()

    def keep(call: Callable[[], None]) -> None:
        calls.append(call)
        asked.set()

    dds = Dds(settings, heard, keep)
    partner = Partner(settings.domain)
    partner.offer(REQUESTS, "request", Offer())
    partner.write(REQUESTS, ORACLE.request(request()))
    assert asked.wait(LIMIT_S)
    partner.close()
    dds.close()
    for call in calls:
        call()
    assert heard.events == []


class Looked:
    """Implements MonitorListener."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, Any]] = []
        self.changed = threading.Condition()

    def on_state(self, state: LiftState) -> None:
        self._note("state", state)

    def on_request(self, topic: str, request: LiftRequest) -> None:
        self._note(topic, request)

    def on_unreadable(self, text: str) -> None:
        self._note("broken", text)

    def wait_for(self, count: int) -> list[tuple[str, Any]]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.seen) >= count, LIMIT_S), self.seen
            return self.seen

    def _note(self, what: str, value: object) -> None:
        with self.changed:
            self.seen.append((what, value))
            self.changed.notify_all()


def test_an_onlooker_hears_all_that_is_said(settings: RosSettings) -> None:
    looked = Looked()
    monitor = Monitor(settings, looked, at_once)
    partner = Partner(settings.domain)
    for topic, kind, data in (
        ("rt/adapter_lift_requests", "request", ORACLE.request(request("asked"))),
        (REQUESTS, "request", ORACLE.request(request("passed on"))),
        (STATES, "state", ORACLE.state(state())),
    ):
        partner.offer(topic, kind, Offer(transient=True))
        partner.write(topic, data)
        looked.wait_for(len(looked.seen))
    partner.write(STATES, ORACLE.state(state()).replace(b"lift1", b"\xff\xfe\xfd11"))
    seen = looked.wait_for(4)
    assert {what for what, _ in seen} == {"adapter_lift_requests", "lift_requests", "state", "broken"}
    assert ("adapter_lift_requests", request("asked")) in seen
    assert ("lift_requests", request("passed on")) in seen
    assert ("state", state()) in seen
    partner.close()
    monitor.close()


@pytest.mark.parametrize("supervisor", [Offer(transient=True), Offer(transient=False)], ids=["iron to main", "humble"])
def test_a_request_of_an_onlooker_reaches_the_supervisor(settings: RosSettings, supervisor: Offer) -> None:
    monitor = Monitor(settings, Looked(), at_once)
    partner = Partner(settings.domain)
    assert (monitor.count_readers(), monitor.count_readers(direct=True)) == (1, 1), "itself, looking on"
    ear = partner.hear("rt/adapter_lift_requests", "request", supervisor)
    assert monitor.count_readers() == 2
    monitor.send_request(request())
    assert ear.wait_for(bool) == [padded(ORACLE.request(request()))]
    partner.close()
    monitor.close()


def test_a_direct_request_of_an_onlooker_reaches_the_adapter(settings: RosSettings) -> None:
    monitor = Monitor(settings, Looked(), at_once)
    partner = Partner(settings.domain)
    ear = partner.hear(REQUESTS, "request", Offer())
    monitor.send_request(request(), direct=True)
    assert ear.wait_for(bool) == [padded(ORACLE.request(request()))]
    partner.close()
    monitor.close()


OPEN_WITHOUT = """
import sys
from lift_manager.rmf.dds import Dds, DdsMissing
from lift_manager.rmf.ros_settings import RosSettings
assert "cyclonedds" not in sys.modules
sys.path.insert(0, sys.argv[1])
try:
    Dds(RosSettings(), None, None)
except DdsMissing as error:
    sys.stdout.write(str(error))
"""
NO_C_LIBRARY = "class CycloneDDSLoaderException(Exception): ...\nraise CycloneDDSLoaderException('not located')\n"


@pytest.mark.parametrize(
    ("package", "cause"),
    [
        pytest.param(
            "raise ModuleNotFoundError('No module named cyclonedds')", "No module named cyclonedds", id="not installed"
        ),
        pytest.param(NO_C_LIBRARY, "not located", id="built from source, without its C library"),
    ],
)
def test_without_the_package_it_says_what_to_install(tmp_path: Path, package: str, cause: str) -> None:
    (tmp_path / "cyclonedds").mkdir()
    (tmp_path / "cyclonedds" / "__init__.py").write_text(package)
    command = [sys.executable, "-c", OPEN_WITHOUT, str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert f"it does not load ({cause})" in said
    assert "extra `rmf`: pip install '.[rmf]'" in said
    assert "CYCLONEDDS_HOME=/opt/cyclonedds pip install --no-binary cyclonedds cyclonedds==11.0.1" in said


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("<broken", r"domain \d+ cannot be joined: Cyclone DDS wrote the reason to the error output.*'<broken'"),
        ("file:///nowhere/at/all.xml", r"a wrong configuration.*CYCLONEDDS_URI is 'file:///nowhere/at/all.xml'"),
        ("file:///größe.xml", r"CYCLONEDDS_URI is 'file:///größe.xml': Cyclone DDS takes ASCII letters only"),
    ],
)
def test_a_configuration_that_cannot_be_used_is_refused(uri: str, message: str) -> None:
    with pytest.raises(DdsFailed, match=message):
        Dds(settings_of_test(cyclonedds_uri=uri), Heard(), at_once)


def test_a_program_is_in_a_domain_once(settings: RosSettings) -> None:
    with (
        adapter(settings),
        pytest.raises(DdsFailed, match=re.escape(f"this program is in domain {settings.domain} already")),
    ):
        Dds(settings, Heard(), at_once)


def test_a_machine_that_is_full_of_programs_is_told_of() -> None:
    settings = settings_of_test(domain=103)
    with ExitStack() as stack:
        for index in range(33):
            taken = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            with suppress(OSError):  # taken already is as good
                taken.bind(("0.0.0.0", 7400 + 250 * settings.domain + 10 + 2 * index))
        with pytest.raises(DdsFailed, match="more than 33 programs of it on this machine"):
            Dds(settings, Heard(), at_once)
