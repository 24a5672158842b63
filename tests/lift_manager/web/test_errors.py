"""ERRORS.md has every code that the manager and its web face can say, each with its status."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.domain.asking import Refusal
from lift_manager.web import codes
from lift_manager.web.codes import CODES, OWN, REFUSALS
from lift_manager.web.error_table import FILE, error_table
from tests.lift_manager.web.fake import FakeManager, ask

WEB = Path(codes.__file__).parent


def said_in(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Every status and code that is written into a call of `No` or `problem`."""
    for call in ast.walk(tree):
        match call:
            case ast.Call(
                func=ast.Name(id="No" | "problem"),
                args=[ast.Constant(value=int() as status), ast.Constant(value=str() as code), *_],
            ):
                yield status, code
            case ast.Call(
                func=ast.Name(id="No" | "problem"),
                args=[ast.Constant(value=int() as status), ast.Attribute(value=ast.Name(id="Refusal"), attr=name), *_],
            ):
                yield status, Refusal[name]
            case _:
                pass


SAID = sorted({said for file in WEB.rglob("*.py") for said in said_in(ast.parse(file.read_text("utf-8")))})


def test_the_file_is_what_the_code_says() -> None:
    assert FILE.read_text("utf-8") == error_table(), "run `python -m lift_manager.web.error_table`"


def test_every_refusal_is_in_the_file() -> None:
    assert set(REFUSALS) == set(Refusal)
    for code in Refusal:
        assert f"| `{code}` | {REFUSALS[code].status} | " in error_table()


@pytest.mark.parametrize(("status", "code"), SAID)
def test_every_code_of_the_web_face_is_in_the_file_with_the_status_that_it_is_said_with(status: int, code: str) -> None:
    assert CODES[code].status == status
    assert f"| `{code}` | {status} | " in error_table()


def test_no_code_is_in_the_file_that_nobody_says() -> None:
    said = {code for _, code in SAID}
    assert len(said) >= 10
    assert set(OWN) - said == {"http_error"}, "http_error has the status that the web framework chose"
    assert not set(OWN) & {str(code) for code in Refusal}


def test_every_line_helps_in_a_sentence() -> None:
    for code, said in CODES.items():
        assert said.title[0].isupper(), code
        assert said.text[0].isupper() or said.text[0] == "`", code
        assert said.text.endswith("."), code
        assert "|" not in said.text + said.title, code


def test_the_manager_serves_the_file_and_its_docs_lead_there() -> None:
    answer = ask(FakeManager(), "GET", "/errors.md")
    assert (answer.status_code, answer.text) == (200, error_table())
    assert answer.headers["content-type"].startswith("text/markdown")
    assert "](errors.md)" in ask(FakeManager(), "GET", "/openapi.json").json()["info"]["description"]
