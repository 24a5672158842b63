"""Every error code of /api/v1 with its HTTP status, its title, and its meaning and remedy."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import NamedTuple

from lift_manager.lift.refusals import Refusal


class Code(NamedTuple):
    """The description of an error code."""

    status: int
    title: str
    text: str


REFUSAL_CODES: Mapping[Refusal, Code] = {
    Refusal.UNKNOWN_LIFT: Code(404, "There is no such lift", "The message lists the lifts there are."),
    Refusal.NO_SUCH_SESSION: Code(
        404,
        "There is no such session",
        "No session of this lift has that id, or it is another key's, or it ended too long ago to be remembered.",
    ),
    Refusal.NO_SUCH_COMMAND: Code(
        404,
        "There is no such command",
        "This session has no command of that id, or it ended too long ago to be remembered.",
    ),
    Refusal.UNKNOWN_RIDE: Code(
        404, "There is no such ride", "No ride has that id, or it ended too long ago to be remembered."
    ),
    Refusal.UNKNOWN_FLOOR: Code(
        422, "There is no such floor", "`field` names the key of the body; the message lists the floors there are."
    ),
    Refusal.NOT_YOUR_RIDE: Code(
        403, "The ride is not the caller's", "A robot's key speaks for the rides that it began; an operator's for all."
    ),
    Refusal.HELD: Code(
        409,
        "Somebody else holds the lift",
        "`holder` says who and `since_s` for how long. Try again later, or begin a ride.",
    ),
    Refusal.QUEUED: Code(
        409,
        "Others wait for the lift",
        "It is free, and `ahead` others come first. Keep trying: that keeps the place in the queue.",
    ),
    Refusal.OFFLINE: Code(
        409, "The lift cannot be read", "`age_s` says since when. Nothing is pressed without a current reading."
    ),
    Refusal.MODE: Code(
        409, "The lift is in a mode for people only", "`mode` says which, `since_s` since when. Wait until it is over."
    ),
    Refusal.FIRE_LATCHED: Code(
        409, "There was a fire", "A person has to check the lift and acknowledge before robots ride again."
    ),
    Refusal.FIRE_ACTIVE: Code(
        409, "The lift still reports a fire", "A fire can be acknowledged once the lift no longer reports it."
    ),
    Refusal.LOCKED_OUT: Code(409, "The lift is locked out", "A person keeps robots off; the message says who and why."),
    Refusal.NOT_LOCKED_OUT: Code(409, "The lift is not locked out", "So there is no lockout to end."),
    Refusal.DRAINING: Code(
        409,
        "No new session begins",
        "A person lets current sessions end; the message says who and why. Try again later.",
    ),
    Refusal.NOT_DRAINING: Code(409, "The lift has no drain", "So there is no drain to end."),
    Refusal.OUTSIDE_HOURS: Code(409, "Outside the robot hours", "The message says when robots may ride."),
    Refusal.MONITOR_ONLY: Code(
        409, "The lift is only watched", "The site file says `access: monitor`: nothing is ever written to this lift."
    ),
    Refusal.NOT_POSSIBLE: Code(
        409,
        "The lift cannot do this",
        "Its map has no signal for it, or the site does not allow it. Trying again does not help.",
    ),
    Refusal.OCCUPANCY_UNKNOWN: Code(
        409, "A robot may be in the car", "Its robot reports that it left, or a person checks the car and acknowledges."
    ),
    Refusal.NOTHING_TO_ACKNOWLEDGE: Code(
        409, "There is nothing to acknowledge", "No fire is latched, and no robot may be in the car."
    ),
    Refusal.NOT_HELD: Code(409, "Nobody holds the lift", "So there is no session to end or to hand over."),
    Refusal.SESSION_OVER: Code(
        409, "The session is over", "The message says why. Open another if the lift is still needed."
    ),
    Refusal.NOT_NOW: Code(
        409,
        "Not possible at this point",
        "The message says where the session or the ride is, and what is possible there.",
    ),
    Refusal.TOO_OFTEN: Code(
        429, "Too many changes", "This protects people and the journal. Change requests less often; repeats are free."
    ),
    Refusal.KEY_REUSED: Code(
        409,
        "The idempotency key belongs to another request",
        "The message says to which. Nothing was done: use a new key for each request.",
    ),
    Refusal.TOO_MANY: Code(
        429,
        "Too many rides wait",
        "Of this caller, or of all: the message says which. Cancel some, or wait until some are over.",
    ),
    Refusal.NOT_RECORDED: Code(
        503,
        "Nothing can be recorded",
        "The disk is full or broken, so nothing is pressed. The manager's log says more.",
    ),
    Refusal.STOPPING: Code(503, "The manager is stopping", "Try again when it has started."),
}
"""Refusals of the manager."""

WEB_CODES: Mapping[str, Code] = {
    "key_needed": Code(
        401,
        "A key is needed",
        "Send it in the header `Authorization: Bearer lm_...`; `lift-manager keys make` makes one.",
    ),
    "bad_key": Code(401, "The key is not valid here", "It is mistyped, revoked, or of another site."),
    "login_over": Code(
        401,
        "The login is over",
        "It was too long ago, its key was revoked or changed, somebody logged out, or the manager was started again: log in.",
    ),
    "csrf_token": Code(
        403,
        "A login alone changes nothing",
        "Send the `csrf` of `GET /api/v1/login` in the header `x-csrf-token`. Programs send a key and no cookie.",
    ),
    "not_allowed": Code(403, "The key may not do this", "Its role is another, or it does not name the lift."),
    "another_site": Code(
        403,
        "Another site's web page, or an unknown host name",
        "Only programs and this manager's own pages may send this. A site without keys is addressed by IP address, as localhost, or by one"
        " of `api: {host_names: [...]}` in its site file.",
    ),
    "other_computer": Code(
        403,
        "Request from another computer",
        "A site without keys accepts operator actions only from the manager's own computer. Make keys, or go there.",
    ),
    "key_in_address": Code(400, "The address holds a key", "Addresses are written down: revoke that key."),
    "not_http": Code(400, "This could not be read as HTTP", "Usually text in the address that is not percent-encoded."),
    "no_such_path": Code(404, "Nothing is here", "The path is mistyped."),
    "wrong_method": Code(405, "The path needs another method", "The header `Allow` says which."),
    "too_long": Code(413, "The body is too long", "At most 64 KB are read."),
    "malformed": Code(
        422, "The request is not what is expected", "`field` names the key of the body, or of the query, that is wrong."
    ),
    "head_too_long": Code(431, "Address and headers are too long", "At most 32 KB and 100 headers are read."),
    "unknown_link": Code(404, "There is no such link", "GET /api/v1/links lists those there are."),
    "too_many_streams": Code(
        503,
        "Too many event streams are open",
        "Close unused ones, or try again a little later. One key gets at most half of all.",
    ),
    "standby": Code(
        503,
        "This manager is the standby",
        "The other machine of the site commands the lifts; the message says where it is, if that is known.",
    ),
    "http_error": Code(400, "The request was not served", "Something else about HTTP; the status says what."),
    "internal_error": Code(500, "A bug in the manager", "The manager's log has the details: please report it."),
}
"""Errors of the web face itself."""

HUB_CODES: Mapping[str, Code] = {
    "unknown_site": Code(404, "There is no such site", "`GET /api/v1/sites` of the hub lists those there are."),
    "site_silent": Code(
        503,
        "The site does not reply",
        "It is cut off, switched off, or too slow. It runs as before; its own manager has its lifts. No command was carried out.",
    ),
    "unconfirmed": Code(
        504,
        "Nobody knows whether the command was carried out",
        "The reply of the site was lost. Send the command again with a new ticket and the same idempotency key: it begins nothing twice.",
    ),
    "ticket_over": Code(
        409,
        "The ticket is not good",
        "It was used, or the command arrived later than 2 s after the site issued it. Nothing was done: request another ticket.",
    ),
    "bad_reply": Code(502, "The site sent a reply that means nothing here", "It may be of another version."),
}
"""Errors of a hub."""

CODES: Mapping[str, Code] = {
    **{str(code): entry_code for code, entry_code in REFUSAL_CODES.items()},
    **WEB_CODES,
    **HUB_CODES,
}


def title(code: str, status: int) -> str:
    """Return the title of a code."""
    return CODES[code].title if code in CODES and code != "http_error" else HTTPStatus(status).phrase
