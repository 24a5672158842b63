"""Access control: the roles of keys, the access level of each route, and whether a key has it. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum, unique


@unique
class Role(StrEnum):
    """The purpose of a key. Operators may do all that viewers may, and commissioners all that operators may."""

    VIEWER = "viewer"
    """Reads."""
    ROBOT = "robot"
    """Reads everything, and commands the lifts that its key names, in sessions of its own."""
    RMF = "rmf"
    """Reads everything, and passes on the requests of RMF's sessions for the lifts that its key names. Commands nothing else."""
    OPERATOR = "operator"
    """Commands every lift, and takes operator actions: acknowledge, lock out, end a session that is not its own."""
    COMMISSIONER = "commissioner"
    """Puts lifts into service."""


@unique
class AccessLevel(StrEnum):
    """The access that a route requires."""

    NOTHING = "nothing"
    """Open to everybody, with or without a key: it reveals nothing about the lifts of the site but their names."""
    READ = "read"
    COMMAND = "command"
    RMF = "rmf"
    """For an RMF adapter only, not for robots or people."""
    OPERATE = "operate"
    COMMISSION = "commission"


OF_SOME_LIFTS = frozenset({Role.ROBOT, Role.RMF})
"""Roles whose keys are limited to the lifts that they name."""

ROLES = {
    AccessLevel.READ: frozenset(Role),
    AccessLevel.COMMAND: frozenset({Role.ROBOT, Role.OPERATOR, Role.COMMISSIONER}),
    AccessLevel.RMF: frozenset({Role.RMF}),
    AccessLevel.OPERATE: frozenset({Role.OPERATOR, Role.COMMISSIONER}),
    AccessLevel.COMMISSION: frozenset({Role.COMMISSIONER}),
}


@unique
class LiftIn(StrEnum):
    """Where a request names its lift."""

    PATH = "path"
    QUERY = "query"
    BODY = "body"
    """In the body, or in the object that the request is about, such as a ride. Keys that command any lift pass; the route calls `refusal`."""


@dataclass(frozen=True, slots=True)
class Route:
    """One kind of request over HTTP."""

    methods: tuple[str, ...]
    path: str
    """The path as a pattern of the web framework."""
    need: AccessLevel
    lift_in: LiftIn | None = None


_GET = ("GET",)
_POST = ("POST",)
_FILE = ("GET", "HEAD")
_WORKSHOP = "/open-rmf/demo-lift"
_LIFT = "/api/v1/lifts/{lift}"
_SESSION = f"{_LIFT}/sessions/{{session}}"
_RIDES = "/api/v1/rides"
_RIDE = f"{_RIDES}/{{ride}}"

ROUTES: tuple[Route, ...] = (
    Route(_GET, "/", AccessLevel.NOTHING),
    Route(_GET, "/wall", AccessLevel.NOTHING),
    Route(_GET, "/lobby/{lift}", AccessLevel.NOTHING, LiftIn.PATH),
    Route(_FILE, "/page/{path:path}", AccessLevel.NOTHING),
    Route(_GET, "/announcements", AccessLevel.NOTHING),
    Route(_GET, "/announcements/{file}", AccessLevel.NOTHING),
    Route(_GET, "/docs", AccessLevel.NOTHING),
    Route(_FILE, "/docs/{path:path}", AccessLevel.NOTHING),
    Route(_GET, "/redoc", AccessLevel.NOTHING),
    Route(_FILE, "/redoc/{path:path}", AccessLevel.NOTHING),
    Route(_FILE, "/openapi.json", AccessLevel.NOTHING),
    Route(_GET, "/errors", AccessLevel.NOTHING),
    Route(_GET, "/errors.md", AccessLevel.NOTHING),
    Route(_GET, "/healthz", AccessLevel.NOTHING),
    Route(_GET, "/readyz", AccessLevel.NOTHING),
    Route(_GET, "/metrics", AccessLevel.READ),
    Route(_GET, f"{_WORKSHOP}/lift_names", AccessLevel.READ),
    Route(_GET, f"{_WORKSHOP}/lift_state", AccessLevel.READ, LiftIn.QUERY),
    Route(_POST, f"{_WORKSHOP}/lift_request", AccessLevel.COMMAND, LiftIn.QUERY),
    Route(_POST, f"{_LIFT}/acknowledge", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/lockout", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/lockout/end", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/drain", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/drain/end", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/session/force-release", AccessLevel.OPERATE, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/sessions", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_POST, f"{_SESSION}/renew", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_POST, f"{_SESSION}/close", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_POST, f"{_SESSION}/hand-over", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_POST, f"{_SESSION}/commands", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/rmf/wanted", AccessLevel.RMF, LiftIn.PATH),
    Route(_POST, f"{_LIFT}/rmf/ended", AccessLevel.RMF, LiftIn.PATH),
    Route(_GET, "/api/v1/rmf", AccessLevel.READ),
    Route(_GET, _RIDES, AccessLevel.READ),
    Route(_POST, _RIDES, AccessLevel.COMMAND, LiftIn.BODY),
    Route(_GET, _RIDE, AccessLevel.READ),
    Route(_POST, f"{_RIDE}/entered", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_POST, f"{_RIDE}/left", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_POST, f"{_RIDE}/here", AccessLevel.COMMAND, LiftIn.BODY),
    Route(_POST, f"{_RIDE}/cancel", AccessLevel.COMMAND, LiftIn.BODY),
    Route(("GET", "POST"), "/api/v1/login", AccessLevel.READ),
    Route(_POST, "/api/v1/logout", AccessLevel.READ),
    Route(_GET, "/api/v1/events", AccessLevel.READ),
    Route(_GET, "/api/v1/links", AccessLevel.COMMISSION),
    Route(_GET, "/api/v1/links/{link:path}/frames", AccessLevel.COMMISSION),
    Route(_GET, "/api/v1/lifts", AccessLevel.READ),
    Route(_GET, f"{_LIFT}/capabilities", AccessLevel.READ, LiftIn.PATH),
    Route(_GET, f"{_LIFT}/signals", AccessLevel.READ, LiftIn.PATH),
    Route(_GET, f"{_LIFT}/commands", AccessLevel.READ, LiftIn.PATH),
    Route(_GET, f"{_LIFT}/commands/writes", AccessLevel.READ, LiftIn.PATH),
    Route(_GET, f"{_SESSION}/commands/{{command}}", AccessLevel.COMMAND, LiftIn.PATH),
    Route(_GET, _SESSION, AccessLevel.COMMAND, LiftIn.PATH),
    Route(_GET, _LIFT, AccessLevel.READ, LiftIn.PATH),
)
"""All requests that are served. Any other gets the answer of a missing page, even if the application has a route for it."""


def refusal(role: Role, own: Sequence[str], need: AccessLevel, requested: Sequence[str]) -> str:
    """Return why a key may not send this request, as a sentence; empty if it may.

    `own` are the lifts that the key names, `requested` those that the request names. The keys of robots and RMF command only their own
    lifts, and cannot send commands that name no lift.
    """
    if need is AccessLevel.NOTHING:
        return ""
    allowed = ROLES[need]
    if role not in allowed:
        return f"this needs a key with the role {_listed([other for other in Role if other in allowed])}; this key's is {role}"
    if role in OF_SOME_LIFTS and need is not AccessLevel.READ and (not requested or set(requested) - set(own)):
        return (
            f"this key commands {_listed(own, 'and') or 'no lift'} and no other; another lift needs a key that names it"
        )
    return ""


def commandable(role: Role, own: Sequence[str], every: Sequence[str]) -> tuple[str, ...]:
    """Return the lifts that a key commands: all, or those that it names."""
    return tuple(lift for lift in every if role not in OF_SOME_LIFTS or lift in own)


def _listed(words: Sequence[str], last: str = "or") -> str:
    return f" {last} ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
