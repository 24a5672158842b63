"""Describes the commands of a lift, and the trial of one, in the words of an electrician."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from lift_manager.api.lifts import LiftCommand, LiftCommands, PlannedWrite, PlannedWrites
from lift_manager.commissioning.poke.trial import ROBOT_MODE, Trial
from lift_manager.commissioning.wording import LINK_LOSS, functions, press_text
from lift_manager.lift.commands import CommandType

WIDTH = 78
"""Chosen: fits a terminal of 80 columns."""
_REQUESTS = {
    CommandType.GO_TO: "call the car to {floor}",
    CommandType.HOLD_DOOR: "hold the door",
    CommandType.RELEASE_DOOR: "release the door",
    CommandType.CLOSE_DOOR: "press the close button",
    CommandType.ROBOT_IN_PLACE: "report that a robot is in place",
    CommandType.ROBOT_LEFT: "report that no robot is in the car or the doorway",
}


def command_lines(found: LiftCommands) -> Iterator[str]:
    """List every command of a lift: how to name it, where it is, what it does, what ends it."""
    for command in found.commands:
        yield f"{command.name} FLOOR" if command.takes_floor else command.name
        yield from _indented(f"{command.meaning}; {_ending(command)}")
        yield from _indented(f"{_places(command.addresses)}; on the wire {_places(command.wire)}")
        if command.requires:
            yield from _indented(f"only while {' and '.join(command.requires)} {_reads(command.requires)} yes")


def trial_lines(trial: Trial, writes: PlannedWrites, hold_s: float) -> Iterator[str]:
    """Show what a trial writes, and what ends it."""
    yield from textwrap.wrap(f"{trial.lift}: {trial}: {trial.command.meaning}", WIDTH)
    yield from textwrap.wrap(f"A session requests: {_requests(trial)}.", WIDTH)
    yield "It writes:"
    for write in writes.writes:
        yield from _write_lines(write)
    yield "Bytes: unit, function and data. In words: addresses on the wire, from 0."
    if any(write.is_read_first for write in writes.writes):
        yield "Others write bits of these registers: they are read first, and kept as found."
    for command in trial.pressed:
        text = f"{command.name}: {_ending(command)}"
        if command is trial.command and trial.is_held:
            text += f"; released here after {hold_s:g} s"
        elif command.name == ROBOT_MODE:
            text += "; released at the end"
        yield from textwrap.wrap(text, WIDTH, subsequent_indent="  ")


def latching_lines(trial: Trial) -> Iterator[str]:
    """Say what would stay on, and who has to be there; nothing where nothing would."""
    for command in trial.latching:
        yield from textwrap.wrap(
            f"WARNING: if this computer, its cable or its battery fails while {command.name} is on,"
            f" {_places(command.addresses)} STAYS ON and nothing releases it; a closed lid is enough. The lift technician has to stand at"
            " the panel of the controller, and switch it off there.",
            WIDTH,
        )


def _write_lines(write: PlannedWrite) -> Iterator[str]:
    what = {"reset": "rest value of"}.get(write.what, write.what)
    yield from textwrap.wrap(
        f"  {what} {write.name} at {_places(write.addresses)}: {functions([write.function])} {write.text}",
        WIDTH,
        subsequent_indent="    ",
    )
    yield f"    {bytes.fromhex(write.frame).hex(' ').upper()}"


def _requests(trial: Trial) -> str:
    if not trial.requests:
        return "nothing; it has robot mode on as long as it lasts"
    asked = [_REQUESTS[one.kind].format(floor=one.floor) for one in trial.requests]
    if trial.here:
        asked[0] += ", where it stands"
    return ", then ".join(asked)


def _ending(command: LiftCommand) -> str:
    if command.action not in ("pulse", "hold"):
        return "written all the time while a manager may write; there is nothing to press"
    is_hold = command.action == "hold"
    parts = [
        press_text(
            is_hold=is_hold,
            ends_itself=command.ends_itself,
            width_s=command.width_s,
            max_hold_s=command.max_hold_s,
            until=command.until,
        )
    ]
    if is_hold and command.refresh_s is not None:
        parts.append(f"written again every {command.refresh_s:g} s")
    if not is_hold and not command.ends_itself:
        parts.append("if this computer is lost meanwhile: STAYS ON until a manager is back")
    if command.on_link_loss:
        parts.append(f"if this computer is lost: {LINK_LOSS[command.on_link_loss]}")
    return "; ".join(parts)


def _places(places: tuple[str, ...]) -> str:
    return ", ".join(places) if len(places) < 4 else f"{places[0]} to {places[-1]}"


def _reads(flags: tuple[str, ...]) -> str:
    return "reads" if len(flags) == 1 else "read"


def _indented(text: str) -> Iterator[str]:
    yield from textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="    ")
