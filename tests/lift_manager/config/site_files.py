"""What the tests of site files share: good files, edits that spoil them, and what is expected to be said about that."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from lift_manager.config.load import LoadedSite, load_site
from register_maps.errors import Finding, MapFileError
from register_maps.load import MAPS

ROOT = Path(__file__).resolve().parents[3]

GENERIC = """\
schema: 1
name: A building
controllers:
  plc: {host: 10.0.0.5, port: 502, map: generic-registers}
lifts:
  main:
    controller: plc
    access: control
    floors: {B1: -1, L1: 1, L2: 2}
"""
TWO_STOP = """\
schema: 1
name: A building
controllers:
  plc: {host: 10.0.0.5, map: two-stop-agv}
lifts:
  goods:
    controller: plc
    access: control
    accept_latching: a person stands beside it
    floors: {L1: 0, L2: 1}
"""
SECOND_LIFT = """\
  second:
    controller: plc
    access: control
    floors: {B1: -1, L1: 1, L2: 2}
"""


@dataclass(frozen=True)
class Said:
    """A finding that is expected: its place, and words that its message must hold."""

    line: int | None
    key: str
    words: tuple[str, ...]

    def fits(self, finding: Finding) -> bool:
        place = (finding.line, finding.key) == (self.line, self.key)
        return place and all(word in finding.message for word in self.words)


def said(line: int | None, key: str, *words: str) -> Said:
    return Said(line, key, words)


def edited(text: str, *edits: tuple[str, str]) -> str:
    for old, new in edits:
        assert text.count(old) == 1, f"{old!r} is not in the file exactly once"
        text = text.replace(old, new)
    return text


def load(folder: Path, text: str, *edits: tuple[str, str]) -> LoadedSite:
    path = folder / "site.yaml"
    path.write_text(edited(text, *edits), "utf-8")
    return load_site(path)


def findings(folder: Path, text: str, *edits: tuple[str, str]) -> tuple[Finding, ...]:
    with pytest.raises(MapFileError) as caught:
        load(folder, text, *edits)
    return caught.value.findings


def assert_says_exactly(found: tuple[Finding, ...], *expected: Said) -> None:
    listing = "\n".join(map(str, found))
    assert len(found) == len(expected), listing
    for wanted in expected:
        assert any(wanted.fits(finding) for finding in found), f"{wanted} is not in\n{listing}"


def my_map(folder: Path, *edits: tuple[str, str], shipped: str = "generic-registers") -> Path:
    """A copy of a shipped map beside the site file, changed."""
    path = folder / "mine.yaml"
    path.write_text(edited((MAPS / f"{shipped}.yaml").read_text("utf-8"), *edits), "utf-8")
    return path


def line_of(path: Path, start: str) -> int:
    return next(n for n, line in enumerate(path.read_text("utf-8").splitlines(), 1) if line.strip().startswith(start))
