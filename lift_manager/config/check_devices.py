"""Whether every device of a lift has its place, and its addresses are still on the wire when they are moved."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from register_maps.codec import Codec
from register_maps.plain import closest


def check_devices(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    """Yield endpoints without a place, places without an endpoint, and offsets that cannot be."""
    yield from _endpoints(key, lift, codec)
    yield from _offsets(key, codec)


def _endpoints(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    there = codec.map.endpoints
    for name in lift.endpoints.keys() - there.keys():
        hint = closest(name, there) or f"; it has {', '.join(there) or 'none'}"
        missing = "" if there else ", and an `override` can add one"
        yield Problem((*key, "endpoints", name), f"{codec.map.name} has no endpoint {name}{hint}{missing}")
    for name, endpoint in there.items():
        if name not in lift.endpoints:
            about = f" ({endpoint.note})" if endpoint.note else ""
            message = (
                f"the endpoint {name}{about} of {codec.map.name} has no place; "
                f"say `{name}: {{controller: ...}}` with the name of its entry under `controllers`"
            )
            yield Problem((*key, "endpoints"), message)


def _offsets(key: Key, codec: Codec) -> Iterator[Problem]:
    for table in codec.offset:
        where = (*key, "offset", table)
        spans = codec.served.get(table)
        if spans is None:
            elsewhere = any(space.endswith(f"/{table}") for space in codec.served)
            aside = "; an offset does not move those of an endpoint" if elsewhere else ""
            own = " of the controller itself" if elsewhere else ""
            yield Problem(where, f"{codec.map.name} uses no {table} addresses{own}{aside}")
        elif any(span.start < 0 or span.stop > 0x10000 for span in spans):
            yield Problem(where, f"moves {table} addresses of {codec.map.name} out of 0 to 65535 on the wire")
