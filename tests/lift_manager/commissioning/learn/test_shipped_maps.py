"""A simulated ride leads `learn` to position, door and motion of every shipped map that has them, and never to wrong ones."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.commissioning.learn.analyse import Findings, analyse
from lift_manager.commissioning.learn.samples import MarkKind
from lift_manager.commissioning.learn.tracks import Confidence
from lift_manager.lab.plant import default_floors
from register_maps.load import shipped
from tests.lift_manager.commissioning.learn.compared import confident, disagreements
from tests.lift_manager.commissioning.learn.riding import ridden
from tests.support.programs import ROOT
from tests.support.shipped_maps import compiled

BLIND = "adam-pushbutton", "moxa-e1211", "waveshare-relay"
"""Maps of output modules: they show neither car nor door, so that nobody can ride by them."""
COLUMNS = {
    "position": ("car_floor", "car_position"),
    "door": ("door.front",),
    "motion": ("motion",),
    "life": ("alive",),
}


@pytest.mark.parametrize("name", [name for name in shipped() if name not in BLIND])
def test_a_careful_ride_finds_every_position_door_motion_and_counter_of_a_map(name: str, tmp_path: Path) -> None:
    truth = compiled(name)
    got = ridden(truth)
    found = analyse(got.recording)
    assert disagreements(got, found, truth, tmp_path) == set()
    assert got.writes == 0
    wanted = {signal for signals in COLUMNS.values() for signal in signals} & truth.signals.keys()
    assert {one: confident(found).get(one) for one in wanted} == dict.fromkeys(wanted, Confidence.SURE)
    assert documented()[name] == row(found)


@pytest.mark.parametrize("name", BLIND)
def test_of_a_module_without_inputs_nothing_is_found(name: str) -> None:
    found = analyse(
        ridden(compiled(name), plan=[next(iter(default_floors(compiled(name).map)))] * 2, marks="").recording
    )
    assert found.proposals == ()
    assert any("nothing that was read ever changed" in caution for caution in found.cautions)
    assert documented()[name] == ["-"] * len(COLUMNS)


@pytest.mark.parametrize("name", [name for name in shipped() if name not in BLIND])
def test_a_careless_ride_leads_to_nothing_wrong(name: str, tmp_path: Path) -> None:
    truth = compiled(name)
    low, high, *_ = default_floors(truth.map)
    got = ridden(truth, plan=[low, high, low])
    for also in ({MarkKind.CLOSED}, {MarkKind.DOOR}, set[MarkKind]()):
        found = analyse(got.with_marks(MarkKind.OPEN, MarkKind.MOVING, *also))
        assert (also, disagreements(got, found, truth, tmp_path)) == (also, set())
        assert Confidence.SURE not in {one for signal, one in confident(found).items() if signal != "alive"}, also


def row(found: Findings) -> list[str]:
    """Return the row of the table in the documentation: address and confidence of each kind of signal."""
    return [", ".join(_cells(found, signals)) or "-" for signals in COLUMNS.values()]


def _cells(found: Findings, signals: tuple[str, ...]) -> Iterator[str]:
    for proposal in found.proposals:
        if proposal.signal in signals:
            places = [
                str(proposal.spec[key])
                for key in ("at", "open_limit", "closed_limit", "up", "down")
                if key in proposal.spec
            ]
            bits: list[str] = next(
                (proposal.spec[key] for key in ("one_of", "open_limits") if key in proposal.spec), []
            )
            places += [bits[0], *(["..."] if len(bits) > 2 else []), bits[-1]] if bits else []
            yield f"{' '.join(places)} ({proposal.confidence})"


def documented() -> dict[str, list[str]]:
    """Return the table of the documentation."""
    page = (ROOT / "docs" / "how-to" / "unknown-controller.md").read_text("utf-8")
    rows = [
        [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        for line in page.splitlines()
        if line.startswith("| `")
    ]
    return {name: cells for name, *cells in rows if re.fullmatch("[a-z0-9-]+", name) and name in shipped()}
