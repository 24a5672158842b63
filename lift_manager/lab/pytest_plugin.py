"""pytest fixtures for robot teams: a lift, its controller, its cable and its manager, all of which can be made to fail.

pytest loads this file in every project of this interpreter, so it imports nothing heavy until a test requests a fixture.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lift_manager.__main__ import stop_if_shadowed

if TYPE_CHECKING:
    from lift_manager.lab.bench import Bench, LiftSimulator, LiftSite, ModbusFaults

MARKER = (
    "lift(name, *, map, floors, speed, faults, **keys): a simulated lift for lift_simulator, modbus_faults and lift_site;"
    " `keys` are those of a lift in a site file; one marker for each lift"
)

try:
    stop_if_shadowed()
except SystemExit as shadowed:
    raise pytest.UsageError(
        f"{shadowed} If no test needs a lift, run 'pytest -p no:lift_manager' to leave the plugin out."
    ) from None


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line("markers", MARKER)


@pytest.fixture
def lift_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    """The base of the other fixtures: a thread with one lift for each marker."""
    # heavy imports: only when a test needs them
    from lift_manager.lab.bench import Bench  # noqa: PLC0415
    from lift_manager.lab.bench.plan import read_marker  # noqa: PLC0415

    with ExitStack() as stack:
        with _in_words():
            markers = [read_marker(mark.args, mark.kwargs) for mark in _marks(request)]
            bench = stack.enter_context(Bench(markers, near=request.path.parent, folder=tmp_path))
        yield bench


@pytest.fixture
def lift_simulator(lift_bench: Bench) -> LiftSimulator:
    """A simulated lift with a Modbus/TCP controller on a free loopback port."""
    with _in_words():
        return lift_bench.simulator()


@pytest.fixture
def modbus_faults(lift_bench: Bench) -> ModbusFaults:
    """The wires to the controllers, with faults on request; `lift_site` uses them."""
    return lift_bench.modbus_faults()


@pytest.fixture
def lift_site(lift_bench: Bench) -> LiftSite:
    """A whole manager on a free loopback port, in front of faulty wires and simulated lifts."""
    with _in_words():
        return lift_bench.site()


def _marks(request: pytest.FixtureRequest) -> list[pytest.Mark]:
    """Return the markers of the test, else of its class, else of its module, from top to bottom."""
    found = list(request.node.iter_markers_with_node(name="lift"))
    marks = [mark for node, mark in found if node is found[0][0]]
    # decorators are applied from the bottom up
    return marks[::-1] if found and found[0][0] is request.node else marks


@contextmanager
def _in_words() -> Iterator[None]:
    """Report a mistake in the test by its message alone, without an internal traceback."""
    from lift_manager.lab.bench import BenchError  # noqa: PLC0415

    try:
        yield
    except BenchError as error:
        raise pytest.fail.Exception(str(error), pytrace=False) from None
