"""ERRORS.md has every code that the manager and its web face can say, each with its status."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

from lift_manager.lift.refusals import Refusal
from lift_manager.web import error_codes
from lift_manager.web.error_codes import CODES, REFUSAL_CODES, WEB_CODES
from lift_manager.web.errors_page import FILE, error_table
from tests.lift_manager.web.fake import FakeSite, ask

WEB = Path(error_codes.__file__).parent


def raised_in(tree: ast.Module) -> Iterator[str]:
    """Every code that is written into a call of `RequestError`."""
    for call in ast.walk(tree):
        match call:
            case ast.Call(func=ast.Name(id="RequestError"), args=[ast.Constant(value=str() as code), *_]):
                yield code
            case _:
                pass


def test_the_file_is_what_the_code_says() -> None:
    assert FILE.read_text("utf-8") == error_table(), "run `python -m lift_manager.web.errors_page`"


def test_every_refusal_has_a_code_and_no_code_is_there_that_nobody_says() -> None:
    assert set(REFUSAL_CODES) == set(Refusal)
    raised = {code for file in WEB.rglob("*.py") for code in raised_in(ast.parse(file.read_text("utf-8")))}
    assert CODES.keys() >= raised
    assert set(WEB_CODES) <= raised
    assert not set(WEB_CODES) & {str(code) for code in Refusal}


def test_every_line_helps_in_a_sentence() -> None:
    for code, said in CODES.items():
        assert said.title[0].isupper(), code
        assert said.text[0].isupper() or said.text[0] == "`", code
        assert said.text.endswith("."), code
        assert "|" not in said.text + said.title, code


def test_the_manager_serves_the_file_and_its_docs_lead_there() -> None:
    answer = ask(FakeSite(), "GET", "/errors.md")
    assert (answer.status_code, answer.text) == (200, error_table())
    assert answer.headers["content-type"].startswith("text/markdown")
    assert "](errors)" in ask(FakeSite(), "GET", "/openapi.json").json()["info"]["description"]


def test_every_code_has_a_place_on_the_page_of_errors_which_runs_no_script() -> None:
    answer = ask(FakeSite(), "GET", "/errors")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
    page = ET.fromstring(re.sub(r"<!doctype html>|<(meta|link)[^>]*>", "", answer.text))
    shown = {row.get("id"): "".join(row.itertext()).replace("`", "") for row in page.findall(".//tbody/tr")}
    assert shown == {
        code: f"{code}{said.status}{said.title}{said.text}".replace("`", "") for code, said in CODES.items()
    }
    assert "<script" not in answer.text
    assert "default-src 'none'" in answer.headers["content-security-policy"]
