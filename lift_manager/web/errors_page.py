"""Generates ERRORS.md, the table of error codes: `python -m lift_manager.web.errors_page`."""

from __future__ import annotations

from pathlib import Path

from lift_manager.web.error_codes import CODES

FILE = Path(__file__).with_name("ERRORS.md")

_HEAD = """# Error codes

Written by `python -m lift_manager.web.errors_page` from `lift_manager/web/error_codes.py`; a test compares it. The manager serves it
as `/errors.md`.

Each error of `/api/v1` is problem+json (RFC 9457): `type`, `title`, `status`, `detail` for people, and `code` for programs, which
stays the same from version to version. Where it is known, the obstacle is given as values as well: `holder` (`face:name`), `mode`,
`since_s`, `age_s`, `ahead`. `field` names the key of the body, or of the query, that is wrong.

| code | status | title | meaning and remedy |
|---|---|---|---|
"""


def error_table() -> str:
    """Return the text of ERRORS.md."""
    order = sorted(CODES.items(), key=lambda entry: (entry[1].status, entry[0]))
    return _HEAD + "".join(
        f"| `{code}` | {entry_code.status} | {entry_code.title} | {entry_code.text} |\n" for code, entry_code in order
    )


if __name__ == "__main__":
    FILE.write_text(error_table(), "utf-8")
