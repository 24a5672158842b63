"""A request's body as a model, or the answer that says what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TypeVar

from fastapi import Request
from pydantic import BaseModel, ValidationError
from starlette.responses import Response

from lift_manager.web.body import LingeringResponse, decode_object, read_body
from lift_manager.web.errors import BodyTooLongError, InputError
from lift_manager.web.problem import problem
from lift_manager.web.schemas import schema_of

Body = TypeVar("Body", bound=BaseModel)


async def taken(request: Request, form: type[Body], *, may_be_empty: bool = False) -> Body | Response:
    """Return the body; `may_be_empty` takes none for `{}`."""
    try:
        body = await read_body(request)
        return form.model_validate({} if may_be_empty and not body.strip() else decode_object(body))
    except BodyTooLongError as error:
        return problem(413, "too_long", str(error), kind=LingeringResponse)
    except InputError as error:
        return problem(422, "malformed", f"{error}; expected {expected(form)}")
    except ValidationError as error:
        field, text = _first(error)
        return problem(422, "malformed", f"{field} {text}; expected {expected(form)}".lstrip(), field=field or None)


@lru_cache(maxsize=64)
def expected(form: type[BaseModel]) -> str:
    """Return what a body looks like, in words: `{"floor": text, "hold_door"?: true or false}`."""
    schema = schema_of(form)
    text = _shape(schema)
    return f"{text} (? may be left out)" if "?" in text else text


def _shape(schema: Mapping[str, Any]) -> str:
    needed = schema.get("required", ())
    keys = (f'"{name}"{"" if name in needed else "?"}: {_word(of)}' for name, of in schema["properties"].items())
    return "{" + ", ".join(keys) + "}"


def _word(schema: Mapping[str, Any]) -> str:
    match schema:
        case {"anyOf": [one, *_]}:
            return _word(one)
        case {"enum": values}:
            return "one of " + ", ".join(map(str, values))
        case {"const": True}:
            return "true"
        case {"properties": _}:
            return _shape(schema)
        case _:
            return _WORDS[schema["type"]]


_WORDS = {"string": "text", "number": "number", "integer": "number", "boolean": "true or false"}


def _first(error: ValidationError) -> tuple[str, str]:
    """Return the key of the first thing that is wrong, and what is wrong with it."""
    found: Any = error.errors(include_url=False, include_input=False)[0]
    told = found.get("ctx", {})
    field = ".".join(str(part) for part in found["loc"]) or str(told.get("field", ""))
    match found["type"]:
        case "string_too_long":
            return field, f"must not be longer than {told['max_length']} characters"
        case "enum" | "literal_error":
            return field, f"must be {told['expected']}"
        case "greater_than_equal":
            return field, f"must be at least {told['ge']:g}"
        case "less_than_equal":
            return field, f"must be at most {told['le']:g}"
        case kind:
            return field, _TEXTS.get(kind, str(found["msg"]))


_TEXTS = {
    "missing": "is missing",
    "extra_forbidden": "is not known here",
    "string_too_short": "must not be empty",
    "string_type": "must be text",
    "string_unicode": "must be whole characters: it holds half of one (a lone surrogate, such as \\ud800)",
    "string_pattern_mismatch": "must be printable ASCII without blanks",
    "float_type": "must be a number",
    "finite_number": "must be a number",
    "bool_type": "must be true or false",
    "model_type": "must be an object",
}
