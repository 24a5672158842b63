"""The query of an address. There is one way to read it: two would be a way past a check."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import parse_qsl

from fastapi import Request

from lift_manager.web.errors import RequestError

LIMIT_BYTES = 4096
"""Chosen: lift names are short, and a caller's text is quoted in answers."""
TOO_LONG = f"the query is longer than {LIMIT_BYTES} bytes"


class Query(NamedTuple):
    """One query. Nothing of one that is too long may be acted on: what is in it is its beginning."""

    pairs: tuple[tuple[str, str], ...]
    too_long: bool

    def all(self, key: str) -> list[str]:
        """Return every value of a key."""
        return [value for name, value in self.pairs if name == key]


def read_query(query: bytes) -> Query:
    """Return the parameters of a query."""
    # `replace`: what is not UTF-8 is no lift's name either
    pairs = parse_qsl(query[:LIMIT_BYTES].decode("utf-8", "replace"), keep_blank_values=True)
    return Query(tuple(pairs), len(query) > LIMIT_BYTES)


def require_once(request: Request, *names: str) -> None:
    """Raise RequestError for a query that is too long, or gives one of these parameters more than once."""
    query = read_query(request.scope["query_string"])
    if query.too_long:
        raise RequestError("malformed", TOO_LONG, field=names[0])
    for name in names:
        if len(query.all(name)) > 1:
            raise RequestError("malformed", f"{name} is in the query more than once", field=name)
