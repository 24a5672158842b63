"""Writes the half of the program that carries out commands: from the cells that the manager writes to the buttons of the lift.

A rewritten 1 looks the same as an old one, so the program detects a refresh only if it clears the cell after reading it. It clears the
request for robot mode at once and takes each one as the manager's sign of life. Where each write carries a claim, it takes that out
instead (`arbitration.py`): each write that counts renews everything that it says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lift_manager.commissioning.plc import cells
from lift_manager.commissioning.plc.arbitration import claim_part, keep_part
from lift_manager.commissioning.plc.requirements import watchdog_s
from lift_manager.commissioning.plc.signals import Part
from lift_manager.commissioning.plc.terminals import GUARDS
from register_maps.codec import Codec, CommandCodec


def command_part(codec: Codec, floor_codes: Sequence[int]) -> Iterator[tuple[str, Part]]:
    """Yield the parts that carry out the commands of the map, each with a heading."""
    if codec.arbitration is not None:
        yield (
            "Which manager counts: that of the highest epoch so far. Any other write is undone.",
            claim_part(codec, codec.arbitration),
        )
    yield "May robots use the lift at all? A broken wire reads as no.", _guards()
    if codec.arbitration is None:
        yield (
            "The request for robot mode is the manager's sign of life; each one counts for a while.",
            _robot_mode(codec),
        )
    else:
        yield "Each write that counts is the manager's sign of life, for a while.", _robot_mode_of_claims(codec)
    hold = codec.commands.get("hold_door.front")
    if hold is not None:
        yield (
            "Door hold: as long as it is written, and never longer than its limit without being written again.",
            _hold(codec) if codec.arbitration is None else _hold_of_claims(codec),
        )
    close = codec.commands.get("close_door.front")
    if close is not None:
        yield "Close button: one press, never against a hold or an obstruction.", _close(codec, close)
    yield "Calls: one press per call, however long the manager leaves it there.", _calls(codec, floor_codes)
    yield "Without robot mode no command is kept.", _clear(codec)
    if codec.arbitration is not None:
        yield "What counts until the next write.", keep_part(codec)


def _guards() -> Part:
    return Part(("MayRun : BOOL;",), (f"MayRun := {' AND '.join(GUARDS)};",))


def _robot_mode(codec: Codec) -> Part:
    command = codec.commands["robot_mode"]
    return Part(
        ("Requested : BOOL;", "Kept : TOF;", "RobotModeOn : BOOL;"),
        (
            f"Requested := {_is_pressed(command)};",
            "IF Requested THEN",
            *_indented(cells.assign(command.encode(None))),
            "END_IF;",
            f"Kept(IN := Requested, PT := {cells.seconds(watchdog_s(codec))});",
            "RobotMode := Kept.Q AND MayRun;",
            "RobotModeOn := RobotMode AND RobotModeGranted;",
        ),
    )


def _robot_mode_of_claims(codec: Codec) -> Part:
    command = codec.commands["robot_mode"]
    return Part(
        ("Alive : TOF;", "RobotModeOn : BOOL;"),
        (
            f"Alive(IN := Obeyed, PT := {cells.seconds(watchdog_s(codec))});",
            f"RobotMode := Alive.Q AND MayRun AND {_is_pressed(command)};",
            "RobotModeOn := RobotMode AND RobotModeGranted;",
        ),
    )


def _hold_of_claims(codec: Codec) -> Part:
    command = codec.commands["hold_door.front"]
    return Part((), (f"DoorOpenButton := {_allowed(command)} AND {_is_pressed(command)};",))


def _hold(codec: Codec) -> Part:
    """Return the part that clears the hold before its limit: a manager that still needs it writes it again in time."""
    command = codec.commands["hold_door.front"]
    rest_s = watchdog_s(codec)
    return Part(
        ("HoldRequested : BOOL;", "HoldTaken : BOOL;", "HoldAge : TON;", "HoldRest : TON;"),
        (
            f"HoldRequested := {_allowed(command)} AND {_is_pressed(command)};",
            "IF HoldRequested OR NOT RobotMode THEN HoldTaken := FALSE; END_IF;",
            f"HoldAge(IN := HoldRequested, PT := {cells.seconds(command.spec.cleared_after_s or 0.0)});",
            "IF HoldAge.Q THEN",
            "  HoldTaken := TRUE;",
            *_indented(cells.assign(command.encode(None))),
            "END_IF;",
            f"HoldRest(IN := HoldTaken, PT := {cells.seconds(rest_s)});",
            f"DoorOpenButton := {_allowed(command)} AND (HoldRequested OR (HoldTaken AND NOT HoldRest.Q));",
        ),
    )


def _close(codec: Codec, command: CommandCodec) -> Part:
    free = [_allowed(command)]
    free += ["NOT DoorOpenButton"] if "hold_door.front" in codec.commands else []
    free += ["DoorwayClear"] if "obstruction.front" in codec.signals else []
    return Part(
        ("CloseEdge : R_TRIG;", "ClosePress : TP;", "MayClose : BOOL;"),
        (
            f"MayClose := {' AND '.join(free)};",
            f"CloseEdge(CLK := {_is_pressed(command)});",
            f"ClosePress(IN := CloseEdge.Q AND MayClose, PT := {cells.seconds(command.spec.width_s or 0.0)});",
            "DoorCloseButton := ClosePress.Q AND MayClose;",
        ),
    )


def _calls(codec: Codec, floor_codes: Sequence[int]) -> Part:
    command = codec.commands["go_to"]
    width = cells.seconds(command.spec.width_s or 0.0)
    declarations = ["MayCall : BOOL;", "CalledLast : INT;  (* the floor called last; 0 = none *)"]
    statements = [f"MayCall := {_allowed(command)};"]
    alone = ""
    if len(command.points) > 1:
        alone = " AND (CallsTogether = 1)"
        declarations.append("CallsTogether : INT;  (* several at once are no call *)")
        statements.append("CallsTogether := 0;")
        for point in command.points:
            bit = cells.cell(point)
            statements.append(f"IF {bit} THEN CallsTogether := CallsTogether + 1; END_IF;")
    for number, code in enumerate(floor_codes, start=1):
        declarations += [f"Edge{number} : R_TRIG;", f"Press{number} : TP;"]
        statements += [
            f"Edge{number}(CLK := {_is_pressed(command, code)}{alone});",
            f"IF Edge{number}.Q AND MayCall THEN CalledLast := {number}; END_IF;",
            f"Press{number}(IN := Edge{number}.Q AND MayCall, PT := {width});",
            f"CallButton{number} := Press{number}.Q AND MayCall;",
        ]
    return Part(tuple(declarations), tuple(statements))


def _clear(codec: Codec) -> Part:
    statements = [line for command in codec.commands.values() for line in cells.assign(command.encode(None))]
    return Part((), ("IF NOT RobotMode THEN", "  CalledLast := 0;", *_indented(statements), "END_IF;"))


def _allowed(command: CommandCodec) -> str:
    """Return the condition for obeying a command. What a map requires besides robot mode is already part of `MayRun`."""
    return "RobotModeOn" if "robot_mode_on" in command.spec.requires else "RobotMode"


def _is_pressed(command: CommandCodec, code: int | None = 1) -> str:
    """Return the condition that the cell of a command has its pressed value; the code matters only for `go_to`."""
    pressed, rest = command.encode(code), command.encode(None)
    return " AND ".join(cells.is_value(point, raw) for point, raw in pressed.items() if raw != rest[point])


def _indented(lines: Iterator[str] | Sequence[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)
