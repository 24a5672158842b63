"""A journal that a test writes."""

from pathlib import Path

from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow

SITE = "Main hospital"
T0 = 1_795_200_000_000_000
"""When the first row is written: microseconds since 1970."""
DAY = 86_400_000_000


class Journal:
    """Writes the journal of the site SITE as its manager does; a row a second."""

    def __init__(self, path: Path, since_s: int = 0) -> None:
        self.path = path
        self._store = SqliteStore(path, SITE, Limits(keep_days=1, max_mb=500))
        self._store.load()
        self._at = T0 + since_s * 1_000_000

    def write(self, *texts: str, lift: str = "east", kind: str = "press", caller: str = "workshop:r1") -> None:
        rows = []
        for text in texts:
            rows.append(PendingRow(self._at, Row(RowKind(kind), text, lift, caller)))
            self._at += 1_000_000
        self._store.commit({}, rows)

    def cut_through(self, seq: int) -> None:
        """Go on a day after this row, when those up to it are too old."""
        check = True
        while self._store.do_upkeep(T0 + DAY + seq * 1_000_000, check=check).more:
            check = False

    def end(self) -> None:
        self._store.close()
