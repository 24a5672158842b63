"""How many examples a property is tried with: a few in every run, more where somebody asks for them by `EXAMPLES_TIMES=20`."""

import os

from hypothesis import settings

TIMES = int(os.environ.get("EXAMPLES_TIMES", "1"))


def examples(count: int) -> settings:
    """Try so many examples, the same in every run."""
    return settings(max_examples=count * TIMES, deadline=None, derandomize=True, database=None)
