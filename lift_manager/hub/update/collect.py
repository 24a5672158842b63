"""Collects the files of a site that go into an update: site file, maps, announcements and named files, and never a secret."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from lift_manager.api.keys import holds_key
from lift_manager.config.load import LoadedSite
from lift_manager.hub.errors import UpdateRefused, file_errors
from lift_manager.hub.update.package import SITE_FILE
from register_maps.load import MAPS


def collect(loaded: LoadedSite, more: Iterable[Path]) -> dict[str, bytes]:
    """Return the files by name; `more` are relative to the site file. Raises UpdateRefused."""
    folder = Path(os.path.abspath(loaded.path.parent))  # noqa: PTH100  links stay: they are part of the names
    used = {one.path for one in (*loaded.maps.values(), *loaded.spare_maps.values())}
    paths = [path for path in used if path.resolve().parent != MAPS.resolve()]
    if (announcements := loaded.site.announcements) is not None and not Path(announcements).is_absolute():
        paths += sorted(path for path in (folder / announcements).iterdir() if path.is_file())
    paths += [folder / path for path in more]
    found = {SITE_FILE: _content(loaded.path)}
    for path in paths:
        inside = Path(os.path.abspath(path))  # noqa: PTH100
        if not inside.is_relative_to(folder):
            raise UpdateRefused(
                f"{path} is not in the folder of {loaded.path}, and could not be found at the site; put it there"
            )
        found[str(inside.relative_to(folder))] = _content(path)
    return found


def _content(path: Path) -> bytes:
    with file_errors(path, "read"):
        data = path.read_bytes()
    if b"PRIVATE KEY-----" in data or holds_key(data.decode("utf-8", "ignore")):
        raise UpdateRefused(
            f"{path} holds a key, and an update never holds a secret: everybody who has the hub can read it"
        )
    return data
