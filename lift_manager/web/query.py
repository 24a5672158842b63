"""What stands behind the `?` of an address. The one reading of it: two would be a way past a check."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import parse_qsl

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
    """Return what a query says."""
    # `replace`: what is not UTF-8 is no lift's name either
    pairs = parse_qsl(query[:LIMIT_BYTES].decode("utf-8", "replace"), keep_blank_values=True)
    return Query(tuple(pairs), len(query) > LIMIT_BYTES)
