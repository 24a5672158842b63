"""`lift-manager rmf`: the Open-RMF adapter as a program of its own, and two tools to inspect RMF's messages about lifts."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import typer
from prometheus_client import CollectorRegistry, PlatformCollector, ProcessCollector, start_http_server

from lift_manager.cli import rmf_tools
from lift_manager.cli.common import fail, print_lines
from lift_manager.cli.key_file import KeyFile, key_of
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.rmf_options import (
    AdapterId,
    AdapterRequestsTopic,
    Domain,
    Namespace,
    Peers,
    RequestsTopic,
    SimTime,
    StatesTopic,
    describe_rmf,
    join_rmf,
    ros_settings,
)
from lift_manager.cli.tls_options import Ca
from lift_manager.metrics.rmf import RmfCollector
from lift_manager.plain.http import DEFAULT_PORT, Address, BadAddress, Server
from lift_manager.plain.signals import stop_on_signals
from lift_manager.rmf.counts import Counts
from lift_manager.rmf.dds import Dds
from lift_manager.rmf.remote_manager import RemoteManager
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.run import RunningAdapter

app = typer.Typer()
app.command("watch")(rmf_tools.watch)
app.command("request")(rmf_tools.request)

MetricsPort = Annotated[
    int | None,
    typer.Option(
        "--metrics-port",
        min=1,
        max=65535,
        help="Serve the adapter's metrics for Prometheus here, as /metrics.",
        show_default=False,
    ),
]


@app.callback(invoke_without_command=True)
def adapter(  # noqa: PLR0913  each is an option of the command line
    context: typer.Context,
    *,
    manager_address: Annotated[
        str, typer.Option("--manager-address", metavar="HOST", help="Where the manager runs; also https://HOST.")
    ] = "127.0.0.1",
    manager_port: Annotated[
        int, typer.Option("--manager-port", min=1, max=65535, help="The port it listens on.")
    ] = DEFAULT_PORT,
    key_file: KeyFile = None,
    ca: Ca = None,
    domain: Domain = None,
    namespace: Namespace = "",
    lift_states: StatesTopic = RosSettings.states_topic,
    lift_requests: RequestsTopic = RosSettings.requests_topic,
    adapter_lift_requests: AdapterRequestsTopic = RosSettings.adapter_requests_topic,
    adapter_id: AdapterId = "",
    peer: Peers = [],  # noqa: B006 - typer makes a new list of it
    use_sim_time: SimTime = False,
    metrics_port: MetricsPort = None,
    metrics_host: Annotated[
        str, typer.Option("--metrics-host", help="With --metrics-port: the address.")
    ] = "127.0.0.1",
    log_format: LogOption = LogFormat.HUMAN,
) -> None:
    """Run the Open-RMF adapter without ROS, or inspect messages.

    The adapter runs beside a manager; `lift-manager serve --rmf` runs it inside.

    Example: lift-manager rmf --manager-address lift-pc.example --key-file rmf.key
    """
    if context.invoked_subcommand is not None:
        _refuse_options(context, context.invoked_subcommand)
        return
    log_to_stderr(log_format)
    settings = ros_settings(
        domain=domain,
        namespace=namespace,
        lift_states=lift_states,
        lift_requests=lift_requests,
        adapter_lift_requests=adapter_lift_requests,
        adapter_id=adapter_id,
        peers=peer,
        use_sim_time=use_sim_time,
    )
    server = _server(manager_address, manager_port, key_file, ca)
    counts = Counts()
    with nullcontext() if metrics_port is None else _metrics(counts, metrics_host, metrics_port):
        run(_run(settings, server, counts))


async def _run(settings: RosSettings, server: Server, counts: Counts) -> None:
    stop = asyncio.Event()
    stop_on_signals(stop)
    running = RunningAdapter(
        lambda listener, deliver: Dds(settings, listener, deliver),
        lambda: RemoteManager(server),
        use_sim_time=settings.use_sim_time,
        counts=counts,
        adapter_id=settings.adapter,
    )
    join_rmf(running.open)
    print_lines([f"Open-RMF lift adapter: {describe_rmf(settings)}; manager {server.address}; Ctrl-C ends it"])
    async with asyncio.TaskGroup() as tasks:
        task = tasks.create_task(running.run())
        await stop.wait()
        task.cancel()


def _server(address: str, port: int, key_file: Path | None, ca: Path | None) -> Server:
    key = key_of(key_file)
    try:
        return Server(Address.of(address, port), "" if key is None else key.reveal(), ca)
    except BadAddress as error:
        raise typer.BadParameter(str(error), param_hint="--manager-address") from error


@contextmanager
def _metrics(counts: Counts, host: str, port: int) -> Iterator[None]:
    """Serve the metrics while the block lasts."""
    registry = CollectorRegistry()
    for collector in (RmfCollector(counts), ProcessCollector(registry=None), PlatformCollector(registry=None)):
        registry.register(collector)
    try:
        server, thread = start_http_server(port, host, registry)
    except OSError as error:
        text = f"cannot listen on {host}:{port} for metrics: {error.strerror or error}; give another --metrics-port"
        raise fail(text) from error
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _refuse_options(context: typer.Context, command: str) -> None:
    for name in context.params:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            option = f"--{name.replace('_', '-')}"
            raise typer.BadParameter(
                f"write it after `{command}`: lift-manager rmf {command} {option} ...", param_hint=option
            )
