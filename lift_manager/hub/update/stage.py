"""Checks an update where it is to run, and gives it the place from which it can be applied."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from lift_manager.config.load import LoadedSite, load_site
from lift_manager.hub.errors import UpdateRefused
from lift_manager.hub.update.changes import forbidden_changes, holds, misplaced_files, only_watched
from lift_manager.hub.update.installation import Installation
from lift_manager.hub.update.installed import Installed, Version
from lift_manager.hub.update.package import SITE_FILE, Verified, trusted_keys, verify
from register_maps.errors import Finding, MapFileError

MOST_MISTAKES = 5
"""How many mistakes of a site file a refusal names."""

Obstacles = Callable[[LoadedSite], Iterable[Finding]]
"""Yields why a site cannot be served on this computer."""


def stage(package: bytes, installation: Installation, obstacles: Obstacles) -> Version:
    """Check a package, and keep its configuration beside the present one. Raises UpdateRefused with the reason; then nothing is kept."""
    installed = installation.read()
    present = load_site(installation.site_file)
    verified = verify(package, trusted_keys(() if present.site.hub is None else present.site.hub.updates))
    _require_meant(verified, present, installed)
    try:
        staged = _checked(verified, installation, present, installed, obstacles)
        installation.keep(staged, installed)
    except UpdateRefused:
        installation.drop_staged()
        raise
    return staged


def _require_meant(verified: Verified, present: LoadedSite, installed: Installed) -> None:
    """Refuse an update for another site, and one that is not newer than every one before."""
    content, hub = verified.content, present.site.hub
    if hub is None or content.site != hub.site:
        raise UpdateRefused(
            f"the update is for the site {content.site!r}, and this is {hub.site if hub else 'no site of a hub'!r}"
        )
    if content.number <= installed.highest:
        text = (
            f"update {content.number} is not newer than {installed.highest}, which this site has had: make it again with a higher"
            " number"
        )
        raise UpdateRefused(text)


def _checked(
    verified: Verified, installation: Installation, present: LoadedSite, installed: Installed, obstacles: Obstacles
) -> Version:
    content = verified.content
    folder = installation.unpack(content.unpacked())
    try:
        other = load_site(folder / SITE_FILE)
    except MapFileError as error:
        raise UpdateRefused(_mistakes(content.number, error.findings)) from error
    if wrong := [*misplaced_files(other), *forbidden_changes(present, other)]:
        raise UpdateRefused(f"update {content.number}: {'; '.join(wrong)}")
    held = holds(present, other, content.number, installed.current.held)
    if found := list(obstacles(only_watched(other, held))):
        raise UpdateRefused(_mistakes(content.number, found))
    return Version(number=content.number, signed_by=verified.signed_by, made_by=content.made_by, held=held)


def _mistakes(number: int, findings: Iterable[Finding]) -> str:
    every = [f"{finding.key}: {finding.message}" if finding.key else finding.message for finding in findings]
    more = f"; and {len(every) - MOST_MISTAKES} more" if len(every) > MOST_MISTAKES else ""
    return f"update {number} cannot be served at this site: {'; '.join(every[:MOST_MISTAKES])}{more}"
