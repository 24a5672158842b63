"""What to write when: every output of one lift as a small state machine. Pure; time is a number handed in.

An output rests, is due to be pressed, is on, or is being let go. Letting go comes first, is repeated until it is verified,
and needs nobody's permission. A press is tried once. A hold is a level: writing it again within its limit is the same
command, not another one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum, unique

from register_maps.codec import CommandCodec
from register_maps.schema import Command
from register_maps.words import Table

RETRY_S = 0.2
"""Pause before a release, or the refresh of a hold that did not stick, is written again. Chosen: five tries a second do not
load a controller, and a button left pressed is let go soon."""

REJECTED_PAUSE_S = 2.0
"""Pause before an output whose press the controller answered with an exception is pressed for the same hold again. Chosen: as for a
failed call; a controller that says no is not to be asked at the pace of the polls."""

Cells = Mapping[tuple[Table, int], int]


@unique
class Phase(StrEnum):
    """Where one output is."""

    REST = "rest"
    DUE = "due"
    """Wanted, not written yet."""
    LEAVING = "leaving"
    """Its press is on its way: whoever wants rest now must let it go."""
    ON = "on"
    LETTING_GO = "letting go"


@unique
class StepKind(StrEnum):
    """What a write is for; only a release needs no permit."""

    PRESS = "press"
    REFRESH = "refresh"
    RELEASE = "release"


@dataclass(frozen=True, slots=True)
class Step:
    """One write to carry out now."""

    kind: StepKind
    name: str
    code: int | None


@dataclass(slots=True)
class _Output:
    codec: CommandCodec
    phase: Phase = Phase.REST
    code: int | None = None
    next_code: int | None = None
    """A press that waits for this output to come to rest."""
    again: bool = False
    fall_at: float = math.inf
    refresh_at: float = math.inf
    try_at: float = -math.inf
    not_before: float = -math.inf
    rested_at: float = -math.inf
    verified: bool = False

    @property
    def spec(self) -> Command:
        return self.codec.spec


class Outputs:
    """All outputs of one lift and what is to be done about them."""

    def __init__(self, commands: Mapping[str, CommandCodec]) -> None:
        """Every output is taken to be at rest until `reconnected` says what the controller holds."""
        self._outputs = {name: _Output(codec) for name, codec in commands.items()}
        self.image: dict[tuple[Table, int], int] = {}
        """What every cell of ours was last told to hold; a block write takes its neighbours from here."""
        for codec in commands.values():
            self.image.update(codec.encode(None))

    def press(self, name: str, code: int | None, now: float) -> None:
        """Want a press. A press of the same output that is still on is let go first."""
        output = self._outputs[name]
        self._clear_excluded(output)
        if output.phase in (Phase.REST, Phase.DUE):
            output.phase, output.code = Phase.DUE, code
        else:
            output.again, output.next_code = True, code
            self._drop(output)
        output.fall_at = now + (output.spec.max_hold_s or math.inf)

    def hold(self, name: str, now: float) -> None:
        """Want a hold, or renew it until `max_hold_s` from now."""
        output = self._outputs[name]
        output.fall_at = now + (output.spec.max_hold_s or 0.0)
        if output.phase is Phase.REST:
            self._clear_excluded(output)
            output.phase, output.code = Phase.DUE, 1
        elif output.phase is Phase.LETTING_GO:
            output.again, output.next_code = True, 1

    def let_go(self, name: str) -> None:
        """Want rest, now."""
        output = self._outputs[name]
        output.again = False
        self._drop(output)

    def let_all_go(self) -> None:
        """Want rest everywhere."""
        for name in self._outputs:
            self.let_go(name)

    def phase(self, name: str) -> Phase:
        """Where this output is."""
        return self._outputs[name].phase

    def verified(self, name: str) -> bool:
        """Whether it is on and the controller was seen to hold it."""
        output = self._outputs[name]
        return output.phase is Phase.ON and output.verified

    @property
    def at_rest(self) -> bool:
        """Whether nothing is on, due or being let go."""
        return all(output.phase is Phase.REST for output in self._outputs.values())

    def next(self, now: float) -> Step | None:
        """Hand out the write that is due now, releases first; None when there is none.

        A press that is handed out is on its way: its fate is told by `written` or `failed`.
        """
        for output in self._outputs.values():
            if output.phase is Phase.ON and now >= output.fall_at:
                self._drop(output)
        due: Step | None = None
        for name, output in self._outputs.items():
            if output.phase is Phase.LETTING_GO and now >= output.try_at:
                return Step(StepKind.RELEASE, name, None)
            if due is None and output.phase is Phase.DUE and now >= self._free_at(output):
                due = Step(StepKind.PRESS, name, output.code)
            if due is None and output.phase is Phase.ON and now >= output.refresh_at:
                due = Step(StepKind.REFRESH, name, output.code)
        if due is not None and due.kind is StepKind.PRESS:
            self._outputs[due.name].phase = Phase.LEAVING
        return due

    def wake_at(self) -> float:
        """Earliest time at which `next` may have something; infinity when only an event can change that."""
        times = [math.inf]
        for output in self._outputs.values():
            if output.phase is Phase.LETTING_GO:
                times.append(output.try_at)
            elif output.phase is Phase.DUE:
                times.append(self._free_at(output))
            elif output.phase is Phase.ON:
                times.append(min(output.fall_at, output.refresh_at))
        return min(times)

    def cells(self, step: Step) -> Cells:
        """Image of our cells with this step applied."""
        return self.image | self._outputs[step.name].codec.encode(step.code)

    def written(self, step: Step, now: float) -> None:
        """The controller echoed the write. That proves nothing yet."""
        output = self._outputs[step.name]
        self.image.update(output.codec.encode(step.code))
        if step.kind is StepKind.PRESS and output.phase is Phase.LEAVING:
            output.phase = Phase.ON
            output.verified = False
            if output.spec.width_s is not None:
                output.fall_at = now + output.spec.width_s
        if output.phase is Phase.ON and output.spec.action == "hold":
            output.refresh_at = now + (output.spec.refresh_s or math.inf)

    def looked(self, step: Step, *, holds: bool, now: float) -> None:
        """The cells were read back; `holds` says whether they hold what the step wrote."""
        output = self._outputs[step.name]
        if output.phase is Phase.ON and step.kind is not StepKind.RELEASE:
            output.verified = holds
            if not holds and output.spec.action == "hold":
                output.refresh_at = min(output.refresh_at, now + RETRY_S)
        elif output.phase is Phase.LETTING_GO and step.kind is StepKind.RELEASE:
            if holds:
                self._rest(output, now)
            else:
                output.try_at = now + RETRY_S

    def failed(self, step: Step, *, maybe_sent: bool, now: float, rejected: bool = False) -> None:
        """The write or its read-back failed. What may have been pressed is let go; a release is tried again."""
        output = self._outputs[step.name]
        if rejected:
            output.not_before = now + REJECTED_PAUSE_S
        if step.kind is StepKind.RELEASE:
            output.try_at = now + RETRY_S
        elif step.kind is StepKind.REFRESH:
            output.verified = False
            output.refresh_at = now + RETRY_S
        elif not maybe_sent and output.phase in (Phase.LEAVING, Phase.LETTING_GO):
            self._rest(output, output.rested_at)
            output.try_at = now + RETRY_S
        elif output.phase is Phase.LEAVING:
            output.phase, output.try_at = Phase.LETTING_GO, now

    def reconnected(self, cells: Cells, now: float) -> None:
        """Compare with what the controller holds after a new connection.

        A hold that is still wanted and still there is adopted; one that is gone is written again as the level it is. A
        call is never repeated. Everything else of ours that is not at rest is let go.
        """
        for output in self._outputs.values():
            rest = output.codec.encode(None)
            self.image.update({cell: value for cell, value in cells.items() if cell in rest})
            if output.phase is Phase.ON and output.spec.action == "hold" and self._adopted(output, cells, now):
                continue
            if output.phase in (Phase.REST, Phase.DUE) and _match(cells, rest):
                continue
            if output.phase is Phase.DUE:
                output.again, output.next_code = True, output.code
            # written even if it reads at rest: the controller may still find our press in the connection that broke
            output.phase, output.try_at, output.verified = Phase.LETTING_GO, now, False

    def _adopted(self, output: _Output, cells: Cells, now: float) -> bool:
        """Keep a wanted hold as it is. One that the controller dropped is written again, unless it is a call."""
        output.verified = _match(cells, output.codec.encode(output.code))
        output.refresh_at = min(now, output.refresh_at)
        return output.verified or not output.codec.is_call

    def _drop(self, output: _Output) -> None:
        if output.phase in (Phase.ON, Phase.LEAVING):
            output.phase, output.try_at = Phase.LETTING_GO, -math.inf
        elif output.phase is Phase.DUE:
            output.phase = Phase.REST
        output.verified = False

    def _rest(self, output: _Output, now: float) -> None:
        output.phase, output.rested_at, output.verified = Phase.REST, now, False
        if output.again:
            output.again = False
            output.phase, output.code = Phase.DUE, output.next_code

    def _clear_excluded(self, output: _Output) -> None:
        for name in output.spec.excludes:
            if name in self._outputs:
                self.let_go(name)

    def _free_at(self, output: _Output) -> float:
        """Return when the outputs that this one excludes will have rested for the gap; infinity while one is on."""
        free = max(output.try_at, output.not_before)
        for name in output.spec.excludes:
            other = self._outputs.get(name)
            if other is None:
                continue
            if other.phase in (Phase.ON, Phase.LEAVING, Phase.LETTING_GO):
                return math.inf
            free = max(free, other.rested_at + output.spec.gap_s)
        return free


def _match(cells: Cells, wanted: Cells) -> bool:
    return all(cells.get(cell) == value for cell, value in wanted.items())
