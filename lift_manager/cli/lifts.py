"""`lift-manager lifts`: show the lifts of a running manager."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from typing import Annotated

import typer
from rich.table import Table

from lift_manager.api.lifts import Lift
from lift_manager.cli.common import out, print_lines, print_stderr
from lift_manager.cli.connection import KeyFile, Manager, ManagerConnection
from lift_manager.cli.tls_options import Ca, Certificate, CertificateKey
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.states import States
from lift_manager.lift.state import Quality
from lift_manager.plain.http import MANAGER

FIRST_WITHIN_S = 5.0
"""Chosen: after this long without an answer, a plain request finds out why."""


def lifts(
    *,
    as_json: Annotated[bool, typer.Option("--json", help="For other programs: one lift a line with --follow.")] = False,
    follow: Annotated[bool, typer.Option("--follow", help="Go on, and print each change as it happens.")] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Show the lifts of a running manager.

    Where each car is, its door, its mode and who holds it. Exit code 1 if no manager answers.

    Example: lift-manager lifts --follow
    """
    connection = ManagerConnection(manager, key_file, ca, certificate, certificate_key)
    if follow:
        try:
            connection.run(lambda client: _follow(client, as_json=as_json))
        except KeyboardInterrupt:
            return
    if as_json:
        found = connection.run(lambda client: client.lifts())
        print_lines([json.dumps([lift.model_dump(mode="json") for lift in found], indent=2, ensure_ascii=False)])
    else:
        shown, display_names = connection.run(_read)
        out.print(_table(shown, display_names), highlight=False)
        print_lines(f"{lift.name}: {note}" for lift in shown if (note := _note(lift)))


async def _read(client: LiftManagerClient) -> tuple[Sequence[Lift], Sequence[str]]:
    """Return every lift, and the display names."""
    found = await client.lifts()
    able = await asyncio.gather(*(client.capabilities(lift.name) for lift in found))
    return found, [lift.display_name for lift in able]


async def _follow(client: LiftManagerClient, *, as_json: bool) -> None:
    # fails with one sentence before anything is printed
    await client.lifts()
    async with client.states() as states:
        await _print(states, as_json=as_json)


async def _print(states: States, *, as_json: bool) -> None:
    is_lost = False
    async for lift in states:
        print_lines([lift.model_dump_json() if as_json else _line(lift)])
        if not is_lost and not states.is_current(lift.name):
            print_stderr("the manager does not answer; this continues once it does")
        is_lost = not states.is_current(lift.name)
        await asyncio.sleep(0)


def _table(found: Sequence[Lift], display_names: Sequence[str]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="")
    called = ("called",) if any(display_names) else ()
    for name in ("lift", *called, "floor", "door", "motion", "mode", "held by", "age"):
        table.add_column(name, overflow="fold", no_wrap=name == "lift")
    for lift, display_name in zip(found, display_names, strict=True):
        name, *cells = _cells(lift)
        table.add_row(*map(_plain, (name, *((display_name or "-",) if called else ()), *cells)))
    return table


def _plain(text: str) -> str:
    # text from people may look like markup
    return text.replace("[", r"\[")


def _cells(lift: Lift) -> tuple[str, ...]:
    age = "-" if lift.age_s is None else f"{lift.age_s:.1f} s"
    held = "-" if lift.session is None else _holder_name(lift.session.face, lift.session.name)
    if lift.quality is Quality.OFFLINE:
        return lift.name, "-", "-", "-", "offline", held, age
    doors = ", ".join(f"{side} {door}" for side, door in lift.doors.items()) or "-"
    return lift.name, lift.floor or "-", doors, str(lift.motion), str(lift.mode), held, age


def _note(lift: Lift) -> str:
    restrictions = lift.restrictions
    notes = [
        lift.reason,
        "a fire has yet to be acknowledged" if restrictions.fire_latched else "",
        f"locked out {restrictions.lockout}" if restrictions.lockout else "",
        f"drain {restrictions.drain}" if restrictions.drain else "",
        f"robot {_holder_name(*_split_holder(restrictions.maybe_occupied_by))} may be in the car"
        if restrictions.maybe_occupied_by
        else "",
        f"distrusted: {restrictions.distrusted}" if restrictions.distrusted else "",
        restrictions.waiting_for,
        f"{lift.waiting} waiting" if lift.waiting else "",
    ]
    return "; ".join(note for note in notes if note)


def _holder_name(face: str, name: str) -> str:
    return name if name == face else f"{name} ({face})"


def _split_holder(holder: str) -> tuple[str, str]:
    """Split `face:name` into face and name; a holder without a name is called like its face."""
    face, _, name = holder.partition(":")
    return face, name or face


def _line(lift: Lift) -> str:
    name, floor, door, motion, mode, held, _ = _cells(lift)
    parts = [f"{name}: {mode}"]
    if lift.quality is Quality.LIVE:
        parts += [f"at {floor}", f"door {door}", motion]
    if held != "-":
        parts.append(f"held by {held}")
    note = _note(lift)
    return ", ".join([*parts, note] if note else parts)
