"""A hub with a site, and the journal of that site."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lift_manager.hub.rig import Rig
from tests.support.journal import Journal


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    rig = Rig(tmp_path / "hub")
    rig.add("berlin")
    return rig


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "berlin.db")
    yield journal
    journal.end()
