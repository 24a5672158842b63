"""Which publishers and subscribers of ROS 2 and the adapter find each other, and what of it arrives (open-rmf 1.3)."""

from collections.abc import Iterator

import pytest
from cyclonedds.qos import Policy
from cyclonedds.util import duration

from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.messages import END_SESSION
from lift_manager.rmf.ros_settings import RosSettings
from tests.support.dds_oracle import BOOL, EMERGENCY_SIGNAL
from tests.support.dds_partner import Offer, Partner
from tests.support.dds_rig import ORACLE, Heard, adapter, padded, request, settings_of_test, state

REQUESTS, STATES = "rt/lift_requests", "rt/lift_states"
FLEETS = "rt/adapter_lift_requests"
FIRE, EMERGENCY = "rt/fire_alarm_trigger", "rt/emergency_signal"
ON, OFF = padded(ORACLE.encoded(BOOL, True)), padded(ORACLE.encoded(BOOL, False))


@pytest.fixture
def settings() -> RosSettings:
    return settings_of_test()


@pytest.fixture
def joined(settings: RosSettings) -> Iterator[tuple[Dds, Heard, Partner]]:
    with adapter(settings) as (dds, heard):
        partner = Partner(settings.domain)
        yield dds, heard, partner
        partner.close()


@pytest.mark.parametrize(
    "offer",
    [
        pytest.param(Offer(transient=False, depth=1), id="humble's supervisor on Cyclone: volatile, depth 1"),
        pytest.param(Offer(transient=False, depth=10), id="the demo script: volatile, depth 10"),
        pytest.param(Offer(transient=True, depth=100), id="iron to main: transient local, depth 100"),
        pytest.param(Offer(transient=True, depth=1), id="humble's supervisor on Fast DDS: transient local, depth 1"),
    ],
)
def test_every_publisher_of_requests_is_heard(joined: tuple[Dds, Heard, Partner], offer: Offer) -> None:
    _, heard, partner = joined
    partner.offer(REQUESTS, "request", offer)
    partner.write(REQUESTS, ORACLE.request(request()))
    assert heard.wait_for("requested") == [request()]
    assert [what for what, _ in heard.events] == ["matched", "requested"]


@pytest.mark.parametrize(
    "offer",
    [
        pytest.param(Offer(transient=False, depth=100), id="humble's fleet adapter on Cyclone: volatile"),
        pytest.param(Offer(transient=True, depth=100), id="iron to main, and rmf-web: transient local"),
    ],
)
def test_every_fleet_adapter_is_heard(joined: tuple[Dds, Heard, Partner], offer: Offer) -> None:
    _, heard, partner = joined
    partner.offer(FLEETS, "request", offer)
    partner.write(FLEETS, ORACLE.request(request(kind=END_SESSION)), ORACLE.request(request()))
    assert heard.wait_for("fleet requested", 2) == [request(kind=END_SESSION), request()]
    assert {what for what, _ in heard.events} == {"fleet requested"}


def test_a_publisher_that_only_does_its_best_is_not_heard_and_the_log_says_why(
    joined: tuple[Dds, Heard, Partner], caplog: pytest.LogCaptureFixture
) -> None:
    _, heard, partner = joined
    partner.offer(REQUESTS, "request", Offer(reliable=False))
    partner.write(REQUESTS, ORACLE.request(request("unreliable")))
    partner.offer(REQUESTS, "request", Offer())
    partner.write(REQUESTS, ORACLE.request(request("reliable")))
    assert [one.lift_name for one in heard.wait_for("requested")] == ["reliable"]
    assert (
        "lift_requests: another program publishes it with an incompatible reliability, so it cannot be received"
        in caplog.text
    )


def test_a_burst_for_fifty_lifts_arrives_whole_and_in_order(joined: tuple[Dds, Heard, Partner]) -> None:
    _, heard, partner = joined
    partner.offer(REQUESTS, "request", Offer(depth=1))
    burst = [request(f"lift{n}") for n in range(50)]
    partner.write(REQUESTS, *map(ORACLE.request, burst))
    assert heard.wait_for("requested", 50) == burst


def test_the_last_request_of_somebody_who_left_at_once_is_heard(settings: RosSettings) -> None:
    with adapter(settings) as (_, heard):
        partner = Partner(settings.domain)
        partner.offer(REQUESTS, "request", Offer())
        partner.write(REQUESTS, ORACLE.request(request()))
        partner.close()
        assert heard.wait_for("requested") == [request()]


@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best effort"])
def test_every_volatile_subscriber_hears_states(joined: tuple[Dds, Heard, Partner], reliable: bool) -> None:
    dds, _, partner = joined
    ear = partner.hear(STATES, "state", Offer(reliable=reliable))
    dds.publish(state())
    assert ear.wait_for(bool) == [padded(ORACLE.state(state()))]


def test_the_states_of_fifty_lifts_are_heard_by_a_subscriber_with_depth_100(
    joined: tuple[Dds, Heard, Partner],
) -> None:
    dds, _, partner = joined
    ear = partner.hear(STATES, "state", Offer(depth=100))
    lifts = [state(f"lift{n}") for n in range(50)]
    for one in lifts:
        dds.publish(one)
    assert ear.wait_for(lambda samples: len(samples) == 50) == [padded(ORACLE.state(one)) for one in lifts]


def test_a_subscriber_that_joins_late_is_told_of_the_fire(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, _, partner = joined
    dds.alarm.publish_alarms(Alarms(fire_alarm=True, emergency_signal=True, emergency_fleets=("blue", "red")), on=True)
    fire = partner.hear(FIRE, "alarm", Offer(transient=True))
    emergency = partner.hear(EMERGENCY, "emergency", Offer(transient=True))
    assert fire.wait_for(bool) == [ON]
    signal = padded(ORACLE.encoded(EMERGENCY_SIGNAL, ["blue", "red"], True))
    assert emergency.wait_for(bool) == [signal]


def test_a_volatile_subscriber_hears_the_alarm_and_its_end(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, _, partner = joined
    ear = partner.hear(FIRE, "alarm", Offer())
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=True)
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=False)
    assert ear.wait_for(lambda samples: len(samples) == 2) == [ON, OFF]


def test_a_late_subscriber_hears_only_the_last_word_about_the_fire(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, _, partner = joined
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=True)
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=False)
    ear = partner.hear(FIRE, "alarm", Offer(transient=True))
    assert ear.wait_for(bool) == [OFF]


def test_a_volatile_subscriber_that_found_us_before_the_fire_hears_the_first_word(
    joined: tuple[Dds, Heard, Partner],
) -> None:
    dds, _, partner = joined
    dds.alarm.offer(Alarms(fire_alarm=True))
    ear = partner.hear(FIRE, "alarm", Offer())
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=True)
    assert ear.wait_for(bool) == [ON]


def test_a_fire_that_is_forgotten_is_no_history_for_who_joins_and_the_next_one_is_told(
    joined: tuple[Dds, Heard, Partner],
) -> None:
    dds, _, partner = joined
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=True)
    early = partner.hear(FIRE, "alarm", Offer(transient=True))
    assert early.wait_for(bool) == [ON]
    dds.alarm.forget()
    late = partner.hear(FIRE, "alarm", Offer(transient=True))
    dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=False)
    assert late.wait_for(bool) == [OFF]
    assert early.wait_for(lambda samples: len(samples) == 2) == [ON, OFF]


def test_what_a_site_does_not_want_is_not_even_offered(joined: tuple[Dds, Heard, Partner]) -> None:
    dds, _, partner = joined
    dds.alarm.publish_alarms(Alarms(), on=True)
    dds.alarm.publish_alarms(Alarms(emergency_signal=True), on=True)
    assert {end.topic_name for what, end in partner.endpoints() if what == "writer"} == {STATES, EMERGENCY}


LIFT, FLEET, STD, GRAPH = (
    f"{package}::msg::dds_::" for package in ("rmf_lift_msgs", "rmf_fleet_msgs", "std_msgs", "rosgraph_msgs")
)
ENDPOINTS = {
    ("writer", STATES): (f"{LIFT}LiftState_", "ce0553cd08eeeb321bdae554efdb6d2ebb2be9755df2e34895cbef55b51f4c06"),
    ("reader", STATES): (f"{LIFT}LiftState_", "ce0553cd08eeeb321bdae554efdb6d2ebb2be9755df2e34895cbef55b51f4c06"),
    ("reader", REQUESTS): (f"{LIFT}LiftRequest_", "e8f1e0aa4d172703d0d7840c1876448c6c5d75ab58955faf7de7dddc17c096ac"),
    ("reader", FLEETS): (f"{LIFT}LiftRequest_", "e8f1e0aa4d172703d0d7840c1876448c6c5d75ab58955faf7de7dddc17c096ac"),
    ("writer", FIRE): (f"{STD}Bool_", "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"),
    ("writer", EMERGENCY): (
        f"{FLEET}EmergencySignal_",
        "2bcead0701ac71c292f12ba705ad9164b796b2660ae48cbf74204515fe5156e0",
    ),
    ("reader", "rt/clock"): (f"{GRAPH}Clock_", "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
}


def test_everything_has_the_names_types_hashes_and_qos_of_ros() -> None:
    settings = settings_of_test(use_sim_time=True)
    with adapter(settings) as (dds, _):
        dds.alarm.publish_alarms(Alarms(fire_alarm=True, emergency_signal=True), on=True)
        partner = Partner(settings.domain)
        ends = {(what, end.topic_name): end for what, end in partner.endpoints() if end.topic_name.startswith("rt/")}
        partner.close()
    assert {key: (end.type_name, end.qos[Policy.Userdata].data) for key, end in ends.items()} == {
        key: (name, f"typehash=RIHS01_{digest};".encode()) for key, (name, digest) in ENDPOINTS.items()
    }
    assert {end.qos[Policy.DataRepresentation] for end in ends.values()} == {Policy.DataRepresentation(True, False)}
    writers = [end for (what, _), end in ends.items() if what == "writer"]
    assert {end.qos[Policy.WriterDataLifecycle].autodispose for end in writers} == {False}
    transient = {key for key, end in ends.items() if end.qos[Policy.Durability] == Policy.Durability.TransientLocal}
    assert transient == {("writer", FIRE), ("writer", EMERGENCY)}
    best_effort = {key for key, end in ends.items() if end.qos[Policy.Reliability] == Policy.Reliability.BestEffort}
    assert best_effort == {("reader", STATES), ("reader", "rt/clock")}
    depths = {key: end.qos[Policy.History].depth for key, end in ends.items()}
    assert depths[("reader", REQUESTS)] >= 100
    assert depths[("reader", FLEETS)] >= 100
    assert depths[("writer", STATES)] >= 100


def test_a_state_that_could_not_be_delivered_in_a_second_never_is(settings: RosSettings) -> None:
    """After a break of the network all of its states came at once, and one that says OPEN sends a robot in (open-rmf 1.5)."""
    with adapter(settings) as (dds, _):
        dds.alarm.publish_alarms(Alarms(fire_alarm=True, emergency_signal=True), on=True)
        partner = Partner(settings.domain)
        ends = [end for what, end in partner.endpoints() if what == "writer" and end.topic_name.startswith("rt/")]
        partner.close()
    assert {end.topic_name: end.qos[Policy.Lifespan].lifespan for end in ends} == {
        STATES: duration(seconds=1),
        FIRE: duration(infinite=True),
        EMERGENCY: duration(infinite=True),
    }
