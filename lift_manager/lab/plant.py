"""Makes simulated lifts: a controller and its devices from a map, floors and a speed."""

from __future__ import annotations

from collections.abc import AsyncIterator, Collection, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace

from lift_manager.plain.version import running_version
from register_maps.codec import Codec, SignalCodec, compile_map
from register_maps.schema import Kind, RegisterMap
from register_maps.words import Side
from simulator import shaft
from simulator.modes import Key
from simulator.registers import RegisterFace
from simulator.server import ClientLimits, SimulatedController
from simulator.state import Parameters

HIGHEST_TRIED = 99
"""The highest floor code that is tried if codes are numbers. Chosen: higher than in any building."""
USUAL_FLOORS = 4
"""How many floors a simulated building has if its map allows any number. Chosen."""


def simulated_lift(
    codec: Codec,
    floors: Mapping[str, int],
    *,
    doors: Mapping[str, Collection[Side]] | None = None,
    speed: float = 1.0,
    like: Parameters | None = None,
) -> RegisterFace:
    """Return a lift with these floors (name to code, lowest first), standing at the lowest floor that is not a basement.

    Every door of the map serves every floor, but for the floors that `doors` names.
    If the commands of a map need robot mode and it has no command for it, the key switch of the lift is set to robot. `like` has further
    settings; its building is replaced. Raises ValueError for a floor that the map cannot express.
    """
    needs_mode = any("robot_mode_on" in command.spec.requires for command in codec.commands.values())
    key = Key.ROBOT if needs_mode and "robot_mode" not in codec.commands else Key.NORMAL
    named = {*codec.signals, *codec.commands}
    kinds = ("door", "hold_door", "close_door", "go_to")
    sides = frozenset(side for side in Side if not named.isdisjoint({f"{kind}.{side}" for kind in kinds}))
    everywhere = sides or frozenset({Side.FRONT})
    doors_at = tuple(frozenset((doors or {}).get(floor, everywhere)) for floor in floors)
    building = shaft.Parameters(heights_m=shaft.even_heights(len(floors)), doors_at=doors_at)
    codes = tuple(floors.values())
    start = next((index for index, code in enumerate(codes) if code >= 0), 0)
    settings = replace(like or Parameters(), shaft=building, speed=speed)
    return RegisterFace(codec, codes, settings, start=start, key=key)


def default_floors(source: RegisterMap) -> dict[str, int]:
    """Return floors that a map can express, for a simulation without floors of its own: L1, L2 and so on, four if the map allows any.

    Raises ValueError for a map that cannot express two floors.
    """
    codec = compile_map(source)
    listed = list(_listed(codec))
    if listed:
        common = [code for code in listed[0] if all(code in others for others in listed)]
        codes = [code for code in common if _is_expressible(codec, code)]
    else:
        tried = [*range(1, HIGHEST_TRIED + 1), 0]
        codes = sorted([code for code in tried if _is_expressible(codec, code)][:USUAL_FLOORS])
    if len(codes) < 2:
        raise ValueError(f"{source.name} can express fewer than two floors; name them with --floors")
    first = 1 if 0 in codes else 0
    return {f"L{code + first}": code for code in codes}


def controllers(
    source: RegisterMap, lift: RegisterFace, *, host: str = "127.0.0.1", port: int = 0
) -> dict[str, SimulatedController]:
    """Return a server for the controller, under an empty name, and one for each endpoint of the map, on the following ports.

    Each says that it is simulated, so that nobody takes a test against it for one of a lift. The controller demands of its clients
    what the map says under `link`.
    """
    limits = client_limits(source)
    identity = {0: "lift-manager", 1: f"simulated {source.name}", 2: running_version()}
    devices = {"": lift} | {name: lift.endpoint(name) for name in source.endpoints}
    return {
        name: SimulatedController(
            {source.unit_of(name): device},
            host=host,
            port=port + number if port else 0,
            identity=identity,
            limits=None if name else limits,
        )
        for number, (name, device) in enumerate(devices.items())
    }


def client_limits(source: RegisterMap) -> ClientLimits:
    """Return what the controller of a map demands of its clients."""
    link = source.link
    return ClientLimits(link.max_connections, link.idle_timeout_s, link.min_gap_s)


@asynccontextmanager
async def listening(
    source: RegisterMap, lift: RegisterFace, *, host: str = "127.0.0.1", port: int = 0
) -> AsyncIterator[dict[str, int]]:
    """Serve the `controllers` while the context lasts; yields their ports. Raises OSError for a port in use."""
    async with AsyncExitStack() as stack:
        servers = controllers(source, lift, host=host, port=port)
        for server in servers.values():
            await server.start()
            stack.push_async_callback(server.stop)
        yield {name: server.port for name, server in servers.items()}


def blind_spots(codec: Codec) -> tuple[str, ...]:
    """Return what a map does not show of its lift, as phrases."""
    signals = codec.signals.keys()
    blind = [] if "car_floor" in signals else ["where the car is"]
    return (*blind, *([] if any(name.startswith("door.") for name in signals) else ["whether its door is open"]))


def _listed(codec: Codec) -> Iterator[Collection[int]]:
    """Yield the floor codes of each signal and call that lists them: one point per floor, or a table of positions."""
    yield from (signal.floor_codes for signal in codec.signals.values() if signal.per_floor)
    yield from (spec.positions for spec in codec.map.signals.values() if spec.positions is not None)
    yield from (call.spec.floor_codes for call in codec.commands.values() if call.spec.one_of is not None)


def _is_expressible(codec: Codec, code: int) -> bool:
    for command in codec.commands.values():
        if command.is_call:
            try:
                command.encode(code)
            except ValueError:
                return False
    return all(_can_show(signal, code) for signal in codec.signals.values() if signal.kind is Kind.FLOOR)


def _can_show(signal: SignalCodec, code: int) -> bool:
    try:
        return signal.decode(signal.encode(code)) == code
    except ValueError:
        return False
