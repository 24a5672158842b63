"""An office, and a folder of its own for the state of its sites."""

from pathlib import Path

import pytest

from tests.lift_manager.hub.update.office import Office


@pytest.fixture
def office(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Office:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return Office(tmp_path / "office")
