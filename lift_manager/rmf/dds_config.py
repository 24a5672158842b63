"""The configuration of Cyclone DDS for the same discovery as ROS 2 with the same settings.

Follows rmw_cyclonedds (`rmw_node.cpp`, iron and later); differences are explained.
"""

from __future__ import annotations

from lift_manager.rmf.ros_settings import RosSettings

_MOST_PARTICIPANTS = 32
"""Programs of one domain on one machine that find each other without multicast; rmw_cyclonedds has the same number."""

_LINGER_MS = 200
"""How long leaving waits until all readers have the last messages. Chosen: Cyclone's own value is a second, in which the
manager around it would do nothing else."""

_PATIENCE = "<SPDPInterval>2 s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
"""Search for peers every 2 s (chosen; Cyclone's own value is 8 s) and without end: 11.0.1 would give up after 30 s, and
never find a supervisor that starts later and has no peers itself."""
_INTERNAL = f"<Internal><WriterLingerDuration>{_LINGER_MS} ms</WriterLingerDuration></Internal>"


def config_of(settings: RosSettings, process: int) -> str:
    """Return the XML for a domain, followed by the user's own configuration, which takes precedence.

    `process` is the process id, which makes a unique tag for the range OFF.
    """
    own = "" if settings.discovery_range == "SYSTEM_DEFAULT" else _xml(settings, process)
    return ",".join(part for part in (own, settings.cyclonedds_uri) if part)


def _xml(settings: RosSettings, process: int) -> str:
    return f"<CycloneDDS><Domain>{_general(settings)}{_discovery(settings, process)}{_INTERNAL}</Domain></CycloneDDS>"


def _general(settings: RosSettings) -> str:
    """Restrict LOCALHOST without peers to the loopback interface, so that nobody on the network can call a lift."""
    if settings.discovery_range == "SUBNET":
        return ""
    only_loopback = settings.discovery_range == "LOCALHOST" and not settings.peers
    interfaces = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>' if only_loopback else ""
    return f"<General>{interfaces}<AllowMulticast>false</AllowMulticast></General>"


def _discovery(settings: RosSettings, process: int) -> str:
    if settings.discovery_range == "OFF":
        tag = f"<Tag>ros_discovery_off_{process}</Tag>"
        return f"<Discovery><ParticipantIndex>none</ParticipantIndex>{tag}</Discovery>"
    local = ("127.0.0.1",) if settings.discovery_range == "LOCALHOST" else ()
    # nothing in them needs quoting: RosSettings accepts addresses only
    peers = "".join(f'<Peer address="{peer}"/>' for peer in (*local, *settings.peers))
    return (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{_MOST_PARTICIPANTS}</MaxAutoParticipantIndex>"
        f"{_PATIENCE}{f'<Peers>{peers}</Peers>' if peers else ''}</Discovery>"
    )
