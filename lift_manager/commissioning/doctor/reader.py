"""Reads from one controller, and keeps every answer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.errors import ConnectFailed
from lift_manager.commissioning.doctor.evidence import Answer, Purpose
from lift_manager.commissioning.doctor.subjects import ExaminedController, UnitBlock
from lift_manager.commissioning.prober import Prober
from register_maps.words import Table

HOPELESS = 3
"""Reads in a row without any answer, from the first one on, after which doctor gives up on a controller."""

Report = Callable[[str], None]


@dataclass
class Reader:
    """One paced read at a time over one connection, in one list of answers."""

    prober: Prober
    controller: ExaminedController
    polls: tuple[UnitBlock, ...]
    """What a manager would read; the first of them is read wherever any block would do."""
    began: float
    report: Report
    """Receives a line about each step."""
    answers: list[Answer] = field(default_factory=list)

    @property
    def now(self) -> float:
        """Seconds from the beginning of the run."""
        return asyncio.get_running_loop().time() - self.began

    @property
    def is_hopeless(self) -> bool:
        """Whether nothing at all was answered, although every unit was tried."""
        tried = {answer.unit for answer in self.answers}
        is_enough = len(self.answers) >= HOPELESS and tried >= {unit for unit, _ in self.polls}
        return is_enough and not any(answer.is_answer for answer in self.answers)

    def is_silent(self, unit: int) -> bool:
        """Whether a unit never answered: each further read from it would take as long as many others."""
        return not any(answer.is_answer for answer in self.answers if answer.unit == unit)

    async def read(
        self, purpose: Purpose, unit: int, table: Table, address: int, count: int = 1, turn: int = 0
    ) -> Answer:
        """Read and record; a connection that cannot be made again is trouble, but for the first one."""
        at_s = self.now
        try:
            got = await self.prober.read(table, address, count, unit=unit)
        except ConnectFailed as error:
            trouble = f"no new connection: {error}"
            answer = Answer(at_s, purpose, unit, table, address, count, trouble=trouble, turn=turn)
        else:
            answer = Answer.of(got, at_s, purpose, turn)
        self.answers.append(answer)
        return answer

    async def read_block(self, purpose: Purpose, what: UnitBlock, turn: int = 0) -> Answer:
        """Read a block of a unit."""
        unit, block = what
        return await self.read(purpose, unit, block.table, block.start, block.count, turn)
