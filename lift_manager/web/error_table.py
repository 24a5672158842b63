"""The table of error codes, for people: ERRORS.md beside this file, written anew by `python -m lift_manager.web.error_table`."""

from __future__ import annotations

from pathlib import Path

from lift_manager.web.codes import CODES

FILE = Path(__file__).with_name("ERRORS.md")

_HEAD = """# What an answer no says

Written by `python -m lift_manager.web.error_table` from `lift_manager/web/codes.py`; a test compares it. The manager serves it
as `/errors.md`.

Each error of `/api/v1` is problem+json (RFC 9457): `type`, `title`, `status`, `detail` for people, and `code` for programs, which
stays the same from version to version. What stands in the way is told as values too, where it is known: `holder` (`face:name`),
`mode`, `since_s`, `age_s`, `ahead`; and `field` names the key of the body, or of the query, that is wrong.

| code | status | title | what it means, and what helps |
|---|---|---|---|
"""


def error_table() -> str:
    """Return the text of ERRORS.md."""
    order = sorted(CODES.items(), key=lambda entry: (entry[1].status, entry[0]))
    return _HEAD + "".join(f"| `{code}` | {said.status} | {said.title} | {said.text} |\n" for code, said in order)


if __name__ == "__main__":
    FILE.write_text(error_table(), "utf-8")
