"""Computes the content of our cells from the state of the outputs. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from drivers.modbus.output import Beat, Cells, Output, put
from drivers.modbus.steps import Phase, Step, StepKind
from register_maps.codec import Block, Cell, CommandCodec
from register_maps.command_codec import Stamp, Written

_BUSY = (Phase.ON, Phase.LEAVING)


class Image:
    """The cells of all outputs of one lift."""

    def __init__(self, outputs: Mapping[str, Output], beats: Mapping[str, Beat], written: Sequence[Written]) -> None:
        """Read the current state of these outputs and beats; `written` are the blocks of the map."""
        self._outputs = outputs
        self._beats = beats
        self.claim: Stamp = ()
        """What each write carries where the controller decides whom it obeys."""
        self._resting: dict[Cell, int] = {cell: 0 for block, _, _ in written for cell in block.cells}
        """All our cells with nothing pressed."""
        self._others: dict[Block | str, tuple[str, ...]] = {}
        """What `others_in_cells` has found, which the map alone decides."""
        codecs = [output.codec for output in outputs.values()] + [beat.codec for beat in beats.values()]
        for codec in codecs:
            put(self._resting, codec.stamp(None))

    def cells(self, step: Step, without: Collection[str]) -> Cells:
        """Return our cells with a step applied; of the other outputs only those that are on are pressed, except `without`."""
        image = dict(self._resting)
        for beat in self._beats.values():
            put(image, beat.codec.stamp(beat.count or None))
        for name, output in self._outputs.items():
            if output.is_asserted and name not in without:
                put(image, output.codec.stamp(output.code))
        if step.block is None:
            put(image, self._codec(step).stamp(step.code))
        put(image, self.claim)
        return image

    def covered_cells(self, step: Step) -> list[Cell]:
        """Return every cell that the writes of a step cover."""
        blocks = self._codec(step).blocks if step.block is None else (step.block,)
        return [cell for block in blocks for cell in block.cells]

    def others_in_cells(self, step: Step) -> tuple[str, ...]:
        """Return the other outputs in the cells of a step, on or not."""
        key = step.block or step.name
        if (known := self._others.get(key)) is None:
            known = self._others[key] = self._find_others(step)
        return known

    def _find_others(self, step: Step) -> tuple[str, ...]:
        if self._codec(step).is_shared:
            return ()
        cells = set(self.covered_cells(step))
        return tuple(
            name
            for name, output in self._outputs.items()
            if name != step.name and any(point.cell in cells for point in output.codec.points)
        )

    def neighbours(self, step: Step) -> tuple[str, ...]:
        """Return the other outputs that a step has to write as pressed, because they are on or may be."""
        outputs = self._outputs
        return tuple(
            name for name in self.others_in_cells(step) if outputs[name].is_asserted or outputs[name].awaits_look
        )

    def is_idle(self, block: Block) -> bool:
        """Whether no output in this block is on or may be; such outputs are refreshed instead, with permission."""
        outputs = [output for output in self._outputs.values() if block in output.codec.blocks]
        return not any(output.awaits_look or (output.phase in _BUSY and not output.is_yielding) for output in outputs)

    def _codec(self, step: Step) -> CommandCodec:
        return self._beats[step.name].codec if step.kind is StepKind.BEAT else self._outputs[step.name].codec
