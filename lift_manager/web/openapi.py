"""What the OpenAPI document says of keys: the scheme, which role each operation needs, and how it is refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

from fastapi import FastAPI
from starlette.routing import compile_path

from lift_manager.api.problem import MEDIA_TYPE, Problem
from lift_manager.domain.access import ROLES, Need, Role, Route
from lift_manager.domain.keys import Keys
from lift_manager.web import examples
from lift_manager.web.faces import is_api, is_workshop
from lift_manager.web.schemas import PROBLEM, put_back, schema_of
from lift_manager.web.workshop_docs import ENVELOPE

SCHEME = "key"
_SCHEME = {
    "type": "http",
    "scheme": "bearer",
    "description": (
        "A key that `lift-manager keys make` has printed. As soon as a site has one, every request needs one. A site without keys"
        " takes requests from its own computer, and from others only where its site file says so; only by an IP address, as localhost or"
        " by one of `api: {host_names: [...]}`, for any other name may be made to lead there."
    ),
}

_REFUSALS = {
    400: "This is no HTTP, or the address holds a key, where it does not belong (`key_in_address`).",
    403: "The site has no keys, and the request names an unknown host (`another_site`).",
    431: "Address and headers are too long.",
    500: "A bug in the manager.",
}

_OF_KEYS = {
    401: "A key is needed (`key_needed`), or the one sent is mistyped, revoked or of another site (`bad_key`).",
    403: "The key has not the role, or does not name the lift (`not_allowed`).",
}
"""Beside these, where a route needs a key."""

Document = dict[str, Any]
_NEEDS_A_ROBOT: Mapping[str, Document] = {
    "/api/v1/lifts/{lift}/sessions": {},
    "/api/v1/rides": {"dry_run": {"const": False}},
}
"""What an idempotency key begins, and in which bodies: a plan begins nothing."""
_DETAIL: Document = {
    "type": "object",
    "properties": {"detail": {"type": "string"}},
    "required": ["detail"],
    "example": {"detail": "a key is needed"},
}
"""What is answered where no face has a form of its own, as under `/metrics`."""


def describe_access(app: FastAPI, routes: Sequence[Route], keys: Keys, lifts: Sequence[str] = ()) -> None:
    """Let the document of an application tell what its routes need; one that is not in `routes` is left out of it.

    While no `keys` are needed, it also says what a body needs then. The first of `lifts` is the example wherever a request names one,
    so that what /docs suggests can be tried.
    """
    documents: list[Document] = []
    made: Callable[[], Document] = app.openapi
    of = {(method, compile_path(route.path)[1]): route for route in routes for method in route.methods}

    def openapi() -> Document:
        if not documents:
            document: Document = {key: put_back(part) for key, part in made().items()}
            components = document.setdefault("components", {})
            components["securitySchemes"] = {SCHEME: _SCHEME}
            components.setdefault("schemas", {})["Problem"] = schema_of(Problem)
            paths = document["paths"]
            for path, operations in list(paths.items()):
                for method in list(operations):
                    route = of.get((method.upper(), path))
                    if route is None:
                        del operations[method]
                    else:
                        _describe(path, operations[method], route.need)
                        _suggest(operations[method], lifts)
                if not operations:
                    del paths[path]
            documents.extend((_without_keys(document), document))
        return documents[keys.needed]

    app.openapi = openapi  # type: ignore[method-assign]  # the way that FastAPI's own manual goes


def _without_keys(document: Document) -> Document:
    """Return the document of a site without keys, where an idempotency key needs a robot: `callers.no_shared_key` refuses it otherwise."""
    document = deepcopy(document)
    for path, but in _NEEDS_A_ROBOT.items():
        if (operation := document["paths"].get(path, {}).get("post")) is not None:
            schema = operation["requestBody"]["content"]["application/json"]["schema"]
            given = {"not": {"type": "null"}}
            schema["if"] = {"required": ["idempotency_key"], "properties": {"idempotency_key": given, **but}}
            schema["then"] = {"required": ["robot"], "properties": {"robot": given}}
    return document


def _describe(path: str, operation: Document, need: Need) -> None:
    # {}: a site without keys asks for none
    operation["security"] = [] if need is Need.NOTHING else [{SCHEME: []}, {}]
    operation["description"] = f"{operation.get('description', '').rstrip()}\n\n{_who(need)}\n"
    content = {MEDIA_TYPE: {"schema": PROBLEM}}
    if not is_api(path):
        content = {"application/json": {"schema": ENVELOPE if is_workshop(path) else _DETAIL}}
    responses: Document = operation["responses"]
    refusals = [*_REFUSALS.items()] if need is Need.NOTHING else [*_OF_KEYS.items(), *_REFUSALS.items()]
    for status, text in refusals:
        said = responses.setdefault(str(status), {"description": "", "content": content})
        said["description"] = f"{said['description']} {text}".strip()
        if status == 401:
            said["headers"] = {"WWW-Authenticate": {"schema": {"type": "string"}}}
    operation["responses"] = dict(sorted(responses.items()))


def _suggest(operation: Document, lifts: Sequence[str]) -> None:
    """Let the examples of a request name a lift that there is."""
    if not lifts:
        return
    for parameter in operation.get("parameters", ()):
        if parameter["name"] == "lift" and parameter["in"] == "path":
            parameter["example"] = lifts[0]
    content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
    for example in content.get("examples", {}).values():
        if example["value"].get("lift") == examples.LIFT.name:
            example["value"] = {**example["value"], "lift": lifts[0]}


def _who(need: Need) -> str:
    if need is Need.NOTHING:
        return "Needs no key."
    roles = ", ".join(role for role in Role if role in ROLES[need])
    limit = {
        Need.COMMAND: " (a robot: for the lifts that its key names)",
        Need.RMF: " (for the lifts that its key names)",
    }.get(need, "")
    return f"Where keys are used, the roles that may: {roles}{limit}."
