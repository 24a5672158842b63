"""Generates ERRORS.md, the table of error codes: `python -m lift_manager.web.errors_page`; and the page `/errors`."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

from lift_manager.web.error_codes import CODES

FILE = Path(__file__).with_name("ERRORS.md")

_HEAD = """# Error codes

Written by `python -m lift_manager.web.errors_page` from `lift_manager/web/error_codes.py`; a test compares it. The manager serves it
as `/errors.md`, and as a page at `/errors`.

Each error of `/api/v1` is problem+json (RFC 9457): `type`, `title`, `status`, `detail` for people, and `code` for programs, which
stays the same from version to version. `type` is a URN of the code, the same for every manager; this table is where to look it up.
Where it is known, the obstacle is given as values as well: `holder` (`face:name`), `mode`, `since_s`, `age_s`, `ahead`. `field` names the key of the body, or of the query, that is wrong.

| code | status | title | meaning and remedy |
|---|---|---|---|
"""


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Error codes: lift manager</title>
<link rel="icon" href="page/icon.svg" type="image/svg+xml">
<link rel="stylesheet" href="page/style.css">
</head>
<body class="errors">
<header class="top"><h1>Error codes</h1><nav aria-label="Pages"><a href="./">Lifts</a> <a href="docs">API</a></nav></header>
<main>
<p>Each refusal of <code>/api/v1</code> has one of these codes, which stay the same from version to version. Its <code>detail</code> says
what is wrong with that request.</p>
<div class="scroll" tabindex="0" role="region" aria-label="All codes"><table>
<thead><tr><th scope="col">Code</th><th scope="col">Status</th><th scope="col">What it means</th><th scope="col">Why, and what to do</th></tr></thead>
<tbody>
{rows}</tbody></table></div>
</main>
</body>
</html>
"""
_CODE = re.compile("`([^`]+)`")

_order = sorted(CODES.items(), key=lambda entry: (entry[1].status, entry[0]))


def error_table() -> str:
    """Return the text of ERRORS.md."""
    return _HEAD + "".join(
        f"| `{code}` | {entry_code.status} | {entry_code.title} | {entry_code.text} |\n" for code, entry_code in _order
    )


def error_document() -> str:
    """Return the page `/errors`, with an anchor for each code."""
    rows = (
        f'<tr id="{code}"><th scope="row"><a href="#{code}"><code>{code}</code></a></th><td>{entry_code.status}</td>'
        f"<td>{_marked_up(entry_code.title)}</td><td>{_marked_up(entry_code.text)}</td></tr>\n"
        for code, entry_code in _order
    )
    return _PAGE.replace("{rows}", "".join(rows))


def _marked_up(text: str) -> str:
    return _CODE.sub(r"<code>\1</code>", escape(text, quote=False))


if __name__ == "__main__":
    FILE.write_text(error_table(), "utf-8")
