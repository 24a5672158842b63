"""Lists the requests on the wire for one map: a poll, a new connection, every command. Without a network and without waiting.

The driver itself carries out each command against a device in memory, with simulated time, so the list is what a controller
receives, byte for byte.
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
from lift_manager.commissioning.bench import Bench, ReceivedRequest, open_bench
from lift_manager.commissioning.maps_list import WIDTH
from register_maps.codec import Codec, CommandCodec, compile_map
from register_maps.schema import RegisterMap

_MAX_WRITES = 100_000
"""Of one command, with its repetitions and cyclic writes. Chosen: an hour of a heartbeat 25 times a second."""

_TIME_WIDTH = 12
"""Columns of the times."""


@dataclass(frozen=True, slots=True)
class PlannedRequest:
    """One request, with its time and purpose."""

    when: str
    purpose: str
    received: ReceivedRequest

    @property
    def bytes_hex(self) -> str:
        """The frame after its transaction id, as it stands in a packet."""
        return self.received.body.hex(" ").upper()

    @property
    def words(self) -> str:
        """A description of the request; addresses as on the wire."""
        device = f" ({self.received.endpoint})" if self.received.endpoint else ""
        return f"{self.received.request}{device}"


RequestGroup = tuple[PlannedRequest, ...]
"""The requests of one step, including the read-back."""


@dataclass(frozen=True, slots=True)
class PlanSection:
    """One section of a plan, with its requests in order."""

    heading: str
    requests: tuple[PlannedRequest, ...]
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """Every request to one lift of a map."""

    poll: PlanSection
    connected: PlanSection
    always: PlanSection
    """Heartbeats, and blocks that are written whether or not anything is requested."""
    commands: tuple[PlanSection, ...]
    """One section per command, or per floor of a call."""

    @property
    def parts(self) -> tuple[PlanSection, ...]:
        """Every section that is not empty."""
        return tuple(
            part for part in (self.poll, self.connected, self.always, *self.commands) if part.requests or part.remark
        )


def plan(source: RegisterMap, floors: Mapping[str, int] | None = None) -> Plan:
    """Return the plan of a checked map; `floors` are names with their codes, lowest first.

    Raises ValueError for a floor code that a command of the map cannot express.
    """
    codec = compile_map(source)
    return asyncio.run(_plan(codec, floors or example_floors(codec)))


def example_floors(codec: Codec) -> dict[str, int]:
    """Return floors that every call of a map can express: one per output, or the first two codes from 1."""
    calls = [command for command in codec.commands.values() if command.is_call]
    listed = [call.spec.floor_codes for call in calls if call.spec.one_of is not None]
    if listed:
        codes = [code for code in listed[0] if all(code in others for others in listed)]
        return {f"L{number}": code for number, code in enumerate(codes, start=1)}
    codes = [code for code in range(1, 5) if all(code != call.spec.rest for call in calls)]
    return {f"L{code}": code for code in codes[:2]}


async def _plan(codec: Codec, floors: Mapping[str, int]) -> Plan:
    async with open_bench(codec) as test_bench:
        commands: list[PlanSection] = []
        for command in codec.commands.values():
            if command.is_call:
                commands += await _plan_call(codec, command, floors, test_bench)
            elif not command.spec.is_heartbeat:
                written = await _plan_command(codec, command, 1, test_bench)
                requests = tuple(request for group in written for request in group)
                commands.append(PlanSection(command.name, requests, wording.action(command.spec)))
        return Plan(
            await _plan_poll(codec, test_bench),
            await _plan_connection(codec, test_bench),
            await _plan_cyclic(codec, test_bench),
            tuple(commands),
        )


async def _plan_poll(codec: Codec, test_bench: Bench) -> PlanSection:
    requests: list[PlannedRequest] = []
    for block in test_bench.poll_blocks:
        names = ", ".join(dict.fromkeys(name for name, _ in named_points(codec, block) if name in codec.signals))
        purpose = (
            f"signals of the lift: {names}" if names else "one of our outputs, to check that the device is connected"
        )
        requests += _planned_requests("each poll", purpose, await test_bench.read(block))
    return PlanSection("One poll", tuple(requests), _cost_text(codec, requests))


def _cost_text(codec: Codec, requests: Collection[PlannedRequest]) -> str:
    if not requests:
        return "no request, because the map has nothing that can be read"
    trips = f"{len(requests)} request{'' if len(requests) == 1 else 's'}, so {len(requests)} round trip{'' if len(requests) == 1 else 's'}"
    link = codec.map.link
    gap = f", {link.min_gap_s:g} s apart" if link.min_gap_s and len(requests) > 1 else ""
    pace = f"; not more often than every {link.min_poll_s:g} s" if link.min_poll_s else ""
    return f"{trips}{gap}{pace}"


async def _plan_connection(codec: Codec, test_bench: Bench) -> PlanSection:
    requests: list[PlannedRequest] = []
    for block in test_bench.output_blocks:
        names = [name for name, command in codec.commands.items() if any(map(block.holds, command.read_points))]
        requests += _planned_requests("once", f"state of our outputs: {', '.join(names)}", await test_bench.read(block))
    return PlanSection("On a new connection, after the first poll and before anything is written", tuple(requests))


async def _plan_cyclic(codec: Codec, test_bench: Bench) -> PlanSection:
    """Run the outputs without requests until everything cyclic was written twice."""
    outputs = Outputs(codec.commands, codec.written, codec.arbitration)
    by_interval: dict[str, list[PlannedRequest]] = {}
    now = 0.0
    for _ in range(_MAX_WRITES):
        step = outputs.next_step(now)
        if step is not None:
            interval = _interval_text(codec, step)
            if len(by_interval.setdefault(interval, [])) < 2:
                by_interval[interval] += _planned_requests(
                    f"{now:g} s", interval, await test_bench.write(step, outputs.cells(step))
                )
            outputs.record_write(step, now)
        elif all(len(found) >= 2 for found in by_interval.values()):
            break
        else:
            now = outputs.wake_at()
    else:
        raise ValueError(f"{min(by_interval)}: far more often than anything else of this map; plan it by itself")
    requests = [request for found in by_interval.values() for request in (found[:2] if _differ(found) else found[:1])]
    return PlanSection("All the time, whether or not anything is requested", tuple(requests))


def _differ(found: list[PlannedRequest]) -> bool:
    return len({request.bytes_hex for request in found[:2]}) > 1


def _interval_text(codec: Codec, step: Step) -> str:
    if step.block is None:
        return f"{step.name}, every {codec.commands[step.name].spec.every_s or 0:g} s"
    every_s = next(every_s for block, _, every_s in codec.written if block == step.block)
    return f"the whole block at rest, every {every_s or 0:g} s"


async def _plan_call(
    codec: Codec, command: CommandCodec, floors: Mapping[str, int], test_bench: Bench
) -> list[PlanSection]:
    """Plan a call to every floor; after the first one, only the writes that differ."""
    parts: list[PlanSection] = []
    read_requests: set[tuple[str, ...]] = set()
    for floor, code in floors.items():
        written = await _plan_command(codec, command, code, test_bench)
        new_groups = [group for group in written if _bytes(group) not in read_requests]
        same = "" if len(new_groups) == len(written) else f"otherwise as for {next(iter(floors))}"
        requests = tuple(request for group in new_groups for request in group)
        parts.append(
            PlanSection(
                f"{command.name} {floor} (code {code})", requests, same if parts else wording.action(command.spec)
            )
        )
        read_requests |= {_bytes(group) for group in written}
    return parts


def _bytes(group: RequestGroup) -> tuple[str, ...]:
    return tuple(request.bytes_hex for request in group)


async def _plan_command(codec: Codec, command: CommandCodec, code: int, test_bench: Bench) -> list[RequestGroup]:
    """Press, repeat once and release, as the driver does with a device that always obeys."""
    outputs = Outputs(codec.commands, codec.written, codec.arbitration)
    outputs.press(command.name, code, 0.0)
    written: list[RequestGroup] = []
    now, is_repeated, is_released = 0.0, False, False
    for _ in range(_MAX_WRITES):
        step = outputs.next_step(now, command.endpoint)
        if step is None:
            if outputs.all_at_rest:
                return written
            now = outputs.wake_at(command.endpoint)
            continue
        if step.name != command.name or (step.kind in _REPEATED and is_repeated):
            # a heartbeat or a cyclic block, which continue anyway; or one of many repetitions
            outputs.record_write(step, now)
            continue
        received = await test_bench.write(step, outputs.cells(step))
        outputs.record_write(step, now)
        reads_first = (
            step.kind is StepKind.REFRESH and command.name in outputs and outputs.is_looked_at_first(command.name)
        )
        is_read_back, read_requests = await test_bench.read_back(
            Step(StepKind.LOOK, step.name, step.code) if reads_first else step
        )
        if is_read_back:
            # a device in memory does not copy outputs to other addresses; a real one shows what was written there
            outputs.record_look(step, holds=True, now=now)
        when = "at the end" if is_released and step.kind is StepKind.RELEASE else f"{now:g} s"
        written.append(tuple(_step_requests(step, when, received, read_requests, looks_first=reads_first)))
        is_repeated = is_repeated or step.kind in _REPEATED
        if is_repeated and command.spec.action == "hold" and not is_released:
            outputs.release(command.name)
            is_released = True
    raise ValueError(f"{command.name}: something is written so often that it never ends; check the times of the map")


_REPEATED = frozenset({StepKind.REFRESH, StepKind.LOOK})
_PURPOSE: Mapping[StepKind, str] = {
    StepKind.PRESS: "press",
    StepKind.REFRESH: "written again",
    StepKind.RELEASE: "release",
    StepKind.PAUSE: "end of one press",
    StepKind.RESET: "rest first, so that the press is an edge",
}


def _step_requests(
    step: Step,
    when: str,
    received: Iterable[ReceivedRequest],
    read_requests: Iterable[ReceivedRequest],
    *,
    looks_first: bool = False,
) -> Iterator[PlannedRequest]:
    if looks_first:
        yield from _planned_requests(when, "check that it is still on", read_requests)
    for request in received:
        purpose = (
            _PURPOSE[step.kind] if request.request.is_write else "read first, because others use this register too"
        )
        yield PlannedRequest(when, purpose, request)
    if not looks_first:
        yield from _planned_requests(when, "read back", read_requests)


def _planned_requests(when: str, purpose: str, received: Iterable[ReceivedRequest]) -> list[PlannedRequest]:
    return [PlannedRequest(when, purpose, request) for request in received]


def lines(found: Plan) -> Iterator[str]:
    """Yield the plan as text: a description of every request, followed by its bytes."""
    for part in found.parts:
        yield from textwrap.wrap(
            part.heading + (f": {part.remark}" if part.remark else ""), WIDTH, subsequent_indent="  "
        )
        for request in part.requests:
            yield from _wrapped(f"  {request.when:<{_TIME_WIDTH}}", f"{request.purpose}: {request.words}")
            yield from _wrapped(" " * (_TIME_WIDTH + 2), request.bytes_hex)
        yield ""
    yield "Bytes as they stand in a packet after the two of the transaction id; addresses as on the wire, from 0."


def _wrapped(start: str, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=start, subsequent_indent=" " * (_TIME_WIDTH + 2))
