"""Checks that every endpoint of a lift has a controller, and that offsets keep addresses in range."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from register_maps.codec import Codec
from register_maps.error_texts import closest


def check_devices(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    """Yield endpoints without a controller, unknown endpoints, and invalid offsets."""
    yield from _check_endpoints(key, lift, codec)
    yield from _check_offsets(key, codec)


def _check_endpoints(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    endpoints = codec.map.endpoints
    for name in lift.endpoints.keys() - endpoints.keys():
        hint = closest(name, endpoints) or f"; it has {', '.join(endpoints) or 'none'}"
        missing = "" if endpoints else ", and an `override` can add one"
        yield Problem((*key, "endpoints", name), f"{codec.map.name} has no endpoint {name}{hint}{missing}")
    for name, endpoint in endpoints.items():
        if name not in lift.endpoints:
            note = f" ({endpoint.note})" if endpoint.note else ""
            message = (
                f"the endpoint {name}{note} of {codec.map.name} has no place; "
                f"say `{name}: {{controller: ...}}` with the name of its entry under `controllers`"
            )
            yield Problem((*key, "endpoints"), message)


def _check_offsets(key: Key, codec: Codec) -> Iterator[Problem]:
    for table in codec.offset:
        where = (*key, "offset", table)
        spans = codec.served.get(table)
        if spans is None:
            elsewhere = any(space.endswith(f"/{table}") for space in codec.served)
            hint_offset = "; an offset does not move those of an endpoint" if elsewhere else ""
            own = " of the controller itself" if elsewhere else ""
            yield Problem(where, f"{codec.map.name} uses no {table} addresses{own}{hint_offset}")
        elif any(span.start < 0 or span.stop > 0x10000 for span in spans):
            yield Problem(where, f"moves {table} addresses of {codec.map.name} out of 0 to 65535 on the wire")
