"""`lift-manager ack`, `lockout`, `drain` and `release`: actions of people at a running manager."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer

from lift_manager.cli.common import print_lines
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.lift.events import Cause
from lift_manager.plain.http import MANAGER

LiftName = Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is recorded with the action.")]

Now = Annotated[
    bool,
    typer.Option(
        "--now", help="Release a held door at once, though a robot may be in the doorway; otherwise after `clear_s`."
    ),
]

ReasonForRobots = Annotated[
    str, typer.Option("--reason", metavar="TEXT", help="The reason; every refused robot gets it.", show_default=False)
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
    """Acknowledge that a lift was checked.

    It was checked after a fire, no robot is in its car, or its signals may be trusted again. The manager then accepts robots.

    Example: lift-manager ack main --by "M. Weber"
    """
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    result = connection.run(lambda client: client.acknowledge(lift, by))
    causes = {
        Cause.FIRE: "the fire",
        Cause.OCCUPIED: "that no robot is in the car",
        Cause.CONTRADICTION: "that its signals may be trusted",
    }
    what = " and ".join(causes[cause] for cause in result.acknowledged)
    print_lines([f"{result.lift}: {result.by} acknowledged {what}, {_shown(result.at)}; robots are taken again"])


def lockout(  # noqa: PLR0913  each is an option of the command line
    lift: LiftName,
    by: By,
    *,
    reason: ReasonForRobots = "",
    end: Annotated[bool, typer.Option("--end", help="End the lockout: robots may command the lift again.")] = False,
    now: Now = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Keep robots off a lift.

    The lockout outlasts a restart, and ends with --end.

    Example: lift-manager lockout main --by "M. Weber" --reason "cleaning the car"
    """
    _check_reason("lockout", reason, end=end)
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    if end:
        ended = connection.run(lambda client: client.end_lockout(lift, by))
        was = ended.lockout
        print_lines(
            [f"{ended.lift}: the lockout by {was.by} since {_shown(was.since)} ({was.reason}) is ended by {ended.by}"]
        )
        return
    result = connection.run(lambda client: client.lock_out(lift, by, reason, now=now))
    print_lines([f"{result.lift}: locked out by {result.by} since {_shown(result.since)}: {result.reason}"])


def drain(  # noqa: PLR0913  each is an option of the command line
    by: By,
    lift: Annotated[
        str, typer.Argument(metavar="[LIFT]", help="The lift, by its name in the site file.", show_default=False)
    ] = "",
    *,
    all_lifts: Annotated[bool, typer.Option("--all", help="Every lift of the site, instead of one.")] = False,
    reason: ReasonForRobots = "",
    end: Annotated[bool, typer.Option("--end", help="End the drain: sessions may begin again.")] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Let present sessions end and no new one begin.

    The drain outlasts a restart, and ends with --end.

    Example: lift-manager drain --all --by "M. Weber" --reason "update at noon"
    """
    if bool(lift) == all_lifts:
        raise typer.BadParameter("name one lift, or all of them with --all", param_hint="LIFT")
    _check_reason("drain", reason, end=end)
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    for name in [one.name for one in connection.run(lambda client: client.lifts())] if all_lifts else [lift]:
        print_lines([_end_drain(connection, name, by) if end else _begin_drain(connection, name, by, reason)])


def _check_reason(what: str, reason: str, *, end: bool) -> None:
    """Raise typer.BadParameter unless there is a reason to begin, and none to end."""
    if end and reason:
        raise typer.BadParameter(f"a {what} that ends needs no reason; leave --reason out", param_hint="--reason")
    if not (end or reason.strip()):
        raise typer.BadParameter(
            "give the reason in a few words; robots and their operators see it", param_hint="--reason"
        )


def _begin_drain(connection: ManagerConnection, lift: str, by: str, reason: str) -> str:
    begun = connection.run(lambda client: client.begin_drain(lift, by, reason))
    return f"{begun.lift}: no new session begins; drain by {begun.by} since {_shown(begun.since)}: {begun.reason}"


def _end_drain(connection: ManagerConnection, lift: str, by: str) -> str:
    ended = connection.run(lambda client: client.end_drain(lift, by))
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
    """End the session that holds a lift.

    Everything is released, and the car does not move.

    Example: lift-manager release main --by "M. Weber" --reason "robot is out of battery"
    """
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    result = connection.run(lambda client: client.force_release(lift, by, reason, now=now))
    print_lines([f"{result.by}, {_shown(result.at)}: {result.text}"])


def _shown(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"
