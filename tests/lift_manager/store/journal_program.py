"""A writer to be killed: presses one after the other, and says each number once its row is on the disk.

python -m tests.lift_manager.store.journal_program FILE FIRST PRESSES NOTES [KEEP_MB]
"""

import asyncio
import sys
from pathlib import Path

from lift_manager.lift.journal import Row, RowKind
from tests.lift_manager.store.journal_disk import journal, press


async def main(path: Path, first: int, presses: int, notes: int, max_mb: int = 500) -> None:
    kept = journal(path, max_mb=max_mb)
    running = asyncio.ensure_future(kept.run(lambda _: None))
    for number in range(first, first + presses):
        for _ in range(notes):
            kept.note(Row(RowKind.WRITE, f"written {number}", "east", data={"frames": ["000100000006" * 8]}))
        assert await kept.commit_now(press(number)) is None
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), *map(int, sys.argv[2:])))
