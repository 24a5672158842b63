"""Start the program, once the packages that came with it are known to be the ones that Python finds."""

import sys
from importlib.util import find_spec
from pathlib import Path


def stop_if_shadowed() -> None:
    """Stop with one sentence if a sibling package would be imported from elsewhere.

    The names are common ones, and `PYTHONPATH` (ROS fills it) goes before what is installed.
    """
    home = Path(__file__).resolve().parent.parent
    for name in ("drivers", "register_maps", "simulator"):
        spec = find_spec(name)
        found = [*(spec.submodule_search_locations or []), spec.origin] if spec else []
        place = Path(found[0] or "?").resolve() if found else None
        if place != home / name:
            sys.exit(
                f"lift-manager: package '{name}' resolves to {place or 'nothing'}, expected {home / name}; start it with"
                " 'python -I -m lift_manager', without PYTHONPATH, from an environment where nothing else is installed."
            )


def main() -> None:
    stop_if_shadowed()
    from lift_manager.cli.main import app  # noqa: PLC0415  after the guard, for it is the guard's purpose

    app()


if __name__ == "__main__":
    main()
