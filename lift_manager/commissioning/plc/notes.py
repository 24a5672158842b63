"""Writes the header comment of the program: its purpose, and how to connect its arrays on common PLCs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lift_manager.commissioning.plc.cells import BLOCK, Area, areas
from lift_manager.commissioning.plc.requirements import watchdog_s
from register_maps.codec import Codec
from register_maps.words import BIT_TABLES

_REGISTERS = {
    "CODESYS": (
        "Modbus TCP Server Device. Tick `Writable` for the holding registers and map them to the array; tick `Watchdog` "
        "as a second line of defence. (CODESYS Modbus help, Modbus TCP Server Device, General.)"
    ),
    "TwinCAT": (
        "TF6250. Map the array by its name in the Modbus TCP Configurator, at the addresses of this program; as "
        "delivered, GVL arrays begin at 0x8000, which a site says as an offset. (Infosys TF6250, Default Configuration.)"
    ),
    "OpenPLC": (
        "Declare %QW0, %QW1 and so on, copy them into the array, call the block, and copy them back. Where they drive "
        "real outputs take %MW0 up, which are the registers from 1024: a site says that as an offset. (OpenPLC, Modbus "
        "addressing.)"
    ),
    "S7-1200 and S7-1500": (
        "MB_SERVER, with MB_HOLD_REG on a data block in which the array lies from its first word; call it before this "
        "block. Write TP_TIME, TON_TIME and TOF_TIME for TP, TON and TOF. (S7-1200 System Manual, Modbus communication.)"
    ),
}
_BITS = {
    "CODESYS": (
        "Modbus TCP Server Device. Give coils and discrete inputs areas of their own, apart from the registers, and make "
        "sure that the program can write the coils. (CODESYS Modbus help, Modbus TCP Server Device, General.)"
    ),
    "TwinCAT": (
        "TF6250. Map the arrays by their names in the Modbus TCP Configurator, at the addresses of this program; as "
        "delivered, GVL arrays begin at 0x8000, which a site says as an offset. (Infosys TF6250, Default Configuration.)"
    ),
    "OpenPLC, S7-1200 and S7-1500": (
        "Take a map of registers instead. Their Modbus servers put coils on the real outputs and discrete inputs on the "
        "real inputs, past this program. (OpenPLC, Modbus addressing; S7-1200 System Manual, Modbus communication.)"
    ),
}
"""How to connect the arrays on each PLC family, with the source of each statement."""


def header(codec: Codec, floors: Mapping[str, int]) -> Iterator[str]:
    """Yield the header comment of the program line by line, in plain ASCII."""
    listed = ", ".join(f"{n} = {name} (code {code})" for n, (name, code) in enumerate(floors.items(), start=1))
    purpose = (
        f"Robot interface of one lift, for the register map {codec.map.name}. Not a safety component: it does what a "
        "passenger's finger does, in parallel to the buttons, and the lift's own safety circuits stay as they are."
    )
    use_it = (
        f"Declare one instance of {BLOCK} and call it in every cycle, after the Modbus server; a cycle lasts 100 ms at "
        "most. Its inputs and outputs are the PLC's digital ones (%I and %Q), wired as in the wiring sheet. Retain "
        "neither the instance nor the arrays over a restart."
    )
    retained = (
        "Declare ObeyedEpochHigh, ObeyedEpochLow and ObeyedOwner, which are passed in, in retained memory (VAR RETAIN; in TwinCAT VAR "
        "PERSISTENT; in an S7 a data block with retain): without them, after a loss of power the program might obey a manager that was "
        "replaced. Set them to 0 only together with an etcd that begins anew."
    )
    silence = (
        f"When the manager is silent for {watchdog_s(codec):g} s, every output falls and every command cell is cleared. "
        "The program takes commands out of their cells, so it must be able to write where the manager writes."
    )
    arrays = (
        "Each array holds one Modbus table; its index is the address on the wire, counted from 0. Declare yours with the types "
        "below. Where types are objects of their own (CODESYS, TwinCAT), make one of each; where an array type cannot have a "
        "name (S7), write the array itself in its place."
    )
    connected = (f"{name}: {text}" for name, text in platforms(codec).items())
    kept = [] if codec.arbitration is None else [retained]
    paragraphs = [purpose, use_it, *kept, silence, f"Floors, lowest first: {listed}.", arrays, *connected]
    for paragraph in paragraphs:
        yield from _wrapped(paragraph.encode("ascii", "replace").decode().replace("(*", "( *").replace("*)", "* )"))
        yield ""


def platforms(codec: Codec) -> Mapping[str, str]:
    """Return how to connect the arrays, by PLC family."""
    return _BITS if any(area.table in BIT_TABLES for area in areas(codec)) else _REGISTERS


def use(area: Area) -> str:
    """Describe the use of one array."""
    direction = "read and written by the manager" if area.commanded else "read by the manager"
    return f"Modbus {area.table} {area.first} to {area.last} on the wire, {direction}"


def _wrapped(text: str, width: int = 110) -> Iterator[str]:
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > width:
            yield line
            line = word
        else:
            line = f"{line} {word}" if line else word
    yield line
