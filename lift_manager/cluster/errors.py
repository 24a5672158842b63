"""Every error of a cluster.

ClusterError
    EtcdError               etcd did not do what was requested; the message names the members and the remedy
        EtcdUnavailable     no member has answered in time; whether the request was or will be carried out is unknown
        EtcdRefused         a member refused the request, which changed nothing
    ClusterUnusable         what etcd holds for this site cannot be used; the message gives the remedy
    FilterFailed            the packet filter of this machine could not be set up or changed
"""

from __future__ import annotations


class ClusterError(Exception):
    """Root of everything that a cluster raises on purpose."""


class EtcdError(ClusterError):
    """etcd did not do what was requested."""


class EtcdUnavailable(EtcdError):
    """No member has answered in time; whether the request was or will be carried out is unknown."""


class EtcdRefused(EtcdError):
    """A member refused the request, which changed nothing."""


class ClusterUnusable(ClusterError):
    """What etcd holds for this site cannot be used."""


class FilterFailed(ClusterError):
    """The packet filter of this machine could not be set up or changed."""
