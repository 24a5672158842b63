"""A recorder whose manager can be killed."""

import asyncio
from asyncio import Future
from collections.abc import Callable

from lift_manager.lift.journal import Row
from lift_manager.runtime.recorder import Recorder, SavedLift


class MortalRecorder:
    """The recorder of one manager. Once that is killed it writes nothing more, whatever timer of it goes off later."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self.killed = False

    @property
    def trouble(self) -> str:
        return self._recorder.trouble

    def recall(self, lift: str) -> SavedLift | None:
        return self._recorder.recall(lift)

    def keep(self, lift: str, saved: SavedLift) -> None:
        if not self.killed:
            self._recorder.keep(lift, saved)

    def note(self, row: Row) -> None:
        if not self.killed:
            self._recorder.note(row)

    def commit_now(self, row: Row) -> Future[str | None]:
        if not self.killed:
            return self._recorder.commit_now(row)
        never: Future[str | None] = asyncio.get_running_loop().create_future()
        return never

    def written(self, lift: str) -> Future[None] | None:
        return self._recorder.written(lift)

    async def run(self, report: Callable[[str], None]) -> None:
        await self._recorder.run(report)

    async def settled(self) -> None:
        await self._recorder.settled()
