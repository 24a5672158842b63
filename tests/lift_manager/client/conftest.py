"""What the tests of the client and of its commands begin with."""

import signal
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def a_closed_terminal_is_heard() -> Iterator[None]:
    """A test run under `nohup` ignores SIGHUP, and so would what it starts."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
