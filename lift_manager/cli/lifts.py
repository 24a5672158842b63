"""`lift-manager lifts`: how the lifts of a running manager are."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from typing import Annotated

import typer
from rich.table import Table

from lift_manager.api.lifts import Lift
from lift_manager.cli.common import out, say, say_aside
from lift_manager.cli.secured import Ca, Certificate, CertificateKey
from lift_manager.cli.speaking import MANAGER, KeyFile, Manager, Speaker
from lift_manager.client.client import LiftManagerClient
from lift_manager.client.states import States
from lift_manager.lift.state import Quality

FIRST_WITHIN_S = 5.0
"""Chosen: a manager that says nothing for so long is asked once more in the plain way, which says why."""


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
    """Show the lifts of a running manager: where each is, its door, its mode and who holds it. Exit code 1 where no manager answers."""
    to = Speaker(manager, key_file, ca, certificate, certificate_key)
    if follow:
        try:
            to.ask(lambda client: _follow(client, as_json=as_json))
        except KeyboardInterrupt:
            return
    if as_json:
        found = to.ask(lambda client: client.lifts())
        say([json.dumps([lift.model_dump(mode="json") for lift in found], indent=2, ensure_ascii=False)])
    else:
        out.print(_table(*to.ask(_read)), highlight=False)


async def _read(client: LiftManagerClient) -> tuple[Sequence[Lift], Sequence[str]]:
    """Return every lift, and what people call each."""
    found = await client.lifts()
    able = await asyncio.gather(*(client.capabilities(lift.name) for lift in found))
    return found, [lift.display_name for lift in able]


async def _follow(client: LiftManagerClient, *, as_json: bool) -> None:
    # says in one sentence why it cannot, before anything is printed
    await client.lifts()
    async with client.states() as states:
        await _print(states, as_json=as_json)


async def _print(states: States, *, as_json: bool) -> None:
    silent = False
    async for lift in states:
        say([lift.model_dump_json() if as_json else _line(lift)])
        if not silent and not states.is_current(lift.name):
            say_aside("the manager is not heard; this goes on by itself once it is")
        silent = not states.is_current(lift.name)
        await asyncio.sleep(0)


def _table(found: Sequence[Lift], display_names: Sequence[str]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="")
    called = ("called",) if any(display_names) else ()
    for name in ("lift", *called, "floor", "door", "motion", "mode", "held by", "age", "note"):
        table.add_column(name, overflow="fold", no_wrap=name == "lift")
    for lift, display_name in zip(found, display_names, strict=True):
        name, *cells = _cells(lift)
        table.add_row(*map(_plain, (name, *((display_name or "-",) if called else ()), *cells)))
    return table


def _plain(text: str) -> str:
    # what a person wrote may look like markup
    return text.replace("[", r"\[")


def _cells(lift: Lift) -> tuple[str, ...]:
    age = "-" if lift.age_s is None else f"{lift.age_s:.1f} s"
    held = "-" if lift.session is None else _who(lift.session.face, lift.session.name)
    if lift.quality is Quality.OFFLINE:
        return lift.name, "-", "-", "-", "offline", held, age, _note(lift)
    doors = ", ".join(f"{side} {door}" for side, door in lift.doors.items()) or "-"
    return lift.name, lift.floor or "-", doors, str(lift.motion), str(lift.mode), held, age, _note(lift)


def _note(lift: Lift) -> str:
    told = lift.restrictions
    notes = [
        lift.reason,
        "a fire has yet to be acknowledged" if told.fire_latched else "",
        f"locked out {told.lockout}" if told.lockout else "",
        f"drain {told.drain}" if told.drain else "",
        f"robot {_who(*_parted(told.maybe_occupied_by))} may be in the car" if told.maybe_occupied_by else "",
        f"distrusted: {told.distrusted}" if told.distrusted else "",
        told.waiting_for,
        f"{lift.waiting} waiting" if lift.waiting else "",
    ]
    return "; ".join(note for note in notes if note)


def _who(face: str, name: str) -> str:
    return name if name == face else f"{name} ({face})"


def _parted(holder: str) -> tuple[str, str]:
    """Return face and name of `face:name`; who has but one name is called by it."""
    face, _, name = holder.partition(":")
    return face, name or face


def _line(lift: Lift) -> str:
    name, floor, door, motion, mode, held, _, note = _cells(lift)
    parts = [f"{name}: {mode}"]
    if lift.quality is Quality.LIVE:
        parts += [f"at {floor}", f"door {door}", motion]
    if held != "-":
        parts.append(f"held by {held}")
    return ", ".join([*parts, note] if note else parts)
