"""What people say to a running manager: acknowledge, lock out, end a lockout, take a lift from its holder."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer

from lift_manager.cli.common import say
from lift_manager.cli.secured import Ca, Certificate, CertificateKey
from lift_manager.cli.speaking import MANAGER, KeyFile, Manager, Speaker
from lift_manager.lift.events import Cause

LiftName = Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is kept with what you say.")]

Now = Annotated[
    bool,
    typer.Option(
        "--now", help="Release a held door at once, though a robot may be in the doorway; otherwise after `clear_s`."
    ),
]


def ack(
    lift: LiftName,
    by: By,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Say that a lift was checked after a fire, that no robot is in its car, or that its signals may be trusted again."""
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    said = to.ask(lambda client: client.acknowledge(lift, by))
    causes = {
        Cause.FIRE: "the fire",
        Cause.OCCUPIED: "that no robot is in the car",
        Cause.CONTRADICTION: "that its signals may be trusted",
    }
    what = " and ".join(causes[cause] for cause in said.acknowledged)
    say([f"{said.lift}: {said.by} acknowledged {what}, {_shown(said.at)}; robots are taken again"])


def lockout(  # noqa: PLR0913  each is an option of the command line
    lift: LiftName,
    by: By,
    *,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why; every robot that asks is told.", show_default=False)
    ] = "",
    end: Annotated[bool, typer.Option("--end", help="End the lockout: robots may command the lift again.")] = False,
    now: Now = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Keep robots off a lift, over restarts too, until somebody ends that with --end."""
    if end and reason:
        raise typer.BadParameter("a lockout that ends needs no reason; leave --reason out", param_hint="--reason")
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    if end:
        ended = to.ask(lambda client: client.end_lockout(lift, by))
        was = ended.lockout
        say([f"{ended.lift}: the lockout by {was.by} since {_shown(was.since)} ({was.reason}) is ended by {ended.by}"])
        return
    if not reason.strip():
        raise typer.BadParameter("say why, in a few words; robots and their people are told", param_hint="--reason")
    said = to.ask(lambda client: client.lock_out(lift, by, reason, now=now))
    say([f"{said.lift}: locked out by {said.by} since {_shown(said.since)}: {said.reason}"])


def drain(  # noqa: PLR0913  each is an option of the command line
    by: By,
    lift: Annotated[
        str, typer.Argument(metavar="[LIFT]", help="The lift, by its name in the site file.", show_default=False)
    ] = "",
    *,
    every: Annotated[bool, typer.Option("--all", help="Every lift of the site, instead of one.")] = False,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why; every robot that asks is told.", show_default=False)
    ] = "",
    end: Annotated[bool, typer.Option("--end", help="End the drain: sessions may begin again.")] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Let present sessions end and no new one begin, over restarts too, until somebody ends that with --end."""
    if bool(lift) == every:
        raise typer.BadParameter("name one lift, or all of them with --all", param_hint="LIFT")
    if end and reason:
        raise typer.BadParameter("a drain that ends needs no reason; leave --reason out", param_hint="--reason")
    if not (end or reason.strip()):
        raise typer.BadParameter("say why, in a few words; robots and their people are told", param_hint="--reason")
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    for name in [one.name for one in to.ask(lambda client: client.lifts())] if every else [lift]:
        say([_end_drain(to, name, by) if end else _begin_drain(to, name, by, reason)])


def _begin_drain(to: Speaker, lift: str, by: str, reason: str) -> str:
    begun = to.ask(lambda client: client.begin_drain(lift, by, reason))
    return f"{begun.lift}: no new session begins; drain by {begun.by} since {_shown(begun.since)}: {begun.reason}"


def _end_drain(to: Speaker, lift: str, by: str) -> str:
    ended = to.ask(lambda client: client.end_drain(lift, by))
    was = ended.drain
    return f"{ended.lift}: the drain by {was.by} since {_shown(was.since)} ({was.reason}) is ended by {ended.by}"


def release(  # noqa: PLR0913  each is an option of the command line
    lift: LiftName,
    by: By,
    *,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; it is written down.")],
    now: Now = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """End the session of whoever holds a lift; everything is released, and the car is not moved."""
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    said = to.ask(lambda client: client.force_release(lift, by, reason, now=now))
    say([f"{said.by}, {_shown(said.at)}: {said.text}"])


def _shown(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"
