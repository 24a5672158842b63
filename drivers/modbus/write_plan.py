"""Plans what presses and releases would write, byte for byte, by the same outputs that write them. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.modbus.confirm import confirmation_of
from drivers.modbus.outputs import Outputs
from drivers.modbus.signals import wire_text
from drivers.modbus.steps import READ_ONLY_KINDS, Phase, Step, StepKind
from drivers.modbus.write_reports import hex_part
from drivers.modbus.writes import step_requests
from drivers.model import CommandInfo, CommandStep, OutputState, PlannedWrite
from register_maps.arbitration import Claim
from register_maps.codec import Block, Codec, CommandCodec
from register_maps.frames import MASK_WRITE
from register_maps.meanings import COMMAND_MEANINGS

_MOST_STEPS = 100_000
"""Chosen: an hour of a heartbeat 25 times a second."""
_PLANNED = frozenset({StepKind.RESET, StepKind.PRESS, StepKind.RELEASE})
_LOOKED_AT = frozenset({StepKind.PRESS, StepKind.REFRESH, StepKind.RELEASE}) | READ_ONLY_KINDS


def command_info(command: CommandCodec, state: OutputState | None) -> CommandInfo:
    """Describe a command of the map; `state` is that of its output."""
    spec = command.spec
    return CommandInfo(
        name=command.name,
        meaning=COMMAND_MEANINGS[command.name],
        takes_floor=command.is_call,
        addresses=spec.addresses,
        wire=tuple(map(wire_text, command.points)),
        action=spec.action,
        ends_itself=spec.ends_itself,
        width_s=spec.width_s,
        max_hold_s=spec.max_hold_s,
        refresh_s=spec.refresh_s,
        until=spec.until or "",
        on_link_loss=spec.on_link_loss or "",
        requires=spec.requires,
        confirmed_within_s=confirmation_of(spec).within_s,
        state=state,
    )


def plan_writes(
    codec: Codec, unit_of: Callable[[str], int], claim: Claim, steps: Iterable[tuple[CommandStep, int | None]]
) -> tuple[PlannedWrite, ...]:
    """Return what these steps would write from rest, each with the code of its floor; what is on at their end is released.

    Raises ValueError for a command that the map does not have, or that writes a floor without a code.
    """
    plan = _Plan(codec, unit_of, claim)
    for step, code in steps:
        name = step.command.name
        if not plan.has(name):
            raise ValueError(f"the map {codec.map.name} has no command {name}")
        if code is None or (codec.commands[name].is_call and step.command.floor is None):
            raise ValueError(f"{name} needs a floor of this lift")
        if step.is_release:
            plan.release(name)
        else:
            plan.press(name, code)
    plan.release_all()
    return tuple(plan.writes)


class _Plan:
    """Outputs on a clock of their own, in front of a device that always obeys."""

    def __init__(self, codec: Codec, unit_of: Callable[[str], int], claim: Claim) -> None:
        self._commands = codec.commands
        self._unit_of = unit_of
        self._outputs = Outputs(codec.commands, codec.written, codec.arbitration)
        self._outputs.set_claim(claim)
        self._now = 0.0
        self.writes: list[PlannedWrite] = []

    def has(self, name: str) -> bool:
        return name in self._outputs

    def press(self, name: str, code: int) -> None:
        output = self._outputs.output(name)
        self._run_until(self._pulses_at_rest)
        self._outputs.press(name, code, self._now)
        self._run_until(lambda: output.phase not in (Phase.DUE, Phase.LEAVING) and not output.has_next_press)

    def release(self, name: str) -> None:
        output = self._outputs.output(name)
        self._outputs.release(name)
        self._run_until(lambda: output.phase is Phase.REST)

    def release_all(self) -> None:
        self._run_until(self._pulses_at_rest)
        self._outputs.release_all()
        self._run_until(lambda: self._outputs.all_at_rest)

    def _pulses_at_rest(self) -> bool:
        outputs = map(self._outputs.output, self._outputs.names)
        return all(output.phase is Phase.REST for output in outputs if not output.is_level)

    def _run_until(self, is_done: Callable[[], bool]) -> None:
        for _ in range(_MOST_STEPS):
            if is_done():
                return
            step = self._next_step()
            if step is None:
                self._now = min(map(self._outputs.wake_at, self._outputs.endpoints))
                self._keep_holds()
            else:
                self._write(step)
        raise ValueError("something is written so often that it never ends; check the times of the map")

    def _next_step(self) -> Step | None:
        steps = (self._outputs.next_step(self._now, endpoint) for endpoint in self._outputs.endpoints)
        return next((step for step in steps if step is not None), None)

    def _keep_holds(self) -> None:
        for name in self._outputs.names:
            output = self._outputs.output(name)
            if output.is_level and output.phase is Phase.ON:
                self._outputs.hold(name, self._now)

    def _write(self, step: Step) -> None:
        if step.kind in _PLANNED:
            command, cells = self._commands[step.name], self._outputs.cells(step)
            for block, request in step_requests(command, step, cells, self._unit_of):
                self.writes.append(
                    PlannedWrite(
                        name=step.name,
                        what=step.kind,
                        addresses=_addresses(command, step, block),
                        function=request.function,
                        text=str(request),
                        frame=hex_part(request).hex(),
                        is_read_first=command.is_shared and request.function != MASK_WRITE,
                    )
                )
        self._outputs.record_write(step, self._now)
        if step.kind in _LOOKED_AT:
            self._outputs.record_look(step, holds=True, now=self._now)


def _addresses(command: CommandCodec, step: Step, block: Block) -> tuple[str, ...]:
    """Return the printed addresses of a command that this write of a block is about: of one output per floor, that of its floor."""
    values = command.encode(step.was if step.code is None else step.code)
    is_one_of = command.spec.one_of is not None
    return tuple(
        address
        for address, point in zip(command.spec.addresses, command.points, strict=True)
        if block.holds(point) and (values[point] or not is_one_of)
    )
