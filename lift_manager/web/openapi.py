"""Extends the OpenAPI document of FastAPI: errors by code, keys and roles, examples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Annotated, Any

from fastapi import Body, FastAPI, Path
from starlette.routing import compile_path

from lift_manager.api.keys import Keys
from lift_manager.api.problem import MEDIA_TYPE, Problem
from lift_manager.api.roles import ROLES, AccessLevel, Role, Route
from lift_manager.lift.config import LIFT_NAME
from lift_manager.web import examples
from lift_manager.web.authenticator import CSRF_HEADER
from lift_manager.web.error_codes import CODES
from lift_manager.web.replies import is_api, is_workshop
from lift_manager.web.workshop_docs import ENVELOPE

Document = dict[str, Any]

LiftName = Annotated[
    str,
    Path(
        description="A lift of the site.",
        json_schema_extra={"pattern": LIFT_NAME},  # documented, not checked: an unknown name is 404
        examples=[examples.LIFT.name],
    ),
]

EVERY_CHANGE = ("another_site",)
"""Codes of every request that changes something."""
EVERY_BODY = ("too_long", "malformed")
EVERY_LIFT = ("unknown_lift",)
"""Codes of every request that names a lift in its path."""
NOT_FREE = (
    "held",
    "queued",
    "offline",
    "mode",
    "fire_latched",
    "locked_out",
    "outside_hours",
    "monitor_only",
    "not_possible",
    "occupancy_unknown",
)
"""Reasons why a lift is not available."""
LOCATION = {
    "Location": {
        "description": "Where to read it, relative to the address of this request.",
        "schema": {"type": "string"},
    }
}
PROBLEM = {"$ref": "#/components/schemas/Problem"}


def problems(*codes: str) -> dict[int | str, Document]:
    """Return the responses of a route that may refuse a request with these codes."""
    found: dict[int | str, Document] = {}
    for code in dict.fromkeys(codes):
        status, title, text = CODES[code]
        response = found.setdefault(
            status, {"description": "", "content": {MEDIA_TYPE: {"schema": PROBLEM, "examples": {}}}}
        )
        response["description"] = f"{response['description']} {title} (`{code}`).".strip()
        example = Problem.of(status, code, title, text).model_dump(mode="json", exclude_none=True)
        response["content"][MEDIA_TYPE]["examples"][code] = {"summary": title, "value": example}
    return found


def errors_of(texts: Mapping[int, str]) -> dict[int | str, Document]:
    """Return the responses of a route that may fail with these statuses, each with a description."""
    content = {MEDIA_TYPE: {"schema": PROBLEM}}
    return {status: {"description": text, "content": content} for status, text in texts.items()}


def in_path(description: str, example: str) -> Any:
    """Return the documentation of a path parameter."""
    return Path(description=description, json_schema_extra={"pattern": "^[^/]+$"}, examples=[example])


def in_body(examples: Mapping[str, Document], *, otherwise: Callable[[], Any] | None = None) -> Any:
    """Return the documentation of a body, with examples by purpose. `otherwise` makes the default for a missing body."""
    named: Any = {name: {"value": value} for name, value in examples.items()}
    return Body(default_factory=otherwise, openapi_examples=named)


SCHEME = "key"
_SCHEME = {
    "type": "http",
    "scheme": "bearer",
    "description": (
        "A key that `lift-manager keys make` has printed. As soon as a site has one, every request needs one. A site without keys"
        " accepts requests from its own computer, and from others only if its site file says so. They must name the manager by an IP address,"
        " as localhost or by one of `api: {host_names: [...]}`, because anybody could point another name at it."
    ),
}

LOGIN_SCHEME, CSRF_SCHEME = "login", "csrf"
_LOGIN_SCHEMES = {
    LOGIN_SCHEME: {
        "type": "apiKey",
        "in": "cookie",
        "name": "lift-manager-{port}",
        "description": "The cookie of `POST /api/v1/login`, which stands for a key. It is named after the port of the manager.",
    },
    CSRF_SCHEME: {
        "type": "apiKey",
        "in": "header",
        "name": CSRF_HEADER,
        "description": "The `csrf` of `GET /api/v1/login`, beside the cookie, for requests that change something.",
    },
}

_REFUSALS = {
    400: "This is not HTTP, or the address contains a key, where it does not belong (`key_in_address`).",
    403: "The site has no keys, and the request names an unknown host (`another_site`).",
    431: "Address and headers are too long.",
    500: "A bug in the manager.",
}

_KEY_REFUSALS = {
    401: "A key is needed (`key_needed`), the one sent is mistyped, revoked or of another site (`bad_key`), or the login is over (`login_over`).",
    403: "The key does not have the role, or does not name the lift (`not_allowed`); or a login came without its token (`csrf_token`).",
}
"""Also, on routes that need a key."""

_ROBOT_REQUIRED: Mapping[str, Document] = {
    "/api/v1/lifts/{lift}/sessions": {},
    "/api/v1/rides": {"dry_run": {"const": False}},
}
"""Routes on which an idempotency key needs a robot name, and for which bodies: a plan begins nothing."""
_DETAIL: Document = {
    "type": "object",
    "properties": {"detail": {"type": "string"}},
    "required": ["detail"],
    "example": {"detail": "a key is needed"},
}
"""The reply outside the faces, as under `/metrics`."""
_EXAMPLES = (
    examples.LIFT,
    examples.LIFTS,
    examples.CAPABILITIES,
    examples.SIGNALS,
    examples.COMMANDS,
    examples.PLANNED_WRITES,
    examples.SESSION,
    examples.COMMAND,
    examples.RIDE,
    examples.RIDES,
    examples.PLAN,
    examples.RMF_SITE,
    examples.RMF_TAKEN,
    examples.LOGIN,
)


def describe_access(app: FastAPI, routes: Sequence[Route], keys: Keys, lifts: Sequence[str] = ()) -> None:
    """Add access rules to the OpenAPI document of an application, and remove operations that are not in `routes`.

    Without `keys`, it also states which bodies need a robot name. The first of `lifts` is the example wherever a request names a
    lift, so that the examples of /docs can be tried.
    """
    documents: list[Document] = []
    derived: Callable[[], Document] = app.openapi
    route_of = {(method, compile_path(route.path)[1]): route for route in routes for method in route.methods}

    def openapi() -> Document:
        if not documents:
            document = derived()
            _add_components(document)
            for path, operations in list(document["paths"].items()):
                for method in list(operations):
                    route = route_of.get((method.upper(), path))
                    if route is None:
                        del operations[method]
                    else:
                        _describe(method, path, operations[method], route.need)
                        _use_real_lift(operations[method], lifts)
                if not operations:
                    del document["paths"][path]
            documents.extend((_without_keys(document), document))
        return documents[keys.are_required]

    app.openapi = openapi  # type: ignore[method-assign]  # the way documented by FastAPI


def _without_keys(document: Document) -> Document:
    """Return the document of a site without keys, where an idempotency key needs a robot name (`callers.refuse_shared_key`)."""
    document = deepcopy(document)
    for path, exception in _ROBOT_REQUIRED.items():
        if (operation := document["paths"].get(path, {}).get("post")) is not None:
            schema = operation["requestBody"]["content"]["application/json"]["schema"]
            given = {"not": {"type": "null"}}
            schema["if"] = {"required": ["idempotency_key"], "properties": {"idempotency_key": given, **exception}}
            schema["then"] = {"required": ["robot"], "properties": {"robot": given}}
    return document


def _add_components(document: Document) -> None:
    components = document.setdefault("components", {})
    components["securitySchemes"] = {SCHEME: _SCHEME, **_LOGIN_SCHEMES}
    schemas = components.setdefault("schemas", {})
    problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas |= problem.pop("$defs") | {"Problem": problem}
    for name in ("HTTPValidationError", "ValidationError"):  # FastAPI's own error, which is never sent
        schemas.pop(name, None)
    for example in _EXAMPLES:  # here because FastAPI drops each null of an example
        schema = schemas.get(type(example).__name__, {})
        schema["examples"] = [example.model_dump(mode="json", by_alias=True)]


def _describe(method: str, path: str, operation: Document, need: AccessLevel) -> None:
    operation["security"] = [] if need is AccessLevel.NOTHING else _security(method, path)
    operation["description"] = f"{operation.get('description', '').rstrip()}\n\n{_roles_text(need)}\n"
    content = {MEDIA_TYPE: {"schema": PROBLEM}}
    if not is_api(path):
        content = {"application/json": {"schema": ENVELOPE if is_workshop(path) else _DETAIL}}
    responses: Document = operation["responses"]
    if "HTTPValidationError" in str(responses.get("422")):
        del responses["422"]
    refusals = [*_REFUSALS.items()] if need is AccessLevel.NOTHING else [*_KEY_REFUSALS.items(), *_REFUSALS.items()]
    for status, text in refusals:
        response = responses.setdefault(str(status), {"description": "", "content": content})
        response["description"] = f"{response['description']} {text}".strip()
        if status == 401:
            response["headers"] = {"WWW-Authenticate": {"schema": {"type": "string"}}}
    operation["responses"] = dict(sorted(responses.items()))


def _security(method: str, path: str) -> list[Document]:
    """Return what may be sent: a key; under /api a login, for changes with its token; and nothing where a site has no keys."""
    login: Document = {LOGIN_SCHEME: []} | ({} if method == "get" else {CSRF_SCHEME: []})
    return [{SCHEME: []}, *([login] if is_api(path) else []), {}]


def _use_real_lift(operation: Document, lifts: Sequence[str]) -> None:
    """Use an existing lift in the examples of a request."""
    for parameter in operation.get("parameters", ()):
        if suggested := parameter["schema"].pop("examples", None):
            is_lift = lifts and (parameter["name"], parameter["in"]) == ("lift", "path")
            parameter["example"] = lifts[0] if is_lift else suggested[0]
    content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
    for example in content.get("examples", {}).values():
        if lifts and example["value"].get("lift") == examples.LIFT.name:
            example["value"] = {**example["value"], "lift": lifts[0]}


def _roles_text(need: AccessLevel) -> str:
    if need is AccessLevel.NOTHING:
        return "Needs no key."
    roles = ", ".join(role for role in Role if role in ROLES[need])
    limit = {
        AccessLevel.COMMAND: " (a robot: for the lifts that its key names)",
        AccessLevel.RMF: " (for the lifts that its key names)",
    }.get(need, "")
    return f"With keys, allowed roles: {roles}{limit}."
