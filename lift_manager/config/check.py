"""What only makes sense across the fields of a site file and the maps it names. Every problem at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from lift_manager.config.site import Controller, Lift, Site
from register_maps.codec import Codec, Point, SignalCodec, compile_map
from register_maps.schema import RegisterMap

Key = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: where it is in the site file, and how to mend it."""

    key: Key
    message: str


def check_site(site: Site, maps: Mapping[str, RegisterMap]) -> list[Problem]:
    """Return every problem; `maps` holds the map of each controller whose map could be read."""
    problems = list(_controllers(site))
    for name, lift in site.lifts.items():
        key: Key = ("lifts", name)
        if lift.controller not in site.controllers:
            problems.append(Problem((*key, "controller"), no_controller(lift.controller, site.controllers)))
            continue
        if lift.controller in maps:
            problems += _lift(key, lift, site.controllers[lift.controller], maps[lift.controller])
    problems += _shared_outputs(site, maps)
    return problems


def no_controller(wanted: str, known: Iterable[str]) -> str:
    """Say that a lift names a controller that is not there."""
    return f"no controller {wanted!r}; there is {', '.join(known)}"


def canonical_host(host: str) -> str:
    """Return one spelling of a host, so that one controller is not taken for two."""
    host = host.lower().strip("[]")
    return "127.0.0.1" if host == "localhost" else host


def _controllers(site: Site) -> Iterator[Problem]:
    at: dict[tuple[str, int], str] = {}
    for name, controller in site.controllers.items():
        address = (canonical_host(controller.host), controller.port)
        if address in at:
            message = (
                f"{controller.host}:{controller.port} is controller {at[address]!r} already; lifts share one entry"
            )
            yield Problem(("controllers", name, "port"), message)
        at.setdefault(address, name)


def _lift(key: Key, lift: Lift, controller: Controller, source: RegisterMap) -> Iterator[Problem]:
    codec = compile_map(source, offset=lift.offset)
    yield from _addresses(key, codec)
    yield from _floors(key, lift, codec)
    yield from _access(key, lift, source)
    yield from _timing(key, lift, controller, source)


def _timing(key: Key, lift: Lift, controller: Controller, source: RegisterMap) -> Iterator[Problem]:
    timeout_s = controller.timeout_s or source.link.timeout_s
    max_age_s = lift.max_age_s or source.link.max_age_s
    if lift.poll_s * 2 > max_age_s:
        message = f"a poll every {lift.poll_s:g} s is too slow for max_age_s {max_age_s:g}: one lost poll would take the lift offline"
        yield Problem((*key, "poll_s"), message)
    if timeout_s > max_age_s:
        message = f"timeout_s {timeout_s:g} of its controller is above max_age_s {max_age_s:g}: one late answer would take the lift offline"
        yield Problem((*key, "controller"), message)


def _addresses(key: Key, codec: Codec) -> Iterator[Problem]:
    for table in codec.offset.keys() - codec.served.keys():
        yield Problem((*key, "offset", table), f"{codec.map.name} uses no {table} addresses")
    for table, spans in codec.served.items():
        if any(span.start < 0 or span.stop > 0x10000 for span in spans):
            message = f"moves {table} addresses of {codec.map.name} out of 0 to 65535 on the wire"
            yield Problem((*key, "offset", table), message)


def _floors(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    named: dict[int, str] = {}
    sides = {name.removeprefix("door.") for name in codec.signals if name.startswith("door.")}
    for floor, entry in lift.floors.items():
        where = (*key, "floors", floor)
        if entry.code in named:
            yield Problem(where, f"code {entry.code} is floor {named[entry.code]} already")
        named.setdefault(entry.code, floor)
        for message in _uncodable(entry.code, codec, writes=lift.access == "control"):
            yield Problem(where, message)
        if entry.doors == ():
            yield Problem(where, "lists no door; leave `doors` out if all of them serve this floor")
        for side in entry.doors or ():
            if side not in sides:
                yield Problem(
                    where, f"{codec.map.name} has no {side} door; it has {', '.join(sorted(sides)) or 'none'}"
                )


def _uncodable(code: int, codec: Codec, *, writes: bool) -> Iterator[str]:
    """Say why the map's coding cannot express this floor."""
    command = codec.commands.get("go_to")
    if command is not None and writes:
        try:
            command.encode(code)
        except ValueError as error:
            yield str(error)
            return
    for name in ("car_floor", "destination", "call_accepted"):
        signal = codec.signals.get(name)
        if signal is not None and (message := _untellable(code, signal)) is not None:
            yield message
            return


def _untellable(code: int, signal: SignalCodec) -> str | None:
    try:
        heard = signal.decode(signal.encode(code) & (1 << sum(point.width for point in signal.points)) - 1)
    except ValueError as error:
        return str(error)
    if heard == code:
        return None
    meaning = "means that there is no floor" if heard is None else f"would read back as {heard}"
    return f"code {code} cannot be told apart: in {signal.name} it {meaning}"


def _access(key: Key, lift: Lift, source: RegisterMap) -> Iterator[Problem]:
    latching = [name for name, command in source.commands.items() if command.on_link_loss == "latches"]
    if lift.access == "control" and latching and lift.accept_latching is None:
        outputs = ", ".join(latching)
        message = (
            f"{outputs} of {source.name} stay on when this manager is lost, and nothing lets them go; "
            "say why that is acceptable here with `accept_latching: ...`, or use `access: monitor`"
        )
        yield Problem((*key, "access"), message)


def _shared_outputs(site: Site, maps: Mapping[str, RegisterMap]) -> Iterator[Problem]:
    """Two lifts must never write the same cell."""
    owners: dict[tuple[str, int, Point], str] = {}
    for name, lift in site.lifts.items():
        source = maps.get(lift.controller)
        if source is None or lift.controller not in site.controllers or lift.access != "control":
            continue
        controller = site.controllers[lift.controller]
        unit = next(u for u in (lift.unit_id, controller.unit_id, source.link.unit_id) if u is not None)
        points = {p for command in compile_map(source, offset=lift.offset).commands.values() for p in command.points}
        shared = sorted({owners[lift.controller, unit, p] for p in points if (lift.controller, unit, p) in owners})
        if shared:
            message = f"writes the same registers as {', '.join(shared)}; give it an `offset` or a `unit_id` of its own"
            yield Problem(("lifts", name), message)
        owners.update({(lift.controller, unit, p): name for p in points})
