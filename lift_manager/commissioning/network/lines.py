"""What the texts that go into other programs' files have in common. Pure."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from ipaddress import IPv4Network, IPv6Network, ip_network

from lift_manager.commissioning.network.model import Network, Station

WIDTH = 118

AnyNetwork = IPv4Network | IPv6Network


def comment(*paragraphs: str) -> Iterator[str]:
    """Yield comment lines, each paragraph wrapped."""
    for text in paragraphs:
        yield from textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="#   ") if text else ["#"]


def header(found: Network, what: str) -> Iterator[str]:
    """Yield what every file begins with: the site, and the maps with their hashes. Without a date: the same site makes the same file."""
    yield from comment(
        f"{what} for the site {found.site}, made by lift-manager network from its site file.", "", "Maps:"
    )
    for use in found.maps:
        yield from comment(f"  {use.lift} ({use.access}): {use.map}, sha256 {use.sha256}")
    named = [station for station in found.stations if station.is_name]
    if named:
        yield from comment("", "Looked up when this was made, and to be made again when one of them moves:")
        yield from comment(*(f"  {each.name}: {each.host} is {', '.join(each.addresses)}" for each in named))
    yield "#"


def address_text(station: Station) -> str:
    """Name a controller and its place."""
    host = f"[{station.host}]" if ":" in station.host else station.host
    return f"{station.name} ({host}:{station.port})"


def by_version(texts: Iterable[str]) -> dict[int, list[str]]:
    """Sort addresses or networks by the version of IP, 4 and 6."""
    found: dict[int, list[str]] = {4: [], 6: []}
    for text in texts:
        found[ip_network(text).version].append(text)
    return found
