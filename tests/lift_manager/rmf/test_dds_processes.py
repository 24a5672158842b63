"""The adapter and others of RMF as separate programs: they find each other, lose each other, and find again."""

import os
import signal

import pytest
from cyclonedds.qos import Policy, Qos

from lift_manager.plain.rmf import Alarms
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.dds_link import DdsLink
from lift_manager.rmf.dds_types import WireLiftState, wire_state
from lift_manager.rmf.messages import END_SESSION, LiftState
from lift_manager.rmf.ros_settings import RosSettings
from tests.support.dds_oracle import BOOL
from tests.support.dds_partner import Offer, Process, process
from tests.support.dds_rig import ORACLE, adapter, config, padded, request, settings_of_test, state

REQUESTS, STATES, FIRE = "rt/lift_requests", "rt/lift_states", "rt/fire_alarm_trigger"
FLEETS = "rt/adapter_lift_requests"
LOCALHOST_OF_ROS = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>'
)
"""What rmw_cyclonedds makes of ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, on iron and later."""


@pytest.fixture
def settings() -> RosSettings:
    return settings_of_test()


def tell(supervisor: Process, dds: Dds, lift: LiftState) -> None:
    supervisor.hears(STATES, padded(ORACLE.state(lift)), lambda: dds.publish(lift))


def test_a_ros_node_on_this_machine_is_found_and_heard_and_hears(settings: RosSettings) -> None:
    theirs = f"{LOCALHOST_OF_ROS},{settings.cyclonedds_uri}"
    with adapter(settings) as (dds, heard), process(settings.domain, theirs) as supervisor:
        supervisor.hear(STATES, "state", Offer())
        supervisor.offer(REQUESTS, "request", Offer(transient=True))
        burst = [request(f"lift{n}") for n in range(50)]
        long = request(session="x" * 1_000_000)
        supervisor.write(REQUESTS, *map(ORACLE.request, [*burst, long]))
        assert heard.wait_for("requested", 51) == [*burst, long]
        tell(supervisor, dds, state("found"))
        lifts = [state(f"lift{n}") for n in range(50)]
        for one in lifts:
            dds.publish(one)
        for one in lifts:
            supervisor.heard(STATES, padded(ORACLE.state(one)))


def test_a_supervisor_that_starts_again_is_noticed_and_heard(settings: RosSettings) -> None:
    with adapter(settings) as (dds, heard):
        for turn in (1, 2):
            with process(settings.domain, config(settings)) as supervisor:
                supervisor.hear(STATES, "state", Offer())
                supervisor.offer(REQUESTS, "request", Offer(transient=True))
                supervisor.write(REQUESTS, ORACLE.request(request(floor=f"turn{turn}")))
                heard.wait_for("requested", turn)
                tell(supervisor, dds, state(floor=f"turn{turn}"))
        assert [what for what, _ in heard.events] == ["matched", "requested", "matched", "requested"]


def test_an_adapter_that_starts_again_is_found_and_hears_nothing_of_before(settings: RosSettings) -> None:
    with process(settings.domain, config(settings)) as supervisor:
        supervisor.hear(STATES, "state", Offer())
        supervisor.hear(FIRE, "alarm", Offer(transient=True))
        supervisor.offer(REQUESTS, "request", Offer(transient=True), readers=0)
        supervisor.write(REQUESTS, *(ORACLE.request(request(floor=f"old{n}")) for n in range(30)))
        supervisor.has_written(REQUESTS, 30)
        for turn in (1, 2):
            # in a process of its own: readers of one process share what the first of them asks a writer for
            with adapter(settings) as (dds, heard), process(settings.domain, config(settings)) as history:
                heard.wait_for("matched")
                history.hear(REQUESTS, "request", Offer(transient=True))
                history.heard(REQUESTS, padded(ORACLE.request(request(floor="old29"))))
                supervisor.write(REQUESTS, ORACLE.request(request(floor=f"turn{turn}")))
                assert heard.wait_for("requested") == [request(floor=f"turn{turn}")]
                tell(supervisor, dds, state(floor=f"first words {turn}"))
                dds.alarm.publish_alarms(Alarms(fire_alarm=True), on=turn == 1)
                dds.publish(state(floor=f"last words {turn}"))
            supervisor.heard(STATES, padded(ORACLE.state(state(floor=f"last words {turn}"))))
            supervisor.heard(FIRE, padded(ORACLE.encoded(BOOL, turn == 1)))


def test_no_old_end_of_a_fleet_reaches_an_adapter_that_starts(settings: RosSettings) -> None:
    with process(settings.domain, config(settings)) as fleet:
        fleet.offer(FLEETS, "request", Offer(transient=True), readers=0)
        fleet.write(FLEETS, ORACLE.request(request("old", kind=END_SESSION)))
        fleet.has_written(FLEETS, 1)
        # in a process of its own: readers of one process share what the first of them asks a writer for
        with adapter(settings) as (_, heard), process(settings.domain, config(settings)) as history:
            history.hear(FLEETS, "request", Offer(transient=True))
            history.heard(FLEETS, padded(ORACLE.request(request("old", kind=END_SESSION))))
            fleet.says(lambda said: said.get("read_by", 0) >= 2)
            fleet.write(FLEETS, ORACLE.request(request("new", kind=END_SESSION)))
            assert heard.wait_for("fleet requested") == [request("new", kind=END_SESSION)]


def test_a_subscriber_that_stands_still_holds_up_nobody(
    settings: RosSettings, caplog: pytest.LogCaptureFixture
) -> None:
    failures: list[Exception] = []
    large = wire_state(state(floors=tuple(f"floor {n}" * 20 for n in range(60))))
    keeps_all = Qos(Policy.History.KeepAll, Policy.Reliability.Reliable(0), Policy.DataRepresentation(True, False))
    link = DdsLink(settings, failures.append)
    link.open_writer("lift_states", WireLiftState, keeps_all)
    link.start()
    with process(settings.domain, config(settings)) as supervisor:
        supervisor.hear(STATES, "state", Offer())
        hello = padded(ORACLE.state(state()))
        supervisor.hears(STATES, hello, lambda: link.write("lift_states", wire_state(state())))
        os.kill(supervisor.process.pid, signal.SIGSTOP)
        for _ in range(300):
            link.write("lift_states", large)
    link.close()
    assert failures == []
    assert [record.getMessage() for record in caplog.records] == [
        "lift_states: the network is too slow for it: some messages are skipped"
    ]
