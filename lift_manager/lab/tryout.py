"""Makes shell commands that read and command a simulated lift. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from register_maps import frames
from register_maps.arbitration import NO_CLAIM, ArbitrationCodec, claim_alone
from register_maps.codec import Codec, CommandCodec, Point
from register_maps.command_codec import payload_counts
from register_maps.words import Table
from simulator.network_commands import watchdog_s

_TYPE = {Table.COIL: 0, Table.DISCRETE: 1, Table.INPUT: 3, Table.HOLDING: 4}
"""mbpoll's option -t."""

MOST_PER_READ = 125
"""mbpoll reads no more addresses at once, bits included."""


def lines(codec: Codec, floors: Mapping[str, int], where: Mapping[str, str]) -> list[str]:
    """Return lines that read every signal and give every command once; `where` has host:port of each device."""
    made = ["", "Read its signals or give a command with any Modbus tool, for example mbpoll:"]
    made += [f"  {line}" for line in _reads(codec, where)]
    for command in codec.commands.values():
        made += [f"  {line}" for line in _gives(codec, command, floors, where)]
    return made


def _mbpoll(codec: Codec, endpoint: str, where: Mapping[str, str]) -> tuple[str, str]:
    host, _, port = where[endpoint].rpartition(":")
    return f"mbpoll -m tcp -a {codec.map.unit_of(endpoint)} -p {port} -0", host


def _reads(codec: Codec, where: Mapping[str, str]) -> Iterator[str]:
    points = [*codec.signal_points, *(point for command in codec.commands.values() for point in command.read_points)]
    for name in dict.fromkeys(point.space for point in points):
        mine = [point for point in points if point.space == name]
        tool, host = _mbpoll(codec, mine[0].endpoint, where)
        for span in codec.served[name]:
            addresses = sorted({point.address for point in mine if point.address in span})
            while addresses:
                first = addresses[0]
                last = max(address for address in addresses if address < first + MOST_PER_READ)
                yield f"{tool} -1 -t {_TYPE[mine[0].table]} -r {first} -c {last - first + 1} {host}"
                addresses = [address for address in addresses if address > last]


def _gives(codec: Codec, command: CommandCodec, floors: Mapping[str, int], where: Mapping[str, str]) -> Iterator[str]:
    spec = command.spec
    floor, code = list(floors.items())[-1]
    pressed = command.encode(code if command.is_call else 1)
    # with one output per floor, only the output of this floor
    point = next((point for point, value in pressed.items() if value), command.points[0])
    what = f"# {command.name}{f' {floor}' if command.is_call else ''}"
    if command.is_timed_coil:
        yield f"{_raw(codec, command, point, where)}   {what}, for {spec.width_s:g} s; mbpoll cannot send that"
        return
    if codec.arbitration is not None:
        yield from _claims(
            codec, codec.arbitration, command, pressed, f"{what[2:]}{_conditions(codec, command)}", where
        )
        return
    tool, host = _mbpoll(codec, point.endpoint, where)
    to = f"{tool} -t {_TYPE[point.table]} -r {point.address} {host}"
    shared = "" if point.is_whole else "; writes the whole register"
    if spec.is_heartbeat:
        changes = "another value" if spec.action == "count" else "0 and 1 in turn"
        yield f"{to} 1   {what}, {changes} every {spec.every_s:g} s{shared}"
        return
    yield f"{to} {_word(codec, point, pressed[point])}   {what}{_conditions(codec, command)}{shared}"
    if not spec.ends_itself:
        yield f"{to} {_word(codec, point, command.encode(None)[point])}   # releases it"


def _claims(
    codec: Codec,
    arbitration: ArbitrationCodec,
    command: CommandCodec,
    pressed: Mapping[Point, int],
    what: str,
    where: Mapping[str, str],
) -> Iterator[str]:
    """Yield writes of the whole block, in the first epoch: the lift obeys none without one.

    A command that needs robot mode is written with the request for it, which would else be released.
    """
    block = codec.written[0][0]
    tool, host = _mbpoll(codec, block.endpoint, where)
    claim = arbitration.encode(claim_alone(NO_CLAIM))
    resting = {point: rest for each in codec.commands.values() for point, rest in each.encode(None).items()}
    if "robot_mode_on" in command.spec.requires and "robot_mode" in codec.commands:
        resting |= codec.commands["robot_mode"].encode(1)
    for given, about in ((pressed, f"{what}; in epoch 1"), (command.encode(None), "releases it")):
        cells = {point.cell: value & point.mask for point, value in (resting | claim | dict(given)).items()}
        values = " ".join(str(cells[cell]) for cell in block.cells)
        yield f"{tool} -t {_TYPE[block.table]} -r {block.start} {host} {values}   # {about}"


def _word(codec: Codec, point: Point, value: int) -> int:
    """Return the contents of a whole address: this value, with all other points at rest."""
    cell = 0
    for command in codec.commands.values():
        for other, rest in command.encode(None).items():
            if other.cell == point.cell:
                cell = other.into(cell, rest)
    return point.into(cell, value)


def _raw(codec: Codec, command: CommandCodec, point: Point, where: Mapping[str, str]) -> str:
    """Return a shell command that sends one function 5 request with a duration, byte by byte."""
    host, _, port = where[point.endpoint].rpartition(":")
    request = frames.pulse_coil(point.address, payload_counts(command.spec), codec.map.unit_of(point.endpoint))
    octal = "".join(f"\\{byte:03o}" for byte in frames.frame(request, 1))
    return f"printf '{octal}' | nc -w 1 {host} {port} | od -An -tx1"


def _conditions(codec: Codec, command: CommandCodec) -> str:
    needs = f", only while {' and '.join(command.spec.requires)} is on" if command.spec.requires else ""
    limit_s = watchdog_s(codec)
    if command.spec.on_link_loss != "device_watchdog" or limit_s is None:
        return needs
    life = "heartbeat" if "heartbeat" in codec.commands else "write"
    return f"{needs}, falls {limit_s:g} s after the last {life}"
