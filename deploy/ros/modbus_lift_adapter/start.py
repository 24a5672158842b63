"""Starts the adapter out of the modules that came with this package."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
PLACES = (HERE / "vendored", HERE.parents[2])
"""Beside this file where the package is installed; in the repository where it is only linked (`colcon build --symlink-install`)."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; return its exit code."""
    place = next((place for place in PLACES if (place / "lift_manager" / "rmf").is_dir()), None)
    if place is None:
        sys.exit(
            f"modbus_lift_adapter: the modules of the lift manager are missing from {PLACES[0]}; build the package anew"
        )
    # first, because PYTHONPATH may hold another version of the lift manager
    sys.path.insert(0, str(place))
    code: int = importlib.import_module("lift_manager.rmf.ros_node").main(args)
    return code
