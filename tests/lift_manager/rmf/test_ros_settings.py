"""What ROS 2's environment variables mean, and what Cyclone DDS is told because of them."""

import re
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from lift_manager.lift.rmf_view import ADAPTER_ID, ADAPTER_ID_LIMIT
from lift_manager.rmf.dds_config import config_of
from lift_manager.rmf.ros_settings import BadSettings, RosSettings
from tests.support.rows import each_row


def test_without_anything_it_is_domain_0_on_the_whole_subnet() -> None:
    assert RosSettings.of({}) == RosSettings(domain=0, discovery_range="SUBNET", peers=())


def test_the_variables_of_ros_are_read() -> None:
    environment = {
        "ROS_DOMAIN_ID": "42",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_STATIC_PEERS": "192.168.1.20;;robots.local ",
        "CYCLONEDDS_URI": "file:///etc/cyclonedds.xml",
    }
    assert RosSettings.of(environment) == RosSettings(
        domain=42,
        discovery_range="LOCALHOST",
        peers=("192.168.1.20", "robots.local"),
        cyclonedds_uri="file:///etc/cyclonedds.xml",
    )


def test_localhost_only_counts_before_range_and_peers() -> None:
    environment = {
        "ROS_LOCALHOST_ONLY": "1",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_STATIC_PEERS": "192.168.1.20",
    }
    assert RosSettings.of(environment) == RosSettings(discovery_range="LOCALHOST", peers=())


@pytest.mark.parametrize("said", ["", "0", "yes"])
def test_only_a_1_means_localhost_only(said: str) -> None:
    assert RosSettings.of({"ROS_LOCALHOST_ONLY": said}).discovery_range == "SUBNET"


@each_row(
    ("environment", "message"),
    [
        ({"ROS_DOMAIN_ID": "two"}, "ROS_DOMAIN_ID is 'two'; it is a whole number from 0 to 232"),
        ({"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID is '233'; it is a whole number from 0 to 232"),
        ({"ROS_DOMAIN_ID": "-1"}, "ROS_DOMAIN_ID is '-1'; it is a whole number from 0 to 232"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "subnet"},
            "ROS_AUTOMATIC_DISCOVERY_RANGE is 'subnet'; it is one of SUBNET, LOCALHOST, OFF, SYSTEM_DEFAULT, in capitals",
        ),
        (
            {"ROS_STATIC_PEERS": 'x"/><Peer address="y'},
            """the peer 'x"/><Peer address="y' is no address; it is like 192.168.1.20 or like robots.local""",
        ),
    ],
)
def test_a_value_that_cannot_be_used_is_refused_with_what_it_may_be(environment: dict[str, str], message: str) -> None:
    with pytest.raises(BadSettings) as caught:
        RosSettings.of(environment)
    assert str(caught.value) == message


@pytest.mark.parametrize("domain", [-1, 233])
def test_a_domain_without_ports_is_refused(domain: int) -> None:
    with pytest.raises(BadSettings, match=f"the domain is {domain}; it is a whole number from 0 to 232"):
        RosSettings(domain=domain)


def test_a_range_that_ros_does_not_have_is_refused() -> None:
    with pytest.raises(BadSettings, match="the discovery range is 'WORLD'; it is one of SUBNET"):
        RosSettings(discovery_range="WORLD")


@each_row("topic", ["", "lift states", "lift//states", "1st_floor", "lift-states", "~/lift_states", "lift/"])
def test_a_topic_that_ros_cannot_have_is_refused(topic: str) -> None:
    with pytest.raises(BadSettings, match="the topic is"):
        RosSettings(states_topic=topic)


def test_two_messages_on_one_topic_are_refused() -> None:
    with pytest.raises(BadSettings, match="two of the topics are 'b1/lifts'; each message has a topic of its own"):
        RosSettings(namespace="b1", states_topic="lifts", requests_topic="/b1/lifts")


@pytest.mark.parametrize("namespace", ["building 1", "//building1", "1"])
def test_a_namespace_that_ros_cannot_have_is_refused(namespace: str) -> None:
    with pytest.raises(BadSettings, match="the namespace is"):
        RosSettings(namespace=namespace)


@each_row(
    ("namespace", "topic", "found"),
    [
        ("", "lift_states", "lift_states"),
        ("/", "lift_states", "lift_states"),
        ("/building1", "lift_states", "building1/lift_states"),
        ("building1/", "sim/lift_states", "building1/sim/lift_states"),
        ("/building1", "/lift_states", "lift_states"),
    ],
)
def test_the_namespace_stands_before_a_relative_topic(namespace: str, topic: str, found: str) -> None:
    settings = RosSettings(namespace=namespace, states_topic=topic)
    assert settings.resolved(settings.states_topic) == found


def told(settings: RosSettings) -> tuple[list[str], str | None, list[str], str | None, str | None]:
    """Return interfaces, multicast, peers, participant index and tag."""
    domain = ET.fromstring(config_of(settings, 4711)).find("Domain")
    assert domain is not None
    return (
        [one.attrib["address"] for one in domain.findall("General/Interfaces/NetworkInterface")],
        domain.findtext("General/AllowMulticast"),
        [one.attrib["address"] for one in domain.findall("Discovery/Peers/Peer")],
        domain.findtext("Discovery/ParticipantIndex"),
        domain.findtext("Discovery/Tag"),
    )


def test_localhost_keeps_to_the_loopback_interface() -> None:
    assert told(RosSettings(discovery_range="LOCALHOST")) == (["127.0.0.1"], "false", ["127.0.0.1"], "auto", None)


def test_localhost_with_peers_leaves_the_machine_for_them_only() -> None:
    settings = RosSettings(discovery_range="LOCALHOST", peers=("192.168.1.20",))
    assert told(settings) == ([], "false", ["127.0.0.1", "192.168.1.20"], "auto", None)


def test_subnet_looks_everywhere_and_at_the_peers() -> None:
    assert told(RosSettings()) == ([], None, [], "auto", None)
    assert told(RosSettings(peers=("192.168.1.20", "[fd00::2]:7410"))) == (
        [],
        None,
        ["192.168.1.20", "[fd00::2]:7410"],
        "auto",
        None,
    )


@pytest.mark.parametrize("discovery_range", ["SUBNET", "LOCALHOST"])
def test_peers_are_looked_for_for_ever_and_every_two_seconds(discovery_range: str) -> None:
    domain = ET.fromstring(config_of(RosSettings(discovery_range=discovery_range), 1))
    assert domain.findtext("Domain/Discovery/InitialLocatorPruneDelay") == "inf"
    assert domain.findtext("Domain/Discovery/SPDPInterval") == "2 s"


def test_off_finds_nobody_not_even_peers() -> None:
    settings = RosSettings(discovery_range="OFF", peers=("192.168.1.20",))
    assert told(settings) == ([], "false", [], "none", "ros_discovery_off_4711")


def test_system_default_says_nothing_of_its_own() -> None:
    assert config_of(RosSettings(discovery_range="SYSTEM_DEFAULT", peers=("192.168.1.20",)), 1) == ""
    assert (
        config_of(RosSettings(discovery_range="SYSTEM_DEFAULT", cyclonedds_uri="file:///x.xml"), 1) == "file:///x.xml"
    )


def test_the_users_own_configuration_comes_last() -> None:
    own = config_of(RosSettings(cyclonedds_uri="file:///x.xml"), 1)
    assert own == config_of(RosSettings(), 1) + ",file:///x.xml"


@each_row(
    ("given", "known_as"),
    [
        ({}, ""),
        ({"domain": 5}, "5"),
        ({"namespace": "/building1/"}, "building1"),
        ({"domain": 5, "namespace": "building1"}, "5/building1"),
        ({"requests_topic": "/b2/lift_requests", "namespace": "b1"}, "b2"),
        ({"requests_topic": "calls"}, "calls"),
        ({"domain": 5, "adapter_id": "test"}, "test"),
    ],
)
def test_an_adapter_is_known_to_the_manager_by_domain_and_namespace_where_nothing_is_said(
    given: dict[str, Any], known_as: str
) -> None:
    assert RosSettings(**given).adapter == known_as


@each_row("text", ["a@b", "a b", "\u00e4", "a\n", "x" * 301])
def test_an_id_that_the_manager_does_not_take_is_refused(text: str) -> None:
    with pytest.raises(BadSettings, match="the adapter's id is"):
        RosSettings(adapter_id=text)
    assert re.fullmatch(ADAPTER_ID, text) is None or len(text) > ADAPTER_ID_LIMIT
