"""What people at a browser need of a hub: the newest events of a site, a login, and to be refused what is not theirs."""

import asyncio
from pathlib import Path

import httpx

from lift_manager.api.keys import KeyRing
from lift_manager.api.roles import Role
from lift_manager.hub.web import make_hub_app
from tests.lift_manager.hub.fake import fake_hub
from tests.lift_manager.web.fake import ask_app
from tests.lift_manager.web.keyed import bearing, ring

HERE = "http://127.0.0.1:5080"
OFF = {"by": "M. Weber", "reason": "its key was copied"}


def test_the_newest_events_of_a_site_come_first_and_without_what_is_for_programs(tmp_path: Path) -> None:
    with fake_hub(tmp_path, "berlin", "rome") as hub:
        hub.write("berlin", "one", "two")
        hub.note("berlin", {"event": "update", "number": 7, "progress": "on trial", "text": "", "at": 5})
        hub.write("rome", "elsewhere")
        app = make_hub_app(hub, KeyRing())
        update, two = ask_app(app, "GET", "/api/v1/sites/berlin/events?most=2").json()["events"]
        assert (update["event"], update["update"], update["progress"], update["at"]) == ("update", 7, "on trial", 5)
        assert (two["event"], two["text"], two["lift"], two["kind"]) == ("row", "two", "goods", "person")
        assert two["number"] < update["number"]
        assert not {"data", "hash"} & two.keys()
        assert len(ask_app(app, "GET", "/api/v1/sites/berlin/events").json()["events"]) == 3
        for path, code in (("berlin/events?most=0", "malformed"), ("paris/events", "unknown_site")):
            assert ask_app(app, "GET", f"/api/v1/sites/{path}").json()["code"] == code


def test_a_gap_has_no_time_and_says_what_is_missing(tmp_path: Path) -> None:
    with fake_hub(tmp_path, "berlin") as hub:
        hub.write("berlin", "nine", first=9)
        row, gap = ask_app(make_hub_app(hub, KeyRing()), "GET", "/api/v1/sites/berlin/events").json()["events"]
        assert (row["event"], row["text"]) == ("row", "nine")
        assert (gap["event"], gap["first"], gap["last"], gap["at"]) == ("gap", 1, 8, None)


def test_a_browser_logs_in_at_a_hub_and_acts_as_its_key_with_the_token_of_its_login(tmp_path: Path) -> None:
    async def main() -> None:
        with fake_hub(tmp_path, "berlin") as hub:
            app = make_hub_app(hub, ring(Role.OPERATOR, open_without_keys=False))
            marks = {"origin": HERE, "sec-fetch-site": "same-origin"}
            async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=HERE, headers=marks) as browser:
                login = await browser.post("/api/v1/login", headers=bearing(Role.OPERATOR))
                assert (await browser.get("/api/v1/sites")).status_code == 200
                path, token = "/api/v1/sites/berlin/off", {"x-csrf-token": login.json()["csrf"]}
                assert (await browser.post(path, json=OFF)).json()["code"] == "csrf_token"
                foreign = {**token, "origin": "http://a.b", "sec-fetch-site": "cross-site"}
                assert (await browser.post(path, json=OFF, headers=foreign)).json()["code"] == "another_site"
                switched = await browser.post(path, json=OFF, headers=token)
                assert switched.json()["off"]["by"] == "M. Weber (key the operator)"
                await browser.post("/api/v1/logout", headers=token)
                assert (await browser.get("/api/v1/sites")).status_code == 401
                scraped = await browser.get("/metrics", headers=bearing(Role.OPERATOR))
                for code in ("csrf_token", "another_site", "key_needed"):
                    assert f'lift_manager_hub_refusals_total{{code="{code}"}} 1\n' in scraped.text

    asyncio.run(main())


def test_a_hub_without_keys_counts_whom_it_refuses_because_nobody_knows_who_it_is(tmp_path: Path) -> None:
    async def main() -> None:
        with fake_hub(tmp_path, "berlin") as hub:
            app = make_hub_app(hub, KeyRing())
            elsewhere = httpx.ASGITransport(app, client=("192.0.2.7", 1))
            async with httpx.AsyncClient(transport=elsewhere, base_url=HERE) as program:
                refused = await program.post("/api/v1/sites/berlin/off", json=OFF)
                assert refused.json()["code"] == "other_computer"
                scraped = await program.get("/metrics")
                assert 'lift_manager_hub_refusals_total{code="other_computer"} 1\n' in scraped.text

    asyncio.run(main())
