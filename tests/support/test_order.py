"""The files that take longest begin first."""

import pytest

from tests.support.programs import ROOT


def test_each_file_that_begins_first_is_there(pytestconfig: pytest.Config) -> None:
    conftest = pytestconfig.pluginmanager.get_plugin(str(ROOT / "tests" / "conftest.py"))
    assert conftest is not None
    assert [name for name in conftest.LONGEST if not (ROOT / "tests" / name).is_file()] == []
