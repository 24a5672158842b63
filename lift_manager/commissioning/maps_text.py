"""One map as text for a terminal of 100 columns: a block of lines per point."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from lift_manager.commissioning.detection import FaultEffect
from lift_manager.commissioning.maps_list import WIDTH
from lift_manager.commissioning.maps_show import CommandSheet, MapSheet, PlaceSheet, SignalSheet, side_by_side
from lift_manager.commissioning.wording import FUNCTIONS, functions


def lines(sheet: MapSheet) -> Iterator[str]:
    """Yield the text, from the head to what is assumed."""
    yield f"{sheet.name}  [{sheet.trust}]"
    yield from textwrap.wrap(sheet.title, WIDTH)
    yield from _facts(_head(sheet))
    yield from _section("SIGNALS: what the lift reports")
    for signal in sheet.signals:
        yield from _block(f"{signal.name}: {signal.meaning}", _signal(signal))
    if not sheet.signals:
        yield "  none: the device has outputs only"
    yield from _section("COMMANDS: what can be written to the lift")
    for command in sheet.commands:
        yield from _block(f"{command.name}: {command.meaning}", _command(command))
    if not sheet.commands:
        yield "  none: this map only looks"
    if sheet.parameters:
        yield from _section("PARAMETERS: what a site sets")
        yield from _facts(_parameters(sheet))
    yield from _section("FAULTS: which ones this map can show")
    yield from _facts(_faults(sheet))
    yield from _section("LINK AND LIMITS")
    yield from _facts(_link(sheet))
    yield from _section("ASSUMED: what the map does not say; compare it with the vendor's table")
    for assumed in sheet.assumed:
        yield from textwrap.wrap(assumed, WIDTH, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)


def _head(sheet: MapSheet) -> Iterator[tuple[str, str]]:
    for source in sheet.sources:
        yield "source", source
    if sheet.notes:
        yield "notes", sheet.notes
    yield "fire", sheet.fire
    for signal, why in sheet.needs.items():
        yield "missing", f"{signal}: {why}"
    if any(signal.name == "car_floor" for signal in sheet.signals):
        yield "at a floor", f"shown by: {sheet.at_floor}"
    if sheet.commands:
        yield "same floor", f"where the car stands already, the door is opened by {sheet.at_same_floor}"
    for caution in sheet.cautions:
        yield "caution", caution
    yield "sha256", sheet.sha256


_EFFECT_TEXTS = {
    FaultEffect.OPEN: "a door may be said to be open that is not",
    FaultEffect.MODE: "robots may be let in, or something be pressed, in a mode without robots",
    FaultEffect.EFFECT: "a command may be said to be confirmed that had no effect",
    FaultEffect.OUTPUT: "an output may be on that nobody has requested there",
}


def _faults(sheet: MapSheet) -> Iterator[tuple[str, str]]:
    """Yield what is dangerous one by one, the worst first, and the rest in one line."""
    unseen = [fault for fault in sheet.faults if fault.within_s is None]
    seen = [fault for fault in sheet.faults if fault.within_s is not None and fault.lies]
    for fault in unseen:
        yield fault.fault, f"UNDETECTABLE: {fault.how}; {'; '.join(_EFFECT_TEXTS[lie] for lie in fault.lies)}"
    for fault in seen:
        until = f"; until it is over, {'; '.join(_EFFECT_TEXTS[lie] for lie in fault.lies)}" if fault.goes_on else ""
        yield fault.fault, f"detected within {fault.within_s:g} s: {fault.how}{until}"
    harmless = ", ".join(fault.fault for fault in sheet.faults if fault not in (*unseen, *seen))
    yield "no wrong word", f"because of {harmless}"


def _link(sheet: MapSheet) -> Iterator[tuple[str, str]]:
    link = sheet.link
    yield "addresses", sheet.addressing
    yield "unit id", str(link["unit_id"])
    for name, about in sheet.endpoints.items():
        yield f"device {name}", about
    for space, ranges in sheet.served.items():
        told = (f"{first} to {last}" if last > first else f"{first}" for first, last in ranges)
        yield f"serves {space}", f"{', '.join(told)} (on the wire)"
    for block in sheet.write_blocks:
        yield "block", block
    yield "reads", f"at most {link['max_registers_per_read']} registers or {link['max_bits_per_read']} bits per request"
    yield (
        "writes",
        f"at most {link['max_registers_per_write']} registers or {link['max_bits_per_write']} bits per request",
    )
    yield "times", "; ".join(_times(sheet))
    if link["max_connections"] is not None:
        yield "connections", f"the device serves {link['max_connections']} at once; the manager uses one"
    if not link["tid_echo"]:
        yield "answers", "do not repeat the transaction id of the request"


def _times(sheet: MapSheet) -> Iterator[str]:
    link = sheet.link
    yield f"an answer is awaited for {link['timeout_s']:g} s"
    if link["min_gap_s"]:
        yield f"{link['min_gap_s']:g} s between two requests"
    if link["min_poll_s"]:
        yield f"at least {link['min_poll_s']:g} s from poll to poll"
    yield f"a lift without a reading for {link['max_age_s']:g} s counts as offline"
    if link["idle_timeout_s"] is not None:
        yield f"a connection without a request for {link['idle_timeout_s']:g} s is closed by the device"
    yield f"at least {link['reconnect_min_s']:g} s from one connection to the next"


def _signal(signal: SignalSheet) -> Iterator[str]:
    used = ", ".join(f"FC{number:02} ({FUNCTIONS[number]})" for number in signal.read_functions)
    yield from _where(signal.places, used)
    yield signal.coding
    if signal.note:
        yield f"note: {signal.note}"


def _command(command: CommandSheet) -> Iterator[str]:
    used = ", ".join(f"FC{number:02} ({FUNCTIONS[number]})" for number in command.write_functions)
    same = command.read_back == command.places
    back = f", read back with {functions(command.read_functions)}" if same else ""
    yield from _where(command.places, used + back)
    if command.read_back and not same:
        yield from (f"read back: {text}" for text in _where(command.read_back, functions(command.read_functions)))
    yield command.coding
    yield command.action
    if command.conditions:
        yield command.conditions
    if command.confirmed_by:
        yield f"proof: {command.confirmed_by}"
    if command.arrive_within_s is not None:
        yield f"the car must be there within {command.arrive_within_s:g} s"
    yield f"when the link is lost: {command.on_link_loss}"
    if command.shared_word:
        yield command.shared_word
    if command.note:
        yield f"note: {command.note}"


def _where(places: Sequence[PlaceSheet], used: str) -> Iterator[str]:
    for printed, wire in side_by_side(places):
        yield f"{printed}   on the wire: {wire}   {used}"


def _parameters(sheet: MapSheet) -> Iterator[tuple[str, str]]:
    for parameter in sheet.parameters:
        value = "EVERY SITE MUST SET IT; here" if parameter.must_be_set else "default"
        allowed = f" ({parameter.allowed})" if parameter.allowed else ""
        yield parameter.name, f"{value} {parameter.value}{allowed}: {parameter.help}"


def _section(heading: str) -> Iterator[str]:
    yield ""
    yield heading


def _block(first: str, rest: Iterable[str]) -> Iterator[str]:
    yield from textwrap.wrap(first, WIDTH, initial_indent="  ", subsequent_indent="    ")
    for text in rest:
        yield from textwrap.wrap(
            text, WIDTH, initial_indent="      ", subsequent_indent="        ", break_on_hyphens=False
        )


def _facts(facts: Iterator[tuple[str, str]]) -> Iterator[str]:
    told = list(facts)
    column = max((len(name) for name, _ in told), default=0) + 2
    for name, text in told:
        yield from textwrap.wrap(
            text,
            WIDTH,
            initial_indent=f"  {name:{column}}",
            subsequent_indent=" " * (column + 2),
            break_on_hyphens=False,
        )
