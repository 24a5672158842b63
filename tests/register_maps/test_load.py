"""Finding a map by name or path, and what comes with it."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import register_maps
from register_maps.codec import UNLISTED, compile_map
from register_maps.errors import MapFileError
from register_maps.load import load, shipped
from tests.support.examples import examples
from tests.support.rows import each_row

PACKAGE = Path(register_maps.__file__).parent
TRUE_WARNINGS: dict[str, list[str]] = {
    "seer-generic": ["only zeros would pass"],
    "thingweb-elevator": ["shows what go_to writes", "no door signal", "only zeros would pass"],
}
"""By map: words of the warnings that a shipped map deserves."""


def refusal(name: str | Path, near: Path | None = None) -> str:
    with pytest.raises(MapFileError) as caught:
        load(name, near=near)
    (finding,) = caught.value.findings
    assert finding.line is None
    return str(finding)


def test_the_shipped_maps_are_the_files_in_the_folder() -> None:
    assert list(shipped()) == sorted(path.stem for path in (PACKAGE / "maps").iterdir())
    assert {"generic-registers", "two-stop-agv"} <= set(shipped())


@each_row("name", shipped())
def test_a_shipped_map_has_no_problem_and_only_true_warnings(name: str) -> None:
    loaded = load(name)
    assert loaded.map.name == name
    assert loaded.path == PACKAGE / "maps" / f"{name}.yaml"
    assert loaded.sha256 == hashlib.sha256(loaded.path.read_bytes()).hexdigest()
    expected = TRUE_WARNINGS.get(name, [])
    assert len(loaded.warnings) == len(expected)
    assert all(words in str(warning) for words, warning in zip(expected, loaded.warnings, strict=True))


def test_an_unknown_name_gets_the_closest_and_the_list() -> None:
    text = refusal("generic-registrs")
    assert "did you mean `generic-registers`?" in text
    assert f"shipped are {', '.join(shipped())}" in text
    assert "./generic-registrs.yaml" in text


def test_a_name_like_no_other_gets_the_list() -> None:
    text = refusal("zzz")
    assert "did you mean" not in text
    assert "shipped are" in text


@each_row("path", ["here.yaml", "./here.yaml", "sub/../here.yaml", "here.yml"])
def test_a_path_is_relative_to_the_folder_it_is_near(tmp_path: Path, path: str) -> None:
    (tmp_path / "sub").mkdir(exist_ok=True)
    shutil.copy(PACKAGE / "maps" / "two-stop-agv.yaml", tmp_path / Path(path).name)
    assert load(path, near=tmp_path).map.name == "two-stop-agv"


def test_an_absolute_path_stays_what_it_is(tmp_path: Path) -> None:
    path = PACKAGE / "maps" / "two-stop-agv.yaml"
    assert load(str(path), near=tmp_path).path == path


def test_a_path_object_is_never_a_name(tmp_path: Path) -> None:
    assert "there is no such file" in refusal(Path("generic-registers"), near=tmp_path)


def test_a_file_next_to_a_shipped_name_does_not_replace_it(tmp_path: Path) -> None:
    (tmp_path / "generic-registers").write_text("schema: 2\n")
    assert load("generic-registers", near=tmp_path).path.parent == PACKAGE / "maps"


def test_a_missing_file_is_told_by_its_path(tmp_path: Path) -> None:
    assert refusal("maps/acme.yaml", near=tmp_path) == f"{tmp_path}/maps/acme.yaml: there is no such file"


def test_a_site_file_in_the_place_of_a_map_is_one_mistake(tmp_path: Path) -> None:
    site = tmp_path / "site.yaml"
    site.write_text("schema: 1\nname: lobby\ncontrollers: {plc: {map: generic-coils}}\nlifts: {}\n")
    with pytest.raises(MapFileError) as raised:
        load(site)
    (finding,) = raised.value.findings
    assert str(finding) == f"{site}: this is a site file and not a map; check it with `lift-manager check`"


def test_the_maps_are_found_wherever_the_package_is_installed(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "site" / "register_maps", ignore=shutil.ignore_patterns("__pycache__"))
    script = "import register_maps.load as l; print(l.__file__, *(l.load(name).map.name for name in l.shipped()))"
    command = [sys.executable, "-W", "error", "-c", script]
    result = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [str(tmp_path / "site/register_maps/load.py"), *shipped()]


PARTS = [re.split(r"([\w.:]+|\W)", (PACKAGE / "maps" / f"{name}.yaml").read_text()) for name in shipped()]
TROUBLE = (
    *("-1", "70000", "~", "1.5", ".nan", ".inf", "on", "[]", "{}", "&a", "*a", "!!set", "<<", "---", "? "),
    *("\t", "\x85", "\U0001f600", "9" * 30),
)
TOKENS = sorted({*TROUBLE, *(part for parts in PARTS for part in parts)})


@examples(60)
@given(
    st.sampled_from(PARTS), st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.sampled_from(TOKENS)), max_size=3)
)
def test_whatever_is_changed_in_a_map_is_a_finding_or_a_map_the_codec_can_use(
    parts: list[str], changes: list[tuple[float, str]]
) -> None:
    parts = parts.copy()
    for where, token in changes:
        parts[int(where * len(parts))] = token
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "changed.yaml"
        path.write_text("".join(parts))
        try:
            codec = compile_map(load(path).map)
        except MapFileError:
            return
    image = codec.empty_image()
    for signal in codec.signals.values():
        for raw in {signal.extract(image), *range(min(1 << sum(p.width for p in signal.points), 256))}:
            value = signal.decode(raw)
            assert value in (None, UNLISTED) or signal.decode(signal.encode(value)) == value
    for command in codec.commands.values():
        assert command.encode(None)
