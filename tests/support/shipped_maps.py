"""Shipped maps, compiled once for all tests of a process: reading one takes ten times as long as a test that uses it."""

from functools import cache

from register_maps.codec import Codec, compile_map
from register_maps.load import load


@cache
def compiled(name: str) -> Codec:
    """Return a shipped map, compiled. It never changes."""
    return compile_map(load(name).map)
