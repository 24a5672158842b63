"""Checks that a controller which decides whom it obeys can tell whose each write is."""

from __future__ import annotations

from collections.abc import Iterator

from register_maps.check_blocks import arbitration_cells, cells_of
from register_maps.check_claims import signal_bits
from register_maps.errors import Problem
from register_maps.schema import EPOCH_BITS, Arbitration, RegisterMap, Signal
from register_maps.words import WRITABLE_TABLES

_SHOWN = ("epoch", "owner")


def check_arbitration(source: RegisterMap) -> Iterator[Problem]:
    """Yield the problems of `arbitration`, of the signals that belong to it, and of `watchdog_s`."""
    yield from _watchdog(source)
    if (spec := source.arbitration) is None:
        for name in _SHOWN:
            if name in source.signals:
                message = "shows whom the controller obeys, which needs `arbitration`: where each write carries it; give that, or remove it"
                yield Problem(("signals", name), message)
        return
    misplaced = list(_places(source, spec))
    yield from misplaced
    yield from _shown(source)
    if not misplaced:
        yield from _overlaps(source)
        yield from _block(source)


def _places(source: RegisterMap, spec: Arbitration) -> Iterator[Problem]:
    for key in _SHOWN:
        text = getattr(spec, key)
        place = source.place(text)
        if place.table not in WRITABLE_TABLES or place.bit is not None or place.endpoint:
            cure = "give a coil or a whole holding register of the controller itself"
            yield Problem(("arbitration", key), f"{text} cannot carry it; {cure}")


def _shown(source: RegisterMap) -> Iterator[Problem]:
    for name in _SHOWN:
        signal = source.signals.get(name)
        if signal is None:
            message = f"the map has no signal {name}, which shows whom the controller obeys; declare it"
            yield Problem(("arbitration",), message)
        elif name == "epoch" and not _is_32_bits(signal):
            yield Problem(
                ("signals", name), f"has {EPOCH_BITS} bits; give `type: uint32`, or `code_of` with as many bits"
            )


def _is_32_bits(signal: Signal) -> bool:
    return signal.type == "uint32" if signal.code_of is None else len(signal.code_of) == EPOCH_BITS


def _overlaps(source: RegisterMap) -> Iterator[Problem]:
    ours = arbitration_cells(source)
    if len(set(ours)) < len(ours):
        yield Problem(("arbitration",), "epoch and owner overlap; give each a place of its own")
    for name, command in source.commands.items():
        if cells_of(source, command) & set(ours):
            yield Problem(("arbitration",), f"overlaps the command {name}; give it a place of its own")
    for name, signal in source.signals.items():
        cells = {bit[:2] for text in signal.addresses for bit in signal_bits(source, signal, text)}
        if cells & set(ours):
            message = (
                "overlaps epoch or owner as they are written; give the place where the controller shows whom it obeys"
            )
            yield Problem(("signals", name), message)


def _block(source: RegisterMap) -> Iterator[Problem]:
    """Yield a write that does not carry everything: nobody could tell whose it is."""
    needed = {cell for command in source.commands.values() for cell in cells_of(source, command)}
    needed |= set(arbitration_cells(source))
    blocks = [
        {(place.space, place.number + offset) for offset in range(block.count)}
        for block in source.write_blocks
        for place in (source.place(block.at),)
    ]
    if len(blocks) != 1 or not needed <= blocks[0]:
        message = "needs one entry in `write_blocks`, with epoch, owner and every command, so that each write says whose it is"
        yield Problem(("arbitration",), message)


def _watchdog(source: RegisterMap) -> Iterator[Problem]:
    limit_s = source.watchdog_s
    if limit_s is None:
        return
    watched = {name: spec for name, spec in source.commands.items() if spec.on_link_loss == "device_watchdog"}
    if not watched:
        yield Problem(("watchdog_s",), "no command has `on_link_loss: device_watchdog`; remove it")
    for name, spec in watched.items():
        if spec.refresh_s is not None and spec.refresh_s >= limit_s:
            message = f"{name} is written every {spec.refresh_s:g} s, and would fall in between; give it a shorter `refresh_s`"
            yield Problem(("watchdog_s",), message)
