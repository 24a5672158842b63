"""The models of /api/v1 as schemas for the OpenAPI document, whole: a reference into a schema of its own leads nowhere there."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

from pydantic import BaseModel

Schema = dict[str, Any]

PROBLEM = {"$ref": "#/components/schemas/Problem"}
"""`openapi.describe_access` puts it there."""


@lru_cache(maxsize=64)
def schema_of(form: type[BaseModel]) -> Schema:
    """Return the schema of a model with everything in place. Not to be changed."""
    schema = form.model_json_schema()
    inner = schema.pop("$defs", {})
    whole = _whole(schema, inner)
    assert isinstance(whole, dict)  # noqa: S101  a schema is an object, and stays one
    return whole


_KEPT = "x-kept"


def kept(value: object) -> Schema:
    """Return an example so that FastAPI leaves it whole: it drops each null in a document. `put_back` makes it again what it was."""
    return {_KEPT: json.dumps(value)}


def put_back(part: object) -> object:
    """Return a part of a document with its examples in place."""
    match part:
        case {"x-kept": str(text)}:
            return json.loads(text)
        case dict():
            return {key: put_back(value) for key, value in part.items()}
        case list():
            return [put_back(value) for value in part]
        case _:
            return part


def _whole(part: object, inner: Schema) -> object:
    match part:
        case {"$ref": str(name), **more}:
            found = _whole(inner[name.rpartition("/")[2]], inner)
            assert isinstance(found, dict)  # noqa: S101  so is what it refers to
            return {**found, **more}
        case dict():
            return {key: _whole(value, inner) for key, value in part.items()}
        case list():
            return [_whole(value, inner) for value in part]
        case _:
            return part
