"""Who may go on, beyond what the gate has looked at: web pages of other sites, other computers, lifts named in a body."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import Request
from starlette.responses import Response

from lift_manager.core.facade import LiftFacade
from lift_manager.domain.access import Need, refusal
from lift_manager.web.access import caller, turned_away
from lift_manager.web.origin import from_another_site, from_this_computer
from lift_manager.web.problem import problem


def no_foreign_page(facade: LiftFacade, request: Request, lift: str) -> Response | None:
    """Return the answer no to a browser that shows a page of another site; `lift` is the one that was asked about, if any."""
    if not from_another_site(request):
        return None
    facade.turned_away(turned_away(request, "another_site", "a web page of another site asked", lift))
    return problem(403, "another_site", "a web page of another site asked; only programs and this manager's own may")


def no_other_computer(facade: LiftFacade, request: Request, lift: str) -> Response | None:
    """Return the answer no to whoever has no key and is no program of this computer, where a person's word or a tool's is asked for."""
    if caller(request) is not None or from_this_computer(request):
        return None
    text = (
        "this site has no keys to tell people by, so only a program on the manager's own computer may say this, to"
        " 127.0.0.1 or the address that the manager listens on, and not through a proxy; use the command line there, or"
        " make keys with `lift-manager keys make`"
    )
    said = "a person's word without a key, from another computer or through a proxy"
    facade.turned_away(turned_away(request, "other_computer", said, lift))
    return problem(403, "other_computer", text)


def no_foreign_lift(facade: LiftFacade, request: Request, lifts: Sequence[str]) -> Response | None:
    """Return the answer no to a robot's key that does not name each of these lifts."""
    key = caller(request)
    if key is None or not (why := refusal(key.role, key.lifts, Need.COMMAND, lifts)):
        return None
    about = f"the key {key.name} may not do this"
    facade.turned_away(turned_away(request, "not_allowed", about, "".join(lifts[:1])))
    return problem(403, "not_allowed", why)
