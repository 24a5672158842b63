"""Builds the documentation as a site that is read without internet: the same pages, each under its own path."""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
INDEX = Path("docs/README.md")
REFERENCE = "look something up"
ABOUT = ("SECURITY.md", "CHANGELOG.md")
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s#]+)[^)\s]*\)")
"""Text and target. A target with a scheme is none of ours."""
GROUP = re.compile(r"^\| \*\*(.+?)\*\* \|", re.MULTILINE)
SHIM = re.compile(r"https://[^\"']*/iframe-worker/shim")
"""What the search needs where a browser opens the site as files; the generator has it fetched, we bring it along."""
OWN_SHIM = Path("assets/iframe-worker.js")
Entry = tuple[str, str]
"""Title and page."""


def linked(page: Path, text: str | None = None) -> Iterator[Entry]:
    """Give text and target of every link of a page, or of a part of it, into the repository; the target as seen from its root."""
    for title, target in LINK.findall((ROOT / page).read_text("utf-8") if text is None else text):
        if ":" not in target:
            yield title.strip("`"), str((ROOT / page.parent / target).resolve().relative_to(ROOT))


def collect() -> list[Path]:
    """Return README.md and everything that can be reached from it by links."""
    found, left = dict[Path, None](), [Path("README.md")]
    while left:
        page = left.pop()
        if page not in found:
            found[page] = None
            left += [Path(target) for _, target in linked(page)] if page.suffix == ".md" else []
    return list(found)


def navigation(pages: list[Path]) -> list[dict[str, object]]:
    """Return the menu: the groups of the index, and behind them the pages that it does not list."""
    groups: dict[str, list[Entry]] = {}
    for row in (ROOT / INDEX).read_text("utf-8").splitlines():
        group = GROUP.match(row)
        if row.startswith("| ["):  # the table of the reference
            groups.setdefault(REFERENCE, []).extend(linked(INDEX, row))
        elif group is not None and group[1] != REFERENCE:
            groups[group[1]] = list(linked(INDEX, row))
    listed = {page for group in groups.values() for _, page in group} | {str(INDEX), "README.md", *ABOUT}
    others = sorted(str(page) for page in pages if page.suffix == ".md" and str(page) not in listed)
    groups |= {"change the code": [(_title(page), page) for page in others]}
    groups |= {"about": [(_title(page), page) for page in ABOUT]}
    menu: list[dict[str, object]] = [{"Start": "README.md"}]
    return menu + [
        {name.capitalize(): [{title: page} for title, page in group if page.endswith(".md")]}
        for name, group in groups.items()
    ]


def _title(page: str) -> str:
    return (ROOT / page).read_text("utf-8").partition("\n")[0].removeprefix("# ").strip("`")


def configuration(menu: list[dict[str, object]]) -> str:
    """Return the generator's file: nothing is fetched, and every page is a file that a browser opens."""
    return f"""[project]
site_name = "Lift manager"
docs_dir = "pages"
site_dir = "site"
use_directory_urls = false
nav = {_toml(menu)}

[project.theme]
font = false
features = ["navigation.tabs", "navigation.top", "content.code.copy", "search.highlight"]

[[project.theme.palette]]
media = "(prefers-color-scheme: light)"
scheme = "default"

[[project.theme.palette]]
media = "(prefers-color-scheme: dark)"
scheme = "slate"

[project.plugins.search]

[project.plugins.offline]
"""


def _toml(value: object) -> str:
    match value:
        case list():
            return f"[{', '.join(map(_toml, value))}]"
        case dict():
            return f"{{{', '.join(f'{json.dumps(key)} = {_toml(inner)}' for key, inner in value.items())}}}"
        case _:
            return json.dumps(value, ensure_ascii=False)


def build(site: Path) -> int:
    """Build into a folder; returns how many pages. Raises CalledProcessError if a link or an anchor leads nowhere."""
    pages = collect()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for page in pages:
            (folder / "pages" / page).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / page, folder / "pages" / page)
        (folder / "zensical.toml").write_text(configuration(navigation(pages)), "utf-8")
        command = [sys.executable, "-m", "zensical", "build", "--strict"]
        subprocess.run(command, cwd=folder, check=True)  # noqa: S603  our own arguments
        for html in (folder / "site").rglob("*.html"):
            up = "../" * (len(html.relative_to(folder / "site").parts) - 1)
            html.write_text(SHIM.sub(f"{up}{OWN_SHIM}", html.read_text("utf-8")), "utf-8")
        shutil.copy(ROOT / "docs" / "site" / "iframe-worker" / "index.js", folder / "site" / OWN_SHIM)
        if site.exists():
            shutil.rmtree(site)
        shutil.move(folder / "site", site)
    return sum(page.suffix == ".md" for page in pages)


def main(words: list[str] | None = None) -> None:
    """Build, and say where."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "build" / "site")
    site: Path = parser.parse_args(words).folder.resolve()
    if site.exists() and not (site / "sitemap.xml").is_file():
        parser.error(f"{site} is no site that was built here; name another folder")
    count = build(site)
    print(f"{count} pages: {site / 'index.html'}")


if __name__ == "__main__":
    main()
