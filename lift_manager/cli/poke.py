"""`lift-manager poke`: try one command of a lift, and see what the lift does."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from lift_manager.api.lifts import PlannedWrites
from lift_manager.cli.active_machine import WithoutEtcd
from lift_manager.cli.common import duration_s, fail, print_lines, print_stderr
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.keyboard import read_typed
from lift_manager.cli.loop import cancel_on_signals
from lift_manager.cli.own_manager import SiteOption, run_directly
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.client.client import LiftManagerClient
from lift_manager.commissioning.poke.perform import Outcome, perform, plan_writes, read_lift
from lift_manager.commissioning.poke.trial import NotPossible, Trial
from lift_manager.commissioning.poke.unlock import LONGEST_S, Unlock, with_draft
from lift_manager.commissioning.poke.wording import command_lines, latching_lines, trial_lines
from lift_manager.lift.commands import CommandState
from lift_manager.plain.http import MANAGER
from lift_manager.plain.text import is_printable

Answer = TypeVar("Answer")

NAME = "poke"
OWN_NAME = "lift-manager"
"""The name of the key of an own manager."""
WORD = "yes"
_EXIT_CODES = {CommandState.CONFIRMED: 0, CommandState.REJECTED: 3, CommandState.UNCONFIRMED: 4}


def poke(  # noqa: PLR0913  each is an option of the command line
    lift: Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")],
    command: Annotated[
        str,
        typer.Argument(
            metavar="COMMAND",
            help="A command of its map, such as go_to or hold_door.front; without one, its commands are listed.",
            show_default=False,
        ),
    ] = "",
    floor: Annotated[str, typer.Argument(metavar="FLOOR", help="With go_to, call and go.", show_default=False)] = "",
    *,
    site: SiteOption = None,
    without_etcd: WithoutEtcd = False,
    hold_s: Annotated[
        float,
        typer.Option("--for", metavar="SECONDS", min=0, max=60, help="How long a door or robot mode is held."),
    ] = 5.0,
    at_panel: Annotated[
        str,
        typer.Option(
            "--at-panel",
            metavar="NAME",
            help="The lift technician who stands at the panel, where an output would stay on if this computer failed.",
            show_default=False,
        ),
    ] = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the frames, and send nothing.")] = False,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Send without asking. The car is empty, and nobody is in the doorway: you say so."),
    ] = False,
    unlock_for: Annotated[
        str,
        typer.Option(
            "--unlock",
            metavar="TIME",
            help="For this long, such as 10m, try the commands of a draft map instead, within `writable_ranges` of the site file.",
            show_default=False,
        ),
    ] = "",
    draft: Annotated[
        str, typer.Option("--draft", metavar="FILE", help="With --unlock: the draft map.", show_default=False)
    ] = "",
    by: Annotated[
        str, typer.Option("--by", metavar="NAME", help="With --unlock: your name, for the journal.", show_default=False)
    ] = "",
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="With --unlock: why, for the journal.", show_default=False)
    ] = "",
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Try one command of a lift.

    It shows the exact frames, asks, sends, and shows what the lift does: through the running manager, or with --site without one. All
    rules hold: no press in fire, in inspection, during a lockout, or on a lift that another robot holds. Everything is released at the
    end, after Ctrl-C too. Without a terminal nothing is sent unless --yes is given.

    Exit codes: 0 confirmed, or nothing was to be sent; 1 it cannot be tried; 3 rejected; 4 unconfirmed, or not verified to be released.

    Example: lift-manager poke east go_to L3 --site site.yaml
    """
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    if " " in command and not floor:
        command, _, floor = command.partition(" ")
    unlock = _read_unlock(unlock_for, draft, by, reason, site)
    route = _Route(connection, site, lift, unlock, without_etcd)
    if not command:
        print_lines(command_lines(route.run(lambda client: client.commands(lift))))
        return
    trial, writes, access = route.run(lambda client: _plan(client, lift, command, floor))
    if unlock is not None:
        print_lines([f"UNLOCKED: the commands of the draft map {unlock.draft}, not those of the map of {lift}"])
    print_lines(trial_lines(trial, writes, hold_s))
    print_lines(latching_lines(trial))
    if dry_run or not (yes or sys.stdin.isatty()):
        why = "--dry-run" if dry_run else "there is no terminal to ask at; --yes sends without asking"
        print_lines([f"dry run: nothing was sent ({why})"])
        return
    if access != "control" and site is None:
        raise fail(
            f"{lift} is only watched: the manager's site file does not say `access: control`; nothing was sent. Without a running"
            f" manager, `lift-manager poke {lift} {trial} --site SITE` tries it"
        )
    technician = _confirm(trial, at_panel, is_interactive=not yes)
    outcome = route.run(
        lambda client: perform(client, trial, writes, who=_holder(technician), hold_s=hold_s, show=_show), writes=True
    )
    _report(trial, outcome)


def _read_unlock(unlock_for: str, draft: str, by: str, reason: str, site: Path | None) -> Unlock | None:
    """Return what is unlocked, if anything. Raises typer.BadParameter."""
    given = {"--unlock": unlock_for, "--draft": draft, "--by": by, "--reason": reason}
    if not any(given.values()):
        return None
    for option, text in given.items():
        if not is_printable(text) or not text.strip():
            raise typer.BadParameter(f"an unlock needs {', '.join(given)}, each on one line", param_hint=option)
    if site is None:
        text = "only without a running manager: give the site file, so that no robot has a session meanwhile"
        raise typer.BadParameter(text, param_hint="--site")
    for_s = duration_s(unlock_for, ("s", "m"))
    if not for_s or for_s > LONGEST_S:
        raise typer.BadParameter(f"write a time such as 90s or 10m, at most {LONGEST_S / 60:g}m", param_hint="--unlock")
    return Unlock(draft, by.strip(), reason.strip(), for_s)


async def _plan(client: LiftManagerClient, lift: str, command: str, floor: str) -> tuple[Trial, PlannedWrites, str]:
    known = await read_lift(client, lift)
    return (*await plan_writes(client, known, command, floor), known.capabilities.access)


@dataclass(frozen=True)
class _Route:
    """How the lift is reached: through the running manager, or an own one of a site file."""

    connection: ManagerConnection
    site: Path | None
    lift: str
    unlock: Unlock | None = None
    without_etcd: bool = False

    def run(self, work: Callable[[LiftManagerClient], Coroutine[Any, Any, Answer]], *, writes: bool = False) -> Answer:
        """Run `work`. Without `writes` an own manager writes nothing, not even a heartbeat."""

        async def until_signal(client: LiftManagerClient) -> Answer:
            return await cancel_on_signals(work(client), [])

        try:
            if self.site is None:
                return self.connection.run(until_signal)
            return self._run_directly(self.site, work, writes=writes)
        except NotPossible as error:
            raise fail(str(error)) from error
        except (asyncio.CancelledError, KeyboardInterrupt):
            print_stderr("ended before its time" if writes else "ended; nothing was sent")
            raise typer.Exit(1) from None

    def _run_directly(
        self, site: Path, work: Callable[[LiftManagerClient], Coroutine[Any, Any, Answer]], *, writes: bool
    ) -> Answer:
        may_command, unlock = ((self.lift,) if writes else ()), self.unlock
        if unlock is None:
            return run_directly(
                site,
                work,
                name=OWN_NAME,
                may_command=may_command,
                is_recorded=writes,
                without_etcd=self.without_etcd,
            )

        async def while_unlocked(client: LiftManagerClient) -> Answer:
            async with asyncio.timeout(unlock.for_s):
                return await work(client)

        try:
            return run_directly(
                site,
                while_unlocked,
                name=OWN_NAME,
                may_command=may_command,
                is_recorded=writes,
                change=lambda loaded: with_draft(loaded, self.lift, unlock.draft),
                decision=unlock.row(self.lift) if writes else None,
                without_etcd=self.without_etcd,
            )
        except TimeoutError as error:
            raise fail(f"the unlock has ended after {unlock.for_s:g} s, and the trial with it") from error


def _confirm(trial: Trial, at_panel: str, *, is_interactive: bool) -> str:
    """Ask the person at the terminal; return the name of the technician at the panel, where there has to be one."""
    technician = at_panel.strip()
    if trial.latching and not technician:
        if is_interactive:
            technician = read_typed("Name of the lift technician at the panel: ").strip()
        if not technician:
            raise fail(
                "nothing was sent: the lift technician has to stand at the panel; give the name with --at-panel NAME"
            )
    if is_interactive:
        print_lines(["The car is empty, nobody is in its doorway, and somebody sees the lift?"])
        if read_typed(f"Type {WORD} to send it: ").strip().lower() != WORD:
            raise fail(f"nothing was sent: {WORD} was not typed")
    return technician


def _holder(technician: str) -> str:
    """Return what is written down as the holder of the lift, with the name of the technician."""
    return f"{NAME}, {technician} at the panel"[:64] if technician else NAME


def _show(text: str) -> None:
    try:
        print_lines([text])
    except OSError:
        # a closed terminal: nobody reads it, but everything has still to be released
        return


def _report(trial: Trial, outcome: Outcome) -> None:
    print_lines([f"{trial.lift}: {trial}: {outcome.state}{f': {outcome.text}' if outcome.text else ''}"])
    if not outcome.is_released:
        raise typer.Exit(4)
    if code := _EXIT_CODES[outcome.state]:
        raise typer.Exit(code)
