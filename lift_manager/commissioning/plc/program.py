"""Writes the program for the PLC of a lift company: Structured Text (IEC 61131-3) and its wiring sheet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from lift_manager.commissioning.plc import arbitration, cells, notes, requirements
from lift_manager.commissioning.plc.commands import command_part
from lift_manager.commissioning.plc.signals import Part, signal_part
from lift_manager.commissioning.plc.terminals import Terminal, inputs, outputs
from lift_manager.commissioning.plc.wiring import wiring_sheet
from register_maps.codec import Codec, compile_map
from register_maps.schema import RegisterMap


@dataclass(frozen=True, slots=True)
class PlcProgram:
    """One program and its wiring sheet."""

    st: str
    """Structured Text, plain ASCII."""
    wiring: str
    """Markdown."""


def render(source: RegisterMap, floors: Mapping[str, int]) -> PlcProgram:
    """Return the program for a checked map; `floors` are names with their codes, lowest floor first.

    Raises ProgramError for a map that is not generic, or that requires something that the program cannot do.
    """
    requirements.check_name(source)
    codec = compile_map(source)
    requirements.check(codec, floors)
    return PlcProgram(structured_text(codec, floors), wiring_sheet(codec, floors))


def structured_text(codec: Codec, floors: Mapping[str, int]) -> str:
    """Return the function block for a compiled map that `requirements.check` has accepted."""
    codes, names = tuple(floors.values()), tuple(floors)
    sections = [*command_part(codec, codes), ("What the manager reads.", _joined(signal_part(codec, codes)))]
    lines = [
        "(*",
        *(f"  {line}".rstrip() for line in notes.header(codec, floors)),
        "*)",
        # one block for each type: TwinCAT accepts no more
        *(line for area in cells.areas(codec) for line in ("TYPE", f"  {area.type_declaration}", "END_TYPE", "")),
        f"FUNCTION_BLOCK {cells.BLOCK}",
        *_passed_in(codec),
        *_variables("VAR_INPUT", map(_declared, inputs(codec, names))),
        *_variables("VAR_OUTPUT", map(_declared, outputs(codec, names))),
        *_variables("VAR", (line for _, part in sections for line in part.declarations)),
    ]
    for number, (heading, part) in enumerate(sections, start=1):
        lines += ["", cells.comment(f"{number}. {heading}"), *part.statements]
    return "\n".join([*lines, "END_FUNCTION_BLOCK", ""])


def _passed_in(codec: Codec) -> Iterator[str]:
    """Yield the declaration of one array per table, and of what is retained.

    The program writes to all of them, as it also clears commands.
    """
    declared = [f"{area.declaration}  {cells.comment(notes.use(area))}" for area in cells.areas(codec)]
    yield from _variables("VAR_IN_OUT", [*declared, *(arbitration.retained() if codec.arbitration else ())])


def _declared(terminal: Terminal) -> str:
    return f"{terminal.name} : BOOL;  {cells.comment(f'{terminal.contact}, {terminal.wire_to}: {terminal.when_on}')}"


def _variables(kind: str, declarations: Iterable[str]) -> Iterator[str]:
    yield kind
    yield from (f"  {line}" for line in declarations)
    yield "END_VAR"


def _joined(parts: Iterable[Part]) -> Part:
    given: Sequence[Part] = tuple(parts)
    return Part(
        tuple(line for part in given for line in part.declarations),
        tuple(line for part in given for line in part.statements),
    )
