"""The command line. Each command is imported only when it is called, because importing the whole program takes two seconds."""

from __future__ import annotations

from importlib import import_module
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
    "maps": "maps:app",
    "network": "network:show",
    "backup": "backup:backup",
    "restore": "restore:restore",
    "bundle": "bundle:bundle",
    "scenario": "scenario:app",
    "rmf": "rmf:app",
}
"""Module of this package, and the function or group in it, by command; in the order of the help."""


SUMMARIES = {
    "demo": "Run three simulated lifts and a manager, with nothing to configure.",
    "serve": "Run the lift manager for a site.",
    "check": "Find every mistake in a site file or a register map; exits 2 if there is one.",
    "simulate": "Serve one simulated lift that any Modbus/TCP tool can read and command, or replay a recorded controller.",
    "init": "Write the site file of a first lift, and look at once whether its controller answers; nothing is written to the lift.",
    "doctor": "Find what is wrong between a map and a controller, by reading alone: one connection, one read at a time, no write.",
    "learn": "Find out which registers of an undocumented controller show position, door and motion, while you ride; writes a draft of a map.",
    "checkout": "Test a lift item by item with the person at its doors, and keep a record that people sign.",
    "checkout-report": "Write the report of an acceptance test: HTML for A4 paper and signatures, JSON or CSV for other programs.",
    "keys": "Make, list and revoke the keys of a site.",
    "lifts": "Show the lifts of a running manager: where each is, its door, its mode and who holds it. Exit code 1 where no manager answers.",
    "watch": "Show every signal of a lift, live, with the car in its shaft and the last minute. Reads only. Ctrl-C ends it.",
    "trace": "Record every Modbus frame of a link, for Wireshark too, and read what was recorded.",
    "ride": "Ride as a robot would: print its guidance, and report when it has entered and left. Ctrl-C cancels, and waits until the robot is out.",
    "poke": "Try one command of a lift: show the exact frames, ask, send, and show what the lift does.",
    "ack": "Acknowledge that a lift was checked after a fire, that no robot is in its car, or that its signals may be trusted again.",
    "lockout": "Keep robots off a lift, over restarts too, until somebody ends that with --end.",
    "drain": "Let present sessions end and no new one begin, over restarts too, until somebody ends that with --end.",
    "release": "End the session that holds a lift; everything is released, and the car does not move.",
    "audit": "Show who requested what, what was written to the lift because of it, and the outcome; export and verify the journal.",
    "maps": "List, show and check register maps; plan what they send; print I/O lists and PLC programs.",
    "network": "Show what the owner's network should let through for a site, as a table or as rules for other programs.",
    "backup": "Back up a site: site file, maps, certificates and keys, state, journal, API keys and checkout records.",
    "restore": "Restore a site from a backup, while no manager runs for it, and lock out every lift.",
    "bundle": "Write a support bundle: site file, maps, versions, journal, and the state of a running manager, without secrets.",
    "scenario": "Play requests, faults and people against a simulated site, and judge the outcome.",
    "rmf": "Run the Open-RMF lift adapter next to a manager, without ROS; or inspect the messages between RMF and lifts.",
}
"""How the help of a command begins; here once more, because the list of all commands imports none of them."""


class Commands(TyperGroup):
    """Looks up commands in `COMMANDS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Name every command."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand:
        """Return what the list of commands shows of one; the command itself is not imported."""
        return TyperCommand(cmd_name, help=SUMMARIES[cmd_name])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Import the command that is called. An unknown one ends the program and names the most similar one."""
        name, *rest = args
        if name not in COMMANDS:
            ctx.fail(f"No such command {name!r}{closest(name, COMMANDS)}")
        return name, load_command(name), rest


def load_command(name: str) -> Any:
    """Import one command or group of commands."""
    module, _, attribute = COMMANDS[name].partition(":")
    found = getattr(import_module(f"lift_manager.cli.{module}"), attribute)
    if isinstance(found, typer.Typer):
        command: Any = get_group(found)
    else:
        alone = typer.Typer(add_completion=False)
        alone.command(name)(found)
        command = get_command(alone)
    command.name = name
    return command


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
