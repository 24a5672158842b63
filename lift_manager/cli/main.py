"""The command line. Each command is imported only when it is called, because importing the whole program takes two seconds."""

from __future__ import annotations

import gc
import sys
from importlib import import_module
from types import ModuleType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from lift_manager.plain.version import running_version
from register_maps.error_texts import closest

COMMANDS = {
    "demo": "lab:demo",
    "serve": "serve:serve",
    "check": "check:check",
    "simulate": "lab:simulate",
    "init": "init:init",
    "doctor": "doctor:doctor",
    "learn": "learn:learn",
    "checkout": "checkout:checkout",
    "checkout-report": "checkout_report:report",
    "keys": "keys:app",
    "lifts": "lifts:lifts",
    "watch": "watch:watch",
    "trace": "trace:app",
    "ride": "ride:ride",
    "poke": "poke:poke",
    "ack": "operate:ack",
    "lockout": "operate:lockout",
    "drain": "operate:drain",
    "release": "operate:release",
    "audit": "audit:audit",
    "cluster": "cluster:app",
    "handover": "cluster:handover",
    "maps": "maps:app",
    "network": "network:show",
    "backup": "backup:backup",
    "restore": "restore:restore",
    "bundle": "bundle:bundle",
    "scenario": "scenario:app",
    "rmf": "rmf:app",
    "hub": "hub:app",
}
"""Module of this package, and the function or group in it, by command."""


SUMMARIES = {
    "Try it": {
        "demo": "Run three simulated lifts and a manager.",
        "simulate": "Serve one simulated lift, or replay a recorded controller.",
        "scenario": "Play faults and people against a simulated site.",
    },
    "Run a manager": {
        "serve": "Run the lift manager for a site.",
        "check": "Find every mistake in a site file or a register map.",
        "keys": "Make, list and revoke the keys of a site.",
        "network": "Show what the owner's network should let through.",
        "rmf": "Run the Open-RMF adapter without ROS, or inspect messages.",
        "hub": "Serve the lifts of many sites, or manage the sites.",
        "cluster": "Prepare and inspect the two machines of a site.",
        "handover": "Let the standby take over, without releasing anything.",
    },
    "Commission a lift": {
        "init": "Write the site file of a first lift.",
        "maps": "List and check maps; print I/O lists and PLC programs.",
        "learn": "Draft a map of an undocumented controller while you ride.",
        "doctor": "Find what is wrong between a map and a controller.",
        "watch": "Show every signal of a lift, live.",
        "trace": "Record every Modbus frame of a link, and read a recording.",
        "poke": "Try one command of a lift.",
        "checkout": "Test a lift item by item, for a record that people sign.",
        "checkout-report": "Write the report of an acceptance test.",
    },
    "Operate lifts": {
        "lifts": "Show the lifts of a running manager.",
        "ride": "Ride a lift as a robot would.",
        "ack": "Acknowledge that a lift was checked.",
        "lockout": "Keep robots off a lift.",
        "drain": "Let present sessions end and no new one begin.",
        "release": "End the session that holds a lift.",
    },
    "Keep records": {
        "audit": "Show, export and verify the journal.",
        "backup": "Back up a site.",
        "restore": "Restore a site from a backup, and lock out every lift.",
        "bundle": "Write a support bundle, without secrets.",
    },
}
"""How the help of a command begins, by group; here once more, because the list of all commands imports none of them."""


class Commands(TyperGroup):
    """Looks up commands in `COMMANDS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Name every command, in the order of the help."""
        return [name for summaries in SUMMARIES.values() for name in summaries]

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand:
        """Return what the list of commands shows of one; the command itself is not imported."""
        group = next(group for group, summaries in SUMMARIES.items() if cmd_name in summaries)
        return TyperCommand(cmd_name, help=SUMMARIES[group][cmd_name], rich_help_panel=group)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Import the command that is called. An unknown one ends the program and names the most similar one."""
        name, *rest = args
        if name not in COMMANDS:
            ctx.fail(f"No such command {name!r}{closest(name, COMMANDS)}")
        return name, load_command(name), rest


def load_command(name: str) -> Any:
    """Import one command or group of commands."""
    module, _, attribute = COMMANDS[name].partition(":")
    found = getattr(_import(f"lift_manager.cli.{module}"), attribute)
    if isinstance(found, typer.Typer):
        command: Any = get_group(found)
    else:
        alone = typer.Typer(add_completion=False)
        alone.command(name)(found)
        command = get_command(alone)
    command.name = name
    _unwrap_help(command)
    return command


def _import(name: str) -> ModuleType:
    """Import a module that imports most of the program.

    What that brings stays as long as the process. To look through it for garbage, several times, would take a quarter of the start.
    """
    if name in sys.modules:
        return sys.modules[name]
    gc.disable()
    try:
        return import_module(name)
    finally:
        gc.freeze()
        gc.enable()


def _unwrap_help(command: Any) -> None:
    """Join the lines of each paragraph: typer prints them as they are broken in the source."""
    command.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in command.help.split("\n\n"))
    for inner in getattr(command, "commands", {}).values():
        _unwrap_help(inner)


app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


def _version(*, is_requested: bool) -> None:
    if is_requested:
        typer.echo(f"lift-manager {running_version()}")
        raise typer.Exit


@app.callback()
def lift_manager(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=lambda value: _version(is_requested=value), is_eager=True, help="Show the version."
        ),
    ] = False,
) -> None:
    """Connect robots to real lifts over Modbus/TCP."""
