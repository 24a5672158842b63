"""Decides what to write when: each output of one lift is a small state machine. Pure; the caller passes the time.

An output is at rest, due to be pressed, on, or being released. Releases come first, are repeated until verified, and need no
permission. A press is tried once. A hold may be written again within its limit: that is the same command, not another one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from drivers.modbus.image import Image
from drivers.modbus.output import (
    LOOK_S,
    MOST_PRESSES,
    REJECTED_PAUSE_S,
    RETRY_S,
    Beat,
    Cells,
    Cycle,
    Output,
    period_s,
)
from drivers.modbus.steps import READ_ONLY_KINDS, Phase, Step, StepKind
from drivers.model import Hold, PressId
from register_maps.arbitration import NO_CLAIM, ArbitrationCodec, Claim, claim_alone
from register_maps.codec import Cell, CommandCodec
from register_maps.command_codec import Written, stamp


class Outputs:
    """All outputs of one lift, and the writes they need."""

    def __init__(
        self,
        commands: Mapping[str, CommandCodec],
        written: Sequence[Written] = (),
        arbitration: ArbitrationCodec | None = None,
    ) -> None:
        """Assume that every output is at rest until `record_reconnect` shows what the controller holds.

        Where the controller arbitrates, writes claim what a manager alone claims of a new controller, until `set_claim`.
        """
        self._outputs = {
            name: Output(codec, period_s(codec, written))
            for name, codec in commands.items()
            if not codec.spec.is_heartbeat
        }
        self._excluded = {name: self._mutual(name) for name in self._outputs}
        self._beats = {name: Beat(codec) for name, codec in commands.items() if codec.spec.is_heartbeat}
        own = {point.cell for output in self._outputs.values() for point in output.codec.points}
        self._cycles = [
            Cycle(block, every_s)
            for block, _, every_s in written
            if every_s is not None and not own.isdisjoint(block.cells)
        ]
        self._image = Image(self._outputs, self._beats, written)
        self._arbitration = arbitration
        self._is_one_device = self.endpoints == ("",)
        self.set_claim(claim_alone(NO_CLAIM))

    def __contains__(self, name: str) -> bool:
        return name in self._outputs

    def set_claim(self, claim: Claim) -> None:
        """Let every write from now on carry this claim, where the map has a place for it."""
        if self._arbitration is not None:
            self._image.claim = stamp(self._arbitration.encode(claim))

    def press(
        self, name: str, code: int | None, now: float, *, press: PressId | None = None, leave_by: float = math.inf
    ) -> None:
        """Request a press, to be written by `leave_by` plus the pauses of its map. The same output, if still on, is released first."""
        output = self._outputs[name]
        self._clear_excluded(name)
        output.adopt_by, output.press = -math.inf, press
        output.leave_by = leave_by + self._pauses_s(name)
        if output.phase in (Phase.REST, Phase.DUE):
            output.phase, output.code = Phase.DUE, code
        else:
            output.has_next_press, output.next_code = True, code
            output.release()
        if output.phase is not Phase.ON:  # the device ends its pulse, not we
            output.expires_at = now + (output.spec.max_hold_s or math.inf)

    def hold(self, name: str, now: float, *, until: float = math.inf, begin: bool = True) -> None:
        """Request a hold, or renew it, for at most `max_hold_s` from now; one that is only kept is pressed again once it may `begin`."""
        output = self._outputs[name]
        if output.renew(min(until, now + (output.spec.max_hold_s or math.inf)), begin=begin):
            return
        if output.phase is Phase.REST:
            self._clear_excluded(name)
            output.phase, output.code, output.leave_by = Phase.DUE, 1, math.inf
        elif output.phase is Phase.RELEASING:
            output.has_next_press, output.next_code, output.leave_by = True, output.code or 1, math.inf
            output.press = None

    def adopt(self, name: str, code: int, now: float, *, until: float = math.inf) -> None:
        """Keep an output that the first look finds on; the outputs it excludes are released."""
        output = self._outputs[name]
        if output.can_be_adopted and output.phase is Phase.REST and now < until:
            self._clear_excluded(name)
            output.code, output.adopt_by = code, min(until, now + (output.spec.max_hold_s or math.inf))

    def declare(self, name: str, code: int, hold: Hold, now: float, *, adopts: bool) -> bool:
        """Hold an output as declared. Returns whether it was released because it is on for another floor.

        With `adopts` the lift has not been read yet, so the output may be on from before.
        """
        output = self._outputs[name]
        kept_from_now = output.begin > 0 and not hold.begin
        output.begin = hold.begin
        if output.press_waits or not output.is_level:
            return False
        is_on = output.phase is Phase.ON or output.awaits_look
        if is_on and output.code != code:
            self.release(name)
            return True
        if is_on or output.has_next_press or output.phase in (Phase.DUE, Phase.LEAVING):
            self.hold(name, now, until=hold.until, begin=hold.begin > 0)
            if kept_from_now:
                output.keep()
        elif output.may_begin:
            self.hold(name, now, until=hold.until)
        elif adopts and not hold.begin:
            self.adopt(name, code, now, until=hold.until)
        return False

    def withhold(self, name: str, hold: Hold | None = None) -> bool:
        """Release an output although it is declared, except for a press under way. Returns whether it was on or requested."""
        output = self._outputs[name]
        if hold is not None:
            output.begin = hold.begin
        is_requested = (
            output.has_next_press or output.awaits_look or output.phase in (Phase.DUE, Phase.LEAVING, Phase.ON)
        )
        if output.press_waits or not (is_requested and output.is_level):
            return False
        self.release(name)
        return True

    def undeclare(self, name: str) -> bool:
        """Stop holding an output, except for a press under way. Returns whether it was released."""
        released = self.withhold(name)
        self._outputs[name].begin = self._outputs[name].used_begin = 0
        return released

    @property
    def first_expiry_at(self) -> float:
        """When the first output expires that is on, due, or may be on from before."""
        outputs = self._outputs.values()
        expiries = [output.expires_at for output in outputs if output.phase in (Phase.DUE, Phase.ON)]
        return min([*expiries, *(output.adopt_by for output in outputs if output.awaits_look)], default=math.inf)

    def release(self, name: str) -> None:
        """Release an output, now."""
        output = self._outputs[name]
        output.has_next_press = False
        output.release()

    def clear(self, name: str, now: float) -> None:
        """Release an output that somebody else has pressed; give up after a few tries without effect."""
        output = self._outputs[name]
        if output.phase is Phase.REST:
            output.phase, output.try_at, output.failures, output.foreign = Phase.RELEASING, now, 0, MOST_PRESSES

    def release_all(self) -> None:
        """Release every output."""
        for name in self._outputs:
            self.release(name)

    def phase(self, name: str) -> Phase:
        """Return the phase of an output."""
        return self._outputs[name].phase

    def is_verified(self, name: str) -> bool:
        """Whether it is on, and verified by a read-back."""
        output = self._outputs[name]
        return output.phase is Phase.ON and output.verified

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Every device that is written to, and the controller."""
        outputs = {output.codec.endpoint for output in self._outputs.values()}
        return tuple(sorted(outputs | {beat.codec.endpoint for beat in self._beats.values()} | {""}))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all outputs."""
        return tuple(self._outputs)

    def output(self, name: str) -> Output:
        """Return one output."""
        return self._outputs[name]

    @property
    def all_at_rest(self) -> bool:
        """Whether no output is on, due or being released."""
        return all(output.phase is Phase.REST for output in self._outputs.values())

    def is_pending(self, name: str) -> bool:
        """Whether it is on or still to be pressed."""
        output = self._outputs[name]
        return output.has_next_press or output.phase in (Phase.DUE, Phase.LEAVING, Phase.ON)

    def is_looked_at_first(self, name: str) -> bool:
        """Whether an output is read back before each refresh instead of after it."""
        output = self._outputs[name]
        return output.is_looked_at_first and not output.codec.is_shared

    def plan_press(self, name: str, code: int) -> tuple[Step, Cells]:
        """Return the press of an output and our cells with it, as if the outputs it excludes were released."""
        step = Step(StepKind.PRESS, name, code)
        return step, self.cells(step, without=self._excluded[name])

    def is_needed(self, step: Step) -> bool:
        """Whether a press or refresh is still requested."""
        output = self._outputs[step.name]
        if step.kind is StepKind.PRESS and output.phase is not Phase.ON:
            return output.phase is Phase.LEAVING and not output.is_abandoned
        return output.phase is Phase.ON

    def next_step(self, now: float, endpoint: str = "") -> Step | None:
        """Return the write to one device that is due now, releases first, or None.

        A press that is returned counts as leaving until `record_write` or `record_failure` reports its result.
        """
        self._expire(now)
        due = self._release_due(now, endpoint) or self._other_due(now, endpoint)
        if due is not None and due.kind is StepKind.PRESS and self._outputs[due.name].phase is Phase.DUE:
            self._outputs[due.name].phase = Phase.LEAVING
        return due

    def _expire(self, now: float) -> None:
        """End outputs whose time is over, and presses that have waited too long."""
        for output in self._outputs.values():
            output.end_yielding(now)
            if now >= output.adopt_by:
                output.adopt_by = -math.inf
            if output.phase is Phase.ON and now >= output.expires_at:
                if output.spec.ends_itself:
                    output.come_to_rest(now)
                else:
                    output.release()
            elif (output.has_next_press or output.phase is Phase.DUE) and now >= output.give_up_at:
                output.has_next_press = False
                if output.phase is Phase.DUE:
                    output.release()

    def _release_due(self, now: float, endpoint: str) -> Step | None:
        """Return the release that has waited longest, so that one that fails repeatedly does not delay the others."""
        due = [(name, output) for name, output in self._at(endpoint) if now >= output.release_at]
        if not due:
            return None
        name, output = min(due, key=lambda item: item[1].release_at)
        kind = StepKind.PAUSE if output.phase is Phase.ON else StepKind.VERIFY if output.echoed else StepKind.RELEASE
        return Step(kind, name, None, was=output.code)

    def defer_verification(self, step: Step, now: float) -> bool:
        """Postpone the read-back of an answered release while another output still waits for its first. Returns whether it is postponed."""
        if step.kind is not StepKind.RELEASE:
            return False
        output = self._outputs[step.name]
        others = (other for _, other in self._at(output.codec.endpoint) if other is not output)
        if any(now >= other.release_at and not other.echoed for other in others):
            output.echoed, output.try_at = True, now
        return output.echoed

    def _at(self, endpoint: str) -> Iterable[tuple[str, Output]]:
        """Return the outputs that are written to one device: mostly all of them."""
        if self._is_one_device:
            return self._outputs.items()
        return ((name, output) for name, output in self._outputs.items() if output.codec.endpoint == endpoint)

    def _other_due(self, now: float, endpoint: str) -> Step | None:
        """Return the other write that has waited longest, so that frequent writes do not starve the rest."""
        due = [(at, step) for at, step in self._others(now, endpoint) if now >= at]
        return min(due, key=lambda item: item[0])[1] if due else None

    def _others(self, now: float, endpoint: str) -> Iterator[tuple[float, Step]]:
        """Yield all writes except releases, each with the time it is due."""
        for name, beat in self._beats.items():
            if beat.codec.endpoint == endpoint:
                yield beat.at, Step(StepKind.BEAT, name, beat.next_count)
        for name, output in self._at(endpoint):
            if output.phase is Phase.DUE:
                armed = output.armed_at is not None or not output.spec.reset_first_s
                kind, code = (StepKind.PRESS, output.code) if armed else (StepKind.RESET, None)
                yield self._free_at(name), Step(kind, name, code)
            if output.phase is Phase.ON:
                again = StepKind.PRESS if output.is_found_off else StepKind.REFRESH
                yield output.due_at, Step(StepKind.LOOK if output.is_read_next else again, name, output.code)
        for cycle in self._cycles:
            if cycle.block.endpoint == endpoint and self._image.is_idle(cycle.block):
                yield cycle.at, Step(StepKind.CYCLE, "", None, cycle.block)

    def wake_at(self, endpoint: str = "") -> float:
        """Return the earliest time at which `next_step` may return a step; infinity if only an event can change that."""
        times = [math.inf, *(beat.at for beat in self._beats.values() if beat.codec.endpoint == endpoint)]
        times += [
            cycle.at for cycle in self._cycles if cycle.block.endpoint == endpoint and self._image.is_idle(cycle.block)
        ]
        for name, output in self._at(endpoint):
            times.append(output.release_at)
            if output.awaits_look:
                times.append(output.adopt_by)
            if output.phase is Phase.DUE:
                times.append(self._free_at(name))
            if output.phase is Phase.DUE or output.has_next_press:
                times.append(output.give_up_at)
            if output.phase is Phase.ON:
                times += [output.expires_at, output.due_at]
        return min(times)

    def cells(self, step: Step, without: Collection[str] = ()) -> Cells:
        """Return our cells with this step applied; of the other outputs only those that are on are pressed."""
        return self._image.cells(step, without)

    def covered_cells(self, step: Step) -> list[Cell]:
        """Return every cell that the writes of a step cover."""
        return self._image.covered_cells(step)

    def others_in_cells(self, step: Step) -> tuple[str, ...]:
        """Return the other outputs in the cells of a step, on or not."""
        return self._image.others_in_cells(step)

    def neighbours(self, step: Step) -> tuple[str, ...]:
        """Return the other outputs that a step has to write as pressed, because they are on or may be."""
        return self._image.neighbours(step)

    def record_write(self, step: Step, now: float) -> None:
        """Record that the controller echoed the write of a step. That proves nothing yet."""
        if step.kind not in READ_ONLY_KINDS:
            self._restart_cycles(self.covered_cells(step), now)
        if step.block is not None:
            return
        if step.kind is StepKind.BEAT:
            beat = self._beats[step.name]
            beat.count, beat.at = step.code or 0, now + (beat.codec.spec.every_s or math.inf)
            return
        output = self._outputs[step.name]
        match step.kind:
            case StepKind.RESET if output.phase is Phase.DUE:
                output.armed_at = now + output.spec.reset_first_s
            case StepKind.PAUSE:
                output.pause_at, output.paused = math.inf, True
            case StepKind.PRESS if output.awaits_press_answer:
                output.phase, output.verified, output.armed_at, output.set_at = Phase.ON, False, None, now
                output.paused = output.is_abandoned = False
                output.not_before = max(output.not_before, now + output.spec.min_repeat_s)
                if output.spec.width_s is not None and output.spec.repeat_pulse_s is None:
                    output.expires_at = now + output.spec.width_s
            case _:
                pass
        if output.phase is Phase.ON and step.kind is not StepKind.PAUSE:
            output.record_write(now, was_read=step.kind is StepKind.LOOK)

    def record_look(self, step: Step, *, holds: bool, now: float, excused: bool = False) -> None:
        """Record a read-back, or that none is possible; `holds` tells whether the cells hold what the step wrote.

        With `excused` the lift itself reports why an output was released; then the drop does not count as a fight.
        """
        output = self._outputs[step.name]
        if output.phase is Phase.ON and step.kind is not StepKind.RELEASE:
            if output.is_only_kept and not holds:
                output.release()
                return
            if holds:
                output.verified = output.was_found_on = True
                output.was_dropped = output.was_dropped and step.kind is not StepKind.LOOK
                return
            # if the first try fails, later ones are slower: each try is a rising edge
            output.press_again_later(
                now, pause_s=RETRY_S if output.verified or not output.was_found_on else LOOK_S, excused=excused
            )
        elif output.phase is Phase.RELEASING and step.kind in (StepKind.RELEASE, StepKind.VERIFY):
            if holds or output.foreign == 1:
                output.come_to_rest(now)
            else:
                output.foreign = max(0, output.foreign - 1)
                output.retry_later(now)

    def record_failure(
        self, step: Step, *, maybe_sent: bool, now: float, rejected: bool = False, arrived: bool = False
    ) -> None:
        """Record that a write or its read-back failed: release what may have been pressed, try a release again.

        With `arrived` the controller has answered, but did nothing.
        """
        if step.block is not None:
            self._restart_cycles(step.block.cells, now)
            return
        if step.kind is StepKind.BEAT:
            beat = self._beats[step.name]
            beat.at = now + min(RETRY_S, beat.codec.spec.every_s or RETRY_S)
            return
        output = self._outputs[step.name]
        if rejected:
            output.not_before = max(output.not_before, now + REJECTED_PAUSE_S)
        match step.kind:
            case StepKind.RELEASE | StepKind.VERIFY:
                output.retry_later(now)
            case StepKind.RESET:
                if output.phase is Phase.DUE:
                    output.come_to_rest(output.rested_at)
                output.try_at = now + RETRY_S
            case StepKind.PAUSE:
                output.pause_at = now + RETRY_S
            case StepKind.REFRESH | StepKind.LOOK:
                output.verified = False
                output.answered = output.answered and step.kind is StepKind.LOOK
                slowly_s = min(REJECTED_PAUSE_S, max(RETRY_S, output.every_s))
                output.refresh_at = now + (slowly_s if rejected else RETRY_S)
            case _:
                output.record_failed_press(maybe_sent=maybe_sent, arrived=arrived, now=now)

    def record_reconnect(self, cells: Cells, now: float, endpoints: Collection[str] = ("",)) -> None:
        """Compare the outputs with what the controller holds after a new connection to these devices; `cells` are those of `read_points`.

        An output to be adopted is kept if it is on, else at rest. A declared hold that is on is kept; one that is off is written
        again. A call is never repeated. All other outputs that are not at rest are released, except at points that show a lamp:
        there a leftover of ours looks like a passenger's call, which must not be cleared.
        """
        for output in self._outputs.values():
            if not output.spec.ends_itself and {point.endpoint for point in output.codec.points} & set(endpoints):
                output.reconnect(cells, now)

    def _restart_cycles(self, cells: Sequence[Cell], now: float) -> None:
        for cycle in self._cycles:
            if not set(cells).isdisjoint(cycle.block.cells):
                cycle.at = now + cycle.every_s

    def _mutual(self, name: str) -> dict[str, float]:
        """Return the outputs that may not be on together with this one, whichever of the two excludes the other, with the pause between them."""
        own = self._outputs[name].spec
        pauses = dict.fromkeys(own.excludes, own.gap_s)
        for other, output in self._outputs.items():
            if name in output.spec.excludes:
                pauses[other] = max(pauses.get(other, 0.0), output.spec.gap_s)
        return {other: gap_s for other, gap_s in pauses.items() if other in self._outputs}

    def _pauses_s(self, name: str) -> float:
        spec = self._outputs[name].spec
        return max(self._excluded[name].values(), default=0.0) + spec.min_repeat_s + spec.reset_first_s

    def _clear_excluded(self, name: str) -> None:
        for other in self._excluded[name]:
            self.release(other)

    def _free_at(self, name: str) -> float:
        """Return when the outputs that this one excludes have been at rest for the gap; infinity while one is on."""
        output = self._outputs[name]
        free = max(output.try_at, output.not_before, -math.inf if output.armed_at is None else output.armed_at)
        for other, gap_s in self._excluded[name].items():
            if self._outputs[other].phase in (Phase.ON, Phase.LEAVING, Phase.RELEASING):
                return math.inf
            free = max(free, self._outputs[other].rested_at + gap_s)
        return free
