"""The page on which a second person confirms results of a checkout from a phone. It can do nothing else."""

from __future__ import annotations

import asyncio
import re
import secrets
import socket
import string
from base64 import b64encode
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from hashlib import sha256
from html import escape
from http import HTTPStatus
from ipaddress import ip_address
from urllib.parse import parse_qs

import segno
from rich.text import Text
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lift_manager.cli.common import fail, out
from lift_manager.commissioning.checkout.engine import Checkout, NotConfirmed
from lift_manager.commissioning.checkout.record import WRITTEN, RecordUnusable
from lift_manager.commissioning.wording import one_line
from lift_manager.web.body import read_body
from lift_manager.web.connections import ConnectionLimits
from lift_manager.web.errors import ListenError, RequestError
from lift_manager.web.origin import is_from_another_site
from lift_manager.web.server import listen, resolved, serve

TOKEN_ALPHABET = string.ascii_lowercase + "234567"
TOKEN_LENGTH = 16
"""80 bits, and short enough to be typed where a camera fails."""
COOKIE = "phone"
CONNECTIONS = 16
"""Chosen: a browser opens six to one host."""
MOST_REQUESTS, WITHIN_S = 30, 10.0
"""Chosen: several times what one phone needs, which asks again every few seconds."""
LONGEST_FORM = 1024
LONGEST_NAME = 60
AGAIN_S, READ_S = 3, 8
"""After how long the page is loaded again: usually, and when it has a sentence to be read."""
QUIET_ZONE = 4
"""Modules around a QR code (ISO/IEC 18004)."""

_CSS = (
    "body{font:1.2rem/1.4 system-ui,sans-serif;margin:0;padding:1rem;max-width:34rem;color:#111;background:#fff}"
    "h1{font-size:1.2rem;margin:0 0 1rem}h2{font-size:1.2rem;margin:0}section{border-top:2px solid #bbb;padding:.8rem 0}"
    "p{margin:.4rem 0;overflow-wrap:anywhere}.small{font-size:1rem;color:#444}.notice{background:#ffe9b0;padding:.6rem}"
    "button,input{font:inherit;width:100%;box-sizing:border-box;padding:.9rem;margin:.6rem 0;border-radius:.5rem}"
    "input{border:2px solid #666}button{border:0;background:#0a5c2b;color:#fff;font-weight:700}"
)
_POLICY = (
    f"default-src 'none'; style-src 'sha256-{b64encode(sha256(_CSS.encode()).digest()).decode()}'; form-action 'self';"
    " base-uri 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    # the address has the token in it; `no-referrer` would also hide the origin of our own forms
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
}


class PhonePage:
    """Shows one phone what is under test and the newest result, and takes its word that its person saw that."""

    def __init__(self, test: Checkout, report: Callable[[str], None]) -> None:
        """`report` receives a line for the person at the laptop."""
        self._test = test
        self._report = report
        self._requests: deque[float] = deque(maxlen=MOST_REQUESTS)
        self.name = ""
        """Who has the phone; empty until that was given."""
        self._cookie = ""
        """The secret of the phone; empty until one opens the page."""
        self.token = ""
        self.renew()
        self.app = Starlette(
            routes=[
                Route("/{token}", self._answer, methods=["GET"]),
                Route("/{token}/seen", self._answer, methods=["POST"]),
            ]
        )

    def renew(self) -> None:
        """Forget the phone, and let another one open the page under a new token."""
        self.token = "".join(secrets.choice(TOKEN_ALPHABET) for _ in range(TOKEN_LENGTH))
        self.name = self._cookie = ""

    @property
    def path(self) -> str:
        """Where the page is."""
        return f"/{self.token}"

    async def _answer(self, request: Request) -> Response:
        if self._is_too_often():
            return _page("Too many requests. Wait a few seconds.", HTTPStatus.TOO_MANY_REQUESTS)
        if not secrets.compare_digest(request.path_params["token"].encode(), self.token.encode()):
            return _page("There is no such page.", HTTPStatus.NOT_FOUND)
        is_own = bool(self._cookie) and secrets.compare_digest(
            request.cookies.get(COOKIE, "").encode(), self._cookie.encode()
        )
        is_read = request.method != "POST"
        if is_read and not self._cookie:
            return self._bind(request)
        if not is_own or is_from_another_site(request):
            text = "Another phone has opened this page, and there can be one only. At the laptop, `phone` shows a new code."
            return _page(text, HTTPStatus.FORBIDDEN)
        if is_read:
            return self._shown()
        try:
            return await self._taken(request)
        except RequestError as error:
            return _page(error.message, error.status)

    def _is_too_often(self) -> bool:
        now = asyncio.get_running_loop().time()
        is_full = len(self._requests) == MOST_REQUESTS
        if is_full and now - self._requests[0] < WITHIN_S:
            return True
        self._requests.append(now)
        return False

    def _bind(self, request: Request) -> Response:
        """Bind the page to the first phone that opens it."""
        self._cookie = secrets.token_urlsafe(16)
        address = request.client.host if request.client is not None else "an unknown address"
        self._report(f"phone: opened from {address}; if that is none of yours, `phone` shows a new code")
        page = self._shown()
        page.set_cookie(COOKIE, self._cookie, path=self.path, httponly=True, samesite="strict")
        return page

    async def _taken(self, request: Request) -> Response:
        """Take a name, or a confirmation."""
        body = await read_body(request)
        if len(body) > LONGEST_FORM:
            return _page("That is too long.", HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        form = {key: values[0] for key, values in parse_qs(body.decode("utf-8", "replace")).items()}
        if not self.name:
            name, runs_it = one_line(form.get("name", ""))[:LONGEST_NAME], self._test.record.people.run_by.name
            if not name:
                return self._shown("Give your name: the record says who saw it.", HTTPStatus.BAD_REQUEST)
            if name.casefold() == runs_it.casefold():
                return self._shown(f"{runs_it} runs this test: a second person confirms it.", HTTPStatus.CONFLICT)
            self.name = name
            self._report(f"phone: {name} takes part")
            return self._shown()
        number = form.get("number", "")
        if not (number.isascii() and number.isdecimal() and len(number) < 10):
            return self._shown("That was not understood. Press the button that is shown.", HTTPStatus.BAD_REQUEST)
        try:
            found = self._test.confirm(int(number), self.name)
        except NotConfirmed as error:
            return self._shown(str(error), HTTPStatus.CONFLICT)
        except RecordUnusable as error:
            self._report(f"phone: {error}")
            return self._shown(
                "It could not be recorded: tell the person at the laptop.", HTTPStatus.SERVICE_UNAVAILABLE
            )
        self._report(f"{found.item}: {found.name} saw it, by phone")
        return self._shown(f"{found.item} is confirmed. Thank you.")

    def _shown(self, notice: str = "", status: HTTPStatus = HTTPStatus.OK) -> Response:
        parts = [f"<h1>Checkout of {escape(self._test.record.lift)}</h1>"]
        if notice:
            parts.append(f'<p class="notice" role="status">{escape(notice)}</p>')
        if not self.name:
            parts.append(
                f'<form method="post" action="{self.path}/seen"><label>Your name<input name="name" required autocomplete="name"'
                f' maxlength="{LONGEST_NAME}"></label><button>Take part</button></form>'
                '<p class="small">You can confirm what you saw, and nothing else. The test continues without you too.</p>'
            )
            return _page("".join(parts), status, is_html=True)
        parts += [*self._result(), *self._under_test(), f'<p class="small">You are {escape(self.name)}.</p>']
        return _page("".join(parts), status, is_html=True, again=f"{READ_S if notice else AGAIN_S};url={self.path}")

    def _result(self) -> list[str]:
        """Return what can be confirmed now."""
        record, result = self._test.record, self._test.confirmable
        if result is None:
            return ["<section><p>Nothing waits for you yet.</p></section>"]
        title = next(item.title for item in record.items if item.id == result.item)
        seen = (line for line in result.evidence if not line.startswith(WRITTEN))
        lines = [f"{result.item}: {result.outcome}{f', {result.note}' if result.note else ''}", *seen]
        shown = "".join(f"<p>{escape(line)}</p>" for line in lines)
        if given := record.confirmations_of(result):
            end = f"<p><b>Confirmed by {escape(given[0].name)}.</b></p>"
        else:
            end = (
                f'<form method="post" action="{self.path}/seen"><input type="hidden" name="number"'
                f' value="{len(record.results)}"><button>I saw it</button></form>'
            )
        return [f"<section><h2>Done: {escape(result.item)} {escape(title)}</h2>{shown}{end}</section>"]

    def _under_test(self) -> list[str]:
        """Return what is done now, in the words of the terminal."""
        item = self._test.item
        if item is None:
            return []
        lines = (item.action, f"Expected: {item.expected}")
        shown = "".join(f"<p>{escape(line)}</p>" for line in lines)
        return [f"<section><h2>Now: {escape(item.id)} {escape(item.title)}</h2>{shown}</section>"]


def _page(text: str, status: int, *, is_html: bool = False, again: str = "") -> Response:
    refresh = f'<meta http-equiv="refresh" content="{again}">' if again else ""
    content = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"{refresh}<title>Checkout</title><style>{_CSS}</style>{text if is_html else f'<p>{escape(text)}</p>'}"
    )
    return Response(content, status, _HEADERS, "text/html")


def open_socket(address: str) -> socket.socket:
    """Listen on HOST or HOST:PORT for a phone, by default on any free port. Prints a sentence and exits with 1 where that fails."""
    host, colon, digits = address.rpartition(":") if re.search(r"[^:]:\d+$|\]:\d+$", address) else (address, "", "")
    cure = (
        "give --phone an address of this computer that the phone can reach, such as 192.168.1.20, or 192.168.1.20:8080"
    )
    try:
        _, (numeric, *_) = resolved(host, 0)
        if ip_address(str(numeric)).is_unspecified:
            raise fail(f"{host} is every address of this computer, and a phone needs one; {cure}")
        return listen(host, int(digits) if colon else 0)
    except ListenError as error:
        problem, _, _ = str(error).partition(";")  # what follows names options of `serve`
        raise fail(f"{problem}; {cure}") from error


def print_code(url: str) -> None:
    """Print where the page is, and at a terminal with colours its QR code: dark on light, as every camera reads it."""
    out.print(f"phone: {url} (for one phone; `phone` shows a new code)", markup=False, highlight=False)
    if not out.is_terminal or out.no_color:
        return
    for line in code_lines(url):
        out.print(Text(line, style="#000000 on #ffffff"))


def code_lines(url: str) -> list[str]:
    """Return the QR code of an address with its quiet zone, two rows of modules in a line; dark ones are drawn."""
    rows = [bytes(row) for row in segno.make(url, micro=False).matrix_iter(border=QUIET_ZONE)]
    rows += [bytes(len(rows[0]))] * (len(rows) % 2)
    halves = {(0, 0): " ", (1, 0): "▀", (0, 1): "▄", (1, 1): "█"}
    return ["".join(halves[pair] for pair in zip(*two, strict=True)) for two in zip(rows[::2], rows[1::2], strict=True)]


@asynccontextmanager
async def serve_page(page: PhonePage, sock: socket.socket, report: Callable[[str], None]) -> AsyncIterator[None]:
    """Serve the page while the context lasts. Whatever becomes of it, the test goes on."""

    def end(running: asyncio.Future[None]) -> None:
        if not running.cancelled() and (error := running.exception()) is not None:
            report(f"phone: its page has ended ({error}); the test goes on without it")

    with sock:
        running = asyncio.ensure_future(serve(page.app, sock, limits=ConnectionLimits.of(CONNECTIONS)))
        running.add_done_callback(end)
        try:
            yield
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
