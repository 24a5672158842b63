"""The Markdown pages of the repository, and what is in them: blocks, commands, links, anchors."""

import re
from functools import cache
from pathlib import Path

from tests.support.programs import ROOT

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_NOT_RUN = re.compile(r"^<!-- not-run: ([^\n]+) -->\n```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
_BUILT = {ROOT / "deploy" / "ros" / name for name in ("build", "install", "log")}


@cache
def pages() -> tuple[Path, ...]:
    """Return every page, without what a checkout gathers: environments, caches, builds."""
    tops = [path for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith(".")]
    found = [*ROOT.glob("*.md"), *(page for top in tops for page in top.rglob("*.md"))]
    return tuple(sorted(page for page in found if _BUILT.isdisjoint(page.parents)))


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return [text for name, text in _FENCED.findall(page.read_text("utf-8")) if name == language]


def commands(page: Path, start: str = "") -> list[str]:
    """Return the lines of the shell blocks that begin so, with their comments."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines() if line]
    return [line for line in lines if line.startswith(start)]


def not_run(page: Path) -> dict[str, str]:
    """Return the commands of the shell blocks that a comment in front of them keeps from being run, and why."""
    marked = _NOT_RUN.findall(page.read_text("utf-8"))
    return {line: why for why, block in marked for line in block.splitlines() if line}


def prose(page: Path) -> str:
    """Return a page without its fenced blocks."""
    return _FENCED.sub("", page.read_text("utf-8"))


def inline_code(page: Path) -> list[str]:
    """Return what stands between single backticks."""
    return re.findall(r"(?<!`)`([^`]+)`(?!`)", prose(page))


def links(page: Path) -> list[str]:
    """Return the targets of its links that lead into the repository."""
    text = re.sub(r"`[^`\n]*`", "code", prose(page))
    return [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"[a-z]+:", target)]


@cache
def anchors(page: Path) -> frozenset[str]:
    """Return what a link to a heading may name, as code hosts make it of the heading."""
    found: dict[str, int] = {}
    names = set()
    for heading in re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        name = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
        number = found.get(name, 0)
        found[name] = number + 1
        names.add(f"{name}-{number}" if number else name)
    return frozenset(names)
