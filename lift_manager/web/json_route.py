"""Routes whose body is a model: read as strict JSON whatever type it declares, and refused in words that say what is expected."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from functools import lru_cache
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.web.body import decode_object, read_body
from lift_manager.web.errors import RequestError


class JsonRoute(APIRoute):
    """A route of /api/v1, whose answers are not stored. A body that cannot be read is refused like a wrong value: after all dependencies."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return FastAPI's handler around a stricter request."""
        handle = super().get_route_handler()
        form: Any = None if self.body_field is None else self.body_field.field_info.annotation

        async def handle_json(request: Request) -> Response:
            # without a declared type FastAPI takes the body for JSON
            headers = [header for header in request.scope["headers"] if header[0] != b"content-type"]
            try:
                response = await handle(_JsonRequest({**request.scope, "headers": headers}, request.receive))
            except RequestValidationError as error:
                raise _malformed(error, form) from error
            response.headers.setdefault("cache-control", "no-store")
            return response

        return handle_json


class _JsonRequest(Request):
    """FastAPI asks for `json` where `body` is not empty. An error in place of a value fails the validation of any model."""

    _value: dict[str, object] | tuple[RequestError] | None = None
    """The error in a tuple: of any other object pydantic would read the attributes."""

    async def body(self) -> bytes:
        try:
            content = await read_body(self)
            self._value = decode_object(content) if content.strip() else None
        except RequestError as error:
            self._value = (error,)
        return b"" if self._value is None else b"{}"

    async def json(self) -> dict[str, object] | tuple[RequestError] | None:
        return self._value


def _malformed(error: RequestValidationError, form: type[BaseModel] | None) -> RequestError:
    found: Any = error.errors()[0]
    place, *names = found["loc"]
    if place != "body" or form is None:
        field = ".".join(map(str, names))
        return RequestError("malformed", f"{field} {_text(found)}", field=field)
    field = ".".join(map(str, names)) or str(found.get("ctx", {}).get("field", ""))
    match found.get("input"):
        case (RequestError(code="malformed") as unread,):
            text = unread.message
        case (RequestError() as unread,):
            return unread
        case None if not field:
            text = "the body is empty"
        case _:
            text = f"{field} {_text(found)}".lstrip()
    return RequestError("malformed", f"{text}; expected {expected(form)}", field=field or None)


@lru_cache(maxsize=64)
def expected(form: type[BaseModel]) -> str:
    """Return what a body looks like, in words: `{"floor": text, "hold_door"?: true or false}`."""
    schema = form.model_json_schema()
    text = _shape(schema, schema.get("$defs", {}))
    return f"{text} (? may be left out)" if "?" in text else text


def _shape(schema: Mapping[str, Any], inner: Mapping[str, Any]) -> str:
    needed = schema.get("required", ())
    keys = (f'"{name}"{"" if name in needed else "?"}: {_word(of, inner)}' for name, of in schema["properties"].items())
    return "{" + ", ".join(keys) + "}"


def _word(schema: Mapping[str, Any], inner: Mapping[str, Any]) -> str:
    match schema:
        case {"$ref": str(name)}:
            return _word(inner[name.rpartition("/")[2]], inner)
        case {"anyOf": [one, *_]}:
            return _word(one, inner)
        case {"enum": values}:
            return "one of " + ", ".join(map(str, values))
        case {"const": True}:
            return "true"
        case {"properties": _}:
            return _shape(schema, inner)
        case _:
            return _WORDS[schema["type"]]


_WORDS = {"string": "text", "number": "number", "integer": "number", "boolean": "true or false"}


def _text(found: Mapping[str, Any]) -> str:
    """Return what pydantic found wrong, in words that follow the name of the field."""
    told = found.get("ctx", {})
    match found["type"]:
        case "string_too_long":
            return f"must not be longer than {told['max_length']} characters"
        case "enum" | "literal_error":
            return f"must be {told['expected']}"
        case "greater_than_equal":
            return f"must be at least {told['ge']:g}"
        case "less_than_equal":
            return f"must be at most {told['le']:g}"
        case kind:
            return _TEXTS.get(kind, str(found["msg"]))


_TEXTS = {
    "missing": "is missing",
    "extra_forbidden": "is not known here",
    "string_too_short": "must not be empty",
    "string_type": "must be text",
    "string_unicode": "must be whole characters: it holds half of one (a lone surrogate, such as \\ud800)",
    "string_pattern_mismatch": "must be printable ASCII without blanks",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a number",
    "bool_type": "must be true or false",
    "model_attributes_type": "must be an object",
}
