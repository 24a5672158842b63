"""`lift-manager rmf watch` and `rmf request`: show the messages between RMF and lifts, and request a lift as a robot does."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Annotated

import typer

from lift_manager.cli.common import print_lines, print_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.rmf_options import (
    AdapterRequestsTopic,
    Domain,
    Namespace,
    Peers,
    RequestsTopic,
    StatesTopic,
    describe_rmf,
    join_rmf,
    ros_settings,
)
from lift_manager.plain.signals import stop_on_signals
from lift_manager.rmf.dds import Monitor
from lift_manager.rmf.messages import LiftRequest, LiftState
from lift_manager.rmf.request import Attempt, AttemptEnd, OperatorRequest
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.watch import Topics, Watch, short

LOOK_S = 0.25
"""Between two checks for what only the passing of time shows. Chosen."""
NOBODY_S = 5.0
"""How long no message may arrive before the command prints advice."""


def watch(
    lift: Annotated[
        str | None, typer.Argument(metavar="LIFT", help="One lift by RMF's name; all of them without it.")
    ] = None,
    *,
    domain: Domain = None,
    namespace: Namespace = "",
    lift_states: StatesTopic = RosSettings.states_topic,
    lift_requests: RequestsTopic = RosSettings.requests_topic,
    adapter_lift_requests: AdapterRequestsTopic = RosSettings.adapter_requests_topic,
    peer: Peers = [],  # noqa: B006 - typer makes a new list of it
) -> None:
    """Print who holds which lift, and every request and change.

    Until Ctrl-C. Nothing is sent.

    Example: lift-manager rmf watch
    """
    settings = ros_settings(
        domain=domain,
        namespace=namespace,
        lift_states=lift_states,
        lift_requests=lift_requests,
        adapter_lift_requests=adapter_lift_requests,
        peers=peer,
    )
    run(_watch(settings, lift))


def request(  # noqa: PLR0913  each is an option of the command line
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift by RMF's name.")],
    floor: Annotated[str | None, typer.Argument(metavar="FLOOR", help="The floor by RMF's name.")] = None,
    *,
    session: Annotated[
        str, typer.Option("--session", metavar="NAME", help="The session id; that of a robot is fleet/robot.")
    ] = "lift-manager",
    closed: Annotated[
        bool, typer.Option("--closed", help="With --human: do not hold the door open there; in AGV mode it is held.")
    ] = False,
    human: Annotated[bool, typer.Option("--human", help="Request HUMAN mode; robots request AGV mode.")] = False,
    direct: Annotated[
        bool,
        typer.Option("--direct", help="Send it to the lift adapter itself: a lift supervisor would end the session."),
    ] = False,
    end: Annotated[bool, typer.Option("--end", help="End the session instead; takes no floor.")] = False,
    instead_of: Annotated[
        str | None,
        typer.Option(
            "--instead-of",
            metavar="NAME",
            help="First end this session, which the lift supervisor serves instead of the one that holds the lift.",
        ),
    ] = None,
    within: Annotated[float, typer.Option("--within", min=1, max=3600, help="Seconds to wait for the lift.")] = 120.0,
    domain: Domain = None,
    namespace: Namespace = "",
    lift_states: StatesTopic = RosSettings.states_topic,
    lift_requests: RequestsTopic = RosSettings.requests_topic,
    adapter_lift_requests: AdapterRequestsTopic = RosSettings.adapter_requests_topic,
    peer: Peers = [],  # noqa: B006 - typer makes a new list of it
) -> None:
    """Request a lift as a robot of RMF does.

    From the lift supervisor, or from the lift adapter if there is none. Exit code 1 if the lift does not come.

    Example: lift-manager rmf request main L2
    """
    if end != (floor is None):
        raise typer.BadParameter("give a floor, or --end without one", param_hint="FLOOR")
    if closed and not human:
        raise typer.BadParameter(
            "in AGV mode the door is open whenever the lift has stopped; add --human", param_hint="--closed"
        )
    if not session:
        raise typer.BadParameter("a session without a name ends nothing and holds nothing", param_hint="--session")
    if instead_of is not None and (end or direct or instead_of in ("", session)):
        raise typer.BadParameter(
            "takes the name of another session, needs a floor, and sends to the supervisor", param_hint="--instead-of"
        )
    settings = ros_settings(
        domain=domain,
        namespace=namespace,
        lift_states=lift_states,
        lift_requests=lift_requests,
        adapter_lift_requests=adapter_lift_requests,
        peers=peer,
    )
    requested = OperatorRequest(
        lift, floor, session, open_door=not closed, human=human, direct=direct, instead_of=instead_of
    )
    if run(_request(settings, requested, within)) is not AttemptEnd.FULFILLED:
        raise typer.Exit(1)


class _WatchPrinter:
    """Prints received messages. Implements `dds.MonitorListener`."""

    def __init__(self, watch_state: Watch) -> None:
        self._watch = watch_state
        self.has_received = False

    def on_state(self, state: LiftState) -> None:
        self.has_received = True
        self.show(self._watch.report_state(state, _now()))

    def on_request(self, topic: str, request: LiftRequest) -> None:
        self.has_received = True
        self.show(self._watch.report_request(topic, request, _now()))

    def on_unreadable(self, text: str) -> None:
        self.show(self._watch.report_unreadable(text, _now()))

    def show(self, lines: Iterable[str]) -> None:
        clock = f"{datetime.now(UTC).astimezone():%H:%M:%S.%f}"[:12]
        print_lines(f"{clock} {line}" for line in lines)


async def _watch(settings: RosSettings, lift: str | None) -> None:
    stop = asyncio.Event()
    stop_on_signals(stop)
    topics = Topics(settings.adapter_requests_topic, settings.requests_topic)
    watch_state = Watch(topics, lift)
    printer = _WatchPrinter(watch_state)
    deliver = asyncio.get_running_loop().call_soon_threadsafe
    monitor = join_rmf(lambda: Monitor(settings, printer, deliver))
    print_stderr(f"watching {describe_rmf(settings)}; Ctrl-C ends it")
    nobody_at = _now() + NOBODY_S
    try:
        while not await _stopped(stop, LOOK_S):
            printer.show(watch_state.report_elapsed(_now()))
            if not printer.has_received and _now() >= nobody_at:
                nobody_at = float("inf")
                print_stderr(
                    "no messages: is the adapter running, in the same domain, with the same namespace and topics, and can this"
                    " computer reach it (multicast, or --peer ADDRESS)?"
                )
    finally:
        monitor.close()
    printer.show(watch_state.report_counts(_now()))


class _AttemptPrinter:
    """Passes received messages to an attempt. Implements `dds.MonitorListener`."""

    def __init__(self, to_lift: str) -> None:
        """`to_lift` is the topic of requests to lift adapters."""
        self._to_lift = to_lift
        self.attempt: Attempt | None = None
        self._has_reported_unreadable = False

    def on_state(self, state: LiftState) -> None:
        if self.attempt is not None:
            print_lines(self.attempt.handle_state(state, _now()))

    def on_request(self, topic: str, request: LiftRequest) -> None:
        if self.attempt is not None and topic == self._to_lift:
            print_lines(self.attempt.handle_relayed_request(request))

    def on_unreadable(self, text: str) -> None:
        """Report only the first one: there may be thousands, from any program."""
        if not self._has_reported_unreadable:
            self._has_reported_unreadable = True
            print_stderr(f"unreadable message: {short(text)}")


async def _request(settings: RosSettings, requested: OperatorRequest, within_s: float) -> AttemptEnd | None:
    stop = asyncio.Event()
    stop_on_signals(stop)
    printer = _AttemptPrinter(settings.requests_topic)
    deliver = asyncio.get_running_loop().call_soon_threadsafe
    monitor = join_rmf(lambda: Monitor(settings, printer, deliver))
    print_stderr(f"sending to {describe_rmf(settings)}")
    printer.attempt = attempt = Attempt(
        requested,
        lambda: monitor.count_readers(direct=True),
        lambda what, direct: monitor.send_request(what, direct=direct),
        within_s=within_s,
        now=_now(),
    )
    try:
        while attempt.end is None and not await _stopped(stop, LOOK_S):
            print_lines(attempt.tick(time.time(), _now()))
    finally:
        monitor.close()
        print_lines(attempt.report_open_session())
    return attempt.end


async def _stopped(stop: asyncio.Event, within_s: float) -> bool:
    try:
        async with asyncio.timeout(within_s):
            await stop.wait()
    except TimeoutError:
        return False
    return True


def _now() -> float:
    return asyncio.get_running_loop().time()
