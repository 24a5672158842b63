"""Who sent a request, as far as it tells."""

from __future__ import annotations

from collections.abc import Collection
from ipaddress import IPv4Address, IPv6Address, ip_address
from urllib.parse import urlsplit

from starlette.requests import Request

_FORWARDED = frozenset(
    {"forwarded", "via", "x-real-ip", "x-client-ip", "x-cluster-client-ip", "true-client-ip", "cf-connecting-ip"}
)


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


def by_a_foreign_name(request: Request, names: Collection[str]) -> bool:
    """Whether a request names a host that is neither an address, nor localhost, nor one of these names (in lower case).

    A page whose name was made to lead here after it was loaded is of the same site as what it requests, as far as its browser can tell,
    and with a GET over plain HTTP that browser sends neither Origin nor Sec-Fetch. It cannot make an address its name, nor
    localhost. No browser leaves the header out.
    """
    if "host" not in request.headers:
        return False
    host = _asked_for(request)
    try:
        ip_address(host)
    except ValueError:
        return host != "localhost" and host not in names
    return False


def from_this_computer(request: Request) -> bool:
    """Whether a program of this computer asked this computer by its own name, or by the address that it listens on.

    What a proxy passed on may come from anywhere, and a page whose name was made to lead here after it was loaded
    still asks for that name. A proxy that leaves no trace cannot be told; one that speaks HTTP/1.0, as nginx does unless it
    is told otherwise, can.
    """
    client = request.client
    if client is None or request.scope.get("http_version") == "1.0":
        return False
    if any(name in _FORWARDED or name.startswith("x-forwarded-") for name in request.headers):
        return False
    # only this computer can call one of its addresses from that same address
    here, _ = request.scope.get("server") or ("", None)
    return all(is_loopback(name) or name == here for name in (client.host, _asked_for(request)))


def _asked_for(request: Request) -> str:
    try:
        asked_for = urlsplit(f"//{request.headers.get('host', '')}")
        return (asked_for.hostname or "") if asked_for.port is None or asked_for.port else ""
    except ValueError:  # half an IPv6 address, or a port that is none
        return ""


def is_loopback(host: str) -> bool:
    """Whether an address or name is this computer's own."""
    if host == "localhost":
        return True
    try:
        return unmapped(host).is_loopback
    except ValueError:
        return False


def unmapped(address: str) -> IPv4Address | IPv6Address:
    """Return an address, that of IPv4 where it is written as one of IPv6. Raises ValueError."""
    found = ip_address(address)
    return (found.ipv4_mapped if isinstance(found, IPv6Address) else None) or found
