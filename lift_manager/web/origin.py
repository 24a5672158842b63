"""Who sent a request, as far as it tells."""

from __future__ import annotations

from ipaddress import IPv6Address, ip_address
from urllib.parse import urlsplit

from starlette.requests import Request

_FORWARDED = ("forwarded", "via", "x-forwarded-for", "x-real-ip")


def from_another_site(request: Request) -> bool:
    """Whether a browser says that some other site's page sent this.

    Any content type is taken here, so a browser would pass on a form from any page in the world without asking first.
    Programs send neither header.
    """
    site = request.headers.get("sec-fetch-site")
    if site is not None:
        return site not in {"same-origin", "none"}
    origin = request.headers.get("origin")
    return origin is not None and origin.partition("://")[2] != request.headers.get("host")


def from_this_computer(request: Request) -> bool:
    """Whether a program of this computer asked this computer by its own name.

    What a proxy passed on may come from anywhere, and a page whose name was made to lead here after it was loaded
    still asks for that name.
    """
    client = request.client
    if client is None or any(name in request.headers for name in _FORWARDED):
        return False
    return is_loopback(client.host) and is_loopback(_asked_for(request))


def _asked_for(request: Request) -> str:
    try:
        return urlsplit(f"//{request.headers.get('host', '')}").hostname or ""
    except ValueError:  # half an IPv6 address
        return ""


def is_loopback(host: str) -> bool:
    """Whether an address or name is this computer's own."""
    if host == "localhost":
        return True
    try:
        address = ip_address(host)
    except ValueError:
        return False
    mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
    return (mapped or address).is_loopback
