"""Authenticates and authorizes every request before a route handles it."""

from __future__ import annotations

import hmac
import logging
import re
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from urllib.parse import unquote_plus

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import compile_path
from starlette.types import ASGIApp, Receive, Scope, Send

from lift_manager.api.keys import Key, Keys, Secret, holds_key
from lift_manager.api.logins import Login, Logins
from lift_manager.api.roles import AccessLevel, LiftIn, Route, refusal
from lift_manager.runtime.refusals import FaceRefusal
from lift_manager.web.body import LingeringResponse
from lift_manager.web.errors import RequestError
from lift_manager.web.origin import is_from_another_site, names_unknown_host
from lift_manager.web.query import named_lifts
from lift_manager.web.replies import error_reply, is_api, is_workshop, not_found, wrong_method

KEY_IN_ADDRESS = (
    "the address holds what looks like a key; addresses are written down on the way here, so revoke that key, and send the next"
    " one in the header `Authorization: Bearer ...` alone"
)
UNKNOWN_HOST = (
    "this site has no keys, and the request names a host that is not known to be the manager: the owner of any name may let it lead"
    " here. Use the IP address of the manager's computer, or localhost on it; list the name in `api: {host_names: [...]}` of the site"
    " file; or make keys with `lift-manager keys make`"
)
NO_KEY = "a key is needed: send it in the header `Authorization: Bearer lm_...`; `lift-manager keys make` makes one"
BAD_KEY = "this key does not count here: it may be mistyped, revoked, or of another site"
LOGIN_OVER = "this login is over: it was too long ago, its key was revoked or changed, somebody logged out, or the manager was started again; log in"
LOGIN_FROM_ANOTHER_SITE = "a web page of another site sent the request with somebody's login"
CSRF_NEEDED = (
    "a login is not enough to change something: send the `csrf` of `GET /api/v1/login` in the header `x-csrf-token`, or a key in the"
    " header `Authorization`, and no cookie"
)
CSRF_HEADER = "x-csrf-token"
_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_BEARER = re.compile("bearer( |$)", re.IGNORECASE)
_CHALLENGE = 'Bearer realm="lift-manager"'
_CALLER = "lift_manager.caller"
_LOGIN = "lift_manager.login"
MAX_LOGGED_REFUSALS = 10
REFUSAL_WINDOW_S = 60.0
"""Chosen: a client with a wrong key polls for weeks, so at most ten lines a minute, one per address and reason."""

_log = logging.getLogger(__name__)


def caller_key(request: Request) -> Key | None:
    """Return the key that a request was authenticated with; None if it needed none."""
    key: Key | None = request.scope.get(_CALLER)
    return key


def caller_login(request: Request) -> Login | None:
    """Return the login that a request was authenticated with; None if it was by a key, or if it needed none."""
    login: Login | None = request.scope.get(_LOGIN)
    return login


def cookie_name(scope: Scope) -> str:
    """Return the name of the cookie of a login. A browser sends cookies to every port of a host, where other managers may listen."""
    _, port = scope.get("server") or ("", None)
    return f"lift-manager-{port}"


def face_refusal(request: Request, code: str, text: str, lift: str) -> FaceRefusal:
    """Return the journal entry for a request that a face refuses by itself."""
    key, client = caller_key(request), request.client
    name = "" if key is None else caller_name(request.scope["path"], key)
    return FaceRefusal(code, text, lift, name, "" if client is None else client.host)


class Authenticator:
    """Decides which requests are in the table of routes and allowed for their caller."""

    def __init__(
        self,
        routes: Sequence[Route],
        logins: Logins,
        keys: Keys,
        note: Callable[[FaceRefusal], None],
        host_names: Collection[str] = (),
    ) -> None:
        """`note` gets every refusal. Without keys, requests must name the manager by an address, localhost or one of `host_names`."""
        self._host_names = frozenset(name.lower() for name in host_names)
        self._keys = keys
        self._logins = logins
        self._note = note
        self._routes = [(compile_path(route.path)[0], route) for route in routes]
        self._known = {
            (route.path, method): self._search_route(route.path, method)
            for route in routes
            if "{" not in route.path
            for method in route.methods
        }
        """The matches of paths without parameters: a search tries one pattern after the other."""
        self._log = RefusalLog()

    def refusal_of(self, scope: Scope) -> Response | None:
        """Return the reply to a request that is not allowed; else None, and the key of the caller is in the scope."""
        try:
            self._check(scope)
        except RequestError as error:
            reply = error_reply(scope["path"], error)
            return LingeringResponse(reply) if _has_body(scope) else reply
        return None

    def _check(self, scope: Scope) -> None:
        """Store the key of the caller in the scope. Raises RequestError if the request is not allowed."""
        path: str = scope["path"]
        if holds_key(path) or holds_key(unquote_plus(scope["query_string"].decode("latin-1"))):
            raise self._refuse(scope, RequestError("key_in_address", KEY_IN_ADDRESS), "a key in its address")
        method: str = scope["method"]
        route, lift, methods = self._known.get((path, method)) or self._search_route(path, method)
        headers = Headers(raw=scope["headers"])
        if not self._keys.are_required and names_unknown_host(headers.get("host"), self._host_names):
            error = RequestError("another_site", UNKNOWN_HOST)
            raise self._refuse(scope, error, "it names a host that is not known to be the manager", lifts=[lift])
        if route is not None and route.need is AccessLevel.NOTHING:
            return
        key = scope[_CALLER] = self._authenticate(scope, headers)
        if route is None:
            raise wrong_method(path, methods) if methods else not_found(path)
        if key is not None:
            lifts = _lifts_of(route, lift, scope, key)
            if why := refusal(key.role, key.lifts, route.need, lifts):
                about = f"the key {key.name} may not do this"
                raise self._refuse(scope, RequestError("not_allowed", why), about, key=key, lifts=lifts)

    def _search_route(self, path: str, method: str) -> tuple[Route | None, str, tuple[str, ...]]:
        """Return the route and the lift in its path, or without a match the methods that the path accepts."""
        for pattern, route in self._routes:
            if method in route.methods and (match := pattern.match(path)) is not None:
                return route, _lift_of(match.groupdict()), ()
        others = [method for pattern, route in self._routes if pattern.match(path) for method in route.methods]
        return None, "", tuple(dict.fromkeys(others))

    def _authenticate(self, scope: Scope, headers: Headers) -> Key | None:
        """Return the key of a request; None if it needs and sends none. Raises RequestError for an invalid key."""
        sent = headers.getlist("authorization")
        if not self._keys.are_required and not any(map(_BEARER.match, sent)):
            return None
        if not sent and is_api(scope["path"]) and (tokens := _login_tokens(scope, headers)):
            return self._check_login(scope, headers, tokens)
        if not sent:
            error = RequestError("key_needed", NO_KEY, headers={"www-authenticate": _CHALLENGE})
            raise self._refuse(scope, error, "it has no key")
        bearer = _BEARER.match(sent[0])
        if len(sent) == 1 and bearer and (key := self._keys.find(Secret(sent[0][bearer.end() :].strip()))):
            return key
        challenge = f'{_CHALLENGE}, error="invalid_token"'
        error = RequestError("bad_key", BAD_KEY, headers={"www-authenticate": challenge})
        raise self._refuse(scope, error, "its key does not count")

    def _check_login(self, scope: Scope, headers: Headers, tokens: Sequence[str]) -> Key:
        """Return the key of a login, and store the login in the scope. Raises RequestError if it does not count for this request."""
        login = self._logins.find(Secret(tokens[0])) if len(tokens) == 1 else None
        if login is None:
            error = RequestError("login_over", LOGIN_OVER, headers={"www-authenticate": _CHALLENGE})
            raise self._refuse(scope, error, "its login is over")
        if is_from_another_site(Request(scope)):
            error = RequestError("another_site", f"{LOGIN_FROM_ANOTHER_SITE}; only this manager's own pages may")
            raise self._refuse(scope, error, LOGIN_FROM_ANOTHER_SITE, key=login.key)
        sent = headers.get(CSRF_HEADER, "")
        if scope["method"] not in _READING and not hmac.compare_digest(sent.encode(), login.csrf.encode()):
            raise self._refuse(scope, RequestError("csrf_token", CSRF_NEEDED), "without a CSRF token", key=login.key)
        scope[_LOGIN] = login
        return login.key

    def _refuse(
        self, scope: Scope, error: RequestError, why: str, *, key: Key | None = None, lifts: Sequence[str] = ()
    ) -> RequestError:
        client = scope.get("client")
        address = str(client[0]) if client else ""
        self._log.log_refusal(address or "an unknown address", why)
        name = "" if key is None else caller_name(scope["path"], key)
        self._note(FaceRefusal(error.code, why, "".join(lifts[:1]), name, address))
        return error


class AllowedRequests:
    """Passes on the requests that are allowed, and answers all others itself."""

    def __init__(self, app: ASGIApp, authenticator: Authenticator) -> None:
        self._app = app
        self._authenticator = authenticator

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            await (self._authenticator.refusal_of(scope) or self._app)(scope, receive, send)
        else:
            # there are no websockets; one would need a check of its own
            await send({"type": "websocket.close", "code": 1008, "reason": ""})


def caller_name(path: str, key: Key) -> str:
    """Return the caller as the journal names it: with its face on the workshop API."""
    return f"workshop:{key.name}" if is_workshop(path) else key.name


def _lift_of(named: Mapping[str, str]) -> str:
    """Return the lift in a path; on a hub with its site, as in `berlin/goods`, which is how keys of a hub name it."""
    lift = named.get("lift", "")
    return f"{named['site']}/{lift}" if lift and "site" in named else lift


def _lifts_of(route: Route, lift: str, scope: Scope, key: Key) -> tuple[str, ...]:
    match route.lift_in:
        case LiftIn.PATH:
            return (lift,)
        case LiftIn.QUERY:
            return named_lifts(scope)
        case LiftIn.BODY:
            return key.lifts  # the route checks the lift itself
        case None:
            return ()


def _login_tokens(scope: Scope, headers: Headers) -> list[str]:
    """Return the values of all cookies with the name of a login."""
    name = cookie_name(scope)
    pairs = (pair.strip().partition("=") for line in headers.getlist("cookie") for pair in line.split(";"))
    return [value for found, _, value in pairs if found == name]


def _has_body(scope: Scope) -> bool:
    headers = Headers(scope=scope)
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers


class RefusalLog:
    """Logs refused requests without letting their senders fill the log."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began_at = -REFUSAL_WINDOW_S
        self._logged: set[tuple[str, str]] = set()
        self._suppressed = 0

    def log_refusal(self, address: str, why: str) -> None:
        """Log a refusal, or only count it if enough were logged. `why` must not contain anything that the caller sent."""
        now = self._clock()
        if now - self._began_at >= REFUSAL_WINDOW_S:
            if self._suppressed:
                _log.warning("%d more requests were refused since, and not logged each", self._suppressed)
            self._began_at, self._suppressed = now, 0
            self._logged.clear()
        if (address, why) in self._logged or len(self._logged) >= MAX_LOGGED_REFUSALS:
            self._suppressed += 1
            return
        self._logged.add((address, why))
        _log.warning("a request from %s was refused: %s", address, why)
