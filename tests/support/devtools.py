"""A real browser that is driven through its DevTools, without internet."""

import asyncio
import base64
import itertools
import json
import subprocess
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
from websockets.asyncio.client import ClientConnection, connect

from tests.support.programs import HANGS_S

HEADLESS = (
    "chromium",
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--in-process-gpu",
)
"""A browser that asks nobody by itself, and starts no process that a page does not need."""
CHROMIUM = (*HEADLESS, "--remote-debugging-port=0", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
LOOK_AGAIN_S = 0.05


class Tab:
    """One page of the browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self._replies: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.complaints: list[str] = []
        """What the browser said was wrong: errors of scripts, of the console, of the policy, and requests that led nowhere."""
        self.requested: list[str] = []
        """The address of every request."""

    async def listen(self) -> None:
        """Take what the browser sends, until the connection ends."""
        async for message in self._socket:
            self._take(json.loads(message))

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"id": int(number)}:
                self._replies.pop(number).set_result(message)
            case {"method": "Network.requestWillBeSent", "params": {"request": {"url": url}}}:
                self.requested.append(url)
            case {"method": "Runtime.exceptionThrown", "params": {"exceptionDetails": details}}:
                self.complaints.append(str(details.get("exception", details).get("description", details)))
            case {"method": "Log.entryAdded", "params": {"entry": {"level": "error", "text": text} as entry}}:
                self.complaints.append(f"{text} {entry.get('url', '')}")
            case _:
                return

    async def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Send one command of the DevTools protocol; returns its result."""
        number = next(self._numbers)
        reply = self._replies[number] = asyncio.get_running_loop().create_future()
        await self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        async with asyncio.timeout(HANGS_S):
            answer = await reply
        assert "error" not in answer, (method, answer["error"])
        result: dict[str, Any] = answer["result"]
        return result

    async def open(self, url: str) -> None:
        """Go to an address."""
        await self.send("Page.navigate", url=url)

    async def value(self, expression: str) -> Any:
        """Return the value of an expression in the page; a promise is awaited."""
        answer = await self.send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    async def until(self, expression: str) -> None:
        """Wait until an expression is true."""
        try:
            async with asyncio.timeout(HANGS_S):
                while not (  # noqa: ASYNC110  it is the browser's state
                    await self.value(f"(() => {{ try {{ return Boolean({expression}) }} catch {{ return false }} }})()")
                ):
                    await asyncio.sleep(LOOK_AGAIN_S)
        except TimeoutError:
            shown = await self.value("document.body.innerText")
            raise AssertionError(f"never true: {expression}\n{shown}\n{self.complaints}") from None

    async def sees(self, text: str) -> None:
        """Wait until a text can be read on the page."""
        await self.until(f"document.body.innerText.includes({json.dumps(text)})")

    async def press(self, *keys: str) -> None:
        """Press keys one after the other, as on a keyboard."""
        for key in keys:
            text = {"Enter": "\r", " ": " "}.get(key, key if len(key) == 1 else "")
            code = {"Tab": 9, "Enter": 13, "Escape": 27, " ": 32}.get(key, 0)
            down: dict[str, Any] = {"type": "keyDown", "text": text} if text else {"type": "rawKeyDown"}
            for event in (down, {"type": "keyUp"}):
                await self.send("Input.dispatchKeyEvent", key=key, code=key, windowsVirtualKeyCode=code, **event)

    async def type(self, text: str) -> None:
        """Type a text into the field that has the focus."""
        await self.send("Input.insertText", text=text)

    async def look(self, *, width: int = 1280, height: int = 800, **features: str) -> None:
        """Set the size of the window, and media features such as `prefers_color_scheme="dark"`."""
        await self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )
        media = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        await self.send("Emulation.setEmulatedMedia", features=media)

    async def picture(self) -> bytes:
        """Return what the window shows, as PNG."""
        answer = await self.send("Page.captureScreenshot", format="png")
        return base64.b64decode(answer["data"])


@asynccontextmanager
async def chromium(
    profile: Path, *, options: Sequence[str] = (), env: Mapping[str, str] | None = None
) -> AsyncIterator[Tab]:
    """A browser with one empty page; `profile` is a folder of its own."""
    command = (*CHROMIUM, *options, f"--user-data-dir={profile}", "about:blank")
    browser = await asyncio.create_subprocess_exec(
        *command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env
    )
    try:
        # no pings: a browser that is slow to answer is not gone
        connection = connect(await _address(profile), max_size=None, open_timeout=HANGS_S, ping_interval=None)
        async with connection as socket, asyncio.TaskGroup() as tasks:
            tab = Tab(socket)
            listening = tasks.create_task(tab.listen())
            for domain in ("Page", "Runtime", "Log", "Network"):
                await tab.send(f"{domain}.enable")
            yield tab
            listening.cancel()
    finally:
        browser.terminate()
        await browser.wait()


async def _address(profile: Path) -> str:
    """Wait for the browser; returns the address of its first page."""
    file = profile / "DevToolsActivePort"
    async with asyncio.timeout(HANGS_S):
        while not (file.exists() and "\n" in file.read_text()):  # noqa: ASYNC110  it is another program's file
            await asyncio.sleep(LOOK_AGAIN_S)
        port = file.read_text().split("\n")[0]
        async with httpx.AsyncClient(trust_env=False, timeout=HANGS_S) as client:
            while True:
                targets = (await client.get(f"http://127.0.0.1:{port}/json")).json()
                if pages := [target for target in targets if target["type"] == "page"]:
                    return str(pages[0]["webSocketDebuggerUrl"])
                await asyncio.sleep(LOOK_AGAIN_S)
