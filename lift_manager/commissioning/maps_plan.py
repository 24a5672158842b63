"""What leaves on the wire for one map: a poll, a new connection, every command. Nothing is opened, and nothing waits.

The driver's own parts carry out each command against a device in memory, with time as a number, so what is listed is what
a controller is sent, byte for byte.
"""

from __future__ import annotations

import asyncio
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

from drivers.modbus.diagnosis import named_points
from drivers.modbus.outputs import Outputs
from drivers.modbus.steps import Step, StepKind
from lift_manager.commissioning import wording
from lift_manager.commissioning.bench import Bench, ReceivedRequest, bench
from lift_manager.commissioning.maps_list import WIDTH
from register_maps.codec import Codec, CommandCodec, compile_map
from register_maps.schema import RegisterMap

_MOST_WRITES = 100_000
"""Of one command, its repetitions and what goes on beside it. Chosen: an hour of a heartbeat 25 times a second."""

_COLUMN = 12
"""Width of the times."""


@dataclass(frozen=True, slots=True)
class PlannedRequest:
    """One request, when it leaves and what for."""

    when: str
    purpose: str
    heard: ReceivedRequest

    @property
    def bytes_hex(self) -> str:
        """The frame after its transaction id, as it stands in a packet."""
        return self.heard.body.hex(" ").upper()

    @property
    def words(self) -> str:
        """What it asks for; addresses as on the wire."""
        device = f" ({self.heard.endpoint})" if self.heard.endpoint else ""
        return f"{self.heard.request}{device}"


Group = tuple[PlannedRequest, ...]
"""The requests of one step, with the look afterwards."""


@dataclass(frozen=True, slots=True)
class Part:
    """One occasion with its requests, in their order."""

    heading: str
    sent: tuple[PlannedRequest, ...]
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything that one lift of a map is sent."""

    poll: Part
    connected: Part
    always: Part
    """Heartbeats, and blocks that are written whether or not anything is wanted."""
    commands: tuple[Part, ...]
    """One part for a command, or one for each floor of a call."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Every part that has something to say."""
        return tuple(
            part for part in (self.poll, self.connected, self.always, *self.commands) if part.sent or part.remark
        )


def plan(source: RegisterMap, floors: Mapping[str, int] | None = None) -> Plan:
    """Work out what is sent for a checked map; `floors` are names with their codes, lowest first.

    Raises ValueError for a floor code that a command of the map cannot express.
    """
    codec = compile_map(source)
    return asyncio.run(_plan(codec, floors or example_floors(codec)))


def example_floors(codec: Codec) -> dict[str, int]:
    """Return floors that every call of a map can express: one for each output, or the first two codes from 1 on."""
    calls = [command for command in codec.commands.values() if command.is_call]
    listed = [call.spec.floor_codes for call in calls if call.spec.one_of is not None]
    if listed:
        codes = [code for code in listed[0] if all(code in others for others in listed)]
        return {f"L{number}": code for number, code in enumerate(codes, start=1)}
    codes = [code for code in range(1, 5) if all(code != call.spec.rest for call in calls)]
    return {f"L{code}": code for code in codes[:2]}


async def _plan(codec: Codec, floors: Mapping[str, int]) -> Plan:
    async with bench(codec) as on:
        commands: list[Part] = []
        for command in codec.commands.values():
            if command.is_call:
                commands += await _call(codec, command, floors, on)
            elif not command.spec.is_heartbeat:
                written = await _command(codec, command, 1, on)
                sent = tuple(one for group in written for one in group)
                commands.append(Part(command.name, sent, wording.action(command.spec)))
        return Plan(await _poll(codec, on), await _connected(codec, on), await _always(codec, on), tuple(commands))


async def _poll(codec: Codec, on: Bench) -> Part:
    sent: list[PlannedRequest] = []
    for block in on.poll_blocks:
        names = ", ".join(dict.fromkeys(name for name, _ in named_points(codec, block) if name in codec.signals))
        purpose = f"what the lift says of {names}" if names else "one of our outputs, to see that the device is there"
        sent += _all("each poll", purpose, await on.read(block))
    return Part("One poll", tuple(sent), _cost(codec, sent))


def _cost(codec: Codec, sent: Collection[PlannedRequest]) -> str:
    if not sent:
        return "no request, because the map has nothing that can be read"
    trips = (
        f"{len(sent)} request{'' if len(sent) == 1 else 's'}, so {len(sent)} round trip{'' if len(sent) == 1 else 's'}"
    )
    link = codec.map.link
    gap = f", {link.min_gap_s:g} s apart" if link.min_gap_s and len(sent) > 1 else ""
    pace = f"; not more often than every {link.min_poll_s:g} s" if link.min_poll_s else ""
    return f"{trips}{gap}{pace}"


async def _connected(codec: Codec, on: Bench) -> Part:
    sent: list[PlannedRequest] = []
    for block in on.output_blocks:
        names = [name for name, command in codec.commands.items() if any(map(block.holds, command.read_points))]
        sent += _all("once", f"what our outputs hold of {', '.join(names)}", await on.read(block))
    return Part("On a new connection, after the first poll and before anything is written", tuple(sent))


async def _always(codec: Codec, on: Bench) -> Part:
    """Run the outputs with nothing wanted until everything has been written twice."""
    outputs = Outputs(codec.commands, codec.written)
    told: dict[str, list[PlannedRequest]] = {}
    now = 0.0
    for _ in range(_MOST_WRITES):
        step = outputs.next_step(now)
        if step is not None:
            every = _every(codec, step)
            if len(told.setdefault(every, [])) < 2:
                told[every] += _all(f"{now:g} s", every, await on.write(step, outputs.cells(step)))
            outputs.record_write(step, now)
        elif all(len(found) >= 2 for found in told.values()):
            break
        else:
            now = outputs.wake_at()
    else:
        raise ValueError(f"{min(told)}: far more often than anything else of this map; plan it by itself")
    sent = [one for found in told.values() for one in (found[:2] if _differ(found) else found[:1])]
    return Part("All the time, whether or not anything is wanted", tuple(sent))


def _differ(found: list[PlannedRequest]) -> bool:
    return len({one.bytes_hex for one in found[:2]}) > 1


def _every(codec: Codec, step: Step) -> str:
    if step.block is None:
        return f"{step.name}, every {codec.commands[step.name].spec.every_s or 0:g} s"
    every_s = next(every_s for block, _, every_s in codec.written if block == step.block)
    return f"the whole block at rest, every {every_s or 0:g} s"


async def _call(codec: Codec, command: CommandCodec, floors: Mapping[str, int], on: Bench) -> list[Part]:
    """Plan a call to every floor; of all but the first only the writes that differ."""
    parts: list[Part] = []
    seen: set[tuple[str, ...]] = set()
    for floor, code in floors.items():
        written = await _command(codec, command, code, on)
        fresh = [group for group in written if _bytes(group) not in seen]
        same = "" if len(fresh) == len(written) else f"all else as for {next(iter(floors))}"
        sent = tuple(one for group in fresh for one in group)
        parts.append(
            Part(f"{command.name} {floor} (code {code})", sent, same if parts else wording.action(command.spec))
        )
        seen |= {_bytes(group) for group in written}
    return parts


def _bytes(group: Group) -> tuple[str, ...]:
    return tuple(one.bytes_hex for one in group)


async def _command(codec: Codec, command: CommandCodec, code: int, on: Bench) -> list[Group]:
    """Press, repeat once, let go: as the driver does it, with a device that always does as it is told."""
    outputs = Outputs(codec.commands, codec.written)
    outputs.press(command.name, code, 0.0)
    written: list[Group] = []
    now, repeated, let_go = 0.0, False, False
    for _ in range(_MOST_WRITES):
        step = outputs.next_step(now, command.endpoint)
        if step is None:
            if outputs.all_at_rest:
                return written
            now = outputs.wake_at(command.endpoint)
            continue
        if step.name != command.name or (step.kind in _REPEATED and repeated):
            # a heartbeat or a cyclic block, which go on whatever is pressed; or one repetition of many
            outputs.record_write(step, now)
            continue
        heard = await on.write(step, outputs.cells(step))
        outputs.record_write(step, now)
        first = step.kind is StepKind.REFRESH and command.name in outputs and outputs.is_looked_at_first(command.name)
        looked, seen = await on.look(Step(StepKind.LOOK, step.name, step.code) if first else step)
        if looked:
            # a device in memory shows nothing where outputs are read elsewhere; a real one shows what was written
            outputs.record_look(step, holds=True, now=now)
        when = "at the end" if let_go and step.kind is StepKind.RELEASE else f"{now:g} s"
        written.append(tuple(_step(step, when, heard, seen, looks_first=first)))
        repeated = repeated or step.kind in _REPEATED
        if repeated and command.spec.action == "hold" and not let_go:
            outputs.release(command.name)
            let_go = True
    raise ValueError(f"{command.name}: something is written so often that it never ends; look at the times of the map")


_REPEATED = frozenset({StepKind.REFRESH, StepKind.LOOK})
_PURPOSE: Mapping[StepKind, str] = {
    StepKind.PRESS: "press",
    StepKind.REFRESH: "written again",
    StepKind.RELEASE: "let go",
    StepKind.PAUSE: "end of one press",
    StepKind.RESET: "rest first, so that the press is an edge",
}


def _step(
    step: Step,
    when: str,
    heard: Iterable[ReceivedRequest],
    seen: Iterable[ReceivedRequest],
    *,
    looks_first: bool = False,
) -> Iterator[PlannedRequest]:
    if looks_first:
        yield from _all(when, "is it still on", seen)
    for one in heard:
        purpose = _PURPOSE[step.kind] if one.request.is_write else "read afresh, because others use this register too"
        yield PlannedRequest(when, purpose, one)
    if not looks_first:
        yield from _all(when, "read back", seen)


def _all(when: str, purpose: str, heard: Iterable[ReceivedRequest]) -> list[PlannedRequest]:
    return [PlannedRequest(when, purpose, one) for one in heard]


def lines(found: Plan) -> Iterator[str]:
    """Yield the plan as text: a line in plain words for every request, and its bytes below."""
    for part in found.parts:
        yield from textwrap.wrap(
            part.heading + (f": {part.remark}" if part.remark else ""), WIDTH, subsequent_indent="  "
        )
        for one in part.sent:
            yield from _wrapped(f"  {one.when:<{_COLUMN}}", f"{one.purpose}: {one.words}")
            yield from _wrapped(" " * (_COLUMN + 2), one.bytes_hex)
        yield ""
    yield "Bytes as they stand in a packet after the two of the transaction id; addresses as on the wire, from 0."


def _wrapped(start: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=start, subsequent_indent=" " * (_COLUMN + 2))
