"""What the pages name is there: files, headings, commands and their options."""

import re
import shlex
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from typer.main import get_command

from lift_manager.cli.main import COMMANDS, app, load_command
from tests.support.pages import anchors, commands, inline_code, links, not_run, pages
from tests.support.programs import ROOT
from tests.support.rows import each_row

DOCS = [page for page in pages() if page.is_relative_to(ROOT / "docs")]
FOR_USERS = [*DOCS, ROOT / "README.md", *(ROOT / "register_maps").glob("*.md"), ROOT / "deploy" / "README.md"]


RUN_BY = {
    "README.md": "tests/test_readme.py",
    "docs/how-to/checkout-report.md": "tests/test_how_to.py",
    "docs/how-to/commissioning.md": "tests/test_how_to.py",
    "docs/how-to/doctor.md": "tests/test_how_to.py",
    "docs/how-to/hub.md": "tests/lift_manager/hub/test_processes.py",
    "docs/how-to/update-sites.md": "tests/lift_manager/hub/update/test_processes.py",
    "docs/how-to/keys-and-tls.md": "tests/test_how_to.py, and tests/external/test_stunnel.py for openssl",
    "docs/how-to/open-rmf.md": "tests/test_readme.py",
    "docs/how-to/people-first.md": "tests/test_how_to.py",
    "docs/how-to/the-panel.md": "tests/test_how_to.py",
    "docs/how-to/try-a-command.md": "tests/test_how_to.py",
    "docs/how-to/two-managers.md": "tests/lift_manager/cluster/test_set_up.py",
    "docs/how-to/watch-and-trace.md": "tests/test_how_to.py",
    "docs/reference/commands.md": "tests/test_how_to.py",
    "docs/reference/journal.md": "tests/test_how_to.py",
    "docs/tutorial/first-lift.md": "tests/test_readme.py",
    "docs/tutorial/first-ride.md": "tests/test_readme.py",
    "examples/building/README.md": "tests/test_building.py",
}
"""Pages with commands, and what runs every one of them that is not marked as `not-run`. Each of these tests takes its lines from the page."""


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def broken(page: Path) -> list[str]:
    """Return the links that lead to no file, or to no heading of a page."""
    found = []
    for link in links(page):
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        is_page = target.suffix == ".md" and target.is_file()
        if not target.is_file() or (anchor and is_page and anchor not in anchors(target)):
            found.append(link)
    return found


def test_every_relative_link_and_anchor_leads_somewhere() -> None:
    assert len(pages()) > 30
    assert {named(page): wrong for page in pages() if (wrong := broken(page))} == {}


def test_a_link_to_a_missing_file_or_heading_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    text = "# A `b`: c, d\n## E\n## E\n[1](#a-b-c-d) [2](#e-1) [3](#e-2) [4](none.md) [5](page.md#f) `[6](x)` [7](https://a.b)\n"
    page.write_text(f"{text}```\n[8](y)\n# F\n```\n")
    assert broken(page) == ["#e-2", "none.md", "page.md#f"]


def test_every_page_of_the_documentation_is_in_its_index() -> None:
    index = ROOT / "docs" / "README.md"
    listed = {(index.parent / link.partition("#")[0]).resolve() for link in links(index)}
    assert [named(page) for page in DOCS if page not in {*listed, index}] == []


WITH_MODULES = [
    *(
        f"lift_manager/{name}"
        for name in ("client", "config", "hub", "hub/update", "lift", "rides", "rmf", "runtime", "store", "web")
    ),
    "drivers",
    "drivers/modbus",
    "register_maps",
    "simulator",
]
"""Folders whose README, or that of the folder above, says what each of their modules is for."""


@each_row("folder", WITH_MODULES)
def test_the_readme_of_a_folder_names_every_module_in_it(folder: str) -> None:
    place = ROOT / folder
    readme = next(at / "README.md" for at in (place, place.parent) if (at / "README.md").is_file())
    patterns = re.findall(r"`([a-z_0-9*]+\.py)`", readme.read_text("utf-8"))
    modules = [path.name for path in place.glob("*.py") if path.name != "__init__.py"]
    assert [name for name in modules if not any(fnmatchcase(name, pattern) for pattern in patterns)] == []


def test_pages_link_only_inside_the_repository() -> None:
    outside = {named(page): link for page in pages() for link in links(page) if link.startswith("/")}
    assert outside == {}


def test_every_command_of_every_page_is_run_or_says_why_not() -> None:
    run = {named(page) for page in pages() if set(commands(page)) - set(not_run(page))}
    assert run == set(RUN_BY)


def test_a_reason_not_to_run_a_command_stands_for_its_block_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- not-run: needs a PLC -->\n```sh\na\nb\n```\n\n```sh\nc\n```\n")
    assert not_run(page) == {"a": "needs a PLC", "b": "needs a PLC"}


def parsed(words: list[str]) -> Any:
    """Return the context of a command line that click accepts; nothing runs."""
    command: Any = get_command(app)
    context = command.make_context("lift-manager", words[:1], resilient_parsing=True)
    command, rest = load_command(words[0]), words[1:]
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        context = command.make_context(command.name, [], parent=context, resilient_parsing=True)
        name, rest = rest[0], rest[1:]
        inner = command.get_command(context, name)
        assert inner is not None, f"no command {name!r}"
        command = inner
    return command.make_context(command.name, list(rest), parent=context)


def command_lines(page: Path) -> list[str]:
    """Return the lines of shell blocks that call the program, without comment, redirection and pipe."""
    lines = [
        line.removeprefix("sudo ").replace("/opt/lift-manager/bin/python -I -m lift_manager", "lift-manager")
        for line in commands(page)
    ]
    ours = [line.removeprefix(".venv/bin/") for line in lines]
    return [re.split(r" +#| [|>]", line)[0] for line in ours if line.startswith("lift-manager ")]


@each_row("page", [page for page in FOR_USERS if command_lines(page)])
def test_every_command_line_of_a_page_is_accepted_by_the_program(page: Path) -> None:
    for line in command_lines(page):
        assert parsed(shlex.split(line)[1:]), line


def helps(name: str, command: Any) -> Iterator[tuple[str, str]]:
    """Yield every command that does something, and its help."""
    inner = getattr(command, "commands", {})
    if not inner or command.invoke_without_command:
        yield name, command.help
    for word, part in inner.items():
        yield from helps(f"{name} {word}", part)


def test_every_help_has_an_example_that_the_program_accepts() -> None:
    for word in COMMANDS:
        for name, text in helps(word, load_command(word)):
            examples = re.findall(r"^Example: lift-manager (.*)$", text, re.MULTILINE)
            assert examples, name
            for example in examples:
                assert example.startswith(name), example
                assert parsed(shlex.split(example)), example


def known_options(name: str) -> set[str]:
    """Return the options of a command and of what is below it."""
    command = load_command(name)
    below = [*getattr(command, "commands", {}).values()]
    below = [*below, *(inner for found in below for inner in getattr(found, "commands", {}).values())]
    return {option for found in (command, *below) for parameter in found.params for option in parameter.opts}


def test_every_command_and_option_that_a_page_names_in_passing_exists() -> None:
    wrong = []
    for page in FOR_USERS:
        for code in inline_code(page):
            if not (match := re.match(r"(?:\.venv/bin/)?lift-manager +([a-z-]+)", code)):
                continue
            options = set(re.findall(r"(?<!\S)\[?(--[a-z-]+)", code)) - {"--help"}
            if match[1] not in COMMANDS or not options <= known_options(match[1]):
                wrong.append(f"{named(page)}: {code}")
    assert wrong == []
