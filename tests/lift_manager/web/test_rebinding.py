"""A web page whose name was made to lead to the manager after it was loaded gets nothing: a site without keys is not known by any name."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from lift_manager.api.roles import Role
from lift_manager.web.app import make_app
from tests.lift_manager.web.browser import shown_by_chromium
from tests.lift_manager.web.changes import refused
from tests.lift_manager.web.fake import ACCEPTED, CALL, NAME, REQUEST, STATE, FakeSite, ask, connected, serving
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row

REBOUND = {"host": "evil.example:5003", "origin": "http://evil.example:5003"}
"""Of one site, as far as the browser can tell."""
ASKED = [
    ("GET", "/api/v1/lifts"),
    ("GET", "/api/v1/lifts/lift"),
    ("GET", "/api/v1/events"),
    ("GET", "/api/v1/links"),
    ("POST", "/api/v1/rides"),
    ("POST", "/api/v1/lifts/lift/sessions"),
    ("POST", "/api/v1/lifts/lift/acknowledge"),
]
BY_BROWSER: list[Mapping[str, str]] = [
    {},  # a GET of its own site over plain HTTP
    {"origin": "http://evil.example:5003"},
    {"sec-fetch-site": "same-origin"},
    {"sec-fetch-site": "none", "sec-fetch-user": "?1"},
    {"Sec-Fetch-Mode": "cors"},
]
OWN = ["127.0.0.1:5003", "localhost:5003", "localhost", "192.0.2.7", "[::1]:5003", "[2001:db8::7]"]


@each_row(("method", "path"), ASKED)
@each_row("marks", BY_BROWSER)
def test_without_keys_a_request_that_names_an_unknown_host_is_told_which_are_known(
    method: str, path: str, marks: Mapping[str, str]
) -> None:
    site = FakeSite()
    said = refused(ask(site, method, path, headers={"host": "evil.example:5003", **marks}), 403, "another_site")
    assert "not known to be the manager" in said
    assert "localhost" in said
    assert "host_names" in said
    assert "lift-manager keys make" in said
    assert site.changes == []
    assert [away.code for away in site.away] == ["another_site"]


def test_the_workshop_takes_no_call_from_it_either() -> None:
    site = FakeSite()
    answer = ask(site, "POST", REQUEST, headers=REBOUND, content=CALL)
    assert (answer.status_code, answer.json()["success"]) == (403, False)
    assert "not known to be the manager" in answer.json()["msg"]
    assert site.changes == []


@each_row("host", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "127.0.0.1x", "", "[::1"])
def test_what_only_looks_like_an_address_is_none(host: str) -> None:
    site = FakeSite()
    answer = ask(site, "GET", "/api/v1/lifts", headers={"host": host, "sec-fetch-site": "same-origin"})
    refused(answer, 403, "another_site")


@each_row("host", OWN)
def test_a_browser_that_asks_by_address_is_served(host: str) -> None:
    site = FakeSite()
    headers = {"host": host, "origin": f"http://{host}", "sec-fetch-site": "same-origin"}
    assert ask(site, "GET", "/api/v1/lifts", headers=headers).status_code == 200
    assert ask(site, "POST", "/api/v1/lifts/lift/sessions", headers=headers).status_code == 201
    assert ask(site, "POST", REQUEST, headers=headers, content=CALL).content == ACCEPTED


@each_row("path", ["/", "/docs", "/openapi.json", "/healthz", "/metrics", f"{STATE}?lift_name=lift", "/x"])
@each_row("method", ["GET", "HEAD", "OPTIONS", "DELETE"])
def test_nothing_at_all_is_served_by_an_unknown_name(method: str, path: str) -> None:
    assert ask(FakeSite(), method, path, headers=REBOUND).status_code == 403


@each_row("host", [NAME, NAME.upper(), f"{NAME}:5003"])
def test_a_name_that_the_site_file_lists_is_known(host: str) -> None:
    site = FakeSite()
    assert ask(site, "GET", "/api/v1/lifts", headers={"host": host}).status_code == 200
    assert ask(site, "POST", REQUEST, headers={"host": host}, content=CALL).content == ACCEPTED


def test_where_there_are_keys_a_browser_asks_by_any_name_with_one() -> None:
    site, keys = FakeSite(), ring(Role.OPERATOR)
    headers = {**REBOUND, **bearing(Role.OPERATOR)}
    assert ask(site, "GET", "/api/v1/lifts", keys=keys, headers=headers).status_code == 200
    assert ask(site, "POST", REQUEST, keys=keys, headers=headers, content=CALL).content == ACCEPTED


PAGE = b"""<!DOCTYPE html><title>a page of somebody else</title><pre></pre><script>
fetch("/api/v1/lifts").then(a => a.text()).then(text => { document.querySelector("pre").textContent = text })
</script>"""


@asynccontextmanager
async def rebound(manager: int) -> AsyncIterator[int]:
    """A port that shows a page of somebody else, and leads to the manager for all that is requested after it."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            if head.startswith(b"GET / "):
                length = f"Content-Length: {len(PAGE)}\r\n".encode()
                writer.write(
                    b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nConnection: close\r\n" + length + b"\r\n" + PAGE
                )
            else:
                async with connected(manager) as (answers, requests):
                    requests.write(head.replace(b"keep-alive", b"close"))
                    writer.write(await answers.read())
            await writer.drain()
        except (ConnectionError, asyncio.IncompleteReadError):
            return  # a connection that the browser opened in advance
        finally:
            writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        yield server.sockets[0].getsockname()[1]


@pytest.mark.external("chromium")
@pytest.mark.parametrize(("host", "said"), [("127.0.0.1", "robot_door"), ("evil.example", "another_site")])
def test_a_page_in_a_real_browser_whose_name_now_leads_here_reads_no_lift(host: str, said: str, tmp_path: Path) -> None:
    async def render() -> str:
        async with serving(make_app(FakeSite())) as manager, rebound(manager) as port:
            names = "MAP evil.example 127.0.0.1, "
            dom, _ = await shown_by_chromium(f"http://{host}:{port}/", tmp_path, names=names)
            return dom

    dom = asyncio.run(render())
    assert "a page of somebody else" in dom
    assert said in dom
    assert ("robot_door" in dom) is (host == "127.0.0.1")
