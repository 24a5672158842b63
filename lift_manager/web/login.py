"""Part of /api/v1: a browser exchanges a key for a cookie, which stands for the key until it is logged out."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Depends, Request, Response

from lift_manager.api.logins import Login, LoginAnswer
from lift_manager.web.authenticator import caller_key, caller_login, cookie_name
from lift_manager.web.callers import face_log_of, forbid_foreign_page, logins_of
from lift_manager.web.errors import RequestError
from lift_manager.web.json_route import JsonRoute
from lift_manager.web.openapi import EVERY_CHANGE, problems

TAG = "login"
TAG_DESCRIPTION = """
For browsers, such as the manager's own page. A program sends its key in the header `Authorization`, and needs none of this.

A login is a cookie that acts as the key it was made with: `HttpOnly`, `SameSite=Strict`, for `/api/v1` alone, and `Secure` over HTTPS. It
lasts 12 hours, that of a viewer's key 30 days, and ends with its key, with a logout, and with the manager. A request that changes something
sends the answer's `csrf` in the header `x-csrf-token` beside it.
"""

KEY_AGAIN = (
    "a login is made with a key and not with another login: send the key in the header `Authorization: Bearer lm_...`"
)

_COOKIE: dict[str, Any] = {
    "Set-Cookie": {"description": "The login, or nothing in its place.", "schema": {"type": "string"}}
}

router = APIRouter(prefix="/api/v1", tags=[TAG], route_class=JsonRoute, strict_content_type=False)


def _answer(request: Request, login: Login | None) -> LoginAnswer:
    key = caller_key(request)
    return LoginAnswer(
        key=None if key is None else key.name,
        role=None if key is None else key.role,
        csrf=None if login is None else login.csrf,
        ends_in_s=None if login is None else logins_of(request).remaining_s(login),
    )


@router.get("/login", name="whose", summary="Who is logged in", response_description="The caller.")
async def whose_login(request: Request) -> LoginAnswer:
    """With the token for changes, which a page needs after it was loaded again."""
    return _answer(request, caller_login(request))


@router.post(
    "/login",
    summary="Log in",
    dependencies=[Depends(forbid_foreign_page)],
    response_description="The browser is logged in; where the site has no keys, there was no need to.",
    responses={200: {"headers": _COOKIE}, **problems(*EVERY_CHANGE, "key_needed")},
)
async def log_in(request: Request, response: Response) -> LoginAnswer:
    """Exchanges the key in the header `Authorization` for a cookie. A body is not looked at."""
    if caller_login(request) is not None:
        raise RequestError("key_needed", KEY_AGAIN)
    key = caller_key(request)
    if key is None:
        return _answer(request, None)
    logins = logins_of(request)
    token, login = logins.begin(key)
    face_log_of(request).logged_in(key.name, _address(request))
    _set_cookie(request, response, token.reveal(), logins.remaining_s(login))
    return _answer(request, login)


@router.post(
    "/logout",
    summary="Log out",
    dependencies=[Depends(forbid_foreign_page)],
    response_description="The caller is logged in no more.",
    responses={200: {"headers": _COOKIE}, **problems(*EVERY_CHANGE)},
)
async def log_out(request: Request, response: Response) -> LoginAnswer:
    """Ends this login, and its event streams within a second. A body is not looked at."""
    if (login := caller_login(request)) is not None:
        logins_of(request).end(login)
        face_log_of(request).logged_in(login.key.name, _address(request), ended=True)
        _set_cookie(request, response, "", 0.0)
    return LoginAnswer(key=None, role=None, csrf=None, ends_in_s=None)


def _address(request: Request) -> str:
    return "" if request.client is None else request.client.host


def _set_cookie(request: Request, response: Response, value: str, lasts_s: float) -> None:
    """Set or delete the cookie.

    Without `Path` it is for the folder of this request, /api/v1, also behind a proxy that adds a prefix which the manager does not know.
    Such a proxy may end TLS as well; then the browser names the scheme in `Origin`.
    """
    is_https = request.url.scheme == "https" or request.headers.get("origin", "").startswith("https://")
    attributes = f"Max-Age={lasts_s:.0f}; HttpOnly; SameSite=Strict" + ("; Secure" if is_https else "")
    response.headers["set-cookie"] = f"{cookie_name(request.scope)}={value}; {attributes}"
