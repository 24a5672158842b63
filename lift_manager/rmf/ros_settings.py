"""Settings for reaching RMF: domain, namespace, topics and discovery, named as in ROS 2. Standard library only."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

DEFAULT_DOMAIN = 0
HIGHEST_DOMAIN = 232
"""Higher domains have no discovery ports (7400 + 250 x domain; up to 101 is safe everywhere, open-rmf 5.4)."""
RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
"""ROS_AUTOMATIC_DISCOVERY_RANGE."""

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_PEER = re.compile(r"[A-Za-z0-9._:%\[\]-]+", re.ASCII)
"""An IPv4 or IPv6 address (with a zone, with a port) or a host name: what Cyclone DDS takes as a peer."""


_ID = re.compile(r"[A-Za-z0-9._/-]*", re.ASCII)
_ID_LIMIT = 300
"""As the manager accepts it (`lift.rmf.ADAPTER_ID_LIMIT`)."""


class BadSettings(ValueError):
    """A setting is invalid; the message names it, its value and what it may be."""


@dataclass(frozen=True)
class RosSettings:
    """How to reach RMF. Raises BadSettings for an invalid value."""

    domain: int = DEFAULT_DOMAIN
    namespace: str = ""
    """Put before the topics, such as `/building1`; empty for none. A topic that begins with `/` ignores it."""
    states_topic: str = "lift_states"
    requests_topic: str = "lift_requests"
    adapter_requests_topic: str = "adapter_lift_requests"
    """Requests of fleets to the lift supervisor, which decides whose turn it is (open-rmf 1.2). The adapter only uses their END_SESSION, if
    the supervisor does not pass it on."""
    fire_topic: str = "fire_alarm_trigger"
    emergency_topic: str = "emergency_signal"
    discovery_range: str = "SUBNET"
    peers: tuple[str, ...] = ()
    """Addresses at which to look for RMF without multicast. Not used with the ranges OFF and SYSTEM_DEFAULT, as in ROS."""
    cyclonedds_uri: str = ""
    """CYCLONEDDS_URI: XML, or the path of a file. It takes precedence, as in rmw_cyclonedds. Not for rclpy."""
    use_sim_time: bool = False
    adapter_id: str = ""
    """The adapter's id at the manager; derived from domain and namespace if empty."""

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= HIGHEST_DOMAIN:
            raise BadSettings(f"the domain is {self.domain}; it is a whole number from 0 to {HIGHEST_DOMAIN}")
        if self.discovery_range not in RANGES:
            raise BadSettings(f"the discovery range is {self.discovery_range!r}; it is one of {', '.join(RANGES)}")
        for peer in self.peers:
            if not _PEER.fullmatch(peer):
                raise BadSettings(f"the peer {peer!r} is no address; it is like 192.168.1.20 or like robots.local")
        if self.namespace.strip("/"):
            _check_name("the namespace", self.namespace.rstrip("/"))
        for topic in self._topics():
            _check_name("the topic", topic)
        check_adapter_id(self.adapter_id)
        found = [self.resolved(topic) for topic in self._topics()]
        if twice := next((topic for topic in found if found.count(topic) > 1), None):
            raise BadSettings(f"two of the topics are {twice!r}; each message has a topic of its own")

    def _topics(self) -> tuple[str, ...]:
        adapter = (self.states_topic, self.requests_topic, self.adapter_requests_topic)
        return (*adapter, self.fire_topic, self.emergency_topic)

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> RosSettings:
        """Read the environment variables of ROS 2 and CYCLONEDDS_URI. Raises BadSettings.

        ROS_LOCALHOST_ONLY=1 overrides ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS, as in ROS.
        """
        localhost_only = environment.get("ROS_LOCALHOST_ONLY", "") == "1"
        peers = "" if localhost_only else environment.get("ROS_STATIC_PEERS", "")
        return cls(
            domain=_domain(environment.get("ROS_DOMAIN_ID", "")),
            discovery_range="LOCALHOST" if localhost_only else _range(environment),
            peers=tuple(part.strip() for part in peers.split(";") if part.strip()),
            cyclonedds_uri=environment.get("CYCLONEDDS_URI", "").strip(),
        )

    @property
    def adapter(self) -> str:
        """The adapter's id at the manager, the same after each start."""
        return self.adapter_id or id_of_adapter(self.domain, self.resolved(self.requests_topic))

    def resolved(self, topic: str) -> str:
        """Return a topic with the namespace before it if it is relative, and without a leading slash."""
        if topic.startswith("/"):
            return topic.strip("/")
        return "/".join(part for part in (self.namespace.strip("/"), topic.strip("/")) if part)


def id_of_adapter(domain: int, requests_topic: str) -> str:
    """Derive the id of an adapter from domain and namespace, so that the adapters of two RMFs have different ids.

    Empty in domain 0 without a namespace, as before adapters had ids.
    """
    namespace, _, last = requests_topic.strip("/").rpartition("/")
    place = namespace if last == RosSettings.requests_topic else requests_topic.strip("/")
    return "/".join(part for part in (str(domain or ""), place) if part)


def check_adapter_id(text: str) -> None:
    """Raise BadSettings if the text is not an adapter id."""
    if len(text) > _ID_LIMIT or not _ID.fullmatch(text):
        raise BadSettings(
            f"the adapter's id is {text!r:.80}; it is made of letters, digits and . _ / -, at most {_ID_LIMIT} of them"
        )


def _check_name(what: str, name: str) -> None:
    if not _NAME.fullmatch(name):
        raise BadSettings(
            f"{what} is {name!r}; it is made of letters, digits and _, in parts with a / between them, "
            "and no part begins with a digit"
        )


def _domain(text: str) -> int:
    if not text.strip():
        return DEFAULT_DOMAIN
    if not text.strip().isdecimal() or int(text) > HIGHEST_DOMAIN:
        raise BadSettings(f"ROS_DOMAIN_ID is {text!r}; it is a whole number from 0 to {HIGHEST_DOMAIN}")
    return int(text)


def _range(environment: Mapping[str, str]) -> str:
    """Require capitals: ROS silently takes any other spelling for LOCALHOST."""
    value = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if value and value not in RANGES:
        raise BadSettings(f"ROS_AUTOMATIC_DISCOVERY_RANGE is {value!r}; it is one of {', '.join(RANGES)}, in capitals")
    return value or "SUBNET"
