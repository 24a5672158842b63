"""What the registration of a route of /api/v1 wants to know: the OpenAPI operation with its schemas, examples and errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.problem import MEDIA_TYPE, Problem
from lift_manager.web.codes import CODES
from lift_manager.web.schemas import PROBLEM, kept, schema_of

Json = dict[str, Any]


class Takes(NamedTuple):
    """The body that an operation takes."""

    form: type[BaseModel]
    examples: Mapping[str, Json]
    """By what each of them is for."""
    required: bool = True


class Gives(NamedTuple):
    """One answer yes; without a form it has no body."""

    text: str
    form: type[BaseModel] | None = None
    example: BaseModel | None = None
    headers: Mapping[str, Json] | None = None


EVERY_CHANGE = ("another_site",)
"""Codes of every request that changes something."""
EVERY_BODY = ("too_long", "malformed")
EVERY_LIFT = ("unknown_lift", "no_such_path")
"""Codes of every request that names a lift in its path."""


def operation(
    summary: str,
    description: str,
    gives: Mapping[int, Gives],
    codes: tuple[str, ...],
    *,
    takes: Takes | None = None,
    parameters: tuple[Json, ...] = (),
) -> dict[str, Any]:
    """Return the arguments of `add_api_route`."""
    extra: Json = {"parameters": list(parameters)} if parameters else {}
    if takes is not None:
        examples = {name: {"value": kept(value)} for name, value in takes.examples.items()}
        content = {"application/json": {"schema": schema_of(takes.form), "examples": examples}}
        extra["requestBody"] = {"required": takes.required, "content": content}
    return {
        "summary": summary,
        "description": description,
        "status_code": min(gives),
        "response_class": Response,
        "responses": {**{status: _given(answer) for status, answer in gives.items()}, **_errors(codes)},
        "openapi_extra": extra,
    }


def _given(answer: Gives) -> Json:
    said: Json = {"description": answer.text}
    if answer.headers:
        said["headers"] = dict(answer.headers)
    if answer.form is not None and answer.example is not None:
        value = answer.example.model_dump(mode="json", by_alias=True)
        content = {"schema": schema_of(answer.form), "examples": {"example": {"value": kept(value)}}}
        said["content"] = {"application/json": content}
    return said


def _errors(codes: tuple[str, ...]) -> dict[int, Json]:
    """Return the answers no by status, each with the codes that it may have."""
    found: dict[int, Json] = {}
    for code in codes:
        status, title, text = CODES[code]
        said = found.setdefault(
            status, {"description": "", "content": {MEDIA_TYPE: {"schema": PROBLEM, "examples": {}}}}
        )
        said["description"] = f"{said['description']} {title} (`{code}`).".strip()
        example = Problem.of(status, code, title, text).model_dump(mode="json", exclude_none=True)
        said["content"][MEDIA_TYPE]["examples"][code] = {"summary": title, "value": example}
    return found


def in_path(name: str, description: str, example: str, pattern: str = "^[^/]+$") -> Json:
    """Return the parameter of a path."""
    return {
        "name": name,
        "in": "path",
        "required": True,
        "description": description,
        "schema": {"type": "string", "pattern": pattern},
        "example": example,
    }


_ANY_NAME = r"^[^\n]+$"
"""A name that may hold a slash."""
LIFT = in_path("lift", "A lift of the site, percent-encoded where its name needs it: `/` is `%2F`.", "east", _ANY_NAME)
LINK = in_path("link", "A link of the site, as `GET /api/v1/links` names it, percent-encoded.", "plc", _ANY_NAME)
SESSION = in_path("session", "The id that the answer to `POST .../sessions` told.", "s-4f1d2c")
COMMAND = in_path("command", "The id that the answer to `POST .../commands` told.", "7")
RIDE = in_path("ride", "The id that the answer to `POST /api/v1/rides` told.", "r-81c0")

WAIT: Json = {
    "name": "wait",
    "in": "query",
    "required": False,
    "description": "Seconds to wait for the end: answered as soon as it is no longer pending, or as it is then.",
    "schema": {"type": "number", "minimum": 0, "maximum": 30, "default": 0},
    "example": 5,
}
IF_NONE_MATCH: Json = {
    "name": "If-None-Match",
    "in": "header",
    "required": False,
    "description": "The `ETag` of an earlier answer, several of them, or `*`. Compared weakly.",
    "schema": {"type": "string"},
    "example": 'W/"5f0c7a31b2d94e68a1c3d7f0"',
}
