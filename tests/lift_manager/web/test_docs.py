import asyncio
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

from lift_manager.web.app import make_app
from tests.lift_manager.web.browser import shown_by_chromium
from tests.lift_manager.web.fake import BASE, FakeSite, ask, serving

PAGES = ["/docs", "/redoc"]
ABSOLUTE = re.compile(r"https?:|(?<![:\w])//[\w.-]+\.\w")
HOSTS_OF_ASSETS = [
    "cdn.jsdelivr.net",
    "unpkg.com",
    "fonts.googleapis.com",
    "fonts.gstatic.com",
    "cdn.redoc.ly",
    "cdnjs.",
]


class Links(HTMLParser):
    """Everything that a page would fetch or lead to."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for key, value in attrs if key in {"src", "href", "spec-url", "action"} and value]


def fetched(path: str) -> str:
    answer = ask(FakeSite(), "GET", path)
    assert answer.status_code == 200
    return answer.text


def assets_of(page: str) -> Iterator[str]:
    links = Links()
    links.feed(page)
    yield from (link for link in links.found if not link.startswith("data:"))


def strings_in(value: object) -> Iterator[str]:
    match value:
        case str():
            yield value
        case list():
            for inner in value:
                yield from strings_in(inner)
        case dict():
            for key, inner in value.items():
                yield key
                yield from strings_in(inner)
        case _:
            return


@pytest.mark.parametrize("path", PAGES)
def test_a_page_names_no_other_host(path: str) -> None:
    assert ABSOLUTE.findall(fetched(path)) == []


@pytest.mark.parametrize("path", PAGES)
def test_every_asset_of_a_page_comes_from_the_application(path: str) -> None:
    links = list(assets_of(fetched(path)))
    assert links
    for link in links:
        text = fetched(f"/{link}")
        assert len(text) > 1000
        assert [host for host in HOSTS_OF_ASSETS if host in text] == []


@pytest.mark.parametrize("path", PAGES)
def test_the_browser_is_told_to_ask_nobody_else(path: str) -> None:
    policy = ask(FakeSite(), "GET", path).headers["content-security-policy"]
    assert policy.startswith("default-src 'self'; ")
    assert ABSOLUTE.findall(policy) == []


def test_the_style_sheet_loads_nothing_from_elsewhere() -> None:
    loaded = re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')\s]+)", fetched("/docs/swagger-ui.css"))
    assert loaded
    assert [link for link in loaded if not link.startswith("data:")] == []


def test_the_logo_of_redoc_is_where_its_script_looks() -> None:
    script = fetched("/redoc/redoc.standalone.js")
    assert 'window.location.pathname+"/logo-mini.svg"' in script
    assert fetched("/redoc/logo-mini.svg").startswith("<svg")


def test_the_schema_is_not_sent_to_a_validator() -> None:
    assert '"validatorUrl": null' in fetched("/docs")


def test_the_schema_names_no_host_at_all() -> None:
    schema = json.loads(fetched("/openapi.json"))
    assert "servers" not in schema
    assert [text for text in strings_in(schema) if ABSOLUTE.search(text)] == []


def test_the_schema_documents_each_route_with_examples_of_success_and_failure() -> None:
    schema = json.loads(fetched("/openapi.json"))
    workshop = {path: methods for path, methods in schema["paths"].items() if path.startswith(BASE)}
    assert sorted(workshop) == [f"{BASE}/{name}" for name in ("lift_names", "lift_request", "lift_state")]
    for path, methods in workshop.items():
        for method in methods.values():
            answer = method["responses"]["200"]["content"]["application/json"]
            envelopes = [example["value"] for example in answer["examples"].values()]
            assert method["summary"]
            assert method["description"]
            assert all(list(envelope) == ["data", "success", "msg"] for envelope in envelopes)
            assert {envelope["success"] for envelope in envelopes} == ({True} if "names" in path else {True, False})
            assert list(method["responses"]) == ["200", "400", "401", "403", "431", "500"]


def test_the_lifts_of_the_site_can_be_chosen_in_the_docs() -> None:
    schema = json.loads(fetched("/openapi.json"))
    (parameter,) = schema["paths"][f"{BASE}/lift_state"]["get"]["parameters"]
    assert [example["value"] for example in parameter["examples"].values()] == ["lift", "goods"]


def test_the_documented_requests_and_refusals_are_the_real_ones() -> None:
    schema = json.loads(fetched("/openapi.json"))
    route = schema["paths"][f"{BASE}/lift_request"]["post"]
    url = f"{BASE}/lift_request?lift_name="
    for example in route["requestBody"]["content"]["application/json"]["examples"].values():
        assert ask(FakeSite(), "POST", f"{url}lift", json=example["value"]).json()["success"] is True
    documented = route["responses"]["200"]["content"]["application/json"]["examples"]
    wrong_door = ask(FakeSite(), "POST", f"{url}lift", json={"floor": "L2", "door_state": 1})
    assert wrong_door.json() == documented["Wrong door_state"]["value"]
    assert ask(FakeSite(), "POST", f"{url}lift").json() == documented["Wrong body"]["value"]
    assert ask(FakeSite(), "POST", f"{url}elevator").json() == documented["Unknown lift"]["value"]


@pytest.mark.external("chromium")
@pytest.mark.parametrize(("path", "proof"), [("/docs", "opblock-summary-path"), ("/redoc", "menu-content")])
def test_a_real_browser_renders_the_page_without_internet(path: str, proof: str, tmp_path: Path) -> None:
    async def render() -> tuple[str, str]:
        async with serving(make_app(FakeSite())) as port:
            return await shown_by_chromium(f"http://127.0.0.1:{port}{path}", tmp_path)

    dom, log = asyncio.run(render())
    assert proof in dom
    assert "lift_request" in dom
    assert "Call, hold and release a lift" in dom
    assert "Refused to" not in log
    assert "violates the following Content Security Policy" not in log
