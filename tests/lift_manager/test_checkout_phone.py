"""The page on which a second person confirms results from a phone: for one phone, and for nothing else."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import pytest
import segno
import typer

from lift_manager.cli.checkout_phone import LONGEST_NAME, MOST_REQUESTS, QUIET_ZONE, PhonePage, code_lines, open_socket
from lift_manager.commissioning.checkout.engine import Checkout
from lift_manager.commissioning.checkout.record import Outcome, Record, RecordUnusable
from tests.lift_manager.commissioning.checkout.records import ANA, SAT
from tests.support.checkout_rig import Rig, TruthfulPerson, site_of
from tests.support.rows import each_row

ITEMS = [item for item in SAT.items if item.id in SAT.newest and SAT.newest[item.id].outcome is Outcome.PASSED]
START = SAT.model_copy(update={"results": (), "signatures": ()})


class Bench:
    """A test that has come so far, and its page."""

    def __init__(self, folder: Path) -> None:
        rig = Rig(site_of(folder))
        self.saved: list[Record] = []
        self.reports: list[str] = []
        self.is_disk_full = False
        self.test = Checkout(START, self._save, TruthfulPerson(rig), rig, rig.codec, ["plc"])
        self.page = PhonePage(self.test, self.reports.append)

    def _save(self, record: Record) -> None:
        if self.is_disk_full:
            raise RecordUnusable("the disk is full")
        self.saved.append(record)

    def has_done(self, count: int) -> None:
        """Let the first items have their results, and the next one be under test."""
        results = tuple(SAT.newest[item.id] for item in ITEMS[:count])
        self.test.record = self.test.record.model_copy(update={"results": results})
        self.test.item = ITEMS[count]

    def phone(self) -> httpx.AsyncClient:
        """Return a phone with cookies of its own."""
        return httpx.AsyncClient(transport=httpx.ASGITransport(self.page.app), base_url="http://192.0.2.7:8080")

    async def send(self, phone: httpx.AsyncClient, **form: str) -> httpx.Response:
        """Send a form of the page."""
        return await phone.post(f"{self.page.path}/seen", data=form)

    async def joined(self, name: str = "Cy") -> httpx.AsyncClient:
        """Return a phone that has opened the page and given a name."""
        phone = self.phone()
        await phone.get(self.page.path)
        await self.send(phone, name=name)
        return phone


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def run(work: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        await work()

    asyncio.run(main())


def said(reply: httpx.Response) -> str:
    """Return the text of a page."""
    body = reply.text.partition("</style>")[2]
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", body)).strip()


def test_a_person_gives_a_name_sees_what_is_done_and_confirms_it_once(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined()
        assert "Nothing waits for you yet." in said(await phone.get(bench.page.path))
        bench.has_done(1)
        page = await phone.get(bench.page.path)
        first, second = ITEMS[0], ITEMS[1]
        assert f"Done: {first.id} {first.title} {first.id}: pass" in said(page)
        assert f"Now: {second.id} {second.title} {second.action} Expected: {second.expected}" in said(page)
        assert re.findall("<(button|input|a)[ >]", page.text) == ["input", "button"]
        number = re.search(r'name="number" value="(\d+)"', page.text)
        assert number is not None
        done = await bench.send(phone, number=number[1])
        assert (done.status_code, said(done).startswith("Checkout of bed-lift S-01 is confirmed.")) == (200, True)
        assert "Confirmed by Cy." in said(done)
        assert "<button>" not in done.text
        again = await bench.send(phone, number=number[1])
        assert (again.status_code, "S-01 is confirmed already." in said(again)) == (409, True)

    run(work)
    (record,) = bench.saved
    assert [(one.item, one.name, one.by) for one in record.confirmations] == [("S-01", "Cy", "phone")]
    assert bench.reports[1:] == ["phone: Cy takes part", "S-01: Cy saw it, by phone"]


def test_a_button_of_an_item_that_is_no_longer_shown_confirms_nothing(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined()
        bench.has_done(1)
        await phone.get(bench.page.path)
        bench.has_done(2)
        stale = await bench.send(phone, number="1")
        assert stale.status_code == 409
        assert "Another item was done meanwhile, so this was not recorded. Look at what is shown now." in said(stale)
        assert f"Done: {ITEMS[1].id}" in said(stale)

    run(work)
    assert bench.saved == []


def test_the_page_belongs_to_the_first_phone_until_there_is_a_new_code(bench: Bench) -> None:
    async def work() -> None:
        first, second = bench.phone(), bench.phone()
        assert (await second.post(f"{bench.page.path}/seen", data={"name": "Eve"})).status_code == 403
        assert (await first.get(bench.page.path)).status_code == 200
        refused = await second.get(bench.page.path)
        assert refused.status_code == 403
        assert "Another phone has opened this page" in said(refused)
        assert (await second.post(f"{bench.page.path}/seen", data={"name": "Eve"})).status_code == 403
        assert (await first.get(bench.page.path)).status_code == 200
        before = bench.page.path
        bench.page.renew()
        assert (await first.get(before)).status_code == 404
        assert (await second.get(bench.page.path)).status_code == 200
        assert (await first.get(bench.page.path)).status_code == 403

    run(work)
    assert [line.partition(";")[0] for line in bench.reports] == ["phone: opened from 127.0.0.1"] * 2


def test_a_wrong_token_opens_nothing_and_binds_nothing(bench: Bench) -> None:
    async def work() -> None:
        stranger, phone = bench.phone(), bench.phone()
        for path in ("/", "/x", bench.page.path[:-1], bench.page.path.upper(), f"{bench.page.path}/", "/docs", "/ä"):
            assert (await stranger.get(path)).status_code in (307, 404), path
        assert (await stranger.post("/x/seen", data={"name": "Eve"})).status_code == 404
        for method in ("PUT", "DELETE", "PATCH", "OPTIONS"):
            assert (await stranger.request(method, bench.page.path)).status_code == 405
        assert (await phone.get(bench.page.path)).status_code == 200

    run(work)
    assert re.fullmatch("/[a-z2-7]{16}", bench.page.path)


def test_a_form_of_another_site_is_refused(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined()
        bench.has_done(1)
        for header in ({"origin": "http://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"}):
            reply = await phone.post(f"{bench.page.path}/seen", data={"number": "1"}, headers=header)
            assert reply.status_code == 403
        own = {"origin": "http://192.0.2.7:8080", "sec-fetch-site": "same-origin"}
        assert (await phone.post(f"{bench.page.path}/seen", data={"number": "1"}, headers=own)).status_code == 200

    run(work)


@each_row(
    "form, status, text",
    [
        ({"name": ""}, 400, "Give your name"),
        ({"name": " \t"}, 400, "Give your name"),
        ({}, 400, "Give your name"),
        ({"number": "1"}, 400, "Give your name"),
        ({"name": ANA.name.upper()}, 409, f"{ANA.name} runs this test: a second person confirms it."),
        ({"name": "x" * 2000}, 413, "That is too long."),
        ({"name": "x" * 70_000}, 413, "the body is too long"),
    ],
)
def test_who_confirms_has_a_name_and_is_another_person(
    form: dict[str, str], status: int, text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    bench = Bench(tmp_path_factory.mktemp("site"))

    async def work() -> None:
        phone = bench.phone()
        await phone.get(bench.page.path)
        reply = await bench.send(phone, **form)
        assert (reply.status_code, text in said(reply)) == (status, True)

    run(work)
    assert bench.page.name == ""


def test_a_name_is_a_short_text_and_never_markup(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined(f"<script>\x1b[2J\n{'y' * LONGEST_NAME}")
        page = await phone.get(bench.page.path)
        assert "<script>" not in page.text
        assert "You are &lt;script&gt; [2J yy" in page.text

    run(work)
    assert len(bench.page.name) == LONGEST_NAME


@each_row("number", ["", "x", "-1", "1.0", "²", "9" * 30, "1&number=2x"])
def test_what_is_no_number_confirms_nothing(number: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    bench = Bench(tmp_path_factory.mktemp("site"))

    async def work() -> None:
        phone = await bench.joined()
        bench.has_done(1)
        assert (await bench.send(phone, number=number)).status_code == 400

    run(work)
    assert bench.saved == []


def test_what_cannot_be_saved_is_not_confirmed_and_both_people_know(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined()
        bench.has_done(1)
        bench.is_disk_full = True
        reply = await bench.send(phone, number="1")
        assert (reply.status_code, "tell the person at the laptop" in said(reply)) == (503, True)
        bench.is_disk_full = False
        assert (await bench.send(phone, number="1")).status_code == 200

    run(work)
    assert "phone: the disk is full" in bench.reports


def test_many_requests_at_once_are_refused(bench: Bench) -> None:
    async def work() -> None:
        phone = bench.phone()
        codes = [(await phone.get("/x")).status_code for _ in range(MOST_REQUESTS + 5)]
        assert codes == [404] * MOST_REQUESTS + [429] * 5

    run(work)


def test_the_page_runs_nothing_and_loads_nothing(bench: Bench) -> None:
    async def work() -> None:
        phone = await bench.joined()
        bench.has_done(1)
        page = await phone.get(bench.page.path)
        policy = page.headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; style-src 'sha256-")
        assert "unsafe" not in policy
        assert page.headers["cache-control"] == "no-store"
        assert "<script" not in page.text
        assert re.findall(r"(?:src|href)=", page.text) == []
        assert f'<meta http-equiv="refresh" content="3;url={bench.page.path}">' in page.text
        cookie = (await Bench.phone(bench).get("/x")).headers.get("set-cookie")
        assert cookie is None

    run(work)


def test_the_code_in_the_terminal_is_that_of_the_address() -> None:
    url = "http://192.168.100.100:54321/abcdefghijklmnop"
    found = code_lines(url)
    assert {len(line) for line in found} == {len(found[0])}
    assert len(found[0]) <= 45
    assert len(found) <= 22
    upper = {" ": (0, 0), "▀": (1, 0), "▄": (0, 1), "█": (1, 1)}
    rows = [[upper[letter][half] for letter in line] for line in found for half in (0, 1)]
    expected = [list(row) for row in segno.make(url, micro=False).matrix_iter(border=QUIET_ZONE)]
    assert rows[: len(expected)] == expected
    assert not any(map(any, rows[len(expected) :]))


@each_row(
    "address, reason",
    [
        ("0.0.0.0", "0.0.0.0 is every address of this computer, and a phone needs one"),
        ("0.0.0.0:8080", "0.0.0.0 is every address of this computer"),
        ("::", ":: is every address of this computer"),
        ("[::]:8080", "[::] is every address of this computer"),
        ("192.0.2.1", "192.0.2.1 is not an address of this computer"),
        ("no such host", "host 'no such host' is not known here"),
        ("127.0.0.1:99999", "port 99999 does not exist"),
    ],
)
def test_an_address_that_no_phone_can_open_is_refused(
    address: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as ended:
        open_socket(address)
    assert ended.value.exit_code == 1
    printed = " ".join(capsys.readouterr().err.split())
    assert printed.startswith(reason)
    assert "give --phone an address of this computer that the phone can reach" in printed
    assert "--host" not in printed


def test_the_port_may_be_chosen() -> None:
    with open_socket("127.0.0.1") as sock:
        host, port = sock.getsockname()
    assert host == "127.0.0.1"
    with open_socket(f"127.0.0.1:{port}") as again:
        assert again.getsockname() == (host, port)
