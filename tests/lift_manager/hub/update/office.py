"""An office that signs updates, and sites that take them: real folders, real site files, and no NATS."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from lift_manager.config.load import LoadedSite, load_site
from lift_manager.hub.update.collect import collect
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.package import Content, make_package, read_private_key, write_key
from register_maps.errors import Finding
from register_maps.load import MAPS

AT = datetime(2026, 11, 28, 12, tzinfo=UTC)


@dataclass
class Office:
    """The key of a person, and a folder of drafts."""

    folder: Path
    key: Ed25519PrivateKey = field(init=False)
    public: Path = field(init=False)

    def __post_init__(self) -> None:
        self.folder.mkdir()
        self.public, _ = write_key(self.folder / "office.key")
        self.key = read_private_key(self.folder / "office.key", str)

    def site(self, site: str = "berlin", **changes: Any) -> dict[str, Any]:
        """A site file with one lift whose map came with it."""
        found: dict[str, Any] = {
            "schema": 1,
            "name": f"The {site}",
            "hub": {
                "site": site,
                "password": str(self.folder / "manager.password"),
                "updates": [str(self.public)],
            },
            "controllers": {"plc": {"host": "192.0.2.10", "map": "own.yaml"}},
            "lifts": {
                "goods": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}},
            },
        }
        return found | changes

    def draft(self, site: dict[str, Any], own_map: str = "") -> LoadedSite:
        """Write a site file with its map, and check it."""
        folder = self.folder / "drafts" / str(len(list(self.folder.glob("drafts/*"))))
        folder.mkdir(parents=True)
        (folder / "own.yaml").write_text(own_map or OWN_MAP)
        (folder / "site.yaml").write_text(yaml.safe_dump(site, sort_keys=False))
        return load_site(folder / "site.yaml")

    def content(self, number: int, site: dict[str, Any], *, of: str = "berlin", own_map: str = "") -> Content:
        files = collect(self.draft(site, own_map), ())
        return Content.of(site=of, number=number, made_by="M. Weber", made_at=AT, files=files)

    def package(
        self, number: int, site: dict[str, Any] | None = None, *, of: str = "berlin", own_map: str = ""
    ) -> bytes:
        return make_package(self.content(number, site or self.site(of), of=of, own_map=own_map), self.key)

    def installation(self, site: str = "berlin") -> Installation:
        """A site that runs by what a person has written."""
        (self.folder / "manager.password").write_text("x")
        (self.folder / "manager.password").chmod(0o600)
        installation = Installation(self.folder / site / "updates")
        installation.begin(collect(self.draft(self.site(site)), ()))
        return installation


OWN_MAP = (MAPS / "generic-registers.yaml").read_text().replace("name: generic-registers", "name: own")


def served(_: LoadedSite) -> Iterable[Finding]:
    """Nothing keeps a site from being served."""
    return ()


def refusing(*messages: str) -> Callable[[LoadedSite], Iterable[Finding]]:
    return lambda loaded: [Finding(str(loaded.path), None, "api.host", message) for message in messages]


def tree(folder: Path) -> dict[str, bytes | str]:
    """Every file of a folder, and where each link leads."""
    found: dict[str, bytes | str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            found[str(path.relative_to(folder))] = str(path.readlink())
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found
