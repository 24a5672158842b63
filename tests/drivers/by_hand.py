"""A write log whose rows are answered by hand."""

import asyncio
from dataclasses import dataclass, field

from drivers.model import Command, Written


@dataclass
class LogByHand:
    """Answers at once while `answers` is set, else when it is told to."""

    answers: bool = True
    trouble: str | None = None
    rows: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)
    """Every press that was to be written down: the command, and its frames."""
    waiting: list[asyncio.Future[str | None]] = field(default_factory=list)
    told: list[Written] = field(default_factory=list)

    def before(self, command: Command, frames: tuple[str, ...], *, again: bool = False) -> asyncio.Future[str | None]:
        self.rows.append((f"{command} again" if again else str(command), frames))
        row: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()
        if self.answers:
            row.set_result(self.trouble)
        else:
            self.waiting.append(row)
        return row

    def wrote(self, written: Written) -> None:
        self.told.append(written)

    def answer(self, trouble: str | None = None) -> None:
        """Answer the row that has waited longest."""
        self.waiting.pop(0).set_result(trouble)

    @property
    def lines(self) -> list[str]:
        return [f"{each.what} {each.name}".strip() + (" failed" if each.failure else "") for each in self.told]
