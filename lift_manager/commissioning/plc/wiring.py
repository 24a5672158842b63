"""Writes the wiring sheet: which contact is wired to which variable, and the Modbus address that shows or commands it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from lift_manager.commissioning.plc.cells import areas
from lift_manager.commissioning.plc.notes import platforms, use
from lift_manager.commissioning.plc.requirements import watchdog_s
from lift_manager.commissioning.plc.terminals import Contact, Terminal, inputs, outputs
from register_maps.codec import Codec, CommandCodec, SignalCodec
from register_maps.schema import Command, Kind, Signal
from register_maps.words import BIT_TABLES, READ_FUNCTION


def wiring_sheet(codec: Codec, floors: Mapping[str, int]) -> str:
    """Return the sheet as Markdown, for a compiled map that `requirements.check` has accepted."""
    names = tuple(floors)
    lines = [
        f"# Wiring sheet: {codec.map.name}",
        "",
        f"{codec.map.title}. Modbus/TCP, unit id {codec.map.link.unit_id}.",
        "Printed addresses are those of the map; addresses on the wire are counted from 0.",
        "",
        "## Inputs",
        "",
        "NC contacts are closed while all is well; a broken wire then says the opposite.",
        "",
        *_table(
            ("variable", "wire to", "contact", "TRUE means", "broken wire reads as", "reported at"),
            (_input(codec, terminal) for terminal in inputs(codec, names)),
        ),
        "",
        "## Outputs",
        "",
        "Dry contacts of relays. They fall when the PLC stops, and a fallen output is a finger taken off its button.",
        "",
        *_table(
            ("variable", "wire to", "contact", "TRUE means", "broken wire means", "commanded at"),
            (_output(codec, terminal) for terminal in outputs(codec, names)),
        ),
        "",
        "## Floors",
        "",
        *_table(
            ("number", "floor", "code"),
            ((str(n), name, str(code)) for n, (name, code) in enumerate(floors.items(), start=1)),
        ),
        "",
        "## Modbus",
        "",
        *_table(("name", "printed", "on the wire", "functions", "meaning"), _points(codec)),
        "",
        "## Where the arrays are connected",
        "",
        *(f"- `{area.declaration}`, `{area.type_declaration}` {use(area)}." for area in areas(codec)),
        *(f"- {name}: {text}" for name, text in platforms(codec).items()),
        "",
        "## To be tried before the first robot",
        "",
        *(f"{number}. {line}" for number, line in enumerate(_trials(codec), start=1)),
        "",
    ]
    return "\n".join(lines)


def _input(codec: Codec, terminal: Terminal) -> tuple[str, ...]:
    signal = codec.signals.get(terminal.shows or "")
    address = "not reported; taken into account" if signal is None else _printed(codec, signal)
    return (terminal.name, terminal.wire_to, terminal.contact, terminal.when_on, terminal.when_cut, address)


def _output(codec: Codec, terminal: Terminal) -> tuple[str, ...]:
    command = codec.commands[terminal.shows or ""]
    return (
        terminal.name,
        terminal.wire_to,
        Contact.NO,
        terminal.when_on,
        terminal.when_cut,
        _printed(codec, command),
    )


def _printed(codec: Codec, part: SignalCodec | CommandCodec) -> str:
    spec = codec.map.signals[part.name] if isinstance(part, SignalCodec) else part.spec
    addresses = spec.addresses
    return addresses[0] if len(addresses) == 1 else f"{addresses[0]} to {addresses[-1]}"


def _points(codec: Codec) -> Iterator[tuple[str, ...]]:
    for signal in codec.signals.values():
        function = f"FC{READ_FUNCTION[signal.points[0].table]:02}"
        yield (signal.name, _printed(codec, signal), _wire(signal), function, _meaning(codec, signal))
    if (claim := codec.map.arbitration) is not None and codec.arbitration is not None:
        for name, address, points in (
            ("owner of a write", claim.owner, codec.arbitration.owner),
            ("epoch of a write", claim.epoch, codec.arbitration.epoch),
        ):
            table, places = points[0].table, sorted(point.address for point in points)
            last = "" if len(places) == 1 else f" to {places[-1]}"
            functions = f"FC{codec.written[0][1]:02}, FC{READ_FUNCTION[table]:02}"
            yield (
                name,
                address,
                f"{places[0]}{last}",
                functions,
                "written with every command, and taken out by the program",
            )
    for command in codec.commands.values():
        read = READ_FUNCTION[command.points[0].table]
        functions = ", ".join(dict.fromkeys(f"FC{number:02}" for number in (*command.functions, read)))
        yield (command.name, _printed(codec, command), _wire(command), functions, _order(command))


def _wire(part: SignalCodec | CommandCodec) -> str:
    first, last = part.points[0], part.points[-1]
    if first.table in BIT_TABLES or first.width == 16:
        return str(first.address) if first == last else f"{first.address} to {last.address}"
    return f"{first.address} bit {first.low}" + ("" if first.width == 1 else f" to {first.low + first.width - 1}")


def _meaning(codec: Codec, signal: SignalCodec) -> str:
    spec = codec.map.signals[signal.name]
    if spec.values is not None:
        return ", ".join([*(f"{code} = {word}" for code, word in spec.values.items()), *_bytes(spec)])
    special = [f"{code} = {word}" for word, codes in (("unknown", spec.unknown), ("none", spec.none)) for code in codes]
    if spec.as_ is not None:
        coded = ["the code of a floor", *(["in BCD"] if spec.code == "bcd" else []), *_bytes(spec)]
        return ", ".join([*coded, *special])
    if signal.kind is Kind.NUMBER:
        return {"epoch": "the highest epoch that was obeyed", "owner": "the machine whose it is"}[signal.name]
    if spec.active == "low":
        return f"0 = {signal.name}"
    return {"floor": "one bit per floor", "counter": "counts up", "flag": f"1 = {signal.name}"}.get(
        signal.kind, "one bit per contact"
    )


def _bytes(spec: Signal | Command) -> list[str]:
    return ["low byte first"] if spec.byte_order == "low_first" else []


def _order(command: CommandCodec) -> str:
    spec = command.spec
    what = (
        ", ".join(["the code of a floor", *(["in BCD"] if spec.code == "bcd" else []), *_bytes(spec)])
        if spec.as_ is not None
        else "one bit per floor"
        if len(command.points) > 1
        else f"{spec.on} = {command.name}"
    )
    if spec.action == "pulse":
        return f"{what}; a press of {spec.width_s:g} s, then {spec.rest}"
    again = "" if spec.refresh_s is None else f", written again every {spec.refresh_s:g} s"
    return f"{what}; held{again}; {spec.rest} releases it"


def _trials(codec: Codec) -> Iterator[str]:
    yield "Pull the wire of NoFire: the manager shows fire, all outputs fall, all command cells read 0."
    yield "Turn the key RobotsAllowed off: robot mode ends, and a call does nothing."
    yield f"Pull the network cable in robot mode: after {watchdog_s(codec):g} s all outputs have fallen."
    yield "Call each floor once: its lamp lights once, however long the call is left standing."
    if codec.arbitration is not None:
        yield "Switch the PLC off and on: it shows the same epoch and owner as before."
        yield "Let the other manager take over (`lift-manager handover`): the epoch rises by one, and no output falls."
    alive = codec.signals.get("alive")
    if alive is not None:
        limit_s = codec.map.signals["alive"].must_change_within_s
        yield f"Stop the PLC: every relay falls, and the manager reports the lift lost within {limit_s:g} s."
    else:
        yield (
            "Stop the PLC: every relay falls, and its Modbus server no longer answers, or serves zeros. If it keeps the "
            "last bits, nobody can tell a stopped program from a standing lift: take the map with an alive counter instead."
        )


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    for row in (head, ("---",) * len(head), *rows):
        yield "| " + " | ".join(" ".join(text.replace("|", "/").split()) for text in row) + " |"
