"""Routes whose body is a model: strict JSON whatever its content type, with refusals that state what is expected."""

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
    """A route of /api/v1 without caching. A body that cannot be parsed is refused like a wrong value: after all dependencies."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of FastAPI with a stricter request."""
        handler = super().get_route_handler()
        model: Any = None if self.body_field is None else self.body_field.field_info.annotation

        async def handle_json(request: Request) -> Response:
            # without a content type FastAPI assumes JSON
            headers = [header for header in request.scope["headers"] if header[0] != b"content-type"]
            try:
                response = await handler(_JsonRequest({**request.scope, "headers": headers}, request.receive))
            except RequestValidationError as error:
                raise _malformed(error, model) from error
            response.headers.setdefault("cache-control", "no-store")
            return response

        return handle_json


class _JsonRequest(Request):
    """FastAPI calls `json` if `body` is not empty. An error in place of a value fails the validation of any model."""

    _value: dict[str, object] | tuple[RequestError] | None = None
    """The error is in a tuple, because pydantic would read the attributes of any other object."""

    async def body(self) -> bytes:
        try:
            content = await read_body(self)
            self._value = decode_object(content) if content.strip() else None
        except RequestError as error:
            self._value = (error,)
        return b"" if self._value is None else b"{}"

    async def json(self) -> dict[str, object] | tuple[RequestError] | None:
        return self._value


def _malformed(error: RequestValidationError, model: type[BaseModel] | None) -> RequestError:
    error_details: Any = error.errors()[0]
    location, *names = error_details["loc"]
    if location != "body" or model is None:
        field = ".".join(map(str, names))
        return RequestError("malformed", f"{field} {_validation_text(error_details)}", field=field)
    field = ".".join(map(str, names)) or str(error_details.get("ctx", {}).get("field", ""))
    match error_details.get("input"):
        case (RequestError(code="malformed") as unread,):
            text = unread.message
        case (RequestError() as unread,):
            return unread
        case None if not field:
            text = "the body is empty"
        case _:
            text = f"{field} {_validation_text(error_details)}".lstrip()
    return RequestError("malformed", f"{text}; expected {expected_text(model)}", field=field or None)


@lru_cache(maxsize=64)
def expected_text(model: type[BaseModel]) -> str:
    """Return a description of a body: `{"floor": text, "hold_door"?: true or false}`."""
    schema = model.model_json_schema()
    text = _shape(schema, schema.get("$defs", {}))
    return f"{text} (? may be left out)" if "?" in text else text


def _shape(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    required = schema.get("required", ())
    keys = (
        f'"{name}"{"" if name in required else "?"}: {_type_name(property_schema, definitions)}'
        for name, property_schema in schema["properties"].items()
    )
    return "{" + ", ".join(keys) + "}"


def _type_name(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    match schema:
        case {"$ref": str(name)}:
            return _type_name(definitions[name.rpartition("/")[2]], definitions)
        case {"anyOf": [one, *_]}:
            return _type_name(one, definitions)
        case {"enum": values}:
            return "one of " + ", ".join(map(str, values))
        case {"const": True}:
            return "true"
        case {"properties": _}:
            return _shape(schema, definitions)
        case _:
            return _TYPE_NAMES[schema["type"]]


_TYPE_NAMES = {"string": "text", "number": "number", "integer": "number", "boolean": "true or false"}


def _validation_text(error_details: Mapping[str, Any]) -> str:
    """Return an error of pydantic as a text that follows the name of the field."""
    context = error_details.get("ctx", {})
    match error_details["type"]:
        case "string_too_long":
            return f"must not be longer than {context['max_length']} characters"
        case "enum" | "literal_error":
            return f"must be {context['expected']}"
        case "greater_than_equal":
            return f"must be at least {context['ge']:g}"
        case "less_than_equal":
            return f"must be at most {context['le']:g}"
        case kind:
            return _VALIDATION_TEXTS.get(kind, str(error_details["msg"]))


_VALIDATION_TEXTS = {
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
