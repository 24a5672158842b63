"""The exceptions of the bench."""

from __future__ import annotations


class BenchError(Exception):
    """The bench cannot do what the test requests; the message says why."""


class BenchBroken(BenchError):
    """The manager or the simulator ended because of a bug; the bug itself is raised when the fixture ends."""


class ConditionNotMet(AssertionError):
    """A condition did not occur in time. An AssertionError, so that the test fails instead of ending with an error."""
