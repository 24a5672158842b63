"""The command line. Each command is imported only when it is called, because importing the whole program takes two seconds."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command, get_group

from lift_manager.plain.version import running_version
from register_maps.plain import closest

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


class Commands(TyperGroup):
    """Looks up commands in `COMMANDS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Name every command."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import one command. An unknown one ends the program and names the most similar one."""
        if cmd_name not in COMMANDS:
            ctx.fail(f"No such command {cmd_name!r}{closest(cmd_name, COMMANDS)}")
        module, _, name = COMMANDS[cmd_name].partition(":")
        found = getattr(import_module(f"lift_manager.cli.{module}"), name)
        if isinstance(found, typer.Typer):
            command: Any = get_group(found)
        else:
            alone = typer.Typer(add_completion=False)
            alone.command(cmd_name)(found)
            command = get_command(alone)
        command.name = cmd_name
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
