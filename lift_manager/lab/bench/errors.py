"""What a test that uses the bench can be told."""

from __future__ import annotations


class BenchError(Exception):
    """What the test asks of the bench cannot be, with the reason in words."""


class BenchBroken(BenchError):
    """The manager or the simulator ended because of a bug; the bug itself is raised when the fixture ends."""


class NeverSeen(AssertionError):
    """What a test waited for did not come in its time. An AssertionError: the test fails, and is not in error."""
