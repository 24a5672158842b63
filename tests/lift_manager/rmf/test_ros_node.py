"""The node on a strict stand-in for rclpy, as each distribution has it."""

from __future__ import annotations

import array
import ast
import logging
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.plain.http import BadAddress
from lift_manager.plain.rmf import Alarms
from lift_manager.rmf import messages
from lift_manager.rmf.messages import LiftRequest, LiftState, Time
from lift_manager.rmf.port import Answer, EndOfSession, SessionDemand
from tests.support.fake_rclpy_loader import DISTROS, Ros, held, installed, lift

HOME = Path(__file__).resolve().parents[3]
ROS_PACKAGES = {"rclpy", "rmf_lift_msgs", "rmf_fleet_msgs", "std_msgs", "rosgraph_msgs", "builtin_interfaces"}
FIRE = Alarms(fire_alarm=True)
WITH_EVENT = DISTROS[1:]


@pytest.fixture(params=DISTROS)
def ros(request: pytest.FixtureRequest) -> Iterator[Ros]:
    """Each distribution."""
    with installed(request.param) as found:
        yield found


@pytest.fixture
def jazzy() -> Iterator[Ros]:
    with installed("jazzy") as found:
        yield found


def test_topics_types_and_quality_of_service_are_those_of_the_contract(ros: Ros) -> None:
    ros.start()
    assert ros.node.get_name() == "lift_adapter"
    assert set(ros.world.topics) == {"/lift_states", "/lift_requests", "/adapter_lift_requests"}
    states, requests, fleets = (
        ros.world.topics[name] for name in ("/lift_states", "/lift_requests", "/adapter_lift_requests")
    )
    # one that could not be delivered in a second says what is over, and OPEN would be believed
    offer, demand = ros.offer(depth=100, lifespan_s=1.0), ros.offer(depth=10_000)
    assert [(one.kind, one.offer) for one in states.writers] == [(ros.lift_msgs.LiftState, offer)]
    assert [(one.kind, one.offer) for one in requests.readers] == [(ros.lift_msgs.LiftRequest, demand)]
    assert [(one.kind, one.offer) for one in fleets.readers] == [(ros.lift_msgs.LiftRequest, demand)]
    assert not states.readers
    assert not requests.writers
    assert not fleets.writers


def test_numbers_are_those_of_the_messages(jazzy: Ros) -> None:
    request, state = jazzy.lift_msgs.LiftRequest, jazzy.lift_msgs.LiftState
    assert (request.REQUEST_END_SESSION, request.REQUEST_AGV_MODE, request.REQUEST_HUMAN_MODE) == (
        messages.REQUEST_TYPES
    )
    assert (request.DOOR_CLOSED, request.DOOR_OPEN) == messages.REQUEST_DOORS
    for name in ("DOOR_CLOSED", "DOOR_MOVING", "DOOR_OPEN"):
        assert getattr(state, name) == getattr(messages, name)
    for name in ("UNKNOWN", "HUMAN", "AGV", "FIRE", "OFFLINE", "EMERGENCY"):
        assert getattr(state, f"MODE_{name}") == getattr(messages, f"MODE_{name}")
    for name in ("STOPPED", "UP", "DOWN", "UNKNOWN"):
        assert getattr(state, f"MOTION_{name}") == getattr(messages, f"MOTION_{name}")


def test_a_state_keeps_every_field_on_its_way_out_and_back(jazzy: Ros) -> None:
    state = LiftState(Time(1, 2), "Lift 1", ("L1", "L2"), "L1", "L2", 2, 3, (1, 2), 5, "fleet/robot1")
    message = jazzy.messages.message_of(state)
    assert (message.lift_time.sec, message.lift_time.nanosec) == (1, 2)
    assert message.available_floors == ["L1", "L2"]
    assert message.available_modes == array.array("B", [1, 2])
    assert (message.lift_name, message.current_floor, message.destination_floor) == ("Lift 1", "L1", "L2")
    assert (message.door_state, message.motion_state, message.current_mode) == (2, 3, 5)
    assert message.session_id == "fleet/robot1"
    assert jazzy.messages.state_of(message) == state


def test_a_request_keeps_every_field_on_its_way_in(jazzy: Ros) -> None:
    message = jazzy.request(session_id="f/r", request_type=2, destination_floor="L9", door_state=0)
    message.request_time.sec, message.request_time.nanosec = 3, 4
    assert jazzy.messages.request_of(message) == LiftRequest("Lift 1", Time(3, 4), "f/r", 2, "L9", 0)


def test_a_request_of_rmf_reaches_the_manager_and_its_answer_rmf(ros: Ros) -> None:
    ros.start()
    reader, supervisor = ros.reader(), ros.writer()
    ros.hear(lift())
    ros.spin(6.0)  # what comes just after a new writer may be a replay
    supervisor.publish(ros.request())
    ros.spin(0.01)
    assert ros.manager.asked == [SessionDemand("east", "fleet/robot1", "first", hold_door=True)]
    asked = ros.manager.asked[0]
    ros.shell.deliver(
        lambda: ros.shell.on_answer(Answer(asked, accepted=True, boot="boot", event=2), ros.world.monotonic())
    )
    ros.hear(lift(holder=held("fleet/robot1"), destination="first"), event=2)
    ros.spin(0.05)
    state = reader.got[-1]
    assert (state.lift_name, state.session_id, state.destination_floor) == ("Lift 1", "fleet/robot1", "L2")
    supervisor.publish(ros.request(request_type=0, destination_floor="", door_state=0))
    ros.spin(0.05)
    assert reader.got[-1].session_id == ""
    assert isinstance(ros.manager.asked[-1], EndOfSession)


@pytest.mark.parametrize(
    ("namespace", "domain", "said", "known_as"),
    [("/", 0, "", ""), ("/building1", 5, "", "5/building1"), ("/building1", 5, "test", "test")],
)
def test_the_node_is_known_to_the_manager_as_the_adapter_without_ros_is(
    jazzy: Ros, namespace: str, domain: int, said: str, known_as: str
) -> None:
    jazzy.world.namespace, jazzy.world.domain = namespace, domain
    jazzy.start(adapter_id=said)
    jazzy.hear(lift())
    jazzy.writer(f"{namespace.rstrip('/')}/lift_requests").publish(jazzy.request())
    jazzy.spin(6.0)
    assert [one.adapter for one in jazzy.manager.asked] == [known_as]


def test_an_end_of_a_fleet_that_its_supervisor_drops_reaches_the_manager(ros: Ros) -> None:
    ros.start()
    reader, fleet = ros.reader(), ros.writer("/adapter_lift_requests", "fleet")
    ros.hear(lift(holder=held("fleet/robot1")))
    fleet.publish(ros.request(request_type=0, destination_floor="", door_state=0))
    ros.spin(1.5)
    assert (reader.got[-1].session_id, ros.manager.asked) == ("fleet/robot1", [])
    ros.spin(1.0)
    assert reader.got[-1].session_id == ""
    assert [type(asked) for asked in ros.manager.asked] == [EndOfSession]


def test_each_lift_is_published_twice_a_second_and_not_in_answer_to_requests(jazzy: Ros) -> None:
    jazzy.start()
    reader, supervisor = jazzy.reader(), jazzy.writer()
    jazzy.hear(lift())
    jazzy.spin(0.9)
    reader.got.clear()
    for _ in range(40):
        supervisor.publish(jazzy.request(session_id="", request_type=0))
        jazzy.spin(0.25)
    assert len(reader.got) == 20


@pytest.mark.parametrize(
    "values",
    [{"lift_name": "x" * 1_000_000}, {"request_type": 255}, {"door_state": 1}, {"destination_floor": "\ufffd"}],
)
def test_a_request_that_makes_no_sense_asks_nothing(jazzy: Ros, values: dict[str, object]) -> None:
    jazzy.start()
    jazzy.hear(lift())
    jazzy.writer().publish(jazzy.request(**values))
    jazzy.spin(6.0)
    assert jazzy.manager.asked == []


def test_topics_are_under_the_namespace_and_the_names_that_ros_gives_them(ros: Ros) -> None:
    ros.world.namespace = "/building1"
    ros.world.remaps["/building1/states"] = "/sim/lift_states"
    ros.start(states_topic="states", requests_topic="calls", adapter_requests_topic="fleets")
    assert {topic for topic, place in ros.world.topics.items() if place.writers} == {"/sim/lift_states"}
    read = {topic for topic, place in ros.world.topics.items() if place.readers}
    assert read == {"/building1/calls", "/building1/fleets"}
    ros.hear(lift(), FIRE)
    assert "/building1/fire_alarm_trigger" in ros.world.topics
    ros.spin(3.0)  # who else is there is asked of the same names


def test_the_time_of_a_state_is_the_wall_clock_less_the_age_of_the_data(ros: Ros) -> None:
    ros.start()
    reader = ros.reader()
    ros.hear(lift(age_s=0.5))
    ros.spin(0.6)
    state = reader.got[-1]
    assert ros.world.system_ns * 1e-9 - state.lift_time.sec - state.lift_time.nanosec * 1e-9 == pytest.approx(
        1.1, abs=0.51
    )


def test_the_time_of_a_state_is_that_of_the_simulation(ros: Ros) -> None:
    ros.start(use_sim_time=True)
    reader = ros.reader()
    ros.world.sim_ns = 77_000_000_000
    ros.hear(lift(age_s=2.0))
    assert (reader.got[-1].lift_time.sec, reader.got[-1].lift_time.nanosec) == (75, 0)


def test_a_simulation_that_stands_still_stops_no_publishing(ros: Ros) -> None:
    ros.start(use_sim_time=True)
    reader = ros.reader()
    ros.hear(lift())
    reader.got.clear()
    ros.spin(10.0)
    assert len(reader.got) == 20
    assert {(state.lift_time.sec, state.lift_time.nanosec) for state in reader.got} == {(0, 0)}


def test_without_clock_one_warning_comes_after_five_seconds(jazzy: Ros, caplog: pytest.LogCaptureFixture) -> None:
    jazzy.start(use_sim_time=True)
    jazzy.spin(4.9)
    assert not caplog.records
    jazzy.spin(60.0)
    assert [(record.levelname, "/clock" in record.getMessage()) for record in caplog.records] == [("WARNING", True)]


@pytest.mark.parametrize("use_sim_time", [True, False])
def test_no_warning_comes_where_there_is_a_clock(
    jazzy: Ros, caplog: pytest.LogCaptureFixture, use_sim_time: bool
) -> None:
    jazzy.start(use_sim_time=use_sim_time)
    jazzy.world.sim_ns = 1 if use_sim_time else 0
    jazzy.spin(60.0)
    assert not caplog.records


def test_ages_are_not_counted_with_the_steady_clock_of_ros(jazzy: Ros) -> None:
    """The two differ by 100 s here; an age that mixes them would make a fresh state stale, or a stale one fresh."""
    jazzy.start()
    reader = jazzy.reader()
    jazzy.hear(lift(max_age_s=2.0))
    jazzy.spin(1.0)
    assert reader.got[-1].door_state == messages.DOOR_OPEN
    jazzy.spin(2.0)
    assert (reader.got[-1].door_state, reader.got[-1].current_mode) == (messages.DOOR_MOVING, messages.MODE_OFFLINE)


def test_what_other_threads_hand_over_is_done_in_the_thread_of_the_executor_in_order(jazzy: Ros) -> None:
    jazzy.start()
    done: list[tuple[int, int]] = []
    before = jazzy.world.steady()

    def hand_over() -> None:
        for number in range(100):
            jazzy.shell.deliver(lambda number=number: done.append((number, threading.get_ident())))

    thread = threading.Thread(target=hand_over)
    thread.start()
    thread.join()
    assert done == []
    while not done:
        jazzy.executor.spin_once()
    assert done == [(number, threading.get_ident()) for number in range(100)]
    # the guard condition woke it, not the timer
    assert jazzy.world.steady() - before < 0.01e9


def test_without_a_lift_too_the_executor_is_woken_four_times_a_second(jazzy: Ros) -> None:
    """A signal wakes no executor: this is how soon it is noticed."""
    jazzy.start()
    for _ in range(20):
        before = jazzy.world.steady()
        jazzy.executor.spin_once()
        assert jazzy.world.steady() - before <= 0.25e9


def test_more_than_fits_into_the_queue_ends_the_node(jazzy: Ros) -> None:
    jazzy.start()
    for _ in range(10_001):
        jazzy.shell.deliver(lambda: None)
    with pytest.raises(jazzy.ros_node.Overrun, match="10000"):
        jazzy.spin(1.0)


def test_a_bug_is_not_caught(jazzy: Ros) -> None:
    jazzy.start()

    def fail() -> None:
        raise ZeroDivisionError

    jazzy.shell.deliver(fail)
    with pytest.raises(ZeroDivisionError):
        jazzy.spin(1.0)


def test_of_what_a_new_writer_replays_only_the_last_floor_is_asked(ros: Ros) -> None:
    ros.start()
    ros.hear(lift())
    ros.spin(30.0)
    supervisor = ros.writer()
    for floor in ("L2", "L1", "L2", "L1"):
        supervisor.publish(ros.request(destination_floor=floor))
    ros.spin(2.0)
    assert [asked.floor for asked in ros.manager.asked if isinstance(asked, SessionDemand)] == ["ground"]


def test_a_writer_that_went_and_came_again_is_a_new_one(ros: Ros) -> None:
    ros.start()
    ros.hear(lift())
    first = ros.writer()
    ros.spin(30.0)
    ros.world.remove_writer(first)
    second = ros.writer()
    for floor in ("L2", "L1"):
        second.publish(ros.request(destination_floor=floor))
    ros.spin(2.0)
    assert [asked.floor for asked in ros.manager.asked if isinstance(asked, SessionDemand)] == ["ground"]


def test_a_writer_that_goes_is_no_new_one(ros: Ros) -> None:
    ros.start()
    ros.hear(lift())
    stays, goes = ros.writer(), ros.writer(node="other")
    ros.spin(30.0)
    ros.world.remove_writer(goes)
    ros.spin(1.5)
    stays.publish(ros.request())
    ros.spin(0.01)
    assert len(ros.manager.asked) == 1


def test_a_middleware_without_the_event_is_asked_who_writes(ros: Ros) -> None:
    ros.world.supports_matched = False
    ros.start()
    ros.hear(lift())
    ros.spin(30.0)
    supervisor = ros.writer()
    for floor in ("L2", "L1"):
        supervisor.publish(ros.request(destination_floor=floor))
    ros.spin(2.0)
    assert [asked.floor for asked in ros.manager.asked if isinstance(asked, SessionDemand)] == ["ground"]


def test_the_end_before_a_burst_of_other_requests_is_not_lost(ros: Ros) -> None:
    """Iron and jazzy send one request of each waiting robot for each state of any lift."""
    ros.start()
    ros.hear(lift(holder=held("fleet/robot1")))
    supervisor = ros.writer()
    ros.spin(6.0)
    looks, ticks = ros.world.looks, ros.node.timers[0].resets
    supervisor.publish(ros.request(request_type=0, destination_floor="", door_state=0))
    for _ in range(500):
        supervisor.publish(ros.request(session_id="fleet/robot2"))
    ros.spin(0.005)
    assert ros.manager.asked == [EndOfSession("east", "fleet/robot1", 3.0)]
    assert ros.world.looks - looks <= 3
    assert ros.node.timers[0].resets - ticks <= 8, "one look at the lifts for all of them"


def test_the_event_is_used_wherever_it_is_there(ros: Ros) -> None:
    ros.start()
    with_event = {one.topic_name for one in ros.node.subscriptions if one.matched}
    assert with_event == ({"/lift_requests"} if ros.world.distro in WITH_EVENT else set())


def test_another_program_that_publishes_the_same_lift_is_told_once(ros: Ros, caplog: pytest.LogCaptureFixture) -> None:
    ros.start()
    ros.hear(lift())
    ros.spin(3.0)
    assert not ros.world.topics["/lift_states"].readers
    rival = ros.writer("/lift_states", node="lift_adapter")
    ros.spin(1.5)
    assert [reader.offer.lifespan_s for reader in ros.world.topics["/lift_states"].readers] == [None]
    for _ in range(5):
        rival.publish(ros.lift_msgs.LiftState(lift_name="Lift 1"))
        ros.spin(1.0)
    warnings = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(warnings) == 1
    assert "another program publishes the state of Lift 1" in warnings[0]
    ros.world.remove_writer(rival)
    ros.spin(1.5)
    assert not ros.world.topics["/lift_states"].readers


def test_an_adapter_of_other_lifts_is_no_rival(ros: Ros, caplog: pytest.LogCaptureFixture) -> None:
    ros.start()
    ros.hear(lift())
    other = ros.writer("/lift_states", node="other_adapter")
    for _ in range(20):
        other.publish(ros.lift_msgs.LiftState(lift_name="Lift 7"))
        ros.spin(0.5)
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_nothing_is_said_of_a_fire_where_the_site_does_not_want_it(ros: Ros) -> None:
    ros.start()
    ros.hear(lift(fire_latched=True, mode="fire"))
    ros.spin(5.0)
    assert not {"/fire_alarm_trigger", "/emergency_signal"} & set(ros.world.topics)


def test_a_fire_is_told_while_it_lasts_to_who_is_there_and_to_who_comes_later(ros: Ros) -> None:
    ros.start()
    ros.hear(lift(), FIRE)
    place = ros.world.topics["/fire_alarm_trigger"]
    assert [writer.offer for writer in place.writers] == [ros.offer(1, transient_local=True)]
    early = ros.reader("/fire_alarm_trigger")
    ros.spin(1.5)
    assert not early.got
    ros.hear(lift(fire_latched=True), FIRE, event=2)
    assert [message.data for message in early.got] == [True]
    late, keeps = ros.reader("/fire_alarm_trigger"), ros.reader("/fire_alarm_trigger", transient_local=True)
    assert [message.data for message in keeps.got] == [True]
    ros.spin(2.5)
    assert {message.data for message in (*early.got, *late.got, *keeps.got)} == {True}
    assert late.got


@pytest.mark.parametrize("values", [{"fire_latched": True}, {"mode": "fire"}])
def test_a_fire_from_before_the_start_is_told_to_readers_that_get_no_history(
    ros: Ros, values: dict[str, object]
) -> None:
    ros.start()
    ros.hear(lift(**values), FIRE)
    ros.hear(lift(**values), FIRE, event=2)
    reader = ros.reader("/fire_alarm_trigger")
    ros.spin(3.5)
    assert [message.data for message in reader.got] == [True]


@pytest.mark.parametrize("clear", [True, False])
def test_the_end_of_a_fire_is_told_once_or_not_at_all(jazzy: Ros, clear: bool) -> None:
    alarms = Alarms(fire_alarm=True, clear_on_acknowledge=clear)
    jazzy.start()
    reader = jazzy.reader("/fire_alarm_trigger")
    jazzy.hear(lift(fire_latched=True), alarms)
    jazzy.hear(lift(), alarms, event=2)
    late = jazzy.reader("/fire_alarm_trigger")
    jazzy.spin(10.0)
    assert [message.data for message in reader.got] == ([True, False] if clear else [True])
    assert not late.got


@pytest.mark.parametrize("clear", [True, False])
def test_a_fire_that_is_over_is_no_history_for_who_comes_later(jazzy: Ros, clear: bool) -> None:
    alarms = Alarms(fire_alarm=True, clear_on_acknowledge=clear)
    jazzy.start()
    jazzy.hear(lift(fire_latched=True), alarms)
    jazzy.hear(lift(), alarms, event=2)
    jazzy.spin(2.5)
    late = jazzy.reader("/fire_alarm_trigger", transient_local=True)
    jazzy.spin(5.0)
    assert not late.got
    jazzy.hear(lift(mode="fire"), alarms, event=3)
    assert [message.data for message in late.got] == [True]


def test_what_was_said_last_of_a_fire_has_a_second_to_arrive(jazzy: Ros) -> None:
    alarms = Alarms(fire_alarm=True, clear_on_acknowledge=True)
    jazzy.start()
    jazzy.hear(lift(fire_latched=True), alarms)
    (writer,) = jazzy.world.topics["/fire_alarm_trigger"].writers
    jazzy.hear(lift(), alarms, event=2)
    jazzy.spin(1.0)
    assert jazzy.world.topics["/fire_alarm_trigger"].writers == [writer]


def test_the_emergency_signal_names_its_fleets_where_the_distribution_has_it(
    ros: Ros, caplog: pytest.LogCaptureFixture
) -> None:
    alarms = Alarms(fire_alarm=True, emergency_signal=True, emergency_fleets=("tinyRobot", "deliveryRobot"))
    ros.start()
    fire = ros.reader("/fire_alarm_trigger")
    ros.hear(lift(), alarms)
    ros.hear(lift(fire_latched=True), alarms, event=2)
    assert [message.data for message in fire.got] == [True]
    errors = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
    if ros.world.distro in ("kilted", "rolling"):
        (writer,) = ros.world.topics["/emergency_signal"].writers
        assert writer.offer == ros.offer(1, transient_local=True)
        (message,) = writer.kept
        assert (message.fleet_names, message.is_emergency) == (["tinyRobot", "deliveryRobot"], True)
        assert errors == []
    else:
        assert "/emergency_signal" not in ros.world.topics
        assert len(errors) == 1
        assert "kilted" in errors[0]


def test_at_the_end_every_lift_is_published_as_offline(jazzy: Ros) -> None:
    jazzy.start()
    reader = jazzy.reader()
    jazzy.hear(lift(holder=held("fleet/robot1")))
    jazzy.shell.stop()
    last = reader.got[-1]
    assert (last.door_state, last.current_mode, last.session_id) == (
        messages.DOOR_MOVING,
        messages.MODE_OFFLINE,
        "fleet/robot1",
    )


def test_log_records_reach_ros_with_their_level_and_their_traceback(jazzy: Ros) -> None:
    jazzy.start()
    handler = jazzy.ros_node.RosLog(jazzy.node)
    for level in (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL) * 2:
        handler.handle(logging.LogRecord("any", level, "", 0, "at %d", (level,), None))
    error = ZeroDivisionError("here")
    handler.handle(
        logging.LogRecord("any", logging.ERROR, "", 0, "failed", (), (ZeroDivisionError, error, error.__traceback__))
    )
    assert [level for level, _ in jazzy.world.log[:10]] == ["debug", "info", "warning", "error", "fatal"] * 2
    assert jazzy.world.log[0] == ("debug", "at 10")
    assert "ZeroDivisionError: here" in jazzy.world.log[-1][1]


def test_the_key_comes_from_the_environment_and_is_no_parameter(jazzy: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIFT_MANAGER_KEY", "secret-of-environment\n")
    jazzy.start()
    server = jazzy.ros_node.server_of(jazzy.node)
    assert str(server.address) == "http://localhost:5003"
    assert server.headers() == {"Authorization": "Bearer secret-of-environment"}
    assert "secret" not in str(vars(jazzy.node))


def test_parameters_say_where_the_manager_is(jazzy: Ros, tmp_path: Path) -> None:
    (tmp_path / "key").write_text("secret-of-file\n")
    jazzy.start(manager_address="10.0.0.7", manager_port=8080, manager_key_file=str(tmp_path / "key"))
    server = jazzy.ros_node.server_of(jazzy.node)
    assert str(server.address) == "http://10.0.0.7:8080"
    assert server.headers() == {"Authorization": "Bearer secret-of-file"}


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"manager_key_file": "/nowhere/key"}, "manager_key_file: /nowhere/key"),
        ({"manager_port": 70_000}, "port 70000"),
        ({"manager_address": "ftp://x"}, "ftp://x"),
    ],
)
def test_parameters_that_cannot_be_used_are_named(jazzy: Ros, parameters: dict[str, object], said: str) -> None:
    jazzy.start(**parameters)
    with pytest.raises(BadAddress, match=said):
        jazzy.ros_node.server_of(jazzy.node)


def test_only_the_node_imports_rclpy_and_only_modules_of_ros_its_messages() -> None:
    folders = ("lift_manager", "drivers", "register_maps", "simulator")
    paths = [path for folder in folders for path in (HOME / folder).rglob("*.py")]
    mention = [path for path in paths if any(name in path.read_text() for name in ROS_PACKAGES)]
    found = {path.name: _imported(ast.parse(path.read_text())) & ROS_PACKAGES for path in mention}
    assert {name: packages for name, packages in found.items() if packages} == {
        "ros_node.py": {"rclpy", "rmf_lift_msgs"},
        "ros_messages.py": {"rmf_lift_msgs"},
        "ros_alarms.py": {"rmf_fleet_msgs", "std_msgs"},
    }


def _imported(tree: ast.Module) -> set[str]:
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
    return {name.split(".")[0] for name in names}
