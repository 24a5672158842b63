"""GET /metrics: who may read it, and in which format."""

import asyncio

import httpx
import pytest

from lift_manager.api.roles import Role
from lift_manager.web.app import make_app
from tests.lift_manager.web.fake import FakeSite, ask_app
from tests.lift_manager.web.keyed import bearing, ring


async def scrape(accept: str) -> tuple[bytes, str]:
    await asyncio.sleep(0)
    return f"asked for {accept}".encode(), "text/plain; version=0.0.4; charset=utf-8"


@pytest.mark.parametrize("role", list(Role))
def test_any_key_reads_it_as_prometheus_sends_it(role: Role) -> None:
    app = make_app(FakeSite(), ring(*Role), metrics=scrape)
    answer = ask_app(app, "GET", "/metrics", headers={**bearing(role), "Accept": "text/plain"})
    assert (answer.status_code, answer.text) == (200, "asked for text/plain")
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    assert answer.headers["cache-control"] == "no-store"


def test_without_a_key_it_is_refused_where_keys_are_needed() -> None:
    app = make_app(FakeSite(), ring(*Role), metrics=scrape)
    answer = ask_app(app, "GET", "/metrics")
    assert answer.status_code == 401
    assert "a key is needed" in answer.json()["detail"]


def test_where_nothing_is_measured_there_is_nothing() -> None:
    answer: httpx.Response = ask_app(make_app(FakeSite()), "GET", "/metrics")
    assert answer.status_code == 404
