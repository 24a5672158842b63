"""The ride of the reference page, run as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import lift_manager.client
from lift_manager.client import errors
from lift_manager.lab.bench import LiftSite
from tests.support.programs import HANGS_S, ROOT

PAGE = (ROOT / "docs" / "reference" / "python-client.md").read_text("utf-8")


@pytest.mark.lift("main", speed=20)
def test_the_ride_of_the_page_gets_there(lift_site: LiftSite, tmp_path: Path) -> None:
    (program,) = (block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "asyncio.run" in block)
    assert len([line for line in program.splitlines() if line.strip()]) <= 15
    ride = tmp_path / "ride.py"
    ride.write_text(program.replace("http://127.0.0.1:5003", lift_site.address), "utf-8")
    done = subprocess.run([sys.executable, ride], capture_output=True, text=True, check=True, timeout=HANGS_S)
    words = [line.split()[0] for line in done.stdout.splitlines()]
    order = [word for number, word in enumerate(words) if word != "wait" and words[number - 1 : number] != [word]]
    assert order == ["enter", "stay", "leave", "done"]


def test_every_error_is_on_the_page() -> None:
    tree = [name for name, found in vars(errors).items() if isinstance(found, type) and issubclass(found, Exception)]
    for name in tree:
        assert f"`{name}`" in PAGE
        assert name in (errors.__doc__ or "")


def test_every_public_name_is_there_and_no_other() -> None:
    for name in lift_manager.client.__all__:
        assert getattr(lift_manager.client, name).__name__ == name
    with pytest.raises(AttributeError, match="has no attribute 'Party'"):
        lift_manager.client.Party  # type: ignore[attr-defined]  # noqa: B018
