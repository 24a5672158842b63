"""Who calls a route of /api/v1: in whose name a caller holds a lift, what is its own, and what it may not do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import Depends, Request

from lift_manager.api.access import AccessLevel, refusal
from lift_manager.api.keys import Keys
from lift_manager.lift.session import Holder
from lift_manager.runtime.site import Site
from lift_manager.web.access import caller, turned_away
from lift_manager.web.errors import RequestError
from lift_manager.web.origin import from_another_site, from_this_computer

SESSION_FACE = "api"
RIDE_FACE = "ride"
ANONYMOUS = "anonymous"
"""Every caller with neither a key nor a robot's name."""
BETWEEN = "/"
"""Stands between the name of a key and that of a robot; `lift-manager keys make` lets no key's name hold one."""

ANOTHER_SITE = "a web page of another site asked"


def site_of(request: Request) -> Site:
    """Return what the application serves."""
    site: Site = request.app.state.site
    return site


async def _site(request: Request) -> Site:
    return site_of(request)


ServedSite = Annotated[Site, Depends(_site)]
"""For a route; a dependency that wants it calls `site_of`, which costs a tenth."""


async def no_foreign_page(request: Request) -> None:
    """Dependency that refuses a browser which shows a page of another site."""
    refuse_foreign_page(request, request.path_params.get("lift", ""))


def refuse_foreign_page(request: Request, lift: str) -> None:
    """Raise RequestError for a page of another site; `lift` is the one that it is about, if any."""
    if from_another_site(request):
        site_of(request).turned_away(turned_away(request, "another_site", ANOTHER_SITE, lift))
        raise RequestError("another_site", f"{ANOTHER_SITE}; only programs and this manager's own may")


async def no_other_computer(request: Request) -> None:
    """Dependency that refuses a caller without a key that is no program of this computer: for what people do, and tools."""
    if caller(request) is not None or from_this_computer(request):
        return
    about = "a person's word without a key, from another computer or through a proxy"
    site_of(request).turned_away(turned_away(request, "other_computer", about, request.path_params.get("lift", "")))
    raise RequestError(
        "other_computer",
        "this site has no keys to tell people by, so only a program on the manager's own computer may say this, to"
        " 127.0.0.1 or the address that the manager listens on, and not through a proxy; use the command line there, or"
        " make keys with `lift-manager keys make`",
    )


def refuse_foreign_lifts(request: Request, lifts: Sequence[str]) -> None:
    """Raise RequestError for a robot's key that does not name each of these lifts."""
    key = caller(request)
    if key is not None and (why := refusal(key.role, key.lifts, AccessLevel.COMMAND, lifts)):
        about = f"the key {key.name} may not do this"
        site_of(request).turned_away(turned_away(request, "not_allowed", about, "".join(lifts[:1])))
        raise RequestError("not_allowed", why)


def holder_of(request: Request, face: str, robot: str | None) -> Holder:
    """Return the caller: the name of its key, and behind it that of the robot, if one was told."""
    key = caller(request)
    if key is None:
        return Holder(face, robot or ANONYMOUS)
    return named(face, key.name, robot)


def named(face: str, name: str, robot: str | None) -> Holder:
    """Return a caller by the name of its key and that of its robot."""
    return Holder(face, f"{name}{BETWEEN}{robot}" if robot else name)


def is_of(request: Request, holder: Holder) -> bool:
    """Whether a holder is this caller, or another robot of the same key. Without keys nobody can tell callers apart."""
    key = caller(request)
    return key is None or holder.name.partition(BETWEEN)[0] == key.name


def refuse_shared_key(request: Request, robot: str | None, idempotency_key: str | None) -> None:
    """Raise RequestError for an idempotency key of a caller that nothing tells from others, who may have chosen the same."""
    if idempotency_key is not None and robot is None and caller(request) is None:
        text = "robot is missing: without keys an idempotency key needs a robot name, or two robots could share what only one began"
        raise RequestError("malformed", text, field="robot")


def refuse_heir(request: Request, keys: Keys, to: str, lift: str) -> None:
    """Raise RequestError where a session is to go to a name which is no live key, or one that may not command the lift."""
    if caller(request) is None:
        return
    heir = keys.named(to)
    if heir is None:
        raise RequestError(
            "malformed", "to is not the name of a live key; `lift-manager keys list` shows them", field="to"
        )
    if refusal(heir.role, heir.lifts, AccessLevel.COMMAND, [lift]):
        raise RequestError("malformed", f"to is the name of a key that may not command {lift}", field="to")
