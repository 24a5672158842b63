"""The menu of the documentation's site: every page once, by the index. `scripts/docs` builds it; the links are checked in test_docs."""

import importlib.util
import tomllib
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.support.programs import ROOT


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    """The program, which is no part of a package."""
    spec = importlib.util.spec_from_file_location("build_site", ROOT / "docs" / "site" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def menu(builder: ModuleType) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = tomllib.loads(builder.configuration(builder.navigation(builder.collect())))[
        "project"
    ]["nav"]
    return found


def test_every_page_that_can_be_reached_is_in_the_menu_once(builder: ModuleType) -> None:
    listed = Counter[str]()
    for group in menu(builder):
        for entries in group.values():
            listed.update(
                [entries] if isinstance(entries, str) else [page for entry in entries for page in entry.values()]
            )
    reached = {str(page) for page in builder.collect() if page.suffix == ".md"}
    assert set(listed) == reached - {"docs/README.md"}, "the menu is that page"
    assert {page: count for page, count in listed.items() if count > 1} == {}
    of_docs = {str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md")}
    assert of_docs <= reached


def test_the_menu_has_the_groups_of_the_index_and_titles_without_markup(builder: ModuleType) -> None:
    names = [name for group in menu(builder) for name in group]
    assert names == [
        "Start", "Learn by doing", "Get something done", "Understand", "Look something up", "Change the code", "About",
    ]  # fmt: skip
    titles = [
        title
        for group in menu(builder)
        for rows in group.values()
        for row in rows
        if isinstance(row, dict)
        for title in row
    ]
    assert all(title and not set(title) & set("`[]#") for title in titles)
    assert "Your first ride" in titles


def test_pictures_and_files_that_a_page_names_come_along(builder: ModuleType) -> None:
    reached = {str(page) for page in builder.collect()}
    assert {"docs/how-to/the-page.png", "constraints/run.txt"} <= reached


def test_a_folder_that_is_no_site_is_not_replaced(builder: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("three years")
    with pytest.raises(SystemExit) as ended:
        builder.main([str(tmp_path)])
    assert ended.value.code == 2
    assert (tmp_path / "thesis.txt").read_text() == "three years"
