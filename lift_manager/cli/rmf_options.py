"""Command line options for reaching RMF. Missing ones come from the environment, as for nodes of ROS 2."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from lift_manager.cli.common import fail, print_stderr
from lift_manager.rmf.dds import DdsError, DdsMissing
from lift_manager.rmf.ros_settings import HIGHEST_DOMAIN, BadSettings, RosSettings

if TYPE_CHECKING:
    from lift_manager.config.site import Rmf

Made = TypeVar("Made")

Domain = Annotated[
    int | None,
    typer.Option(
        "--domain",
        min=0,
        max=HIGHEST_DOMAIN,
        help="The ROS domain, instead of that in ROS_DOMAIN_ID.",
        show_default=False,
    ),
]
Namespace = Annotated[
    str, typer.Option("--namespace", metavar="NAME", help="Before the topics, such as /building1.", show_default=False)
]
StatesTopic = Annotated[str, typer.Option("--lift-states", metavar="TOPIC", help="Where lifts publish their states.")]
RequestsTopic = Annotated[
    str,
    typer.Option("--lift-requests", metavar="TOPIC", help="Where the lift supervisor sends requests to lift adapters."),
]
AdapterRequestsTopic = Annotated[
    str,
    typer.Option("--adapter-lift-requests", metavar="TOPIC", help="Where fleets send requests to the lift supervisor."),
]
AdapterId = Annotated[
    str,
    typer.Option(
        "--adapter-id",
        metavar="NAME",
        help="This RMF's name at the manager, if several RMFs share it; by default derived from domain and namespace.",
        show_default=False,
    ),
]
Peers = Annotated[
    list[str],
    typer.Option(
        "--peer",
        metavar="ADDRESS",
        help="An address at which to look for RMF without multicast; can be repeated.",
        show_default=False,
    ),
]
SimTime = Annotated[bool, typer.Option("--use-sim-time", help="Take the time from /clock, as a simulation does.")]


def ros_settings(  # noqa: PLR0913  each is an option of the command line
    *,
    domain: int | None = None,
    namespace: str = "",
    lift_states: str = RosSettings.states_topic,
    lift_requests: str = RosSettings.requests_topic,
    adapter_lift_requests: str = RosSettings.adapter_requests_topic,
    peers: list[str] | tuple[str, ...] = (),
    use_sim_time: bool = False,
    adapter_id: str = "",
) -> RosSettings:
    """Combine options with the environment, which they override; an invalid one is a usage error."""
    try:
        settings = RosSettings.of(os.environ)
        return replace(
            settings,
            domain=settings.domain if domain is None else domain,
            namespace=namespace,
            states_topic=lift_states,
            requests_topic=lift_requests,
            adapter_requests_topic=adapter_lift_requests,
            peers=(*peers, *settings.peers),
            use_sim_time=use_sim_time,
            adapter_id=adapter_id,
        )
    except BadSettings as error:
        raise typer.BadParameter(str(error)) from error


def settings_of_site(rmf: Rmf) -> RosSettings:
    """Combine the settings of a site file with the environment, which they override."""
    return ros_settings(
        domain=rmf.domain,
        namespace=rmf.namespace or "",
        lift_states=rmf.lift_states,
        lift_requests=rmf.lift_requests,
        adapter_lift_requests=rmf.adapter_lift_requests,
        peers=rmf.peers,
        use_sim_time=rmf.use_sim_time,
        adapter_id=rmf.adapter_id,
    )


def join_rmf(make: Callable[[], Made]) -> Made:
    """Join RMF, or report why it failed and exit."""
    try:
        return make()
    except DdsError as error:
        raise report_join_failure(error) from error


def report_join_failure(error: Exception) -> typer.Exit:
    """Print why RMF cannot be joined; raise what this returns. The exit code is 2 if something has to be installed first, else 1."""
    if not isinstance(error, DdsMissing):
        return fail(str(error))
    print_stderr(str(error))
    return typer.Exit(2)


def describe_rmf(settings: RosSettings) -> str:
    """Describe domain, topics and discovery in words."""
    topics = f"/{settings.resolved(settings.states_topic)} and /{settings.resolved(settings.requests_topic)}"
    reach = "" if settings.discovery_range == "SUBNET" else f", discovery {settings.discovery_range}"
    peers = f", peers {', '.join(settings.peers)}" if settings.peers else ""
    return f"ROS domain {settings.domain}, {topics}{reach}{peers}"
