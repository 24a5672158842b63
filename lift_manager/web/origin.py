"""Where a request comes from, according to its headers and addresses."""

from __future__ import annotations

from functools import lru_cache
from ipaddress import IPv4Address, IPv6Address, ip_address
from urllib.parse import urlsplit

from starlette.requests import Request

_FORWARDED = frozenset(
    {"forwarded", "via", "x-real-ip", "x-client-ip", "x-cluster-client-ip", "true-client-ip", "cf-connecting-ip"}
)


def is_from_another_site(request: Request) -> bool:
    """Whether a browser indicates that a page of another site sent this request.

    The manager accepts any content type, so a browser would send a form from any page without a preflight request. Programs send
    neither header.
    """
    site = request.headers.get("sec-fetch-site")
    if site is not None:
        return site not in {"same-origin", "none"}
    origin = request.headers.get("origin")
    return origin is not None and origin.partition("://")[2] != request.headers.get("host")


@lru_cache(maxsize=64)  # each request of a client has the same
def names_unknown_host(header: str | None, names: frozenset[str]) -> bool:
    """Whether the header Host names a host that is neither an address, nor localhost, nor one of these names (in lower case).

    This stops DNS rebinding: to its browser, a page whose name was redirected here after loading is of the same site as what it requests,
    and a GET over plain HTTP has neither Origin nor Sec-Fetch. Such a page cannot use an address or localhost as its name. No
    browser omits the header Host.
    """
    if header is None:
        return False
    host = _requested_host(header)
    try:
        ip_address(host)
    except ValueError:
        return host != "localhost" and host not in names
    return False


def is_from_this_computer(request: Request) -> bool:
    """Whether a program on this computer sent this, to localhost or to the address that the manager listens on.

    A request through a proxy may come from anywhere, and a page that uses DNS rebinding still sends its own name. A proxy that
    leaves no trace cannot be detected; one that speaks HTTP/1.0, the default of nginx, can.
    """
    client = request.client
    if client is None or request.scope.get("http_version") == "1.0":
        return False
    if any(name in _FORWARDED or name.startswith("x-forwarded-") for name in request.headers):
        return False
    # only this computer can connect to one of its addresses from the same address
    here, _ = request.scope.get("server") or ("", None)
    requested = _requested_host(request.headers.get("host", ""))
    return all(is_loopback(name) or name == here for name in (client.host, requested))


def _requested_host(header: str) -> str:
    try:
        asked_for = urlsplit(f"//{header}")
        return (asked_for.hostname or "") if asked_for.port is None or asked_for.port else ""
    except ValueError:  # half an IPv6 address, or a port that is none
        return ""


def is_loopback(host: str) -> bool:
    """Whether an address or name is that of this computer."""
    if host == "localhost":
        return True
    try:
        return unmapped(host).is_loopback
    except ValueError:
        return False


def unmapped(address: str) -> IPv4Address | IPv6Address:
    """Parse an address, and convert an IPv4-mapped IPv6 address to IPv4. Raises ValueError."""
    found = ip_address(address)
    return (found.ipv4_mapped if isinstance(found, IPv6Address) else None) or found
