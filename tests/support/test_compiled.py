"""What is compiled before the workers start is what pytest would have compiled, and no module is left to them."""

import sys
from pathlib import Path

from _pytest.assertion.rewrite import AssertionRewritingHook, _read_pyc

from tests.support.compiled import PACKAGES, ROOT, compiled_by_pytest, is_rewritten, rewrite


def test_pytest_takes_it_for_its_own(tmp_path: Path) -> None:
    source = tmp_path / "test_one.py"
    source.write_text("def test_one():\n    assert 1 == 2\n")
    rewrite(source)
    assert _read_pyc(source, compiled_by_pytest(source)) is not None


def test_it_knows_every_module_that_pytest_has_rewritten() -> None:
    specs = [spec for module in sys.modules.values() if (spec := getattr(module, "__spec__", None)) is not None]
    rewritten = [Path(spec.origin) for spec in specs if isinstance(spec.loader, AssertionRewritingHook)]
    ours = [file.relative_to(ROOT) for file in rewritten if file.is_relative_to(ROOT)]
    assert ours
    assert [file for file in ours if file.parts[0] in PACKAGES and not is_rewritten(file)] == []
