"""Generates ACCESS.md, the table of which roles may send which requests: `python -m lift_manager.web.access_page`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from lift_manager.api.roles import ROUTES, AccessLevel, Role, Route, refusal

FILE = Path(__file__).with_name("ACCESS.md")

COLUMNS = (
    "no key",
    "viewer",
    "robot, its lift",
    "robot, another lift",
    "rmf, its lift",
    "rmf, another lift",
    "operator",
    "commissioner",
)
NO_KEYS = ("this computer", "another computer")
_HEAD = """# Which roles may send which requests

Written by `python -m lift_manager.web.access_page` from `lift_manager/api/roles.py`; a test compares it and tries
every cell on the application. A request that is not in the table does not exist.

With keys: the site has at least one live key. "no" is 401 without a key and 403 with one.

"""
_WITHOUT_KEYS_HEAD = """
Without keys. On an address that other computers can reach, this needs `api: {without_keys: "<why>"}` in the site file.
Each request has to name the manager by an address, as localhost, or by `host` or one of `host_names` under `api`.

"""


def access_table() -> str:
    """Return the text of ACCESS.md."""
    return _HEAD + "".join(_table(COLUMNS, _with_keys)) + _WITHOUT_KEYS_HEAD + "".join(_table(NO_KEYS, _without_keys))


def _table(columns: tuple[str, ...], cells: Callable[[Route], tuple[bool, ...]]) -> Iterator[str]:
    yield f"| request | needs | {' | '.join(columns)} |\n"
    yield f"|---|---|{'---|' * len(columns)}\n"
    for route in ROUTES:
        marks = ("yes" if may else "no" for may in cells(route))
        yield f"| `{' '.join(route.methods)} {route.path}` | {route.need} | {' | '.join(marks)} |\n"


def _with_keys(route: Route) -> tuple[bool, ...]:
    own, other = ["its"], ["another"]
    return (
        route.need is AccessLevel.NOTHING,
        not refusal(Role.VIEWER, (), route.need, own),
        not refusal(Role.ROBOT, own, route.need, own),
        not refusal(Role.ROBOT, own, route.need, other),
        not refusal(Role.RMF, own, route.need, own),
        not refusal(Role.RMF, own, route.need, other),
        not refusal(Role.OPERATOR, (), route.need, own),
        not refusal(Role.COMMISSIONER, (), route.need, own),
    )


def _without_keys(route: Route) -> tuple[bool, ...]:
    return True, route.need not in {AccessLevel.OPERATE, AccessLevel.COMMISSION}


if __name__ == "__main__":
    FILE.write_text(access_table(), "utf-8")
