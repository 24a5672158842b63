"""What a record is bound to: the map of a lift, and what the site file adds to it."""

from __future__ import annotations

import hashlib
import json

from lift_manager.commissioning.checkout.record import MapIdentity
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite


def identify_map(loaded: LoadedSite, lift: str) -> MapIdentity:
    """Return the identity of the map of a lift, as a record of its acceptance test has it.

    The addresses of the controllers are not part of it: `Record.controller` has that of the one that was tested.
    """
    source, spec = loaded.maps[lift], loaded.site.lifts[lift]
    added = {
        "floors": [
            [floor, entry.code, None if entry.doors is None else [side.value for side in entry.doors]]
            for floor, entry in spec.floors.items()
        ],
        "offset": {table.value: by for table, by in spec.offset.items()},
        "units": {name: device.unit_id for name, device in devices(loaded.site, spec, source.map).items()},
    }
    text = json.dumps(added, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return MapIdentity(
        name=source.map.name,
        title=source.map.title,
        sha256=source.sha256,
        lift_sha256=hashlib.sha256(text.encode()).hexdigest(),
    )
