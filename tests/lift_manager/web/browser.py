"""A real browser that shows one page, and has no internet."""

import asyncio
import subprocess
from pathlib import Path

from tests.support.devtools import HEADLESS

CHROMIUM = (*HEADLESS, "--enable-logging=stderr", "--virtual-time-budget=10000", "--dump-dom")


async def shown_by_chromium(url: str, profile: Path, *, names: str = "") -> tuple[str, str]:
    """Return the document after its scripts ran, and the log. `names` are rules by which names are resolved; else none is."""
    rules = f"--host-resolver-rules={names}MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
    command = (*CHROMIUM, rules, f"--user-data-dir={profile}", url)
    browser = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    dom, log = await browser.communicate()
    return dom.decode(), log.decode()
