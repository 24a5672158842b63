"""A table of inputs that all show one behaviour: one test, which names every row that is not as it should be."""

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pytest

LONGEST_NOTE = 300


def each_row(
    names: str | Sequence[str], rows: Iterable[Any] | Callable[[], Iterable[Any]]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Call the test once per row, as `pytest.mark.parametrize` does with the same names and rows, but in one item.

    Each row is tried, whatever became of the others; the failure is a group with a note of the row at each of its errors. Fixtures
    are shared by all rows, so a test whose rows leave something in one (a file, what was printed) stays parametrized. Rows that are
    expensive to make are given as a function, which is called when the test runs.
    """
    arguments = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    # an enum is callable too, and a table of its members
    given = list(rows) if isinstance(rows, Iterable) else rows

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def every_row(*bound: Any, **fixtures: Any) -> None:
            table = given if isinstance(given, list) else list(given())
            assert table, "a table without rows shows nothing"
            errors = []
            for each in table:
                name, row = _named(each, single=names == arguments[0])
                try:
                    test(*bound, **fixtures, **dict(zip(arguments, row, strict=True)))
                except Exception as error:  # noqa: BLE001  all of them are raised below
                    errors.append(_noted(error, name))
                except pytest.fail.Exception as failed:  # no Exception, and what `pytest.raises` fails with
                    errors.append(_noted(AssertionError(str(failed)), name))
            if errors:
                raise ExceptionGroup(f"{len(errors)} of {len(table)} rows", errors)

        own = inspect.signature(test)
        kept = [parameter for name, parameter in own.parameters.items() if name not in arguments]
        every_row.__signature__ = own.replace(parameters=kept)  # type: ignore[attr-defined]  # what pytest is to give
        return every_row

    return decorate


def _named(row: Any, *, single: bool) -> tuple[str, tuple[Any, ...]]:
    """Return what a row is called, and its values; a row of `pytest.param` may have a name."""
    if isinstance(row, type(pytest.param())):
        return str(row.id or row.values), tuple(row.values)
    values = (row,) if single else tuple(row)
    return str(values), values


def _noted(error: Exception, name: str) -> Exception:
    error.add_note(f"in the row {name}"[:LONGEST_NOTE])
    return error
