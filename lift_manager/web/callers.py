"""Identifies the caller of a route of /api/v1, what belongs to it, and what it may not do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Protocol

from fastapi import Depends, Request

from lift_manager.api.keys import Keys
from lift_manager.api.logins import Logins
from lift_manager.api.roles import AccessLevel, refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.refusals import FaceRefusal
from lift_manager.runtime.site import Site
from lift_manager.web.authenticator import caller_key, caller_login, face_refusal
from lift_manager.web.errors import RequestError
from lift_manager.web.origin import is_from_another_site, is_from_this_computer

SESSION_FACE = "api"
RIDE_FACE = "ride"
ANONYMOUS = "anonymous"
"""The name of every caller without a key and a robot name."""
ROBOT_SEPARATOR = "/"
"""Separates the names of a key and a robot; `lift-manager keys make` does not allow it in the name of a key."""

FOREIGN_PAGE = "a web page of another site sent the request"


class FaceLog(Protocol):
    """Where a face writes down what it decides about its callers by itself: the journal of a site, or the log of a hub."""

    def turned_away(self, who: FaceRefusal) -> None:
        """Write down a request that the face refused."""
        ...

    def logged_in(self, key: str, address: str, *, ended: bool = False) -> None:
        """Write down that a browser logged in with this key, or out."""
        ...


def face_log_of(request: Request) -> FaceLog:
    """Return where the application writes down refusals and logins."""
    log: FaceLog = request.app.state.face_log
    return log


def logins_of(request: Request) -> Logins:
    """Return the logins of the browsers that use the application."""
    logins: Logins = request.app.state.logins
    return logins


def site_of(request: Request) -> Site:
    """Return the site that the application serves."""
    site: Site = request.app.state.site
    return site


async def _site(request: Request) -> Site:
    return site_of(request)


ServedSite = Annotated[Site, Depends(_site)]
"""For routes; a dependency calls `site_of` instead, at a tenth of the cost."""


async def forbid_foreign_page(request: Request) -> None:
    """Refuse a request from a web page of another site; a dependency."""
    refuse_foreign_page(request, request.path_params.get("lift", ""))


def refuse_foreign_page(request: Request, lift: str) -> None:
    """Raise RequestError for a request from a web page of another site; `lift` is the lift that it concerns, if any."""
    if is_from_another_site(request):
        face_log_of(request).turned_away(face_refusal(request, "another_site", FOREIGN_PAGE, lift))
        raise RequestError("another_site", f"{FOREIGN_PAGE}; only programs and this manager's own may")


async def forbid_other_computer(request: Request) -> None:
    """Refuse a caller without a key from another computer, for operator actions and tools; a dependency."""
    refuse_other_computer(
        request,
        "this site has no keys to identify people, so only a program on the manager's own computer may send this, to"
        " 127.0.0.1 or the address that the manager listens on, and not through a proxy; use the command line there, or"
        " make keys with `lift-manager keys make`",
    )


def refuse_other_computer(request: Request, text: str) -> None:
    """Raise RequestError, with this text, for a caller without a key from another computer."""
    if caller_key(request) is not None or is_from_this_computer(request):
        return
    about = "an operator action without a key, from another computer or through a proxy"
    refused = face_refusal(request, "other_computer", about, request.path_params.get("lift", ""))
    face_log_of(request).turned_away(refused)
    raise RequestError("other_computer", text)


def admission_check(request: Request) -> Callable[[], bool]:
    """Return a function that checks whether the login or the key of the caller is still valid, for as long as its event stream is open."""
    login, logins = caller_login(request), logins_of(request)
    if login is not None:
        return partial(logins.is_live, login)
    keys: Keys = request.app.state.keys
    return partial(keys.admits, caller_key(request))


def refuse_foreign_lifts(request: Request, lifts: Sequence[str]) -> None:
    """Raise RequestError if the key of a robot does not name all of these lifts."""
    key = caller_key(request)
    if key is not None and (why := refusal(key.role, key.lifts, AccessLevel.COMMAND, lifts)):
        about = f"the key {key.name} may not do this"
        face_log_of(request).turned_away(face_refusal(request, "not_allowed", about, "".join(lifts[:1])))
        raise RequestError("not_allowed", why)


def holder_of(request: Request, face: str, robot: str | None) -> Holder:
    """Return the caller as a holder: the name of its key, followed by that of the robot, if given."""
    key = caller_key(request)
    if key is None:
        return Holder(face, robot or ANONYMOUS)
    return holder_named(face, key.name, robot)


def holder_named(face: str, name: str, robot: str | None) -> Holder:
    """Return the holder with the name of a key and of a robot."""
    return Holder(face, f"{name}{ROBOT_SEPARATOR}{robot}" if robot else name)


def belongs_to_caller(request: Request, holder: Holder) -> bool:
    """Whether a holder is this caller, or another robot of the same key. Without keys, callers cannot be told apart."""
    key = caller_key(request)
    return key is None or holder.name.partition(ROBOT_SEPARATOR)[0] == key.name


def refuse_shared_key(request: Request, robot: str | None, idempotency_key: str | None) -> None:
    """Raise RequestError for an idempotency key of an anonymous caller: another one may have chosen the same."""
    if idempotency_key is not None and robot is None and caller_key(request) is None:
        text = "robot is missing: without keys an idempotency key needs a robot name, or two robots could share what only one began"
        raise RequestError("malformed", text, field="robot")


def require_successor_key(request: Request, keys: Keys, to: str, lift: str) -> None:
    """Raise RequestError if `to` does not name a live key that may command the lift."""
    if caller_key(request) is None:
        return
    successor = keys.find_by_name(to)
    if successor is None:
        raise RequestError(
            "malformed", "to is not the name of a live key; `lift-manager keys list` shows them", field="to"
        )
    if refusal(successor.role, successor.lifts, AccessLevel.COMMAND, [lift]):
        raise RequestError("malformed", f"to is the name of a key that may not command {lift}", field="to")
