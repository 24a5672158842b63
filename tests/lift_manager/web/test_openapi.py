"""The OpenAPI document of /api/v1: every operation with its words and examples, and each example as its schema has it."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel, ValidationError

from lift_manager.api.keys import KeyRing, Keys
from lift_manager.api.people import AcknowledgeRequest
from lift_manager.api.problem import MEDIA_TYPE
from lift_manager.api.rides import ANY
from lift_manager.api.rmf import RmfEndedRequest
from lift_manager.api.roles import ROUTES, AccessLevel, Role
from lift_manager.api.sessions import CommandRequest, OpenSessionRequest
from lift_manager.lift.commands import CommandType
from lift_manager.web.error_codes import CODES
from tests.lift_manager.web.changes import OF_THE_CALLER
from tests.lift_manager.web.fake import FakeSite, ask
from tests.lift_manager.web.fake_lifts import IDLE
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row

Json = dict[str, Any]
API = [
    (method.lower(), route.path.replace(":path}", "}"))
    for route in ROUTES
    for method in route.methods
    if route.path.startswith("/api/v1") and "/events" not in route.path and "/links" not in route.path
]


@cache
def document(keys: KeyRing | None = None) -> Json:
    """What a site with these keys says of itself, made once for everybody who asks."""
    bears = {} if keys is None else bearing(Role.OPERATOR)
    found: Json = ask(FakeSite(), "GET", "/openapi.json", keys=keys, headers=bears).json()
    return found


def operation(method: str, path: str) -> Json:
    found: Json = document()["paths"][path][method]
    return found


def schema_in(content: Mapping[str, Any]) -> Json:
    """The schema of a body, which may be one of the components."""
    schema: Json = content["schema"]
    if "$ref" in schema:
        schema = document()["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return {**schema, "components": document()["components"]}


def examples_in(content: Mapping[str, Any]) -> list[Json]:
    """The examples of a body: its own, or those of what it is."""
    schemas = [schema_in({"schema": one}) for one in content["schema"].get("anyOf", [content["schema"]])]
    own = [example["value"] for example in content.get("examples", {}).values()]
    return own or [example for schema in schemas for example in schema.get("examples", ())]


def contents(of: Mapping[str, Any]) -> Iterator[tuple[str, Json]]:
    """Every body of an operation, with where it is."""
    if "requestBody" in of:
        yield "request", of["requestBody"]["content"]["application/json"]
    for status, said in of["responses"].items():
        for kind, content in said.get("content", {}).items():
            yield f"{status} {kind}", content


def references(part: object) -> Iterator[str]:
    if isinstance(part, dict):
        if isinstance(name := part.get("$ref"), str):
            yield name
        part = list(part.values())
    if isinstance(part, list):
        for inner in part:
            yield from references(inner)


@each_row(("method", "path"), API)
def test_every_operation_says_what_it_is_for_and_what_can_come(method: str, path: str) -> None:
    said = operation(method, path)
    assert said["summary"]
    assert said["description"]
    assert said["tags"]
    assert all(answer["description"] for answer in said["responses"].values())
    assert {"400", "401", "403", "431", "500"} <= said["responses"].keys()
    if "{lift}" in path:
        assert "404" in said["responses"]
    if method == "post" and path not in OF_THE_CALLER:
        assert {"409", "503"} <= said["responses"].keys()
    if "requestBody" in said:
        assert {"413", "422"} <= said["responses"].keys()
    named = {parameter["name"] for parameter in said.get("parameters", ()) if parameter["in"] == "path"}
    assert named == {part.strip("{}") for part in path.split("/") if part.startswith("{")}


@each_row(("method", "path"), [one for one in API if not {"acknowledge", "lockout", "drain"} & set(one[1].split("/"))])
def test_every_body_has_examples_and_they_are_as_its_schema_has_them(method: str, path: str) -> None:
    if path.endswith("force-release"):
        return
    for where, content in contents(operation(method, path)):
        examples = examples_in(content)
        if not where.endswith(MEDIA_TYPE):
            assert examples, where
        # that the schema itself is valid is seen once, below
        validator = jsonschema.Draft202012Validator(schema_in(content), format_checker=jsonschema.FormatChecker())
        for example in examples:
            validator.validate(example)


@each_row(("method", "path"), API)
def test_every_documented_code_is_in_the_table_with_this_status(method: str, path: str) -> None:
    for status, said in operation(method, path)["responses"].items():
        for code, example in said.get("content", {}).get(MEDIA_TYPE, {}).get("examples", {}).items():
            assert CODES[code].status == int(status) == example["value"]["status"]
            assert f"`{code}`" in said["description"]


def test_every_summary_is_a_few_words_and_no_two_are_the_same() -> None:
    summaries = [said["summary"] for operations in document()["paths"].values() for said in operations.values()]
    assert len(set(summaries)) == len(summaries) > 30
    assert max(map(len, summaries)) <= 40
    assert all(text[0].isupper() and text[-1].isalpha() for text in summaries)


def test_the_document_is_valid_by_the_specification() -> None:
    from openapi_spec_validator import OpenAPIV31SpecValidator  # which takes long to load, and nobody else needs it

    assert [error.message for error in OpenAPIV31SpecValidator(document()).iter_errors()] == []


def test_every_parameter_in_a_path_is_declared() -> None:
    paths = {route.path.replace(":path}", "}") for route in ROUTES} & document()["paths"].keys()
    assert len(paths) > 10
    for path in paths:
        for said in document()["paths"][path].values():
            named = {parameter["name"] for parameter in said.get("parameters", ()) if parameter["in"] == "path"}
            assert named == {part.strip("{}") for part in path.split("/") if part.startswith("{")}, path


COMMAND = {"do": "go_to", "floor": "L2"}
CLOSE = {"do": "close_door", "clear": True}
BODIES: list[tuple[type[BaseModel], Json]] = [
    *((CommandRequest, body) for body in (COMMAND, COMMAND | {"hold_door": False}, CLOSE, CLOSE | {"door": "front"})),
    *((CommandRequest, {"do": do}) for do in CommandType),
    *((CommandRequest, {"do": do, "floor": "L2"}) for do in CommandType),
    *((CommandRequest, {"do": do, "clear": True}) for do in CommandType),
    *(
        (CommandRequest, COMMAND | more)
        for more in ({"clear": True}, {"door": "front"}, {"clear": None}, {"floor": None})
    ),
    *((CommandRequest, CLOSE | more) for more in ({"floor": "L2"}, {"clear": False}, {"clear": None}, {"door": None})),
    *(
        (AcknowledgeRequest, {"by": by})
        for by in ("M. Weber", " M. Weber ", "عل\u200cر", "", " ", "a\nb", "a\x7f", "x" * 65)
    ),
    *((OpenSessionRequest, {"idempotency_key": key}) for key in ("3f1c9a", "a b", "ü", "", None, "x" * 129)),
    *((RmfEndedRequest, {"session_id": said, "grace_s": 1}) for said in ("fleet/amr-7", " ", "", "a\nb", "x" * 257)),
]


@each_row(("form", "body"), BODIES)
def test_the_schema_of_a_body_takes_what_the_manager_takes_and_nothing_else(form: type[BaseModel], body: Json) -> None:
    try:
        form.model_validate(body)
    except ValidationError:
        taken = False
    else:
        taken = True
    assert jsonschema.Draft202012Validator(form.model_json_schema()).is_valid(body) is taken


WISH = {"lift": "lift", "from": "L1", "to": "L2"}
OPENED, BEGUN = "/api/v1/lifts/{lift}/sessions", "/api/v1/rides"


@each_row("keys", [None, ring(Role.OPERATOR)])
@each_row("more", [{}, {"robot": "amr-7"}, {"robot": None}, {"idempotency_key": None}])
@each_row(
    ("path", "body"),
    [
        (OPENED, {}),
        (OPENED, {"idempotency_key": "k1"}),
        (BEGUN, WISH),
        (BEGUN, WISH | {"idempotency_key": "k1"}),
        (BEGUN, WISH | {"idempotency_key": "k1", "dry_run": False}),
        (BEGUN, WISH | {"idempotency_key": "k1", "dry_run": True}),
    ],
)
def test_the_schema_needs_a_robot_beside_an_idempotency_key_exactly_where_the_manager_does(
    path: str, body: Json, more: Json, keys: KeyRing | None
) -> None:
    site, bears = FakeSite(), {} if keys is None else bearing(Role.OPERATOR)
    wish = body | more
    answer = ask(site, "POST", path.format(lift="lift"), keys=keys, headers=bears, json=wish)
    said = document(keys)
    schema = said["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"]
    schema = {**schema, "components": said["components"]}
    assert jsonschema.Draft202012Validator(schema).is_valid(wish) is (answer.status_code != 422)


def test_the_document_follows_the_first_key_that_a_site_makes() -> None:
    keys = Switch()
    assert "if" in schema_of_rides(keys)
    keys.are_required = True
    assert "if" not in schema_of_rides(keys)
    keys.are_required = False
    assert "if" in schema_of_rides(keys)


class Switch(KeyRing):
    """Keys that come and go."""

    are_required = False


def schema_of_rides(keys: Keys) -> Json:
    said = ask(FakeSite(), "GET", "/openapi.json", keys=keys).json()["paths"][BEGUN]["post"]
    found: Json = said["requestBody"]["content"]["application/json"]["schema"]
    return found


def test_every_reference_leads_somewhere() -> None:
    for name in set(references(document())):
        part: Any = document()
        for key in name.removeprefix("#/").split("/"):
            part = part[key]
        assert part


@pytest.mark.parametrize("path", ["commands", "commands/{command}"])
def test_the_wait_is_documented_with_its_bounds(path: str) -> None:
    said = operation("post" if path == "commands" else "get", f"/api/v1/lifts/{{lift}}/sessions/{{session}}/{path}")
    (wait,) = (one for one in said["parameters"] if one["name"] == "wait")
    assert (wait["in"], wait["schema"]["minimum"], wait["schema"]["maximum"]) == ("query", 0, 30)


def test_the_bodies_that_may_be_left_out_are_said_to_be() -> None:
    for method, path in API:
        body = operation(method, path).get("requestBody")
        if body is not None:
            needs = schema_in(body["content"]["application/json"]).get("required", [])
            assert body.get("required", False) is bool(needs), path


def test_lifts_document_the_etag_of_both_answers() -> None:
    for route in ROUTES:
        if route.path.startswith("/api/v1/lifts") and route.need is AccessLevel.READ:
            said = operation("get", route.path.replace(":path}", "}"))
            for status in ("200", "304"):
                assert {"ETag", "Cache-Control", "lift-age-s"} <= said["responses"][status]["headers"].keys()
            assert "If-None-Match" in {parameter["name"] for parameter in said["parameters"]}


def test_the_first_example_of_a_body_can_be_sent_again_and_again() -> None:
    for method, path in API:
        body = operation(method, path).get("requestBody", {}).get("content", {}).get("application/json", {})
        first: Json = next(iter(body.get("examples", {}).values()), {"value": {}})
        assert "idempotency_key" not in first["value"], path


@pytest.mark.parametrize("name", ["goods", "B-2_goods.1"])
def test_what_a_request_names_in_the_examples_is_a_lift_of_the_site(name: str) -> None:
    site = FakeSite({name: replace(IDLE, lift=name), "other": replace(IDLE, lift="other")})
    paths = ask(site, "GET", "/openapi.json").json()["paths"]
    named = set()
    for method, path in API:
        said = paths[path][method]
        of_path = [
            one["example"] for one in said.get("parameters", ()) if one["in"] == "path" and one["name"] == "lift"
        ]
        assert of_path == [name] * ("{lift}" in path), path
        body = said.get("requestBody", {}).get("content", {}).get("application/json", {})
        named |= {example["value"].get("lift") for example in body.get("examples", {}).values()}
    assert named == {None, ANY, name}
